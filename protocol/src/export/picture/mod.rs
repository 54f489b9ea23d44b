//! A raster as a picture: title, map on a neutral background, scale bar, legend.

mod canvas;

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use crate::export::picture::canvas::{Canvas, Rect, TextRenderer};
use crate::export::{ExportError, write_atomically};
use crate::layer::{Legend, Palette, Pattern, Ramp, Swatch, UNKNOWN};
use crate::mosaic::Raster;

const PAGE_COLOR: [u8; 3] = [250, 250, 251];
/// Bluish, distinct from the greys of an occupancy map.
const BACKGROUND: [u8; 3] = [180, 192, 206];
const TEXT_COLOR: [u8; 3] = [24, 28, 34];
/// Orange, as in \[LOD\] §5.
const VEHICLE_COLOR: [u8; 3] = [255, 140, 0];
/// Length of the scale bar in the pictures of \[LOD\] §5, metres.
const DOCUMENT_BAR_M: f64 = 1.0;
const FAINT_TEXT_COLOR: [u8; 3] = [92, 98, 108];

const MARGIN: u32 = 28;
const TITLE_PX: f32 = 30.0;
const TEXT_PX: f32 = 19.0;
const LINE_HEIGHT: u32 = 24;
/// Background around the map.
const MAP_PADDING: u32 = 14;
/// Minimum width of the background, for title and scale bar.
const BACKGROUND_SIDE_MIN: u32 = 420;

/// Text of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Caption<'a> {
    /// Printed above the map, for example the name of the recording.
    pub title: &'a str,
    /// Position of the vehicle in `odom`, metres: its cell is orange (\[LOD\] §5).
    pub vehicle_m: Option<[f64; 2]>,
    /// Labels on the map, the most important first: one without free space is omitted.
    pub labels: &'a [Label],
}

/// A label on the map.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// The text.
    pub text: String,
    /// What it names, in `odom`, metres. The label is beside it, with a line to it.
    pub at_m: [f64; 2],
}

/// Writes `raster` in the colours of `palette`.
///
/// Small maps are magnified by an integer factor. In maps of more than 4096 cells per side each
/// pixel shows the highest code of a square of cells, so that walls stay visible.
pub fn write_picture(
    path: &Path,
    raster: &Raster,
    palette: &Palette,
    caption: &Caption<'_>,
) -> Result<(), ExportError> {
    let canvas = draw(raster, palette, caption);
    write_atomically(path, |writer| Ok(encode(writer, &canvas)?))
}

