//! Cells → pixels.

use super::GROUND;
use super::canvas::{Canvas, Rect};
use crate::layer::{Palette, Pattern};
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
        for (block_y, file_row) in (0..raster.height()).step_by(cells).zip(0_u32..) {
            for (block_x, column) in (0..raster.width()).step_by(cells).zip(0_u32..) {
                let code = highest_code(raster, block_x, block_y, cells);
                let square = Rect {
                    x: at.0 + column * side_px,
                    y: at.1 + file_row * side_px,
                    width: side_px,
                    height: side_px,
                };
                if palette.pattern(code) == Pattern::Plain {
                    canvas.fill(square, over_ground(palette.color(code)));
                } else {
                    canvas.fill_with(square, |x, y| {
                        let [x, y] = [x - at.0, y - at.1].map(|pixel| pixel as usize);
                        over_ground(palette.color_at(code, x, y))
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
        let (x, y) = self.place(raster, cell);
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
    pub(super) fn place(self, raster: &Raster, cell: (usize, usize)) -> (u32, u32) {
        let row = raster.height() - 1 - cell.1;
        let (x, y) = match self {
            Self::PixelsPerCell(factor) => (cell.0 * factor, row * factor),
            Self::CellsPerPixel(factor) => (cell.0 / factor, row / factor),
        };
        (x as u32, y as u32)
    }
}

/// A colour with straight alpha as it looks on the ground.
pub(super) fn over_ground([red, green, blue, alpha]: [u8; 4]) -> [u8; 3] {
    let color = [red, green, blue];
    std::array::from_fn(|channel| {
        let (over, under) = (u16::from(color[channel]), u16::from(GROUND[channel]));
        let alpha = u16::from(alpha);
        ((over * alpha + under * (255 - alpha) + 127) / 255) as u8
    })
}

/// The highest code of a square of cells whose upper left one is in column `x` and row `y` from the top.
fn highest_code(raster: &Raster, x: usize, y: usize, cells: usize) -> u16 {
    let right = (x + cells).min(raster.width());
    let bottom = (y + cells).min(raster.height());
    (y..bottom)
        .flat_map(|y| &raster.row(raster.height() - 1 - y)[x..right])
        .copied()
        .max()
        .unwrap_or_default()
}
