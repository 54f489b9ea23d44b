//! The streams of each simulated vehicle.

use std::collections::BTreeMap;

use measurement::pose;
use measurement::scan::Scan;
use measurement::{GeodeticFix, ImuSample};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use recording::Selection;
use recording::writer::McapWriter;

use super::sensor::WHEEL_JOINTS;
use super::*;
use crate::attitude::Attitude;
use crate::fixtures::vehicle;
use crate::gps::FixNoise;

/// 4.2 m straight over a board that lifts one axle at a time.
const BUMP: &str = r#"name = "bump"
vehicle = "holos"
noise = { range_m = 0.01, dropout = 0.005 }
start = { x_m = 0.0, y_m = 0.0, yaw_deg = 90.0 }

[path]
speed_mps = 0.5
turn_rate_degps = 60.0
waypoints = [{ x_m = 0.0, y_m = 4.2 }]

[[solids]]
shape = "box"
centre_m = [0.0, 1.5, 0.0215]
size_m = [2.0, 0.2, 0.043]

[[solids]]
shape = "wall"
from_m = [-4.0, 9.0]
to_m = [4.0, 9.0]
thickness_m = 0.2
height_m = 2.5
"#;

/// 3 m along level ground, whose top is z = 0.
const GROUND: &str = r#"name = "ground"
vehicle = "introbot"
noise = { range_m = 0.0, dropout = 0.0, attitude_deg = 0.0 }
start = { x_m = 0.0, y_m = 0.0, yaw_deg = 36.86989764584402 }

[path]
speed_mps = 0.5
turn_rate_degps = 60.0
waypoints = [{ x_m = 2.4, y_m = 1.8 }]

[[solids]]
shape = "plane"
"#;

/// 6 m over a flat bed 5.5 m down, 5 m below the sonar; a quay 30 m ahead stands on it.
const LAKE: &str = r#"name = "lake"
vehicle = "riverwatch"
noise = { range_m = 0.0, dropout = 0.0 }
start = { x_m = 0.0, y_m = 0.0, yaw_deg = 90.0 }

[path]
speed_mps = 1.5
turn_rate_degps = 10.0
waypoints = [{ x_m = 0.0, y_m = 6.0 }]

[[solids]]
shape = "plane"
point_m = [0.0, 0.0, -5.5]

[[solids]]
shape = "box"
centre_m = [0.0, 33.0, 0.0]
size_m = [400.0, 6.0, 20.0]
"#;

fn world_of(text: &str, changes: &[(&str, &str)]) -> World {
    World::parse("w.toml", &changed(text, changes)).unwrap()
}

fn changed(text: &str, changes: &[(&str, &str)]) -> String {
    changes.iter().fold(text.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    })
}

/// [`BUMP`] with more noise.
fn bump(noise: &str) -> World {
    world_of(BUMP, &[("0.005", &format!("0.005{noise}"))])
}

/// Measurements with the names of their streams.
type Named = (String, Measurement);

pub(super) fn run(world: &World, options: SimulationOptions) -> Vec<Named> {
    let mut source = SimulatedSource::new(world, options).unwrap();
    let streams = source.streams().to_vec();
    std::iter::from_fn(|| source.next_measurement())
        .map(|measurement| {
            let stream = &streams[usize::from(measurement.stream.0)];
            (stream.name.clone(), measurement)
        })
        .collect()
}

fn seeded(seed: u64) -> SimulationOptions {
    SimulationOptions {
        seed,
        ..SimulationOptions::default()
    }
}

fn seconds(measurement: &Measurement) -> f64 {
    measurement.stamp.since(START).as_secs_f64()
}

fn scans<'a>(run: &'a [Named], stream: &str) -> Vec<(f64, &'a Scan)> {
    let scan = |(name, measurement): &'a Named| {
        let MeasurementData::Scan { scan, .. } = &measurement.data else {
            return None;
        };
        (name == stream).then(|| (seconds(measurement), scan))
    };
    run.iter().filter_map(scan).collect()
}

fn imu(measurement: &Measurement) -> Option<ImuSample> {
    if let MeasurementData::Imu(sample) = measurement.data {
        Some(sample)
    } else {
        None
    }
}

