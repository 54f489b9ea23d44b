//! The command `setup`: asks what a vehicle has, and writes its configuration.

use std::collections::BTreeSet;
use std::fs::{self, OpenOptions};
use std::io::{BufRead, Write};
use std::path::Path;

use anyhow::Context as _;
use drivers::config::{DeviceConfig, Kind};
use network::endpoints::{check, is_loopback};
use toml::{Table, Value};

use crate::cli::setup::{NamedDevice, NamedMount, Setup, Size, device_settings, mount};
use crate::config::presets::{self, GENERIC, PRESETS, Preset};
use crate::config::{self, Config, ConfigError};
use crate::exit::{Exit, UsageError};
use crate::vehicle_commands;

/// The configuration of the service `robot-edge`.
pub const SERVICE_CONFIG: &str = "/etc/foreshore/vehicle.toml";
const KEYS: &str = "/etc/foreshore/keys";
const LISTEN: &str = "quic/[::]:7447";
/// Names of serial ports that stay.
const SERIAL_PORTS: [&str; 2] = ["/dev/foreshore", "/dev/serial/by-id"];

/// `setup`. Without `input` nothing is asked.
pub fn setup(
    command: &Setup,
    input: Option<&mut dyn BufRead>,
    out: &mut dyn Write,
) -> anyhow::Result<Exit> {
    let path = &command.out;
    if path.exists() && !command.force {
        let why = format!(
            "{}: is there already; --force overwrites it",
            path.display()
        );
        return Err(UsageError(why).into());
    }
    let table = Dialog { input, out }.configuration(command)?;
    let text = format!(
        "# Written by `robot-edge setup`. `robot-edge vehicles NAME` prints every key there is, `robot-edge check FILE`\n\
         # validates what you change.\n\n{}",
        toml::to_string(&table).context("configuration")?
    );
    let config = config::load::load_text(path, &text)?;
    let mut options = OpenOptions::new();
    options
        .write(true)
        .create(true)
        .truncate(true)
        .create_new(!command.force);
    options
        .open(path)
        .and_then(|mut file| file.write_all(text.as_bytes()))
        .with_context(|| path.display().to_string())?;
    write_next_steps(path, &table, &config, out)?;
    Ok(Exit::Done)
}

struct Dialog<'i, 'o> {
    input: Option<&'i mut dyn BufRead>,
    out: &'o mut dyn Write,
}

impl Dialog<'_, '_> {
    fn configuration(&mut self, command: &Setup) -> anyhow::Result<Table> {
        let vehicle = match command.vehicle {
            Some(vehicle) => vehicle,
            None => self.vehicle()?,
        };
        let sensors = config::load(vehicle.name, &[])?.sensors;
        let kind_of = |name: &str| sensors.get(name).map(config::SensorConfig::kind);
        let size = match command.size {
            None if vehicle == GENERIC || self.input.is_some() => self.size(vehicle)?,
            given => given,
        };
        let devices = if command.devices.is_empty() && self.input.is_some() {
            let named = |kind: &str| {
                let mut fitting = sensors.iter().filter(|(_, sensor)| sensor.kind() == kind);
                fitting.next().map(|(name, _)| name.clone())
            };
            self.devices(vehicle, named)?
        } else {
            command.devices.clone()
        };
        check_devices(vehicle, &devices).map_err(UsageError)?;

        let mut added = Table::new();
        for NamedDevice { name, settings } in &devices {
            let kinds = kind(settings).map_or(&[][..], sensor_kinds);
            match (kind_of(name), kinds) {
                (Some(known), kinds) if !kinds.is_empty() && !kinds.contains(&known) => {
                    let why = format!(
                        "device {name}: its measurements are of a sensor of kind {}, and the sensor {name} of {} is of kind \
                         {known}: give the device another name",
                        kinds.join(" or "),
                        vehicle.name
                    );
                    return Err(UsageError(why).into());
                }
                (None, [kind, ..]) => {
                    let kind = Value::String((*kind).to_owned());
                    let sensor = Table::from_iter([("kind".to_owned(), kind)]);
                    added.insert(name.clone(), Value::Table(sensor));
                }
                _ => {}
            }
        }
        let mut mounts = command.mounts.clone();
        for (name, sensor) in &added {
            let has_range = matches!(sensor["kind"].as_str(), Some("laser_scan" | "sonar"));
            if has_range && !mounts.iter().any(|given| given.sensor == *name) {
                mounts.push(self.mount(name)?);
            }
        }
        for NamedMount { sensor, mount } in mounts {
            let entry = added
                .entry(sensor)
                .or_insert_with(|| Value::Table(Table::new()));
            if let Value::Table(sensor) = entry {
                sensor.insert("mount".to_owned(), Value::Table(mount));
            }
        }

        let mut table = Table::new();
        table.insert("preset".to_owned(), Value::String(vehicle.name.to_owned()));
        let size = size.map_or_else(Table::new, |Size(size)| {
            let keys = ["length_m", "width_m", "height_m"].map(str::to_owned);
            keys.into_iter().zip(size.map(Value::Float)).collect()
        });
        let devices = devices.into_iter();
        let devices = devices.map(|device| (device.name, Value::Table(device.settings)));
        for (key, part) in [
            ("vehicle", size),
            ("sensors", added),
            ("devices", devices.collect()),
            ("link", self.link(command)?),
        ] {
            if !part.is_empty() {
                table.insert(key.to_owned(), Value::Table(part));
            }
        }
        Ok(table)
    }

