//! Rolling elevation map of one down-tilted laser (docs/methods.md, section 1; \[LOD\] §4).
//!
//! Cells are fixed in `odom` and hold heights above the ground plane. Driving and turning move
//! nothing between cells. The obstacle class of a cell is updated here too, only for cells that the
//! scan hit.

mod cell;

use std::collections::{HashMap, VecDeque};
use std::ops::Range;

use measurement::pose;
use measurement::pose::Pose;
use measurement::time::{RobotDuration, RobotTime};
use nalgebra::{Point2, Point3};
use rustc_hash::FxBuildHasher;
use serde::Deserialize;

pub use self::cell::{CellClass, ElevationCell};
use crate::grid::{CellIndex, CellSize};
use crate::ground_plane::{Bounds, GroundConfig, GroundPlane, GroundReference, LocalGround};
use crate::obstacle::{ObstacleConfig, ObstacleRule};
use crate::octree::RangeSensorModel;
use crate::ray_clearing::{RayClearing, around, rises_from_ground};
use crate::registered_scan::{BeamOutcome, RegisteredScan, ScanKind};
use crate::rolling_grid::{RollingGrid, Slot};
use crate::scan_metrics::{IntraScan, MetricsConfig};

/// Settings of `[mapping.elevation]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ElevationConfig {
    /// Enables the elevation map and the obstacle map.
    pub enabled: bool,
    /// Side of a cell along x of `odom`, metres; of the obstacle map too, unless it has its own.
    pub cell_m: f64,
    /// Side of a cell along y, metres; else `cell_m`.
    pub cell_y_m: Option<f64>,
    /// Cells along x of the window around the vehicle.
    pub cells: u32,
    /// Cells along y; else `cells`.
    pub cells_y: Option<u32>,
    /// Time after which an obstacle observed in fewer than 5 scans is forgotten, seconds.
    pub forget_s: f64,
}

impl Default for ElevationConfig {
    /// 20 × 20 m (\[LOD\] table 5.1).
    fn default() -> Self {
        Self {
            enabled: false,
            cell_m: 0.2,
            cell_y_m: None,
            cells: 101,
            cells_y: None,
            forget_s: 10.0,
        }
    }
}

impl ElevationConfig {
    /// Size of a cell.
    pub fn size(&self) -> CellSize {
        CellSize::new(self.cell_m, self.cell_y_m.unwrap_or(self.cell_m))
    }

    /// Columns and rows of the window.
    pub fn sides(&self) -> [u32; 2] {
        [self.cells, self.cells_y.unwrap_or(self.cells)]
    }
}

/// Rolling elevation map.
#[derive(Clone, Debug)]
pub struct ElevationMap {
    size: CellSize,
    /// Along x.
    cells_per_m: f64,
    rule: ObstacleRule,
    h_pos_m: f32,
    h_neg_m: f32,
    local_ground: Option<LocalGround>,
    compensation: bool,
    /// Height above the ground from which on clouds show what the vehicle passes below, metres.
    overhang_m: f32,
    /// Where grass is no obstacle.
    grass: Option<Grass>,
    /// Of the beams of a scan, as [`IntraScan::less_spot`] has them.
    widths: Vec<f32>,
    /// Of the hits of a cloud, as [`RegisteredScan::above_ground`] has them.
    above_m: Vec<f32>,
    /// Rise over run of the steepest ground.
    max_slope: f64,
    grid: RollingGrid<ElevationCell>,
    hits: ScanHits,
    /// Cells of a cloud where the ground is not known, each with its first height, metres.
    groundless: HashMap<CellIndex, f32, FxBuildHasher>,
    ray_clearing: RayClearing,
    forget_ms: u32,
    /// Time and cell of new obstacles, oldest first, until they are confirmed or forgotten.
    unconfirmed: VecDeque<(u32, CellIndex)>,
    last_position: Option<Point3<f64>>,
    travel_m: f32,
    last_stamp: Option<RobotTime>,
    elapsed: RobotDuration,
    /// Time of the data since the first scan, milliseconds, at the last scan and when the map was
    /// last erased.
    now_ms: u32,
    start_ms: u32,
    /// Cells whose class the last scan changed.
    reclassified: Vec<CellIndex>,
}

/// Result of one scan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ElevationReport {
    /// Points inside the window.
    pub points: u32,
    /// Points outside of the window.
    pub outside: u32,
    /// Cells whose obstacle was cleared.
    pub cleared: u32,
}

