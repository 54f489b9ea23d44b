//! What moves the vehicle: the teleop loop's only way to the motors.
//!
//! An [`Actuator`] is told a velocity at every tick and never waits. Everything that is kept from being obeyed too late
//! is below this seam: the motors are owned by a process of their own ([`motor_guard`]), which stops them when
//! nothing valid has come for [`motor_guard::WATCHDOG`].

pub mod report;

pub mod differential_drive;
pub mod published_velocity;
pub mod roboteq;

#[cfg(target_os = "linux")]
pub mod motor_guard;

pub use report::{Fault, Report};
pub use teleop::Velocity;

use measurement::time::Monotonic;

/// Name of the hidden command of this program that runs [`motor_guard::run`].
pub const MOTOR_GUARD_COMMAND: &str = "motor-guard";

/// One vehicle's motors.
#[derive(Debug)]
pub enum Actuator {
    /// There are none: nothing moves, whatever is asked for.
    None,
    /// Motors behind a guard.
    #[cfg(target_os = "linux")]
    Guarded(motor_guard::GuardedMotors),
}

impl Actuator {
    /// Asks for `velocity`, which was decided at `now`, and says what is known of the motors.
    ///
    /// Call it at every tick, also to stand: what is not repeated for [`motor_guard::WATCHDOG`] ends in a stop. It
    /// never blocks.
    ///
    /// # Errors
    /// The motors cannot be driven; they have been told to stand, or stop by themselves.
    pub fn apply(&mut self, velocity: Velocity, now: Monotonic) -> Result<Report, Fault> {
        match self {
            Self::None if !velocity.is_finite() => Err(Fault::NotANumber),
            Self::None => Ok(Report::unknown(now)),
            #[cfg(target_os = "linux")]
            Self::Guarded(motors) => motors.apply(velocity, now),
        }
    }
}
