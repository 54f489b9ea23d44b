//! Which values make sense, alone and together.

use super::checks::{Allowed, Checks, as_toml};
use super::error::Fault;
use super::layer::quoted;
use super::sensors::{LaserScanConfig, SensorConfig};
use super::{Config, VehicleConfig};
use crate::link::config::LinkConfig;
use crate::link::endpoints::bulk_endpoint;
use crate::localization::config::LocalizationConfig;
use crate::mapping::config::MappingConfig;
use crate::mapping::occupancy_config::OccupancyConfig;
use crate::streaming::config::StreamingConfig;

/// Most sensors on one vehicle.
pub(super) const MAX_SENSORS: usize = 32;

impl Config {
    /// Everything that is wrong with the values; empty where nothing is.
    pub fn validate(&self) -> Vec<Fault> {
        let mut checks = Checks::default();
        vehicle(&mut checks, &self.vehicle);
        let sensors = self.sensors.len();
        if !(1..=MAX_SENSORS).contains(&sensors) {
            let why = "maps are made of what sensors say, and each takes memory";
            checks.fault(
                "sensors",
                format!("a table of {sensors}"),
                why,
                format!("1 to {MAX_SENSORS} sensors"),
            );
        }
        for (name, sensor) in self.sensors.iter().take(MAX_SENSORS) {
            match sensor {
                SensorConfig::LaserScan(laser) => {
                    laser_scan(&mut checks, &format!("sensors.{name}"), laser);
                }
            }
        }
        localization(&mut checks, &self.localization);
        mapping(&mut checks, &self.mapping);
        streaming(&mut checks, &self.streaming);
        link(&mut checks, &self.link);
        checks.into_faults()
    }
}

fn link(checks: &mut Checks, link: &LinkConfig) {
    let endpoints = [
        ("link.listen", link.listen.as_ref()),
        ("link.connect", link.connect.as_ref()),
    ];
    for (key, endpoint) in endpoints {
        if let Some(endpoint) = endpoint
            && bulk_endpoint(endpoint).is_err()
        {
            checks.fault(
                key,
                quoted(endpoint),
                "control is at this port and tiles at the next",
                "\"tcp/HOST:PORT\" with a port from 1 to 65534".to_owned(),
            );
        }
    }
}

fn vehicle(checks: &mut Checks, vehicle: &VehicleConfig) {
    checks.name(
        "vehicle.name",
        &vehicle.name,
        "it stands in summaries and messages",
    );
    let body = "it is the size of a ground robot or boat, in metres";
    let size = Allowed::PositiveUpTo(100.0);
    checks.number("vehicle.length_m", vehicle.length_m, size, body);
    checks.number("vehicle.width_m", vehicle.width_m, size, body);
    checks.number("vehicle.height_m", vehicle.height_m, size, body);
    let limit = "limits must be finite and leave room to move";
    checks.number(
        "vehicle.max_speed_mps",
        vehicle.max_speed_mps,
        Allowed::PositiveUpTo(50.0),
        limit,
    );
    checks.number(
        "vehicle.max_turn_rate_radps",
        vehicle.max_turn_rate_radps,
        Allowed::PositiveUpTo(50.0),
        limit,
    );
}

fn laser_scan(checks: &mut Checks, path: &str, laser: &LaserScanConfig) {
    let key = |name: &str| format!("{path}.{name}");
    if let Some(topic) = &laser.topic {
        checks.name(&key("topic"), topic, "no stream can have this name");
    }
    let ranges = "ranges are metres along a beam";
    if let Some(range_min_m) = laser.range_min_m {
        checks.number(
            &key("range_min_m"),
            range_min_m,
            Allowed::Within(0.0, 10_000.0),
            ranges,
        );
    }
    if let Some(range_max_m) = laser.range_max_m {
        checks.number(
            &key("range_max_m"),
            range_max_m,
            Allowed::PositiveUpTo(10_000.0),
            ranges,
        );
    }
    if let (Some(range_min_m), Some(range_max_m)) = (laser.range_min_m, laser.range_max_m)
        && range_min_m >= range_max_m
    {
        let why = "no range could be a hit";
        checks.fault(
            &key("range_max_m"),
            as_toml(range_max_m),
            why,
            format!("above range_min_m = {range_min_m}"),
        );
    }
    let offset = "it makes up for latency; clocks that differ by more cannot be reconciled";
    checks.number(
        &key("time_offset_s"),
        laser.time_offset_s,
        Allowed::Within(-3600.0, 3600.0),
        offset,
    );
    let mount = &laser.mount;
    for (name, value) in [("x_m", mount.x_m), ("y_m", mount.y_m), ("z_m", mount.z_m)] {
        let why = "a sensor sits on its vehicle";
        checks.number(
            &key(&format!("mount.{name}")),
            value,
            Allowed::Within(-100.0, 100.0),
            why,
        );
    }
    for (name, value) in [
        ("roll_deg", mount.roll_deg),
        ("pitch_deg", mount.pitch_deg),
        ("yaw_deg", mount.yaw_deg),
    ] {
        let why = "angles are degrees, at most one turn";
        checks.number(
            &key(&format!("mount.{name}")),
            value,
            Allowed::Within(-360.0, 360.0),
            why,
        );
    }
    if let Some(model) = &laser.model {
        checks.name(&key("model"), model, "a device has a name");
    }
    if let Some(beams) = laser.beams {
        checks.whole(
            &key("beams"),
            beams.into(),
            1,
            100_000,
            "every beam takes memory and time",
        );
    }
    if let Some(field_of_view_deg) = laser.field_of_view_deg {
        let why = "a planar sensor sweeps at most one turn";
        checks.number(
            &key("field_of_view_deg"),
            field_of_view_deg,
            Allowed::PositiveUpTo(360.0),
            why,
        );
    }
    if let Some(rate_hz) = laser.rate_hz {
        let why = "sweeps take time";
        checks.number(&key("rate_hz"), rate_hz, Allowed::PositiveUpTo(1000.0), why);
    }
}

