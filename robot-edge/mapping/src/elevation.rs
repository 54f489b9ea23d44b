//! Rolling elevation map from one down-tilted laser ([LOD §4]; `algorithms.md` §1).
//!
//! Cells are fixed in `odom` and hold heights above a ground plane, so that neither driving nor turning
//! moves anything from cell to cell. What each cell says as an obstacle is decided here too, for the cells
//! that a scan touched and no others.

use std::collections::VecDeque;

use nalgebra::{Point2, Point3};

use super::elevation_cell::{Bounds, CellClass, ElevationCell};
use super::elevation_config::{
    ElevationConfig, GroundConfig, GroundReference, ObstacleConfig, ObstacleRule,
};
use super::grid::CellIndex;
use super::ground_plane::GroundPlane;
use super::local_ground::LocalGround;
use super::ray_clearing::{RayClearing, around, rises_from_ground};
use super::registered_scan::{BeamOutcome, RegisteredScan};
use super::rolling_grid::RollingGrid;
use super::scan_hits::{HitCell, ScanHits};
use measurement::pose::{self, Pose};
use measurement::time::{RobotDuration, RobotTime};

/// The map.
#[derive(Clone, Debug)]
pub struct ElevationMap {
    cell_m: f64,
    cells_per_m: f64,
    rule: ObstacleRule,
    h_pos_m: f32,
    h_neg_m: f32,
    local_ground: Option<LocalGround>,
    compensation: bool,
    grid: RollingGrid<ElevationCell>,
    hits: ScanHits,
    ray_clearing: RayClearing,
    forget_ms: u32,
    /// Obstacles when they were first seen, oldest first: some were never seen again.
    unconfirmed: VecDeque<(u32, CellIndex)>,
    last_position: Option<Point3<f64>>,
    travel_m: f32,
    last_stamp: Option<RobotTime>,
    elapsed: RobotDuration,
    /// Milliseconds from the first scan to the last one, and to the one with which the map began.
    now_ms: u32,
    start_ms: u32,
    /// Cells whose class the last scan changed.
    reclassified: Vec<CellIndex>,
}

/// What became of one scan's points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ElevationReport {
    /// Points that are in the map.
    pub points: u32,
    /// Points outside of the window.
    pub outside: u32,
    /// Cells whose obstacle was seen to be gone.
    pub cleared: u32,
}

/// An obstacle seen in fewer scans is forgotten if it is not seen again.
const CONFIRMING_SCANS: u16 = 5;
/// What is there when a map begins is taken to stand there: nothing was seen of how it came, milliseconds.
const BEGINNING_MS: u32 = 1000;

impl ElevationMap {
    /// An empty map. The settings are taken as valid (see the configuration's own checks).
    pub fn new(
        elevation: &ElevationConfig,
        obstacle: &ObstacleConfig,
        ground: &GroundConfig,
    ) -> Self {
        Self {
            cell_m: elevation.cell_m,
            cells_per_m: 1.0 / elevation.cell_m,
            rule: obstacle.rule,
            h_pos_m: obstacle.h_pos_m as f32,
            h_neg_m: obstacle.h_neg_m as f32,
            local_ground: (ground.reference == GroundReference::Local)
                .then(|| LocalGround::new(elevation.cell_m, ground.max_slope_deg)),
            compensation: ground.compensation,
            grid: RollingGrid::new(elevation.cells, ElevationCell::UNKNOWN),
            hits: ScanHits::default(),
            ray_clearing: RayClearing::new(elevation.cells, elevation.cell_m),
            forget_ms: (1000.0 * elevation.forget_s) as u32,
            unconfirmed: VecDeque::new(),
            last_position: None,
            travel_m: 0.0,
            last_stamp: None,
            elapsed: RobotDuration::ZERO,
            now_ms: 0,
            start_ms: 0,
            reclassified: Vec::new(),
        }
    }

