//! A raster as a picture: title and dates, map with path and vehicle on a neutral background, axes, scale bar, legend.

mod canvas;

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use crate::contours::contours;
use crate::export::date::span_label;
use crate::export::picture::canvas::{Canvas, Rect, TextRenderer};
use crate::export::{ExportError, StampedPose, write_atomically};
use crate::layer::{LayerId, Legend, Palette, Pattern, Ramp, Swatch};
use crate::message::Datum;
use crate::mosaic::Raster;

const PAGE_COLOR: [u8; 3] = [250, 250, 251];
/// Bluish, distinct from the greys of an occupancy map.
const BACKGROUND: [u8; 3] = [180, 192, 206];
const TEXT_COLOR: [u8; 3] = [24, 28, 34];
/// Orange, as in \[LOD\] §5.
const VEHICLE_COLOR: [u8; 3] = [255, 140, 0];
/// Length of the scale bar in the pictures of \[LOD\] §5, metres.
const DOCUMENT_BAR_M: f64 = 1.0;
/// Magenta, in no palette of a layer.
const PATH_COLOR: [u8; 3] = [196, 0, 122];
/// Grey, so that a path is not taken for one.
const CONTOUR_COLOR: [u8; 3] = [70, 70, 70];
const FAINT_TEXT_COLOR: [u8; 3] = [92, 98, 108];

const MARGIN: u32 = 28;
/// Title, subtitle and dates.
const HEADING_HEIGHT: u32 = 3 * LINE_HEIGHT + 18;
const TITLE_PX: f32 = 30.0;
const TEXT_PX: f32 = 19.0;
const LINE_HEIGHT: u32 = 24;
/// Of the numbers at the axes.
const AXIS_PX: f32 = 15.0;
/// Space for the numbers left of the map.
const AXIS_WIDTH: u32 = 62;
/// Space for the numbers below the map.
const AXIS_HEIGHT: u32 = 26;
/// Least distance of two ticks of an axis.
const TICK_DISTANCE_MIN: f64 = 70.0;
/// Maps of so many pixels per side, and of multiples of it, get text of this size, and of multiples of it.
const UNSCALED_SIDE: u32 = 1000;
const PATH_WIDTH: u32 = 2;
/// A vehicle that is drawn shorter is enlarged.
const VEHICLE_LENGTH_MIN: f64 = 12.0;
/// Background around the map.
const MAP_PADDING: u32 = 14;
/// Minimum width of the background, for title and scale bar.
const BACKGROUND_SIDE_MIN: u32 = 420;

/// What exports say beside the cells.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Caption<'a> {
    /// Printed above the map, for example the name of the recording.
    pub title: &'a str,
    /// Position of the vehicle in `odom`, metres: its cell is orange (\[LOD\] §5).
    pub vehicle_m: Option<[f64; 2]>,
    /// Path of the vehicle, in the order of time: a line, its dates, and the heading of the vehicle.
    pub path: &'a [StampedPose],
    /// Size of the vehicle, which is drawn at the end of the path.
    pub footprint: Option<Footprint>,
    /// Where on Earth `odom` is, for the files that say so.
    pub datum: Option<Datum>,
    /// Labels on the map, the most important first: one without free space is omitted.
    pub labels: &'a [Label],
}

/// A rectangle under the vehicle, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Along x of `base_link`.
    pub length_m: f64,
    /// Along y of `base_link`.
    pub width_m: f64,
    /// From `base_link` forward to the middle.
    pub offset_m: f64,
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
/// pixel shows the code of a square of cells that decides, so that walls stay visible.
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