fn rotation(sample: &ImuSample) -> UnitQuaternion<f64> {
    let pose = pose::from_parts([0.0; 3], sample.orientation_xyzw.unwrap()).unwrap();
    pose.rotation
}

#[test]
fn each_vehicle_has_its_streams_at_their_rates_in_the_order_of_stamps() {
    // 8.4 s, 6 s and 4 s. The sweeps of the boat's laser follow each other without a gap, so the last ends at 4 s
    // less one beam.
    for (text, at_nanos, at_once, counts) in [
        (
            BUMP,
            40_000_000,
            "/tf /odom /joint_states /imu/data /scan",
            "/imu/data imu_link 841, /joint_states base_link 421, /odom odom 841, /scan laser 210, \
             /tf odom 841, /tf_static base_link 2",
        ),
        (
            GROUND,
            40_000_000,
            "/tf /odom /joint_states /imu/data /scan",
            "/bumper/front  121, /bumper/rear  121, \
             /imu/data imu_link 601, /joint_states base_link 601, /odom odom 601, /scan laser 150, \
             /tf odom 601, /tf_static base_link 1, \
             /ultrasonic/front_left ultrasonic_front_left 61, \
             /ultrasonic/front_right ultrasonic_front_right 61, \
             /ultrasonic/left ultrasonic_left 61, \
             /ultrasonic/rear_left ultrasonic_rear_left 61, \
             /ultrasonic/rear_right ultrasonic_rear_right 61, \
             /ultrasonic/right ultrasonic_right 61",
        ),
        (
            LAKE,
            200_000_000,
            "/tf /odom /joint_states /imu/data /fix /scan /sonar",
            "/fix gps_link 41, /imu/data imu_link 401, /joint_states base_link 201, /odom odom 201, \
             /scan laser 20, /sonar sonar 41, /tf odom 201, /tf_static base_link 3",
        ),
    ] {
        let run = run(&world_of(text, &[]), seeded(1));
        let mut found = BTreeMap::new();
        for (name, measurement) in &run {
            *found.entry((name, &measurement.frame)).or_insert(0) += 1;
        }
        let found = found
            .iter()
            .map(|((name, frame), n)| format!("{name} {frame} {n}"));
        assert_eq!(found.collect::<Vec<_>>().join(", "), counts);
        let together = run
            .iter()
            .filter(|(_, m)| m.stamp.since(START).as_nanos() == at_nanos);
        let together: Vec<&str> = together.map(|(name, _)| name.as_str()).collect();
        assert_eq!(together.join(" "), at_once);
        assert!(
            run.windows(2)
                .all(|pair| pair[0].1.stamp <= pair[1].1.stamp)
        );
    }
}

#[test]
fn static_transforms_are_the_mounts_of_sensors_that_do_not_tilt() {
    for (text, expected) in [
        (BUMP, vec!["laser", "imu_link"]),
        (GROUND, vec!["imu_link"]),
        (LAKE, vec!["sonar", "imu_link", "gps_link"]),
    ] {
        let run = run(&world_of(text, &[]), seeded(1));
        let child = |(_, m): &Named| match &m.data {
            MeasurementData::Transform {
                child,
                is_static: true,
                ..
            } => Some(child.to_string()),
            _ => None,
        };
        assert_eq!(run.iter().filter_map(child).collect::<Vec<_>>(), expected);
    }
}

