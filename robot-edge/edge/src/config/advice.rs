//! Settings that are allowed and probably not meant: they are reported, never refused or repaired.

use toml::{Table, Value};

use super::config_layer::join;
use super::{Config, ConfigError, Override, load};

/// No range sensor of a ground robot or boat measures farther, metres.
const LONGEST_RANGE_M: f64 = 500.0;
/// No laser has its beams closer together, degrees. (A sensor with 25,200 beams a turn: 0.014°.)
const FINEST_STEP_DEG: f64 = 0.01;

/// Questions about numbers that no sensor has.
pub fn doubts(config: &Config) -> Vec<String> {
    let mut doubts = Vec::new();
    for (name, sensor) in &config.sensors {
        let Some(range) = sensor.range_sensor() else {
            continue;
        };
        if let Some(range_m) = range
            .range_max_m
            .filter(|range_m| *range_m > LONGEST_RANGE_M)
        {
            doubts.push(format!(
                "`sensors.{name}.range_max_m`: no sensor of a vehicle measures {range_m} m: are these millimetres?"
            ));
        }
        if let (Some(beams), Some(field_of_view_deg)) = (range.beams, range.field_of_view_deg) {
            let step_deg = field_of_view_deg / f64::from(beams.saturating_sub(1).max(1));
            if step_deg < FINEST_STEP_DEG {
                doubts.push(format!(
                    "`sensors.{name}.field_of_view_deg`: {beams} beams in {field_of_view_deg}° are {step_deg:.4}° apart, \
                     which no laser resolves: are these radians?"
                ));
            }
        }
    }
    doubts
}

/// Warns of [`doubts`], and returns [`idle_settings`] for the notes of a run, whose configuration is valid.
pub fn advise(
    vehicle: &str,
    overrides: &[Override],
    config: &Config,
    can_drive: bool,
) -> Vec<String> {
    for doubt in doubts(config) {
        tracing::warn!("{doubt}");
    }
    idle_settings(vehicle, overrides, config, can_drive).unwrap_or_default()
}

