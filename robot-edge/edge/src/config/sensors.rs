//! Settings of `[sensors.<name>]`.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer};

use localization::beam_projection::ZeroRange;
use mapping::octree::RangeSensorModel;
use mapping::registered_scan::{ScanKind, SensorId};
use mapping::tilt_search::TiltSearchConfig;
use measurement::mount::Mount;

pub const MAIN_LASER: &str = "laser";

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
    /// An ultrasonic or infrared sensor, whose readings come as `sensor_msgs/Range`.
    #[serde(deserialize_with = "range_sensor_of::<UltrasonicConfig, _>")]
    Ultrasonic(RangeSensorConfig),
    /// A three-dimensional lidar, whose clouds come as `sensor_msgs/PointCloud2`.
    #[serde(deserialize_with = "range_sensor_of::<LidarConfig, _>")]
    Lidar(RangeSensorConfig),
    /// A bumper, whose state comes as `std_msgs/Bool`.
    #[serde(deserialize_with = "range_sensor_of::<BumperConfig, _>")]
    Bumper(RangeSensorConfig),
}

/// A sensor whose scans are mapped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeSensor<'a> {
    /// Its place among them, in the order of their names.
    pub id: SensorId,
    pub name: &'a str,
    pub config: &'a RangeSensorConfig,
    pub model: RangeSensorModel,
}

impl SensorConfig {
    pub(super) const KINDS: &[&str] = &[
        "laser_scan",
        "sonar",
        "wheel_encoders",
        "imu",
        "gps",
        "ultrasonic",
        "lidar",
        "bumper",
    ];

