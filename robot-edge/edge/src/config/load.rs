//! From a vehicle's name or file and the command line to a configuration.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use serde::Deserialize;
use toml::{Table, Value};

use super::Config;
use super::config_layer::{ConfigLayer, join, quoted};
use super::error::{ConfigError, ConfigIssue, Problem};
use super::overrides::Override;
use super::presets::{self, GENERIC, PRESET_KEY, Preset};
use super::schema::{Expected, Schema, SensorKinds};
use super::validate::{MAX_SENSORS, validate};

const MAX_FILE_BYTES: u64 = 1 << 20;
/// What a file without a preset must say of its vehicle: obstacles are judged by it.
const SIZE_KEYS: [&str; 3] = ["length_m", "width_m", "height_m"];

/// The configuration of `vehicle`, a preset's name or a file, with `overrides` in order of precedence.
pub fn load(vehicle: &str, overrides: &[Override]) -> Result<Config, ConfigError> {
    build(&layers(vehicle, overrides)?)
}

/// The configuration that a file of this `text` at `path` would be.
pub(crate) fn load_text(path: &Path, text: &str) -> Result<Config, ConfigError> {
    build(&text_layers(path, text)?)
}

/// The preset, the file and the overrides, in order of precedence.
pub(super) fn layers(
    vehicle: &str,
    overrides: &[Override],
) -> Result<Vec<ConfigLayer>, ConfigError> {
    let mut layers = match presets::find(vehicle) {
        Some(preset) => preset.layers()?,
        None => text_layers(Path::new(vehicle), &read(Path::new(vehicle))?)?,
    };
    layers.extend(overrides.iter().map(Override::layer));
    Ok(layers)
}

fn text_layers(path: &Path, text: &str) -> Result<Vec<ConfigLayer>, ConfigError> {
    let mut file = ConfigLayer::file(path, text)?;
    let named = file.table.remove(PRESET_KEY);
    let mut layers = named_preset(&file, named.as_ref())?.layers()?;
    // Without a name, of a single layer.
    let base = &mut layers[0];
    if let (None, Some(Value::Table(own))) = (&named, file.table.get("sensors"))
        && let Some(Value::Table(sensors)) = base.table.get_mut("sensors")
    {
        sensors.retain(|name, _| own.contains_key(name));
    }
    if named.is_none()
        && let Some(Value::Table(vehicle)) = base.table.get_mut("vehicle")
    {
        vehicle.retain(|key, _| !SIZE_KEYS.contains(&key));
    }
    layers.push(file);
    Ok(layers)
}

fn named_preset(file: &ConfigLayer, named: Option<&Value>) -> Result<Preset, ConfigError> {
    let problem = match named {
        None => return Ok(GENERIC),
        Some(Value::String(name)) => match presets::get(name) {
            Ok(preset) => return Ok(preset),
            Err(unknown) => Problem::Other(unknown.to_string()),
        },
        Some(other) => Problem::WrongType {
            expected: Expected::Text,
            found: quoted(&other.to_string()),
        },
    };
    Err(ConfigError::Issues(vec![ConfigIssue {
        origin: file.origin(PRESET_KEY),
        key: PRESET_KEY.to_owned(),
        problem,
    }]))
}

fn read(path: &Path) -> Result<String, ConfigError> {
    let io = |source| ConfigError::Io {
        path: path.to_owned(),
        source: recording::name_missing(path, source),
    };
    let not_a_configuration = |what: String| ConfigError::NotAConfiguration {
        path: path.to_owned(),
        what,
    };
    let file = match File::open(path) {
        // A lone word was meant as a preset's name; anything else as a file.
        Err(error)
            if error.kind() == std::io::ErrorKind::NotFound
                && path.components().count() <= 1
                && path.extension().is_none() =>
        {
            return Err(presets::unknown(&path.to_string_lossy()));
        }
        opened => opened.map_err(io)?,
    };
    let mut bytes = Vec::new();
    file.take(MAX_FILE_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(io)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(not_a_configuration(format!(
            "larger than {MAX_FILE_BYTES} bytes; a vehicle's configuration is a short TOML file"
        )));
    }
    String::from_utf8(bytes).map_err(|error| {
        let offset = error.utf8_error().valid_up_to();
        not_a_configuration(format!(
            "not UTF-8 at byte {offset}; a configuration is TOML text"
        ))
    })
}

