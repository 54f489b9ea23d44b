//! The commands that open devices without mapping: `devices`, `check --connect` and `calibrate`.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::sync_channel;
use std::time::Duration;

use anyhow::anyhow;

use crate::cli::{Calibrate, Devices};
use crate::config::{self, Config};
use crate::exit::{Exit, Interrupted, UsageError};
use crate::runtime::is_set;
use drivers::Drivers;
use drivers::beam_selection::SelfHits;
use drivers::config::{DeviceConfig, Kind};
use drivers::status::{DeviceStatus, DeviceStatuses, State};
use measurement::MeasurementData;
use measurement::scan::Scan;
use network::clock;

/// Readings that wait; they are taken at once.
const MAX_READINGS: usize = 4096;
const POLL_TIMEOUT: Duration = Duration::from_millis(20);

/// Time for a device to say which one it is.
const ANSWER_TIME: Duration = Duration::from_millis(2500);

/// Where devices are when they are delivered (manuals of the `LMS1xx`, `TiM`, LD-LRS and UST).
const FACTORY_ADDRESSES: [(Kind, &str); 4] = [
    (Kind::SickCola, "192.168.0.1:2111"),
    (Kind::SickCola, "192.168.0.1:2112"),
    (Kind::SickLdlrs, "192.168.1.10:49152"),
    (Kind::Hokuyo, "192.168.0.10:10940"),
];

/// Kinds that answer on a serial port, as they are delivered.
const SERIAL_KINDS: [Kind; 6] = [
    Kind::Xsens,
    Kind::Ublox,
    Kind::Hokuyo,
    Kind::Rplidar,
    Kind::Ping1d,
    Kind::Imagenex852,
];

/// Usual rates of receivers and echo sounders.
const NMEA_BAUDS: [u32; 4] = [4800, 9600, 38_400, 115_200];

/// Runs devices for `time`. `take` gets the names and the scans.
fn observe(
    devices: &BTreeMap<String, DeviceConfig>,
    time: Duration,
    interrupt: &AtomicBool,
    mut take: impl FnMut(&str, Scan),
) -> anyhow::Result<DeviceStatuses> {
    let (sender, readings) = sync_channel(MAX_READINGS);
    let drivers = Drivers::start(devices, clock::now, &sender)
        .map_err(|error| UsageError(error.to_string()))?;
    let until = clock::now() + time;
    while !until.since(clock::now()).is_zero() {
        if is_set(interrupt) {
            return Err(Interrupted.into());
        }
        let Ok(reading) = readings.recv_timeout(POLL_TIMEOUT) else {
            continue;
        };
        if let MeasurementData::Scan { scan, .. } = reading.measurement.data {
            take(&reading.measurement.frame, scan);
        }
    }
    Ok(drivers.statuses().clone())
}

/// `check CONFIG --connect`: opens every device, and says what it is and how it measures.
pub(crate) fn connect(
    config: &Config,
    time: Duration,
    interrupt: &AtomicBool,
    out: &mut dyn Write,
) -> anyhow::Result<Exit> {
    if config.devices.is_empty() {
        writeln!(
            out,
            "devices: none: the configuration has no [devices.NAME]"
        )?;
        return Ok(Exit::Done);
    }
    let mut sweeps = BTreeMap::new();
    let statuses = observe(&config.devices, time, interrupt, |name, scan| {
        sweeps.insert(name.to_owned(), scan);
    })?;
    let mut silent = Vec::new();
    for (name, status) in statuses.now() {
        let device = &config.devices[name];
        writeln!(
            out,
            "\ndevice {name}: {}, {}",
            device.kind,
            state_text(&status)
        )?;
        if let Some(identity) = &status.identity {
            writeln!(out, "  {identity}")?;
        }
        if let Some(clock) = status.clock {
            writeln!(
                out,
                "  clock: {:+.3} s to the vehicle's, messages late by up to {:.0} ms",
                clock.offset_s,
                1e3 * clock.spread_s
            )?;
        }
        for (loss, count) in &status.losses {
            writeln!(out, "  lost: {count} {loss}")?;
        }
        if let Some(sweep) = sweeps.get(name) {
            write_sweep(sweep, out)?;
        }
        // A caster has no measurements.
        if status.state != State::Measuring {
            silent.push(name.to_owned());
        }
    }
    if silent.is_empty() {
        return Ok(Exit::Done);
    }
    Err(anyhow!(
        "no measurements from {}; see above",
        silent.join(", ")
    ))
}

fn state_text(status: &DeviceStatus) -> String {
    match (&status.state, &status.trouble) {
        (State::Measuring, _) => format!("measures, {:.1} Hz", status.rate_hz),
        (State::Configuring, None) => "answers, has not measured yet".to_owned(),
        (State::Connecting, None) => "not connected".to_owned(),
        (State::Configuring | State::Connecting, Some(trouble)) => format!("no: {trouble}"),
    }
}

