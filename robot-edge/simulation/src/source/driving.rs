//! Driving a simulated vehicle.

use super::sensor::Sensor;
use super::ticks::Ticks;
use super::{START, SimulatedSource};
use crate::bumper::Bumper;
use crate::motion::{Collisions, DriveModel, POSTURE_STEP_S};
use crate::velocity::{CommandedVelocity, PlanarVelocity};
use measurement::time::{RobotDuration, RobotTime};

/// How far ahead of the last measurement a vehicle can be driven, seconds: half of what is kept of its motion, so
/// that what is measured next finds all of it.
pub const FARTHEST_AHEAD_S: f64 = 5.0;

const STEP_NANOS: i64 = (POSTURE_STEP_S * 1e9) as i64;
const _: () = assert!(STEP_NANOS == 5_000_000, "whole nanoseconds");

/// Why a vehicle was not told something.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum DriveError {
    /// The time is too far ahead of what was measured.
    #[error(
        "a command for {at_s:.3} s, where the last measurement is of {now_s:.3} s: take measurements up to \
         {FARTHEST_AHEAD_S} s before it first"
    )]
    TooFarAhead {
        /// Since [`START`].
        at_s: f64,
        /// Since [`START`].
        now_s: f64,
    },
}

/// The vehicle as an actuator.
///
/// Motion advances in steps of [`POSTURE_STEP_S`]; what the vehicle is told holds from the first step at or after
/// the time of the command that no measurement has looked at. A scan looks as far ahead of its stamp as its sweep
/// takes (30 ms on a land robot, 200 ms on the boat), an AHRS by its period. Whoever takes a measurement when
/// [`SimulatedSource::next_due`] has come therefore loses nothing, and whoever takes it at its stamp or one early
/// has commands wait for the end of a sweep.
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

    /// Tells the vehicle how fast to go from `at` on, until it is told something else. Returns when that takes
    /// effect: never before `at`, never before the command that came before this one.
    ///
    /// The first command other than zero takes the vehicle off its path. Until then zero is what it is told by
    /// whoever does not drive it, and does nothing.
    ///
    /// # Errors
    /// Where `at` is more than [`FARTHEST_AHEAD_S`] ahead of the last measurement. A vehicle that is driven is told
    /// zero instead: who cannot obey stops.
    pub fn drive(
        &mut self,
        at: RobotTime,
        velocity: CommandedVelocity,
    ) -> Result<RobotTime, DriveError> {
        if self.is_driven() || !velocity.or_zero().is_zero() {
            let effective = self.take_over(at);
            let applied = effective.map_or(CommandedVelocity::ZERO, |_effective| velocity);
            if let Some(drive_model) = self.run.motion.drive_model_mut() {
                drive_model.set_command(applied);
            }
            return effective;
        }
        Ok(at.max(self.frontier()))
    }

    /// Takes the vehicle off its path at `at`, or as soon after as [`SimulatedSource::drive`] would, and stops it:
    /// it is told zero. One that is driven already goes on as told to that time.
    ///
    /// # Errors
    /// As [`SimulatedSource::drive`].
    pub fn take_over(&mut self, at: RobotTime) -> Result<RobotTime, DriveError> {
        let since_start = at.since(START);
        let (at_s, now_s) = (since_start.as_secs_f64(), self.now_nanos as f64 / 1e9);
        if at_s > now_s + FARTHEST_AHEAD_S {
            return Err(DriveError::TooFarAhead { at_s, now_s });
        }
        self.frontier = self.frontier.max(step_from(since_start.as_nanos()));
        if !self.is_driven() {
            let bumper = Bumper::new(self.run.vehicle.body, self.run.scene.clone());
            let drive = self.run.vehicle.drive;
            self.run.motion.take_over(self.frontier, drive, bumper);
            self.continue_past_path();
        }
        self.run.motion.advance_to(self.frontier);
        Ok(self.frontier())
    }

    /// The time up to which measurements have looked or commands were given: what is told from now on takes effect
    /// then at the earliest.
    pub fn frontier(&self) -> RobotTime {
        START + RobotDuration::from_nanos(self.frontier * STEP_NANOS)
    }

    /// When all that the next measurement looks at has happened; `None` where there is none.
    pub fn next_due(&self) -> Option<RobotTime> {
        if let Some(ready) = self.ready.front() {
            return Some(ready.stamp);
        }
        let (nanos, place) = self.next_reading()?;
        let (_, sensor) = self.timetable.get(place)?;
        Some(START + RobotDuration::from_nanos(nanos + lookahead_nanos(sensor)))
    }

    /// How fast the vehicle truly goes in the plane at `at`, as far as it has got: not after
    /// [`SimulatedSource::frontier`].
    pub fn velocity(&self, at: RobotTime) -> PlanarVelocity {
        let known = at.min(self.frontier());
        self.run.motion.velocity(known.since(START).as_secs_f64())
    }

    /// Whether somebody has taken the vehicle off its path.
    pub fn is_driven(&self) -> bool {
        self.run.motion.drive_model().is_some()
    }

    /// What its bumper felt since it was taken off its path.
    pub fn collisions(&self) -> Collisions {
        let drive_model = self.run.motion.drive_model();
        drive_model.map_or_else(Collisions::default, DriveModel::collisions)
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

/// The first step that a reading at `nanos` does not look at any more; at the step itself nothing is told yet.
pub(super) fn observed_until(nanos: i64, sensor: &Sensor) -> i64 {
    step_from(nanos.saturating_add(lookahead_nanos(sensor)))
}

fn lookahead_nanos(sensor: &Sensor) -> i64 {
    libm::ceil(sensor.lookahead_s() * 1e9) as i64
}

/// The first step at or after a time.
fn step_from(nanos: i64) -> i64 {
    nanos.max(0).saturating_add(STEP_NANOS - 1) / STEP_NANOS
}