/// Measures what is grass: no wider than the laser spot by a least width.
#[derive(Clone, Debug)]
pub(crate) struct Grass {
    widths: IntraScan,
    /// Full angles of the sensors' beams, in their order, radians.
    divergences_rad: Vec<f64>,
}

impl Grass {
    /// With a least width of obstacles, metres.
    pub(crate) fn new(
        least_width_m: f64,
        metrics: &MetricsConfig,
        sensors: &[RangeSensorModel],
    ) -> Self {
        let divergences_rad = sensors.iter().map(|sensor| sensor.divergence_rad);
        Self {
            widths: IntraScan::less_spot(metrics, least_width_m),
            divergences_rad: divergences_rad.collect(),
        }
    }

    fn measure(&self, scan: &RegisteredScan, widths: &mut Vec<f32>) {
        let divergence_rad = self.divergences_rad.get(usize::from(scan.sensor.0));
        self.widths
            .measure(scan, divergence_rad.copied().unwrap_or_default(), widths);
    }
}

/// An obstacle observed in fewer scans is forgotten after `forget_s`.
const CONFIRMING_SCANS: u16 = 5;
/// The lowest beams of a lidar on a vehicle's roof meet the ground no farther away, metres.
const BLIND_ZONE_M: f64 = 4.0;
/// Obstacles observed this soon after the map began are grounded: their approach could not be
/// observed, milliseconds.
const BEGINNING_MS: u32 = 1000;