fn encode(writer: &mut BufWriter<File>, canvas: &Canvas) -> Result<(), png::EncodingError> {
    let mut encoder = png::Encoder::new(writer, canvas.width(), canvas.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut image = encoder.write_header()?;
    image.write_image_data(canvas.rgb())?;
    image.finish()
}

/// Layout: title and subtitle, below them the map with the legend to its right, below the map the
/// scale bar.
fn draw(raster: &Raster, palette: &Palette, caption: &Caption<'_>) -> Canvas {
    let text_renderer = TextRenderer::new();
    let mut legend = palette.legend();
    let vehicle = caption
        .vehicle_m
        .and_then(|vehicle_m| raster.cell_of(vehicle_m[0], vehicle_m[1]));
    if vehicle.is_some() {
        let [red, green, blue] = VEHICLE_COLOR;
        let swatch = Swatch::plain([red, green, blue, 255], "vehicle".to_owned());
        legend.swatches.push(swatch);
    }
    let magnification = Magnification::of(raster);
    let (map_width, map_height) = magnification.pixels(raster);
    let legend_size = legend_size(&text_renderer, &legend);

    let title = caption.title;
    let heading = if title.is_empty() {
        raster.layer().name().to_owned()
    } else {
        format!("{title} — {}", raster.layer().name())
    };
    let heading_height = 2 * LINE_HEIGHT + 18;
    let ground = Rect::new(
        MARGIN,
        MARGIN + heading_height,
        (map_width + 2 * MAP_PADDING).max(BACKGROUND_SIDE_MIN),
        (map_height + 2 * MAP_PADDING).max(legend_size.1),
    );
    let legend_x = ground.right() + MARGIN;
    let heading_width = text_renderer.width(&heading, TITLE_PX);
    let page_width = (legend_x + legend_size.0).max(MARGIN + heading_width) + MARGIN;
    let page_height = ground.bottom() + SCALE_BAR_HEIGHT + MARGIN;

    let mut canvas = Canvas::new(page_width, page_height, PAGE_COLOR);
    text_renderer.draw(
        &mut canvas,
        (MARGIN, MARGIN),
        TITLE_PX,
        TEXT_COLOR,
        &heading,
    );
    let subtitle_y = MARGIN + LINE_HEIGHT + 14;
    let subtitle = subtitle(raster, &magnification);
    text_renderer.draw(
        &mut canvas,
        (MARGIN, subtitle_y),
        TEXT_PX,
        FAINT_TEXT_COLOR,
        &subtitle,
    );

    canvas.fill(ground, BACKGROUND);
    let map_x = ground.x + (ground.width - map_width) / 2;
    let map_y = ground.y + (ground.height - map_height) / 2;
    magnification.draw(&mut canvas, (map_x, map_y), raster, palette);
    if let Some(cell) = vehicle {
        let (x, y) = magnification.pixel_of(raster, cell);
        let side_px = magnification.pixels_per_cell as u32;
        let square = Rect::new(map_x + x, map_y + y, side_px, side_px);
        canvas.fill(square, VEHICLE_COLOR);
    }
    let labels = caption.labels.iter().filter_map(|label| {
        let cell = raster.cell_of(label.at_m[0], label.at_m[1])?;
        let (x, y) = magnification.pixel_of(raster, cell);
        Some((&*label.text, (map_x + x, map_y + y)))
    });
    draw_labels(&mut canvas, &text_renderer, ground, labels);
    draw_legend(&mut canvas, &text_renderer, (legend_x, ground.y), &legend);
    draw_scale_bar(
        &mut canvas,
        &text_renderer,
        (ground.x, ground.bottom()),
        magnification.pixels_per_m(raster.cell_m()),
        palette.is_document_palette().then_some(DOCUMENT_BAR_M),
        ground.width,
    );
    canvas
}

/// Distance of a label from what it names, pixels.
const LABEL_DISTANCE: u32 = 16;

fn draw_labels<'a>(
    canvas: &mut Canvas,
    text_renderer: &TextRenderer,
    ground: Rect,
    labels: impl Iterator<Item = (&'a str, (u32, u32))>,
) {
    let mut plates: Vec<Rect> = Vec::new();
    for (text, (x, y)) in labels {
        let (width, height) = (text_renderer.width(text, TEXT_PX) + 4, TEXT_PX as u32 + 2);
        // Columns and rows left and above; the others are right and below.
        let [left, right] = [
            x.checked_sub(LABEL_DISTANCE + width),
            Some(x + LABEL_DISTANCE),
        ];
        let [above, below] = [
            y.checked_sub(LABEL_DISTANCE + height),
            Some(y + LABEL_DISTANCE),
        ];
        let places = [(right, above), (left, above), (right, below), (left, below)];
        let plates_at = places
            .into_iter()
            .filter_map(|(x, y)| Some(Rect::new(x?, y?, width, height)));
        let is_free = |plate: &Rect| {
            ground.contains(*plate) && !plates.iter().any(|other| other.intersects(*plate))
        };
        let Some(plate) = plates_at.into_iter().find(is_free) else {
            continue;
        };
        let corner = (
            if plate.x > x { plate.x } else { plate.right() },
            if plate.y > y { plate.y } else { plate.bottom() },
        );
        canvas.line((x, y), corner, TEXT_COLOR);
        canvas.fill(plate, PAGE_COLOR);
        text_renderer.draw(canvas, (plate.x + 2, plate.y), TEXT_PX, TEXT_COLOR, text);
        plates.push(plate);
    }
}

fn subtitle(raster: &Raster, magnification: &Magnification) -> String {
    let ([x_min, y_min], [x_max, y_max]) = raster.corners_m();
    let cell_m = (raster.cell_m() * 1e4).round() / 1e4;
    let (width_m, height_m) = (x_max - x_min, y_max - y_min);
    let decimals = if width_m.min(height_m) < 10.0 { 2 } else { 1 };
    let size = format!("{width_m:.decimals$} × {height_m:.decimals$} m, cells of {cell_m} m");
    match magnification.cells_per_pixel {
        1 => size,
        cells => format!("{size}, a pixel is {cells} × {cells} cells"),
    }
}

/// Limit of the longer side of a magnified map, pixels.
const MAGNIFIED_SIDE_MAX: usize = 1000;
/// Limit of the longer side of a map, pixels.
const SIDE_MAX: usize = 4096;
const FACTOR_MAX: usize = 24;

/// Integer scale of a map; one of the two is 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Magnification {
    /// Edge of a cell, pixels.
    pixels_per_cell: usize,
    /// Edge of a pixel, cells.
    cells_per_pixel: usize,
}

