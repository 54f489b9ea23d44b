//! Settings given on the command line.

use std::str::FromStr;

use serde::Deserialize;
use toml::de::ValueDeserializer;
use toml::{Table, Value};

use super::config_layer::{ConfigLayer, Origins, is_bare, join, quoted};
use super::error::Origin;

/// Parts of a dotted key; no key that exists has as many.
const MAX_KEY_PARTS: usize = 16;

#[derive(Clone, Debug, PartialEq)]
pub struct Override {
    parts: Vec<String>,
    value: Value,
    origin: Origin,
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct OverrideError(String);

impl Override {
    /// `--topic role=NAME`: the sensor `role` listens to `NAME`.
    pub fn topic(text: &str) -> Result<Self, OverrideError> {
        let (role, topic) = split(text, "laser=/scan")?;
        let key = join("sensors", role);
        Ok(Self {
            parts: key_parts(&join(&key, "topic"))?,
            value: Value::String(topic.to_owned()),
            origin: Origin::Topic,
        })
    }

    pub(super) fn layer(&self) -> ConfigLayer {
        let mut value = self.value.clone();
        for part in self.parts.iter().rev() {
            value = Value::Table(Table::from_iter([(part.clone(), value)]));
        }
        let table = match value {
            Value::Table(table) => table,
            Value::String(_)
            | Value::Integer(_)
            | Value::Float(_)
            | Value::Boolean(_)
            | Value::Datetime(_)
            | Value::Array(_) => Table::new(),
        };
        ConfigLayer {
            table,
            origins: Origins::One(self.origin.clone()),
        }
    }
}

impl FromStr for Override {
    type Err = OverrideError;

    /// `--set key.path=value`: the value is TOML; a bare word is a string.
    fn from_str(text: &str) -> Result<Self, OverrideError> {
        let (key, value) = split(text, "mapping.occupancy.cell_m=0.05")?;
        Ok(Self {
            parts: key_parts(key)?,
            value: parse_value(value)?,
            origin: Origin::Set,
        })
    }
}

fn split<'a>(text: &'a str, example: &str) -> Result<(&'a str, &'a str), OverrideError> {
    let (key, value) = text
        .split_once('=')
        .ok_or_else(|| OverrideError(format!("there is no `=`; write it like `{example}`")))?;
    Ok((key.trim(), value.trim()))
}

fn key_parts(key: &str) -> Result<Vec<String>, OverrideError> {
    let parts: Vec<String> = key
        .split('.')
        .take(MAX_KEY_PARTS + 1)
        .map(str::to_owned)
        .collect();
    if parts.len() > MAX_KEY_PARTS || !parts.iter().all(|part| is_bare(part)) {
        return Err(OverrideError(format!(
            "`{}` is not a key: keys are words of letters, digits, `_` and `-` joined by dots",
            quoted(key)
        )));
    }
    Ok(parts)
}

/// TOML, or text without quotes.
pub(crate) fn parse_value(text: &str) -> Result<Value, OverrideError> {
    let parsed = ValueDeserializer::parse(text).and_then(Value::deserialize);
    match parsed {
        Ok(value) => Ok(value),
        Err(error) if text.starts_with(['"', '\'', '[', '{']) => Err(OverrideError(format!(
            "`{}` is not a TOML value: {}",
            quoted(text),
            error.message()
        ))),
        Err(_not_toml) => Ok(Value::String(text.to_owned())),
    }
}
