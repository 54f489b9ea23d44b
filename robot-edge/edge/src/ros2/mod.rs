//! A third Zenoh session: a client of the robot's ROS 2 system.
//!
//! It subscribes, requests earlier messages once (static transforms), and publishes velocities. Zenoh's callbacks only
//! fill bounded queues; the receiver decodes.

mod inbox;
mod session;

pub use inbox::{Inbox, RosMessage};
pub use session::{RosEndpoint, RosLink, RosLinkError, TwistPublisher};
