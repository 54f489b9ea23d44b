//! The cells that a truth is given for.

use std::ops::Range;

use nalgebra::Point2;

/// A rectangle in the world, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Least x and y.
    pub min_m: [f64; 2],
    /// Greatest x and y.
    pub max_m: [f64; 2],
}

/// A rectangle of cells whose edges lie at multiples of the cell size, in rows of growing y, in a row
/// growing x.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellGrid {
    cell_m: f64,
    first: [i64; 2],
    size: [usize; 2],
}

/// Cells that make no grid.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TruthError {
    /// A size or bound that is not a number, or a rectangle without area.
    #[error("no grid of cells of {cell_m} m from {min:?} to {max:?}", min = bounds.min_m, max = bounds.max_m)]
    Senseless {
        /// What was asked for.
        cell_m: f64,
        /// What was asked for.
        bounds: Bounds,
    },
    /// More cells than memory is given to.
    #[error("a grid of {cells} cells of {cell_m} m is more than {most}: make the cells larger")]
    TooLarge {
        /// What was asked for.
        cell_m: f64,
        /// What that comes to.
        cells: f64,
        /// The limit.
        most: usize,
    },
}

impl CellGrid {
    /// All cells that `bounds` touches, where these are at most `most`.
    pub(super) fn new(cell_m: f64, bounds: Bounds, most: usize) -> Result<Self, TruthError> {
        let first = bounds.min_m.map(|m| libm::floor(m / cell_m));
        let end = bounds.max_m.map(|m| libm::ceil(m / cell_m));
        let [width, height] = [end[0] - first[0], end[1] - first[1]];
        let finite = first.into_iter().chain(end).all(|n| n.abs() < 1e15);
        if !(finite && cell_m > 0.0 && width >= 1.0 && height >= 1.0) {
            return Err(TruthError::Senseless { cell_m, bounds });
        }
        let cells = width * height;
        if cells > most as f64 {
            return Err(TruthError::TooLarge {
                cell_m,
                cells,
                most,
            });
        }
        Ok(Self {
            cell_m,
            first: first.map(|n| n as i64),
            size: [width as usize, height as usize],
        })
    }

    /// Edge length of a cell, metres.
    pub fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// Index of the cell with the least x and y: cell (i, j) begins at (i, j) · `cell_m`.
    pub fn first(&self) -> [i64; 2] {
        self.first
    }

    /// Number of columns and rows.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    pub(super) fn cells(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// Where the cell of index (i, j) is in the order of cells; `None` outside the grid.
    pub(super) fn place(&self, index: [i64; 2]) -> Option<usize> {
        let column = usize::try_from(index[0].checked_sub(self.first[0])?).ok()?;
        let row = usize::try_from(index[1].checked_sub(self.first[1])?).ok()?;
        (column < self.size[0] && row < self.size[1]).then_some(row * self.size[0] + column)
    }

    /// Index of the cell at a place in the order of cells.
    pub(super) fn index(&self, place: usize) -> [i64; 2] {
        let (column, row) = (place % self.size[0], place / self.size[0]);
        [self.along(0, column), self.along(1, row)]
    }

    /// Columns (axis 0) or rows (axis 1) that touch the interval.
    pub(super) fn reach(&self, axis: usize, least_m: f64, greatest_m: f64) -> Range<usize> {
        // One more on either side: an interval that ends on an edge touches both cells.
        let from = libm::floor(least_m / self.cell_m) as i64 - 1 - self.first[axis];
        let to = libm::floor(greatest_m / self.cell_m) as i64 + 2 - self.first[axis];
        let clamp = |n: i64| usize::try_from(n).unwrap_or(0).min(self.size[axis]);
        clamp(from)..clamp(to)
    }

    /// The corner of least x and y of a column and row.
    pub(super) fn corner_m(&self, column: usize, row: usize) -> Point2<f64> {
        Point2::new(
            self.along(0, column) as f64 * self.cell_m,
            self.along(1, row) as f64 * self.cell_m,
        )
    }

    fn along(&self, axis: usize, cell: usize) -> i64 {
        self.first[axis].saturating_add_unsigned(cell as u64)
    }
}