#[test]
fn a_recording_holds_every_stream() {
    let folder = tempfile::tempdir().unwrap();
    for (text, name) in [(BUMP, "holos"), (LAKE, "riverwatch")] {
        let path = folder.path().join(name).with_extension("mcap");
        let options = SimulationOptions {
            duration_s: Some(1.0),
            ..seeded(1)
        };
        let mut source = SimulatedSource::new(&world_of(text, &[]), options).unwrap();
        let streams = source.streams().to_vec();
        let mut writer = McapWriter::create(&path, Some(name)).unwrap();
        let mut written = Vec::new();
        while let Some(measurement) = source.next_measurement() {
            let stream = &streams[usize::from(measurement.stream.0)];
            writer.write(stream, &measurement).unwrap();
            written.push((stream.clone(), measurement));
        }
        assert_eq!(writer.not_written(), 0);
        writer.finish().unwrap();

        let mut reader = recording::open(&path, Selection::All).unwrap();
        for (stream, measurement) in written {
            let read = reader.next_measurement().unwrap().unwrap();
            let read_stream = &reader.streams()[usize::from(read.stream.0)].stream;
            assert_eq!(read_stream, &stream);
            let numbered_alike = Measurement {
                stream: measurement.stream,
                ..read
            };
            // Not-a-number is not equal to itself.
            assert_eq!(format!("{numbered_alike:?}"), format!("{measurement:?}"));
        }
        assert!(reader.next_measurement().unwrap().is_none());
    }
}

#[test]
fn invalid_waves_and_errors_are_refused() {
    let waves = |height: &str, second: &str| {
        format!("[waves]\n{height}\nperiod_s = 2.0\nheading_deg = 0.0\n{second}\n\n[path]")
    };
    let steep = waves("height_m = 1.0", "");
    let second = waves(
        "height_m = 0.1",
        "second = { height_m = 9.0, period_s = 5.0, heading_deg = 1.0 }",
    );
    let negative = waves("height_m = -0.1", "");
    let noise = |noise: &str| format!("dropout = 0.0, {noise}");
    for (from, to, expected) in [
        (
            "[path]",
            steep,
            "7: `height_m`: waves of 2 s break above 0.89 m, a seventh of their length",
        ),
        (
            "[path]",
            second,
            "10: `height_m`: waves of 5 s break above 5.57 m, a seventh of their length",
        ),
        (
            "[path]",
            negative,
            "7: `height_m`: -0.1 is not between 0 and 1000000",
        ),
        (
            "dropout = 0.0",
            noise("joint_lag_s = 11.0"),
            "3: `joint_lag_s`: 11 is not between 0 and 10",
        ),
        (
            "dropout = 0.0",
            noise("fix_m = -1.0"),
            "3: `fix_m`: -1 is not between 0 and 1000000",
        ),
        (
            "dropout = 0.0",
            noise("attitude_deg = -0.1"),
            "3: `attitude_deg`: -0.1 is not between 0 and 180",
        ),
        (
            "dropout = 0.0",
            noise("encoder_scale_error = -1.0"),
            "3: `encoder_scale_error`: -1 is not between -0.9 and 10",
        ),
    ] {
        let text = changed(LAKE, &[(from, &to)]);
        let error = World::parse("w.toml", &text).err().unwrap().to_string();
        assert_eq!(error, format!("w.toml:{expected}"));
    }
    let on_land = waves("height_m = 0.1", "");
    let text = changed(LAKE, &[("riverwatch", "introbot"), ("[path]", &on_land)]);
    let error = World::parse("w.toml", &text).err().unwrap().to_string();
    assert!(
        error.ends_with("waves move boats only, and `introbot` is none"),
        "{error}"
    );
}

#[test]
fn what_the_sensors_say_is_the_motion() {
    let world = bump(", attitude_deg = 0.0");
    let motion = Motion::new(&world);
    let mut lowest_pitch_rad = 0.0_f64;
    for (_, measurement) in run(&world, seeded(1)) {
        let truth = motion.world_from_base(seconds(&measurement));
        if let MeasurementData::Odometry { odom_from_base, .. } = &measurement.data {
            assert_eq!(*odom_from_base, truth);
            lowest_pitch_rad = lowest_pitch_rad.min(Attitude::of(&truth.rotation).pitch_rad);
        } else if let Some(sample) = imu(&measurement) {
            assert!(rotation(&sample).angle_to(&truth.rotation) < 1e-7);
        }
    }
    assert!(
        (lowest_pitch_rad.to_degrees() + 4.48).abs() < 0.02,
        "{lowest_pitch_rad}"
    );
}

