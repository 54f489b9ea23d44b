//! How a vehicle follows the velocity that it is told.

mod thrusters;
mod wheels;

pub use thrusters::{Drag, TwinThrusters};
pub use wheels::{Axis, WheelDrive};

use crate::velocity::{CommandedVelocity, PlanarVelocity};

/// What drives a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// Wheels, each side by its own motor.
    Wheels(WheelDrive),
    /// A thruster on either side of a boat.
    Thrusters(TwinThrusters),
}

/// What goes on from one moment to the next.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Momentum {
    /// Of the vehicle.
    pub velocity: PlanarVelocity,
    /// Of the port and the starboard thruster over the boat's mass, m/s²; wheels have none.
    pub thrusts_mps2: [f64; 2],
}

impl Drive {
    /// What becomes of `momentum` while the vehicle is told `command` for `duration_s`, a few milliseconds.
    pub fn after(
        &self,
        momentum: Momentum,
        command: CommandedVelocity,
        duration_s: f64,
    ) -> Momentum {
        match self {
            Self::Wheels(wheels) => Momentum {
                velocity: wheels.after(momentum.velocity, command, duration_s),
                ..Momentum::default()
            },
            Self::Thrusters(thrusters) => thrusters.after(momentum, command, duration_s),
        }
    }
}

/// Share of the way to its target that a first-order lag goes in `duration_s`.
fn lag_share(lag_s: f64, duration_s: f64) -> f64 {
    -libm::expm1(-duration_s / lag_s)
}

#[cfg(test)]
mod tests;