/// Size of a picture in characters, which have two by four dots.
const PICTURE: [usize; 2] = [60, 24];

/// A sweep from above in dots, the sensor's x axis up.
fn write_sweep(scan: &Scan, out: &mut dyn Write) -> io::Result<()> {
    if let [range_m] = scan.ranges_m[..] {
        return writeln!(out, "  {range_m:.2} m");
    }
    let angles = (0..scan.ranges_m.len())
        .map(|beam| scan.angle_min_rad + beam as f32 * scan.angle_increment_rad);
    let hits: Vec<(f32, f32)> = angles
        .zip(&scan.ranges_m)
        .filter(|(_, range_m)| **range_m > 0.0 && **range_m < scan.range_max_m)
        .map(|(angle, range_m)| (range_m * angle.cos(), range_m * angle.sin()))
        .collect();
    let reach = |size: f32, (x, y): &(f32, f32)| size.max(x.abs()).max(y.abs());
    let reach_m = hits.iter().fold(0.1, reach);
    let [columns, rows] = PICTURE;
    // Dots are square: all rows show the reach ahead and behind.
    let dot_m = reach_m / (2.0 * rows as f32 - 1.0);
    let mut cells = vec![[0_u8; PICTURE[0]]; rows];
    for (x_m, y_m) in hits.iter().copied().chain([(0.0, 0.0)]) {
        let row = (2.0 * rows as f32 - x_m / dot_m) as usize;
        let column = (columns as f32 - y_m / dot_m) as usize;
        // Unicode, Braille patterns: dots 1 to 8.
        let dot = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]][row % 4][column % 2];
        if let Some(cell) = cells
            .get_mut(row / 4)
            .and_then(|line| line.get_mut(column / 2))
        {
            *cell |= dot;
        }
    }
    // Without the empty rows on both sides.
    let is_drawn = |line: &[u8; PICTURE[0]]| line.iter().any(|dots| *dots != 0);
    let first = cells.iter().position(is_drawn).unwrap_or(0);
    let last = cells.iter().rposition(is_drawn).unwrap_or(0);
    for line in &cells[first..=last] {
        let line: String = line
            .iter()
            .filter_map(|dots| char::from_u32(0x2800 + u32::from(*dots)))
            .collect();
        writeln!(out, "  {}", line.trim_end_matches('\u{2800}'))?;
    }
    writeln!(
        out,
        "  {} of {} beams hit, the farthest {reach_m:.1} m ahead or aside; ahead is up",
        hits.len(),
        scan.ranges_m.len()
    )
}

/// `devices`: what is connected, as far as it says so.
pub(crate) fn devices(
    command: &Devices,
    interrupt: &AtomicBool,
    out: &mut dyn Write,
) -> anyhow::Result<Exit> {
    let mut ports = serial_ports();
    ports.extend(command.ports.iter().cloned());
    let mut rounds = vec![network_candidates()];
    rounds.extend(NMEA_BAUDS.map(|baud| serial_candidates(&ports, Kind::Nmea, Some(baud))));
    if command.ask {
        rounds.extend(SERIAL_KINDS.map(|kind| serial_candidates(&ports, kind, None)));
    }
    let mut found: BTreeMap<String, (Kind, String)> = BTreeMap::new();
    for mut round in rounds {
        round.retain(|place, _| !found.contains_key(place));
        if round.is_empty() {
            continue;
        }
        let statuses = observe(&round, ANSWER_TIME, interrupt, |_, _| {})?;
        for (place, status) in statuses.now() {
            let is_there = status.identity.is_some() || status.measurements > 0;
            if is_there {
                let kind = round[place].kind;
                let identity = status.identity.unwrap_or_else(|| "sends".to_owned());
                found.insert(place.to_owned(), (kind, identity));
            }
        }
    }
    for port in &ports {
        found
            .entry(port.display().to_string())
            .or_insert((Kind::default(), String::new()));
    }
    for (place, (kind, identity)) in &found {
        if identity.is_empty() {
            writeln!(out, "{place}: nothing that is known")?;
        } else {
            writeln!(out, "{place}: {kind}, {identity}")?;
        }
    }
    if found.is_empty() {
        writeln!(
            out,
            "no serial port, and nothing at the addresses that devices are delivered with"
        )?;
    }
    if !command.ask && !ports.is_empty() {
        writeln!(
            out,
            "\nSerial ports were listened to only. --ask writes the requests of each kind to them: not for the port of a \
             motor controller"
        )?;
    }
    writeln!(out, "\nkinds of devices, and what proves them:")?;
    for kind in Kind::ALL {
        writeln!(out, "  {kind}: {}", kind.evidence())?;
    }
    Ok(Exit::Done)
}

