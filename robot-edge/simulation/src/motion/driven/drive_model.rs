//! Who drives a vehicle: what it is told, how it follows, and what it runs into.

use super::Moment;
use crate::bumper::Bumper;
use crate::dynamics::{Drive, Momentum};
use crate::motion::POSTURE_STEP_S;
use crate::motion::support::Support;
use crate::path::PlanarPose;
use crate::velocity::{CommandedVelocity, PlanarVelocity};

/// A drive that is told how fast to go, behind a bumper.
#[derive(Clone)]
pub struct DriveModel {
    drive: Drive,
    bumper: Bumper,
    command: CommandedVelocity,
    momentum: Momentum,
    collisions: Collisions,
}

/// What the bumper felt.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Collisions {
    /// How often the vehicle ran into something.
    pub count: u64,
    /// When it did so last, seconds since the beginning of the run.
    pub last_s: Option<f64>,
    /// Where it stands before what it ran into; `None` where it has gone away.
    pub contact: Option<PlanarPose>,
}

/// Who moves no farther than this, metres and radians, from where it ran into something is still there.
const AWAY_M: f64 = 0.02;
const AWAY_RAD: f64 = 0.03;

impl DriveModel {
    /// How many steps are kept.
    pub(super) const KEPT_STEPS: usize = 2_000;

    /// How long poses are kept, seconds.
    pub const KEPT_S: f64 = Self::KEPT_STEPS as f64 * POSTURE_STEP_S;

    /// A drive that is told to stand still, in a vehicle that goes at `velocity`.
    pub(in crate::motion) fn new(drive: Drive, bumper: Bumper, velocity: PlanarVelocity) -> Self {
        Self {
            drive,
            bumper,
            command: CommandedVelocity::ZERO,
            momentum: Momentum {
                velocity,
                ..Momentum::default()
            },
            collisions: Collisions::default(),
        }
    }

    /// From the next step on it is to go so; what is not finite asks it to stand still.
    pub fn set_command(&mut self, command: CommandedVelocity) {
        self.command = command.or_zero();
    }

    /// What its bumper felt so far.
    pub fn collisions(&self) -> Collisions {
        self.collisions
    }

    pub(super) fn velocity(&self) -> PlanarVelocity {
        self.momentum.velocity
    }

    /// What follows on `last` after a step that ends at `time_s`.
    ///
    /// Who would run into something does not move in that step and has lost all speed, so that it stands within a
    /// step's way of what stops it. Coming down on something, as the tail does behind a kerb, stops nobody.
    pub(super) fn step(&mut self, last: &Moment, support: &Support, time_s: f64) -> Moment {
        let before = self.momentum.velocity;
        self.momentum = self
            .drive
            .after(self.momentum, self.command, POSTURE_STEP_S);
        let mut mean = before.towards(self.momentum.velocity, 0.5);
        // Along the ground, not along the map.
        mean.forward_mps *= libm::cos(last.posture.pitch_rad);
        let at = mean.moved(last.at, POSTURE_STEP_S);
        if at == last.at {
            return Moment {
                velocity: self.momentum.velocity,
                ..*last
            };
        }
        let as_it_stood = |at| support.pose(at, time_s - POSTURE_STEP_S, |_| last.posture);
        if self
            .bumper
            .allows_motion(&as_it_stood(last.at), &as_it_stood(at), time_s)
        {
            self.collisions.move_to(at);
            return Moment {
                at,
                posture: support.posture(at, last.posture, time_s),
                velocity: self.momentum.velocity,
            };
        }
        self.collisions.record_contact(last.at, time_s);
        self.momentum.velocity = PlanarVelocity::default();
        Moment {
            velocity: self.momentum.velocity,
            ..*last
        }
    }
}

impl Collisions {
    /// Pushing on against the same thing is the same collision.
    fn record_contact(&mut self, at: PlanarPose, time_s: f64) {
        if self.contact.is_none() {
            self.count += 1;
            self.last_s = Some(time_s);
            self.contact = Some(at);
        }
    }

    fn move_to(&mut self, at: PlanarPose) {
        self.contact = self.contact.filter(|contact| {
            (at.position_m - contact.position_m).norm() <= AWAY_M
                && (at.yaw_rad - contact.yaw_rad).abs() <= AWAY_RAD
        });
    }
}
