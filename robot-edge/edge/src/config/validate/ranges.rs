//! Which values each key may have by itself.

use std::fmt;

use toml::Value;

use super::super::config_layer::quoted;

use Allowed::{Between, Name, PositiveUpTo, Whole, Within};

const MAX_NAME_BYTES: usize = 255;

/// Sides of cells, metres.
pub(super) const CELL_M: Allowed = Within(0.01, 10.0);
/// Cells along an edge of a window: 2001² cells take some 60 bytes each.
pub(super) const CELLS_MAX: u32 = 2001;
/// Sides of voxels, metres.
pub(super) const VOXEL_M: Allowed = Within(0.01, 10.0);

/// Which values are allowed; infinity and not-a-number never are.
#[derive(Clone, Copy)]
pub(super) enum Allowed {
    /// From, to, both included.
    Within(f64, f64),
    /// From, to, both excluded.
    Between(f64, f64),
    /// Above zero, up to this.
    PositiveUpTo(f64),
    /// A whole number from, to, both included.
    Whole(u32, u32),
    Name,
}

/// Keys, what each may hold, and why.
pub(super) type Rule = (&'static [&'static str], Allowed, &'static str);

/// Keys whose range depends on nothing else.
pub(super) const RULES: &[Rule] = &[
    (&["ros2_output.map_frame"], Name, "a frame has a name"),
    (
        &[
            "ros2_output.map.rate_hz",
            "ros2_output.cost_map.rate_hz",
            "ros2_output.elevation.rate_hz",
            "ros2_output.voxels.rate_hz",
            "ros2_output.obstacles.rate_hz",
            "ros2_output.tf.rate_hz",
            "ros2_output.odometry.rate_hz",
            "ros2_output.path.rate_hz",
        ],
        PositiveUpTo(100.0),
        "faster than poses come, nothing is new",
    ),
    (
        &[
            "ros2_output.map.max_kb",
            "ros2_output.cost_map.max_kb",
            "ros2_output.elevation.max_kb",
            "ros2_output.voxels.max_kb",
            "ros2_output.obstacles.max_kb",
            "ros2_output.tf.max_kb",
            "ros2_output.odometry.max_kb",
            "ros2_output.path.max_kb",
        ],
        // Zenoh takes up to 1 GiB by default.
        Whole(1, 1_000_000),
        "a message has content, and receivers take no larger one",
    ),
    (
        &["planner.max_gap_ms"],
        Whole(50, 200),
        "it bounds how long the vehicle goes on after the planner is gone, and planners send 20 velocities a second",
    ),
    (
        &["vehicle.name"],
        Name,
        "it is used in summaries and messages",
    ),
    (
        &["vehicle.length_m", "vehicle.width_m", "vehicle.height_m"],
        PositiveUpTo(100.0),
        "it is the size of a ground robot or boat, in metres",
    ),
    (
        &["vehicle.bottom_z_m"],
        Within(-10.0, 10.0),
        "it is the height of the vehicle's lowest part above its base frame",
    ),
    (
        &["vehicle.max_speed_mps", "vehicle.max_turn_rate_radps"],
        PositiveUpTo(50.0),
        "limits must be finite and leave room to move",
    ),
    (
        &["localization.base_frame", "localization.fixed_frame"],
        Name,
        "a frame has a name",
    ),
    (
        &["localization.max_gap_s"],
        PositiveUpTo(60.0),
        POSES_FARTHER_AWAY,
    ),
    (
        &[
            "localization.max_pose_wait_s",
            "localization.max_extrapolation_s",
        ],
        Within(0.0, 60.0),
        POSES_FARTHER_AWAY,
    ),
    (
        &["localization.buffer_s"],
        PositiveUpTo(3600.0),
        "what is kept takes memory",
    ),
    (
        &["localization.max_waiting_scans"],
        Whole(1, 100_000),
        "what is kept takes memory",
    ),
    (
        &["localization.attitude_smoothing_s"],
        Within(0.0, 1.0),
        "the attitude must follow the vehicle; 0 smooths nothing",
    ),
    (
        &["localization.jump_m"],
        PositiveUpTo(10_000.0),
        "poses farther apart than the vehicle drives are a jump",
    ),
    (
        &["mapping.threads"],
        Whole(1, 2),
        "nothing is gained by more",
    ),
    (
        &[
            "mapping.occupancy.cell_m",
            "mapping.elevation.cell_m",
            "mapping.elevation.cell_y_m",
            "mapping.obstacle.cell_m",
            "mapping.obstacle.cell_y_m",
        ],
        CELL_M,
        "smaller cells are finer than lasers measure, larger ones than robots move",
    ),
    (
        &["mapping.occupancy.p_free"],
        Between(0.0, 0.5),
        "seeing through a cell must make it less likely to be occupied",
    ),
    (
        &["mapping.occupancy.p_occupied"],
        Between(0.5, 1.0),
        "a hit in a cell must make it more likely to be occupied",
    ),
    (
        &["mapping.occupancy.memory_limit_mb"],
        Whole(1, 1 << 20),
        "the grid must hold something, and the machine must hold the grid",
    ),
    (
        &["mapping.elevation.cells", "mapping.elevation.cells_y"],
        Whole(5, CELLS_MAX),
        "the window holds the vehicle, and the machine holds the window",
    ),
    (
        &["mapping.elevation.forget_s"],
        PositiveUpTo(3600.0),
        "what was glimpsed is remembered for a while, not for ever",
    ),
    (
        &["mapping.obstacle.h_pos_m", "mapping.obstacle.h_neg_m"],
        PositiveUpTo(10.0),
        "an obstacle is higher than nothing and no higher than a house",
    ),
    (
        &["mapping.obstacle.least_width_m"],
        Within(0.0, 10.0),
        "it is the width of what is no grass; 0: nothing is grass",
    ),
    (
        &["mapping.ground.epsilon_deg", "mapping.ground.eta_deg"],
        PositiveUpTo(45.0),
        PITCH,
    ),
    (&["mapping.ground.max_slope_deg"], Within(0.0, 45.0), PITCH),
    (
        &["mapping.octree.cell_m"],
        VOXEL_M,
        "smaller voxels are finer than lasers measure, larger ones than robots move",
    ),
    (
        &[
            "mapping.occupancy.cloud_min_height_m",
            "mapping.occupancy.cloud_max_height_m",
        ],
        Within(-10.0, 10.0),
        "it is a height above the vehicle's frame",
    ),
    (
        &["mapping.octree.p_min"],
        Within(0.001, 0.499),
        "a voxel that is seen through becomes free, so its probability falls below 0.5",
    ),
    (
        &["mapping.octree.p_max"],
        Within(0.501, 0.999),
        "a voxel that is hit becomes occupied, so its probability rises above 0.5",
    ),
    (
        &["mapping.octree.memory_limit_mb"],
        Whole(1, 65536),
        "there must be room for what surrounds the vehicle",
    ),
    (
        &["mapping.octree.fine_m"],
        Within(1.0, 10_000.0),
        "around the vehicle voxels stay as they are",
    ),
    (
        &["mapping.octree.disk_limit_mb"],
        Whole(0, 1_000_000),
        "a file keeps the voxels that memory has no room for",
    ),
    (
        &["mapping.cost.box_half_height_m"],
        Within(0.5, 50.0),
        "the box must hold the ground under the vehicle and what stands on it",
    ),
    (
        &["mapping.cost.critical_slope_deg"],
        Within(1.0, 80.0),
        "it lies between level and upright",
    ),
    (
        &["mapping.cost.period_s"],
        Within(0.01, 60.0),
        "updates cost time, and the map should not be old",
    ),
    (
        &[
            "mapping.rigidity.intra_threshold",
            "mapping.rigidity.inter_threshold",
            "mapping.shore.intra_threshold",
            "mapping.shore.inter_threshold",
        ],
        Within(0.0, 1.0),
        "it is a value of a metric, 0 to 1",
    ),
    (
        &["mapping.rigidity.traversable_vegetation_cost"],
        Within(0.0, 0.996),
        "1 would be lethal",
    ),
    (
        &["mapping.metrics.max_range_m"],
        PositiveUpTo(1000.0),
        "beams beyond it have no metrics",
    ),
    (
        &[
            "mapping.metrics.intra_sigma_m",
            "mapping.metrics.intra_width_m",
            "mapping.metrics.inter_full_m",
            "mapping.rigidity.least_width_m",
        ],
        PositiveUpTo(10.0),
        "it is a length of the things that are distinguished",
    ),
    (
        &[
            "mapping.metrics.intra_weight",
            "mapping.metrics.inter_weight",
        ],
        Within(0.001, 1.0),
        "it is the share of the newest value in the average",
    ),
    (
        &["mapping.shore.near_m"],
        Within(0.0, 1000.0),
        "it is the distance within which a Solid shore is divided; 0: never",
    ),
    (
        &["mapping.shore.cluster_m"],
        PositiveUpTo(100.0),
        "it is the gap between the voxels of one shore",
    ),
    (
        &["mapping.shore.solid_from_per_m2"],
        PositiveUpTo(10_000.0),
        SPARSE_BEFORE_SOLID,
    ),
    (
        &["mapping.shore.solid_above"],
        Within(0.0, 1.0),
        SPARSE_BEFORE_SOLID,
    ),
    (
        &["mapping.shore.period_s"],
        Within(0.01, 60.0),
        "clustering costs time, and classes should not be old",
    ),
    (
        &["streaming.budget_kbps"],
        Whole(1, 10_000_000),
        "less carries no map, and no link carries more",
    ),
    (
        &["streaming.tile_store_mb"],
        Whole(1, 1 << 20),
        "the store must hold something, and the machine must hold the store",
    ),
    (
        &["streaming.publish_period_s"],
        Within(0.02, 3600.0),
        "more often than that costs without showing more, less often shows nothing",
    ),
];

