//! Which values make sense for elevation and obstacles.

use crate::config::checks::{Allowed, Checks};
use mapping::MappingConfig;

/// Most cells along an edge of a window: 4 million cells of some 60 bytes.
const MAX_CELLS: u32 = 2001;

pub(super) fn terrain(checks: &mut Checks, mapping: &MappingConfig) {
    let MappingConfig {
        occupancy,
        elevation,
        obstacle,
        ground,
        ..
    } = mapping;
    if !occupancy.enabled && !elevation.enabled && !mapping.octree.enabled {
        checks.issue(
            "mapping.occupancy.enabled",
            "false".to_owned(),
            "nothing would be mapped",
            "true, here, in mapping.elevation.enabled or in mapping.octree.enabled".to_owned(),
        );
    }
    let mut number = |key: &str, value: f64, allowed, why| {
        checks.number(&format!("mapping.{key}"), value, allowed, why);
    };
    let cell = "smaller cells are finer than lasers measure, larger ones than robots move";
    number(
        "elevation.cell_m",
        elevation.cell_m,
        Allowed::Within(0.01, 10.0),
        cell,
    );
    let forget = "what was glimpsed is remembered for a while, not for ever";
    number(
        "elevation.forget_s",
        elevation.forget_s,
        Allowed::PositiveUpTo(3600.0),
        forget,
    );
    let height = "an obstacle is higher than nothing and no higher than a house";
    number(
        "obstacle.h_pos_m",
        obstacle.h_pos_m,
        Allowed::PositiveUpTo(10.0),
        height,
    );
    number(
        "obstacle.h_neg_m",
        obstacle.h_neg_m,
        Allowed::PositiveUpTo(10.0),
        height,
    );
    let angle = "angles are degrees of pitch that a vehicle reaches";
    number(
        "ground.epsilon_deg",
        ground.epsilon_deg,
        Allowed::PositiveUpTo(45.0),
        angle,
    );
    number(
        "ground.eta_deg",
        ground.eta_deg,
        Allowed::PositiveUpTo(45.0),
        angle,
    );
    number(
        "ground.max_slope_deg",
        ground.max_slope_deg,
        Allowed::Within(0.0, 45.0),
        angle,
    );
    let window = "the window holds the vehicle, and the machine holds the window";
    let cells = u64::from(elevation.cells);
    checks.whole(
        "mapping.elevation.cells",
        cells,
        5,
        MAX_CELLS.into(),
        window,
    );
    let inside = "it is a part of the elevation map";
    let cells = u64::from(obstacle.cells);
    checks.whole(
        "mapping.obstacle.cells",
        cells,
        1,
        elevation.cells.into(),
        inside,
    );
}