/// Layout: title, subtitle and dates, below them the map with the legend to its right, below the map the scale bar.
fn draw(raster: &Raster, palette: &Palette, caption: &Caption<'_>) -> Canvas {
    let magnification = Magnification::of(raster);
    let (map_width, map_height) = magnification.pixels(raster);
    let text_renderer = TextRenderer::new((map_width.max(map_height) / UNSCALED_SIDE).max(1));
    let px = |length| text_renderer.px(length);
    let vehicle = caption
        .vehicle_m
        .filter(|vehicle_m| raster.cell_of(vehicle_m[0], vehicle_m[1]).is_some());
    let mut legend = palette.legend();
    for (is_drawn, [red, green, blue], name) in [
        (vehicle.is_some(), VEHICLE_COLOR, "vehicle"),
        (!caption.path.is_empty(), PATH_COLOR, "path"),
    ] {
        let swatch = Swatch::plain([red, green, blue, 255], name.to_owned());
        legend.swatches.extend(is_drawn.then_some(swatch));
    }
    let legend_size = legend_size(&text_renderer, &legend);

    let title = caption.title;
    let heading = if title.is_empty() {
        raster.layer().name().to_owned()
    } else {
        format!("{title} — {}", raster.layer().name())
    };
    let ground = Rect::new(
        px(MARGIN + AXIS_WIDTH),
        px(MARGIN + HEADING_HEIGHT),
        (map_width + px(2 * MAP_PADDING)).max(px(BACKGROUND_SIDE_MIN)),
        (map_height + px(2 * MAP_PADDING)).max(legend_size.1),
    );
    let legend_x = ground.right() + px(MARGIN);
    let lines = [subtitle(raster, &magnification), dates(caption.path)];
    let heading_width = lines
        .iter()
        .map(|line| text_renderer.width(line, TEXT_PX))
        .fold(text_renderer.width(&heading, TITLE_PX), u32::max);
    let page_width = (legend_x + legend_size.0).max(px(MARGIN) + heading_width) + px(MARGIN);
    let page_height = ground.bottom() + px(AXIS_HEIGHT + SCALE_BAR_HEIGHT + MARGIN);

    let mut canvas = Canvas::new(page_width, page_height, PAGE_COLOR);
    let corner = (px(MARGIN), px(MARGIN));
    text_renderer.draw(&mut canvas, corner, TITLE_PX, TEXT_COLOR, &heading);
    for (line, y) in lines.iter().zip([LINE_HEIGHT + 14, 2 * LINE_HEIGHT + 14]) {
        let at = (px(MARGIN), px(MARGIN + y));
        text_renderer.draw(&mut canvas, at, TEXT_PX, FAINT_TEXT_COLOR, line);
    }

    canvas.fill(ground, BACKGROUND);
    let map = Rect::new(
        ground.x + (ground.width - map_width) / 2,
        ground.y + (ground.height - map_height) / 2,
        map_width,
        map_height,
    );
    magnification.draw(&mut canvas, (map.x, map.y), raster, palette);
    let view = View {
        raster,
        ground,
        map,
        pixels_per_m: magnification.pixels_per_m(raster.cell_m()),
    };
    view.draw_axes(&mut canvas, &text_renderer);
    if raster.layer() == LayerId::Depth {
        for contour in contours(raster) {
            let points = contour.points.iter();
            let points = points.map(|cells| cells.map(|n| n * raster.cell_m()));
            view.draw_line(&mut canvas, points, px(1), CONTOUR_COLOR);
        }
    }
    let path = caption.path.iter().map(|pose| {
        let [x_m, y_m, _] = pose.position_m();
        [x_m, y_m]
    });
    view.draw_line(&mut canvas, path, px(PATH_WIDTH), PATH_COLOR);
    if let Some(vehicle_m) = vehicle {
        match (caption.footprint, caption.path.last()) {
            (Some(footprint), Some(pose)) => {
                let length_min_px = f64::from(text_renderer.px(1)) * VEHICLE_LENGTH_MIN;
                let pose = (vehicle_m, pose.yaw_rad());
                view.draw_vehicle(&mut canvas, pose, footprint, length_min_px);
            }
            (None, _) | (_, None) => {
                if let Some(cell) = raster.cell_of(vehicle_m[0], vehicle_m[1]) {
                    let (x, y) = magnification.pixel_of(raster, cell);
                    let side_px = magnification.pixels_per_cell as u32;
                    let square = Rect::new(map.x + x, map.y + y, side_px, side_px);
                    canvas.fill(square, VEHICLE_COLOR);
                }
            }
        }
    }
    let labels = caption.labels.iter().filter_map(|label| {
        let cell = raster.cell_of(label.at_m[0], label.at_m[1])?;
        let (x, y) = magnification.pixel_of(raster, cell);
        Some((&*label.text, (map.x + x, map.y + y)))
    });
    draw_labels(&mut canvas, &text_renderer, ground, labels);
    draw_legend(&mut canvas, &text_renderer, (legend_x, ground.y), &legend);
    draw_scale_bar(
        &mut canvas,
        &text_renderer,
        (ground.x, ground.bottom() + px(AXIS_HEIGHT)),
        view.pixels_per_m,
        palette.is_document_palette().then_some(DOCUMENT_BAR_M),
        ground.width,
    );
    canvas
}

