//! Settings of `[sensors.<name>]`.

use serde::Deserialize;

use mapping::octree::RangeSensorModel;
use mapping::registered_scan::SensorId;
use measurement::mount::Mount;

mod pose_sensors;
mod range_sensor;

pub use pose_sensors::{FixesAndAttitude, WheelsAndAttitude};
pub use range_sensor::{RangeSensorConfig, TiltConfig};

/// Name of the sensor that is the vehicle's main laser.
pub const MAIN_LASER: &str = "laser";

/// One sensor; `kind` says which.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum SensorConfig {
    /// A planar laser whose sweeps come as `sensor_msgs/LaserScan` or as a CARMEN laser line.
    LaserScan(RangeSensorConfig),
    /// A planar sonar whose sweeps come as `sensor_msgs/LaserScan`.
    Sonar(RangeSensorConfig),
    /// Encoders on the wheels of both sides, whose angles come as `sensor_msgs/JointState`.
    WheelEncoders(WheelEncodersConfig),
    /// An attitude sensor (AHRS), whose orientation comes as `sensor_msgs/Imu`.
    Imu(ImuConfig),
    /// A satellite receiver, whose positions come as `sensor_msgs/NavSatFix`.
    Gps(GpsConfig),
}

/// A sensor whose scans are mapped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeSensor<'a> {
    /// Its place among them, in the order of their names.
    pub id: SensorId,
    /// Its name.
    pub name: &'a str,
    /// Its settings.
    pub config: &'a RangeSensorConfig,
    /// What the octree must know of it.
    pub model: RangeSensorModel,
}

impl SensorConfig {
    /// Every value of `kind`.
    pub(super) const KINDS: &[&str] = &["laser_scan", "sonar", "wheel_encoders", "imu", "gps"];

    /// The value of `kind`.
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::LaserScan(_) => "laser_scan",
            Self::Sonar(_) => "sonar",
            Self::WheelEncoders(_) => "wheel_encoders",
            Self::Imu(_) => "imu",
            Self::Gps(_) => "gps",
        }
    }

    /// Topic or message name; where absent, the only stream whose type fits.
    pub fn topic(&self) -> Option<&str> {
        match self {
            Self::LaserScan(range) | Self::Sonar(range) => range.topic.as_deref(),
            Self::WheelEncoders(encoders) => encoders.topic.as_deref(),
            Self::Imu(imu) => imu.topic.as_deref(),
            Self::Gps(gps) => gps.topic.as_deref(),
        }
    }

    /// The settings of a range sensor; `None` of others.
    pub const fn range_sensor(&self) -> Option<&RangeSensorConfig> {
        match self {
            Self::LaserScan(range) | Self::Sonar(range) => Some(range),
            Self::WheelEncoders(_) | Self::Imu(_) | Self::Gps(_) => None,
        }
    }

    /// What the octree must know of a range sensor; `None` of others.
    pub fn range_model(&self) -> Option<RangeSensorModel> {
        let (range, of_kind) = match self {
            Self::LaserScan(range) => (range, RangeSensorModel::default()),
            Self::Sonar(range) => (range, SONAR),
            Self::WheelEncoders(_) | Self::Imu(_) | Self::Gps(_) => return None,
        };
        let min_neighbours = range.min_neighbours.and_then(|least| least.try_into().ok());
        Some(RangeSensorModel {
            p_hit: range.p_hit.unwrap_or(of_kind.p_hit),
            p_miss: range.p_miss.unwrap_or(of_kind.p_miss),
            min_neighbours: min_neighbours.unwrap_or(of_kind.min_neighbours),
            divergence_rad: range
                .divergence_mrad
                .map_or(of_kind.divergence_rad, |mrad| 1e-3 * mrad),
            has_metrics: of_kind.has_metrics,
        })
    }

    const fn wheel_encoders(&self) -> Option<&WheelEncodersConfig> {
        match self {
            Self::WheelEncoders(encoders) => Some(encoders),
            Self::LaserScan(_) | Self::Sonar(_) | Self::Imu(_) | Self::Gps(_) => None,
        }
    }

    const fn imu(&self) -> Option<&ImuConfig> {
        match self {
            Self::Imu(imu) => Some(imu),
            Self::LaserScan(_) | Self::Sonar(_) | Self::WheelEncoders(_) | Self::Gps(_) => None,
        }
    }

    const fn gps(&self) -> Option<&GpsConfig> {
        match self {
            Self::Gps(gps) => Some(gps),
            Self::LaserScan(_) | Self::Sonar(_) | Self::WheelEncoders(_) | Self::Imu(_) => None,
        }
    }
}

/// The sonar of \[HYB\]'s riverwatch (§4.3.1); water carries echoes and no vegetation, so its beams tell none.
const SONAR: RangeSensorModel = RangeSensorModel {
    p_hit: 0.7,
    p_miss: 0.45,
    min_neighbours: 1,
    divergence_rad: 0.0,
    has_metrics: false,
};

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

/// A satellite receiver.
#[derive(Clone, Debug, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GpsConfig {
    /// Topic; where absent, the only stream of fixes.
    pub topic: Option<String>,
    /// Added to the stamps to make up for latency, seconds.
    pub time_offset_s: f64,
    /// Where the antenna sits on the vehicle; only the place matters.
    pub mount: Mount,
}
