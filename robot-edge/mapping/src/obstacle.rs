//! Obstacle map: the part of the elevation map that a planner or an operator needs ([LOD §4.3, §4.4]).

use nalgebra::Point2;

use super::elevation::ElevationMap;
use super::elevation_cell::CellClass;
use super::elevation_config::ObstacleConfig;
use super::grid::CellIndex;
use super::rolling_grid::{RollingGrid, difference};

/// A window of the elevation map at the same cell size, in three states.
#[derive(Clone, Debug)]
pub struct ObstacleMap {
    grid: RollingGrid<CellClass>,
}

impl ObstacleMap {
    /// An empty map. The settings are taken as valid.
    pub fn new(config: &ObstacleConfig) -> Self {
        Self {
            grid: RollingGrid::new(config.cells, CellClass::Unknown),
        }
    }

    /// Follows the vehicle and takes over the cells that the elevation map's last scan decided anew, and those
    /// that enter the window.
    pub fn update(&mut self, elevation: &ElevationMap, vehicle: Point2<f64>) {
        let before = self.grid.first();
        let center = CellIndex::containing(vehicle, elevation.cell_m());
        self.grid.center_on(center);
        let (after, side) = (self.grid.first(), self.grid.side());
        if let (Some(before), Some(after)) = (before, after)
            && side < elevation.grid().side()
        {
            for cell in difference(after, before, side) {
                self.set(cell, elevation.class(cell));
            }
        }
        for &cell in elevation.reclassified() {
            self.set(cell, elevation.class(cell));
        }
    }

    fn set(&mut self, cell: CellIndex, class: CellClass) {
        if let Some(slot) = self.grid.slot(cell)
            && *self.grid.at(cell, slot) != class
        {
            *self.grid.at_mut(cell, slot) = class;
            self.grid.mark_changed(cell, slot);
        }
    }

    /// Forgets everything.
    pub fn erase(&mut self) {
        self.grid.erase();
    }

    /// The cells.
    pub const fn grid(&self) -> &RollingGrid<CellClass> {
        &self.grid
    }

    /// The cells changed since the last call, those that left the window included.
    pub fn take_changed(&mut self) -> Vec<(CellIndex, CellClass)> {
        self.grid.take_changed()
    }

    /// Memory, bytes.
    pub const fn bytes(&self) -> usize {
        self.grid.bytes()
    }
}

#[cfg(test)]
mod tests;