impl Magnification {
    fn of(raster: &Raster) -> Self {
        let side = raster.width().max(raster.height());
        Self {
            pixels_per_cell: (MAGNIFIED_SIDE_MAX / side).clamp(1, FACTOR_MAX),
            cells_per_pixel: side.div_ceil(SIDE_MAX),
        }
    }

    /// Width and height of the map.
    fn pixels(self, raster: &Raster) -> (u32, u32) {
        let pixels = |cells: usize| cells.div_ceil(self.cells_per_pixel) * self.pixels_per_cell;
        (
            pixels(raster.width()) as u32,
            pixels(raster.height()) as u32,
        )
    }

    fn pixels_per_m(self, cell_m: f64) -> f64 {
        self.pixels_per_cell as f64 / (self.cells_per_pixel as f64 * cell_m)
    }

    /// Draws the map with its upper left corner at `at`, where its patterns start; up is greater y.
    fn draw(self, canvas: &mut Canvas, at: (u32, u32), raster: &Raster, palette: &Palette) {
        let (cells, side_px) = (self.cells_per_pixel, self.pixels_per_cell as u32);
        let (mut row, mut highest) = (Vec::new(), Vec::new());
        for (block_y, file_row) in (0..raster.height()).step_by(cells).zip(0_u32..) {
            highest_codes(raster, block_y, cells, &mut row, &mut highest);
            for (&code, column) in highest.iter().zip(0_u32..) {
                let square = Rect::new(
                    at.0 + column * side_px,
                    at.1 + file_row * side_px,
                    side_px,
                    side_px,
                );
                if palette.pattern(code) == Pattern::Plain {
                    canvas.fill(square, over_background(palette.color(code)));
                } else {
                    canvas.fill_with(square, |x, y| {
                        let [x, y] = [x - at.0, y - at.1].map(|pixel| pixel as usize);
                        over_background(palette.color_at(code, x, y))
                    });
                }
            }
        }
    }

    /// Upper left pixel of a cell, (column, row from the bottom) of `raster`, relative to the map.
    fn pixel_of(self, raster: &Raster, cell: (usize, usize)) -> (u32, u32) {
        let row = raster.height() - 1 - cell.1;
        let pixel = |cell| cell * self.pixels_per_cell / self.cells_per_pixel;
        (pixel(cell.0) as u32, pixel(row) as u32)
    }
}

/// Blends a colour with straight alpha over the background.
fn over_background([red, green, blue, alpha]: [u8; 4]) -> [u8; 3] {
    let color = [red, green, blue];
    std::array::from_fn(|channel| {
        let (over, under) = (u16::from(color[channel]), u16::from(BACKGROUND[channel]));
        let alpha = u16::from(alpha);
        ((over * alpha + under * (255 - alpha) + 127) / 255) as u8
    })
}

/// Sets `highest` to the highest code of each square of `cells` by `cells`, whose upper row is `y`
/// from the top; `row` is scratch memory.
fn highest_codes(
    raster: &Raster,
    y: usize,
    cells: usize,
    row: &mut Vec<u16>,
    highest: &mut Vec<u16>,
) {
    highest.clear();
    highest.resize(raster.width().div_ceil(cells), UNKNOWN);
    for y in y..(y + cells).min(raster.height()) {
        raster.read_row(raster.height() - 1 - y, row);
        for (highest, square) in highest.iter_mut().zip(row.chunks(cells)) {
            *highest = square.iter().copied().fold(*highest, u16::max);
        }
    }
}