    pub const fn kind(&self) -> &'static str {
        match self {
            Self::LaserScan(_) => "laser_scan",
            Self::Sonar(_) => "sonar",
            Self::WheelEncoders(_) => "wheel_encoders",
            Self::Imu(_) => "imu",
            Self::Gps(_) => "gps",
            Self::Ultrasonic(_) => "ultrasonic",
            Self::Lidar(_) => "lidar",
            Self::Bumper(_) => "bumper",
        }
    }

    /// Topic or message name; where absent, the only stream whose type fits.
    pub fn topic(&self) -> Option<&str> {
        match self {
            Self::LaserScan(range)
            | Self::Sonar(range)
            | Self::Ultrasonic(range)
            | Self::Lidar(range)
            | Self::Bumper(range) => range.topic.as_deref(),
            Self::WheelEncoders(encoders) => encoders.topic.as_deref(),
            Self::Imu(imu) => imu.topic.as_deref(),
            Self::Gps(gps) => gps.topic.as_deref(),
        }
    }

    pub const fn range_sensor(&self) -> Option<&RangeSensorConfig> {
        match self {
            Self::LaserScan(range)
            | Self::Sonar(range)
            | Self::Ultrasonic(range)
            | Self::Lidar(range)
            | Self::Bumper(range) => Some(range),
            Self::WheelEncoders(_) | Self::Imu(_) | Self::Gps(_) => None,
        }
    }

    pub fn range_model(&self) -> Option<RangeSensorModel> {
        let (range, of_kind) = match self {
            Self::LaserScan(range) | Self::Lidar(range) => (range, RangeSensorModel::default()),
            Self::Sonar(range) => (range, SONAR),
            // Arcs do not reach the octree.
            Self::Ultrasonic(range) | Self::Bumper(range) => (range, BUMPER),
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
}

/// The sonar of \[HYB\]'s riverwatch (§4.3.1). Under water there is no vegetation, so its beams have no metrics.
const SONAR: RangeSensorModel = RangeSensorModel {
    p_hit: 0.7,
    p_miss: 0.45,
    min_neighbours: 1,
    divergence_rad: 0.0,
    has_metrics: false,
};

/// What a bumper touches is there; nothing beside it confirms it.
const BUMPER: RangeSensorModel = RangeSensorModel {
    p_hit: 0.95,
    p_miss: 0.49,
    min_neighbours: 0,
    divergence_rad: 0.0,
    has_metrics: false,
};

#[derive(Clone, Debug, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RangeSensorConfig {
    /// What its scans show, which is not a setting but follows from the kind of sensor.
    #[serde(skip)]
    pub scan_kind: ScanKind,
    /// Topic or message name; where absent, the only stream whose type fits that no other sensor names.
    pub topic: Option<String>,
    /// Replaces the message's smallest range, metres.
    pub range_min_m: Option<f64>,
    /// Replaces the message's greatest range, metres; ranges at or above it are misses.
    pub range_max_m: Option<f64>,
    /// Added to the stamps to make up for latency, seconds.
    pub time_offset_s: f64,
    pub zero_range: ZeroRange,
    /// Probability that a voxel which one scan hit is occupied; where absent, that of the kind.
    pub p_hit: Option<f64>,
    /// Probability that a voxel which one scan saw through is occupied; where absent, that of the kind.
    pub p_miss: Option<f64>,
    /// Of the beams beside a hit as many must have hit something close to it, or the octree does not take
    /// it; 0 takes every hit. Where absent, that of the kind.
    pub min_neighbours: Option<u32>,
    /// Full angle of a beam's cone, milliradians: in the octree a hit gives way to others whose spot of light was
    /// smaller. 0 takes beams for lines; where absent, that of the kind.
    pub divergence_mrad: Option<f64>,
    /// Of the points of a lidar in a cube of this side, metres, one is mapped; where absent, all are.
    #[serde(skip)]
    pub thin_m: Option<f64>,
    /// Where the sensor sits on the vehicle, where no transform of the source says so.
    pub mount: Mount,
    /// The servo that tilts it, if it is tilted and no transform of the source says how far.
    pub tilt: Option<TiltConfig>,
    /// Device, for people and for simulation.
    pub model: Option<String>,
    /// Beams in a sweep, for simulation.
    pub beams: Option<u32>,
    /// Angle from the first beam to the last, degrees, for simulation.
    pub field_of_view_deg: Option<f64>,
    /// Sweeps per second, for simulation.
    pub rate_hz: Option<f64>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LidarConfig {
    /// Where absent, the only topic of clouds.
    pub topic: Option<String>,
    /// Nearer points are dropped, metres.
    pub range_min_m: Option<f64>,
    /// Points at or beyond it are misses, metres.
    pub range_max_m: Option<f64>,
    /// Added to the stamps to make up for latency, seconds.
    pub time_offset_s: f64,
    /// See [`RangeSensorConfig`], as the next three.
    pub p_hit: Option<f64>,
    pub p_miss: Option<f64>,
    pub min_neighbours: Option<u32>,
    pub divergence_mrad: Option<f64>,
    /// Of the points in a cube of this side, metres, one is mapped; where absent, all are.
    pub thin_m: Option<f64>,
    /// Where the sensor sits on the vehicle, where no transform of the source says so.
    pub mount: Mount,
    /// Device, for people.
    pub model: Option<String>,
    /// Clouds per second.
    pub rate_hz: Option<f64>,
}

/// Each has its own topic: there are several of them, and a topic without messages yet must be known.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct UltrasonicConfig {
    pub topic: Option<String>,
    /// Replaces the message's smallest range, metres.
    pub range_min_m: Option<f64>,
    /// Replaces the message's greatest range, metres; ranges at or above it are no echo.
    pub range_max_m: Option<f64>,
    /// Added to the stamps to make up for latency, seconds.
    pub time_offset_s: f64,
    /// Where the sensor sits on the vehicle, where no transform of the source says so.
    pub mount: Mount,
    /// Readings per second.
    pub rate_hz: Option<f64>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BumperConfig {
    pub topic: Option<String>,
    /// Along its y axis, metres.
    pub width_m: f64,
    /// The middle of its face, at a height at which things stand in the way; its x axis points outwards.
    pub mount: Mount,
    /// Messages per second; where absent, they come only when the state changes, and silence is no fault.
    pub rate_hz: Option<f64>,
}

impl From<LidarConfig> for RangeSensorConfig {
    fn from(config: LidarConfig) -> Self {
        Self {
            scan_kind: ScanKind::Cloud,
            topic: config.topic,
            range_min_m: config.range_min_m,
            range_max_m: config.range_max_m,
            time_offset_s: config.time_offset_s,
            p_hit: config.p_hit,
            p_miss: config.p_miss,
            min_neighbours: config.min_neighbours,
            divergence_mrad: config.divergence_mrad,
            thin_m: config.thin_m,
            mount: config.mount,
            model: config.model,
            rate_hz: config.rate_hz,
            ..Self::default()
        }
    }
}

impl From<UltrasonicConfig> for RangeSensorConfig {
    fn from(config: UltrasonicConfig) -> Self {
        Self {
            scan_kind: ScanKind::Arc,
            topic: config.topic,
            range_min_m: config.range_min_m,
            range_max_m: config.range_max_m,
            time_offset_s: config.time_offset_s,
            mount: config.mount,
            rate_hz: config.rate_hz,
            ..Self::default()
        }
    }
}

impl From<BumperConfig> for RangeSensorConfig {
    fn from(config: BumperConfig) -> Self {
        Self {
            scan_kind: ScanKind::Contact {
                width_m: config.width_m as f32,
            },
            topic: config.topic,
            mount: config.mount,
            rate_hz: config.rate_hz,
            ..Self::default()
        }
    }
}

fn range_sensor_of<'de, T, D>(deserializer: D) -> Result<RangeSensorConfig, D::Error>
where
    T: Deserialize<'de> + Into<RangeSensorConfig>,
    D: Deserializer<'de>,
{
    T::deserialize(deserializer).map(Into::into)
}

/// A servo that turns a sensor about its own y axis, and whose angle comes as `sensor_msgs/JointState`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TiltConfig {
    /// Topic of the angles; where absent, the only stream that has the joint.
    pub topic: Option<String>,
    pub joint: String,
    /// The joint's angle times this is the sensor's: −1 where the joint counts nose up as positive.
    pub scale: f64,
    /// The sensor's angle where the joint is at zero, degrees, positive nose down; added to `mount.pitch_deg`.
    pub offset_deg: f64,
    /// Added to the stamps of the angles to make up for the encoder's latency, seconds.
    pub time_offset_s: f64,
    /// The servo is turned to where the obstacle map knows nothing ahead.
    pub search: Option<TiltSearchConfig>,
}

