//! Cells → pixels.

use super::BACKGROUND;
use super::canvas::{Canvas, Rect};
use crate::layer::{Palette, Pattern, UNKNOWN};
use crate::mosaic::Raster;

/// The longer side of a magnified map stays below this, pixels.
const MAGNIFIED_SIDE_MAX: usize = 1000;
/// No map is longer than this, pixels.
const SIDE_MAX: usize = 4096;
const FACTOR_MAX: usize = 24;

/// By which whole factor a map is drawn larger or smaller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Magnification {
    /// A cell is so many pixels wide and high.
    PixelsPerCell(usize),
    /// A pixel is so many cells wide and high, at least 2.
    CellsPerPixel(usize),
}

impl Magnification {
    pub(super) fn of(raster: &Raster) -> Self {
        let side = raster.width().max(raster.height());
        if side > SIDE_MAX {
            Self::CellsPerPixel(side.div_ceil(SIDE_MAX))
        } else {
            Self::PixelsPerCell((MAGNIFIED_SIDE_MAX / side).clamp(1, FACTOR_MAX))
        }
    }

    /// Width and height of the map.
    pub(super) fn pixels(self, raster: &Raster) -> (u32, u32) {
        let pixels = |cells: usize| match self {
            Self::PixelsPerCell(factor) => (cells * factor) as u32,
            Self::CellsPerPixel(factor) => cells.div_ceil(factor) as u32,
        };
        (pixels(raster.width()), pixels(raster.height()))
    }

    pub(super) fn pixels_per_m(self, cell_m: f64) -> f64 {
        match self {
            Self::PixelsPerCell(factor) => factor as f64 / cell_m,
            Self::CellsPerPixel(factor) => 1.0 / (factor as f64 * cell_m),
        }
    }

    /// How many cells a pixel is wide and high, where that is more than one.
    pub(super) fn cells_per_pixel(self) -> Option<usize> {
        match self {
            Self::PixelsPerCell(_) => None,
            Self::CellsPerPixel(factor) => Some(factor),
        }
    }

    /// Draws the map with its upper left corner at `at`, where its patterns begin; up is greater y.
    pub(super) fn draw(
        self,
        canvas: &mut Canvas,
        at: (u32, u32),
        raster: &Raster,
        palette: &Palette,
    ) {
        let (cells, side_px) = match self {
            Self::PixelsPerCell(factor) => (1, factor as u32),
            Self::CellsPerPixel(factor) => (factor, 1),
        };
        let (mut row, mut highest) = (Vec::new(), Vec::new());
        for (block_y, file_row) in (0..raster.height()).step_by(cells).zip(0_u32..) {
            highest_codes(raster, block_y, cells, &mut row, &mut highest);
            for (&code, column) in highest.iter().zip(0_u32..) {
                let square = Rect {
                    x: at.0 + column * side_px,
                    y: at.1 + file_row * side_px,
                    width: side_px,
                    height: side_px,
                };
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

    /// Draws one cell in `color`, (column, row from the bottom) of `raster`, whose map is at `at`.
    pub(super) fn mark(
        self,
        canvas: &mut Canvas,
        at: (u32, u32),
        raster: &Raster,
        cell: (usize, usize),
        color: [u8; 3],
    ) {
        let (x, y) = self.pixel_of(raster, cell);
        let side_px = match self {
            Self::PixelsPerCell(factor) => factor as u32,
            Self::CellsPerPixel(_) => 1,
        };
        let square = Rect {
            x: at.0 + x,
            y: at.1 + y,
            width: side_px,
            height: side_px,
        };
        canvas.fill(square, color);
    }

    /// The upper left pixel of a cell, (column, row from the bottom) of `raster`, from that of its map.
    pub(super) fn pixel_of(self, raster: &Raster, cell: (usize, usize)) -> (u32, u32) {
        let row = raster.height() - 1 - cell.1;
        let (x, y) = match self {
            Self::PixelsPerCell(factor) => (cell.0 * factor, row * factor),
            Self::CellsPerPixel(factor) => (cell.0 / factor, row / factor),
        };
        (x as u32, y as u32)
    }
}

/// A colour with straight alpha as it looks on the ground.
pub(super) fn over_background([red, green, blue, alpha]: [u8; 4]) -> [u8; 3] {
    let color = [red, green, blue];
    std::array::from_fn(|channel| {
        let (over, under) = (u16::from(color[channel]), u16::from(BACKGROUND[channel]));
        let alpha = u16::from(alpha);
        ((over * alpha + under * (255 - alpha) + 127) / 255) as u8
    })
}

/// Puts into `highest` the highest code of each square of `cells` by `cells`, whose upper row is `y` from the top; `row` is
/// room for a row.
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
