#![expect(
    clippy::float_cmp,
    reason = "settings are what was written, to the last bit"
)]

use proptest::prelude::*;

use super::*;
use crate::config::error::{Origin, Suggestion};
use crate::config::presets::PRESETS;
use crate::config::sensors::{
    ImuConfig, RangeSensorConfig, SensorConfig, WheelEncodersConfig, WheelsAndAttitude,
};
use localization::PoseSource;

fn sets(settings: &[&str]) -> Vec<Override> {
    settings.iter().map(|text| text.parse().unwrap()).collect()
}

fn issues(result: Result<Config, ConfigError>) -> Vec<ConfigIssue> {
    match result {
        Err(ConfigError::Issues(issues)) => issues,
        other => panic!("{other:?}"),
    }
}

fn set_issue(setting: &str) -> String {
    let issues = issues(load("generic2d", &sets(&[setting])));
    assert_eq!(issues.len(), 1, "{setting}: {issues:?}");
    issues[0].to_string()
}

fn laser(config: &Config) -> &RangeSensorConfig {
    let SensorConfig::LaserScan(laser) = &config.sensors["laser"] else {
        panic!("{:?}", config.sensors);
    };
    laser
}

fn file(text: impl AsRef<[u8]>) -> Result<Config, ConfigError> {
    file_with(text, &[])
}

fn file_with(text: impl AsRef<[u8]>, overrides: &[Override]) -> Result<Config, ConfigError> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("v.toml");
    std::fs::write(&path, text).unwrap();
    load(path.to_str().unwrap(), overrides)
}

/// The preset with every key behind `#` set.
fn uncommented(text: &str) -> String {
    let is_key = |line: &str| {
        let is_table = line.starts_with('[');
        let name = line.split_once(" = ").map(|(key, _)| key);
        is_table || name.is_some_and(|key| !key.contains([' ', '`']))
    };
    let uncomment = |line: &str| match line.strip_prefix("# ") {
        Some(rest) if is_key(rest) => format!("{rest}\n"),
        Some(_) | None => format!("{line}\n"),
    };
    text.lines().map(uncomment).collect()
}

/// What can stand in one file: no depth limit on land, no output of layers that are not mapped, and of the kinds of motors one;
/// not a Roboteq where the wheels have other modes than it can drive.
fn compatible(uncommented: &str) -> String {
    let maps_depth =
        !uncommented.contains("is_boat = false") && uncommented.contains("kind = \"sonar\"");
    let lines = uncommented.split_inclusive('\n');
    let lines = lines.filter(|line| maps_depth || !line.starts_with("min_depth_m"));
    let uncommented: String = lines.collect();
    let (uncommented, _output) = uncommented.split_once("[ros2_output]").unwrap();
    let (before, motors) = uncommented.split_once("[motors.roboteq]").unwrap();
    let (_roboteq, twist) = motors.split_once("[motors.ros2_twist]").unwrap();
    if before.contains("differential = false") {
        format!("{before}[motors.ros2_twist]{twist}")
    } else {
        uncommented
            .split_once("[motors.mavlink]")
            .unwrap()
            .0
            .to_owned()
    }
}

fn flattened(prefix: &str, table: &Table, keys: &mut Vec<String>) {
    for (key, value) in table {
        let path = join(prefix, key);
        if let Value::Table(inner) = value {
            flattened(&path, inner, keys);
        } else {
            keys.push(path);
        }
    }
}

#[test]
fn presets_load_and_the_generic_one_is_the_default() {
    for preset in PRESETS {
        let config = load(preset.name, &[]).unwrap();
        let vehicle = preset.name.trim_end_matches("-document");
        assert_eq!(config.vehicle.name, vehicle);
    }
    assert_eq!(load("generic2d", &[]).unwrap(), Config::default());
}

