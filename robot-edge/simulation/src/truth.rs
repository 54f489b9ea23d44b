//! What a perfect map of a world looks like, by exact geometry.

pub mod cells;
pub mod heights;
pub mod outline;
pub mod shores;
pub mod terrain_truth;
pub mod verdict;

mod crossing;
mod plan;

use nalgebra::Point2;

pub use cells::{Bounds, CellGrid, TruthError};
pub use heights::{CellHeights, HeightOptions, HeightTruth, heights};
pub use shores::{Dock, Shore, ShoreClass};
pub use terrain_truth::TerrainTruth;
pub use verdict::{GroundPlane, Thresholds, Verdict};

use crate::World;
use crate::truth::crossing::{Crossed, passes};
use crate::truth::outline::Outline;

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

/// The truth over a rectangle of cells whose edges lie at multiples of the cell size.
#[derive(Clone, Debug, PartialEq)]
pub struct TruthGrid {
    grid: CellGrid,
    cells: Vec<TruthCell>,
}

/// 128 MB.
const MAX_CELLS: usize = 1 << 23;

/// The truth of `world` in the plane of its vehicle's laser, over all cells that `bounds` touches. Moving
/// solids are left out, glass is a solid as any other.
pub fn occupancy(world: &World, cell_m: f64, bounds: Bounds) -> Result<TruthGrid, TruthError> {
    let laser = &world.simulated_vehicle().laser;
    let outline = Outline::at_height(world.solids(), laser.base_from_mount.translation.z);
    TruthGrid::of(&outline, cell_m, bounds)
}

impl TruthGrid {
    fn of(outline: &Outline, cell_m: f64, bounds: Bounds) -> Result<Self, TruthError> {
        let grid = CellGrid::new(cell_m, bounds, MAX_CELLS)?;
        let half_m = 0.5 * cell_m;
        let width = grid.size()[0];
        let cells = cells_crossed(&grid, outline)
            .into_iter()
            .enumerate()
            .map(|(place, crossed)| {
                let corner_m = grid.corner_m(place % width, place / width);
                let centre_m = Point2::new(corner_m.x + half_m, corner_m.y + half_m);
                let kind = match (crossed, outline.contains(centre_m)) {
                    (Crossed::Interior, _) | (Crossed::Edge, true) => CellKind::Occupied,
                    (Crossed::No, true) => CellKind::Inside,
                    (Crossed::No | Crossed::Edge, false) => CellKind::Free,
                };
                TruthCell {
                    kind,
                    surface_distance_m: outline.distance_m(centre_m),
                }
            })
            .collect();
        Ok(Self { grid, cells })
    }

    /// Edge length of a cell, metres.
    pub fn cell_m(&self) -> f64 {
        self.grid.cell_m()
    }

    /// Index of the cell with the least x and y: cell (i, j) begins at (i, j) · `cell_m`.
    pub fn first(&self) -> [i64; 2] {
        self.grid.first()
    }

    /// Number of columns and rows.
    pub fn size(&self) -> [usize; 2] {
        self.grid.size()
    }

    /// The cell of index (i, j); `None` outside the grid.
    pub fn get(&self, index: [i64; 2]) -> Option<TruthCell> {
        self.cells.get(self.grid.place(index)?).copied()
    }

    /// Every cell with its index, rows of growing y, in a row growing x.
    pub fn iter(&self) -> impl Iterator<Item = ([i64; 2], TruthCell)> + '_ {
        self.cells
            .iter()
            .enumerate()
            .map(|(place, &cell)| (self.grid.index(place), cell))
    }
}

/// How the surfaces pass each cell: only cells in the box of a segment are looked at.
fn cells_crossed(grid: &CellGrid, outline: &Outline) -> Vec<Crossed> {
    let mut crossed = vec![Crossed::No; grid.cells()];
    for &[a, b] in outline.segments() {
        let columns = grid.reach(0, a.x.min(b.x), a.x.max(b.x));
        for row in grid.reach(1, a.y.min(b.y), a.y.max(b.y)) {
            for column in columns.clone() {
                let min = grid.corner_m(column, row);
                let max = grid.corner_m(column + 1, row + 1);
                if let Some(cell) = crossed.get_mut(row * grid.size()[0] + column) {
                    *cell = (*cell).max(passes(a, b, min, max));
                }
            }
        }
    }
    crossed
}

#[cfg(test)]
mod tests;