fn build(layers: &[ConfigLayer]) -> Result<Config, ConfigError> {
    let other = |key: &str, message: String| {
        ConfigError::Issues(vec![ConfigIssue {
            origin: None,
            key: key.to_owned(),
            problem: Problem::Other(message),
        }])
    };
    let schema = Schema::of_config().map_err(|error| other("configuration", error.to_string()))?;
    let mut issues: Vec<ConfigIssue> = (0..layers.len())
        .flat_map(|index| layers[index].check(&schema, &kinds_for(layers, index)))
        .collect();

    let mut merged = Table::new();
    for layer in layers {
        drop_other_kinds(&mut merged, &layer.sensor_kinds());
        merge(&mut merged, &layer.table);
    }
    issues.extend(missing_sensors(&merged));
    if issues.is_empty() {
        issues.extend(missing_sizes(&merged));
    }
    if issues.is_empty() {
        let config = Config::deserialize(Value::Table(merged.clone()))
            .map_err(|error| other("configuration", error.message().to_owned()))?;
        issues = validate(&config, &merged);
        if issues.is_empty() {
            return Ok(config);
        }
    }
    for issue in &mut issues {
        let set_by = || {
            layers
                .iter()
                .rev()
                .find_map(|layer| layer.origin(&issue.key))
        };
        issue.origin = issue.origin.take().or_else(set_by);
    }
    issues.sort_by(|a, b| a.origin.cmp(&b.origin));
    Err(ConfigError::Issues(issues))
}

/// The kinds by which layer `index` is to be read: as it or the nearest layer under it names them, or else
/// the nearest over it.
fn kinds_for(layers: &[ConfigLayer], index: usize) -> SensorKinds<'_> {
    let mut kinds = SensorKinds::new();
    let (under, over) = layers.split_at(index + 1);
    for layer in over.iter().rev().chain(under) {
        kinds.extend(layer.sensor_kinds());
    }
    kinds
}

/// A sensor that becomes one of another kind has nothing left of what it was.
fn drop_other_kinds(merged: &mut Table, kinds: &SensorKinds<'_>) {
    if let Some(Value::Table(sensors)) = merged.get_mut("sensors") {
        sensors.retain(|name, sensor| {
            let was = sensor.get("kind").and_then(Value::as_str);
            let becomes = kinds.get(name).copied();
            was.is_none() || becomes.is_none() || was == becomes
        });
    }
}

/// Lays `over` over `under`: tables key by key, anything else replaces.
fn merge(under: &mut Table, over: &Table) {
    for (key, value) in over {
        match (under.get_mut(key), value) {
            (Some(Value::Table(under)), Value::Table(over)) => merge(under, over),
            _ => drop(under.insert(key.clone(), value.clone())),
        }
    }
}

fn missing_sensors(merged: &Table) -> Vec<ConfigIssue> {
    let Some(Value::Table(sensors)) = merged.get("sensors") else {
        return Vec::new();
    };
    let has_kind = |sensor: &Value| sensor.get("kind").is_some();
    let known: Vec<String> = sensors
        .iter()
        .filter(|(_, sensor)| has_kind(sensor))
        .take(MAX_SENSORS)
        .map(|(name, _)| name.clone())
        .collect();
    let unknown = sensors
        .iter()
        .filter(|(_, sensor)| sensor.is_table() && !has_kind(sensor));
    unknown
        .take(MAX_SENSORS)
        .map(|(name, _)| ConfigIssue {
            origin: None,
            key: join("sensors", name),
            problem: Problem::NoSuchSensor {
                known: known.clone(),
            },
        })
        .collect()
}

fn missing_sizes(merged: &Table) -> Vec<ConfigIssue> {
    let vehicle = merged.get("vehicle").and_then(Value::as_table);
    let is_missing = |key: &&str| vehicle.is_none_or(|vehicle| !vehicle.contains_key(*key));
    let missing = SIZE_KEYS.into_iter().filter(is_missing);
    missing
        .map(|key| ConfigIssue {
            origin: None,
            key: join("vehicle", key),
            problem: Problem::Other(
                "missing: measure the vehicle, in metres; or start from another by `preset = \"NAME\"`"
                    .to_owned(),
            ),
        })
        .collect()
}

#[cfg(test)]
mod tests;
