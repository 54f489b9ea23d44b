//! A third Zenoh session, apart from control and bulk: a client of the robot's own ROS 2 system.
//!
//! It listens, asks once more for what was said before it came (static transforms), and says velocities where it is
//! asked to. Callbacks of Zenoh only put
//! into bounded queues; whoever takes from them decodes.

mod inbox;
mod session;
mod twist;

pub use inbox::{Inbox, RosMessage};
pub use session::{RosEndpoint, RosLink, RosLinkError};
pub use twist::TwistPublisher;
