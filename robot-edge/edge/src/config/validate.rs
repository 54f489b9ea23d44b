//! Which values are allowed, alone and together.

use std::fmt;

use toml::{Table, Value};

use super::config_layer::{join, quoted};
use super::error::{ConfigIssue, Problem};
use super::{Config, FixesAndAttitude, LinkConfig, SensorConfig, VehicleConfig, WheelsAndAttitude};
use drivers::config::{DeviceConfig, Output};
use localization::{LocalizationConfig, PoseSource};
use mapping::registered_scan::ScanKind;
use network::endpoints::bulk_endpoint;

use Allowed::{Between, Name, PositiveUpTo, Whole, Within};

mod layers;

pub(super) const MAX_SENSORS: usize = 32;

const MAX_NAME_BYTES: usize = 255;

/// Sides of cells, metres.
const CELL_M: Allowed = Within(0.01, 10.0);
/// Cells along an edge of a window: 2001² cells take some 60 bytes each.
const CELLS_MAX: u32 = 2001;
/// Sides of voxels, metres.
const VOXEL_M: Allowed = Within(0.01, 10.0);

/// Which values are allowed; infinity and not-a-number never are.
#[derive(Clone, Copy)]
enum Allowed {
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
type Rule = (&'static [&'static str], Allowed, &'static str);

/// Keys whose range depends on nothing else.
const RULES: &[Rule] = &[
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
const SENSOR_RULES: &[Rule] = &[
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
const SPARSE_BEFORE_SOLID: &str = "Sparse comes before Dense, and Dense before Solid";

impl Allowed {
    fn contains(self, value: f64) -> bool {
        match self {
            Self::Within(least, most) => (least..=most).contains(&value),
            Self::Between(least, most) => least < value && value < most,
            Self::PositiveUpTo(most) => value > 0.0 && value <= most,
            Self::Whole(least, most) => (f64::from(least)..=f64::from(most)).contains(&value),
            Self::Name => false,
        }
    }

    /// The value as TOML, if it is not allowed.
    fn refused(self, value: &Value) -> Option<String> {
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

fn in_quotes(text: &str) -> String {
    format!("\"{}\"", quoted(text))
}

/// A number as the user would write it (`nan`, not `NaN`).
fn as_toml(value: f64) -> String {
    Value::Float(value).to_string()
}

/// Everything that is wrong with the values of `config`, whose settings are `merged`.
pub(super) fn validate(config: &Config, merged: &Table) -> Vec<ConfigIssue> {
    let mut checks = Checks::default();
    checks.rules("", merged, RULES);
    let sensors = merged.get("sensors").and_then(Value::as_table);
    for (name, sensor) in sensors.into_iter().flatten().take(MAX_SENSORS) {
        if let Value::Table(settings) = sensor {
            checks.rules(&join("sensors", name), settings, SENSOR_RULES);
        }
    }
    vehicle(&mut checks, &config.vehicle);
    let sensors = config.sensors.len();
    if !(1..=MAX_SENSORS).contains(&sensors) {
        checks.issue(
            "sensors",
            format!("a table of {sensors}"),
            "maps are made of what sensors say, and each takes memory",
            format!("1 to {MAX_SENSORS} sensors"),
        );
    }
    for (name, config) in config.sensors.iter().take(MAX_SENSORS) {
        sensor(&mut checks, name, config);
    }
    localization(&mut checks, &config.localization);
    pose_sensors(&mut checks, config);
    layers::check(&mut checks, config);
    link(&mut checks, &config.link);
    let mut issues = checks.0;
    issues.extend(config.teleop.check().into_iter().map(ConfigIssue::from));
    let locomotion = config.motors.locomotion().check(&config.teleop);
    issues.extend(locomotion.into_iter().map(ConfigIssue::from));
    issues.extend(config.motors.check());
    issues.extend(config.ros2_output.check(config));
    issues.extend(devices(config, merged));
    issues
}

#[derive(Default)]
struct Checks(Vec<ConfigIssue>);

impl Checks {
    fn issue(&mut self, key: &str, value: String, why: &'static str, allowed: String) {
        self.0.push(ConfigIssue {
            origin: None,
            key: key.to_owned(),
            problem: Problem::NotAllowed {
                value,
                why,
                allowed,
            },
        });
    }

    /// Checks the values that `settings`, the table at `path`, has; defaults are allowed.
    fn rules(&mut self, path: &str, settings: &Table, rules: &[Rule]) {
        for &(keys, allowed, why) in rules {
            for key in keys {
                let mut parts = key.split('.');
                let first = parts.next().and_then(|part| settings.get(part));
                let value = parts.fold(first, |value, part| value?.get(part));
                if let Some(refused) = value.and_then(|value| allowed.refused(value)) {
                    self.issue(&join(path, key), refused, why, allowed.to_string());
                }
            }
        }
    }

    fn number(&mut self, key: &str, value: f64, allowed: Allowed, why: &'static str) {
        if !allowed.contains(value) {
            self.issue(key, as_toml(value), why, allowed.to_string());
        }
    }
}

fn vehicle(checks: &mut Checks, vehicle: &VehicleConfig) {
    let length_m = vehicle.length_m;
    // Not a number is not within either.
    if length_m > 0.0 && !(-length_m..=length_m).contains(&vehicle.footprint_offset_m) {
        checks.issue(
            "vehicle.footprint_offset_m",
            as_toml(vehicle.footprint_offset_m),
            "the base frame is at the vehicle",
            format!("-{length_m} to {length_m}, length_m"),
        );
    }
    if let Some(wheelbase_m) = vehicle.wheelbase_m
        && !PositiveUpTo(length_m).contains(wheelbase_m)
    {
        checks.issue(
            "vehicle.wheelbase_m",
            as_toml(wheelbase_m),
            "the axles are under the vehicle",
            format!("above 0, up to length_m = {length_m}"),
        );
    }
}

fn sensor(checks: &mut Checks, name: &str, sensor: &SensorConfig) {
    let key = |key: &str| format!("sensors.{name}.{key}");
    if let Some(range) = sensor.range_sensor() {
        if let (Some(range_min_m), Some(range_max_m)) = (range.range_min_m, range.range_max_m)
            && range_min_m >= range_max_m
        {
            checks.issue(
                &key("range_max_m"),
                as_toml(range_max_m),
                "no range could be a hit",
                format!("above range_min_m = {range_min_m}"),
            );
        }
        let may_be_silent = !matches!(range.scan_kind, ScanKind::Beams | ScanKind::Cloud);
        if may_be_silent && range.topic.is_none() {
            checks.issue(
                &key("topic"),
                "nothing".to_owned(),
                "several streams may have its type, and it may be silent when streams are chosen",
                "the name of its topic".to_owned(),
            );
        }
        if range.scan_kind == (ScanKind::Contact { width_m: 0.0 }) {
            checks.issue(
                &key("width_m"),
                "nothing".to_owned(),
                "what a bumper touches lies along its width",
                "above 0, up to 10".to_owned(),
            );
        }
        if let Some(tilt) = &range.tilt
            && tilt.scale == 0.0
        {
            checks.issue(
                &key("tilt.scale"),
                as_toml(tilt.scale),
                "the sensor would not tilt",
                "-100 to 100, not 0".to_owned(),
            );
        }
        if let Some(search) = range.tilt.as_ref().and_then(|tilt| tilt.search)
            && search.lowest_deg <= search.rest_deg
        {
            checks.issue(
                &key("tilt.search.lowest_deg"),
                as_toml(search.lowest_deg),
                "it is to look nearer than at rest",
                format!("above rest_deg = {}", search.rest_deg),
            );
        }
    }
    if let SensorConfig::WheelEncoders(encoders) = sensor
        && encoders.left_joint == encoders.right_joint
    {
        checks.issue(
            &key("right_joint"),
            in_quotes(&encoders.right_joint),
            "the vehicle moves by the mean of two wheels",
            "a joint other than left_joint".to_owned(),
        );
    }
}

fn localization(checks: &mut Checks, localization: &LocalizationConfig) {
    let fixed_frame = localization.fixed_frame.as_deref();
    let frames = [
        ("localization.base_frame", Some(&*localization.base_frame)),
        ("localization.fixed_frame", fixed_frame),
    ];
    for (key, frame) in frames {
        if let Some(frame) = frame
            && let Some(bare) = frame.strip_prefix('/')
        {
            checks.issue(
                key,
                in_quotes(frame),
                "frames have no leading slash in tf2, so it would match none",
                in_quotes(bare),
            );
        }
    }
    if fixed_frame == Some(&localization.base_frame) {
        checks.issue(
            "localization.fixed_frame",
            in_quotes(&localization.base_frame),
            "the map would move with the vehicle",
            "a frame other than localization.base_frame".to_owned(),
        );
    }
    let least_s = localization.max_gap_s.max(localization.max_pose_wait_s);
    if localization.buffer_s < least_s {
        checks.issue(
            "localization.buffer_s",
            as_toml(localization.buffer_s),
            "poses would be forgotten before the scans that wait for them are placed",
            format!("at least max_gap_s and max_pose_wait_s, {least_s}"),
        );
    }
}

/// The sensors that poses are made of must exist.
fn pose_sensors(checks: &mut Checks, config: &Config) {
    let (source, why, kind, found) = match config.localization.source {
        PoseSource::Auto
        | PoseSource::Tf
        | PoseSource::Odometry
        | PoseSource::Log
        | PoseSource::Scan
        | PoseSource::ScanWheels
        | PoseSource::ScanImu
        | PoseSource::Static => return,
        PoseSource::Wheels => (
            "wheels",
            "poses are reckoned from the wheels and the attitude",
            "wheel_encoders",
            WheelsAndAttitude::of(&config.sensors).map(|_| ()),
        ),
        PoseSource::Gps | PoseSource::ScanGps => (
            "gps",
            "poses are made of the receiver's positions and the attitude",
            "gps",
            FixesAndAttitude::of(&config.sensors).map(|_| ()),
        ),
    };
    if let Err((others, imus)) = found {
        checks.issue(
            "localization.source",
            in_quotes(source),
            why,
            format!(
                "with one sensor of kind \"{kind}\" (there are {others}) and one of kind \"imu\" (there \
                 are {imus})"
            ),
        );
    }
}

fn devices(config: &Config, merged: &Table) -> Vec<ConfigIssue> {
    let given = |name: &str| {
        let table = merged.get("devices").and_then(|devices| devices.get(name));
        let table = table.and_then(Value::as_table);
        table.into_iter().flatten().map(|(key, _)| key.as_str())
    };
    let problems = DeviceConfig::check_all(&config.devices, given);
    let issue = |problem: drivers::config::Problem| ConfigIssue {
        origin: None,
        key: problem.key,
        problem: Problem::Other(problem.text),
    };
    let mut issues: Vec<_> = problems.into_iter().map(issue).collect();
    for (name, device) in &config.devices {
        let topic = format!("/{name}");
        let takes = |(sensor, of): &(&String, &SensorConfig)| match of.topic() {
            Some(named) => named == topic,
            None => *sensor == name,
        };
        let Some((sensor, of)) = config.sensors.iter().find(takes) else {
            continue;
        };
        let gives_clouds = device.kind.output() == Output::Clouds;
        if gives_clouds != matches!(of, SensorConfig::Lidar(_)) {
            let (kind, of) = (device.kind, of.kind());
            issues.push(ConfigIssue {
                origin: None,
                key: format!("devices.{name}.kind"),
                problem: Problem::Other(format!(
                    "\"{kind}\" measures nothing for the sensor `{sensor}` of kind \"{of}\": sensors of kind \"lidar\", and only \
                     these, have the devices velodyne, ouster and livox"
                )),
            });
        }
    }
    issues
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

#[cfg(test)]
mod tests {
    use super::super::schema::{Expected, Schema};
    use super::*;

    #[test]
    fn every_number_has_a_range() {
        let schema = Schema::of_config().unwrap();
        let of_sensors = SensorConfig::KINDS
            .iter()
            .flat_map(|kind| schema.paths("s", Some(kind)))
            .filter_map(|(path, expected)| {
                let key = path.strip_prefix("sensors.s.")?;
                Some((key.to_owned(), expected))
            });
        let of_sensors: Vec<_> = of_sensors.collect();
        let mut of_config = schema.paths("s", None);
        // The crate of the devices checks theirs.
        of_config.retain(|(path, _)| !path.starts_with("sensors") && !path.starts_with("devices"));
        let by_code = [
            "vehicle.footprint_offset_m",
            "vehicle.wheelbase_m",
            "mapping.occupancy.p_min",
            "mapping.occupancy.p_max",
            "mapping.occupancy.p_prior",
            "mapping.obstacle.cells",
            "mapping.obstacle.cells_y",
            "mapping.cost.box_m",
            "mapping.shore.dense_from_per_m2",
            "mapping.shore.sparse_below",
        ];
        for (rules, keys) in [(RULES, of_config), (SENSOR_RULES, of_sensors)] {
            let rule_of = |key: &str| rules.iter().find(|(keys, ..)| keys.contains(&key));
            for (key, expected) in &keys {
                let is_elsewhere = key.starts_with("teleop.") || key.starts_with("motors.");
                let fits = match (expected, rule_of(key)) {
                    (Expected::Number, Some((_, allowed, _))) => {
                        !matches!(allowed, Allowed::Whole(..) | Allowed::Name)
                    }
                    (Expected::Integer(_), Some((_, allowed, _))) => {
                        matches!(allowed, Allowed::Whole(..))
                    }
                    (Expected::Number | Expected::Integer(_), None) => {
                        is_elsewhere || by_code.contains(&&**key)
                    }
                    (Expected::Text, Some((_, allowed, _))) => matches!(allowed, Allowed::Name),
                    (_, rule) => rule.is_none(),
                };
                assert!(fits, "{key}");
            }
            for rule in rules.iter().flat_map(|(keys, ..)| *keys) {
                assert!(keys.iter().any(|(key, _)| key == rule), "{rule}");
            }
        }
    }
}
