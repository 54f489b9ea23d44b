//! Collision monitor: limits the speed so that the vehicle stops before obstacles and unknown ground.
//!
//! Inputs are the last scan of each sensor ([`ObstacleScan`], filled by the localization thread) and a copy of the map
//! ([`LocalMap`], filled by the mapping thread). Both are plain data, and the monitor waits for neither. The output is
//! only a set of speed limits, so it can only make the vehicle slower (P9). In addition it reports what limits the
//! requested motion ([`Barrier`]); no limit depends on this report.
//!
//! The loop calls [`CollisionMonitor::output`] in each round, after the commands of the round and before its tick. All
//! parts reuse their buffers, so nothing is allocated after the first rounds.
//!
//! One round: predict the pose at which the vehicle obeys the present command (`predicted_pose`); find how far the
//! footprint can move from there along arcs before it touches a point (`footprint`, exact); find the speed from which
//! the vehicle stops within this distance (`allowed_speed`); combine the directions to limits of linear and angular
//! speed (`limit_solver`). Before ground that no sensor observed in time, the vehicle must be able to stop, or creep.
//!
//! Limits of the guarantee: it covers static obstacles only, and not those that the sensors cannot detect (glass,
//! objects below or above a level laser, objects thinner than the gap between beams). The vehicle must brake as
//! configured. In the vegetation of a docking site that the driver has chosen it only creeps, and what stands hidden there
//! is no obstacle until it changes the site's class or a bumper touches it. Obstacles known only from the map are passed no nearer than half a cell, at creep speed a sixth. A boat
//! cannot brake: thrust is cut, and the guarantee is that it coasts no farther than `teleop.stop_decel_mps2` says,
//! without wind and current.

mod allowed_speed;
mod blockage;
mod config;
mod footprint;
mod limit_solver;
mod local_environment;
mod local_map;
mod obstacle_scan;
mod predicted_pose;

use std::fmt;
use std::time::Duration;

use crate::interface::{CollisionMonitorOutput, SpeedLimits};
use crate::motion::Velocity;
use allowed_speed::SpeedLimitContext;
use footprint::MotionPlane;
use limit_solver::{AxisSpeeds, DirectionTable, LimitSolver};
use local_environment::LocalEnvironment;
use measurement::time::Monotonic;
use predicted_pose::{CommandHistory, MAX_POSE_AGE};
use protocol::message::DockingChoice;

pub use allowed_speed::Barrier;
pub use blockage::BlockageDetector;
pub use config::{CollisionMonitorConfig, CollisionMonitorRules, UnknownSpacePolicy};
pub use local_map::{CopyRequest, LocalMap};
pub use obstacle_scan::{ObstacleScan, ObstaclesAround, SECTORS_AROUND};
pub use predicted_pose::OdometrySample;

/// The inputs of one round.
#[derive(Clone, Copy, Debug)]
pub struct CollisionMonitorInput<'a> {
    /// The last sweep of each sensor.
    pub obstacle_scans: &'a [ObstacleScan],
    /// The last map, if there is one.
    pub map: Option<&'a LocalMap>,
    /// The newest pose and measured speed; absent before the first.
    pub odometry: Option<OdometrySample>,
    /// The velocity sent to the motors in the last round.
    pub commanded: Velocity,
    /// The velocity requested by the operator now, as far as the vehicle can do it: not both a lateral and an angular
    /// part.
    pub requested: Velocity,
    /// The docking site into whose vegetation the operator steers on purpose.
    pub docking: Option<DockingChoice>,
}

/// The collision monitor of one vehicle. Of earlier rounds it uses only the velocities sent to the motors.
#[derive(Clone, Debug)]
pub struct CollisionMonitor {
    rules: CollisionMonitorRules,
    /// For turning, and for going sideways.
    directions: [DirectionTable; 2],
    environment: LocalEnvironment,
    commanded: CommandHistory,
    last_round: Option<Monotonic>,
    unavailable_reason: Option<UnavailableReason>,
    barrier: Option<Barrier>,
}

impl CollisionMonitor {
    /// A monitor with these rules.
    pub fn new(rules: CollisionMonitorRules) -> Self {
        Self {
            rules,
            directions: [
                MotionPlane::Turning {
                    radius_m: rules.footprint.radius_m(),
                },
                MotionPlane::Sideways,
            ]
            .map(DirectionTable::new),
            environment: LocalEnvironment::new(&rules),
            commanded: CommandHistory::new(MAX_POSE_AGE + rules.actuator_delay),
            last_round: None,
            unavailable_reason: None,
            barrier: None,
        }
    }

    /// The rules.
    pub const fn rules(&self) -> &CollisionMonitorRules {
        &self.rules
    }

    /// Why the last round gave no limits, if so.
    pub const fn unavailable_reason(&self) -> Option<UnavailableReason> {
        self.unavailable_reason
    }

    /// What limited the requested motion in the last round, if anything did.
    pub const fn barrier(&self) -> Option<Barrier> {
        self.barrier
    }

    /// Age of the last observation of the ground beside the vehicle: ahead, left, behind, right; absent without
    /// observation.
    pub const fn side_ground_ages(&self) -> [Option<Duration>; 4] {
        self.environment.side_ground_ages
    }

