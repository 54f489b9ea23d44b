//! The root configuration, and how it is put together.
//!
//! A vehicle is one TOML file; the presets are such files, embedded. Layers are merged, each
//! replacing only what it names: preset < file < `--set` < flags. A file starts from the preset that its
//! first key `preset = "NAME"` names, else from `generic2d`; in the latter case a file that has a `sensors`
//! table names *all* its sensors. Every layer is checked against the keys that exist before anything is
//! merged, so that an error has a position; nothing is ever repaired silently.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Deserialize;

pub mod advice;
pub mod error;
pub mod load;
pub mod motors;
pub mod overrides;
pub mod planner;
pub mod presets;
pub mod ros2_output;
pub mod sensors;

mod config_layer;
mod schema;
mod validate;

pub use error::{ConfigError, ConfigIssue, Origin, Problem};
pub use load::load;
pub use motors::{MotorsConfig, TwistConfig};
pub use overrides::Override;
pub use planner::PlannerConfig;
pub use ros2_output::Ros2OutputConfig;
pub use sensors::{
    FixesAndAttitude, GpsConfig, ImuConfig, RangeSensor, RangeSensorConfig, SensorConfig,
    TiltConfig, WheelEncodersConfig, WheelsAndAttitude, the_gps, the_imu,
};

use drivers::config::DeviceConfig;
use localization::LocalizationConfig;
use mapping::MappingConfig;
use mapping::octree::RangeSensorModel;
use mapping::registered_scan::SensorId;
use mapping::vehicle::VehicleConfig;
use teleop::TeleopConfig;

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    pub vehicle: VehicleConfig,
    /// Sensors by name; the main laser is named `laser`.
    pub sensors: BTreeMap<String, SensorConfig>,
    /// Devices that are read without a middleware, by name.
    pub devices: BTreeMap<String, DeviceConfig>,
    pub localization: LocalizationConfig,
    pub mapping: MappingConfig,
    pub streaming: StreamingConfig,
    pub link: LinkConfig,
    pub teleop: TeleopConfig,
    pub motors: MotorsConfig,
    pub ros2_output: Ros2OutputConfig,
    pub planner: Option<PlannerConfig>,
}

impl Config {
    /// The sensors whose scans are mapped, in the order of their names; a [`SensorId`] is an index into them.
    pub fn range_sensors(&self) -> Vec<RangeSensor<'_>> {
        let of_range = self.sensors.iter().filter_map(|(name, sensor)| {
            Some((name.as_str(), sensor.range_sensor()?, sensor.range_model()?))
        });
        let ids = (0..=u8::MAX).map(SensorId);
        let sensor = |(id, (name, config, model))| RangeSensor {
            id,
            name,
            config,
            model,
        };
        ids.zip(of_range).map(sensor).collect()
    }

    pub fn range_models(&self) -> Vec<RangeSensorModel> {
        self.range_sensors()
            .iter()
            .map(|sensor| sensor.model)
            .collect()
    }
}

impl Default for Config {
    /// One planar laser on a vehicle nothing else is known of: the preset `generic2d`.
    fn default() -> Self {
        let laser = SensorConfig::LaserScan(RangeSensorConfig::default());
        Self {
            vehicle: VehicleConfig::default(),
            sensors: BTreeMap::from([(sensors::MAIN_LASER.to_owned(), laser)]),
            devices: BTreeMap::new(),
            localization: LocalizationConfig::default(),
            mapping: MappingConfig::default(),
            streaming: StreamingConfig::default(),
            link: LinkConfig::default(),
            teleop: TeleopConfig::default(),
            motors: MotorsConfig::default(),
            ros2_output: Ros2OutputConfig::default(),
            planner: None,
        }
    }
}

/// `[streaming]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StreamingConfig {
    /// What tiles may take of the link, kilobits (10³ bits) per second.
    pub budget_kbps: u32,
    /// Most memory for the tile store, megabytes (10⁶ bytes); as much again while the vehicle is searched for in a saved map.
    pub tile_store_mb: u32,
    /// Time of the data between two publications of changed tiles, seconds.
    pub publish_period_s: f64,
}

impl Default for StreamingConfig {
    fn default() -> Self {
        Self {
            budget_kbps: 256,
            tile_store_mb: 256,
            publish_period_s: 1.0,
        }
    }
}

/// How the robot is reached. What the command line says comes first.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LinkConfig {
    /// Control endpoint to listen on, `quic/HOST:PORT` with keys, `tcp/HOST:PORT` without; bulk is the next port.
    /// Without one: this machine only, and a port that is taken is no reason not to map.
    pub listen: Option<String>,
    /// Control endpoint of a router to connect to.
    pub connect: Option<String>,
    /// The vehicle's folder of `robot-edge keys`.
    pub keys: Option<PathBuf>,
    /// Audit log: a file to which lines of JSON are added; without it, nothing is logged.
    pub audit_log: Option<PathBuf>,
}
