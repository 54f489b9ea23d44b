//! Which values are allowed, alone and together.

use toml::{Table, Value};

use super::config_layer::{join, quoted};
use super::error::{ConfigIssue, Problem};
use super::{Config, FixesAndAttitude, LinkConfig, SensorConfig, VehicleConfig, WheelsAndAttitude};
use drivers::config::{DeviceConfig, Output};
use localization::{LocalizationConfig, PoseSource};
use mapping::registered_scan::ScanKind;
use network::endpoints::bulk_endpoint;

mod layers;
mod ranges;

use Allowed::PositiveUpTo;
use ranges::{Allowed, RULES, Rule, SENSOR_RULES, as_toml, in_quotes};

pub(super) const MAX_SENSORS: usize = 32;

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
    issues.extend(
        config
            .planner
            .iter()
            .flat_map(|planner| planner.check(config)),
    );
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
