//! Vehicles that come with the program.

use super::config_layer::ConfigLayer;
use super::error::{ConfigError, suggest};

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

    pub(super) fn layer(&self) -> Result<ConfigLayer, ConfigError> {
        ConfigLayer::preset(self.name, self.text)
    }
}

pub const GENERIC: Preset = Preset {
    name: "generic2d",
    text: include_str!("../../../vehicles/generic2d.toml"),
};

pub const PRESETS: &[Preset] = &[
    GENERIC,
    Preset {
        name: "holos",
        text: include_str!("../../../vehicles/holos.toml"),
    },
    Preset {
        name: "introbot",
        text: include_str!("../../../vehicles/introbot.toml"),
    },
    Preset {
        name: "pioneer",
        text: include_str!("../../../vehicles/pioneer.toml"),
    },
    Preset {
        name: "riverwatch",
        text: include_str!("../../../vehicles/riverwatch.toml"),
    },
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
        presets: PRESETS.iter().map(|preset| preset.name).collect(),
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
