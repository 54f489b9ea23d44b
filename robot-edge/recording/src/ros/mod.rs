//! ROS messages: bytes to measurements and back.
//!
//! ROS 1 serialisation and ROS 2's CDR differ in padding, in byte order and in `Header`; one cursor reads
//! both, so that each message is described once.

mod cursor;
mod decode;
mod encode;
mod message_type;
pub mod middleware;
mod point_cloud;
mod schema;

pub use decode::decode;
pub use encode::{encode, twist_message};
pub use message_type::MessageType;
pub(crate) use message_type::ros1_type_name;
pub(crate) use schema::ros2msg;

use measurement::drops::DropReason;
use measurement::time::RobotTime;
use measurement::{FrameId, MeasurementData};

/// How the bytes of a message are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// ROS 1 serialisation: little endian, unpadded, `Header` with a sequence number.
    Ros1,
    /// ROS 2 CDR (XCDR1) behind a 4-byte encapsulation header, either byte order.
    Cdr,
}

/// One measurement out of a message; a `TFMessage` gives several.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded {
    /// The header's stamp; `None` where the message has none or it is zero.
    pub stamp: Option<RobotTime>,
    /// The header's frame without a leading slash; empty where there is none.
    pub frame: FrameId,
    /// The content.
    pub data: MeasurementData,
}

/// Why (a part of) a message says nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// The message ends before its last field, or a sequence claims more elements than there are bytes.
    #[error("it is shorter than its type")]
    TooShort,
    /// Not plain CDR.
    #[error("its CDR encapsulation is {0:02x?}, not 00 00 or 00 01")]
    Encapsulation([u8; 2]),
    /// A string that is not UTF-8.
    #[error("a name in it is not text")]
    NotText,
    /// A pose that is not finite or whose quaternion is not a rotation.
    #[error("a pose in it is not finite, or its quaternion is not a rotation")]
    BadPose,
    /// A cloud without the order of its sensor.
    #[error(
        "the cloud is neither organised nor has a ring field, so its beams cannot be told apart"
    )]
    NotOrganised,
    /// A cloud whose fields are not where its layout says.
    #[error("the cloud's fields do not fit its points")]
    BadCloud,
}

impl DecodeError {
    /// Under which reason it is counted.
    pub const fn reason(self) -> DropReason {
        match self {
            Self::BadPose => DropReason::BadPose,
            Self::TooShort
            | Self::Encapsulation(_)
            | Self::NotText
            | Self::NotOrganised
            | Self::BadCloud => DropReason::Undecodable,
        }
    }
}

#[cfg(test)]
mod tests;
