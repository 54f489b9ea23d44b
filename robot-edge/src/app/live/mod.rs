//! Live sensors of a ROS 2 system as a source: found first, then mapped as they come.

mod delay_estimator;
mod discovery;
mod probe_buffer;
mod source;

pub(super) use discovery::{TopicDiscovery, find};
pub(super) use source::{LiveSource, StreamSelection};
