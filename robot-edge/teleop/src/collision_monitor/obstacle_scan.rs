//! Obstacles and observed ground of the last scan of one sensor.

use std::collections::HashSet;
use std::f64::consts::TAU;
use std::time::Duration;

use nalgebra::{Point2, Point3, Vector2};

use crate::collision_monitor::blockage::{BlockageCounts, BlockageDetector};
use crate::collision_monitor::config::{CollisionMonitorRules, Heights};
use mapping::ground_plane::GroundPlane;
use mapping::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, ScanKind};
use measurement::pose::Pose;
use measurement::time::Monotonic;

/// Greatest number of points kept of one scan; real sensors have some thousand.
const MAX_POINTS: usize = 16_384;

/// Width of a beam in steps between beams, so that a single missing beam leaves no gap.
const BEAM_STEPS: f64 = 2.0;

/// Sweeps and maps are never stale before this.
const MIN_STALE_AGE: Duration = Duration::from_millis(300);

/// One scan of one sensor. Its buffers are reused from scan to scan.
#[derive(Clone, Debug, Default)]
pub struct ObstacleScan {
    measured_at: Monotonic,
    period: Duration,
    kind: ScanKind,
    /// Those in the water last.
    points_in_odom: Vec<[f64; 2]>,
    shallows: usize,
    /// Where a cloud has a point already.
    places: HashSet<[i64; 2]>,
    coverage: Coverage,
    blockage_counts: BlockageCounts,
}

/// Sectors of [`ObstaclesAround`].
pub const SECTORS_AROUND: usize = 72;

/// Obstacles around the vehicle, at any distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObstaclesAround {
    /// Distance of the nearest one from the vehicle's frame, metres, in sectors of 5 degrees, clockwise seen from above; the middle of the
    /// first one is ahead. Infinite where beams met none, not a number where none looked.
    pub nearest_m: [f32; SECTORS_AROUND],
}

impl Default for ObstaclesAround {
    fn default() -> Self {
        Self {
            nearest_m: [f32::NAN; SECTORS_AROUND],
        }
    }
}

impl ObstaclesAround {
    /// A beam ended here, metres; `is_obstacle`: at an obstacle.
    fn add(&mut self, in_base: &Point3<f64>, is_obstacle: bool) {
        let turned = -libm::atan2(in_base.y, in_base.x) / TAU * SECTORS_AROUND as f64;
        let sector = libm::round(turned).rem_euclid(SECTORS_AROUND as f64);
        if let Some(nearest_m) = self.nearest_m.get_mut(sector as usize) {
            let distance_m = if is_obstacle {
                in_base.xy().coords.norm() as f32
            } else {
                f32::INFINITY
            };
            // The least of both, and a number rather than none.
            *nearest_m = nearest_m.min(distance_m);
        }
    }
}

/// Whether what was known at `measured_at` and is renewed every `period` is too old: max(300 ms, 2.5 periods).
pub(super) fn is_stale(measured_at: Monotonic, period: Duration, now: Monotonic) -> bool {
    now.since(measured_at) > MIN_STALE_AGE.max(period.saturating_mul(5) / 2)
}

