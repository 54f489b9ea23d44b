//! Driving a simulated vehicle.

use std::sync::Arc;

use super::sensor::Sensor;
use super::{START, SimulatedSource, Ticks};
use crate::motion::POSTURE_STEP_S;
use crate::velocity::{CommandedVelocity, PlanarVelocity};
use measurement::time::{RobotDuration, RobotTime};

/// How far ahead of the last measurement a vehicle can be driven, seconds: half of what is kept of its motion, so
/// that what is measured next finds all of it.
pub const FARTHEST_AHEAD_S: f64 = 5.0;

const STEP_NANOS: i64 = (POSTURE_STEP_S * 1e9) as i64;
const _: () = assert!(STEP_NANOS == 5_000_000, "whole nanoseconds");

/// A command whose time is too far ahead of what was measured.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "a command for {at_s:.3} s, where the last measurement is of {now_s:.3} s: take measurements up to \
     {FARTHEST_AHEAD_S} s before it first"
)]
pub struct DriveError {
    /// Time of the command, since [`START`].
    pub at_s: f64,
    /// Time of the last measurement, since [`START`].
    pub now_s: f64,
}

/// The vehicle as an actuator.
///
/// Motion advances in steps of 5 ms; a command holds from the first step at or after its time that no measurement
/// has looked at. A scan looks as far ahead of its stamp as its sweep takes (30 ms on a land robot, 200 ms on the
/// boat), an AHRS by its period: commands given meanwhile wait for the end of the sweep.
///
/// The same commands at the same effective times give the same motion and the same measurements, bit for bit,
/// however measurements were taken in between.
impl SimulatedSource {
    /// The same run, but the end of the path does not end it: the vehicle waits there to be driven.
    #[must_use]
    pub fn until_stopped(mut self) -> Self {
        self.continue_past_path();
        self
    }

    /// Commands a velocity from `at` on, until the next command. Returns when that takes effect: never before `at`,
    /// never before the command that came before this one.
    ///
    /// The first command other than zero takes the vehicle off its path; until then zero does nothing.
    ///
    /// # Errors
    /// Where `at` is more than [`FARTHEST_AHEAD_S`] ahead of the last measurement. A driven vehicle then stops.
    pub fn drive(
        &mut self,
        at: RobotTime,
        velocity: CommandedVelocity,
    ) -> Result<RobotTime, DriveError> {
        if self.is_driven() || !velocity.or_zero().is_zero() {
            let effective = self.take_over(at);
            let applied = effective.map_or(CommandedVelocity::ZERO, |_effective| velocity);
            self.run.motion.set_command(applied);
            return effective;
        }
        Ok(at.max(self.frontier()))
    }

    /// Takes the vehicle off its path at `at`, or as soon after as [`SimulatedSource::drive`] would, and stops it:
    /// its command is zero. One that is driven already goes on to that time.
    ///
    /// # Errors
    /// As [`SimulatedSource::drive`].
    pub fn take_over(&mut self, at: RobotTime) -> Result<RobotTime, DriveError> {
        let since_start = at.since(START);
        let (at_s, now_s) = (since_start.as_secs_f64(), self.now_nanos as f64 / 1e9);
        if at_s > now_s + FARTHEST_AHEAD_S {
            return Err(DriveError { at_s, now_s });
        }
        self.frontier = self.frontier.max(step_from(since_start.as_nanos()));
        if !self.is_driven() {
            let scene = Arc::clone(&self.run.scene);
            self.run
                .motion
                .take_over(self.frontier, &self.run.vehicle, scene);
            self.continue_past_path();
        }
        self.run.motion.advance_to(self.frontier);
        Ok(self.frontier())
    }

    /// The time up to which measurements have looked or commands were given: later commands take effect then at the
    /// earliest.
    pub fn frontier(&self) -> RobotTime {
        START + RobotDuration::from_nanos(self.frontier * STEP_NANOS)
    }

    /// How fast the vehicle truly goes in the plane at `at`, as far as it has got: not after
    /// [`SimulatedSource::frontier`].
    pub fn velocity(&self, at: RobotTime) -> PlanarVelocity {
        let known = at.min(self.frontier());
        self.run.motion.velocity(known.since(START).as_secs_f64())
    }

    /// Whether the vehicle is driven by commands instead of its path.
    pub fn is_driven(&self) -> bool {
        self.run.motion.is_driven()
    }

    /// The end of the path is no longer that of the run.
    fn continue_past_path(&mut self) {
        self.last_pose_s = Ticks::until(self.longest_s, self.run.vehicle.odometry_rate_hz).last_s();
        for (ticks, sensor) in &mut self.timetable {
            // A sensor may have come to its end before the last pose.
            ticks.extend(&sensor.ticks(&self.run, self.last_pose_s), self.now_nanos);
        }
    }
}

/// The first step that a reading at `nanos` does not look at any more; at the step itself no command holds yet.
pub(super) fn observed_until(nanos: i64, sensor: &Sensor) -> i64 {
    step_from(nanos.saturating_add(lookahead_nanos(sensor)))
}

pub(super) fn lookahead_nanos(sensor: &Sensor) -> i64 {
    libm::ceil(sensor.lookahead_s() * 1e9) as i64
}

/// The first step at or after a time.
fn step_from(nanos: i64) -> i64 {
    nanos.max(0).saturating_add(STEP_NANOS - 1) / STEP_NANOS
}
