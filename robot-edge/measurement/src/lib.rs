//! What a sensor, a recording or a simulated world says, in one plain vocabulary.

#![warn(missing_docs)]

pub mod drops;
pub mod mount;
pub mod pose;
pub mod scan;
pub mod time;

use std::sync::Arc;

use crate::pose::Pose;
use crate::scan::Scan;
use crate::time::RobotTime;

/// Name of a coordinate frame, without a leading slash (`odom`, `base_link`, `laser`).
pub type FrameId = Arc<str>;

/// Index of a stream in its source's table of [`Stream`]s.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct StreamId(pub u16);

/// One stream of a source: a ROS topic, or a CARMEN message name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stream {
    /// Topic or message name (`/scan`, `FLASER`).
    pub name: String,
    /// Type as the source calls it, ROS types in their ROS 1 form (`sensor_msgs/LaserScan`).
    pub type_name: String,
}

/// One thing that was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurement {
    /// When, on the clock of the data; for a scan, the time of beam 0.
    pub stamp: RobotTime,
    /// Which stream of its source it came from.
    pub stream: StreamId,
    /// Frame in which the data is given; empty where the source names none.
    pub frame: FrameId,
    /// What was measured.
    pub data: MeasurementData,
}

impl Measurement {
    /// Whether it holds for all time, so that its stamp (often of another clock) says nothing of the present.
    pub const fn is_static_transform(&self) -> bool {
        matches!(
            self.data,
            MeasurementData::Transform {
                is_static: true,
                ..
            }
        )
    }
}

/// The kinds of measurement.
#[derive(Clone, Debug, PartialEq)]
pub enum MeasurementData {
    /// One sweep of a planar range sensor.
    Scan {
        /// The sweep, in [`Measurement::frame`].
        scan: Scan,
        /// The pose that the log itself gives to this sweep (CARMEN), which needs no other pose.
        own_pose: Option<OwnPose>,
    },
    /// One transform of a tf message.
    Transform {
        /// Frame of the points before the transform.
        child: FrameId,
        /// Moves points from `child` into [`Measurement::frame`].
        parent_from_child: Pose,
        /// Holds for all time (`/tf_static`).
        is_static: bool,
    },
    /// Where the vehicle says it is: `nav_msgs/Odometry`, `geometry_msgs/PoseStamped`, CARMEN `ODOM`.
    Odometry {
        /// The vehicle's frame; `base_link` where the message names none.
        child: FrameId,
        /// Moves points from `child` into [`Measurement::frame`].
        odom_from_base: Pose,
    },
    /// `sensor_msgs/Imu`.
    Imu(ImuSample),
    /// `sensor_msgs/JointState`: angle of each named joint, radians.
    Joints(Vec<(String, f64)>),
    /// `sensor_msgs/NavSatFix`.
    Fix(GeodeticFix),
    /// `geometry_msgs/Twist` and `TwistStamped`.
    Twist(Twist),
    /// `sensor_msgs/PointCloud2` that is organised or has a ring field.
    PointCloud(PointCloud),
}

/// The poses that a CARMEN laser line carries for its own sweep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OwnPose {
    /// Places beams: the laser's pose.
    pub odom_from_sensor: Pose,
    /// Places the vehicle: the robot's pose.
    pub odom_from_base: Pose,
}

/// Attitude and rates, frame of the sensor, SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// Attitude as a quaternion (x, y, z, w), absent where the sensor gives none.
    pub orientation_xyzw: Option<[f64; 4]>,
    /// Turn rates about x, y, z, rad/s.
    pub angular_velocity_radps: [f64; 3],
    /// Specific force along x, y, z, m/s².
    pub linear_acceleration_mps2: [f64; 3],
}

/// A position on WGS-84.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeodeticFix {
    /// Degrees, north positive.
    pub latitude_deg: f64,
    /// Degrees, east positive.
    pub longitude_deg: f64,
    /// Metres above the ellipsoid.
    pub altitude_m: f64,
    /// `sensor_msgs/NavSatStatus`: −1 no fix, 0 fix, 1 satellite-based, 2 ground-based augmentation.
    pub status: i8,
}

/// Commanded or measured velocity, frame of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Twist {
    /// Along x, y, z, m/s.
    pub linear_mps: [f64; 3],
    /// About x, y, z, rad/s.
    pub angular_radps: [f64; 3],
}

/// A cloud whose points keep the sensor's order.
#[derive(Clone, Debug, PartialEq)]
pub struct PointCloud {
    /// Points in row order, metres, not-a-number where there was no return.
    pub points_m: Vec<[f32; 3]>,
    /// Number of points in a row, where the cloud is organised.
    pub width: u32,
    /// Ring (row of the sensor) of each point, where the cloud has such a field.
    pub rings: Option<Vec<u16>>,
}