/// Way of the left and the right wheels, metres.
fn wheels_m(measurement: &Measurement) -> Option<[f64; 2]> {
    let MeasurementData::Joints(joints) = &measurement.data else {
        return None;
    };
    let names: Vec<&str> = joints.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, WHEEL_JOINTS);
    Some([joints[0].1 * 0.125, joints[1].1 * 0.125])
}

#[test]
fn the_world_or_the_options_choose_the_errors() {
    let last_wheels_m = |world: &World, options| {
        let run = run(world, options);
        let last = run.iter().rev().find_map(|(_, m)| wheels_m(m));
        last.unwrap()[0]
    };
    let exact_m = last_wheels_m(&bump(""), seeded(1));
    assert!((4.2..4.23).contains(&exact_m), "{exact_m}");
    let of_world_m = last_wheels_m(&bump(", encoder_scale_error = 0.048"), seeded(1));
    assert!((of_world_m - 1.048 * exact_m).abs() < 1e-3, "{of_world_m}");
    let of_options_m = last_wheels_m(
        &bump(", encoder_scale_error = 0.048"),
        SimulationOptions {
            encoder_error: Some(0.07),
            ..seeded(1)
        },
    );
    assert!(
        (of_options_m - 1.07 * exact_m).abs() < 1e-3,
        "{of_options_m}"
    );

    // Root mean square of roll, which is truly 0, over 841 readings.
    let noise_deg = |world: &World, options| {
        let errors_deg2: Vec<f64> = run(world, options)
            .iter()
            .filter_map(|(_, m)| imu(m))
            .map(|sample| Attitude::of(&rotation(&sample)).roll_rad.to_degrees())
            .map(|deg| deg * deg)
            .collect();
        libm::sqrt(errors_deg2.iter().sum::<f64>() / errors_deg2.len() as f64)
    };
    assert!((noise_deg(&bump(""), seeded(1)) - 0.1).abs() < 0.01);
    assert!((noise_deg(&bump(", attitude_deg = 0.5"), seeded(1)) - 0.5).abs() < 0.05);
    let quiet = SimulationOptions {
        attitude_noise_rad: Some(0.0),
        ..seeded(1)
    };
    assert!(noise_deg(&bump(", attitude_deg = 0.5"), quiet) < 1e-6);
}

#[test]
fn noise_is_reproducible_and_independent_between_sensors() {
    let of = |stream: &str, run: &[Named]| -> String {
        let measurements: Vec<_> = run.iter().filter(|(name, _)| name == stream).collect();
        format!("{measurements:?}")
    };
    let first = run(&bump(""), seeded(1));
    assert_eq!(
        format!("{first:?}"),
        format!("{:?}", run(&bump(""), seeded(1)))
    );
    let other = run(&bump(""), seeded(2));
    assert_ne!(of("/imu/data", &first), of("/imu/data", &other));
    assert_eq!(of("/odom", &first), of("/odom", &other));
    let slipping = SimulationOptions {
        wheel_slip: Some(0.05),
        attitude_noise_rad: Some(0.0),
        ..seeded(1)
    };
    let slipping = run(&bump(""), slipping);
    for stream in ["/tf", "/odom", "/scan"] {
        assert_eq!(of(stream, &first), of(stream, &slipping), "{stream}");
    }
    assert_ne!(of("/joint_states", &first), of("/joint_states", &slipping));
}

#[test]
fn the_laser_of_holos_meets_level_ground_8_metres_ahead() {
    let mount = vehicle("holos").laser.base_from_mount;
    // [LOD §4]: 1.08 m / cos 82.5°.
    let forward = mount.rotation * Vector3::x();
    assert!((mount.translation.z / -forward.z - 8.274).abs() < 1e-3);
}

#[test]
fn ramp_measurements_match_stored_digest() {
    let options = SimulationOptions {
        duration_s: Some(20.0),
        ..seeded(3)
    };
    let mut hasher = blake3::Hasher::new();
    for (stream, measurement) in run(&World::load("ramp").unwrap(), options) {
        hasher.update(format!("{stream} {measurement:?}\n").as_bytes());
    }
    // Written down once: what changes it changes every experiment.
    assert_eq!(hasher.finalize().to_string(), FIRST_20_SECONDS_OF_RAMP);
}