/// First and last date, and length of a path; empty without one.
fn dates(path: &[StampedPose]) -> String {
    let (Some(first), Some(last)) = (path.first(), path.last()) else {
        return String::new();
    };
    let steps = path.windows(2).map(|step| {
        let [from, to] = [step[0].position_m(), step[1].position_m()];
        libm::hypot(to[0] - from[0], to[1] - from[1])
    });
    // The sum of nothing would be -0.
    let length_m = steps.fold(0.0, |sum, step_m| sum + step_m);
    match span_label(first.stamp_ns, last.stamp_ns) {
        Some(span) => format!("{span}, path of {length_m:.1} m"),
        None => format!("path of {length_m:.1} m"),
    }
}

/// Where points of `odom` are on the page.
struct View<'a> {
    raster: &'a Raster,
    /// Neutral background, which contains the map.
    ground: Rect,
    map: Rect,
    pixels_per_m: f64,
}

impl View<'_> {
    /// Pixel of a point of `odom`, not limited to the page.
    fn pixel_of(&self, [x_m, y_m]: [f64; 2]) -> [f64; 2] {
        let ([x_min_m, _], [_, y_max_m]) = self.raster.corners_m();
        [
            f64::from(self.map.x) + (x_m - x_min_m) * self.pixels_per_m,
            f64::from(self.map.y) + (y_max_m - y_m) * self.pixels_per_m,
        ]
    }

    /// Ticks with their coordinates in `odom` at the left and lower edge of the background.
    fn draw_axes(&self, canvas: &mut Canvas, text_renderer: &TextRenderer) {
        let ground = self.ground;
        let tick_px = text_renderer.px(TICK_LENGTH);
        let distance_min_m = TICK_DISTANCE_MIN * f64::from(text_renderer.px(1)) / self.pixels_per_m;
        // The lengths 1, 2, 5, 10, … are at most 2.5 times their predecessors.
        let step_m = round_length_m(2.5 * distance_min_m);
        let [x0, y0] = self.pixel_of([0.0, 0.0]);
        let step_px = step_m * self.pixels_per_m;
        let ticks = |from_px: f64, to_px: f64| {
            (libm::ceil(from_px / step_px) as i64)..=(libm::floor(to_px / step_px) as i64)
        };
        for n in ticks(f64::from(ground.x) - x0, f64::from(ground.right()) - x0) {
            let x = (x0 + n as f64 * step_px) as u32;
            let mark = Rect::new(x, ground.bottom(), text_renderer.px(1), tick_px);
            canvas.fill(mark, FAINT_TEXT_COLOR);
            let label = tick_label(n, step_m);
            let half = text_renderer.width(&label, AXIS_PX) / 2;
            let at = (x.saturating_sub(half), mark.bottom() + text_renderer.px(1));
            text_renderer.draw(canvas, at, AXIS_PX, FAINT_TEXT_COLOR, &label);
        }
        for n in ticks(y0 - f64::from(ground.bottom()), y0 - f64::from(ground.y)) {
            let y = (y0 - n as f64 * step_px) as u32;
            let mark = Rect::new(ground.x - tick_px, y, tick_px, text_renderer.px(1));
            canvas.fill(mark, FAINT_TEXT_COLOR);
            let label = tick_label(n, step_m);
            let width = text_renderer.width(&label, AXIS_PX) + text_renderer.px(4);
            let half_height = text_renderer.px(AXIS_PX as u32) / 2;
            let at = (mark.x.saturating_sub(width), y.saturating_sub(half_height));
            text_renderer.draw(canvas, at, AXIS_PX, FAINT_TEXT_COLOR, &label);
        }
    }

    /// Draws what is inside of the background.
    fn draw_line(
        &self,
        canvas: &mut Canvas,
        points_m: impl Iterator<Item = [f64; 2]>,
        width: u32,
        color: [u8; 3],
    ) {
        let on_map = |point_m| {
            let [x, y] = self.pixel_of(point_m);
            let is_inside = x >= f64::from(self.ground.x)
                && y >= f64::from(self.ground.y)
                && x < f64::from(self.ground.right())
                && y < f64::from(self.ground.bottom());
            is_inside.then_some((x as u32, y as u32))
        };
        let mut before = None;
        for point in points_m.map(on_map) {
            if let (Some(from), Some(to)) = (before, point)
                && from != to
            {
                canvas.line(from, to, width, color);
            }
            before = point;
        }
    }

    /// Fills the footprint of the vehicle, with a dark arrow in front; a small one is enlarged.
    fn draw_vehicle(
        &self,
        canvas: &mut Canvas,
        (position_m, yaw_rad): ([f64; 2], f64),
        footprint: Footprint,
        length_min_px: f64,
    ) {
        let enlarged = (length_min_px / (footprint.length_m * self.pixels_per_m)).max(1.0);
        let scale = enlarged * self.pixels_per_m;
        let [x0, y0] = self.pixel_of(position_m);
        let (sin, cos) = libm::sincos(yaw_rad);
        let [half_length, half_width] =
            [footprint.length_m, footprint.width_m].map(|side_m| 0.5 * side_m * scale);
        let offset = footprint.offset_m * scale;
        let page = i64::from(self.ground.width + self.ground.height);
        let reach = (libm::ceil(half_length + half_width + offset.abs()) as i64).min(page);
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let [right, up] = [dx as f64, -dy as f64];
                let forward = cos * right + sin * up - offset;
                let left = cos * up - sin * right;
                let is_front =
                    forward > half_length - half_width && forward + left.abs() < half_length;
                if forward.abs() > half_length || left.abs() > half_width {
                    continue;
                }
                let color = if is_front { TEXT_COLOR } else { VEHICLE_COLOR };
                let [x, y] = [x0 + dx as f64, y0 + dy as f64];
                if x >= 0.0 && y >= 0.0 {
                    canvas.fill(Rect::new(x as u32, y as u32, 1, 1), color);
                }
            }
        }
    }
}

