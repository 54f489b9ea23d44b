//! Encodes measurements as ROS 2 messages (little-endian CDR) with their schemas.

use measurement::pose::Pose;
use measurement::scan::Scan;
use measurement::time::RobotTime;
use measurement::{GeodeticFix, ImuSample, Measurement, MeasurementData, Twist};

use super::{MessageType, point_cloud};

/// The message of a measurement.
///
/// `type_name` is that of its stream: a pose of a stream of `PoseStamped` becomes one again. A scan's own pose is
/// not part of a `LaserScan`: write it as transforms beside it.
pub fn encode(measurement: &Measurement, type_name: &str) -> Option<(MessageType, Vec<u8>)> {
    let of_stream = MessageType::from_type_name(type_name);
    let mut out = CdrWriter::new();
    match measurement.data {
        MeasurementData::Transform { .. } => out.length(1),
        MeasurementData::Bool(value) => {
            out.number([u8::from(value)]);
            return Some((MessageType::Bool, out.bytes));
        }
        _ => {}
    }
    out.header(measurement.stamp, &measurement.frame);
    let kind = match &measurement.data {
        MeasurementData::Scan { scan, .. } => {
            out.laser_scan(scan);
            MessageType::LaserScan
        }
        MeasurementData::Transform {
            child,
            parent_from_child,
            ..
        } => {
            out.string(child);
            out.pose(parent_from_child);
            MessageType::TfMessage
        }
        MeasurementData::Odometry { odom_from_base, .. }
            if of_stream == Some(MessageType::PoseStamped) =>
        {
            out.pose(odom_from_base);
            MessageType::PoseStamped
        }
        MeasurementData::Odometry {
            child,
            odom_from_base,
        } => {
            out.string(child);
            out.pose(odom_from_base);
            // The pose's covariance, the twist and its covariance: not known.
            out.f64s(&[0.0; 36 + 6 + 36]);
            MessageType::Odometry
        }
        MeasurementData::Imu(sample) => {
            out.imu(sample);
            MessageType::Imu
        }
        MeasurementData::Joints(joints) => {
            out.joints(joints);
            MessageType::JointState
        }
        MeasurementData::Fix(fix) => {
            out.fix(fix);
            MessageType::NavSatFix
        }
        MeasurementData::Twist(twist) => {
            out.twist(twist);
            MessageType::TwistStamped
        }
        MeasurementData::Range(reading) => {
            out.number([reading.radiation_type]);
            out.f32s(&[
                reading.field_of_view_rad,
                reading.range_min_m,
                reading.range_max_m,
                reading.range_m,
            ]);
            MessageType::Range
        }
        MeasurementData::Cloud(cloud) => {
            point_cloud::write(cloud, &mut out);
            MessageType::PointCloud2
        }
        // Encoded above.
        MeasurementData::Bool(_) => return None,
    };
    Some((kind, out.bytes))
}

/// Appends fields, each aligned to its size, counted from the end of the encapsulation header.
pub(super) struct CdrWriter {
    pub(super) bytes: Vec<u8>,
}

const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

impl CdrWriter {
    pub(super) fn new() -> Self {
        Self {
            bytes: ENCAPSULATION.to_vec(),
        }
    }

    pub(super) fn number<const SIZE: usize>(&mut self, bytes: [u8; SIZE]) {
        let fields = self.bytes.len() - ENCAPSULATION.len();
        self.bytes
            .resize(ENCAPSULATION.len() + fields.next_multiple_of(SIZE), 0);
        self.bytes.extend(bytes);
    }

    pub(super) fn u32(&mut self, value: u32) {
        self.number(value.to_le_bytes());
    }

    pub(super) fn f32s(&mut self, values: &[f32]) {
        for value in values {
            self.number(value.to_le_bytes());
        }
    }

    pub(super) fn f64s(&mut self, values: &[f64]) {
        for value in values {
            self.number(value.to_le_bytes());
        }
    }

    /// A sequence.
    pub(super) fn i8s(&mut self, values: &[i8]) {
        self.length(values.len());
        self.bytes
            .extend(values.iter().map(|value| value.cast_unsigned()));
    }

    pub(super) fn length(&mut self, elements: usize) {
        self.u32(u32::try_from(elements).unwrap_or(u32::MAX));
    }

    pub(super) fn string(&mut self, text: &str) {
        self.length(text.len() + 1);
        self.bytes.extend(text.as_bytes());
        self.bytes.push(0);
    }

    pub(super) fn header(&mut self, stamp: RobotTime, frame: &str) {
        self.stamp(stamp);
        self.string(frame);
    }

    pub(super) fn stamp(&mut self, stamp: RobotTime) {
        let (secs, nanos) = split(stamp);
        self.number(secs.to_le_bytes());
        self.u32(nanos);
    }