/// The same of one sensor.
pub(super) const SENSOR_RULES: &[Rule] = &[
    (
        &["topic", "tilt.topic"],
        Name,
        "no stream can have this name",
    ),
    (
        &["range_min_m"],
        Within(0.0, 10_000.0),
        "ranges are metres along a beam",
    ),
    (
        &["range_max_m"],
        PositiveUpTo(10_000.0),
        "ranges are metres along a beam",
    ),
    (
        &["thin_m"],
        PositiveUpTo(10.0),
        "it is the side of a cube in which one point is enough",
    ),
    (&["model"], Name, "a device has a name"),
    (
        &["beams"],
        Whole(1, 100_000),
        "every beam takes memory and time",
    ),
    (
        &["field_of_view_deg"],
        PositiveUpTo(360.0),
        "a planar sensor sweeps at most one turn",
    ),
    (&["rate_hz"], PositiveUpTo(1000.0), "sweeps take time"),
    (
        &["width_m"],
        PositiveUpTo(10.0),
        "what a bumper touches lies along its width",
    ),
    (
        &["p_hit"],
        Within(0.501, 0.999),
        "a hit must make a voxel more likely to be occupied",
    ),
    (
        &["p_miss"],
        Within(0.001, 0.499),
        "seeing through a voxel must make it less likely to be occupied",
    ),
    (
        &["divergence_mrad"],
        Within(0.0, 500.0),
        "it is the full angle of a beam's cone",
    ),
    // Two beams on either side, and the same five of the scan before.
    (
        &["min_neighbours"],
        Whole(0, 9),
        "a hit has no more neighbours",
    ),
    (
        &["tilt.joint", "left_joint", "right_joint"],
        Name,
        "no joint can have this name",
    ),
    (
        &["tilt.scale"],
        Within(-100.0, 100.0),
        "it is the gear between joint and sensor",
    ),
    (
        &["wheel_radius_m"],
        PositiveUpTo(10.0),
        "it turns the wheels' angles into metres",
    ),
    (
        &["time_offset_s", "tilt.time_offset_s"],
        Within(-3600.0, 3600.0),
        "it makes up for latency; clocks that differ by more cannot be reconciled",
    ),
    (
        &["mount.x_m", "mount.y_m", "mount.z_m"],
        Within(-100.0, 100.0),
        "a sensor sits on its vehicle",
    ),
    (
        &[
            "mount.roll_deg",
            "mount.pitch_deg",
            "mount.yaw_deg",
            "tilt.offset_deg",
        ],
        Within(-360.0, 360.0),
        "angles are degrees, at most one turn",
    ),
    (
        &["tilt.search.rest_deg", "tilt.search.lowest_deg"],
        Within(1.0, 85.0),
        "the beams are to meet the ground ahead",
    ),
];