impl ObstacleScan {
    /// Reads a scan; heights refer to `plane`.
    ///
    /// `around` gets what it shows around the vehicle, beside what is in it.
    ///
    /// `measured_at` is when it was measured, on this machine's clock: when it arrived, at the latest. `period` is the
    /// time from sweep to sweep. `blockage` is that of the sensor, and has taken this scan.
    pub fn read(
        &mut self,
        scan: &RegisteredScan,
        plane: &GroundPlane,
        rules: &CollisionMonitorRules,
        blockage: &BlockageDetector,
        (measured_at, period): (Monotonic, Duration),
        mut around: Option<&mut ObstaclesAround>,
    ) {
        self.measured_at = measured_at;
        self.period = period;
        self.kind = scan.kind;
        self.points_in_odom.clear();
        self.places.clear();
        self.shallows = 0;
        self.blockage_counts = blockage.blockage_counts();
        let Some(first) = scan.beams.first() else {
            self.coverage.clear(Point2::origin());
            return;
        };
        self.coverage.clear(first.origin_in_odom.xy());
        let base_from_odom = scan.odom_from_base.inverse();
        let at = BeamEvaluator {
            plane,
            rules,
            blockage,
            base_from_odom,
            first_origin: first.origin_in_odom,
            vehicle: Point2::from(scan.odom_from_base.translation.vector.xy()),
            kind: scan.kind,
        };
        let window_m2 = rules.window_m() * rules.window_m();
        for beam in &scan.beams {
            let beam_result = at.evaluate(beam);
            if scan.kind == ScanKind::Beams {
                let along = (beam.end_in_odom - beam.origin_in_odom).xy();
                let width_rad = BEAM_STEPS * scan.beam_step_rad;
                self.coverage
                    .add_beam(along, width_rad, beam_result.visible);
            }
            // A bumper touches what is in the way at any height, and at the edge of the footprint.
            let obstacle_in_odom = match scan.kind {
                ScanKind::Contact { .. } => Some((beam.end_in_odom, false)),
                ScanKind::Beams | ScanKind::Cloud | ScanKind::Arc => beam_result.obstacle_in_odom,
            };
            if let Some(around) = &mut around
                && beam_result.is_seen
                && matches!(scan.kind, ScanKind::Beams | ScanKind::Cloud)
            {
                let end = obstacle_in_odom.map_or(beam.end_in_odom, |(point, _)| point);
                around.add(&(base_from_odom * end), obstacle_in_odom.is_some());
            }
            if let Some((point, is_shallow)) = obstacle_in_odom
                && (point.xy() - at.vehicle).norm_squared() <= window_m2
                && self.points_in_odom.len() < MAX_POINTS
                && (scan.kind != ScanKind::Cloud || self.places.insert(place_of(&point)))
            {
                self.points_in_odom.push([point.x, point.y]);
                if is_shallow {
                    self.shallows += 1;
                } else {
                    let last = self.points_in_odom.len() - 1;
                    self.points_in_odom.swap(last, last - self.shallows);
                }
            }
        }
    }

    pub(super) const fn measured_at(&self) -> Monotonic {
        self.measured_at
    }

    pub(super) const fn blockage_counts(&self) -> BlockageCounts {
        self.blockage_counts
    }

    /// Obstacles and points of too shallow water, metres in `odom`.
    pub(super) fn obstacles_and_shallows(&self) -> (&[[f64; 2]], &[[f64; 2]]) {
        let first = self.points_in_odom.len() - self.shallows;
        self.points_in_odom.split_at(first)
    }

    /// Whether it shows no free ground: it is too old, or no planar scan. The map shows what clouds have seen.
    pub fn is_stale(&self, now: Monotonic) -> bool {
        self.kind != ScanKind::Beams || is_stale(self.measured_at, self.period, now)
    }

    pub(super) const fn is_contact(&self) -> bool {
        matches!(self.kind, ScanKind::Contact { .. })
    }

    /// Whether its obstacles are no longer there. Those of beams remain until the next scan: without one, the vehicle
    /// has no business there. A dead ultrasonic sensor must not hold it for ever.
    pub(super) fn is_forgotten(&self, max_age: Duration, now: Monotonic) -> bool {
        self.kind == ScanKind::Arc && now.since(self.measured_at) > max_age
    }

    /// All obstacle points, metres in `odom`.
    pub fn points_in_odom(&self) -> &[[f64; 2]] {
        &self.points_in_odom
    }

    pub(super) const fn coverage(&self) -> &Coverage {
        &self.coverage
    }
}

/// Side of the squares of which one point of a cloud is kept, metres: the points of a wall lie above each other.
const PLACE_M: f64 = 0.02;

fn place_of(point: &Point3<f64>) -> [i64; 2] {
    [point.x, point.y].map(|metres| (metres / PLACE_M).floor() as i64)
}

struct BeamResult {
    /// It says what is there.
    is_seen: bool,
    visible: VisibleRange,
    /// The obstacle, and whether it is the bottom of the water.
    obstacle_in_odom: Option<(Point3<f64>, bool)>,
}

struct BeamEvaluator<'a> {
    plane: &'a GroundPlane,
    rules: &'a CollisionMonitorRules,
    blockage: &'a BlockageDetector,
    base_from_odom: Pose,
    first_origin: Point3<f64>,
    vehicle: Point2<f64>,
    kind: ScanKind,
}

