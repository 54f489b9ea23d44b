//! The streams of a vehicle that stands on its wheels and has encoders and an AHRS.

use super::*;
use crate::attitude::Attitude;
use crate::vehicle::SimulatedVehicle;
use measurement::pose::Pose;
use measurement::{ImuSample, MeasurementData, StreamId};
use recording::writer::McapWriter;
use recording::{self, Selection};

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

fn world(noise: &str) -> World {
    let text = BUMP.replace("dropout = 0.005", &format!("dropout = 0.005{noise}"));
    World::parse("bump.toml", &text).unwrap()
}

fn run(world: &World, options: SimulationOptions) -> Vec<(String, Measurement)> {
    let mut source = SimulatedSource::new(world, options).unwrap();
    let streams = source.streams().to_vec();
    let name = |id: StreamId| streams[usize::from(id.0)].name.clone();
    std::iter::from_fn(|| source.next_measurement())
        .map(|measurement| (name(measurement.stream), measurement))
        .collect()
}

fn seeded(seed: u64) -> SimulationOptions {
    SimulationOptions {
        seed,
        ..SimulationOptions::default()
    }
}

fn imu(measurement: &Measurement) -> Option<ImuSample> {
    if let MeasurementData::Imu(sample) = measurement.data {
        Some(sample)
    } else {
        None
    }
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

fn true_pose(measurement: &Measurement) -> Option<Pose> {
    if let MeasurementData::Odometry { odom_from_base, .. } = measurement.data {
        Some(odom_from_base)
    } else {
        None
    }
}

fn attitude(sample: &ImuSample) -> Attitude {
    let pose = measurement::pose::from_parts([0.0; 3], sample.orientation_xyzw.unwrap()).unwrap();
    Attitude::of(&pose.rotation)
}

#[test]
fn streams_come_at_their_rates_in_the_order_of_stamps() {
    let run = run(&world(""), seeded(1));
    // 8.4 s: poses and AHRS at 100 Hz, wheels at 50 Hz, scans at 25 Hz that end before the last pose.
    for (name, frame, expected) in [
        ("/tf_static", "base_link", 2),
        ("/tf", "odom", 841),
        ("/odom", "odom", 841),
        ("/joint_states", "base_link", 421),
        ("/imu/data", "imu_link", 841),
        ("/scan", "laser", 210),
    ] {
        let of_stream = || run.iter().filter(|(stream, _)| stream == name);
        assert_eq!(of_stream().count(), expected, "{name}");
        assert!(of_stream().all(|(_, measurement)| &*measurement.frame == frame));
    }
    assert!(
        run.windows(2)
            .all(|pair| pair[0].1.stamp <= pair[1].1.stamp)
    );
    let at_once: Vec<&str> = run
        .iter()
        .filter(|(_, m)| m.stamp.since(START).as_nanos() == 40_000_000)
        .map(|(name, _)| name.as_str())
        .collect();
    assert_eq!(
        at_once,
        ["/tf", "/odom", "/joint_states", "/imu/data", "/scan"]
    );
}

#[test]
fn what_the_sensors_say_is_the_motion() {
    let world = world(", attitude_deg = 0.0");
    let motion = Motion::new(&world);
    let mut lowest_pitch_rad = 0.0_f64;
    for (_, measurement) in run(&world, seeded(1)) {
        let time_s = measurement.stamp.since(START).as_secs_f64();
        let truth = motion.world_from_base(time_s);
        if let Some(pose) = true_pose(&measurement) {
            assert_eq!(pose, truth);
            lowest_pitch_rad = lowest_pitch_rad.min(Attitude::of(&pose.rotation).pitch_rad);
        } else if let Some(sample) = imu(&measurement) {
            let pose =
                measurement::pose::from_parts([0.0; 3], sample.orientation_xyzw.unwrap()).unwrap();
            assert!(pose.rotation.angle_to(&truth.rotation) < 1e-7);
        }
    }
    assert!(
        (lowest_pitch_rad.to_degrees() + 4.48).abs() < 0.02,
        "{lowest_pitch_rad}"
    );
}

#[test]
fn the_world_or_the_options_choose_the_errors() {
    let last_wheels_m = |world: &World, options| {
        let run = run(world, options);
        let last = run.iter().rev().find_map(|(_, m)| wheels_m(m));
        last.unwrap()[0]
    };
    let exact_m = last_wheels_m(&world(""), seeded(1));
    assert!((4.2..4.23).contains(&exact_m), "{exact_m}");
    let of_world_m = last_wheels_m(&world(", encoder_scale_error = 0.048"), seeded(1));
    assert!((of_world_m - 1.048 * exact_m).abs() < 1e-3, "{of_world_m}");
    let of_options_m = last_wheels_m(
        &world(", encoder_scale_error = 0.048"),
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
            .map(|sample| attitude(&sample).roll_rad.to_degrees())
            .map(|deg| deg * deg)
            .collect();
        libm::sqrt(errors_deg2.iter().sum::<f64>() / errors_deg2.len() as f64)
    };
    assert!((noise_deg(&world(""), seeded(1)) - 0.1).abs() < 0.01);
    assert!((noise_deg(&world(", attitude_deg = 0.5"), seeded(1)) - 0.5).abs() < 0.05);
    let quiet = SimulationOptions {
        attitude_noise_rad: Some(0.0),
        ..seeded(1)
    };
    assert!(noise_deg(&world(", attitude_deg = 0.5"), quiet) < 1e-6);
}

#[test]
fn the_same_seed_gives_the_same_bits_and_noise_of_one_sensor_leaves_the_others_alone() {
    let of = |stream: &str, run: &[(String, Measurement)]| -> String {
        let measurements: Vec<_> = run.iter().filter(|(name, _)| name == stream).collect();
        format!("{measurements:?}")
    };
    let first = run(&world(""), seeded(1));
    assert_eq!(
        format!("{first:?}"),
        format!("{:?}", run(&world(""), seeded(1)))
    );
    let other = run(&world(""), seeded(2));
    assert_ne!(of("/imu/data", &first), of("/imu/data", &other));
    assert_eq!(of("/odom", &first), of("/odom", &other));
    let slipping = SimulationOptions {
        wheel_slip: Some(0.05),
        attitude_noise_rad: Some(0.0),
        ..seeded(1)
    };
    let slipping = run(&world(""), slipping);
    for stream in ["/tf", "/odom", "/scan"] {
        assert_eq!(of(stream, &first), of(stream, &slipping), "{stream}");
    }
    assert_ne!(of("/joint_states", &first), of("/joint_states", &slipping));
}

#[test]
fn senseless_errors_are_refused() {
    let defaults = SimulationOptions::default();
    for (option, options) in [
        (
            "attitude_noise_rad",
            SimulationOptions {
                attitude_noise_rad: Some(f64::INFINITY),
                ..defaults
            },
        ),
        (
            "encoder_error",
            SimulationOptions {
                encoder_error: Some(-1.0),
                ..defaults
            },
        ),
        (
            "wheel_slip",
            SimulationOptions {
                wheel_slip: Some(f64::NAN),
                ..defaults
            },
        ),
    ] {
        let error = SimulatedSource::new(&world(""), options).err().unwrap();
        assert!(error.to_string().starts_with(&format!("`{option}` is")));
    }
    let refused = |noise: &str| {
        let text = BUMP.replace("dropout = 0.005", &format!("dropout = 0.005, {noise}"));
        World::parse("bump.toml", &text).err().unwrap().to_string()
    };
    assert_eq!(
        refused("attitude_deg = -0.1"),
        "bump.toml:3: `attitude_deg`: -0.1 is not between 0 and 180"
    );
    assert_eq!(
        refused("encoder_scale_error = -1.0"),
        "bump.toml:3: `encoder_scale_error`: -1 is not between -0.9 and 10"
    );
}

#[test]
fn the_laser_of_holos_meets_level_ground_8_metres_ahead() {
    let holos = SimulatedVehicle::preset("holos").unwrap();
    let (mount, laser) = (holos.laser.base_from_mount, &holos.laser.planar);
    // [LOD §4]: 1.08 m / cos 82.5°.
    let forward = mount.rotation * nalgebra::Vector3::x();
    assert!((mount.translation.z / -forward.z - 8.274).abs() < 1e-3);
    let last_rad = f64::from(laser.angle_min_rad) + 480.0 * f64::from(laser.angle_increment_rad);
    assert!((last_rad.to_degrees() - 60.0).abs() < 1e-4, "{last_rad}");
    assert!((laser.sweep_duration_s() - 0.04 / 3.0).abs() < 1e-6);
}

#[test]
fn a_recording_holds_every_stream() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bump.mcap");
    let options = SimulationOptions {
        duration_s: Some(1.0),
        ..seeded(1)
    };
    let mut source = SimulatedSource::new(&world(""), options).unwrap();
    let streams = source.streams().to_vec();
    let mut writer = McapWriter::create(&path, Some("holos")).unwrap();
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

#[test]
fn the_first_seconds_of_ramp_are_what_they_were_with_one_fixed_laser() {
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
