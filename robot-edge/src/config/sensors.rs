//! Settings of `[sensors.<name>]`.

use std::collections::BTreeMap;

use nalgebra::{Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;

use crate::localization::beam_range::ZeroRange;
use crate::pose::Pose;

/// Name of the sensor that is the vehicle's main laser.
pub const MAIN_LASER: &str = "laser";

/// One sensor; `kind` says which.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum SensorConfig {
    /// A planar laser whose sweeps come as `sensor_msgs/LaserScan` or as a CARMEN laser line.
    LaserScan(LaserScanConfig),
    /// Encoders on the wheels of both sides, whose angles come as `sensor_msgs/JointState`.
    WheelEncoders(WheelEncodersConfig),
    /// An attitude sensor (AHRS), whose orientation comes as `sensor_msgs/Imu`.
    Imu(ImuConfig),
}

impl SensorConfig {
    /// Every value of `kind`.
    pub(super) const KINDS: &[&str] = &["laser_scan", "wheel_encoders", "imu"];

    /// The value of `kind`.
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::LaserScan(_) => "laser_scan",
            Self::WheelEncoders(_) => "wheel_encoders",
            Self::Imu(_) => "imu",
        }
    }

    /// Topic or message name; where absent, the only stream whose type fits.
    pub fn topic(&self) -> Option<&str> {
        match self {
            Self::LaserScan(laser) => laser.topic.as_deref(),
            Self::WheelEncoders(encoders) => encoders.topic.as_deref(),
            Self::Imu(imu) => imu.topic.as_deref(),
        }
    }
}

/// A planar laser.
#[derive(Clone, Debug, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LaserScanConfig {
    /// Topic or message name; where absent, the only stream whose type fits.
    pub topic: Option<String>,
    /// Replaces the message's smallest range, metres.
    pub range_min_m: Option<f64>,
    /// Replaces the message's greatest range, metres; ranges at or above it are misses.
    pub range_max_m: Option<f64>,
    /// Added to the stamps to make up for latency, seconds.
    pub time_offset_s: f64,
    /// What a range of zero means.
    pub zero: ZeroRange,
    /// Where the sensor sits on the vehicle, where no transform of the source says so.
    pub mount: Mount,
    /// Device, for people and for simulation.
    pub model: Option<String>,
    /// Beams in a sweep, for simulation.
    pub beams: Option<u32>,
    /// Angle from the first beam to the last, degrees, for simulation.
    pub field_of_view_deg: Option<f64>,
    /// Sweeps per second, for simulation.
    pub rate_hz: Option<f64>,
}

/// Encoders on a wheel of either side.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WheelEncodersConfig {
    /// Topic; where absent, the only stream that has both joints.
    pub topic: Option<String>,
    /// Name of the left wheel's joint.
    pub left_joint: String,
    /// Name of the right wheel's joint.
    pub right_joint: String,
    /// What the joints' angles (radians, positive forward) are multiplied with to give metres.
    pub wheel_radius_m: f64,
    /// Added to the stamps to make up for latency, seconds.
    pub time_offset_s: f64,
}

impl Default for WheelEncodersConfig {
    fn default() -> Self {
        Self {
            topic: None,
            left_joint: "left_wheel_joint".to_owned(),
            right_joint: "right_wheel_joint".to_owned(),
            wheel_radius_m: 0.125,
            time_offset_s: 0.0,
        }
    }
}

/// An attitude sensor.
#[derive(Clone, Debug, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImuConfig {
    /// Topic; where absent, the only stream that gives an orientation.
    pub topic: Option<String>,
    /// Added to the stamps to make up for latency, seconds.
    pub time_offset_s: f64,
    /// How the sensor sits on the vehicle.
    pub mount: Mount,
}

/// What poses are reckoned from where nothing else says them, each with the name of its sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelsAndAttitude<'a> {
    /// The only encoders.
    pub encoders: (&'a str, &'a WheelEncodersConfig),
    /// The only attitude sensor.
    pub imu: (&'a str, &'a ImuConfig),
}

impl<'a> WheelsAndAttitude<'a> {
    /// Those of `sensors`.
    ///
    /// # Errors
    /// Unless there is exactly one of each: how many encoders and attitude sensors there are.
    pub fn of(sensors: &'a BTreeMap<String, SensorConfig>) -> Result<Self, (usize, usize)> {
        let (mut encoders, mut imus) = (Vec::new(), Vec::new());
        for (name, sensor) in sensors {
            match sensor {
                SensorConfig::LaserScan(_) => {}
                SensorConfig::WheelEncoders(config) => encoders.push((name.as_str(), config)),
                SensorConfig::Imu(config) => imus.push((name.as_str(), config)),
            }
        }
        match (&encoders[..], &imus[..]) {
            ([encoders], [imu]) => Ok(Self {
                encoders: *encoders,
                imu: *imu,
            }),
            (encoders, imus) => Err((encoders.len(), imus.len())),
        }
    }
}

/// Pose of a sensor in the base frame (x forward, y left, z up; REP-103).
#[derive(Clone, Copy, Debug, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Mount {
    /// Forward, metres.
    pub x_m: f64,
    /// Left, metres.
    pub y_m: f64,
    /// Up, metres.
    pub z_m: f64,
    /// About x, degrees: positive is right side down.
    pub roll_deg: f64,
    /// About y, degrees: positive is nose down.
    pub pitch_deg: f64,
    /// About z, degrees: positive is to the left.
    pub yaw_deg: f64,
}

impl Mount {
    /// Moves points from the sensor's frame into the base frame: roll, then pitch, then yaw, all about the
    /// base's axes, as URDF writes them.
    pub fn base_from_sensor(&self) -> Pose {
        let about = |axis: usize, angle_deg: f64| {
            let half_rad = 0.5 * angle_deg.to_radians();
            let mut imaginary = [0.0; 3];
            imaginary[axis] = libm::sin(half_rad);
            let [i, j, k] = imaginary;
            UnitQuaternion::new_normalize(nalgebra::Quaternion::new(libm::cos(half_rad), i, j, k))
        };
        Pose::from_parts(
            Translation3::from(Vector3::new(self.x_m, self.y_m, self.z_m)),
            about(2, self.yaw_deg) * about(1, self.pitch_deg) * about(0, self.roll_deg),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn a_mount_turns_roll_then_pitch_then_yaw() {
        let mount = Mount {
            x_m: 1.0,
            roll_deg: 90.0,
            yaw_deg: 90.0,
            ..Mount::default()
        };
        // Sensor's y goes up by the roll and stays there; sensor's x goes left by the yaw.
        let base_from_sensor = mount.base_from_sensor();
        let up = base_from_sensor * Point3::new(0.0, 1.0, 0.0);
        let left = base_from_sensor * Point3::new(1.0, 0.0, 0.0);
        assert!((up - Point3::new(1.0, 0.0, 1.0)).norm() < 1e-12, "{up}");
        assert!((left - Point3::new(1.0, 1.0, 0.0)).norm() < 1e-12, "{left}");
    }

    #[test]
    fn positive_pitch_is_nose_down() {
        let mount = Mount {
            pitch_deg: 7.5,
            ..Mount::default()
        };
        let ahead = mount.base_from_sensor() * Point3::new(8.274, 0.0, 0.0);
        assert!((ahead.z + 1.08).abs() < 1e-3, "{ahead}");
    }
}