impl BeamEvaluator<'_> {
    fn evaluate(&self, beam: &RegisteredBeam) -> BeamResult {
        let (from, to) = (beam.origin_in_odom, beam.end_in_odom);
        let (from_height_m, to_height_m) = (self.plane.height_m(&from), self.plane.height_m(&to));
        let along = (to - from).xy();
        let length_m = (along.x * along.x + along.y * along.y).sqrt();
        let nothing = BeamResult {
            is_seen: false,
            visible: VisibleRange {
                near_m: 0.0,
                ..VisibleRange::NOTHING
            },
            obstacle_in_odom: None,
        };
        if !(length_m.is_finite() && from_height_m.is_finite() && to_height_m.is_finite()) {
            return nothing;
        }
        let is_miss = beam.outcome == BeamOutcome::Miss;
        if is_miss && !self.is_miss_trusted(beam) {
            return nothing;
        }
        let fall_m = from_height_m - to_height_m;
        let (near, far) = low_part(
            from_height_m,
            to_height_m,
            self.rules.ground_visible_below_m,
        );
        // What is nearer than a cone measures lies at the sensor, at the edge of the footprint.
        let is_sweep = matches!(self.kind, ScanKind::Beams | ScanKind::Cloud);
        let is_own_body = is_sweep && self.is_own_body(beam);
        let hits = !is_miss && !is_own_body;
        let height = self.rules.heights.of(from_height_m, to_height_m);
        let obstacle = match height {
            HeightClass::Clear => None,
            // The edge is not farther than where the beam was as high as the ground.
            HeightClass::Hole if from_height_m > 0.0 => Some(from_height_m / fall_m),
            HeightClass::Obstacle | HeightClass::Shallow | HeightClass::Hole => Some(1.0),
        };
        let obstacle = obstacle.filter(|_| hits);
        let until = obstacle.unwrap_or(1.0);
        // A beam under water does not observe floating obstacles.
        let is_under_water = self.rules.is_boat && from_height_m < 0.0;
        BeamResult {
            is_seen: !is_own_body,
            visible: if is_under_water {
                nothing.visible
            } else {
                VisibleRange {
                    near_m: (near * length_m) as f32,
                    far_m: (far.min(until) * length_m) as f32,
                    reach_m: (until * length_m) as f32,
                    is_miss: is_miss && !self.rules.treat_no_return_as_free,
                }
            },
            obstacle_in_odom: obstacle
                .map(|share| from + (to - from) * share)
                .map(|point| (point, height == HeightClass::Shallow)),
        }
    }

    fn is_miss_trusted(&self, beam: &RegisteredBeam) -> bool {
        let is_proven = self.rules.no_return_speed_mps > 0.0 && self.blockage.has_returns();
        (self.rules.treat_no_return_as_free || is_proven) && !self.blockage.is_beam_blocked(beam)
    }

    /// Whether it ends within the footprint, which moved with the sensor since the sweep began.
    fn is_own_body(&self, beam: &RegisteredBeam) -> bool {
        let moved = beam.origin_in_odom - self.first_origin;
        let point_in_base = self.base_from_odom * (beam.end_in_odom - moved);
        self.rules
            .footprint
            .contains([point_in_base.x, point_in_base.y])
    }
}

