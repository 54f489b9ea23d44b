//! ROS messages: bytes to measurements and back.

pub mod messages;

use crate::measurement::{FrameId, MeasurementData};
use crate::robot_time::RobotTime;

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
