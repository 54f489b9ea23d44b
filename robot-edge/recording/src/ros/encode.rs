//! Encodes measurements as ROS 2 messages (little-endian CDR) with their schemas.

use measurement::pose::Pose;
use measurement::scan::Scan;
use measurement::time::RobotTime;
use measurement::{GeodeticFix, ImuSample, Measurement, MeasurementData, Twist};

use super::MessageType;

/// The message of a measurement; `None` for a cloud, which is not recorded.
///
/// A scan's own pose is not part of a `LaserScan`: write it as transforms beside it.
pub fn encode(measurement: &Measurement) -> Option<(MessageType, Vec<u8>)> {
    let mut out = CdrWriter::new();
    let kind = match &measurement.data {
        MeasurementData::Scan { scan, .. } => {
            out.header(measurement);
            out.laser_scan(scan);
            MessageType::LaserScan
        }
        MeasurementData::Transform {
            child,
            parent_from_child,
            ..
        } => {
            out.u32(1);
            out.header(measurement);
            out.string(child);
            out.pose(parent_from_child);
            MessageType::TfMessage
        }
        MeasurementData::Odometry {
            child,
            odom_from_base,
        } => {
            out.header(measurement);
            out.string(child);
            out.pose(odom_from_base);
            // The pose's covariance, the twist and its covariance: not known.
            out.f64s(&[0.0; 36 + 6 + 36]);
            MessageType::Odometry
        }
        MeasurementData::Imu(sample) => {
            out.header(measurement);
            out.imu(sample);
            MessageType::Imu
        }
        MeasurementData::Joints(joints) => {
            out.header(measurement);
            out.joints(joints);
            MessageType::JointState
        }
        MeasurementData::Fix(fix) => {
            out.header(measurement);
            out.fix(fix);
            MessageType::NavSatFix
        }
        MeasurementData::Twist(twist) => {
            out.header(measurement);
            out.twist(twist);
            MessageType::TwistStamped
        }
        MeasurementData::PointCloud(_) => return None,
    };
    Some((kind, out.bytes))
}

/// A `geometry_msgs/Twist`, which has no stamp.
pub fn twist_message(twist: &Twist) -> Vec<u8> {
    let mut out = CdrWriter::new();
    out.twist(twist);
    out.bytes
}

/// Appends fields, each aligned to its size, counted from the end of the encapsulation header.
struct CdrWriter {
    bytes: Vec<u8>,
}

const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

impl CdrWriter {
    fn new() -> Self {
        Self {
            bytes: ENCAPSULATION.to_vec(),
        }
    }

    fn number<const SIZE: usize>(&mut self, bytes: [u8; SIZE]) {
        let fields = self.bytes.len() - ENCAPSULATION.len();
        self.bytes
            .resize(ENCAPSULATION.len() + fields.next_multiple_of(SIZE), 0);
        self.bytes.extend(bytes);
    }

    fn u32(&mut self, value: u32) {
        self.number(value.to_le_bytes());
    }

    fn f32s(&mut self, values: &[f32]) {
        for value in values {
            self.number(value.to_le_bytes());
        }
    }

    fn f64s(&mut self, values: &[f64]) {
        for value in values {
            self.number(value.to_le_bytes());
        }
    }

    fn length(&mut self, elements: usize) {
        self.u32(u32::try_from(elements).unwrap_or(u32::MAX));
    }

    fn string(&mut self, text: &str) {
        self.length(text.len() + 1);
        self.bytes.extend(text.as_bytes());
        self.bytes.push(0);
    }

