//! Measurements of sensors, recordings and simulated worlds in one form.

#![warn(missing_docs)]

pub mod byte_limit;
pub mod cloud;
pub mod delay_window;
pub mod drops;
pub mod mount;
pub mod pose;
pub mod scan;
pub mod time;

use std::sync::Arc;

use crate::cloud::{Cloud, CloudPoint};
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

/// One message of one sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurement {
    /// Stamp of the data; for a scan, the time of beam 0.
    pub stamp: RobotTime,
    /// Its stream in the source.
    pub stream: StreamId,
    /// Frame of the data; empty if the source names none.
    pub frame: FrameId,
    /// The data.
    pub data: MeasurementData,
}

impl Measurement {
    /// Whether it is a static transform, whose stamp (often of another clock) is meaningless.
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
        /// The pose that the log gives to this sweep (CARMEN).
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
    /// Pose of the vehicle: `nav_msgs/Odometry`, `geometry_msgs/PoseStamped`, CARMEN `ODOM`.
    Odometry {
        /// The vehicle's frame; `base_link` if the message names none.
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
    /// `sensor_msgs/PointCloud2`, and the packets of a three-dimensional lidar.
    Cloud(Cloud),
    /// `sensor_msgs/Range`.
    Range(RangeReading),
    /// `std_msgs/Bool`; of a bumper, whether it is pressed.
    Bool(bool),
}

impl MeasurementData {
    /// Whether it is a sweep of a range sensor: a scan or a cloud.
    pub const fn is_scan(&self) -> bool {
        matches!(self, Self::Scan { .. } | Self::Cloud(_))
    }

    /// Heap memory of the kinds that can be large.
    pub fn payload_bytes(&self) -> usize {
        match self {
            Self::Scan { scan, .. } => scan.ranges_m.len() * size_of::<f32>(),
            Self::Cloud(cloud) => cloud.points.len() * size_of::<CloudPoint>(),
            Self::Joints(joints) => joints
                .iter()
                .map(|(name, _)| name.len() + size_of::<(String, f64)>())
                .sum(),
            Self::Transform { .. }
            | Self::Odometry { .. }
            | Self::Imu(_)
            | Self::Fix(_)
            | Self::Twist(_)
            | Self::Range(_)
            | Self::Bool(_) => 0,
        }
    }
}

/// Poses in a CARMEN laser line for its own sweep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OwnPose {
    /// The laser's pose.
    pub odom_from_sensor: Pose,
    /// The robot's pose.
    pub odom_from_base: Pose,
}

/// Attitude and rates, frame of the sensor, SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// Attitude as a quaternion (x, y, z, w), if the sensor provides it.
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
    /// Standard deviation to the east and to the north, each, metres; `None` where the receiver does not say.
    pub sigma_m: Option<f64>,
}

/// Commanded or measured velocity, frame of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Twist {
    /// Along x, y, z, m/s.
    pub linear_mps: [f64; 3],
    /// About x, y, z, rad/s.
    pub angular_radps: [f64; 3],
}

/// One reading of an ultrasonic or infrared sensor: the nearest echo from anywhere in a cone about its x axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeReading {
    /// `sensor_msgs/Range`: 0 ultrasound, 1 infrared.
    pub radiation_type: u8,
    /// Full angle of the cone, radians, 0 to π.
    pub field_of_view_rad: f32,
    /// Smallest range that is a measurement, metres.
    pub range_min_m: f32,
    /// Ranges at or above this are no echo, metres; of a fixed-distance ranger equal to `range_min_m`.
    pub range_max_m: f32,
    /// Metres; +∞ no echo, −∞ nearer than `range_min_m` (REP 117).
    pub range_m: f32,
}

impl RangeReading {
    /// The arc on which the echo lies: a scan of equal ranges at most 1° apart.
    pub fn arc(&self) -> Scan {
        let steps = libm::ceilf(self.field_of_view_rad.to_degrees()).max(1.0);
        Scan {
            angle_min_rad: -0.5 * self.field_of_view_rad,
            angle_increment_rad: self.field_of_view_rad / steps,
            time_increment_s: 0.0,
            range_min_m: self.range_min_m,
            range_max_m: self.range_max_m,
            ranges_m: vec![self.range_m; steps as usize + 1],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn payload_is_what_grows_with_a_measurement() {
        let scan = Scan {
            ranges_m: vec![1.0; 100],
            ..Scan::default()
        };
        let ring = CloudPoint {
            position_m: [0.0; 3],
            after_s: 0.0,
            intensity: 0.0,
            ring: Some(0),
        };
        let cloud = Cloud {
            points: vec![ring; 64 * 2048],
            without_return: 0,
        };
        for (data, bytes) in [
            (MeasurementData::Bool(true), 0),
            (
                MeasurementData::Scan {
                    scan,
                    own_pose: None,
                },
                400,
            ),
            (MeasurementData::Joints(vec![("tilt".to_owned(), 0.0)]), 36),
            (MeasurementData::Cloud(cloud), 3 << 20),
        ] {
            assert_eq!(data.payload_bytes(), bytes);
        }
    }
}