const POSES_FARTHER_AWAY: &str = "poses farther away than that say nothing about a beam";
const PITCH: &str = "angles are degrees of pitch that a vehicle reaches";
pub(super) const SPARSE_BEFORE_SOLID: &str = "Sparse comes before Dense, and Dense before Solid";

impl Allowed {
    pub(super) fn contains(self, value: f64) -> bool {
        match self {
            Self::Within(least, most) => (least..=most).contains(&value),
            Self::Between(least, most) => least < value && value < most,
            Self::PositiveUpTo(most) => value > 0.0 && value <= most,
            Self::Whole(least, most) => (f64::from(least)..=f64::from(most)).contains(&value),
            Self::Name => false,
        }
    }

    /// The value as TOML, if it is not allowed.
    pub(super) fn refused(self, value: &Value) -> Option<String> {
        let is_allowed = |number| self.contains(number);
        match (self, value) {
            (Self::Name, Value::String(name)) => (!is_name(name)).then(|| in_quotes(name)),
            (Self::Whole(..), Value::Integer(whole)) => {
                (!is_allowed(*whole as f64)).then(|| whole.to_string())
            }
            (_, Value::Integer(whole)) => {
                let number = *whole as f64;
                (!is_allowed(number)).then(|| as_toml(number))
            }
            (_, Value::Float(number)) => (!is_allowed(*number)).then(|| as_toml(*number)),
            _ => None,
        }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Within(least, most) => write!(f, "{least} to {most}"),
            Self::Between(least, most) => write!(f, "above {least}, below {most}"),
            Self::PositiveUpTo(most) => write!(f, "above 0, up to {most}"),
            Self::Whole(least, most) => write!(f, "{least} to {most}"),
            Self::Name => write!(f, "1 to {MAX_NAME_BYTES} printable characters"),
        }
    }
}

fn is_name(text: &str) -> bool {
    !text.trim().is_empty() && text.len() <= MAX_NAME_BYTES && !text.contains(char::is_control)
}

pub(super) fn in_quotes(text: &str) -> String {
    format!("\"{}\"", quoted(text))
}

/// A number as the user would write it (`nan`, not `NaN`).
pub(super) fn as_toml(value: f64) -> String {
    Value::Float(value).to_string()
}