#[test]
fn presets_list_every_key_and_their_examples_are_valid() {
    let schema = Schema::of_config().unwrap();
    let is_whole = |preset: &&Preset| !preset.text.contains("\npreset = ");
    for preset in PRESETS.iter().filter(is_whole) {
        let text = uncommented(preset.text);
        let mut listed = Vec::new();
        flattened("", &text.parse().unwrap(), &mut listed);
        listed.sort();
        let config = file(compatible(&text)).unwrap();
        let mut known: Vec<String> = config
            .sensors
            .iter()
            .flat_map(|(name, sensor)| schema.paths(name, Some(sensor.kind())))
            .filter(|(path, expected)| *expected != Expected::Table && !path.starts_with("devices"))
            .map(|(path, _)| path)
            .collect();
        known.sort();
        known.dedup();
        assert_eq!(listed, known, "{}", preset.name);
    }
}

#[test]
fn the_generic_preset_shows_every_kind_of_sensor_with_its_defaults() {
    let config = file(compatible(&uncommented(GENERIC.text))).unwrap();
    let mut kinds: Vec<_> = config.sensors.values().map(SensorConfig::kind).collect();
    kinds.sort_unstable();
    assert_eq!(
        kinds,
        [
            "bumper",
            "gps",
            "imu",
            "laser_scan",
            "lidar",
            "sonar",
            "ultrasonic",
            "wheel_encoders"
        ]
    );
    let sensors = WheelsAndAttitude::of(&config.sensors).unwrap();
    let topic = |topic: &str| Some(topic.to_owned());
    assert_eq!(
        sensors.encoders,
        (
            "wheels",
            &WheelEncodersConfig {
                topic: topic("/joint_states"),
                ..WheelEncodersConfig::default()
            }
        )
    );
    assert_eq!(
        sensors.imu,
        (
            "ahrs",
            &ImuConfig {
                topic: topic("/imu/data"),
                ..ImuConfig::default()
            }
        )
    );
}

#[test]
fn pioneer_has_the_figures_of_its_data_sheets() {
    let config = load("pioneer", &[]).unwrap();
    let laser = laser(&config);
    assert_eq!((laser.beams, laser.rate_hz), (Some(683), Some(10.0)));
    assert_eq!(
        (laser.range_min_m, laser.range_max_m),
        (Some(0.02), Some(5.6))
    );
    assert_eq!(
        (config.vehicle.length_m, config.vehicle.width_m),
        (0.455, 0.381)
    );
}

#[test]
fn flags_win_over_set_over_file_over_preset() {
    let text = "preset = \"pioneer\"\n[sensors.laser]\ntopic = \"/file\"\nrange_max_m = 4.0\n\
                [mapping.occupancy]\ncell_m = 0.2";
    let topic = |config: &Config| laser(config).topic.clone().unwrap();
    let from_file = file(text).unwrap();
    assert_eq!(from_file.vehicle.length_m, 0.455);
    assert_eq!(from_file.mapping.occupancy.cell_m, 0.2);
    assert_eq!(topic(&from_file), "/file");

    let mut overrides = sets(&["mapping.occupancy.cell_m=1", "sensors.laser.topic=/set"]);
    let set = file_with(text, &overrides).unwrap();
    assert_eq!(set.mapping.occupancy.cell_m, 1.0);
    assert_eq!(topic(&set), "/set");

    overrides.push(Override::topic("laser=/flag").unwrap());
    assert_eq!(topic(&file_with(text, &overrides).unwrap()), "/flag");
}

const SIZE: &str = "vehicle = { length_m = 1, width_m = 0.6, height_m = 0.8 }\n";

#[test]
fn a_file_without_a_preset_gives_the_size_of_its_vehicle() {
    let says: Vec<_> = issues(file("[vehicle]\nname = \"mine\"\nheight_m = 1"))
        .iter()
        .map(ToString::to_string)
        .collect();
    let why =
        "missing: measure the vehicle, in metres; or start from another by `preset = \"NAME\"`";
    let missing = ["length_m", "width_m"].map(|key| format!("`vehicle.{key}`: {why}"));
    assert_eq!(says, missing);
    assert_eq!(file(SIZE).unwrap().vehicle.length_m, 1.0);
    assert_eq!(
        file("preset = \"generic2d\"").unwrap().vehicle.length_m,
        0.5
    );
}