    fn vehicle(&mut self) -> anyhow::Result<Preset> {
        if self.input.is_some() {
            let mut vehicles = PRESETS.to_vec();
            vehicles.retain(|preset| !preset.is_document());
            vehicle_commands::list(&vehicles, self.out)?;
        }
        self.ask(
            "--vehicle",
            "The vehicle that it is, or is most like",
            |name| presets::get(name).map_err(|error| error.to_string()),
        )
    }

    fn size(&mut self, vehicle: Preset) -> anyhow::Result<Option<Size>> {
        let (default, may_be_empty) = if vehicle == GENERIC {
            ("", false)
        } else {
            ("; empty: as the preset", true)
        };
        let question = format!("Length, width, height in metres, as 1.2,0.8,0.6{default}");
        self.ask("--size", &question, |text| match text {
            "" if may_be_empty => Ok(None),
            _ => text.parse().map(Some),
        })
    }

    /// `named` is the vehicle's first sensor of a kind.
    fn devices(
        &mut self,
        vehicle: Preset,
        named: impl Fn(&str) -> Option<String>,
    ) -> anyhow::Result<Vec<NamedDevice>> {
        let words = Kind::ALL.map(Kind::name);
        writeln!(self.out, "Devices: {}", words.join(", "))?;
        let ports = SERIAL_PORTS
            .iter()
            .filter_map(|folder| fs::read_dir(folder).ok());
        for port in ports.flatten().flatten() {
            writeln!(self.out, "Serial port: {}", port.path().display())?;
        }
        let mut devices: Vec<NamedDevice> = Vec::new();
        loop {
            let kind = self.ask("--device", "Kind of a device; empty: no more", |word| {
                if word.is_empty() || words.contains(&word) {
                    Ok(word.to_owned())
                } else {
                    Err(format!("there is: {}", words.join(", ")))
                }
            })?;
            if kind.is_empty() {
                return Ok(devices);
            }
            let taken: BTreeSet<String> =
                devices.iter().map(|device| device.name.clone()).collect();
            let settings = device_settings(&kind, "").unwrap_or_default();
            let kinds = self::kind(&settings).map_or(&[][..], sensor_kinds);
            let mut fitting = kinds.iter().filter_map(|kind| named(kind));
            let default = fitting.find(|name| !taken.contains(name));
            let default = default.unwrap_or_else(|| kind.clone());
            let name = self.ask("--device", &format!("Its name [{default}]"), |name| {
                let name = if name.is_empty() {
                    default.as_str()
                } else {
                    name
                };
                let is_free = !taken.contains(name);
                is_free
                    .then(|| name.to_owned())
                    .ok_or_else(|| format!("{name} is taken"))
            })?;
            let place = self::kind(&settings).and_then(|kind| {
                let device = DeviceConfig {
                    kind,
                    ..DeviceConfig::default()
                };
                device.address().err().map(|(_, places)| places)
            });
            writeln!(self.out, "{}", place.unwrap_or_default())?;
            let question = "Its settings, KEY=VALUE,KEY=VALUE, as tcp=192.168.0.1:2111";
            let all = self.ask("--device", question, |text| {
                let mut all = devices.clone();
                all.push(NamedDevice {
                    name: name.clone(),
                    settings: device_settings(&kind, text)?,
                });
                check_devices(vehicle, &all).map(|()| all)
            })?;
            devices = all;
        }
    }

    fn mount(&mut self, sensor: &str) -> anyhow::Result<NamedMount> {
        let question = format!(
            "Place of the sensor {sensor} in the base frame (x forward, y left, z up), metres, as 0.6,0,0.3; or with roll, \
             pitch, yaw, degrees"
        );
        let mount = self.ask(&format!("--mount {sensor}=X,Y,Z"), &question, mount)?;
        Ok(NamedMount {
            sensor: sensor.to_owned(),
            mount,
        })
    }

