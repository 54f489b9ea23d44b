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
        .flat_map(|y| (0..MARGIN + AXIS_WIDTH + BACKGROUND_SIDE_MIN).map(move |x| (x, y)))
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
    assert!(canvas.width() < 3000 + 3 * 450, "{}", canvas.width());
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
        ..Caption::default()
    };
    let canvas = draw(&raster, &palette, &caption);
    let count = |color: [u8; 3], rows: std::ops::Range<u32>| {
        rows.flat_map(|y| (0..MARGIN + AXIS_WIDTH + 1000 + 2 * MAP_PADDING).map(move |x| (x, y)))
            .filter(|&(x, y)| pixel(&canvas, x, y) == color)
            .count()
    };
    let map_bottom = canvas.height() - AXIS_HEIGHT - SCALE_BAR_HEIGHT - MARGIN;
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
    let x0 = MARGIN + AXIS_WIDTH + (ground_width - width) / 2;
    let legend_height = legend_size(&TextRenderer::new(1), &palette.legend()).1;
    let ground_height = (height + 2 * MAP_PADDING).max(legend_height);
    let y0 = MARGIN + HEADING_HEIGHT + (ground_height - height) / 2;
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

fn pose(secs: i64, x_m: f64, y_m: f64, yaw_rad: f64) -> StampedPose {
    let (sin, cos) = libm::sincos(0.5 * yaw_rad);
    StampedPose::new(secs * 1_000_000_000, [x_m, y_m, 0.0], [0.0, 0.0, sin, cos])
}

#[test]
fn path_dates_and_the_vehicle_to_scale_are_on_the_picture() {
    let raster = raster_of(LayerId::Occupancy, 0.1, 100, 100, |_, _| 6);
    let palette = LayerId::Occupancy.default_palette();
    let ([x_m, y_m], _) = raster.corners_m();
    // 4 m to the right, then up; it heads up at the end.
    let begin_s = 946_684_800;
    let path = [
        pose(begin_s, x_m + 1.0, y_m + 1.0, 0.0),
        pose(begin_s + 8, x_m + 5.0, y_m + 1.0, 0.0),
        pose(
            begin_s + 13,
            x_m + 5.0,
            y_m + 4.0,
            std::f64::consts::FRAC_PI_2,
        ),
    ];
    assert_eq!(
        dates(&path),
        "2000-01-01 00:00:00 to 00:00:13 UTC, path of 7.0 m"
    );
    assert_eq!(dates(&[]), "");
    assert_eq!(dates(&[pose(5, 0.0, 0.0, 0.0)]), "path of 0.0 m");
    let caption = Caption {
        vehicle_m: Some([x_m + 5.0, y_m + 4.0]),
        path: &path,
        footprint: Some(Footprint {
            length_m: 1.0,
            width_m: 0.5,
            offset_m: 0.0,
        }),
        ..Caption::default()
    };
    let canvas = draw(&raster, &palette, &caption);
    // 0.1 m are 10 pixels.
    let map = (
        MARGIN + AXIS_WIDTH + MAP_PADDING,
        MARGIN + HEADING_HEIGHT + MAP_PADDING,
    );
    let at = |x_m: f64, y_m: f64| {
        let [x, y] = [100.0 * x_m, 100.0 * (10.0 - y_m)].map(|px| px as u32);
        pixel(&canvas, map.0 + x, map.1 + y)
    };
    assert_eq!(at(3.0, 1.0), PATH_COLOR);
    assert_eq!(at(5.0, 2.0), PATH_COLOR);
    assert_ne!(at(3.0, 1.1), PATH_COLOR);
    assert_eq!(at(5.2, 3.6), VEHICLE_COLOR, "as wide as it is");
    assert_ne!(at(5.3, 3.6), VEHICLE_COLOR);
    assert_eq!(at(5.0, 4.45), TEXT_COLOR, "its front");
    assert_ne!(at(5.0, 4.55), TEXT_COLOR, "as long as it is");
    // The axes have a tick at each 1 m: the picture begins at (-2, -1) m.
    let y = map.1 + 1000 + MAP_PADDING;
    let ticks = (0..canvas.width()).filter(|&x| pixel(&canvas, x, y) == FAINT_TEXT_COLOR);
    let expected: Vec<_> = (0..=10).map(|n| map.0 + 100 * n).collect();
    assert_eq!(ticks.collect::<Vec<_>>(), expected);
}

#[test]
fn ticks_are_coordinates() {
    for (n, step_m, label) in [
        (-3, 5.0, "-15 m"),
        (0, 0.5, "0.0 m"),
        (7, 0.1, "0.7 m"),
        (-1, 0.05, "-0.05 m"),
    ] {
        assert_eq!(tick_label(n, step_m), label);
    }
}

#[test]
fn text_grows_with_the_picture() {
    let canvas = |side| {
        let raster = raster_of(LayerId::Occupancy, 0.1, side, side, |_, _| 6);
        let palette = LayerId::Occupancy.default_palette();
        draw(&raster, &palette, &Caption::default())
    };
    let border = |side| canvas(side).height() - side as u32;
    assert_eq!(border(3000), 3 * border(1000));
}

#[test]
fn lengths_are_round_and_fit() {
    let check = |length_max_m: f64, expected: &str| {
        assert_eq!(
            length_label(round_length_m(length_max_m)),
            expected,
            "{length_max_m}"
        );
    };
    check(24.0, "20 m");
    check(9.99, "5 m");
    check(1.0, "1 m");
    check(0.57, "50 cm");
    check(0.024, "2 cm");
    check(4100.0, "2 km");
}

#[test]
fn labels_are_beside_what_they_name_and_do_not_overlap() {
    let raster = raster_of(LayerId::Shore, 0.5, 200, 200, |_, _| 3);
    let palette = LayerId::Shore.default_palette();
    let (low_m, high_m) = raster.corners_m();
    let at_m = [0, 1].map(|axis| 0.5 * (low_m[axis] + high_m[axis]));
    // There are four places around it.
    let labels = ["A", "B", "C", "D", "E"].map(|text| Label {
        text: text.to_owned(),
        at_m,
    });
    let caption = Caption {
        labels: &labels,
        ..Caption::default()
    };
    let canvas = draw(&raster, &palette, &caption);
    let cell = raster.cell_of(at_m[0], at_m[1]).unwrap();
    let (x, y) = Magnification::of(&raster).pixel_of(&raster, cell);
    let (x, y) = (
        MARGIN + AXIS_WIDTH + MAP_PADDING + x,
        MARGIN + HEADING_HEIGHT + MAP_PADDING + y,
    );
    let plates = |reach: u32| {
        let rows = y - reach..=y + reach;
        let pixels = rows.flat_map(|row| (x - reach..=x + reach).map(move |column| (column, row)));
        pixels
            .filter(|&(x, y)| pixel(&canvas, x, y) == PAGE_COLOR)
            .count() as u32
    };
    assert_eq!(plates(LABEL_DISTANCE - 1), 0);
    assert_eq!(pixel(&canvas, x, y), TEXT_COLOR, "the line begins here");
    let widths = labels[..4].iter();
    let widths = widths.map(|label| TextRenderer::new(1).width(&label.text, TEXT_PX) + 4);
    let area = widths.sum::<u32>() * (TEXT_PX as u32 + 2);
    let free = plates(60);
    assert!(free < area && 2 * free > area, "{free} of {area}");
}
