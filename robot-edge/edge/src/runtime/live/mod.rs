//! Live sensors of a ROS 2 system as a source.

mod delay_estimator;
mod discovery;
mod source;

pub(super) use discovery::{TopicDiscovery, find};
pub(super) use source::{LiveSource, StreamSelection};
