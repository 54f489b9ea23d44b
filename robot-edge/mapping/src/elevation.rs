//! Rolling elevation map of one down-tilted laser (docs/methods.md, section 1; \[LOD\] §4).
//!
//! Cells are fixed in `odom` and hold heights above the ground plane. Driving and turning move
//! nothing between cells. The obstacle class of a cell is updated here too, only for cells that the
//! scan hit.

use std::collections::{HashMap, VecDeque};
use std::ops::Range;

use measurement::pose;
use measurement::pose::Pose;
use measurement::time::{RobotDuration, RobotTime};
use nalgebra::{Point2, Point3};
use rustc_hash::FxBuildHasher;
use serde::Deserialize;

use crate::grid::{CellIndex, CellSize};
use crate::ground_plane::{GroundConfig, GroundPlane, GroundReference, LocalGround};
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
            let is_groundless = is_cloud
                && (self.groundless.contains_key(&cell)
                    || (known.is_none() && !ground.contains(height_m)));
            // The vehicle passes below what is so high.
            let overhangs_m = |ground: Bounds| ground.highest_m - self.h_pos_m + self.overhang_m;
            let is_over = |ground: Bounds| height_m > overhangs_m(ground);
            if is_cloud
                && (is_over(ground) || (known.is_none() && is_over(beyond(Bounds::at(lowest_m)))))
            {
                continue;
            }
            if is_groundless {
                // The ground between two rings is not known: it may have come down or up to here. What has a step is no ground.
                let first_m = self.groundless.entry(cell).or_insert(lowest_m);
                *first_m = first_m.min(height_m);
                ground = beyond(Bounds::at(*first_m));
                if is_over(ground) {
                    continue;
                }
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
        let known = self.grid.at_mut(cell, slot);
        *known = ElevationCell {
            hit: known.hit,
            ..ElevationCell::UNKNOWN
        };
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

    /// Erases the map after a reset of the ground plane.
    pub fn erase(&mut self) {
        self.grid.erase();
        self.ray_clearing.erase();
        self.unconfirmed.clear();
        self.start_ms = self.now_ms;
        self.reclassified.clear();
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

/// Statistics of the heights in one cell, metres above the ground plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElevationCell {
    mean_m: f32,
    /// Sum of squared deviations from the mean (Welford 1962), m².
    squares_m2: f32,
    min_m: f32,
    max_m: f32,
    /// Mean of the points within the thresholds.
    ground_mean_m: f32,
    /// Lowest point clearly above the ground.
    lowest_raised_m: f32,
    /// Travelled distance at the last hit, metres.
    pub(super) hit_at_travel_m: f32,
    points: u32,
    /// Milliseconds since the map's first scan.
    last_seen_ms: u32,
    /// Counts of about the newest [`RECENT`] points.
    recent: u16,
    above: u16,
    /// Above the ground on narrow bodies; not among `above`.
    narrow: u16,
    below: u16,
    ground_points: u16,
    scans: u16,
    /// Index of the cell in the list of the scan that hit it last; [`ScanHits::bounds`] checks
    /// whether that is this scan.
    pub(super) hit: u16,
    /// Scans with a beam through the obstacle since the last hit.
    pub(super) crossed_scans: u8,
    class: CellClass,
    /// Travelled distance at which the obstacle was first observed to stand on the ground, or to
    /// touch one that does; +∞ if never.
    pub(super) grounded_at_travel_m: f32,
}

/// Class of a cell of the obstacle map (\[LOD\] §4.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum CellClass {
    /// No point.
    Unknown,
    /// Within the thresholds.
    Free,
    /// Beyond one of them.
    Obstacle,
}

/// Heights of the local ground, metres above the ground plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bounds {
    pub(super) lowest_m: f32,
    pub(super) highest_m: f32,
    /// Points above this are clearly above the ground, obstacle or not.
    pub(super) raised_above_m: f32,
}

/// Points for the 5 % rule. Of all points ever, 5 % would be too many for a kerb that is reached
/// after a minute of standing in front of it.
const RECENT: u16 = 512;

impl ElevationCell {
    /// Without information.
    pub const UNKNOWN: Self = Self {
        mean_m: 0.0,
        squares_m2: 0.0,
        min_m: f32::INFINITY,
        max_m: f32::NEG_INFINITY,
        ground_mean_m: 0.0,
        lowest_raised_m: f32::INFINITY,
        hit_at_travel_m: 0.0,
        points: 0,
        last_seen_ms: 0,
        hit: 0,
        recent: 0,
        above: 0,
        narrow: 0,
        below: 0,
        ground_points: 0,
        scans: 0,
        crossed_scans: 0,
        class: CellClass::Unknown,
        grounded_at_travel_m: f32::INFINITY,
    };

    /// Whether it has a point.
    pub const fn is_known(&self) -> bool {
        self.points > 0
    }

    /// Mean height; `None` if unknown.
    pub fn mean_m(&self) -> Option<f32> {
        self.is_known().then_some(self.mean_m)
    }

