//! ROS messages: bytes to measurements and back.
//!
//! ROS 1 serialisation and ROS 2's CDR differ in padding, in byte order and in `Header`; one cursor reads
//! both, so that each message is described once.

mod decode;
mod encode;
pub mod middleware;
mod point_cloud;
pub mod published;

pub(crate) use decode::velodyne_packets;
pub use decode::{decode, decode_path};
pub use encode::encode;
pub(crate) use encode::ros2msg;

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
    /// The header's stamp; `None` if the message has none or it is zero.
    pub stamp: Option<RobotTime>,
    /// The header's frame without a leading slash; empty where there is none.
    pub frame: FrameId,
    /// The content.
    pub data: MeasurementData,
}

/// Why a message, or a part of it, cannot be decoded.
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
    /// A cloud whose fields do not fit its layout.
    #[error("the cloud is damaged: {0}")]
    BadCloud(&'static str),
    /// A cone or limits of range that cannot be.
    #[error(
        "its field of view is not from 0 to π, or its limits of range are not in order from 0 up"
    )]
    BadCone,
}

impl DecodeError {
    /// Under which reason it is counted.
    pub const fn reason(self) -> DropReason {
        match self {
            Self::BadPose => DropReason::BadPose,
            _ => DropReason::Undecodable,
        }
    }
}

/// A message type that becomes measurements.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MessageType {
    /// `sensor_msgs/LaserScan`.
    LaserScan,
    /// `sensor_msgs/MultiEchoLaserScan`: the first echo of each beam.
    MultiEchoLaserScan,
    /// `sensor_msgs/PointCloud2`.
    PointCloud2,
    /// `velodyne_msgs/VelodyneScan`: the packets of a turn.
    VelodyneScan,
    /// `sensor_msgs/Imu`.
    Imu,
    /// `sensor_msgs/JointState`.
    JointState,
    /// `sensor_msgs/NavSatFix`.
    NavSatFix,
    /// `nav_msgs/Odometry`.
    Odometry,
    /// `tf2_msgs/TFMessage`, and ROS 1's older `tf/tfMessage`.
    TfMessage,
    /// `geometry_msgs/PoseStamped`.
    PoseStamped,
    /// `geometry_msgs/PoseWithCovarianceStamped`.
    PoseWithCovarianceStamped,
    /// `geometry_msgs/Twist`.
    Twist,
    /// `geometry_msgs/TwistStamped`.
    TwistStamped,
    /// `sensor_msgs/Range`.
    Range,
    /// `std_msgs/Bool`.
    Bool,
}

impl MessageType {
    const NAMES: [(Self, &'static str); 15] = [
        (Self::LaserScan, "sensor_msgs/LaserScan"),
        (Self::MultiEchoLaserScan, "sensor_msgs/MultiEchoLaserScan"),
        (Self::PointCloud2, "sensor_msgs/PointCloud2"),
        (Self::VelodyneScan, "velodyne_msgs/VelodyneScan"),
        (Self::Imu, "sensor_msgs/Imu"),
        (Self::JointState, "sensor_msgs/JointState"),
        (Self::NavSatFix, "sensor_msgs/NavSatFix"),
        (Self::Odometry, "nav_msgs/Odometry"),
        (Self::TfMessage, "tf2_msgs/TFMessage"),
        (Self::PoseStamped, "geometry_msgs/PoseStamped"),
        (
            Self::PoseWithCovarianceStamped,
            "geometry_msgs/PoseWithCovarianceStamped",
        ),
        (Self::Twist, "geometry_msgs/Twist"),
        (Self::TwistStamped, "geometry_msgs/TwistStamped"),
        (Self::Range, "sensor_msgs/Range"),
        (Self::Bool, "std_msgs/Bool"),
    ];

    /// Whether its messages become clouds.
    pub const fn is_cloud(self) -> bool {
        matches!(self, Self::PointCloud2 | Self::VelodyneScan)
    }

    /// All of them, with their names in ROS 1 form (`sensor_msgs/Imu`).
    pub fn all() -> impl Iterator<Item = (Self, &'static str)> {
        Self::NAMES.into_iter()
    }

    /// From a type name in ROS 1 form (`sensor_msgs/Imu`) or ROS 2 form (`sensor_msgs/msg/Imu`).
    pub fn from_type_name(name: &str) -> Option<Self> {
        if name == "tf/tfMessage" {
            return Some(Self::TfMessage);
        }
        let name = ros1_type_name(name);
        Self::NAMES
            .iter()
            .find_map(|&(kind, known)| (known == name).then_some(kind))
    }
}

/// `sensor_msgs/msg/Imu` → `sensor_msgs/Imu`; ROS 1 names stay.
pub(crate) fn ros1_type_name(name: &str) -> String {
    name.replacen("/msg/", "/", 1)
}

#[cfg(test)]
mod tests;
