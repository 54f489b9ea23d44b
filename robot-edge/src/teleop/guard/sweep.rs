//! What the last sweep of a sensor says of what is in the way, and of what was looked at.

use std::time::Duration;

use nalgebra::{Point2, Point3};

use super::blockage::{BlockageDetector, Doubts};
use super::config::{GuardRules, Heights};
use super::coverage::{Coverage, Look};
use crate::clock::Monotonic;
use crate::mapping::ground_plane::GroundPlane;
use crate::mapping::posed_scan::{BeamOutcome, PosedBeam, PosedScan};
use crate::pose::Pose;

/// Most points of one sweep that are kept; real sensors have some thousand.
const MAX_POINTS: usize = 16_384;

/// How many steps from beam to beam wide a beam looks: one that is missing between two others is made up for.
const BEAM_STEPS: f64 = 2.0;

/// Sweeps and maps are never stale before this ("Collision guard").
const LEAST_STALE: Duration = Duration::from_millis(300);

/// One sweep of one sensor. It keeps its memory from sweep to sweep: whoever hands them over swaps two or three.
#[derive(Clone, Debug, Default)]
pub struct GuardSweep {
    taken: Monotonic,
    period: Duration,
    /// Those in the water last.
    points_in_odom: Vec<[f64; 2]>,
    shallows: usize,
    coverage: Coverage,
    doubts: Doubts,
}

/// Whether what was known at `taken` and is renewed every `period` is too old: max(300 ms, 2.5 periods).
pub(super) fn is_stale(taken: Monotonic, period: Duration, now: Monotonic) -> bool {
    now.since(taken) > LEAST_STALE.max(period.saturating_mul(5) / 2)
}

