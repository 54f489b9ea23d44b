use super::*;
use crate::export::tests::raster_of;
use crate::layer::LayerId;

fn pixel(canvas: &Canvas, x: u32, y: u32) -> [u8; 3] {
    let start = 3 * (y as usize * canvas.width() as usize + x as usize);
    canvas.rgb()[start..start + 3].try_into().unwrap()
}

#[test]
fn map_is_upright_and_coloured() {
    let raster = raster_of(LayerId::Obstacle, 0.5, 10, 10, |x, y| match (x, y) {
        (0, 0) | (9, 9) => 1,
        (9, 0) => 2,
        _ => 0,
    });
    let palette = LayerId::Obstacle.default_palette();
    let canvas = draw(&raster, &palette, &Caption::default());
    let magnification = Magnification::of(&raster);
    assert_eq!(magnification.pixels_per_cell, 24);
    let [red, green, blue, _] = palette.color(2);
    let obstacle: Vec<(u32, u32)> = (0..canvas.height())
        .flat_map(|y| (0..MARGIN + BACKGROUND_SIDE_MIN).map(move |x| (x, y)))
        .filter(|&(x, y)| pixel(&canvas, x, y) == [red, green, blue])
        .collect();
    assert_eq!(obstacle.len(), 24 * 24, "one cell, lower right");
    let (x, y) = obstacle[0];
    assert_eq!(
        pixel(&canvas, x, y - 1),
        BACKGROUND,
        "unknown shows the ground"
    );
    let [red, green, blue, _] = palette.color(1);
    assert_eq!(
        pixel(&canvas, x, y - 9 * 24),
        [red, green, blue],
        "upper right is free"
    );
}

#[test]
fn huge_maps_are_reduced_and_keep_their_walls() {
    let raster = raster_of(LayerId::Occupancy, 0.1, 9000, 20, |x, _| {
        if x == 4501 { 246 } else { 6 }
    });
    assert_eq!(Magnification::of(&raster).cells_per_pixel, 3);
    let palette = LayerId::Occupancy.default_palette();
    let canvas = draw(&raster, &palette, &Caption::default());
    assert!(canvas.width() < 3000 + 400, "{}", canvas.width());
    let [wall, ..] = palette.color(246);
    let dark = canvas
        .rgb()
        .chunks(3)
        .filter(|pixel| **pixel == [wall; 3])
        .count();
    assert!(dark >= 7, "the wall has vanished");
}

#[test]
fn the_vehicles_cell_is_orange_and_the_documents_bar_is_a_metre() {
    let raster = raster_of(LayerId::Elevation, 0.2, 50, 50, |_, _| 32768);
    let palette = LayerId::Elevation.document_palette().unwrap();
    let center_m = 0.2 * (25.5);
    let corner_m = raster.corners_m().0;
    let caption = Caption {
        title: "",
        vehicle_m: Some([corner_m[0] + center_m, corner_m[1] + 0.1]),
        labels: &[],
    };
    let canvas = draw(&raster, &palette, &caption);
    let count = |color: [u8; 3], rows: std::ops::Range<u32>| {
        rows.flat_map(|y| (0..MARGIN + 1000 + 2 * MAP_PADDING).map(move |x| (x, y)))
            .filter(|&(x, y)| pixel(&canvas, x, y) == color)
            .count()
    };
    let map_bottom = canvas.height() - SCALE_BAR_HEIGHT - MARGIN;
    assert_eq!(
        count(VEHICLE_COLOR, 0..map_bottom),
        20 * 20,
        "one cell of 20 pixels"
    );
    assert_eq!(
        count([40, 80, 220], 0..map_bottom),
        (2500 - 1) * 400,
        "ground is blue"
    );
    // 1 m is 100 pixels: half of it white inside its frame.
    assert_eq!(count([255; 3], map_bottom..canvas.height()), 49 * 7);
}

/// Marks of `palette`'s pattern for `code` in the map's upper left square of `side` pixels.
fn marks(raster: &Raster, palette: &Palette, code: u16, side: u32) -> Vec<(u32, u32)> {
    let canvas = draw(raster, palette, &Caption::default());
    let (width, height) = Magnification::of(raster).pixels(raster);
    let ground_width = (width + 2 * MAP_PADDING).max(BACKGROUND_SIDE_MIN);
    let x0 = MARGIN + (ground_width - width) / 2;
    let legend_height = legend_size(&TextRenderer::new(), &palette.legend()).1;
    let ground_height = (height + 2 * MAP_PADDING).max(legend_height);
    let y0 = MARGIN + 2 * LINE_HEIGHT + 18 + (ground_height - height) / 2;
    let [red, green, blue, _] = palette.mark_color(code);
    let pixels = (0..side).flat_map(|y| (0..side).map(move |x| (x, y)));
    pixels
        .filter(|&(x, y)| pixel(&canvas, x0 + x, y0 + y) == [red, green, blue])
        .collect()
}

#[test]
fn patterns_are_as_fine_on_large_cells_as_on_small_ones() {
    let palette = LayerId::Shore.default_palette();
    for code in 1..=4 {
        // Cells of one pixel, and of 24.
        let small = raster_of(LayerId::Shore, 0.3, 900, 900, |_, _| code);
        let large = raster_of(LayerId::Shore, 0.3, 4, 4, |_, _| code);
        let pattern = palette.pattern(code);
        let pixels = (0..48).flat_map(|y| (0..48).map(move |x| (x, y)));
        let expected: Vec<_> = pixels
            .filter(|&(x, y)| pattern.is_mark(x as usize, y as usize))
            .collect();
        assert!(expected.len() >= 48 * 48 / 8, "{code}");
        assert_eq!(marks(&small, &palette, code, 48), expected, "{code}");
        assert_eq!(marks(&large, &palette, code, 48), expected, "{code}");
    }
}
