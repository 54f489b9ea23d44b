//! What the guard lacked where it could not judge.

use std::fmt;
use std::time::Duration;

/// Why its word was [`GuardVerdict::Stale`](crate::teleop::GuardVerdict::Stale).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lack {
    /// The newest pose is so old, or there was none yet.
    Pose(Option<Duration>),
    /// A pose or speed, or what the motors were told, is no number.
    Number,
    /// Every sensor's last sweep is too old, and `teleop.guard.on_blind` says to stop then.
    Sweeps,
}

impl fmt::Display for Lack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pose(Some(age)) => {
                write!(f, "its newest pose was {:.2} s old", age.as_secs_f64())
            }
            Self::Pose(None) => f.write_str("it had no pose yet"),
            Self::Number => f.write_str("a pose or speed was no number"),
            Self::Sweeps => f.write_str("no sensor had seen anything new in time"),
        }
    }
}