const FIRST_20_SECONDS_OF_RAMP: &str =
    "edfb3acd1bbb3b6cdc44ed8d4dd1100448cd6526c69bb8f11f0bbf4782d66222";

/// Times and angles of the tilt joint.
fn tilts(run: &[Named]) -> Vec<(f64, f64)> {
    let tilt = |(stream, measurement): &Named| {
        let MeasurementData::Joints(joints) = &measurement.data else {
            return None;
        };
        let [(name, angle_rad)] = &joints[..] else {
            panic!("{joints:?}")
        };
        assert_eq!(
            (stream.as_str(), name.as_str()),
            ("/joint_states", "laser_tilt_joint")
        );
        Some((seconds(measurement), *angle_rad))
    };
    run.iter().filter_map(tilt).collect()
}

#[test]
fn a_servo_turns_to_the_goal_of_its_joint_from_what_was_measured_on() {
    let text = BUMP.replacen("vehicle = \"holos\"", "vehicle = \"holos-tilt\"", 1);
    let text = text + "[[solids]]\nshape = \"plane\"\n";
    let mut source = SimulatedSource::new(&world_of(&text, &[]), seeded(0)).unwrap();
    let joint = "laser_tilt_joint";
    let mut angles_rad = Vec::new();
    let (mut turned_at, mut ahead_m) = (None, f32::NAN);
    while let Some(measurement) = source.next_measurement() {
        match &measurement.data {
            MeasurementData::Joints(joints) if joints[0].0 == joint => {
                angles_rad.push((seconds(&measurement), joints[0].1));
            }
            MeasurementData::Scan { scan, .. } => ahead_m = scan.ranges_m[240],
            _ => {}
        }
        if seconds(&measurement) > 0.5 && turned_at.is_none() {
            source.turn(joint, 0.4);
            turned_at = Some(source.frontier().since(START).as_secs_f64());
        }
        if seconds(&measurement) > 2.0 {
            break;
        }
    }
    let of = |at_s: f64| {
        let found = angles_rad.iter().find(|(time_s, _)| *time_s >= at_s - 1e-6);
        found.unwrap().1
    };
    let turned_at = turned_at.unwrap();
    let rate_radps = (of(turned_at + 0.1) - of(turned_at)) / 0.1;
    let swings = |at_s: f64| (of(at_s) - of(0.0)).abs();
    assert!(swings(0.4) > 0.1, "to and fro before");
    assert!(rate_radps.abs() < 95.0_f64.to_radians(), "{rate_radps}");
    for at_s in [1.2, 1.6, 2.0] {
        assert!((of(at_s) - 0.4).abs() < 1e-3, "{at_s} {}", of(at_s));
    }
    // 1.08 m / sin 0.4.
    assert!((ahead_m - 2.77).abs() < 0.1, "{ahead_m}");
}

#[test]
fn the_joint_swings_by_30_degrees_in_4_seconds() {
    let tilts = tilts(&run(&world_of(GROUND, &[]), seeded(0)));
    let tilt_deg = |time_s: f64| {
        let near = |&&(at_s, _): &&(f64, f64)| (at_s - time_s).abs() < 1e-6;
        tilts.iter().find(near).unwrap().1.to_degrees()
    };
    // 37.5°/s between ramps of 0.4 s; the encoder's step is 0.01°.
    for (time_s, expected_deg) in [
        (0.0, -30.0),
        (0.4, -22.5),
        (1.0, 0.0),
        (1.4, 15.0),
        (2.0, 30.0),
        (3.0, 0.0),
        (4.0, -30.0),
        (5.4, 15.0),
    ] {
        let found_deg = tilt_deg(time_s);
        assert!(
            (found_deg - expected_deg).abs() <= 0.005 + 1e-9,
            "{time_s} {found_deg}"
        );
    }
}