const TITLE_WIDTH_MAX: u32 = 190;
const RAMP_WIDTH: u32 = 22;
const RAMP_HEIGHT: u32 = 240;
const TICK_LENGTH: u32 = 6;
const SWATCH_SIDE: u32 = 20;
const SWATCH_PITCH: u32 = 30;
const GAP: u32 = 12;

/// Size that [`draw_legend`] needs.
fn legend_size(text_renderer: &TextRenderer, legend: &Legend) -> (u32, u32) {
    let title = text_renderer.wrap(&legend.title, TEXT_PX, TITLE_WIDTH_MAX);
    let width_of = |text: &str| text_renderer.width(text, TEXT_PX);
    let titles = title.iter().map(|line| width_of(line));
    let swatches = legend.swatches.iter();
    let swatches = swatches.map(|swatch| SWATCH_SIDE + GAP + width_of(&swatch.label));
    let ticks = legend.ramp.iter().flat_map(|ramp| &ramp.ticks);
    let ticks = ticks.map(|tick| RAMP_WIDTH + TICK_LENGTH + 6 + width_of(&tick.label));
    let width = titles.chain(swatches).chain(ticks).max().unwrap_or(0);
    let ramp_height = if legend.ramp.is_some() {
        RAMP_HEIGHT + LINE_HEIGHT + GAP
    } else {
        0
    };
    let height = title.len() as u32 * LINE_HEIGHT
        + GAP
        + ramp_height
        + legend.swatches.len() as u32 * SWATCH_PITCH;
    (width, height)
}

/// Draws the legend with its upper left corner at `at`.
fn draw_legend(canvas: &mut Canvas, text_renderer: &TextRenderer, at: (u32, u32), legend: &Legend) {
    let (x, mut y) = at;
    for line in text_renderer.wrap(&legend.title, TEXT_PX, TITLE_WIDTH_MAX) {
        text_renderer.draw(canvas, (x, y), TEXT_PX, TEXT_COLOR, &line);
        y += LINE_HEIGHT;
    }
    y += GAP;
    if let Some(ramp) = &legend.ramp {
        // Half a line above and below, for the labels of the ends.
        y += LINE_HEIGHT / 2;
        draw_ramp(canvas, text_renderer, (x, y), ramp);
        y += RAMP_HEIGHT + LINE_HEIGHT / 2 + GAP;
    }
    for swatch in &legend.swatches {
        let square = Rect::new(x, y, SWATCH_SIDE, SWATCH_SIDE);
        canvas.fill(square, FAINT_TEXT_COLOR);
        canvas.fill_with(square.inside(), |x, y| {
            let [x, y] = [x - square.x, y - square.y].map(|pixel| pixel as usize);
            over_background(swatch.color_at(x, y))
        });
        let label_x = square.right() + GAP;
        text_renderer.draw(canvas, (label_x, y), TEXT_PX, TEXT_COLOR, &swatch.label);
        y += SWATCH_PITCH;
    }
}

fn draw_ramp(canvas: &mut Canvas, text_renderer: &TextRenderer, at: (u32, u32), ramp: &Ramp) {
    let (x, y) = at;
    let bar = Rect::new(x, y, RAMP_WIDTH, RAMP_HEIGHT);
    canvas.fill(bar, FAINT_TEXT_COLOR);
    let span = ramp.high - ramp.low;
    for row in 1..RAMP_HEIGHT - 1 {
        let part = 1.0 - (row as f32 - 0.5) / (RAMP_HEIGHT - 2) as f32;
        let [red, green, blue, _] = ramp.color(ramp.low + span * part);
        let line = Rect::new(x + 1, y + row, RAMP_WIDTH - 2, 1);
        canvas.fill(line, [red, green, blue]);
    }
    for tick in &ramp.ticks {
        let part = (tick.value - ramp.low) / span;
        let tick_y = y + ((1.0 - part) * (RAMP_HEIGHT - 1) as f32).round() as u32;
        let mark = Rect::new(bar.right(), tick_y, TICK_LENGTH, 1);
        canvas.fill(mark, FAINT_TEXT_COLOR);
        let label = (mark.right() + 6, tick_y.saturating_sub(LINE_HEIGHT / 2 - 2));
        text_renderer.draw(canvas, label, TEXT_PX, TEXT_COLOR, &tick.label);
    }
}

