//! The commands `vehicles`, `check`, `keys` and `install-keys`.

use std::collections::BTreeMap;
use std::io::{self, Write};

use crate::cli::{InstallKeys, Keys};
use crate::config::advice::{doubts, idle_settings};
use crate::config::presets::Preset;
use crate::config::{self, Config, SensorConfig};
use crate::exit::{Exit, UsageError};
use mapping::registered_scan::ScanKind;
use network::credentials::{Installed, IssueRequest, install, issue};
use teleop::Role;

/// `vehicles`: one line for each preset.
pub fn list(presets: &[Preset], out: &mut dyn Write) -> io::Result<()> {
    let names = presets.iter().map(|preset| preset.name.len());
    let width = names.max().unwrap_or(0);
    for preset in presets {
        writeln!(out, "{:width$}  {}", preset.name, preset.title())?;
    }
    Ok(())
}

/// `vehicles NAME`: the preset as a configuration to edit.
pub fn print(preset: &Preset, out: &mut dyn Write) -> io::Result<()> {
    out.write_all(preset.text.as_bytes())
}

/// `check CONFIG`: `ok` and what was understood, or every fault on a line.
pub fn check(vehicle: &str, out: &mut dyn Write) -> io::Result<Exit> {
    match config::load(vehicle, &[]) {
        Ok(config) => {
            writeln!(out, "ok")?;
            write_essentials(&config, out)?;
            for doubt in doubts(&config) {
                writeln!(out, "warning: {doubt}")?;
            }
            // Whether it is driven depends on the run.
            for note in idle_settings(vehicle, &[], &config, true).unwrap_or_default() {
                writeln!(out, "{note}")?;
            }
            Ok(Exit::Done)
        }
        Err(error) => {
            writeln!(out, "{error}")?;
            Ok(Exit::Usage)
        }
    }
}

fn write_essentials(config: &Config, out: &mut dyn Write) -> io::Result<()> {
    let vehicle = &config.vehicle;
    writeln!(
        out,
        "vehicle: {}, {} × {} × {} m, at most {} m/s and {} rad/s",
        vehicle.name,
        vehicle.length_m,
        vehicle.width_m,
        vehicle.height_m,
        vehicle.max_speed_mps,
        vehicle.max_turn_rate_radps
    )?;
    for (name, sensor) in &config.sensors {
        let topic = sensor.topic().unwrap_or("by type");
        writeln!(
            out,
            "sensor {name}: {}, topic {topic}, {}",
            sensor.kind(),
            sensor_essentials(sensor)
        )?;
    }
    for (name, device) in &config.devices {
        let address = device
            .address()
            .map_err(|(_, text)| io::Error::other(text))?;
        writeln!(out, "device {name}: {} at {address}", device.kind)?;
    }
    let (mapping, streaming) = (&config.mapping, &config.streaming);
    writeln!(
        out,
        "occupancy: cells of {} m, at most {} MB",
        mapping.occupancy.cell_m, mapping.occupancy.memory_limit_mb
    )?;
    writeln!(out, "streaming: {} kbit/s", streaming.budget_kbps)
}

fn sensor_essentials(sensor: &SensorConfig) -> String {
    match sensor {
        SensorConfig::LaserScan(sensor)
        | SensorConfig::Lidar(sensor)
        | SensorConfig::Sonar(sensor)
        | SensorConfig::Ultrasonic(sensor) => {
            let range = |range_m: Option<f64>| {
                range_m.map_or("as its messages say".to_owned(), |range_m| {
                    format!("{range_m} m")
                })
            };
            let (from, to) = (range(sensor.range_min_m), range(sensor.range_max_m));
            let tilted = sensor.tilt.as_ref().map_or(String::new(), |tilt| {
                format!(", tilted by joint {}", tilt.joint)
            });
            format!("ranges from {from} to {to}{tilted}")
        }
        SensorConfig::Bumper(sensor) => match sensor.scan_kind {
            ScanKind::Contact { width_m } => format!("{width_m} m wide"),
            ScanKind::Beams | ScanKind::Cloud | ScanKind::Arc => String::new(),
        },
        SensorConfig::WheelEncoders(encoders) => format!(
            "joints {} and {}, wheels of radius {} m",
            encoders.left_joint, encoders.right_joint, encoders.wheel_radius_m
        ),
        SensorConfig::Imu(imu) => {
            let mount = &imu.mount;
            format!(
                "turned by {}°, {}°, {}°",
                mount.roll_deg, mount.pitch_deg, mount.yaw_deg
            )
        }
        SensorConfig::Gps(gps) => {
            let antenna = &gps.mount;
            format!(
                "antenna at {} m, {} m, {} m",
                antenna.x_m, antenna.y_m, antenna.z_m
            )
        }
    }
}

