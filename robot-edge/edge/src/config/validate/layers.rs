//! What the settings of layers must be together.

use super::Allowed::{Between, Within};
use super::Checks;
use super::ranges::{CELL_M, CELLS_MAX, SPARSE_BEFORE_SOLID, VOXEL_M, as_toml};
use crate::config::Config;
use mapping::MappingConfig;
use mapping::grid::CellSize;
use mapping::obstacle::ObstacleRule;
use mapping::occupancy_grid::OccupancyConfig;
use mapping::rigidity::RigidityRule;

pub(super) fn check(checks: &mut Checks, config: &Config) {
    occupancy(checks, &config.mapping.occupancy);
    layers(checks, &config.mapping);
    depth_limit(checks, config);
}

fn occupancy(checks: &mut Checks, occupancy: &OccupancyConfig) {
    let OccupancyConfig {
        p_free,
        p_occupied,
        p_prior,
        p_min,
        p_max,
        cloud_min_height_m,
        cloud_max_height_m,
        ..
    } = *occupancy;
    if cloud_min_height_m >= cloud_max_height_m {
        checks.issue(
            "mapping.occupancy.cloud_max_height_m",
            as_toml(cloud_max_height_m),
            "nothing of a cloud would be in the map",
            format!("above cloud_min_height_m = {cloud_min_height_m}"),
        );
    }
    let is_ordered = p_free < 0.5 && p_occupied > 0.5;
    if is_ordered && !Between(p_free, p_occupied).contains(p_prior) {
        let why =
            "a beam through a cell must make it less likely to be occupied, and a hit more likely";
        let allowed = format!("between p_free = {p_free} and p_occupied = {p_occupied}");
        checks.issue("mapping.occupancy.p_prior", as_toml(p_prior), why, allowed);
    }
    let clamp = "at the limit one scan must still count, and the map must be able to forget";
    if !Between(0.0, p_free).contains(p_min) {
        let allowed = format!("above 0, below p_free = {p_free}");
        checks.issue("mapping.occupancy.p_min", as_toml(p_min), clamp, allowed);
    }
    if !Between(p_occupied, 1.0).contains(p_max) {
        let allowed = format!("above p_occupied = {p_occupied}, below 1");
        checks.issue("mapping.occupancy.p_max", as_toml(p_max), clamp, allowed);
    }
}

fn layers(checks: &mut Checks, mapping: &MappingConfig) {
    if !mapping.occupancy.enabled && !mapping.elevation.enabled && !mapping.octree.enabled {
        checks.issue(
            "mapping.occupancy.enabled",
            "false".to_owned(),
            "nothing would be mapped",
            "true, here, in mapping.elevation.enabled or in mapping.octree.enabled".to_owned(),
        );
    }
    obstacle_window(checks, mapping);
    let voxel_m = mapping.octree.cell_m;
    // A voxel that is itself not allowed does not limit the box.
    if VOXEL_M.contains(voxel_m) {
        // 2000² columns of some 60 bytes.
        checks.number(
            "mapping.cost.box_m",
            mapping.cost.box_m,
            Within(1.0, 2000.0 * voxel_m),
            "the box holds the vehicle and at most 2000 columns along an edge",
        );
    }
    let shore = &mapping.shore;
    for (key, dense_from, solid_from) in [
        (
            "mapping.shore.dense_from_per_m2",
            shore.dense_from_per_m2,
            shore.solid_from_per_m2,
        ),
        (
            "mapping.shore.sparse_below",
            shore.sparse_below,
            shore.solid_above,
        ),
    ] {
        checks.number(
            key,
            dense_from,
            Within(0.0, solid_from),
            SPARSE_BEFORE_SOLID,
        );
    }
    let rigidity = &mapping.rigidity;
    if rigidity.enabled && rigidity.rule == RigidityRule::Width && mapping.shore.enabled {
        checks.issue(
            "mapping.rigidity.rule",
            "width".to_owned(),
            "shores are classified by IntraScan with the laser spot in it",
            "\"metrics\", or false in mapping.shore.enabled".to_owned(),
        );
    }
    let obstacle = &mapping.obstacle;
    if obstacle.rule == ObstacleRule::Mean && obstacle.least_width_m > 0.0 {
        checks.issue(
            "mapping.obstacle.least_width_m",
            obstacle.least_width_m.to_string(),
            "the rule \"mean\" does not use it",
            "0, or \"points\" in mapping.obstacle.rule".to_owned(),
        );
    }
    let (cost, octree) = (mapping.cost.enabled, mapping.octree.enabled);
    for (layer, is_enabled, needed, is_there) in [
        ("cost", cost, "octree", octree),
        ("rigidity", mapping.rigidity.enabled, "cost", cost),
        ("shore", mapping.shore.enabled, "cost", cost),
    ] {
        if is_enabled && !is_there {
            checks.issue(
                &format!("mapping.{layer}.enabled"),
                "true".to_owned(),
                "it is made of another layer, which is not mapped",
                format!("false, or true in mapping.{needed}.enabled, too"),
            );
        }
    }
}

/// Along each axis, in metres, it is at most that of the elevation map.
fn obstacle_window(checks: &mut Checks, mapping: &MappingConfig) {
    let (elevation, obstacle) = (&mapping.elevation, &mapping.obstacle);
    let [whole, own] = [elevation.size(), obstacle.size(elevation)].map(CellSize::sides_m);
    let mut is_too_large = false;
    for (axis, key) in ["mapping.obstacle.cells", "mapping.obstacle.cells_y"]
        .iter()
        .enumerate()
    {
        // A side that is itself not allowed limits nothing.
        if !CELL_M.contains(whole[axis]) || !CELL_M.contains(own[axis]) {
            continue;
        }
        let fit = f64::from(elevation.sides()[axis]) * whole[axis] / own[axis] + 1e-6;
        let (cells, most) = (obstacle.sides()[axis], (fit as u32).min(CELLS_MAX));
        // One number for both axes is refused once.
        let is_repeated = is_too_large && obstacle.cells_y.is_none();
        if !(1..=most).contains(&cells) && !is_repeated {
            is_too_large = true;
            checks.issue(
                key,
                cells.to_string(),
                "it is a part of the elevation map",
                format!("1 to {most}"),
            );
        }
    }
}

fn depth_limit(checks: &mut Checks, config: &Config) {
    let Some(min_depth_m) = config.teleop.collision_monitor.min_depth_m else {
        return;
    };
    let maps_depth = config.mapping.maps_depth(&config.range_models());
    if !(config.teleop.is_boat && maps_depth) {
        checks.issue(
            "teleop.collision_monitor.min_depth_m",
            as_toml(min_depth_m),
            "it is kept by a map of the depth of the water, and there is none",
            "on a boat only: with teleop.is_boat = true, mapping.cost.enabled = true, \
             mapping.cost.surface = \"water\" and a sensor of kind \"sonar\""
                .to_owned(),
        );
    }
}
