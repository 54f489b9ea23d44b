//! Scratch list of the cells that one scan hits, each found once.

use super::elevation_cell::{Bounds, ElevationCell};
use super::grid::CellIndex;
use super::rolling_grid::{RollingGrid, Slot};

/// The cells that the points of one scan fell into.
#[derive(Clone, Debug, Default)]
pub(super) struct ScanHits {
    cells: Vec<HitCell>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct HitCell {
    pub(super) cell: CellIndex,
    pub(super) slot: Slot,
    /// Which heights are ground there.
    pub(super) bounds: Bounds,
}

impl ScanHits {
    pub(super) fn clear(&mut self) {
        self.cells.clear();
    }

    /// In the order of their first points.
    pub(super) fn cells(&self) -> &[HitCell] {
        &self.cells
    }

    /// Whether a point of this scan fell into `cell`.
    pub(super) fn contains(&self, grid: &RollingGrid<ElevationCell>, cell: CellIndex) -> bool {
        let slot = grid.slot(cell);
        slot.is_some_and(|slot| self.bounds(grid.at(cell, slot).hit, slot).is_some())
    }

    /// The bounds of the cell at `slot` that believes to be listed at `hit`; `None` where it is not.
    pub(super) fn bounds(&self, hit: u16, slot: Slot) -> Option<Bounds> {
        let entry = self.cells.get(usize::from(hit))?;
        (entry.slot == slot).then_some(entry.bounds)
    }

    /// Lists a cell; returns where.
    pub(super) fn list(&mut self, cell: CellIndex, slot: Slot, bounds: Bounds) -> u16 {
        // A scan has fewer cells than that; one that had more would list some of them twice.
        let hit = u16::try_from(self.cells.len()).unwrap_or(u16::MAX);
        self.cells.push(HitCell { cell, slot, bounds });
        hit
    }
}