    fn laser_scan(&mut self, scan: &Scan) {
        let steps = scan.ranges_m.len().saturating_sub(1) as f32;
        self.f32s(&[
            scan.angle_min_rad,
            scan.angle_min_rad + steps * scan.angle_increment_rad,
            scan.angle_increment_rad,
            scan.time_increment_s,
            0.0, // scan_time: not known
            scan.range_min_m,
            scan.range_max_m,
        ]);
        self.length(scan.ranges_m.len());
        self.f32s(&scan.ranges_m);
        self.length(0); // intensities
    }

    pub(super) fn pose(&mut self, pose: &Pose) {
        let q = pose.rotation.quaternion();
        self.f64s(pose.translation.vector.as_slice());
        self.f64s(&[q.i, q.j, q.k, q.w]);
    }

    fn imu(&mut self, sample: &ImuSample) {
        self.f64s(&sample.orientation_xyzw.unwrap_or([0.0, 0.0, 0.0, 1.0]));
        // −1 first: no orientation; all zero: covariance not known.
        self.f64s(&[if sample.orientation_xyzw.is_some() {
            0.0
        } else {
            -1.0
        }]);
        self.f64s(&[0.0; 8]);
        self.f64s(&sample.angular_velocity_radps);
        self.f64s(&[0.0; 9]);
        self.f64s(&sample.linear_acceleration_mps2);
        self.f64s(&[0.0; 9]);
    }

    fn joints(&mut self, joints: &[(String, f64)]) {
        self.length(joints.len());
        for (name, _) in joints {
            self.string(name);
        }
        self.length(joints.len());
        for (_, position) in joints {
            self.f64s(&[*position]);
        }
        self.length(0); // velocity
        self.length(0); // effort
    }

    fn fix(&mut self, fix: &GeodeticFix) {
        self.number(fix.status.to_le_bytes());
        self.number(0u16.to_le_bytes()); // service: not known
        self.f64s(&[fix.latitude_deg, fix.longitude_deg, fix.altitude_m]);
        let variance_m2 = fix.sigma_m.map_or(0.0, |sigma_m| sigma_m * sigma_m);
        let mut covariance_m2 = [0.0; 9];
        (covariance_m2[0], covariance_m2[4]) = (variance_m2, variance_m2);
        self.f64s(&covariance_m2);
        // Covariance type: approximated, or not known.
        self.number([u8::from(fix.sigma_m.is_some())]);
    }

    pub(super) fn twist(&mut self, twist: &Twist) {
        self.f64s(&twist.linear_mps);
        self.f64s(&twist.angular_radps);
    }
}

/// Seconds and nanoseconds of a ROS 2 stamp, whose seconds are 32 bits: saturates.
fn split(stamp: RobotTime) -> (i32, u32) {
    let nanos = stamp.as_nanos();
    let secs = nanos.div_euclid(1_000_000_000);
    (
        secs.clamp(i32::MIN.into(), i32::MAX.into()) as i32,
        nanos.rem_euclid(1_000_000_000) as u32,
    )
}

/// Name in ROS 2 form and definition, with the definitions it uses, as MCAP's `ros2msg` encoding wants them;
/// `None` for types that [`encode`] does not write.
pub(crate) const fn ros2msg(kind: MessageType) -> Option<(&'static str, &'static str)> {
    Some(match kind {
        MessageType::LaserScan => (
            "sensor_msgs/msg/LaserScan",
            include_str!("ros2msg/LaserScan.msg"),
        ),
        MessageType::PointCloud2 => (
            "sensor_msgs/msg/PointCloud2",
            include_str!("ros2msg/PointCloud2.msg"),
        ),
        MessageType::TfMessage => (
            "tf2_msgs/msg/TFMessage",
            include_str!("ros2msg/TfMessage.msg"),
        ),
        MessageType::Odometry => (
            "nav_msgs/msg/Odometry",
            include_str!("ros2msg/Odometry.msg"),
        ),
        MessageType::PoseStamped => (
            "geometry_msgs/msg/PoseStamped",
            include_str!("ros2msg/PoseStamped.msg"),
        ),
        MessageType::Imu => ("sensor_msgs/msg/Imu", include_str!("ros2msg/Imu.msg")),
        MessageType::JointState => (
            "sensor_msgs/msg/JointState",
            include_str!("ros2msg/JointState.msg"),
        ),
        MessageType::NavSatFix => (
            "sensor_msgs/msg/NavSatFix",
            include_str!("ros2msg/NavSatFix.msg"),
        ),
        MessageType::TwistStamped => (
            "geometry_msgs/msg/TwistStamped",
            include_str!("ros2msg/TwistStamped.msg"),
        ),
        MessageType::Range => ("sensor_msgs/msg/Range", include_str!("ros2msg/Range.msg")),
        MessageType::Bool => ("std_msgs/msg/Bool", "bool data\n"),
        _ => return None,
    })
}
