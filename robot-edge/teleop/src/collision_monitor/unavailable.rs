//! What the guard lacked where it could not judge.

use std::fmt;
use std::time::Duration;

/// Why its word was [`CollisionMonitorOutput::Stale`](crate::GuardVerdict::Stale).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnavailableReason {
    /// The newest pose is so old, or there was none yet.
    PoseTooOld(Option<Duration>),
    /// A pose or speed, or what the motors were told, is no number.
    NotFinite,
    /// Every sensor's last sweep is too old, and `teleop.collision_monitor.unknown_space_policy` says to stop then.
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