#[test]
fn a_file_without_a_preset_names_all_its_sensors() {
    let sized = |text: &str| file(format!("{SIZE}{text}")).unwrap();
    let rear = sized("[sensors.rear]\nkind = \"laser_scan\"\nmount.yaw_deg = 180");
    assert_eq!(rear.sensors.keys().collect::<Vec<_>>(), ["rear"]);
    // What it does not say of a sensor that the generic vehicle has too, it has as the generic vehicle.
    let laser = sized("sensors.laser.time_offset_s = -0.04");
    assert_eq!(self::laser(&laser).time_offset_s, -0.04);
    let both = file("preset = \"pioneer\"\nsensors.rear.kind = \"laser_scan\"").unwrap();
    assert_eq!(both.sensors.len(), 2);
}

#[test]
fn set_takes_toml_and_bare_words() {
    let config = load(
        "generic2d",
        &sets(&[
            "localization.source=tf",
            "localization.fixed_frame = \"map\"",
            "vehicle.name=my robot",
            "mapping.occupancy={cell_m = 5e-2, miss = 'free'}",
            "streaming.budget_kbps=1_000",
        ]),
    )
    .unwrap();
    assert_eq!(config.localization.source, PoseSource::Tf);
    assert_eq!(config.localization.fixed_frame.as_deref(), Some("map"));
    assert_eq!(config.vehicle.name, "my robot");
    assert_eq!(
        (
            config.mapping.occupancy.cell_m,
            config.mapping.occupancy.p_free
        ),
        (0.05, 0.3)
    );
    assert_eq!(config.streaming.budget_kbps, 1000);
}

#[test]
fn misspelt_keys_are_named_with_the_nearest() {
    for (setting, key, suggestion) in [
        (
            "mapping.occupancy.cell=1",
            "mapping.occupancy.cell",
            "mapping.occupancy.cell_m",
        ),
        (
            "mapping.ocupancy.cell_m=1",
            "mapping.ocupancy.cell_m",
            "mapping.occupancy.cell_m",
        ),
        ("cell_m=1", "cell_m", "mapping.elevation.cell_m"),
        ("vehicle.lenght_m=1", "vehicle.lenght_m", "vehicle.length_m"),
        (
            "sensors.laser.mount.pitch=1",
            "sensors.laser.mount.pitch",
            "sensors.laser.mount.pitch_deg",
        ),
        (
            "sensor.laser.range_max_m=1",
            "sensor.laser.range_max_m",
            "sensors.laser.range_max_m",
        ),
        (
            "streaming.budget_kpbs=1",
            "streaming.budget_kpbs",
            "streaming.budget_kbps",
        ),
    ] {
        let expected = format!("--set: `{key}`: unknown key: did you mean `{suggestion}`?");
        assert_eq!(set_issue(setting), expected);
    }
    assert!(set_issue("radio.call_sign=1").contains("unknown key: the nearest that exists is `"));
}

#[test]
fn a_sensor_that_is_not_there_is_not_invented() {
    let expected = "the vehicle has no sensor of this name; it has: laser. \
                    To add one, set its `kind` (laser_scan, sonar, wheel_encoders, imu, gps, ultrasonic, lidar, bumper)";
    assert_eq!(
        set_issue("sensors.lazer.range_max_m=5"),
        format!("--set: `sensors.lazer`: {expected}")
    );
    let topic = Override::topic("sonar=/scan").unwrap();
    assert_eq!(
        issues(load("pioneer", &[topic]))[0].to_string(),
        format!("--topic: `sensors.sonar`: {expected}")
    );
}