pub fn keys(command: &Keys, out: &mut dyn Write) -> anyhow::Result<Exit> {
    let mut people = BTreeMap::new();
    for (names, role) in [
        (&command.operators, Role::Operator),
        (&command.supervisors, Role::Supervisor),
        (&command.observers, Role::Observer),
    ] {
        for name in names {
            let known = people.insert(name.clone(), role);
            if known.is_some_and(|known| known != role) {
                let why = format!("{name} is given two roles: a name has one");
                return Err(UsageError(why).into());
            }
        }
    }
    let done = issue(&IssueRequest {
        folder: command.folder.clone(),
        vehicles: command.robots.clone(),
        hosts: command.hosts.clone(),
        people,
        router_hosts: command.router_hosts.clone(),
        days: command.days,
    })?;
    if done.is_empty() {
        writeln!(out, "nothing to do: everything asked for is there")?;
    }
    for line in done {
        writeln!(out, "{line}")?;
    }
    Ok(Exit::Done)
}

pub fn install_keys(command: &InstallKeys, out: &mut dyn Write) -> anyhow::Result<Exit> {
    let Installed {
        robot,
        people,
        warning,
    } = install(&command.from, &command.to)?;
    let to = command.to.display();
    writeln!(
        out,
        "{to}: the keys of {robot}, with {people} people on its list"
    )?;
    if let Some(warning) = warning {
        writeln!(out, "{warning}")?;
    }
    Ok(Exit::Done)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::presets::PRESETS;

    fn checked(text: &str) -> (Exit, String) {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("boat.toml");
        std::fs::write(&path, text).unwrap();
        let mut out = Vec::new();
        let exit = check(path.to_str().unwrap(), &mut out).unwrap();
        let place = format!("{}/", directory.path().display());
        (exit, String::from_utf8(out).unwrap().replace(&place, ""))
    }

    #[test]
    fn a_good_configuration_is_ok() {
        let (exit, text) = checked(
            "preset = \"pioneer\"\nsensors.laser.topic = \"/front\"\n\
             sensors.wheels = { kind = \"wheel_encoders\", wheel_radius_m = 0.0975 }\n\
             sensors.ahrs = { kind = \"imu\", mount.yaw_deg = 90 }\n\
             sensors.gps = { kind = \"gps\", mount.z_m = 1.5 }\n\
             sensors.sonar = { kind = \"sonar\", tilt.joint = \"tilt\" }",
        );
        assert_eq!(exit, Exit::Done);
        assert_eq!(
            text,
            "ok\n\
             vehicle: pioneer, 0.455 × 0.381 × 0.237 m, at most 1.2 m/s and 5.24 rad/s\n\
             sensor ahrs: imu, topic by type, turned by 0°, 0°, 90°\n\
             sensor gps: gps, topic by type, antenna at 0 m, 0 m, 1.5 m\n\
             sensor laser: laser_scan, topic /front, ranges from 0.02 m to 5.6 m\n\
             sensor sonar: sonar, topic by type, ranges from as its messages say to as its messages say, \
             tilted by joint tilt\n\
             sensor wheels: wheel_encoders, topic by type, joints left_wheel_joint and \
             right_wheel_joint, wheels of radius 0.0975 m\n\
             occupancy: cells of 0.1 m, at most 256 MB\n\
             streaming: 256 kbit/s\n"
        );
    }

    #[test]
    fn what_is_probably_not_meant_is_reported() {
        let (exit, text) = checked(
            "preset = \"pioneer\"\n[sensors.laser]\nrange_max_m = 5600\n[mapping.cost]\nbox_m = 20\n",
        );
        assert_eq!(exit, Exit::Done);
        let says = "warning: `sensors.laser.range_max_m`: no sensor of a vehicle measures 5600 m: are these millimetres?\n\
                    without effect, as mapping.cost.enabled is false: mapping.cost.box_m\n";
        assert!(text.ends_with(says), "{text}");
        let (exit, text) = checked("[vehicle]\nname = \"mine\"\nwidth_m = 1\nheight_m = 1\n");
        assert_eq!(exit, Exit::Usage);
        let why =
            "missing: measure the vehicle, in metres; or start from another by `preset = \"NAME\"`";
        assert_eq!(text, format!("`vehicle.length_m`: {why}\n"));
    }

    #[test]
    fn every_fault_has_its_line() {
        let (exit, text) =
            checked("[mapping.occupancy]\ncell = 0.1\n\n[vehicle]\nlength_m = \"long\"");
        assert_eq!(exit, Exit::Usage);
        assert_eq!(
            text,
            "boat.toml:2:1: `mapping.occupancy.cell`: unknown key: did you mean `mapping.occupancy.cell_m`?\n\
             boat.toml:5:1: `vehicle.length_m`: expected a number, found the text \"long\"\n"
        );
    }

    #[test]
    fn presets_are_listed_and_printed_verbatim() {
        let mut out = Vec::new();
        list(PRESETS, &mut out).unwrap();
        let text = String::from_utf8(out).unwrap();
        assert!(
            text.starts_with("generic2d            One horizontal laser"),
            "{text}"
        );
        assert!(
            text.contains("\npioneer              Pioneer 3-DX"),
            "{text}"
        );

        for preset in PRESETS {
            let mut out = Vec::new();
            print(preset, &mut out).unwrap();
            assert_eq!(out, preset.text.as_bytes());
        }
        let error = config::presets::get("pionear").unwrap_err();
        assert_eq!(Exit::of(&error), Exit::Usage);
        assert!(
            error.to_string().contains("did you mean `pioneer`?"),
            "{error}"
        );
    }
}
