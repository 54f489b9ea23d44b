//! The guard of one vehicle, round by round.

use std::time::Duration;

use super::barrier::Barrier;
use super::command_history::CommandHistory;
use super::config::{CollisionMonitorRules, UnknownSpacePolicy};
use super::direction_table::{AxisSpeeds, DirectionTable};
use super::limit_solver::LimitSolver;
use super::local_environment::LocalEnvironment;
use super::local_map::LocalMap;
use super::obstacle_scan::ObstacleScan;
use super::overspeed::overspeed;
use super::predicted_pose::{MAX_POSE_AGE, OdometrySample};
use super::speed_limit_context::SpeedLimitContext;
use super::unavailable::UnavailableReason;
use crate::speed_limits::{CollisionMonitorOutput, SpeedLimits};
use crate::velocity::Velocity;
use measurement::time::Monotonic;

/// What the guard knows in a round.
#[derive(Clone, Copy, Debug)]
pub struct CollisionMonitorInput<'a> {
    /// The last sweep of each sensor.
    pub obstacle_scans: &'a [ObstacleScan],
    /// The last map, where there is one.
    pub map: Option<&'a LocalMap>,
    /// The newest pose and measured speed; absent before the first.
    pub odometry: Option<OdometrySample>,
    /// What the motors were told in the last round.
    pub commanded: Velocity,
    /// What the operator asks now.
    pub requested: Velocity,
}

/// The guard of one vehicle. Of earlier rounds it judges by what the motors were told, and by nothing else.
#[derive(Clone, Debug)]
pub struct CollisionMonitor {
    rules: CollisionMonitorRules,
    directions: DirectionTable,
    environment: LocalEnvironment,
    commanded: CommandHistory,
    last_round: Option<Monotonic>,
    unavailable_reason: Option<UnavailableReason>,
    barrier: Option<Barrier>,
}

impl CollisionMonitor {
    /// A guard that keeps to `rules`.
    pub fn new(rules: CollisionMonitorRules) -> Self {
        Self {
            rules,
            directions: DirectionTable::new(rules.footprint.radius_m()),
            environment: LocalEnvironment::new(&rules),
            commanded: CommandHistory::new(MAX_POSE_AGE + rules.actuator_delay),
            last_round: None,
            unavailable_reason: None,
            barrier: None,
        }
    }

    /// The rules that it keeps to.
    pub const fn rules(&self) -> &CollisionMonitorRules {
        &self.rules
    }

    /// What it lacked in the last round, where it could not judge then.
    pub const fn unavailable_reason(&self) -> Option<UnavailableReason> {
        self.unavailable_reason
    }

    /// What bounded the motion that was asked for in the last round; none where nothing did, or where it could not judge.
    pub const fn barrier(&self) -> Option<Barrier> {
        self.barrier
    }

    /// How long ago the ground beside the vehicle was looked at last: ahead, to the left, behind, to the right; absent where
    /// nobody has looked.
    pub const fn side_ground_ages(&self) -> [Option<Duration>; 4] {
        self.environment.side_ground_ages
    }

    /// Its word of this round. Where the operator asks for no number, it judges as if they asked for nothing.
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
        // Without a pose nothing can be placed, and creeping would be a guess.
        let obeys = (self.rules.actuator_delay, self.rules.is_boat);
        let odometry = input.odometry.ok_or(UnavailableReason::PoseTooOld(None))?;
        let vehicle = odometry.predicted_pose(&self.commanded, obeys, now)?;
        let measured = odometry.measured;
        let is_stale = input
            .obstacle_scans
            .iter()
            .all(|obstacle_scan| obstacle_scan.is_stale(now));
        if is_stale && self.rules.unknown_space_policy == UnknownSpacePolicy::Stop {
            return Err(UnavailableReason::ScansTooOld);
        }
        let known = (input.obstacle_scans, input.map);
        self.environment.update(&self.rules, known, vehicle, now);
        let context = SpeedLimitContext {
            rules: &self.rules,
            environment: &self.environment,
            is_stale,
        };
        let mut solver = LimitSolver::new(context, &self.directions);
        let requested = if input.requested.is_finite() {
            input.requested
        } else {
            Velocity::ZERO
        };
        let travel = |velocity| AxisSpeeds::of(velocity, &self.rules);
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