#[test]
fn a_lagging_encoder_says_old_angles_with_new_stamps() {
    let honest = tilts(&run(&world_of(GROUND, &[]), seeded(0)));
    let check = |lagging: Vec<(f64, f64)>| {
        assert_eq!(honest.len(), lagging.len());
        // 0.2 s are 20 readings.
        for (now, before) in lagging.iter().skip(20).zip(&honest) {
            assert!((now.0 - before.0 - 0.2).abs() < 1e-6);
            // 0.2 s is no number of the machine: now and then it falls on the other side of a step.
            let step_rad = 0.01_f64.to_radians();
            assert!(
                (now.1 - before.1).abs() < 1.01 * step_rad,
                "{now:?} {before:?}"
            );
        }
        let behind_deg = (lagging[100].1 - honest[100].1).to_degrees();
        assert!((behind_deg + 7.5).abs() < 0.011, "{behind_deg}");
    };
    let noise = (
        "attitude_deg = 0.0",
        "attitude_deg = 0.0, joint_lag_s = 0.2",
    );
    let lagging = run(&world_of(GROUND, &[noise]), seeded(0));
    check(tilts(&lagging));
    let options = SimulationOptions {
        joint_lag_s: Some(0.2),
        ..seeded(0)
    };
    check(tilts(&run(&world_of(GROUND, &[]), options)));
    // What the laser measures is where it is, not where it says it is.
    let honest_run = run(&world_of(GROUND, &[]), seeded(0));
    assert!(scans(&honest_run, "/scan") == scans(&lagging, "/scan"));
}

#[test]
fn hits_lie_on_the_ground_with_the_mount_pitched_by_the_joint() {
    let world = world_of(GROUND, &[]);
    let run = run(&world, seeded(0));
    let motion = Motion::new(&world);
    let laser = vehicle("introbot").laser;
    let tilts = tilts(&run);
    let tilt_rad = |time_s: f64| {
        let after = tilts.partition_point(|(at_s, _)| *at_s <= time_s);
        let ((from_s, from_rad), (to_s, to_rad)) = (tilts[after - 1], tilts[after]);
        from_rad + (to_rad - from_rad) * (time_s - from_s) / (to_s - from_s)
    };
    let mut hits = 0;
    for (start_s, scan) in scans(&run, "/scan") {
        for (beam, range_m) in scan.ranges_m.iter().enumerate() {
            if !range_m.is_finite() {
                continue;
            }
            let time_s = start_s + beam as f64 * f64::from(scan.time_increment_s);
            // As the edge places it: the joint's angle on top of the mount's pitch.
            let attitude = Attitude {
                pitch_rad: tilt_rad(time_s),
                ..Attitude::default()
            };
            let base_from_laser =
                Pose::from_parts(laser.base_from_mount.translation, attitude.rotation());
            let angle_rad =
                f64::from(scan.angle_min_rad) + beam as f64 * f64::from(scan.angle_increment_rad);
            let in_laser =
                Point3::new(libm::cos(angle_rad), libm::sin(angle_rad), 0.0) * f64::from(*range_m);
            let hit = motion.world_from_base(time_s) * base_from_laser * in_laser;
            // Half a step of the encoder and as much of interpolation, at that range.
            assert!(
                hit.z.abs() < 0.0002 * f64::from(*range_m) + 1e-4,
                "{time_s} {beam} {hit}"
            );
            hits += 1;
        }
    }
    // About half of the time the middle 180° look down, and see the ground as far as 20 m.
    assert!(hits > 30_000, "{hits}");
}

fn fixes(run: &[Named]) -> Vec<(f64, GeodeticFix)> {
    let fix = |(_, measurement): &Named| {
        let MeasurementData::Fix(fix) = measurement.data else {
            return None;
        };
        Some((seconds(measurement), fix))
    };
    run.iter().filter_map(fix).collect()
}

