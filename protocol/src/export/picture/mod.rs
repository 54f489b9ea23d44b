//! A raster as a picture: title, map on a neutral ground, scale bar, legend with numbers or names.

mod canvas;
mod legend;
mod map;
mod scale_bar;
mod text;

pub use scale_bar::{length_label, round_length_m};
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use self::canvas::{Canvas, Rect};
use self::map::Magnification;
use self::text::TextRenderer;
use super::ExportError;
use super::atomic_file::write_atomically;
use crate::layer::{Palette, Swatch};
use crate::mosaic::Raster;

const PAGE_COLOR: [u8; 3] = [250, 250, 251];
/// Bluish, so that no grey of an occupancy map is mistaken for it.
const BACKGROUND: [u8; 3] = [180, 192, 206];
const TEXT_COLOR: [u8; 3] = [24, 28, 34];
/// The vehicle's cell: orange, as [LOD §5] draws it.
const VEHICLE_COLOR: [u8; 3] = [255, 140, 0];
/// Length of the scale in the pictures of [LOD §5], metres.
const DOCUMENT_BAR_M: f64 = 1.0;
const FAINT_TEXT_COLOR: [u8; 3] = [92, 98, 108];

const MARGIN: u32 = 28;
const TITLE_PX: f32 = 30.0;
const TEXT_PX: f32 = 19.0;
const LINE_HEIGHT: u32 = 24;
/// Ground left free around the map.
const MAP_PADDING: u32 = 14;
/// Narrower maps are centred on this much ground, so that title and scale bar have room.
const BACKGROUND_SIDE_MIN: u32 = 420;

/// What a picture says beside its map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Caption<'a> {
    /// Printed above the map, for instance the name of the recording.
    pub title: &'a str,
    /// Where the vehicle is in `odom`, metres: its cell is orange ([LOD §5]).
    pub vehicle_m: Option<[f64; 2]>,
    /// What is written on the map.
    pub labels: &'a [Label],
}

/// A word on the map.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// The word.
    pub text: String,
    /// Where its middle is in `odom`, metres.
    pub at_m: [f64; 2],
}

/// Writes `raster` in the colours of `palette`.
///
/// Small maps are magnified by a whole factor; of maps more than 4096 cells wide or high each pixel shows
/// the highest code of a square of cells, so that walls stay visible.
pub fn write_picture(
    path: &Path,
    raster: &Raster,
    palette: &Palette,
    caption: &Caption<'_>,
) -> Result<(), ExportError> {
    let canvas = draw(raster, palette, caption);
    write_atomically(path, |writer| {
        encode(writer, &canvas).map_err(|error| {
            let path = path.to_owned();
            if let png::EncodingError::IoError(source) = error {
                ExportError::Io { path, source }
            } else {
                let source = error;
                ExportError::Png { path, source }
            }
        })
    })
}

fn encode(writer: &mut BufWriter<File>, canvas: &Canvas) -> Result<(), png::EncodingError> {
    let mut encoder = png::Encoder::new(writer, canvas.width(), canvas.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut image = encoder.write_header()?;
    image.write_image_data(canvas.rgb())?;
    image.finish()
}

/// The page: title and subtitle, below them the map on its ground with the legend to its right, below the
/// map the scale bar.
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
    let legend_size = legend::size(&text_renderer, &legend);

    let title = caption.title;
    let heading = if title.is_empty() {
        raster.layer().name().to_owned()
    } else {
        format!("{title} — {}", raster.layer().name())
    };
    let heading_height = 2 * LINE_HEIGHT + 18;
    let ground = Rect {
        x: MARGIN,
        y: MARGIN + heading_height,
        width: (map_width + 2 * MAP_PADDING).max(BACKGROUND_SIDE_MIN),
        height: (map_height + 2 * MAP_PADDING).max(legend_size.1),
    };
    let legend_x = ground.right() + MARGIN;
    let heading_width = text_renderer.width(&heading, TITLE_PX);
    let page_width = (legend_x + legend_size.0).max(MARGIN + heading_width) + MARGIN;
    let page_height = ground.bottom() + scale_bar::HEIGHT + MARGIN;

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
        magnification.mark(&mut canvas, (map_x, map_y), raster, cell, VEHICLE_COLOR);
    }
    for label in caption.labels {
        if let Some(cell) = raster.cell_of(label.at_m[0], label.at_m[1]) {
            let (x, y) = magnification.pixel_of(raster, cell);
            let (width, height) = (text_renderer.width(&label.text, TEXT_PX), TEXT_PX as u32);
            let plate = Rect {
                x: (map_x + x).saturating_sub(width / 2 + 2),
                y: (map_y + y).saturating_sub(height / 2),
                width: width + 4,
                height: height + 2,
            };
            canvas.fill(plate, PAGE_COLOR);
            text_renderer.draw(
                &mut canvas,
                (plate.x + 2, plate.y),
                TEXT_PX,
                TEXT_COLOR,
                &label.text,
            );
        }
    }
    legend::draw(&mut canvas, &text_renderer, (legend_x, ground.y), &legend);
    scale_bar::draw(
        &mut canvas,
        &text_renderer,
        (ground.x, ground.bottom()),
        magnification.pixels_per_m(raster.cell_m()),
        palette.is_document_palette().then_some(DOCUMENT_BAR_M),
        ground.width,
    );
    canvas
}

fn subtitle(raster: &Raster, magnification: &Magnification) -> String {
    let ([x_min, y_min], [x_max, y_max]) = raster.corners_m();
    let cell_m = (raster.cell_m() * 1e4).round() / 1e4;
    let (width_m, height_m) = (x_max - x_min, y_max - y_min);
    let decimals = if width_m.min(height_m) < 10.0 { 2 } else { 1 };
    let size = format!("{width_m:.decimals$} × {height_m:.decimals$} m, cells of {cell_m} m");
    match magnification.cells_per_pixel() {
        None => size,
        Some(cells) => format!("{size}, a pixel is {cells} × {cells} cells"),
    }
}

#[cfg(test)]
mod tests;