#[test]
fn the_keys_of_a_sensor_are_those_of_its_kind_whoever_names_it() {
    let vehicle = "preset = \"pioneer\"\n[sensors.wheels]\nkind = \"wheel_encoders\"\n\
                   [sensors.ahrs]\nkind = \"imu\"\n";
    let message = |text: &str, settings: &[&str]| {
        let issues = issues(file_with(format!("{vehicle}{text}"), &sets(settings)));
        assert_eq!(issues.len(), 1, "{issues:?}");
        let ConfigIssue { key, problem, .. } = &issues[0];
        format!("{key}: {problem}")
    };
    assert_eq!(
        message("mount.yaw_dg = 90", &[]),
        "sensors.ahrs.mount.yaw_dg: unknown key: did you mean `sensors.ahrs.mount.yaw_deg`?"
    );
    assert_eq!(
        message("", &["sensors.wheels.radius_m=0.1"]),
        "sensors.wheels.radius_m: unknown key: did you mean `sensors.wheels.wheel_radius_m`?"
    );
    // What a laser has, encoders need not have.
    assert_eq!(
        message("", &["sensors.wheels.range_max_m=5"]),
        "sensors.wheels.range_max_m: unknown key: the nearest that exists is \
         `sensors.wheels.right_joint`"
    );
    assert_eq!(
        message("", &["sensors.wheels.wheel_radius_m=big"]),
        "sensors.wheels.wheel_radius_m: expected a number, found the text \"big\""
    );
    // The kind may be named after the key, and may change: then nothing of the other kind is left.
    let last = sets(&["sensors.back.topic=/imu", "sensors.back.kind=imu"]);
    let config = load("pioneer", &last).unwrap();
    assert_eq!(config.sensors["back"].topic(), Some("/imu"));
    let config = load("pioneer", &sets(&["sensors.laser.kind=wheel_encoders"])).unwrap();
    let encoders = WheelEncodersConfig::default();
    assert_eq!(
        config.sensors["laser"],
        SensorConfig::WheelEncoders(encoders)
    );
}

#[test]
fn values_of_wheels_and_attitude_that_make_no_sense_are_refused() {
    let with = "preset = \"pioneer\"\n[sensors.wheels]\nkind = \"wheel_encoders\"\n\
                [sensors.ahrs]\nkind = \"imu\"\n[sensors.second]\nkind = \"imu\"";
    for (setting, expected) in [
        (
            "sensors.wheels.wheel_radius_m=0",
            "0.0 is not allowed: it turns the wheels' angles into metres; \
             allowed: above 0, up to 10",
        ),
        (
            "sensors.wheels.right_joint=left_wheel_joint",
            "\"left_wheel_joint\" is not allowed: the vehicle moves by the mean of two wheels; \
             allowed: a joint other than left_joint",
        ),
        (
            "sensors.wheels.left_joint=",
            "\"\" is not allowed: no joint can have this name; \
             allowed: 1 to 255 printable characters",
        ),
        (
            "sensors.wheels.time_offset_s=nan",
            "nan is not allowed: it makes up for latency; clocks that differ by more cannot be \
             reconciled; allowed: -3600 to 3600",
        ),
        (
            "sensors.ahrs.time_offset_s=1e9",
            "1000000000.0 is not allowed: it makes up for latency; clocks that differ by more cannot \
             be reconciled; allowed: -3600 to 3600",
        ),
        (
            "sensors.ahrs.mount.pitch_deg=400",
            "400.0 is not allowed: angles are degrees, at most one turn; allowed: -360 to 360",
        ),
        (
            "sensors.ahrs.topic=",
            "\"\" is not allowed: no stream can have this name; allowed: 1 to 255 printable \
             characters",
        ),
        (
            "localization.source=wheels",
            "\"wheels\" is not allowed: poses are reckoned from the wheels and the attitude; allowed: \
             with one sensor of kind \"wheel_encoders\" (there are 1) and one of kind \"imu\" (there \
             are 2)",
        ),
    ] {
        let issues = issues(file_with(with, &sets(&[setting])));
        assert_eq!(issues.len(), 1, "{issues:?}");
        let (key, _) = setting.split_once('=').unwrap();
        assert_eq!(issues[0].to_string(), format!("--set: `{key}`: {expected}"));
    }
}