#[test]
fn the_sonar_looks_ahead_and_down_on_a_flat_bed() {
    let run = run(&world_of(LAKE, &[]), seeded(1));
    let scans = scans(&run, "/sonar");
    let first = scans[0].1;
    assert_eq!(first.ranges_m.len(), 240);
    for (beam, &range_m) in first.ranges_m.iter().enumerate() {
        let angle_rad = (-59.75 + 0.5 * beam as f64).to_radians();
        // A beam descends by the sine of 21° times its share ahead. All meet the bed before the quay, which is
        // 28.2 m ahead of the sonar.
        let descent = libm::sin(21.0_f64.to_radians()) * libm::cos(angle_rad);
        let expected_m = 5.0 / descent;
        assert!(
            (f64::from(range_m) - expected_m).abs() < 1e-3,
            "{beam} {range_m} {expected_m}"
        );
    }
    // The middle meets the bed 13.95 m off, 13.03 m ahead; the outermost 27.7 m off.
    assert!((first.ranges_m[119] - 13.952).abs() < 1e-3);
    assert!((first.ranges_m[0] - 27.696).abs() < 1e-3);
}

#[test]
fn the_laser_tilts_down_by_19_degrees_on_its_mast() {
    let world = world_of(LAKE, &[("y_m = 6.0", "y_m = 9.0"), ("-5.5", "0.0")]);
    let run = run(&world, seeded(1));
    // At 5 s it looks down by 19°; beam 720 looks ahead, 0.1 s later, when it is 0.05° back up.
    let scans = scans(&run, "/scan");
    let (_, scan) = scans
        .iter()
        .find(|(at_s, _)| (at_s - 5.0).abs() < 1e-6)
        .unwrap();
    let down_rad = (19.0_f64 - 0.5 * 4.75 * 0.01).to_radians();
    let expected_m = 1.9 / libm::sin(down_rad);
    assert!(
        (f64::from(scan.ranges_m[720]) - expected_m).abs() < 2e-3,
        "{}",
        scan.ranges_m[720]
    );
    // Astern it looks up.
    assert!(scan.ranges_m[0].is_infinite());
}

#[test]
fn fixes_are_of_the_antenna_and_err_by_2_cm() {
    let world = world_of(LAKE, &[("y_m = 6.0", "y_m = 90.0"), ("33.0", "133.0")]);
    let motion = Motion::new(&world);
    let exact = SimulationOptions {
        duration_s: Some(5.0),
        fix_noise_m: Some(0.0),
        ..seeded(1)
    };
    for (time_s, fix) in fixes(&run(&world, exact)) {
        // Bow to the north: the antenna is 0.5 m south of the middle.
        let antenna_m = motion.world_from_base(time_s) * Point3::new(-0.5, 0.0, 1.5);
        assert!((antenna_m.y - (1.5 * time_s - 0.5)).abs() < 1e-9);
        let [latitude_deg, longitude_deg, altitude_m] = Datum::LAKE.geodetic(antenna_m);
        assert_eq!(
            fix,
            GeodeticFix {
                latitude_deg,
                longitude_deg,
                altitude_m,
                status: 2,
                sigma_m: None,
            }
        );
    }
    // Metres of a degree of longitude and of latitude at the datum.
    let scale_m = [87_220.0, 111_005.0, 1.0];
    let receiver = world.simulated_vehicle().gps.unwrap();
    let mut noise = FixNoise::new(1, "gps");
    let mut sums = [0.0; 3];
    for _ in 0..2000 {
        let mut fix = |noise_m| {
            let fix = receiver.fix(&Datum::LAKE, &motion, 7.0, noise_m, &mut noise);
            [fix.longitude_deg, fix.latitude_deg, fix.altitude_m]
        };
        let (exact, noisy) = (fix(0.0), fix(world.errors().fix_noise_m));
        for axis in 0..3 {
            sums[axis] += ((noisy[axis] - exact[axis]) * scale_m[axis]).powi(2);
        }
    }
    let [east_m, north_m, up_m] = sums.map(|sum| libm::sqrt(sum / 2000.0));
    assert!((east_m - 0.02).abs() < 0.001, "{east_m}");
    assert!((north_m - 0.02).abs() < 0.001, "{north_m}");
    assert!((up_m - 0.04).abs() < 0.002, "{up_m}");
    let of_world = world_of(LAKE, &[("dropout = 0.0", "dropout = 0.0, fix_m = 0.5")]);
    assert!((of_world.errors().fix_noise_m - 0.5).abs() < f64::EPSILON);
}