impl Default for TiltConfig {
    fn default() -> Self {
        Self {
            topic: None,
            joint: "laser_tilt_joint".to_owned(),
            scale: 1.0,
            offset_deg: 0.0,
            time_offset_s: 0.0,
            search: None,
        }
    }
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WheelEncodersConfig {
    /// Topic; where absent, the only stream that has both joints.
    pub topic: Option<String>,
    pub left_joint: String,
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

#[derive(Clone, Debug, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImuConfig {
    /// Topic; where absent, the only stream that gives an orientation.
    pub topic: Option<String>,
    /// Added to the stamps to make up for latency, seconds.
    pub time_offset_s: f64,
    pub mount: Mount,
}

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

type Named<'a, T> = (&'a str, &'a T);

/// The only wheel encoders and the only attitude sensor, from which poses are reckoned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelsAndAttitude<'a> {
    pub encoders: Named<'a, WheelEncodersConfig>,
    pub imu: Named<'a, ImuConfig>,
}

/// The only satellite receiver and the only attitude sensor, which give poses on Earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FixesAndAttitude<'a> {
    pub gps: Named<'a, GpsConfig>,
    pub imu: Named<'a, ImuConfig>,
}

impl<'a> WheelsAndAttitude<'a> {
    /// Fails with the numbers of encoders and attitude sensors, unless there is one of each.
    pub fn of(sensors: &'a BTreeMap<String, SensorConfig>) -> Result<Self, (usize, usize)> {
        let (encoders, imu) = with_attitude(sensors, |sensor| match sensor {
            SensorConfig::WheelEncoders(encoders) => Some(encoders),
            _ => None,
        })?;
        Ok(Self { encoders, imu })
    }
}

impl<'a> FixesAndAttitude<'a> {
    /// Fails with the numbers of receivers and attitude sensors, unless there is one of each.
    pub fn of(sensors: &'a BTreeMap<String, SensorConfig>) -> Result<Self, (usize, usize)> {
        let (gps, imu) = with_attitude(sensors, |sensor| match sensor {
            SensorConfig::Gps(gps) => Some(gps),
            _ => None,
        })?;
        Ok(Self { gps, imu })
    }
}

/// The only attitude sensor.
pub fn the_imu(sensors: &BTreeMap<String, SensorConfig>) -> Option<Named<'_, ImuConfig>> {
    the_only(sensors, |sensor| match sensor {
        SensorConfig::Imu(imu) => Some(imu),
        _ => None,
    })
}

/// The only satellite receiver.
pub fn the_gps(sensors: &BTreeMap<String, SensorConfig>) -> Option<Named<'_, GpsConfig>> {
    the_only(sensors, |sensor| match sensor {
        SensorConfig::Gps(gps) => Some(gps),
        _ => None,
    })
}

fn the_only<'a, T>(
    sensors: &'a BTreeMap<String, SensorConfig>,
    of_kind: impl Fn(&'a SensorConfig) -> Option<&'a T>,
) -> Option<Named<'a, T>> {
    let mut found = sensors
        .iter()
        .filter_map(|(name, sensor)| Some((name.as_str(), of_kind(sensor)?)));
    found.next().filter(|_| found.next().is_none())
}

fn with_attitude<'a, T>(
    sensors: &'a BTreeMap<String, SensorConfig>,
    of_kind: impl Fn(&'a SensorConfig) -> Option<&'a T>,
) -> Result<(Named<'a, T>, Named<'a, ImuConfig>), (usize, usize)> {
    let (mut others, mut imus) = (Vec::new(), Vec::new());
    for (name, sensor) in sensors {
        others.extend(of_kind(sensor).map(|config| (name.as_str(), config)));
        if let SensorConfig::Imu(imu) = sensor {
            imus.push((name.as_str(), imu));
        }
    }
    match (&others[..], &imus[..]) {
        (&[other], &[imu]) => Ok((other, imu)),
        _ => Err((others.len(), imus.len())),
    }
}
