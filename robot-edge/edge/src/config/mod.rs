//! The root configuration, and how it is put together.
//!
//! A vehicle is one TOML file; the presets are such files, embedded. Layers lie over each other, each
//! replacing only what it names: preset < file < `--set` < flags. A file starts from the preset that its
//! first key `preset = "NAME"` names, else from `generic2d`; in the latter case a file that has a `sensors`
//! table names *all* its sensors. Every layer is checked against the keys that exist before anything is
//! merged, so that an error can say where it stands; nothing is ever repaired silently.

use std::collections::BTreeMap;

use serde::Deserialize;

pub mod error;
pub mod load;
pub mod motors;
pub mod overrides;
pub mod presets;
pub mod sensors;

mod checks;
mod layer;
mod schema;
mod suggestion;
mod validate;

pub use error::{ConfigError, ConfigIssue, Origin, Problem};
pub use load::load;
pub use motors::{MotorsConfig, TwistConfig};
pub use overrides::Override;
pub use sensors::{
    FixesAndAttitude, GpsConfig, ImuConfig, RangeSensor, RangeSensorConfig, SensorConfig,
    TiltConfig, WheelEncodersConfig, WheelsAndAttitude,
};

use crate::publishing::config::StreamingConfig;
use crate::server::config::LinkConfig;
use localization::LocalizationConfig;
use mapping::MappingConfig;
use mapping::octree::RangeSensorModel;
use mapping::registered_scan::SensorId;
use mapping::vehicle::VehicleConfig;
use teleop::TeleopConfig;

/// Everything that can be set, by module.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// The vehicle's body and limits.
    pub vehicle: VehicleConfig,
    /// Sensors by name; the main laser is named `laser`.
    pub sensors: BTreeMap<String, SensorConfig>,
    /// Poses.
    pub localization: LocalizationConfig,
    /// Map layers.
    pub mapping: MappingConfig,
    /// Tiles.
    pub streaming: StreamingConfig,
    /// Network.
    pub link: LinkConfig,
    /// Driving.
    pub teleop: TeleopConfig,
    /// What is driven.
    pub motors: MotorsConfig,
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

    /// What the octree must know of each of them, in the same order.
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
            localization: LocalizationConfig::default(),
            mapping: MappingConfig::default(),
            streaming: StreamingConfig::default(),
            link: LinkConfig::default(),
            teleop: TeleopConfig::default(),
            motors: MotorsConfig::default(),
        }
    }
}