    /// Least height; +∞ if unknown.
    pub const fn min_m(&self) -> f32 {
        self.min_m
    }

    /// Greatest height; −∞ if unknown.
    pub const fn max_m(&self) -> f32 {
        self.max_m
    }

    /// Variance of the heights, m²; 0 for fewer than two points.
    pub fn variance_m2(&self) -> f32 {
        if self.points < 2 {
            0.0
        } else {
            self.squares_m2 / (self.points - 1) as f32
        }
    }

    /// Number of points.
    pub const fn points(&self) -> u32 {
        self.points
    }

    /// Number of scans with a point in it.
    pub const fn scans(&self) -> u16 {
        self.scans
    }

    /// Time of the last such scan, milliseconds since the map's first scan.
    pub const fn last_seen_ms(&self) -> u32 {
        self.last_seen_ms
    }

    /// Class in the obstacle map.
    pub const fn class(&self) -> CellClass {
        self.class
    }

    /// Whether it holds something that beams below its top cannot pass.
    pub(super) const fn is_raised(&self) -> bool {
        matches!(self.class, CellClass::Obstacle) && self.above > 0
    }

    /// Height above ground at which the obstacle was first observed, metres: near 0 if the beams
    /// swept up its face, more if it came from the side.
    pub(super) fn gap_m(&self) -> f32 {
        self.lowest_raised_m - self.ground_mean_m
    }

    pub(super) fn is_grounded(&self) -> bool {
        self.grounded_at_travel_m.is_finite()
    }

    /// Height of the slice that was observed, metres.
    pub(super) fn slice_m(&self) -> f32 {
        self.max_m - self.lowest_raised_m
    }

    /// Whether any point was within the thresholds.
    const fn has_ground(&self) -> bool {
        self.ground_points > 0
    }

    /// Adds a point; one on a narrow body is no obstacle by being high.
    pub(super) fn add(&mut self, height_m: f32, ground: Bounds, is_narrow: bool) {
        self.add_height(height_m);
        if self.recent >= RECENT {
            self.recent /= 2;
            self.above /= 2;
            self.narrow /= 2;
            self.below /= 2;
        }
        self.recent += 1;
        if height_m > ground.raised_above_m && !is_narrow {
            self.lowest_raised_m = self.lowest_raised_m.min(height_m);
        }
        if height_m > ground.highest_m {
            self.above += u16::from(!is_narrow);
            self.narrow += u16::from(is_narrow);
        } else if height_m < ground.lowest_m {
            self.below += 1;
        } else {
            self.ground_points = self.ground_points.saturating_add(1);
            self.ground_mean_m += (height_m - self.ground_mean_m) / f32::from(self.ground_points);
        }
    }

    /// Adds a point that says nothing of the class.
    fn add_height(&mut self, height_m: f32) {
        self.points = self.points.saturating_add(1);
        let deviation_m = height_m - self.mean_m;
        self.mean_m += deviation_m / self.points as f32;
        self.squares_m2 += deviation_m * (height_m - self.mean_m);
        self.min_m = self.min_m.min(height_m);
        self.max_m = self.max_m.max(height_m);
    }

    /// Finishes a scan that had points in it.
    pub(super) fn end_scan(&mut self, now_ms: u32, travel_m: f32) {
        self.scans = self.scans.saturating_add(1);
        self.last_seen_ms = now_ms;
        self.hit_at_travel_m = travel_m;
        self.crossed_scans = 0;
    }

    fn classify(&mut self, rule: ObstacleRule, ground: Bounds) {
        match rule {
            ObstacleRule::Mean => self.classify_by_mean(ground),
            ObstacleRule::Points => self.classify_by_points(),
        }
    }

    /// Rule `mean` (docs/methods.md, section 1).
    pub(super) fn classify_by_mean(&mut self, ground: Bounds) {
        self.class = self.known_class(!ground.contains(self.mean_m));
    }

    /// Rule `points`: at least 2 points and 5 % of the recent ones beyond a threshold
    /// (docs/methods.md, section 1).
    pub(super) fn classify_by_points(&mut self) {
        let beyond = |count: u16| count >= 2 && u32::from(count) * 20 >= u32::from(self.recent);
        let is_raised = beyond(self.above) && self.above >= self.narrow;
        self.class = self.known_class(is_raised || beyond(self.below));
    }

    fn known_class(&self, is_obstacle: bool) -> CellClass {
        match (self.is_known(), is_obstacle) {
            (false, _) => CellClass::Unknown,
            (true, false) => CellClass::Free,
            (true, true) => CellClass::Obstacle,
        }
    }

