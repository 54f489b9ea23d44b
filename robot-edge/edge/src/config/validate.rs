//! Which values make sense, alone and together.

use self::localization::{localization, pose_sensors};
use self::sensors::sensor;
use self::terrain::terrain;
use self::voxels::voxels;
use super::checks::{Allowed, Checks, as_toml};
use super::error::ConfigIssue;
use super::layer::quoted;
use super::{Config, VehicleConfig};
use crate::publishing::config::StreamingConfig;
use crate::server::config::LinkConfig;
use mapping::MappingConfig;
use mapping::occupancy_grid::OccupancyConfig;
use network::endpoints::bulk_endpoint;

mod localization;
mod sensors;
mod terrain;
mod voxels;

/// Most sensors on one vehicle.
pub(super) const MAX_SENSORS: usize = 32;

impl Config {
    /// Everything that is wrong with the values; empty where nothing is.
    pub fn validate(&self) -> Vec<ConfigIssue> {
        let mut checks = Checks::default();
        vehicle(&mut checks, &self.vehicle);
        let sensors = self.sensors.len();
        if !(1..=MAX_SENSORS).contains(&sensors) {
            let why = "maps are made of what sensors say, and each takes memory";
            checks.issue(
                "sensors",
                format!("a table of {sensors}"),
                why,
                format!("1 to {MAX_SENSORS} sensors"),
            );
        }
        for (name, config) in self.sensors.iter().take(MAX_SENSORS) {
            sensor(&mut checks, name, config);
        }
        localization(&mut checks, &self.localization);
        pose_sensors(&mut checks, self);
        mapping(&mut checks, &self.mapping);
        terrain(&mut checks, &self.mapping);
        voxels(&mut checks, &self.mapping);
        streaming(&mut checks, &self.streaming);
        link(&mut checks, &self.link);
        let mut issues = checks.into_issues();
        issues.extend(self.teleop.check().into_iter().map(ConfigIssue::from));
        issues.extend(self.motors.check());
        issues
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
            checks.issue(
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
        "it is used in summaries and messages",
    );
    let body = "it is the size of a ground robot or boat, in metres";
    let size = Allowed::PositiveUpTo(100.0);
    checks.number("vehicle.length_m", vehicle.length_m, size, body);
    checks.number("vehicle.width_m", vehicle.width_m, size, body);
    checks.number("vehicle.height_m", vehicle.height_m, size, body);
    checks.number(
        "vehicle.bottom_z_m",
        vehicle.bottom_z_m,
        Allowed::Within(-10.0, 10.0),
        "it is the height of the vehicle's lowest part above its base frame",
    );
    // Not a number is not within either.
    if vehicle.length_m > 0.0
        && !(-vehicle.length_m..=vehicle.length_m).contains(&vehicle.footprint_offset_m)
    {
        checks.issue(
            "vehicle.footprint_offset_m",
            as_toml(vehicle.footprint_offset_m),
            "the base frame is at the vehicle",
            format!("-{0} to {0}, length_m", vehicle.length_m),
        );
    }
    if let Some(wheelbase_m) = vehicle.wheelbase_m
        && !(wheelbase_m > 0.0 && wheelbase_m <= vehicle.length_m)
    {
        checks.issue(
            "vehicle.wheelbase_m",
            as_toml(wheelbase_m),
            "the axles are under the vehicle",
            format!("above 0, up to length_m = {}", vehicle.length_m),
        );
    }
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
            checks.issue(&key(name), as_toml(value), why, allowed);
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
        "streaming.tile_store_mb",
        streaming.tile_store_mb.into(),
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