    fn header(&mut self, measurement: &Measurement) {
        let (secs, nanos) = split(measurement.stamp);
        self.number(secs.to_le_bytes());
        self.u32(nanos);
        self.string(&measurement.frame);
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

    fn pose(&mut self, pose: &Pose) {
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
        self.f64s(&[0.0; 9]);
        self.number([0u8]); // covariance type: not known
    }

    fn twist(&mut self, twist: &Twist) {
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

const HEADER: (&str, &str) = (
    "std_msgs/Header",
    "builtin_interfaces/Time stamp\nstring frame_id\n",
);
const TIME: (&str, &str) = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n");
const VECTOR3: (&str, &str) = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n");
const POINT: (&str, &str) = ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n");
const QUATERNION: (&str, &str) = (
    "geometry_msgs/Quaternion",
    "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
);
const POSE: (&str, &str) = (
    "geometry_msgs/Pose",
    "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
);
const TWIST: (&str, &str) = (
    "geometry_msgs/Twist",
    "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
);

/// Name in ROS 2 form, definition, and the definitions it uses.
type Schema = (
    &'static str,
    &'static str,
    &'static [(&'static str, &'static str)],
);

/// The schema of a type that [`super::encode`] writes; `None` for those it does not.
const fn schema(kind: MessageType) -> Option<Schema> {
    Some(match kind {
        MessageType::LaserScan => (
            "sensor_msgs/msg/LaserScan",
            "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\n\
             float32 time_increment\nfloat32 scan_time\nfloat32 range_min\nfloat32 range_max\n\
             float32[] ranges\nfloat32[] intensities\n",
            &[HEADER, TIME],
        ),
        MessageType::TfMessage => (
            "tf2_msgs/msg/TFMessage",
            "geometry_msgs/TransformStamped[] transforms\n",
            &[
                (
                    "geometry_msgs/TransformStamped",
                    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
                ),
                (
                    "geometry_msgs/Transform",
                    "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
                ),
                HEADER,
                TIME,
                VECTOR3,
                QUATERNION,
            ],
        ),
        MessageType::Odometry => (
            "nav_msgs/msg/Odometry",
            "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n\
             geometry_msgs/TwistWithCovariance twist\n",
            &[
                (
                    "geometry_msgs/PoseWithCovariance",
                    "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
                ),
                (
                    "geometry_msgs/TwistWithCovariance",
                    "geometry_msgs/Twist twist\nfloat64[36] covariance\n",
                ),
                HEADER,
                TIME,
                POSE,
                POINT,
                QUATERNION,
                TWIST,
                VECTOR3,
            ],
        ),
        MessageType::Imu => (
            "sensor_msgs/msg/Imu",
            "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\n\
             float64[9] orientation_covariance\ngeometry_msgs/Vector3 angular_velocity\n\
             float64[9] angular_velocity_covariance\ngeometry_msgs/Vector3 linear_acceleration\n\
             float64[9] linear_acceleration_covariance\n",
            &[HEADER, TIME, QUATERNION, VECTOR3],
        ),
        MessageType::JointState => (
            "sensor_msgs/msg/JointState",
            "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n\
             float64[] effort\n",
            &[HEADER, TIME],
        ),
        MessageType::NavSatFix => (
            "sensor_msgs/msg/NavSatFix",
            "uint8 COVARIANCE_TYPE_UNKNOWN=0\nuint8 COVARIANCE_TYPE_APPROXIMATED=1\n\
             uint8 COVARIANCE_TYPE_DIAGONAL_KNOWN=2\nuint8 COVARIANCE_TYPE_KNOWN=3\n\
             std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\n\
             float64 longitude\nfloat64 altitude\nfloat64[9] position_covariance\n\
             uint8 position_covariance_type\n",
            &[
                HEADER,
                TIME,
                ("sensor_msgs/NavSatStatus", "int8 status\nuint16 service\n"),
            ],
        ),
        MessageType::TwistStamped => (
            "geometry_msgs/msg/TwistStamped",
            "std_msgs/Header header\ngeometry_msgs/Twist twist\n",
            &[HEADER, TIME, TWIST, VECTOR3],
        ),
        MessageType::MultiEchoLaserScan
        | MessageType::PointCloud2
        | MessageType::PoseStamped
        | MessageType::PoseWithCovarianceStamped
        | MessageType::Twist => return None,
    })
}

/// Name and text of the schema, as MCAP's `ros2msg` encoding wants it.
pub(crate) fn ros2msg(kind: MessageType) -> Option<(&'static str, String)> {
    let (name, definition, used) = schema(kind)?;
    let mut text = definition.to_owned();
    for (used_name, used_definition) in used {
        text.push_str(&"=".repeat(80));
        text.extend(["\nMSG: ", used_name, "\n", used_definition]);
    }
    Some((name, text))
}