#[test]
fn beam_seas_roll_the_boat_and_its_attitude_sensor_says_so() {
    // A swell to the east, 8 s and 100 m long, meets a boat that hardly moves and heads north on its beam.
    let waves = "[waves]\nheight_m = 0.8\nperiod_s = 8.0\nheading_deg = 0.0\n\n[path]";
    let world = world_of(
        LAKE,
        &[
            ("y_m = 6.0", "y_m = 0.8"),
            ("speed_mps = 1.5", "speed_mps = 0.01"),
            ("[path]", waves),
        ],
    );
    let motion = Motion::new(&world);
    let (mut rolls, mut pitches) = (0.0, 0.0);
    // 80 s, when waves of 8 s repeat.
    for step in 0..8000 {
        let attitude = Attitude::of(&motion.world_from_base(f64::from(step) * 0.01).rotation);
        rolls += attitude.roll_rad.powi(2);
        pitches += attitude.pitch_rad.powi(2);
        assert!((attitude.yaw_rad - 0.5 * std::f64::consts::PI).abs() < 1e-9);
    }
    let root_mean_deg = |sum: f64, n: f64| libm::sqrt(sum / n).to_degrees();
    let (roll_deg, pitch_deg) = (root_mean_deg(rolls, 8e3), root_mean_deg(pitches, 8e3));
    // σ 0.2 m, k = ω²/g = 0.0629, and 1.029 for the steeper short ones: see the hull's tests.
    let slope_deg = (0.2 * 0.062_9 * 1.0287_f64).to_degrees();
    assert!(
        (roll_deg - slope_deg).abs() < 0.02 * slope_deg,
        "{roll_deg}"
    );
    assert!(pitch_deg < 0.2 * slope_deg, "{pitch_deg}");

    let options = SimulationOptions {
        duration_s: Some(5.0),
        ..seeded(1)
    };
    let attitudes: Vec<_> = run(&world, options)
        .into_iter()
        .filter_map(|(_, measurement)| Some((seconds(&measurement), rotation(&imu(&measurement)?))))
        .collect();
    let errors: f64 = attitudes
        .iter()
        .map(|(time_s, read)| {
            read.angle_to(&motion.world_from_base(*time_s).rotation)
                .powi(2)
        })
        .sum();
    assert_eq!(attitudes.len(), 501);
    // 0.1° about each of three axes.
    let error_deg = root_mean_deg(errors, 501.0);
    assert!((error_deg - 0.173).abs() < 0.01, "{error_deg}");
}

#[test]
fn each_range_sensor_errs_on_its_own() {
    let noisy = world_of(
        LAKE,
        &[(
            "range_m = 0.0, dropout = 0.0",
            "range_m = 0.01, dropout = 0.2",
        )],
    );
    let exact = run(&world_of(LAKE, &[]), seeded(1));
    let noisy = run(&noisy, seeded(1));
    for stream in ["/scan", "/sonar"] {
        let (exact, noisy) = (scans(&exact, stream), scans(&noisy, stream));
        let pairs = || {
            exact
                .iter()
                .zip(&noisy)
                .flat_map(|(exact, noisy)| exact.1.ranges_m.iter().zip(&noisy.1.ranges_m))
        };
        let dropped = pairs().filter(|(_, noisy)| noisy.is_nan()).count() as f64;
        assert!(
            (dropped / pairs().count() as f64 - 0.2).abs() < 0.02,
            "{stream}"
        );
        let errors_m: Vec<f64> = pairs()
            .filter(|(exact, noisy)| exact.is_finite() && noisy.is_finite())
            .map(|(exact, noisy)| f64::from(noisy - exact))
            .collect();
        let variance_m2 = errors_m.iter().map(|m| m * m).sum::<f64>() / errors_m.len() as f64;
        assert!((libm::sqrt(variance_m2) - 0.01).abs() < 0.001, "{stream}");
    }
    let dropped_of = |stream: &str| -> Vec<bool> {
        scans(&noisy, stream)[0].1.ranges_m[..240]
            .iter()
            .map(|range_m| range_m.is_nan())
            .collect()
    };
    assert_ne!(dropped_of("/scan"), dropped_of("/sonar"));
}