/// A switch, whether it is on, and the parts of the configuration that do nothing without it.
type Switch = (&'static str, fn(&Config) -> bool, &'static [&'static str]);

const SWITCHES: &[Switch] = &[
    (
        "mapping.occupancy.enabled",
        |config| config.mapping.occupancy.enabled,
        &["mapping.occupancy"],
    ),
    (
        "mapping.elevation.enabled",
        |config| config.mapping.elevation.enabled,
        &["mapping.elevation", "mapping.obstacle", "mapping.ground"],
    ),
    (
        "mapping.octree.enabled",
        |config| config.mapping.octree.enabled,
        &["mapping.octree"],
    ),
    (
        "mapping.octree.enabled",
        |config| config.mapping.octree.enabled || config.mapping.obstacle.least_width_m > 0.0,
        &["mapping.metrics"],
    ),
    (
        "mapping.cost.enabled",
        |config| config.mapping.cost.enabled,
        &["mapping.cost"],
    ),
    (
        "mapping.rigidity.enabled",
        |config| config.mapping.rigidity.enabled,
        &["mapping.rigidity"],
    ),
    (
        "mapping.shore.enabled",
        |config| config.mapping.shore.enabled,
        &["mapping.shore"],
    ),
];

/// Parts that need something to drive.
const DRIVING_PARTS: [&str; 2] = ["motors", "teleop"];

/// Says of the settings that `vehicle` (a file) or `overrides` change which ones do nothing in this run, and why.
pub fn idle_settings(
    vehicle: &str,
    overrides: &[Override],
    config: &Config,
    can_drive: bool,
) -> Result<Vec<String>, ConfigError> {
    let layers = load::layers(vehicle, overrides)?;
    let Some((base, own)) = layers.split_first() else {
        return Ok(Vec::new());
    };
    let mut changed = Vec::new();
    for layer in own {
        collect_changed("", &layer.table, Some(&base.table), &mut changed);
    }
    changed.sort();
    changed.dedup();
    let mut idle: Vec<(String, Vec<String>)> = Vec::new();
    for key in changed {
        let is_in = |parts: &[&str]| {
            let mut rests = parts.iter().filter_map(|part| key.strip_prefix(part));
            rests.any(|rest| rest.starts_with('.') && rest != ".enabled")
        };
        let off = SWITCHES
            .iter()
            .find(|(_, is_on, parts)| is_in(parts) && !is_on(config));
        let why = match off {
            Some((switch, ..)) => format!("{switch} is false"),
            None if !can_drive && is_in(&DRIVING_PARTS) => {
                "nothing is driven in this run".to_owned()
            }
            None => continue,
        };
        match idle.iter_mut().find(|(known, _)| *known == why) {
            Some((_, keys)) => keys.push(key),
            None => idle.push((why, vec![key])),
        }
    }
    let lines = idle
        .into_iter()
        .map(|(why, keys)| format!("without effect, as {why}: {}", keys.join(", ")));
    Ok(lines.collect())
}

/// Adds the keys of `table` whose values differ from those in `base`.
fn collect_changed(prefix: &str, table: &Table, base: Option<&Table>, changed: &mut Vec<String>) {
    for (key, value) in table {
        let path = join(prefix, key);
        let before = base.and_then(|base| base.get(key));
        match value {
            Value::Table(inner) => {
                collect_changed(&path, inner, before.and_then(Value::as_table), changed);
            }
            _ if before != Some(value) => changed.push(path),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::presets::PRESETS;

    fn sets(settings: &[&str]) -> Vec<Override> {
        settings.iter().map(|text| text.parse().unwrap()).collect()
    }

    #[test]
    fn numbers_beyond_physics_are_asked_about() {
        let doubts_of = |settings: &[&str]| doubts(&load("generic2d", &sets(settings)).unwrap());
        assert_eq!(
            doubts_of(&["sensors.laser.range_max_m=5600"]),
            [
                "`sensors.laser.range_max_m`: no sensor of a vehicle measures 5600 m: are these millimetres?"
            ]
        );
        assert_eq!(
            doubts_of(&[
                "sensors.laser.beams=481",
                "sensors.laser.field_of_view_deg=4"
            ]),
            [
                "`sensors.laser.field_of_view_deg`: 481 beams in 4° are 0.0083° apart, which no laser resolves: are these \
                 radians?"
            ]
        );
        for preset in PRESETS {
            assert_eq!(doubts(&load(preset.name, &[]).unwrap()), [""; 0]);
        }
    }

    #[test]
    fn settings_without_effect_are_named_with_the_reason() {
        let idle = |vehicle: &str, settings: &[&str], can_drive| {
            let overrides = sets(settings);
            let config = load(vehicle, &overrides).unwrap();
            idle_settings(vehicle, &overrides, &config, can_drive).unwrap()
        };
        let settings = [
            "mapping.cost.box_m=20",
            "mapping.ground.eta_deg=0.2",
            "mapping.ground.epsilon_deg=0.6",
            "mapping.occupancy.cell_m=0.2",
            "teleop.lease_s=1.0",
        ];
        let disabled = [
            "without effect, as mapping.cost.enabled is false: mapping.cost.box_m",
            "without effect, as mapping.elevation.enabled is false: mapping.ground.epsilon_deg, mapping.ground.eta_deg",
        ];
        assert_eq!(idle("generic2d", &settings, true), disabled);
        let driving = "without effect, as nothing is driven in this run: teleop.lease_s";
        let replayed = idle("generic2d", &settings, false);
        assert_eq!(replayed, [&disabled[..], &[driving]].concat());
        // What the preset says already, and what switches a layer, is nothing to report.
        let unchanged = ["mapping.cost.box_m=40.0", "mapping.occupancy.enabled=true"];
        assert_eq!(idle("generic2d", &unchanged, false), [""; 0]);
    }
}
