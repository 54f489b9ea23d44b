//! Vehicles that come with the program.

use toml::Value;

use super::config_layer::ConfigLayer;
use super::error::{ConfigError, suggest};

/// Key that names the preset to start from.
pub(super) const PRESET_KEY: &str = "preset";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preset {
    pub name: &'static str,
    pub text: &'static str,
}

impl Preset {
    /// The first line of the file: what the vehicle is.
    pub fn title(&self) -> &'static str {
        let line = self.text.lines().next().unwrap_or_default();
        line.trim_start_matches(['#', ' '])
    }

    /// Whether it judges as a document says, for comparison with the vehicle's own preset.
    pub fn is_document(&self) -> bool {
        self.name.ends_with("-document")
    }

    /// Its own layer, after those of the preset that it starts from.
    pub(super) fn layers(&self) -> Result<Vec<ConfigLayer>, ConfigError> {
        let mut layer = ConfigLayer::preset(self.name, self.text)?;
        let mut layers = match layer.table.remove(PRESET_KEY) {
            Some(Value::String(base)) => get(&base)?.layers()?,
            _ => Vec::new(),
        };
        layers.push(layer);
        Ok(layers)
    }
}

macro_rules! preset {
    ($name:literal) => {
        Preset {
            name: $name,
            text: include_str!(concat!("../../../vehicles/", $name, ".toml")),
        }
    };
}

pub const GENERIC: Preset = preset!("generic2d");

pub const PRESETS: &[Preset] = &[
    GENERIC,
    preset!("generic3d"),
    preset!("holos"),
    preset!("holos-document"),
    preset!("holos-tilt"),
    preset!("introbot"),
    preset!("introbot-document"),
    preset!("lidar16"),
    preset!("lidar64"),
    preset!("pioneer"),
    preset!("pioneer-document"),
    preset!("riverwatch"),
    preset!("riverwatch-document"),
    preset!("riverwatch-lidar"),
];

pub(super) fn find(name: &str) -> Option<Preset> {
    PRESETS.iter().find(|preset| preset.name == name).copied()
}

/// The preset called `name`.
pub fn get(name: &str) -> Result<Preset, ConfigError> {
    find(name).ok_or_else(|| unknown(name))
}

pub(super) fn unknown(name: &str) -> ConfigError {
    ConfigError::UnknownVehicle {
        name: super::config_layer::quoted(name),
        suggestion: suggest(name, PRESETS.iter().map(|preset| preset.name))
            .filter(|hint| hint.is_close),
        presets: PRESETS
            .iter()
            .filter(|preset| !preset.is_document())
            .map(|preset| preset.name)
            .collect(),
    }
}

#[cfg(all(test, feature = "simulation"))]
mod tests {
    #![expect(clippy::float_cmp, reason = "these values are exact")]

    use simulation::dynamics::Drive;
    use simulation::vehicle::SimulatedVehicle;

    #[test]
    fn a_vehicle_is_as_large_and_as_fast_as_its_preset_says() {
        for name in SimulatedVehicle::NAMES {
            let preset = crate::config::load(name, &[]).unwrap().vehicle;
            let SimulatedVehicle { body, drive, .. } = SimulatedVehicle::preset(name).unwrap();
            let [speed_mps, turn_rate_radps] = match drive {
                Drive::Wheels(wheels) => [wheels.linear.max_speed, wheels.angular.max_speed],
                Drive::Thrusters(boat) => [boat.max_speed_mps, boat.max_turn_rate_radps],
            };
            assert_eq!(
                [body.length_m, body.width_m, speed_mps, turn_rate_radps],
                [
                    preset.length_m,
                    preset.width_m,
                    preset.max_speed_mps,
                    preset.max_turn_rate_radps
                ],
                "{name}"
            );
        }
    }
}
