//! `setup` and its options.

use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;
use drivers::config::DeviceConfig;
use toml::{Table, Value};

use crate::config::overrides::parse_value;
use crate::config::presets::{self, Preset};

pub(super) const QUESTIONS: &str = "\
What no option says is asked for. Where standard input is no terminal, nothing is asked: --vehicle and --listen or
--connect must be there, --size with the vehicle generic2d, and --mount for each laser and sonar that the vehicle does
not come with.

A device is read without a middleware. Its measurements are those of the sensor of its name, and a sensor that the
vehicle does not come with is added: name the device as the sensor (`robot-edge vehicles NAME` prints them). The kinds
and their settings are in the page on devices.";

/// `setup`.
#[derive(Clone, Debug, Default, PartialEq, Args)]
pub struct Setup {
    /// The vehicle that it is, or is most like: a preset (see `robot-edge vehicles`)
    #[arg(long, value_name = "NAME", value_parser = preset)]
    pub vehicle: Option<Preset>,
    /// Its length, width and height, metres [default: as the preset]
    #[arg(long, value_name = "L,W,H", value_parser = str::parse::<Size>)]
    pub size: Option<Size>,
    /// A device: `laser=sick_cola,tcp=192.168.0.1:2111`; may be repeated
    #[arg(long = "device", value_name = "NAME=KIND,KEY=VALUE", value_parser = str::parse::<NamedDevice>)]
    pub devices: Vec<NamedDevice>,
    /// Place of a sensor in the base frame (x forward, y left, z up), metres, and how it is turned, degrees; may be repeated
    /// [default: as the preset]
    #[arg(long = "mount", value_name = "SENSOR=X,Y,Z[,ROLL,PITCH,YAW]", value_parser = str::parse::<NamedMount>)]
    pub mounts: Vec<NamedMount>,
    /// Listen here for consoles: `quic/HOST:PORT`, tiles at the next port
    #[arg(long, value_name = "ENDPOINT")]
    pub listen: Option<String>,
    /// Connect to a Zenoh router here
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Option<String>,
    /// Where its keys are, or will be [default: /etc/foreshore/keys, but none for tcp on this machine alone]
    #[arg(long, value_name = "DIR")]
    pub keys: Option<PathBuf>,
    /// The configuration to write
    #[arg(long, value_name = "FILE", default_value = crate::setup::SERVICE_CONFIG)]
    pub out: PathBuf,
    /// Overwrite it if it is there
    #[arg(long)]
    pub force: bool,
}

fn preset(name: &str) -> Result<Preset, String> {
    presets::get(name).map_err(|error| error.to_string())
}

/// Length, width and height, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Size(pub [f64; 3]);

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let size = numbers(text).and_then(|numbers| numbers.try_into().ok());
        size.map(Self).ok_or_else(|| {
            "a size is three numbers: length, width, height, as 1.2,0.8,0.6".to_owned()
        })
    }
}

/// A table `[devices.NAME]`.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedDevice {
    pub name: String,
    pub settings: Table,
}

impl FromStr for NamedDevice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let device = text.split_once('=').and_then(|(name, rest)| {
            let (kind, settings) = rest.split_once(',').unwrap_or((rest, ""));
            (!name.is_empty() && !kind.contains('=')).then_some((name, kind, settings))
        });
        let (name, kind, settings) = device.ok_or_else(|| {
            "a device is its name, kind and settings, as laser=sick_cola,tcp=192.168.0.1:2111"
                .to_owned()
        })?;
        Ok(Self {
            name: name.to_owned(),
            settings: device_settings(kind, settings)?,
        })
    }
}

/// The table of a device of this kind with these settings, `KEY=VALUE,KEY=VALUE`.
pub fn device_settings(kind: &str, settings: &str) -> Result<Table, String> {
    let mut table = Table::from_iter([("kind".to_owned(), Value::String(kind.to_owned()))]);
    let mut last = None;
    for part in settings.split(',').filter(|part| !part.trim().is_empty()) {
        let (key, text) = match (part.split_once('='), last.take()) {
            (Some((key, value)), _) => (key.trim(), value.to_owned()),
            // A list's comma: masks_deg=-135..-120,95..100
            (None, Some((key, value))) => (key, format!("{value},{part}")),
            (None, None) => return Err(format!("\"{part}\" is no KEY=VALUE")),
        };
        table.insert(key.to_owned(), device_value(key, &text)?);
        last = Some((key, text));
    }
    Ok(table)
}

/// What is text by its key is text, even if it looks like a number.
fn device_value(key: &str, text: &str) -> Result<Value, String> {
    let string = Value::String(text.to_owned());
    let is_text = Table::from_iter([(key.to_owned(), string.clone())]).try_into::<DeviceConfig>();
    if is_text.is_ok() {
        return Ok(string);
    }
    parse_value(text).map_err(|error| error.to_string())
}

/// A table `[sensors.NAME.mount]`.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedMount {
    pub sensor: String,
    pub mount: Table,
}

impl FromStr for NamedMount {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (sensor, place) = text
            .split_once('=')
            .ok_or_else(|| "a mount is a sensor's name and place, as laser=0.6,0,0.3".to_owned())?;
        Ok(Self {
            sensor: sensor.to_owned(),
            mount: mount(place)?,
        })
    }
}

/// `X,Y,Z` or `X,Y,Z,ROLL,PITCH,YAW`.
pub fn mount(text: &str) -> Result<Table, String> {
    let keys = ["x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg"];
    match numbers(text) {
        Some(numbers) if [3, 6].contains(&numbers.len()) => {
            let settings = keys.iter().zip(numbers);
            Ok(settings
                .map(|(key, number)| ((*key).to_owned(), Value::Float(number)))
                .collect())
        }
        _ => Err("a place is x,y,z or x,y,z,roll,pitch,yaw in numbers, as 0.6,0,0.3".to_owned()),
    }
}

fn numbers(text: &str) -> Option<Vec<f64>> {
    let number = |text: &str| {
        text.trim()
            .parse()
            .ok()
            .filter(|number: &f64| number.is_finite())
    };
    text.split(',').map(number).collect()
}
