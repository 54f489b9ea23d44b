//! Obstacle map: the classes of the elevation map's cells (docs/methods.md, section 1; \[LOD\]
//! §4.3, §4.4), and what only ultrasound detects.

use std::collections::BTreeMap;

use measurement::time::{RobotDuration, RobotTime};
use nalgebra::Point2;
use serde::Deserialize;

use crate::elevation::{CellClass, ElevationMap};
use crate::grid::CellIndex;
use crate::rolling_grid::{RollingGrid, difference};

/// Settings of `[mapping.obstacle]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ObstacleConfig {
    /// Which cells are obstacles.
    pub rule: ObstacleRule,
    /// Greatest height that is no obstacle, metres (\[LOD\] ch. 5: 0.10).
    pub h_pos_m: f64,
    /// Greatest depth below the ground that is no obstacle, metres (\[LOD\] ch. 5: 0.10).
    pub h_neg_m: f64,
    /// Cells along an edge of the window, at most those of the elevation map.
    pub cells: u32,
}

/// Rule for obstacles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ObstacleRule {
    /// The mean height is beyond a threshold (\[LOD\] §4.3).
    Mean,
    /// At least 2 points and 5 % of the recent points are beyond a threshold. A mean hides a pole
    /// or a kerb that fills half of its cell.
    Points,
}

impl Default for ObstacleConfig {
    fn default() -> Self {
        Self {
            rule: ObstacleRule::Points,
            h_pos_m: 0.1,
            h_neg_m: 0.1,
            cells: 101,
        }
    }
}

/// A window of the elevation map at the same cell size, in three classes.
#[derive(Clone, Debug)]
pub struct ObstacleMap {
    grid: RollingGrid<CellClass>,
    /// Obstacles whatever the elevation map says, and when they were marked last.
    marked: BTreeMap<CellIndex, RobotTime>,
}

impl ObstacleMap {
    /// An empty map; the settings must be valid.
    pub fn new(config: &ObstacleConfig) -> Self {
        Self {
            grid: RollingGrid::new(config.cells, CellClass::Unknown),
            marked: BTreeMap::new(),
        }
    }

    /// Moves with the vehicle; copies the cells that the last scan reclassified and those that
    /// enter the window.
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

    /// Makes the cells of points, metres in `odom`, obstacles for the elevation map's `forget_s`.
    ///
    /// No laser beam clears them: what sound meets and light does not is glass.
    pub fn mark(
        &mut self,
        points: impl Iterator<Item = Point2<f64>>,
        now: RobotTime,
        elevation: &ElevationMap,
    ) {
        for point in points {
            let cell = CellIndex::containing(point, elevation.cell_m());
            self.marked.insert(cell, now);
            self.set(cell, CellClass::Obstacle);
        }
        self.expire(now, elevation);
    }

    /// Forgets marks that are too old.
    pub fn expire(&mut self, now: RobotTime, elevation: &ElevationMap) {
        let fresh = RobotDuration::ZERO..=elevation.forget();
        let is_old = |at: &RobotTime| !fresh.contains(&now.since(*at));
        let marks = self.marked.iter().filter(|(_, at)| is_old(at));
        for cell in marks.map(|(cell, _)| *cell).collect::<Vec<_>>() {
            self.marked.remove(&cell);
            self.set(cell, elevation.class(cell));
        }
    }

    fn set(&mut self, cell: CellIndex, class: CellClass) {
        let class = if self.marked.contains_key(&cell) {
            CellClass::Obstacle
        } else {
            class
        };
        if let Some(slot) = self.grid.slot(cell)
            && *self.grid.at(cell, slot) != class
        {
            *self.grid.at_mut(cell, slot) = class;
            self.grid.mark_changed(cell, slot);
        }
    }

    /// Erases every cell.
    pub fn erase(&mut self) {
        self.grid.erase();
        self.marked.clear();
    }

    /// The cells.
    pub const fn grid(&self) -> &RollingGrid<CellClass> {
        &self.grid
    }

    /// Cells changed since the last call, including those that left the window.
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
