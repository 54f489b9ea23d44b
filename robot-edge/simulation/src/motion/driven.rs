//! The motion of a vehicle that somebody drives, from one step to the next.

mod drive_model;

use std::collections::VecDeque;

pub use drive_model::{Collisions, DriveModel};

use super::POSTURE_STEP_S;
use super::support::Support;
use crate::chassis::Posture;
use crate::path::PlanarPose;
use crate::velocity::PlanarVelocity;

/// Where the vehicle was at each of the last steps.
///
/// Steps are numbered from the beginning of the run and lie [`POSTURE_STEP_S`] apart. What the vehicle is told
/// holds for whole steps, so that its motion depends on the steps at which it was told it and on nothing else.
#[derive(Clone)]
pub(super) struct Driven {
    begin: i64,
    /// The number of the last of the moments.
    newest: i64,
    /// At least one.
    moments: VecDeque<Moment>,
    drive_model: DriveModel,
}

/// A vehicle at a step.
#[derive(Clone, Copy)]
pub(super) struct Moment {
    pub(super) at: PlanarPose,
    pub(super) posture: Posture,
    pub(super) velocity: PlanarVelocity,
}

/// Times nearer to a step than this are at it, in steps: what rounding makes of the step's own time.
const AT_STEP: f64 = 1e-6;

impl Driven {
    pub(super) fn new(
        step: i64,
        at: PlanarPose,
        posture: Posture,
        drive_model: DriveModel,
    ) -> Self {
        let first = Moment {
            at,
            posture,
            velocity: drive_model.velocity(),
        };
        Self {
            begin: step,
            newest: step,
            moments: VecDeque::from([first]),
            drive_model,
        }
    }

    pub(super) fn drive_model(&self) -> &DriveModel {
        &self.drive_model
    }

    pub(super) fn drive_model_mut(&mut self) -> &mut DriveModel {
        &mut self.drive_model
    }

    /// At the very beginning both say the same pose; the path says it, whether somebody has looked before or not.
    pub(super) fn has_begun(&self, time_s: f64) -> bool {
        time_s / POSTURE_STEP_S > self.begin as f64 + AT_STEP
    }

    pub(super) fn advance_to(&mut self, step: i64, support: &Support) {
        while self.newest < step
            && let Some(&last) = self.moments.back()
        {
            self.newest += 1;
            let time_s = self.newest as f64 * POSTURE_STEP_S;
            let next = self.drive_model.step(&last, support, time_s);
            self.moments.push_back(next);
            if self.moments.len() > DriveModel::KEPT_STEPS {
                self.moments.pop_front();
            }
        }
    }

    pub(super) fn planar_pose(&self, time_s: f64) -> PlanarPose {
        let (from, to, share) = self.around(time_s);
        from.at.towards(&to.at, share)
    }

    pub(super) fn posture(&self, time_s: f64) -> Posture {
        let (from, to, share) = self.around(time_s);
        from.posture.towards(&to.posture, share)
    }

    pub(super) fn velocity(&self, time_s: f64) -> PlanarVelocity {
        let (from, to, share) = self.around(time_s);
        from.velocity.towards(to.velocity, share)
    }

    /// The moments before and after `time_s`, and where it is between them.
    fn around(&self, time_s: f64) -> (&Moment, &Moment, f64) {
        let steps = time_s / POSTURE_STEP_S - (self.newest + 1) as f64 + self.moments.len() as f64;
        let steps = steps.clamp(0.0, (self.moments.len() - 1) as f64);
        let nearest = libm::round(steps);
        let steps = if (steps - nearest).abs() < AT_STEP {
            nearest
        } else {
            steps
        };
        let before = libm::floor(steps);
        let share = steps - before;
        let from = &self.moments[before as usize];
        let to = self.moments.get(before as usize + 1).unwrap_or(from);
        (from, to, share)
    }
}