    /// Adds one scan; heights are those above `plane`.
    pub fn integrate(&mut self, scan: &RegisteredScan, plane: &GroundPlane) -> ElevationReport {
        self.reclassified.clear();
        self.hits.clear();
        let now_ms = self.advance_time(scan.stamp);
        self.now_ms = now_ms;
        self.follow_vehicle(&scan.odom_from_base);
        let mut report = ElevationReport::default();
        if self.compensation {
            self.add_points(scan, &mut report, |point| {
                (point.xy(), plane.height_m(&point))
            });
        } else {
            let flattened = Flattened::new(&scan.odom_from_base);
            self.add_points(scan, &mut report, |point| flattened.project(&point));
        }
        self.classify_hits(now_ms);
        if self.compensation {
            report.cleared = self.clear_passed_through(scan, plane);
        }
        self.expire_unconfirmed(now_ms);
        report
    }

    /// Time of the data that has passed over the scans, milliseconds; steps back count for nothing.
    fn advance_time(&mut self, stamp: RobotTime) -> u32 {
        let step = stamp.since(self.last_stamp.replace(stamp).unwrap_or(stamp));
        self.elapsed = self.elapsed + step.max(RobotDuration::ZERO);
        u32::try_from(self.elapsed.as_nanos() / 1_000_000).unwrap_or(u32::MAX)
    }

    fn follow_vehicle(&mut self, odom_from_base: &Pose) {
        let position = Point3::from(odom_from_base.translation.vector);
        if let Some(last) = self.last_position.replace(position) {
            self.travel_m += (position - last).norm() as f32;
        }
        let center = CellIndex::containing(position.xy(), self.cell_m);
        self.ray_clearing.center_on(center);
        self.grid.center_on(center);
    }

    fn add_points(
        &mut self,
        scan: &RegisteredScan,
        report: &mut ElevationReport,
        project: impl Fn(Point3<f64>) -> (Point2<f64>, f64),
    ) {
        let hits = scan
            .beams
            .iter()
            .filter(|beam| beam.outcome == BeamOutcome::Hit);
        for beam in hits {
            let (position, height_m) = project(beam.end_in_odom);
            let cell = CellIndex::near(position, self.cells_per_m);
            let Some(slot) = self.grid.slot(cell) else {
                report.outside += 1;
                continue;
            };
            report.points += 1;
            let hit = self.grid.at(cell, slot).hit;
            let ground = if let Some(ground) = self.hits.bounds(hit, slot) {
                ground
            } else {
                let around = match &self.local_ground {
                    Some(local) => local.around(&self.grid, cell),
                    None => Bounds::PLANE,
                };
                let ground = around.beyond(self.h_neg_m, self.h_pos_m);
                self.grid.at_mut(cell, slot).hit = self.hits.list(cell, slot, ground);
                ground
            };
            self.grid.at_mut(cell, slot).add(height_m as f32, ground);
        }
    }

    fn classify_hits(&mut self, now_ms: u32) {
        for hit in self.hits.cells() {
            let cell = self.grid.at_mut(hit.cell, hit.slot);
            let (was_raised, class) = (cell.is_raised(), cell.class());
            cell.end_scan(now_ms, self.travel_m);
            match self.rule {
                ObstacleRule::Mean => cell.classify_by_mean(hit.bounds),
                ObstacleRule::Points => cell.classify_by_points(),
            }
            let (is_raised, is_grounded) = (cell.is_raised(), cell.is_grounded());
            let scans = cell.scans();
            if cell.class() != class {
                self.reclassified.push(hit.cell);
            }
            match (was_raised, is_raised) {
                (_, true) => self.ray_clearing.mark(hit.cell, cell.max_m()),
                (true, false) => self.ray_clearing.unmark(hit.cell),
                (false, false) => {}
            }
            if is_raised && !was_raised && scans < CONFIRMING_SCANS {
                self.unconfirmed.push_back((now_ms, hit.cell));
            }
            if is_raised && !is_grounded && self.is_grounded(hit, now_ms) {
                self.grid.at_mut(hit.cell, hit.slot).grounded_at_travel_m = self.travel_m;
            }
            self.grid.mark_changed(hit.cell, hit.slot);
        }
    }