fn localization(checks: &mut Checks, localization: &LocalizationConfig) {
    let key = |name: &str| format!("localization.{name}");
    checks.frame(&key("base_frame"), &localization.base_frame);
    if let Some(fixed_frame) = &localization.fixed_frame {
        checks.frame(&key("fixed_frame"), fixed_frame);
        if *fixed_frame == localization.base_frame {
            let why = "the map would move with the vehicle";
            let allowed = "a frame other than localization.base_frame".to_owned();
            checks.fault(
                &key("fixed_frame"),
                format!("\"{}\"", quoted(fixed_frame)),
                why,
                allowed,
            );
        }
    }
    let pose = "poses farther away than that say nothing about a beam";
    checks.number(
        &key("max_gap_s"),
        localization.max_gap_s,
        Allowed::PositiveUpTo(60.0),
        pose,
    );
    checks.number(
        &key("wait_s"),
        localization.wait_s,
        Allowed::Within(0.0, 60.0),
        pose,
    );
    checks.number(
        &key("max_extrapolation_s"),
        localization.max_extrapolation_s,
        Allowed::Within(0.0, 60.0),
        pose,
    );
    let memory = "what is kept takes memory";
    checks.number(
        &key("buffer_s"),
        localization.buffer_s,
        Allowed::PositiveUpTo(3600.0),
        memory,
    );
    let least_s = localization.max_gap_s.max(localization.wait_s);
    if localization.buffer_s < least_s {
        let why = "poses would be forgotten before the scans that wait for them are placed";
        let allowed = format!("at least max_gap_s and wait_s, {least_s}");
        checks.fault(
            &key("buffer_s"),
            as_toml(localization.buffer_s),
            why,
            allowed,
        );
    }
    let waiting = localization.max_waiting_scans as u64;
    checks.whole(&key("max_waiting_scans"), waiting, 1, 100_000, memory);
}

fn mapping(checks: &mut Checks, mapping: &MappingConfig) {
    let threads = "nothing is gained by more";
    checks.whole("mapping.threads", mapping.threads as u64, 1, 2, threads);
    occupancy(checks, &mapping.occupancy);
}

fn occupancy(checks: &mut Checks, occupancy: &OccupancyConfig) {
    let key = |name: &str| format!("mapping.occupancy.{name}");
    let cell = "smaller cells are finer than lasers measure, larger ones than robots move";
    checks.number(
        &key("cell_m"),
        occupancy.cell_m,
        Allowed::Within(0.01, 10.0),
        cell,
    );
    let OccupancyConfig {
        p_free,
        p_occupied,
        p_min,
        p_max,
        ..
    } = *occupancy;
    let mut ordered = |name: &str, value: f64, holds: bool, why, allowed: String| {
        if !holds {
            checks.fault(&key(name), as_toml(value), why, allowed);
        }
    };
    let free = "seeing through a cell must make it less likely to be occupied";
    ordered(
        "p_free",
        p_free,
        p_free > 0.0 && p_free < 0.5,
        free,
        "above 0, below 0.5".to_owned(),
    );
    let occupied = "a hit in a cell must make it more likely to be occupied";
    ordered(
        "p_occupied",
        p_occupied,
        p_occupied > 0.5 && p_occupied < 1.0,
        occupied,
        "above 0.5, below 1".to_owned(),
    );
    let clamp = "at the limit one scan must still count, and the map must be able to forget";
    ordered(
        "p_min",
        p_min,
        p_min > 0.0 && p_min < p_free,
        clamp,
        format!("above 0, below p_free = {p_free}"),
    );
    ordered(
        "p_max",
        p_max,
        p_max > p_occupied && p_max < 1.0,
        clamp,
        format!("above p_occupied = {p_occupied}, below 1"),
    );
    let memory = "the grid must hold something, and the machine must hold the grid";
    checks.whole(
        &key("memory_limit_mb"),
        occupancy.memory_limit_mb.into(),
        1,
        1 << 20,
        memory,
    );
}

fn streaming(checks: &mut Checks, streaming: &StreamingConfig) {
    let budget = "less carries no map, and no link carries more";
    checks.whole(
        "streaming.budget_kbps",
        streaming.budget_kbps.into(),
        1,
        10_000_000,
        budget,
    );
    let store = "the store must hold something, and the machine must hold the store";
    checks.whole(
        "streaming.store_mb",
        streaming.store_mb.into(),
        1,
        1 << 20,
        store,
    );
    let period = "more often than that costs without showing more, less often shows nothing";
    checks.number(
        "streaming.publish_period_s",
        streaming.publish_period_s,
        Allowed::Within(0.02, 3600.0),
        period,
    );
}
