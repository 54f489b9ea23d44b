//! Live sensors of a ROS 2 system as a source: found first, then mapped as they come.

mod finding;
mod gathered;
mod lateness;
mod source;

pub(super) use finding::{Finding, find};
pub(super) use source::{Live, Wanted};
