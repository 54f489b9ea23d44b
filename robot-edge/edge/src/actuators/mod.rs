//! The motors of a real vehicle.
//!
//! The teleop loop never owns the motors' port. A process of its own, the [`motor_guard`], does: it stops the motors if
//! no valid command arrives for [`motor_guard::WATCHDOG`].

pub mod report;

#[cfg(target_os = "linux")]
pub mod forward_pipe;
pub mod mavlink;
#[cfg(target_os = "linux")]
pub mod motor_link;

pub mod differential_drive;
pub mod published_velocity;
pub mod roboteq;

#[cfg(target_os = "linux")]
pub mod motor_guard;

pub use report::{Fault, Report};
pub use teleop::Velocity;

pub const MOTOR_GUARD_COMMAND: &str = "motor-guard";