#[test]
fn wrong_types_are_named_with_what_is_expected() {
    for (setting, message) in [
        (
            "mapping.occupancy.cell_m=small",
            "expected a number, found the text \"small\"",
        ),
        (
            "mapping.threads=1.5",
            "expected a whole number, not negative, found 1.5",
        ),
        (
            "streaming.tile_store_mb=-1",
            "expected a whole number, not negative, found -1",
        ),
        (
            "streaming.tile_store_mb=99999999999",
            "expected a whole number, not negative, found 99999999999",
        ),
        ("vehicle.name=7", "expected text in quotes, found 7"),
        (
            "vehicle.name=[1]",
            "expected text in quotes, found an array",
        ),
        (
            "vehicle=pioneer",
            "expected a table of settings, found the text \"pioneer\"",
        ),
        ("vehicle.name.x=1", "expected text in quotes, found a table"),
        (
            "mapping.occupancy.miss=fre",
            "expected one of \"unknown\", \"free\", found the text \"fre\"",
        ),
        (
            "sensors.laser.kind=radar",
            "expected one of \"laser_scan\", \"sonar\", \"wheel_encoders\", \"imu\", \"gps\", \
             \"ultrasonic\", \"lidar\", \"bumper\", found the text \"radar\"",
        ),
    ] {
        let key = setting.split('=').next().unwrap().trim_end_matches(".x");
        assert_eq!(set_issue(setting), format!("--set: `{key}`: {message}"));
    }
}

#[test]
fn a_sensor_of_kind_lidar_and_no_other_has_a_device_that_gives_clouds() {
    let sick = "kind = \"sick_cola\"\ntcp = \"192.168.0.1:2111\"";
    let velodyne = "kind = \"velodyne\"\nudp_listen = \"0.0.0.0:2368\"";
    let lidar = "preset = \"generic3d\"\n";
    let renamed = "preset = \"generic3d\"\nsensors.lidar.topic = \"/mast\"\n";
    let of = |preset: &str, device: &str, settings: &str| {
        file(format!("{preset}[devices.{device}]\n{settings}"))
    };
    assert!(of(lidar, "lidar", velodyne).is_ok());
    assert!(of(renamed, "mast", velodyne).is_ok());
    // No sensor takes it.
    assert!(of(renamed, "lidar", sick).is_ok());
    for (preset, device, settings, says) in [
        (
            lidar,
            "lidar",
            sick,
            "\"sick_cola\" measures nothing for the sensor `lidar` of kind \"lidar\"",
        ),
        (
            renamed,
            "mast",
            sick,
            "\"sick_cola\" measures nothing for the sensor `lidar` of kind \"lidar\"",
        ),
        (
            "preset = \"generic2d\"\n",
            "laser",
            velodyne,
            "\"velodyne\" measures nothing for the sensor `laser` of kind \"laser_scan\"",
        ),
    ] {
        let issues = issues(of(preset, device, settings));
        let text = issues[0].to_string();
        assert!(issues.len() == 1 && text.contains(says), "{text}");
    }
}