impl ElevationMap {
    /// An empty map; the settings must be valid.
    pub fn new(
        elevation: &ElevationConfig,
        obstacle: &ObstacleConfig,
        ground: &GroundConfig,
    ) -> Self {
        Self {
            size: elevation.size(),
            cells_per_m: 1.0 / elevation.cell_m,
            rule: obstacle.rule,
            h_pos_m: obstacle.h_pos_m as f32,
            h_neg_m: obstacle.h_neg_m as f32,
            local_ground: (ground.reference == GroundReference::Local)
                .then(|| LocalGround::new(elevation.size(), ground.max_slope_deg)),
            compensation: ground.compensation,
            overhang_m: f32::INFINITY,
            grass: None,
            widths: Vec::new(),
            above_m: Vec::new(),
            max_slope: libm::tan(ground.max_slope_deg.to_radians()),
            grid: RollingGrid::new(elevation.sides(), ElevationCell::UNKNOWN),
            hits: ScanHits::default(),
            groundless: HashMap::default(),
            ray_clearing: RayClearing::new(elevation.sides(), elevation.size()),
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

    /// From now on, narrow bodies of these sensors' scans are no obstacles.
    pub(crate) fn ignore_grass(&mut self, grass: Grass) {
        self.grass = Some(grass);
    }

    /// From now on, clouds show no obstacles above this height, metres above the ground.
    pub(crate) const fn ignore_overhangs(&mut self, above_m: f64) {
        self.overhang_m = above_m as f32;
    }

    /// Adds one scan; heights refer to `plane`.
    pub fn integrate(&mut self, scan: &RegisteredScan, plane: &GroundPlane) -> ElevationReport {
        if let Some(grass) = &self.grass {
            grass.measure(scan, &mut self.widths);
        }
        scan.above_ground(self.max_slope, &mut self.above_m);
        self.reclassified.clear();
        self.hits.clear();
        self.groundless.clear();
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
        self.classify_hits(now_ms, scan.kind == ScanKind::Cloud);
        if self.compensation {
            report.cleared = self.clear_passed_through(scan, plane);
        }
        self.expire_unconfirmed(now_ms);
        report
    }

    /// Time of the data since the first scan, milliseconds. Steps back count as zero.
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
        let center = self.size.containing(position.xy());
        self.ray_clearing.center_on(center);
        self.grid.center_on(center);
    }

    fn add_points(
        &mut self,
        scan: &RegisteredScan,
        report: &mut ElevationReport,
        project: impl Fn(Point3<f64>) -> (Point2<f64>, f64),
    ) {
        let is_cloud = scan.kind == ScanKind::Cloud;
        // The ground around a ring is that of the rings below it, which are nearer.
        for ring in scan.rings_upwards() {
            let listed = self.hits.cells.len();
            self.add_ring(scan, ring, report, &project);
            if is_cloud {
                self.find_ground(listed);
            }
        }
    }

    /// Makes new cells free that a part of the scan found to be so.
    fn find_ground(&mut self, listed: usize) {
        for hit in self.hits.cells.get(listed..).unwrap_or_default() {
            let cell = self.grid.at_mut(hit.cell, hit.slot);
            if cell.class == CellClass::Unknown {
                cell.classify(self.rule, hit.bounds);
                if cell.class == CellClass::Free && cell.has_ground() {
                    self.reclassified.push(hit.cell);
                } else {
                    cell.class = CellClass::Unknown;
                }
            }
        }
    }

    fn add_ring(
        &mut self,
        scan: &RegisteredScan,
        ring: Range<usize>,
        report: &mut ElevationReport,
        project: impl Fn(Point3<f64>) -> (Point2<f64>, f64),
    ) {
        let is_cloud = scan.kind == ScanKind::Cloud;
        let beams = ring.clone().zip(&scan.beams[ring]);
        for (at, beam) in beams.filter(|(_, beam)| beam.outcome == BeamOutcome::Hit) {
            let (position, height_m) = project(beam.end_in_odom);
            let cell = CellIndex::near(self.size.squared(position), self.cells_per_m);
            let Some(slot) = self.grid.slot(cell) else {
                report.outside += 1;
                continue;
            };
            report.points += 1;
            let height_m = height_m as f32;
            let listed = self.hits.bounds(self.grid.at(cell, slot).hit, slot);
            let near = || match &self.local_ground {
                Some(local) => local.around(&self.grid, cell),
                None => Some(Bounds::PLANE),
            };
            let beyond = |ground: Bounds| ground.beyond(self.h_neg_m, self.h_pos_m);
            let known = listed.or_else(|| near().map(beyond));
            let mut ground = known.unwrap_or_else(|| beyond(Bounds::PLANE));
            let lowest_m = self.grid.at(cell, slot).min_m();
            let mut is_groundless = is_cloud && self.groundless.contains_key(&cell);
            let mut least_m = height_m;
            if let (true, None, Some(local)) = (is_cloud, known, &self.local_ground) {
                // The ground may have come down or up to here from the ring below. It is no higher than what is lower beside it
                // allows. What is higher than the hits before it allows may be a roof, an obstacle, or ground that is reached from
                // another side: it is not judged.
                let above_m = self.above_m.get(at).copied().unwrap_or(f32::NAN);
                let beside_m = local.highest(&self.grid, cell).min(lowest_m);
                let highest_m = beside_m.min(height_m - above_m);
                if height_m > highest_m + self.overhang_m {
                    continue;
                }
                if !ground.contains(height_m) {
                    is_groundless = true;
                    least_m = least_m.min(beside_m);
                } else if height_m > highest_m + self.h_pos_m {
                    is_groundless = true;
                }
            }
            if is_groundless {
                let first_m = self.groundless.entry(cell).or_insert(least_m);
                *first_m = first_m.min(least_m);
                ground = beyond(Bounds::at(*first_m));
            }
            // The vehicle passes below what is so high.
            let overhangs_m = |ground: Bounds| ground.highest_m - self.h_pos_m + self.overhang_m;
            if is_cloud && height_m > overhangs_m(ground) {
                continue;
            }
            if is_cloud && lowest_m.is_finite() && lowest_m > overhangs_m(ground) {
                self.restart(cell, slot);
            }
            if listed.is_none() {
                self.grid.at_mut(cell, slot).hit = self.hits.list(cell, slot, ground);
            }
            if is_groundless && ground.contains(height_m) {
                self.grid.at_mut(cell, slot).add_height(height_m);
                continue;
            }
            // What has no width, because a beam beside it was dropped or it is far away, counts.
            let is_narrow = self
                .widths
                .get(at)
                .is_some_and(|width| f64::from(*width) <= IntraScan::LEAST_WIDTH);
            self.grid
                .at_mut(cell, slot)
                .add(height_m, ground, is_narrow);
        }
    }

    /// Forgets what a cell was made of, which the vehicle passes below.
    fn restart(&mut self, cell: CellIndex, slot: Slot) {
        self.grid.at_mut(cell, slot).restart();
        self.ray_clearing.unmark(cell);
        self.reclassified.push(cell);
    }

    fn classify_hits(&mut self, now_ms: u32, is_cloud: bool) {
        for hit in self.hits.cells() {
            let cell = self.grid.at_mut(hit.cell, hit.slot);
            let (was_raised, class) = (cell.is_raised(), cell.class());
            cell.end_scan(now_ms, self.travel_m);
            cell.classify(self.rule, hit.bounds);
            // The ground around is compared with free cells: one point of a cloud above it makes none.
            if is_cloud && cell.class() == CellClass::Free && !cell.has_ground() {
                cell.class = CellClass::Unknown;
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

    /// Whether a raised cell stands on the ground: it rose from it, was there from the beginning,
    /// or touches a cell that was grounded half a cell of travel ago. The delay excludes a person
    /// who passes close to a wall.
    fn is_grounded(&self, hit: &HitCell, now_ms: u32) -> bool {
        let known_before_m = self.travel_m - 0.5 * self.size.shorter_m() as f32;
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

    /// Erases the map after a reset of the ground plane, but for the ground near the vehicle, which no beam of a three-dimensional lidar
    /// meets again while it drives on; its heights refer to the new plane.
    pub(crate) fn erase_beyond_blind_zone(
        &mut self,
        [before, after]: [&GroundPlane; 2],
        vehicle: Point2<f64>,
    ) {
        let near = self.grid.iter().filter_map(|(cell, value)| {
            let at = self.size.centre(cell);
            let is_near = (at - vehicle).norm() <= BLIND_ZONE_M;
            let mean_m = value.mean_m().filter(|_| is_near)?;
            let rise_m = before.rise_m(after, at, mean_m.into()) as f32;
            let is_level = (mean_m + rise_m).abs() <= (self.max_slope * BLIND_ZONE_M) as f32;
            (value.class() == CellClass::Free && is_level).then(|| (cell, value.raised_by(rise_m)))
        });
        let near: Vec<_> = near.collect();
        self.erase();
        for (cell, value) in near {
            if let Some(slot) = self.grid.slot(cell) {
                *self.grid.at_mut(cell, slot) = value;
                self.grid.mark_changed(cell, slot);
                self.reclassified.push(cell);
            }
        }
    }

    /// Erases the map after a reset of the ground plane.
    pub fn erase(&mut self) {
        self.grid.erase();
        self.ray_clearing.erase();
        self.unconfirmed.clear();
        self.start_ms = self.now_ms;
        self.reclassified.clear();
    }

    /// Whether the class of a cell refers to the ground around it.
    pub(crate) const fn is_local(&self) -> bool {
        self.local_ground.is_some()
    }

    /// Size of a cell.
    pub const fn size(&self) -> CellSize {
        self.size
    }

    /// Time after which an unconfirmed obstacle is forgotten.
    pub const fn forget(&self) -> RobotDuration {
        RobotDuration::from_millis(self.forget_ms as i64)
    }

    /// The cells.
    pub const fn grid(&self) -> &RollingGrid<ElevationCell> {
        &self.grid
    }

    /// Cells whose class the last scan changed; with possible repetitions.
    pub fn reclassified(&self) -> &[CellIndex] {
        &self.reclassified
    }

    /// Cells changed since the last call, including those that left the window.
    pub fn take_changed(&mut self) -> Vec<(CellIndex, ElevationCell)> {
        self.grid.take_changed()
    }

    /// Obstacle class of a cell; unknown outside of the window.
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

/// A pose without pitch, roll and height, for `compensation = false`.
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

/// Scratch list of the cells that one scan hits, each listed once.
#[derive(Clone, Debug, Default)]
pub(super) struct ScanHits {
    cells: Vec<HitCell>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct HitCell {
    pub(super) cell: CellIndex,
    pub(super) slot: Slot,
    /// Heights of the ground there.
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

    /// Whether this scan has a point in `cell`.
    pub(super) fn contains(&self, grid: &RollingGrid<ElevationCell>, cell: CellIndex) -> bool {
        let slot = grid.slot(cell);
        slot.is_some_and(|slot| self.bounds(grid.at(cell, slot).hit, slot).is_some())
    }

    /// Bounds of the cell at `slot` if it is listed at index `hit`.
    pub(super) fn bounds(&self, hit: u16, slot: Slot) -> Option<Bounds> {
        let entry = self.cells.get(usize::from(hit))?;
        (entry.slot == slot).then_some(entry.bounds)
    }

    /// Lists a cell; returns its index.
    pub(super) fn list(&mut self, cell: CellIndex, slot: Slot, bounds: Bounds) -> u16 {
        // A scan has far fewer cells; beyond this limit a cell would be listed twice, which is
        // harmless.
        let hit = u16::try_from(self.cells.len()).unwrap_or(u16::MAX);
        self.cells.push(HitCell { cell, slot, bounds });
        hit
    }
}

#[cfg(test)]
mod tests;