/// The part of a beam, 0 to 1, that is at most `below_m` high; empty where none is.
fn low_part(from_height_m: f64, to_height_m: f64, below_m: f64) -> (f64, f64) {
    let crossing = (from_height_m - below_m) / (from_height_m - to_height_m);
    match (from_height_m <= below_m, to_height_m <= below_m) {
        (true, true) => (0.0, 1.0),
        (true, false) => (0.0, crossing),
        (false, true) => (crossing, 1.0),
        (false, false) => (f64::INFINITY, 0.0),
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum HeightClass {
    Clear,
    Obstacle,
    /// The bottom of the water, too near below its surface.
    Shallow,
    Hole,
}

impl Heights {
    /// What the end of a beam is.
    ///
    /// A sensor that is no higher than what may be driven over cannot tell floor from what stands on it; and what a
    /// sensor above the vehicle's top sees at its own height is not known to end there.
    fn of(&self, from_height_m: f64, to_height_m: f64) -> HeightClass {
        if to_height_m > self.top_m.max(from_height_m) + self.h_pos_m {
            return HeightClass::Clear;
        }
        if to_height_m > self.h_pos_m
            || (from_height_m.abs() <= self.h_pos_m && self.keel_m.is_none())
        {
            return HeightClass::Obstacle;
        }
        if to_height_m >= -self.h_neg_m {
            return HeightClass::Clear;
        }
        match self.keel_m {
            None => HeightClass::Hole,
            Some(keel_m) if to_height_m >= keel_m - self.h_neg_m => HeightClass::Shallow,
            Some(_) => HeightClass::Clear,
        }
    }
}

const SECTORS: usize = 720;

/// Widest beam that counts as observed, radians; coarser sensors leave gaps.
const WIDEST_BEAM_RAD: f64 = 0.1;

#[derive(Clone, Debug)]
pub(super) struct Coverage {
    origin_in_odom: Point2<f64>,
    sectors: Box<[Option<VisibleRange>; SECTORS]>,
}

/// The range observed by one beam, or by all beams of one sector; distances along the ground, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct VisibleRange {
    /// From here on it was low enough to see what stands on the ground, …
    pub(super) near_m: f32,
    /// … up to here.
    pub(super) far_m: f32,
    /// It passed over everything up to here, at whatever height.
    pub(super) reach_m: f32,
    /// It had no echo.
    pub(super) is_miss: bool,
}

impl VisibleRange {
    pub(super) const NOTHING: Self = Self {
        near_m: f32::INFINITY,
        far_m: 0.0,
        reach_m: 0.0,
        is_miss: false,
    };

    fn and(self, other: Self) -> Self {
        Self {
            near_m: self.near_m.max(other.near_m),
            far_m: self.far_m.min(other.far_m),
            reach_m: self.reach_m.min(other.reach_m),
            is_miss: self.is_miss || other.is_miss,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Observation {
    /// By a beam that was low enough there; else by one that passed above it.
    pub(super) is_low: bool,
    /// By a beam without an echo.
    pub(super) is_miss: bool,
}

impl Default for Coverage {
    fn default() -> Self {
        Self {
            origin_in_odom: Point2::origin(),
            sectors: Box::new([None; SECTORS]),
        }
    }
}

/// The number of the sector of a direction that is not zero. Sectors are equal parts of a square, not of a circle,
/// which takes no trigonometry.
fn sector(direction: Vector2<f64>) -> usize {
    let share = direction.y / (direction.x.abs() + direction.y.abs());
    let quarters = match (direction.x >= 0.0, direction.y >= 0.0) {
        (true, true) => share,
        (true, false) => 4.0 + share,
        (false, _) => 2.0 - share,
    };
    ((0.25 * SECTORS as f64 * quarters) as usize).min(SECTORS - 1)
}

impl Coverage {
    /// Forgets everything, and looks from another place.
    pub(super) fn clear(&mut self, origin_in_odom: Point2<f64>) {
        self.origin_in_odom = origin_in_odom;
        self.sectors.fill(None);
    }

    /// A beam of some width, radians, looked in a direction (any length).
    pub(super) fn add_beam(
        &mut self,
        direction: Vector2<f64>,
        width_rad: f64,
        visible: VisibleRange,
    ) {
        let is_direction =
            direction.x.is_finite() && direction.y.is_finite() && direction != Vector2::zeros();
        if !is_direction {
            return;
        }
        let half = (0.5 * width_rad).clamp(0.0, 0.5 * WIDEST_BEAM_RAD); // NaN stays, and looks nowhere
        let across = Vector2::new(-direction.y, direction.x) * half;
        let (first, last) = (sector(direction - across), sector(direction + across));
        let mut at = first;
        loop {
            let observation = &mut self.sectors[at];
            *observation = Some(observation.map_or(visible, |before| before.and(visible)));
            if at == last {
                break;
            }
            at = if at + 1 == SECTORS { 0 } else { at + 1 };
        }
    }

    /// How a point, metres in `odom`, was looked at, if it was; with `slack_m` for what lies at the end of a beam.
    pub(super) fn observation_at(
        &self,
        point_in_odom: Point2<f64>,
        slack_m: f64,
    ) -> Option<Observation> {
        let to = point_in_odom - self.origin_in_odom;
        let distance_m = (to.x * to.x + to.y * to.y).sqrt();
        if distance_m <= 0.0 {
            return Some(Observation {
                is_low: true,
                is_miss: false,
            });
        }
        let visible = self.sectors[sector(to)]?;
        let is_low = distance_m >= f64::from(visible.near_m) - slack_m
            && distance_m <= f64::from(visible.far_m) + slack_m;
        let is_passed = distance_m <= f64::from(visible.reach_m);
        (is_low || is_passed).then_some(Observation {
            is_low,
            is_miss: visible.is_miss,
        })
    }
}

#[cfg(test)]
mod tests;
