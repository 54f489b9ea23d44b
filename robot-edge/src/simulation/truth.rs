//! What a perfect map of a world looks like, by exact geometry.

pub mod outline;

mod crossing;

use nalgebra::Point2;

use crate::simulation::World;
use crate::simulation::truth::crossing::{Crossed, passes};
use crate::simulation::truth::outline::Outline;

/// What is truly in a cell of a 2D occupancy grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellKind {
    /// No surface passes through it and its centre is outside all solids.
    Free,
    /// A surface passes through it, or lies on its edge with the solid on its side.
    Occupied,
    /// Within a solid, where no beam comes.
    Inside,
}

/// The truth of one cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthCell {
    /// What is there.
    pub kind: CellKind,
    /// From its centre to the nearest surface, metres; infinite in an empty world. It lets a comparison
    /// leave out cells that a surface only grazes.
    pub surface_distance_m: f64,
}

/// A rectangle in the world, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Least x and y.
    pub min_m: [f64; 2],
    /// Greatest x and y.
    pub max_m: [f64; 2],
}

/// The truth over a rectangle of cells whose edges lie at multiples of the cell size.
#[derive(Clone, Debug, PartialEq)]
pub struct TruthGrid {
    cell_m: f64,
    first: [i64; 2],
    size: [usize; 2],
    cells: Vec<TruthCell>,
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
    #[error(
        "a grid of {cells} cells of {cell_m} m is more than {MAX_CELLS}: make the cells larger"
    )]
    TooLarge {
        /// What was asked for.
        cell_m: f64,
        /// What that comes to.
        cells: f64,
    },
}

/// 128 MB.
const MAX_CELLS: usize = 1 << 23;

/// The truth of `world` in the plane of its vehicle's laser, over all cells that `bounds` touches.
pub fn occupancy(world: &World, cell_m: f64, bounds: Bounds) -> Result<TruthGrid, TruthError> {
    let laser = &world.simulated_vehicle().laser;
    let outline = Outline::at_height(world.solids(), laser.base_from_laser.translation.z);
    TruthGrid::of(&outline, cell_m, bounds)
}

impl TruthGrid {
    fn of(outline: &Outline, cell_m: f64, bounds: Bounds) -> Result<Self, TruthError> {
        let mut grid = Self::empty(cell_m, bounds)?;
        let crossed = grid.cells_crossed(outline);
        let half_m = 0.5 * cell_m;
        for (index, crossed) in crossed.into_iter().enumerate() {
            let [column, row] = [index % grid.size[0], index / grid.size[0]];
            let corner_m = grid.corner_m(column, row);
            let centre_m = Point2::new(corner_m.x + half_m, corner_m.y + half_m);
            let kind = match (crossed, outline.contains(centre_m)) {
                (Crossed::Interior, _) | (Crossed::Edge, true) => CellKind::Occupied,
                (Crossed::No, true) => CellKind::Inside,
                (Crossed::No | Crossed::Edge, false) => CellKind::Free,
            };
            grid.cells.push(TruthCell {
                kind,
                surface_distance_m: outline.distance_m(centre_m),
            });
        }
        Ok(grid)
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

    /// The cell of index (i, j); `None` outside the grid.
    pub fn get(&self, index: [i64; 2]) -> Option<TruthCell> {
        let column = usize::try_from(index[0].checked_sub(self.first[0])?).ok()?;
        let row = usize::try_from(index[1].checked_sub(self.first[1])?).ok()?;
        (column < self.size[0] && row < self.size[1])
            .then(|| self.cells.get(row * self.size[0] + column).copied())?
    }

    /// Every cell with its index, rows of growing y, in a row growing x.
    pub fn iter(&self) -> impl Iterator<Item = ([i64; 2], TruthCell)> + '_ {
        self.cells.iter().enumerate().map(|(n, &cell)| {
            let (column, row) = (n % self.size[0], n / self.size[0]);
            ([self.index(0, column), self.index(1, row)], cell)
        })
    }

    fn empty(cell_m: f64, bounds: Bounds) -> Result<Self, TruthError> {
        let first = bounds.min_m.map(|m| libm::floor(m / cell_m));
        let end = bounds.max_m.map(|m| libm::ceil(m / cell_m));
        let [width, height] = [end[0] - first[0], end[1] - first[1]];
        let finite = first.into_iter().chain(end).all(|n| n.abs() < 1e15);
        if !(finite && cell_m > 0.0 && width >= 1.0 && height >= 1.0) {
            return Err(TruthError::Senseless { cell_m, bounds });
        }
        let cells = width * height;
        if cells > MAX_CELLS as f64 {
            return Err(TruthError::TooLarge { cell_m, cells });
        }
        Ok(Self {
            cell_m,
            first: first.map(|n| n as i64),
            size: [width as usize, height as usize],
            cells: Vec::with_capacity(cells as usize),
        })
    }

    /// How the surfaces pass each cell: only cells in the box of a segment are looked at.
    fn cells_crossed(&self, outline: &Outline) -> Vec<Crossed> {
        let mut crossed = vec![Crossed::No; self.size[0] * self.size[1]];
        for &[a, b] in outline.segments() {
            let columns = self.reach(0, a.x.min(b.x), a.x.max(b.x));
            for row in self.reach(1, a.y.min(b.y), a.y.max(b.y)) {
                for column in columns.clone() {
                    let min = self.corner_m(column, row);
                    let max = self.corner_m(column + 1, row + 1);
                    if let Some(cell) = crossed.get_mut(row * self.size[0] + column) {
                        *cell = (*cell).max(passes(a, b, min, max));
                    }
                }
            }
        }
        crossed
    }

    /// Columns (axis 0) or rows (axis 1) that touch the interval.
    fn reach(&self, axis: usize, least_m: f64, greatest_m: f64) -> std::ops::Range<usize> {
        // One more on either side: an interval that ends on an edge touches both cells.
        let from = libm::floor(least_m / self.cell_m) as i64 - 1 - self.first[axis];
        let to = libm::floor(greatest_m / self.cell_m) as i64 + 2 - self.first[axis];
        let clamp = |n: i64| usize::try_from(n).unwrap_or(0).min(self.size[axis]);
        clamp(from)..clamp(to)
    }

    fn corner_m(&self, column: usize, row: usize) -> Point2<f64> {
        Point2::new(
            self.index(0, column) as f64 * self.cell_m,
            self.index(1, row) as f64 * self.cell_m,
        )
    }

    fn index(&self, axis: usize, cell: usize) -> i64 {
        self.first[axis].saturating_add_unsigned(cell as u64)
    }
}

#[cfg(test)]
mod tests;