/// Height that [`draw_scale_bar`] needs.
const SCALE_BAR_HEIGHT: u32 = 44;
const BAR_PX_MAX: f64 = 240.0;
const BAR_PX_MIN: f64 = 10.0;
const BAR_TOP: u32 = 16;
const BAR_HEIGHT: u32 = 9;

/// Draws the bar, `wanted_m` long if that is possible, with its label to the right; `at` is the
/// upper left corner.
fn draw_scale_bar(
    canvas: &mut Canvas,
    text_renderer: &TextRenderer,
    at: (u32, u32),
    pixels_per_m: f64,
    wanted_m: Option<f64>,
    width_max: u32,
) {
    let fits_m = BAR_PX_MAX.min(f64::from(width_max) * 0.5) / pixels_per_m;
    let can_be_seen = |length_m: &f64| length_m * pixels_per_m >= BAR_PX_MIN;
    let length_m = wanted_m
        .map(|length_m| length_m.min(fits_m))
        .filter(can_be_seen)
        .unwrap_or_else(|| round_length_m(fits_m));
    let (x, y) = (at.0, at.1 + BAR_TOP);
    let width = (length_m * pixels_per_m).round().max(1.0) as u32;
    let bar = Rect::new(x, y, width, BAR_HEIGHT);
    canvas.fill(bar, TEXT_COLOR);
    // The second half is white, so that the bar also shows half its length.
    let half = Rect::new(
        x + width / 2,
        y + 1,
        (width - width / 2).saturating_sub(1),
        BAR_HEIGHT - 2,
    );
    canvas.fill(half, [255; 3]);
    let label = (bar.right() + 10, y.saturating_sub(6));
    text_renderer.draw(canvas, label, TEXT_PX, TEXT_COLOR, &length_label(length_m));
}

/// Length of a scale bar, metres: the greatest of 1, 2 and 5 times a power of ten up to
/// `length_max_m`.
pub fn round_length_m(length_max_m: f64) -> f64 {
    let mut power = 1e-3;
    while power * 10.0 <= length_max_m && power < 1e9 {
        power *= 10.0;
    }
    [5.0, 2.0]
        .into_iter()
        .map(|factor| factor * power)
        .find(|&length| length <= length_max_m)
        .unwrap_or(power)
}

/// Label of a length in metres.
pub fn length_label(length_m: f64) -> String {
    let rounded = |value: f64| (value * 1000.0).round() / 1000.0;
    if length_m >= 1000.0 {
        format!("{} km", rounded(length_m / 1000.0))
    } else if length_m >= 1.0 {
        format!("{} m", rounded(length_m))
    } else {
        format!("{} cm", rounded(length_m * 100.0))
    }
}

#[cfg(test)]
mod tests {
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
            MARGIN + MAP_PADDING + x,
            MARGIN + 2 * LINE_HEIGHT + 18 + MAP_PADDING + y,
        );
        let plates = |reach: u32| {
            let rows = y - reach..=y + reach;
            let pixels =
                rows.flat_map(|row| (x - reach..=x + reach).map(move |column| (column, row)));
            pixels
                .filter(|&(x, y)| pixel(&canvas, x, y) == PAGE_COLOR)
                .count() as u32
        };
        assert_eq!(plates(LABEL_DISTANCE - 1), 0);
        assert_eq!(pixel(&canvas, x, y), TEXT_COLOR, "the line begins here");
        let widths = labels[..4].iter();
        let widths = widths.map(|label| TextRenderer::new().width(&label.text, TEXT_PX) + 4);
        let area = widths.sum::<u32>() * (TEXT_PX as u32 + 2);
        let free = plates(60);
        assert!(free < area && 2 * free > area, "{free} of {area}");
    }
}