impl GuardSweep {
    /// Takes over a sweep whose heights are those above `plane`.
    ///
    /// `taken` is when it was measured, on this machine's clock: when it arrived, at the latest. `period` is the time from
    /// sweep to sweep. `blockage` is that of the sensor, and has taken this scan.
    pub fn read(
        &mut self,
        scan: &PosedScan,
        plane: &GroundPlane,
        rules: &GuardRules,
        blockage: &BlockageDetector,
        (taken, period): (Monotonic, Duration),
    ) {
        self.taken = taken;
        self.period = period;
        self.points_in_odom.clear();
        self.shallows = 0;
        self.doubts = blockage.doubts();
        let Some(first) = scan.beams.first() else {
            self.coverage.clear(Point2::origin());
            return;
        };
        self.coverage.clear(first.origin_in_odom.xy());
        let base_from_odom = scan.odom_from_base.inverse();
        let at = Sight {
            plane,
            rules,
            blockage,
            base_from_odom,
            first_origin: first.origin_in_odom,
            vehicle: Point2::from(scan.odom_from_base.translation.vector.xy()),
            window_m2: rules.window_m() * rules.window_m(),
        };
        for beam in &scan.beams {
            let seen = at.look(beam);
            let along = (beam.end_in_odom - beam.origin_in_odom).xy();
            self.coverage
                .look(along, BEAM_STEPS * scan.beam_step_rad, seen.look);
            if let Some((point, is_shallow)) = seen.obstacle_in_odom
                && self.points_in_odom.len() < MAX_POINTS
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

    /// When it was measured.
    pub(super) const fn taken(&self) -> Monotonic {
        self.taken
    }

    pub(super) const fn doubts(&self) -> Doubts {
        self.doubts
    }

    /// What stands in the vehicle's way, and where the water is too shallow for it; metres in `odom`.
    pub(super) fn obstacles_and_shallows(&self) -> (&[[f64; 2]], &[[f64; 2]]) {
        let first = self.points_in_odom.len() - self.shallows;
        self.points_in_odom.split_at(first)
    }

    /// Whether it is too old to be relied on.
    pub fn is_stale(&self, now: Monotonic) -> bool {
        is_stale(self.taken, self.period, now)
    }

    /// What is in the way, metres in `odom`.
    pub fn points_in_odom(&self) -> &[[f64; 2]] {
        &self.points_in_odom
    }

    pub(super) const fn coverage(&self) -> &Coverage {
        &self.coverage
    }
}

/// What one beam says.
struct Seen {
    look: Look,
    /// What is in the way, and whether that is the bottom of the water.
    obstacle_in_odom: Option<(Point3<f64>, bool)>,
}

struct Sight<'a> {
    plane: &'a GroundPlane,
    rules: &'a GuardRules,
    blockage: &'a BlockageDetector,
    base_from_odom: Pose,
    first_origin: Point3<f64>,
    vehicle: Point2<f64>,
    window_m2: f64,
}

impl Sight<'_> {
    fn look(&self, beam: &PosedBeam) -> Seen {
        let (from, to) = (beam.origin_in_odom, beam.end_in_odom);
        let (from_height_m, to_height_m) = (self.plane.height_m(&from), self.plane.height_m(&to));
        let along = (to - from).xy();
        let length_m = (along.x * along.x + along.y * along.y).sqrt();
        let nothing = Seen {
            look: Look {
                near_m: 0.0,
                ..Look::NOTHING
            },
            obstacle_in_odom: None,
        };
        if !(length_m.is_finite() && from_height_m.is_finite() && to_height_m.is_finite()) {
            return nothing;
        }
        let is_miss = beam.outcome == BeamOutcome::Miss;
        if is_miss && !self.is_miss_believed(beam) {
            return nothing;
        }
        let fall_m = from_height_m - to_height_m;
        let (near, far) = low_part(from_height_m, to_height_m, self.rules.seen_below_m);
        let hits = !is_miss && !self.is_own_body(beam);
        let height = self.rules.heights.of(from_height_m, to_height_m);
        let obstacle = match height {
            Height::Clear => None,
            // The edge is not farther than where the beam was as high as the ground.
            Height::Hole if from_height_m > 0.0 => Some(from_height_m / fall_m),
            Height::InTheWay | Height::Shallow | Height::Hole => Some(1.0),
        };
        let obstacle = obstacle.filter(|_| hits);
        let until = obstacle.unwrap_or(1.0);
        // What looks under water has not seen what floats on it.
        let is_under_water = self.rules.is_boat && from_height_m < 0.0;
        Seen {
            look: if is_under_water {
                nothing.look
            } else {
                Look {
                    near_m: (near * length_m) as f32,
                    far_m: (far.min(until) * length_m) as f32,
                    reach_m: (until * length_m) as f32,
                    is_miss: is_miss && !self.rules.trust_misses,
                }
            },
            obstacle_in_odom: obstacle
                .map(|share| from + (to - from) * share)
                .filter(|point| (point.xy() - self.vehicle).norm_squared() <= self.window_m2)
                .map(|point| (point, height == Height::Shallow)),
        }
    }

    /// Whether a beam without an echo has seen that the way is free.
    fn is_miss_believed(&self, beam: &PosedBeam) -> bool {
        let is_proven = self.rules.open_mps > 0.0 && self.blockage.has_echoes();
        (self.rules.trust_misses || is_proven) && !self.blockage.is_beam_blocked(beam)
    }

    /// Whether it ends within the footprint, which moved with the sensor since the sweep began.
    fn is_own_body(&self, beam: &PosedBeam) -> bool {
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

/// What something at a height is to the vehicle.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Height {
    Clear,
    InTheWay,
    /// The bottom of the water, too near below its surface.
    Shallow,
    Hole,
}

impl Heights {
    /// What the end of a beam is.
    ///
    /// A sensor that is no higher than what may be driven over cannot tell floor from what stands on it; and what a
    /// sensor above the vehicle's top sees at its own height is not known to end there.
    fn of(&self, from_height_m: f64, to_height_m: f64) -> Height {
        if to_height_m > self.top_m.max(from_height_m) + self.h_pos_m {
            return Height::Clear;
        }
        if to_height_m > self.h_pos_m
            || (from_height_m.abs() <= self.h_pos_m && self.keel_m.is_none())
        {
            return Height::InTheWay;
        }
        if to_height_m >= -self.h_neg_m {
            return Height::Clear;
        }
        match self.keel_m {
            None => Height::Hole,
            Some(keel_m) if to_height_m >= keel_m - self.h_neg_m => Height::Shallow,
            Some(_) => Height::Clear,
        }
    }
}

#[cfg(test)]
mod tests;