    fn link(&mut self, command: &Setup) -> anyhow::Result<Table> {
        let asked = if command.listen.is_none() && command.connect.is_none() {
            let question = format!("Listen for consoles at [{LISTEN}]");
            let listen = self.ask("--listen or --connect", &question, |text| {
                let endpoint = if text.is_empty() { LISTEN } else { text };
                let is_ok = check(endpoint, !is_open(endpoint)).map_err(|error| error.to_string());
                is_ok.map(|()| endpoint.to_owned())
            })?;
            Some(listen)
        } else {
            None
        };
        let listen = command.listen.as_ref().or(asked.as_ref());
        let endpoints: Vec<&String> = listen.into_iter().chain(&command.connect).collect();
        let keys = match &command.keys {
            None if endpoints.iter().all(|endpoint| is_open(endpoint)) => None,
            None if self.input.is_some() => Some(self.ask(
                "--keys",
                &format!("Folder of its keys [{KEYS}]"),
                |text| Ok(if text.is_empty() { KEYS } else { text }.to_owned()),
            )?),
            None => Some(KEYS.to_owned()),
            Some(folder) => Some(folder.to_str().context("--keys is not UTF-8")?.to_owned()),
        };
        for endpoint in endpoints {
            check(endpoint, keys.is_some()).map_err(|error| UsageError(error.to_string()))?;
        }
        let settings = [
            ("listen", listen.cloned()),
            ("connect", command.connect.clone()),
            ("keys", keys),
        ];
        let given = settings
            .into_iter()
            .filter_map(|(key, value)| Some((key.to_owned(), value?)));
        Ok(given
            .map(|(key, value)| (key, Value::String(value)))
            .collect())
    }

    /// Asks until the answer can be taken.
    fn ask<T>(
        &mut self,
        option: &str,
        question: &str,
        parse: impl Fn(&str) -> Result<T, String>,
    ) -> anyhow::Result<T> {
        let Some(input) = &mut self.input else {
            let why = format!("{option} is missing, and there is no terminal to ask at");
            return Err(UsageError(why).into());
        };
        loop {
            write!(self.out, "{question}: ")?;
            self.out.flush()?;
            let mut line = String::new();
            if input.read_line(&mut line)? == 0 {
                let why = "the input ended before the last question; nothing is written";
                return Err(UsageError(why.to_owned()).into());
            }
            match parse(line.trim()) {
                Ok(answer) => return Ok(answer),
                Err(why) => writeln!(self.out, "{why}")?,
            }
        }
    }
}

/// Reached from this machine alone, so that it needs no keys.
fn is_open(endpoint: &str) -> bool {
    endpoint.starts_with("tcp/") && is_loopback(endpoint)
}

fn kind(settings: &Table) -> Option<Kind> {
    settings.get("kind")?.clone().try_into().ok()
}

/// Kinds of sensors whose measurements a device gives, the usual one first.
const fn sensor_kinds(kind: Kind) -> &'static [&'static str] {
    match kind {
        Kind::SickCola | Kind::SickLdlrs | Kind::Hokuyo | Kind::Rplidar => &["laser_scan"],
        Kind::Imagenex852 | Kind::ImagenexDeltat | Kind::Ping1d => &["sonar"],
        Kind::Xsens => &["imu"],
        Kind::Nmea => &["gps", "sonar"],
        Kind::Ublox => &["gps"],
        Kind::Velodyne | Kind::Ouster | Kind::Livox => &["lidar"],
        Kind::Ntrip | Kind::Dynamixel => &[],
    }
}

fn check_devices(vehicle: Preset, devices: &[NamedDevice]) -> Result<(), String> {
    let mut table = Table::new();
    for NamedDevice { name, settings } in devices {
        let settings = Value::Table(settings.clone());
        if table.insert(name.clone(), settings).is_some() {
            return Err(format!("there are two devices of the name {name}"));
        }
    }
    let table = Table::from_iter([
        ("preset".to_owned(), Value::String(vehicle.name.to_owned())),
        ("devices".to_owned(), Value::Table(table)),
    ]);
    let text = toml::to_string(&table).map_err(|error| error.to_string())?;
    let loaded = config::load::load_text(Path::new("--device"), &text);
    loaded.map(drop).map_err(|mut error| {
        if let ConfigError::Issues(issues) = &mut error {
            // No file has these lines yet.
            for issue in issues {
                issue.origin = None;
            }
        }
        error.to_string()
    })
}

/// What is written, and the commands that come next.
fn write_next_steps(
    path: &Path,
    table: &Table,
    config: &Config,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    let shown = path.display();
    writeln!(
        out,
        "{shown}: written; `robot-edge check {shown}` says what it means"
    )?;
    let devices = table.get("devices").and_then(Value::as_table);
    for (name, sensor) in &config.sensors {
        // No device gives ranges of cones or contacts: they are topics.
        let is_topic = matches!(
            sensor,
            config::SensorConfig::Ultrasonic(_) | config::SensorConfig::Bumper(_)
        );
        let devices = devices.filter(|_| !is_topic);
        if devices.is_some_and(|devices| !devices.contains_key(name)) {
            writeln!(out, "sensor {name}: no device has this name")?;
        }
    }
    let mut folder = "";
    if let Some(keys) = &config.link.keys {
        let keys = keys.display();
        writeln!(
            out,
            "Install its keys:  robot-edge install-keys FOLDER {keys}"
        )?;
        folder = "\nFOLDER is vehicles/NAME in the folder that `robot-edge keys` makes.";
    }
    if path == Path::new(SERVICE_CONFIG) {
        let start = "systemctl enable --now --no-block foreshore-nft robot-edge";
        writeln!(out, "Start the service: {start}{folder}")?;
    } else {
        writeln!(
            out,
            "Start it:          robot-edge run --vehicle {shown}{folder}"
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