    /// Removes the obstacle; keeps the ground observed below it.
    pub(super) fn clear(&mut self) {
        let ground = (self.ground_points, self.ground_mean_m, self.last_seen_ms);
        *self = Self::UNKNOWN;
        let (points, mean_m, last_seen_ms) = ground;
        if points > 0 {
            self.points = u32::from(points);
            self.recent = points.min(RECENT);
            self.ground_points = points;
            (self.mean_m, self.ground_mean_m) = (mean_m, mean_m);
            (self.min_m, self.max_m) = (mean_m, mean_m);
            self.last_seen_ms = last_seen_ms;
            self.scans = 1;
            self.class = CellClass::Free;
        }
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

#[cfg(test)]
mod elevation_cell_tests {
    use proptest::prelude::*;

    use super::*;

    const GROUND: Bounds = Bounds {
        lowest_m: -0.1,
        highest_m: 0.1,
        raised_above_m: 0.05,
    };

    fn cell(points_m: &[f32]) -> ElevationCell {
        let mut cell = ElevationCell::UNKNOWN;
        for &height_m in points_m {
            cell.add(height_m, GROUND, false);
        }
        cell.classify_by_points();
        cell
    }

    #[test]
    fn a_cell_is_grass_if_most_of_what_is_high_is_narrow() {
        let with = |wide: usize, narrow: usize, height_m: f32| {
            let mut cell = cell(&[0.0; 5]);
            for is_narrow in [vec![false; wide], vec![true; narrow]].concat() {
                cell.add(height_m, GROUND, is_narrow);
            }
            cell.classify_by_points();
            cell
        };
        assert_eq!(with(3, 4, 0.5).class(), CellClass::Free);
        assert_eq!(with(4, 4, 0.5).class(), CellClass::Obstacle);
        assert_eq!(with(0, 4, -0.5).class(), CellClass::Obstacle, "a hole");
        assert!((with(3, 4, 0.5).max_m() - 0.5).abs() < 1e-6);
    }

    #[test]
    fn two_points_and_one_in_twenty_make_an_obstacle() {
        let ground = |n: usize| vec![0.0; n];
        let with = |n: usize, extra: &[f32]| cell(&[&ground(n), extra].concat()).class();
        assert_eq!(with(0, &[]), CellClass::Unknown);
        assert_eq!(with(5, &[]), CellClass::Free);
        assert_eq!(with(5, &[0.5]), CellClass::Free, "one point");
        assert_eq!(with(38, &[0.5; 2]), CellClass::Obstacle);
        assert_eq!(with(39, &[0.5; 2]), CellClass::Free, "2 of 41");
        assert_eq!(with(5, &[-0.5; 2]), CellClass::Obstacle);
        // A kerb that is reached after a minute of standing in front of it.
        assert_eq!(with(9000, &[0.15; 28]), CellClass::Obstacle);
    }

    #[test]
    fn the_mean_hides_a_pole() {
        let mut pole = cell(&[&[0.0; 18][..], &[0.6; 2]].concat());
        assert_eq!(pole.class(), CellClass::Obstacle);
        pole.classify_by_mean(GROUND);
        assert_eq!(pole.class(), CellClass::Free);
        let mut kerb = cell(&[0.0, 0.21]);
        kerb.classify_by_mean(GROUND);
        assert_eq!(kerb.class(), CellClass::Obstacle);
    }

    #[test]
    fn cleared_cell_keeps_its_ground() {
        let mut cell = cell(&[0.02, 0.5, 0.9]);
        cell.clear();
        assert_eq!((cell.mean_m(), cell.points()), (Some(0.02), 1));
        assert_eq!((cell.min_m(), cell.max_m()), (0.02, 0.02));
        assert_eq!(cell.class(), CellClass::Free);
        let mut never_ground = ElevationCell::UNKNOWN;
        never_ground.add(0.5, GROUND, false);
        never_ground.clear();
        assert_eq!(never_ground, ElevationCell::UNKNOWN);
    }

    proptest! {
        #[test]
        fn statistics_are_those_of_all_points(
            heights_m in prop::collection::vec(-3.0..3.0f32, 1..300),
        ) {
            let mut cell = ElevationCell::UNKNOWN;
            for &height_m in &heights_m {
                cell.add(height_m, GROUND, false);
            }
            let n = heights_m.len() as f64;
            let mean = heights_m.iter().map(|&z| f64::from(z)).sum::<f64>() / n;
            let squares: f64 = heights_m.iter().map(|&z| (f64::from(z) - mean).powi(2)).sum();
            let variance = if heights_m.len() < 2 { 0.0 } else { squares / (n - 1.0) };
            prop_assert!((f64::from(cell.mean_m().unwrap()) - mean).abs() < 1e-4);
            prop_assert!((f64::from(cell.variance_m2()) - variance).abs() < 1e-3);
            let least_m = heights_m.iter().copied().fold(f32::INFINITY, f32::min);
            let greatest_m = heights_m.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            prop_assert_eq!(cell.min_m().to_bits(), least_m.to_bits());
            prop_assert_eq!(cell.max_m().to_bits(), greatest_m.to_bits());
            prop_assert_eq!(cell.points() as usize, heights_m.len());
        }
    }
}
