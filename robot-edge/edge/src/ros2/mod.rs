//! A third Zenoh session: a client of the robot's ROS 2 system.
//!
//! It subscribes, requests earlier messages once (static transforms), and publishes velocities, maps, poses and goals. Zenoh's
//! callbacks only fill bounded queues; the receiver decodes, and threads of their own encode.

mod grid_state;
mod inbox;
mod node;
mod output;
mod planner;
mod session;
mod subscribers;
#[cfg(test)]
mod test_router;
mod twist;

pub use inbox::{Inbox, RosMessage};
pub use node::{RosEndpoint, RosLinkError, RosNode};
pub use output::{Drops, RosOutput, RosTarget};
pub use planner::PlannerSession;
pub use session::RosLink;
pub use twist::TwistPublisher;
