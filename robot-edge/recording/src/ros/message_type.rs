//! The message types that are understood.

/// A message type that becomes measurements.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MessageType {
    /// `sensor_msgs/LaserScan`.
    LaserScan,
    /// `sensor_msgs/MultiEchoLaserScan`: the first echo of each beam.
    MultiEchoLaserScan,
    /// `sensor_msgs/PointCloud2`, organised or with a ring field.
    PointCloud2,
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
}

impl MessageType {
    const NAMES: [(Self, &'static str); 12] = [
        (Self::LaserScan, "sensor_msgs/LaserScan"),
        (Self::MultiEchoLaserScan, "sensor_msgs/MultiEchoLaserScan"),
        (Self::PointCloud2, "sensor_msgs/PointCloud2"),
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
    ];

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
mod tests {
    use super::*;

    #[test]
    fn both_forms_of_a_name_are_one_type() {
        for name in ["sensor_msgs/LaserScan", "sensor_msgs/msg/LaserScan"] {
            assert_eq!(
                MessageType::from_type_name(name),
                Some(MessageType::LaserScan)
            );
        }
        assert_eq!(
            MessageType::from_type_name("tf/tfMessage"),
            Some(MessageType::TfMessage)
        );
        assert_eq!(MessageType::from_type_name("sick_scan/RadarScan"), None);
    }
}