fn network_candidates() -> BTreeMap<String, DeviceConfig> {
    let candidate = |(kind, address): (Kind, &str)| {
        let config = DeviceConfig {
            kind,
            tcp: Some(address.to_owned()),
            ..DeviceConfig::default()
        };
        (address.to_owned(), config)
    };
    FACTORY_ADDRESSES.into_iter().map(candidate).collect()
}

fn serial_candidates(
    ports: &[PathBuf],
    kind: Kind,
    baud: Option<u32>,
) -> BTreeMap<String, DeviceConfig> {
    let candidate = |port: &PathBuf| {
        let place = port.display().to_string();
        let config = DeviceConfig {
            kind,
            serial: Some(place.clone()),
            baud,
            ..DeviceConfig::default()
        };
        (place, config)
    };
    ports.iter().map(candidate).collect()
}

/// By the names that stay, if there are any.
fn serial_ports() -> Vec<PathBuf> {
    let listed = |folder: &str| {
        let entries = Path::new(folder).read_dir().into_iter().flatten().flatten();
        entries.map(|entry| entry.path()).collect::<Vec<_>>()
    };
    let mut ports = listed("/dev/serial/by-id");
    if ports.is_empty() {
        ports = listed("/dev");
        ports.retain(|port| {
            let name = port.file_name().unwrap_or_default().to_string_lossy();
            name.starts_with("ttyUSB") || name.starts_with("ttyACM")
        });
    }
    ports.sort();
    ports
}

/// `calibrate self-hits CONFIG`: the masks of beams that hit the vehicle itself.
pub(crate) fn calibrate(
    command: &Calibrate,
    interrupt: &AtomicBool,
    out: &mut dyn Write,
) -> anyhow::Result<Exit> {
    let Calibrate::SelfHits(command) = command;
    let config = config::load(&command.config, &[])?;
    let mut scanners: BTreeMap<String, DeviceConfig> = config.devices.clone();
    scanners.retain(|_, device| device.kind.gives_scans());
    if scanners.is_empty() {
        return Err(UsageError(format!(
            "{}: it has no [devices.NAME] that scans",
            command.config
        ))
        .into());
    }
    for device in scanners.values_mut() {
        device.masks_deg = None;
    }
    let reach_m = command.within_m.unwrap_or(default_reach_m(&config)) as f32;
    let time = Duration::from_secs_f64(command.seconds);
    writeln!(
        out,
        "{:.0} s: the vehicle stands, and nothing else is within {reach_m:.1} m of a scanner",
        command.seconds
    )?;
    let mut hits: BTreeMap<String, SelfHits> = BTreeMap::new();
    observe(&scanners, time, interrupt, |name, scan| {
        let of_scanner = hits.entry(name.to_owned()).or_default();
        of_scanner.add(&scan, reach_m);
    })?;
    let mut is_complete = true;
    for name in scanners.keys() {
        match hits.get(name).and_then(SelfHits::masks) {
            Some(masks) if masks.is_empty() => {
                writeln!(out, "[devices.{name}] no beam hits the vehicle")?;
            }
            Some(masks) => {
                let masks: Vec<_> = masks.iter().map(ToString::to_string).collect();
                writeln!(
                    out,
                    "[devices.{name}]\nmasks_deg = \"{}\"",
                    masks.join(", ")
                )?;
            }
            None => {
                is_complete = false;
                writeln!(
                    out,
                    "[devices.{name}] too few sweeps: is it connected? `robot-edge check --connect` says more"
                )?;
            }
        }
    }
    if is_complete {
        return Ok(Exit::Done);
    }
    Err(anyhow!("not every scanner was calibrated"))
}

/// From a corner to the opposite one, and a little more: whatever the vehicle carries is nearer to a scanner on it.
fn default_reach_m(config: &Config) -> f64 {
    libm::hypot(config.vehicle.length_m, config.vehicle.width_m) + 0.2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sweep_is_drawn_from_above() {
        let scan = Scan {
            angle_min_rad: -std::f32::consts::FRAC_PI_2,
            angle_increment_rad: std::f32::consts::FRAC_PI_2,
            range_max_m: 10.0,
            // Right, ahead, left without an echo.
            ranges_m: vec![1.0, 4.7, f32::INFINITY],
            ..Scan::default()
        };
        let mut text = Vec::new();
        write_sweep(&scan, &mut text).unwrap();
        let text = String::from_utf8(text).unwrap();
        let lines: Vec<_> = text.lines().collect();
        let at = |row: usize, column: usize| lines[row].chars().nth(2 + column);
        // 0.1 m a dot: ahead 47 dots up, 10 dots to the right; the sensor's row is the last one.
        assert_eq!(lines.len(), 14);
        assert_eq!(at(0, 30), Some('\u{2802}'), "{text}");
        assert_eq!(at(12, 30), Some('\u{2801}'), "{text}");
        assert_eq!(at(12, 35), Some('\u{2801}'), "{text}");
        assert!(lines[13].contains("2 of 3 beams hit"), "{text}");
    }
}