/// Coordinate of the tick `n` of an axis.
fn tick_label(n: i64, step_m: f64) -> String {
    let decimals = match step_m {
        step if step >= 1.0 => 0,
        step if step >= 0.1 => 1,
        _ => 2,
    };
    format!("{:.decimals$} m", n as f64 * step_m)
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
        let px = |length| text_renderer.px(length);
        let (width, height) = (
            text_renderer.width(text, TEXT_PX) + px(4),
            px(TEXT_PX as u32 + 2),
        );
        let distance = px(LABEL_DISTANCE);
        // Columns and rows left and above; the others are right and below.
        let [left, right] = [x.checked_sub(distance + width), Some(x + distance)];
        let [above, below] = [y.checked_sub(distance + height), Some(y + distance)];
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
        canvas.line((x, y), corner, px(1), TEXT_COLOR);
        canvas.fill(plate, PAGE_COLOR);
        let at = (plate.x + px(2), plate.y);
        text_renderer.draw(canvas, at, TEXT_PX, TEXT_COLOR, text);
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
        let columns = raster.width().div_ceil(cells);
        let mut deciding = Vec::with_capacity(columns);
        for (row, file_row) in (0..raster.height().div_ceil(cells)).zip(0_u32..) {
            raster.read_deciding(cells, row, 0..columns, &mut deciding);
            for (&code, column) in deciding.iter().zip(0_u32..) {
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

const TITLE_WIDTH_MAX: u32 = 190;
const RAMP_WIDTH: u32 = 22;
const RAMP_HEIGHT: u32 = 240;
const TICK_LENGTH: u32 = 6;
const SWATCH_SIDE: u32 = 20;
const SWATCH_PITCH: u32 = 30;
const GAP: u32 = 12;

/// Size that [`draw_legend`] needs.
fn legend_size(text_renderer: &TextRenderer, legend: &Legend) -> (u32, u32) {
    let px = |length| text_renderer.px(length);
    let title = text_renderer.wrap(&legend.title, TEXT_PX, px(TITLE_WIDTH_MAX));
    let width_of = |text: &str| text_renderer.width(text, TEXT_PX);
    let titles = title.iter().map(|line| width_of(line));
    let swatches = legend.swatches.iter();
    let swatches = swatches.map(|swatch| px(SWATCH_SIDE + GAP) + width_of(&swatch.label));
    let ticks = legend.ramp.iter().flat_map(|ramp| &ramp.ticks);
    let ticks = ticks.map(|tick| px(RAMP_WIDTH + TICK_LENGTH + 6) + width_of(&tick.label));
    let width = titles.chain(swatches).chain(ticks).max().unwrap_or(0);
    let ramp_height = if legend.ramp.is_some() {
        px(RAMP_HEIGHT + LINE_HEIGHT + GAP)
    } else {
        0
    };
    let lines = title.len() as u32 * LINE_HEIGHT + legend.swatches.len() as u32 * SWATCH_PITCH;
    let height = px(lines + GAP) + ramp_height;
    (width, height)
}

/// Draws the legend with its upper left corner at `at`.
fn draw_legend(canvas: &mut Canvas, text_renderer: &TextRenderer, at: (u32, u32), legend: &Legend) {
    let px = |length| text_renderer.px(length);
    let (x, mut y) = at;
    for line in text_renderer.wrap(&legend.title, TEXT_PX, px(TITLE_WIDTH_MAX)) {
        text_renderer.draw(canvas, (x, y), TEXT_PX, TEXT_COLOR, &line);
        y += px(LINE_HEIGHT);
    }
    y += px(GAP);
    if let Some(ramp) = &legend.ramp {
        // Half a line above and below, for the labels of the ends.
        y += px(LINE_HEIGHT / 2);
        draw_ramp(canvas, text_renderer, (x, y), ramp);
        y += px(RAMP_HEIGHT + LINE_HEIGHT / 2 + GAP);
    }
    for swatch in &legend.swatches {
        let square = Rect::new(x, y, px(SWATCH_SIDE), px(SWATCH_SIDE));
        canvas.fill(square, FAINT_TEXT_COLOR);
        canvas.fill_with(square.inside(), |x, y| {
            let [x, y] = [x - square.x, y - square.y].map(|pixel| pixel as usize);
            over_background(swatch.color_at(x, y))
        });
        let label_x = square.right() + px(GAP);
        text_renderer.draw(canvas, (label_x, y), TEXT_PX, TEXT_COLOR, &swatch.label);
        y += px(SWATCH_PITCH);
    }
}

fn draw_ramp(canvas: &mut Canvas, text_renderer: &TextRenderer, at: (u32, u32), ramp: &Ramp) {
    let px = |length| text_renderer.px(length);
    let (x, y) = at;
    let (width, height) = (px(RAMP_WIDTH), px(RAMP_HEIGHT));
    let bar = Rect::new(x, y, width, height);
    canvas.fill(bar, FAINT_TEXT_COLOR);
    let span = ramp.high - ramp.low;
    for row in 1..height - 1 {
        let part = 1.0 - (row as f32 - 0.5) / (height - 2) as f32;
        let [red, green, blue, _] = ramp.color(ramp.low + span * part);
        let line = Rect::new(x + 1, y + row, width - 2, 1);
        canvas.fill(line, [red, green, blue]);
    }
    for tick in &ramp.ticks {
        let part = (tick.value - ramp.low) / span;
        let tick_y = y + ((1.0 - part) * (height - 1) as f32).round() as u32;
        let mark = Rect::new(bar.right(), tick_y, px(TICK_LENGTH), px(1));
        canvas.fill(mark, FAINT_TEXT_COLOR);
        let label = (
            mark.right() + px(6),
            tick_y.saturating_sub(px(LINE_HEIGHT / 2 - 2)),
        );
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
    let px = |length| text_renderer.px(length);
    let scale = f64::from(px(1));
    let fits_m = (scale * BAR_PX_MAX).min(f64::from(width_max) * 0.5) / pixels_per_m;
    let can_be_seen = |length_m: &f64| length_m * pixels_per_m >= scale * BAR_PX_MIN;
    let length_m = wanted_m
        .map(|length_m| length_m.min(fits_m))
        .filter(can_be_seen)
        .unwrap_or_else(|| round_length_m(fits_m));
    let (x, y) = (at.0, at.1 + px(BAR_TOP));
    let width = (length_m * pixels_per_m).round().max(1.0) as u32;
    let bar = Rect::new(x, y, width, px(BAR_HEIGHT));
    canvas.fill(bar, TEXT_COLOR);
    // The second half is white, so that the bar also shows half its length.
    let half = Rect::new(
        x + width / 2,
        y + 1,
        (width - width / 2).saturating_sub(1),
        px(BAR_HEIGHT) - 2,
    );
    canvas.fill(half, [255; 3]);
    let label = (bar.right() + px(10), y.saturating_sub(px(6)));
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
mod tests;
