//! Obstacle map: the classes of the elevation map's cells (docs/methods.md, section 1; \[LOD\]
//! §4.3, §4.4), and what only ultrasound detects.

use std::collections::BTreeMap;

use measurement::time::{RobotDuration, RobotTime};
use nalgebra::Point2;
use serde::Deserialize;

use crate::elevation::{CellClass, ElevationConfig, ElevationMap};
use crate::grid::{CellIndex, CellSize};
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
    /// By the rule `Points`: a cell is grass and no obstacle if most of its points above the ground lie
    /// on bodies that are no wider than the laser spot by this, metres; 0: no cell is (\[LOD\] §6.2
    /// asks for it).
    pub least_width_m: f64,
    /// Side of a cell along x of `odom`, metres; else as the elevation map has it.
    pub cell_m: Option<f64>,
    /// Side of a cell along y, metres; else `cell_m`, or as the elevation map has it.
    pub cell_y_m: Option<f64>,
    /// Cells along x of the window, which is no larger than the elevation map's.
    pub cells: u32,
    /// Cells along y; else `cells`.
    pub cells_y: Option<u32>,
}

impl ObstacleConfig {
    /// Size of a cell.
    pub fn size(&self, elevation: &ElevationConfig) -> CellSize {
        let [x_m, y_m] = elevation.size().sides_m();
        CellSize::new(
            self.cell_m.unwrap_or(x_m),
            self.cell_y_m.or(self.cell_m).unwrap_or(y_m),
        )
    }

    /// Columns and rows of the window.
    pub fn sides(&self) -> [u32; 2] {
        [self.cells, self.cells_y.unwrap_or(self.cells)]
    }
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
            least_width_m: 0.0,
            cell_m: None,
            cell_y_m: None,
            cells: 101,
            cells_y: None,
        }
    }
}

/// A window of the elevation map in three classes. A cell of a size of its own has the worst class of
/// the cells of the elevation map that it overlaps: obstacle, else free, else unknown.
#[derive(Clone, Debug)]
pub struct ObstacleMap {
    size: CellSize,
    grid: RollingGrid<CellClass>,
    /// Obstacles whatever the elevation map says, and when they were marked last.
    marked: BTreeMap<CellIndex, RobotTime>,
}

impl ObstacleMap {
    /// An empty map; the settings must be valid.
    pub fn new(config: &ObstacleConfig, elevation: &ElevationConfig) -> Self {
        Self {
            size: config.size(elevation),
            grid: RollingGrid::new(config.sides(), CellClass::Unknown),
            marked: BTreeMap::new(),
        }
    }

    /// Moves with the vehicle; updates the cells that the last scan reclassified and those that enter
    /// the window.
    pub fn update(&mut self, elevation: &ElevationMap, vehicle: Point2<f64>) {
        let before = self.grid.first();
        self.grid.center_on(self.size.containing(vehicle));
        let (after, sides) = (self.grid.first(), self.grid.sides());
        // What enters a window of the same size is unknown to the elevation map, too.
        let is_same = sides == elevation.grid().sides() && self.size == elevation.size();
        if let (Some(before), Some(after)) = (before, after)
            && !is_same
        {
            for cell in difference(after, before, sides) {
                self.update_cell(cell, elevation);
            }
        }
        for &changed in elevation.reclassified() {
            if self.size == elevation.size() {
                self.set(changed, elevation.class(changed));
                continue;
            }
            for cell in elevation.size().overlapping(changed, self.size) {
                self.update_cell(cell, elevation);
            }
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
            let cell = self.size.containing(point);
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
            self.update_cell(cell, elevation);
        }
    }

    fn update_cell(&mut self, cell: CellIndex, elevation: &ElevationMap) {
        let classes = self.size.overlapping(cell, elevation.size());
        let classes = classes.map(|cell| elevation.class(cell));
        self.set(cell, classes.max().unwrap_or(CellClass::Unknown));
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

    /// Size of a cell.
    pub const fn size(&self) -> CellSize {
        self.size
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