    /// The output of this round. A request that is not finite counts as zero.
    pub fn output(
        &mut self,
        input: &CollisionMonitorInput<'_>,
        now: Monotonic,
    ) -> CollisionMonitorOutput {
        self.barrier = None;
        if !self.rules.enabled {
            return CollisionMonitorOutput::Off;
        }
        let limits = self.limits(input, now);
        self.unavailable_reason = limits.err();
        limits.map_or(
            CollisionMonitorOutput::Stale,
            CollisionMonitorOutput::Limits,
        )
    }

    fn limits(
        &mut self,
        input: &CollisionMonitorInput<'_>,
        now: Monotonic,
    ) -> Result<SpeedLimits, UnavailableReason> {
        let since = self.last_round.replace(now).unwrap_or(now);
        if !input.commanded.is_finite() {
            return Err(UnavailableReason::NotFinite);
        }
        self.commanded.record(since, input.commanded);
        // Without a pose no scan can be used, and creeping would be a guess.
        let obeys = (self.rules.actuator_delay, self.rules.is_boat);
        let odometry = input.odometry.ok_or(UnavailableReason::PoseTooOld(None))?;
        let vehicle = odometry.predicted_pose(&self.commanded, obeys, now)?;
        let measured = odometry.measured;
        let is_stale = input.obstacle_scans.iter().all(|scan| scan.is_stale(now));
        if is_stale && self.rules.unknown_space_policy == UnknownSpacePolicy::Stop {
            return Err(UnavailableReason::ScansTooOld);
        }
        let known = (input.obstacle_scans, input.map);
        let (docking, rules) = (input.docking, &self.rules);
        self.environment.update(rules, known, docking, vehicle, now);
        let context = SpeedLimitContext {
            rules: &self.rules,
            environment: &self.environment,
            is_stale,
        };
        let requested = if input.requested.is_finite() {
            input.requested
        } else {
            Velocity::ZERO
        };
        // Between turning and going sideways the vehicle stands.
        let goes_sideways =
            requested.lateral_mps.abs() > 0.0 || input.commanded.lateral_mps.abs() > 0.0;
        let directions = &self.directions[usize::from(goes_sideways)];
        let mut solver = LimitSolver::new(context, directions);
        let travel = |velocity| AxisSpeeds::of(velocity, directions.plane, &self.rules);
        solver.limit_request(travel(requested));
        self.barrier = solver.barrier().map(|(kind, point)| Barrier {
            position_in_odom: vehicle.to_odom(point),
            kind,
        });
        for motion in [measured, input.commanded] {
            solver.limit_motion(travel(motion));
            solver.limit_change(travel(motion), travel(requested));
        }
        let limits = solver.limits();
        Ok(SpeedLimits {
            overspeed: if self.rules.is_boat {
                overspeed(&limits, measured, &self.rules)
            } else {
                Velocity::ZERO
            },
            ..limits
        })
    }
}

/// Why the output is [`CollisionMonitorOutput::Stale`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnavailableReason {
    /// The newest pose has this age, or there is none yet.
    PoseTooOld(Option<Duration>),
    /// A pose, speed or motor command is NaN or infinite.
    NotFinite,
    /// The last scan of every sensor is too old, and `teleop.collision_monitor.unknown_space_policy` is `stop`.
    ScansTooOld,
}

impl fmt::Display for UnavailableReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::PoseTooOld(Some(age)) => {
                write!(f, "its newest pose was {:.2} s old", age.as_secs_f64())
            }
            Self::PoseTooOld(None) => f.write_str("it had no pose yet"),
            Self::NotFinite => f.write_str("a pose or speed was no number"),
            Self::ScansTooOld => f.write_str("no sensor had seen anything new in time"),
        }
    }
}

/// A limit counts as the configured greatest speed if it is smaller by less than this share: rounding errors.
const ROUNDING: f64 = 1e-9;

/// The measured speed of a boat at its greatest speed is noisy by less than this share: positions with errors of 2 cm,
/// half a second apart, give 0.06 m/s of 3.0 m/s. A boat that much faster needs 0.6 m more to stop, less than its margin
/// of 1 m.
const NOISE: f64 = 0.03;

/// By how much the measured velocity exceeds the limits, with its sign; zero along an axis within its limits.
///
/// Where the greatest speed is allowed, noise does not count: no command asks for more, and if thrust were cut at every
/// second measurement, the boat would never reach that speed.
fn overspeed(limits: &SpeedLimits, measured: Velocity, rules: &CollisionMonitorRules) -> Velocity {
    Velocity::new(
        beyond(
            (limits.forward_mps, limits.reverse_mps),
            measured.linear_mps,
            rules.max_speed_mps,
        ),
        // A boat has no lateral thrust.
        beyond(
            (limits.left_radps, limits.right_radps),
            measured.angular_radps,
            rules.max_turn_rate_radps,
        ),
    )
}

fn beyond((positive, negative): (f64, f64), measured: f64, greatest: f64) -> f64 {
    let limit = if measured < 0.0 { negative } else { positive };
    let tolerated = if limit < greatest * (1.0 - ROUNDING) {
        limit
    } else {
        greatest * (1.0 + NOISE)
    };
    if measured.abs() > tolerated {
        measured - limit.copysign(measured)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests;