    /// Whether what now stands out stands on the ground: it rose from it, was there from the beginning, or
    /// touches what was known to before the beams had moved on to this cell. A person who brushes past a wall
    /// does so within a moment, and the cells behind them are no older.
    fn is_grounded(&self, hit: &HitCell, now_ms: u32) -> bool {
        let known_before_m = self.travel_m - 0.5 * self.cell_m as f32;
        let touches_grounded = || {
            around(hit.cell).any(|at| {
                let near = self.grid.get(at);
                near.is_some_and(|near| {
                    near.is_raised() && near.grounded_at_travel_m <= known_before_m
                })
            })
        };
        now_ms.saturating_sub(self.start_ms) < BEGINNING_MS
            || rises_from_ground(self.grid.at(hit.cell, hit.slot))
            || touches_grounded()
    }

    fn clear_passed_through(&mut self, scan: &RegisteredScan, plane: &GroundPlane) -> u32 {
        let gone =
            self.ray_clearing
                .cleared_cells(scan, plane, &mut self.grid, &self.hits, self.travel_m);
        let cleared = gone.len() as u32;
        for cell in gone {
            self.clear(cell);
        }
        cleared
    }

    fn expire_unconfirmed(&mut self, now_ms: u32) {
        while let Some(&(seen, cell)) = self.unconfirmed.front()
            && now_ms.saturating_sub(seen) > self.forget_ms
        {
            self.unconfirmed.pop_front();
            let is_unconfirmed = self.grid.get(cell).is_some_and(|value| {
                value.is_raised()
                    && !value.is_grounded()
                    && value.scans() < CONFIRMING_SCANS
                    && now_ms.saturating_sub(value.last_seen_ms()) > self.forget_ms
            });
            if is_unconfirmed {
                self.clear(cell);
            }
        }
    }

    fn clear(&mut self, cell: CellIndex) {
        if let Some(slot) = self.grid.slot(cell) {
            self.grid.at_mut(cell, slot).clear();
            self.grid.mark_changed(cell, slot);
            self.ray_clearing.unmark(cell);
            self.reclassified.push(cell);
        }
    }

    /// Forgets everything: the ground plane was reset.
    pub fn erase(&mut self) {
        self.grid.erase();
        self.ray_clearing.erase();
        self.unconfirmed.clear();
        self.start_ms = self.now_ms;
        self.reclassified.clear();
    }

    /// Side of a cell, metres.
    pub const fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// The cells.
    pub const fn grid(&self) -> &RollingGrid<ElevationCell> {
        &self.grid
    }

    /// The cells whose class the last scan changed; a cell may be listed twice.
    pub fn reclassified(&self) -> &[CellIndex] {
        &self.reclassified
    }

    /// The cells changed since the last call, those that left the window included.
    pub fn take_changed(&mut self) -> Vec<(CellIndex, ElevationCell)> {
        self.grid.take_changed()
    }

    /// What the obstacle map says of a cell; unknown outside of the window.
    pub fn class(&self, cell: CellIndex) -> CellClass {
        self.grid
            .get(cell)
            .map_or(CellClass::Unknown, ElevationCell::class)
    }

    /// Memory, bytes.
    pub fn bytes(&self) -> usize {
        self.grid.bytes() + self.ray_clearing.bytes()
    }
}

/// A pose without pitch, roll and height: what the document's map is without its compensation.
struct Flattened {
    base_from_odom: Pose,
    odom_from_flat: Pose,
}

impl Flattened {
    fn new(odom_from_base: &Pose) -> Self {
        let at = odom_from_base.translation.vector;
        Self {
            base_from_odom: odom_from_base.inverse(),
            odom_from_flat: pose::planar(at.x, at.y, pose::yaw_rad(odom_from_base)),
        }
    }

    fn project(&self, point_in_odom: &Point3<f64>) -> (Point2<f64>, f64) {
        let point_in_base = self.base_from_odom * point_in_odom;
        let point = self.odom_from_flat * point_in_base;
        (point.xy(), point_in_base.z)
    }
}

#[cfg(test)]
mod tests;
