//! `ros2msg` schemas of the messages that are written: the type's definition, then those it uses.
//!
//! Definitions are those of ROS 2 (`common_interfaces`, `geometry2`), without comments: a schema is what a
//! reader without ROS parses the message by.

use super::MessageType;

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