#[test]
fn all_faults_in_files_are_reported_with_line_and_column() {
    let text = "[vehicle]\nname = \"é\"\n  width = 1\n[localization]\nsource = \"stars\"\n\
                max_pose_wait_s = true\n[mapping]\noccupancy = { miss = \"é\", cell = 1 }";
    let issues = issues(file(text));
    let reported: Vec<(usize, usize, &str)> = issues
        .iter()
        .map(|issue| match &issue.origin {
            Some(Origin::File { line, column, .. }) => (*line, *column, issue.key.as_str()),
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(
        reported,
        [
            (3, 3, "vehicle.width"),
            (5, 1, "localization.source"),
            (6, 1, "localization.max_pose_wait_s"),
            (8, 15, "mapping.occupancy.miss"),
            (8, 27, "mapping.occupancy.cell"),
        ]
    );
    let hint = Suggestion {
        name: "vehicle.width_m".to_owned(),
        is_close: true,
    };
    assert_eq!(
        issues[0].problem,
        Problem::UnknownKey {
            suggestion: Some(hint)
        }
    );
}

#[test]
fn files_that_are_not_configurations_are_refused() {
    let message = |result: Result<Config, ConfigError>| result.unwrap_err().to_string();
    let syntax = message(file("[vehicle]\nname = \"a"));
    assert!(syntax.contains("v.toml:2:"), "{syntax}");
    assert!(message(file("a = 1\na = 2")).contains("v.toml:2:1: duplicate key"));
    assert!(message(file([b'a', 0xff])).contains("not UTF-8 at byte 1"));
    assert!(message(file(vec![b'#'; 1 << 21])).contains("larger than 1048576 bytes"));
    assert!(message(file("a".repeat(1 << 20))).len() < 1000);
    assert!(message(file("a.".repeat(100_000) + "b = 1")).contains("v.toml:1:"));
    assert!(message(file(format!("a = {}", "[".repeat(1 << 19)))).contains("v.toml:1:"));
    assert!(
        message(file("preset = \"pioner\"")).contains(
            "v.toml:1:1: `preset`: there is no vehicle `pioner`: did you mean `pioneer`?"
        )
    );
    assert!(message(file("preset = 3")).contains("expected text in quotes, found 3"));
    assert!(message(file("\"vehicle.name\" = 'a'")).contains("unknown key"));
    assert!(message(load("/nowhere/v.toml", &[])).starts_with("/nowhere/v.toml: "));
    assert!(message(load("/", &[])).starts_with("/: "));
}

#[test]
fn an_unknown_vehicle_gets_the_list() {
    let error = load("pionneer", &[]).unwrap_err().to_string();
    assert!(
        error.starts_with(
            "there is no vehicle `pionneer`: did you mean `pioneer`? Presets: generic2d, generic3d, holos, holos-tilt, introbot, lidar16, lidar64, pioneer, riverwatch, riverwatch-lidar."
        ),
        "{error}"
    );
    let error = load("toaster", &[]).unwrap_err().to_string();
    assert!(
        error.starts_with("there is no vehicle `toaster`. Presets: generic2d, generic3d, holos, holos-tilt, introbot, lidar16, lidar64, pioneer, riverwatch, riverwatch-lidar."),
        "{error}"
    );
}

#[test]
fn values_that_make_no_sense_are_refused() {
    for (setting, allowed) in [
        ("mapping.occupancy.cell_m=0", "0.01 to 10"),
        ("mapping.occupancy.cell_m=nan", "0.01 to 10"),
        ("mapping.occupancy.cell_m=inf", "0.01 to 10"),
        ("mapping.occupancy.p_free=0.5", "above 0, below 0.5"),
        ("mapping.occupancy.p_occupied=0.5", "above 0.5, below 1"),
        ("mapping.occupancy.p_min=0.3", "above 0, below p_free = 0.3"),
        ("mapping.occupancy.p_min=0", "above 0, below p_free = 0.3"),
        (
            "mapping.occupancy.p_prior=0.6",
            "between p_free = 0.3 and p_occupied = 0.6",
        ),
        (
            "mapping.occupancy.p_max=1",
            "above p_occupied = 0.6, below 1",
        ),
        ("mapping.threads=3", "1 to 2"),
        ("vehicle.width_m=-1", "above 0, up to 100"),
        ("vehicle.name=", "1 to 255 printable characters"),
        ("sensors.laser.mount.yaw_deg=nan", "-360 to 360"),
        ("sensors.laser.range_max_m=0", "above 0, up to 10000"),
        ("sensors.laser.beams=0", "1 to 100000"),
        ("localization.base_frame=/base_link", "\"base_link\""),
        (
            "localization.fixed_frame=base_link",
            "a frame other than localization.base_frame",
        ),
        (
            "localization.buffer_s=0.2",
            "at least max_gap_s and max_pose_wait_s, 0.5",
        ),
        ("localization.max_waiting_scans=0", "1 to 100000"),
        ("localization.attitude_smoothing_s=2", "0 to 1"),
        ("localization.jump_m=0", "above 0, up to 10000"),
        (
            "localization.source=wheels",
            "with one sensor of kind \"wheel_encoders\" (there are 0) and one of kind \"imu\" \
             (there are 0)",
        ),
        ("streaming.publish_period_s=0", "0.02 to 3600"),
    ] {
        let (key, value) = setting.split_once('=').unwrap();
        let message = set_issue(setting);
        assert!(
            message.starts_with(&format!("--set: `{key}`: ")),
            "{message}"
        );
        assert!(
            message.contains(value) && message.ends_with(&format!("; allowed: {allowed}")),
            "{message}"
        );
    }
}

#[test]
fn the_box_is_not_judged_by_a_cell_that_is_not_allowed() {
    for cell in ["-3", "0", "0.001", "11", "nan"] {
        let message = set_issue(&format!("mapping.octree.cell_m={cell}"));
        assert!(message.contains("`mapping.octree.cell_m`"), "{message}");
    }
    let message = set_issue("mapping.cost.box_m=500");
    assert!(message.ends_with("; allowed: 1 to 200"), "{message}");
    load("generic2d", &sets(&["mapping.cost.box_m=40"])).unwrap();
}

#[test]
fn all_faults_of_values_are_reported_with_the_source_of_the_value() {
    let text =
        "[vehicle]\nlength_m = -1\nwidth_m = 1\nheight_m = 1\n[sensors.laser]\nrange_min_m = 6";
    let reported: Vec<String> = issues(file_with(text, &sets(&["sensors.laser.range_max_m=5"])))
        .iter()
        .map(|issue| match &issue.origin {
            Some(Origin::File { line, .. }) => format!("{} {line}", issue.key),
            other => format!("{} {other:?}", issue.key),
        })
        .collect();
    assert_eq!(
        reported,
        ["vehicle.length_m 2", "sensors.laser.range_max_m Some(Set)"]
    );
}

#[test]
fn many_faults_stay_readable_and_cheap() {
    let settings = |count: usize, setting: &str| -> String {
        let lines = (0..count).map(|i| ["sensors.s", &i.to_string(), setting, "\n"].concat());
        lines.collect()
    };
    let unknown = file(settings(40_000, ".x = 1"));
    assert!((1..=200).contains(&issues(unknown).len()));
    let too_many = file(SIZE.to_owned() + &settings(30_000, ".kind='laser_scan'"));
    assert_eq!(issues(too_many).len(), 1);
}

proptest! {
    #[test]
    fn no_setting_panics(
        key in prop_oneof![
            "[a-z_.]{0,30}",
            Just("mapping.occupancy.cell_m".to_owned()),
            Just("sensors.laser".to_owned()),
            Just("vehicle".to_owned()),
            any::<String>(),
        ],
        value in prop_oneof!["[0-9a-z'\"{}\\[\\]=., -]{0,20}", any::<String>()],
    ) {
        if let Ok(setting) = format!("{key}={value}").parse()
            && let Err(error) = load("generic2d", &[setting])
        {
            prop_assert!((10..10_000).contains(&error.to_string().len()));
        }
    }

    #[test]
    fn no_file_panics(text in "(\\[?[a-z.]{0,12}\\]? ?=? ?[0-9a-z\"'{}.-]{0,8}\n){0,6}") {
        drop(file(text));
    }
}
