//! The streams of a vehicle whose laser tilts.

use super::*;
use crate::attitude::Attitude;
use crate::vehicle::SimulatedVehicle;
use measurement::MeasurementData;
use measurement::pose::Pose;
use measurement::scan::Scan;

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

fn world(noise: &str) -> World {
    let text = GROUND.replace("attitude_deg = 0.0", &format!("attitude_deg = 0.0{noise}"));
    World::parse("ground.toml", &text).unwrap()
}

fn run(world: &World) -> Vec<(String, Measurement)> {
    let mut source = SimulatedSource::new(world, SimulationOptions::default()).unwrap();
    let streams = source.streams().to_vec();
    std::iter::from_fn(|| source.next_measurement())
        .map(|measurement| {
            let stream = &streams[usize::from(measurement.stream.0)];
            (stream.name.clone(), measurement)
        })
        .collect()
}

fn seconds(measurement: &Measurement) -> f64 {
    measurement.stamp.since(START).as_secs_f64()
}

/// Times and angles of the tilt joint.
fn tilts(run: &[(String, Measurement)]) -> Vec<(f64, f64)> {
    let tilt = |(stream, measurement): &(String, Measurement)| {
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

fn scans(run: &[(String, Measurement)]) -> impl Iterator<Item = (f64, &Scan)> {
    run.iter().filter_map(|(_, measurement)| {
        if let MeasurementData::Scan { scan, .. } = &measurement.data {
            Some((seconds(measurement), scan))
        } else {
            None
        }
    })
}

#[test]
fn streams_come_at_their_rates_and_say_nothing_of_the_moving_mount() {
    let run = run(&world(""));
    // 6 s: poses, AHRS and encoder at 100 Hz; a sweep of 1080 steps takes 30 ms of a turn of 40.
    for (name, frame, expected) in [
        ("/tf_static", "base_link", 1),
        ("/tf", "odom", 601),
        ("/odom", "odom", 601),
        ("/joint_states", "base_link", 601),
        ("/imu/data", "imu_link", 601),
        ("/scan", "laser", 150),
        ("/fix", "", 0),
    ] {
        let of_stream = || run.iter().filter(|(stream, _)| stream == name);
        assert_eq!(of_stream().count(), expected, "{name}");
        assert!(of_stream().all(|(_, measurement)| &*measurement.frame == frame));
    }
    for (_, measurement) in &run {
        if let MeasurementData::Transform { child, .. } = &measurement.data {
            assert_ne!(&**child, "laser");
        }
    }
    assert!(scans(&run).all(|(_, scan)| scan.ranges_m.len() == 1081));
    let at_once: Vec<&str> = run
        .iter()
        .filter(|(_, measurement)| measurement.stamp.since(START).as_nanos() == 40_000_000)
        .map(|(name, _)| name.as_str())
        .collect();
    assert_eq!(
        at_once,
        ["/tf", "/odom", "/joint_states", "/imu/data", "/scan"]
    );
}

#[test]
fn the_joint_swings_by_30_degrees_in_4_seconds() {
    let tilts = tilts(&run(&world("")));
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
    let honest = tilts(&run(&world("")));
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
    let lagging = run(&world(", joint_lag_s = 0.2"));
    check(tilts(&lagging));
    let options = SimulationOptions {
        joint_lag_s: Some(0.2),
        ..SimulationOptions::default()
    };
    let mut source = SimulatedSource::new(&world(""), options).unwrap();
    let of_options: Vec<_> = std::iter::from_fn(|| source.next_measurement())
        .map(|measurement| ("/joint_states".to_owned(), measurement))
        .collect();
    check(tilts(&of_options));
    // What the laser measures is where it is, not where it says it is.
    let honest_run = run(&world(""));
    assert!(scans(&honest_run).eq(scans(&lagging)));
}

#[test]
fn hits_lie_on_the_ground_with_the_mount_pitched_by_the_joint() {
    let world = world("");
    let run = run(&world);
    let motion = Motion::new(&world);
    let laser = SimulatedVehicle::preset("introbot").unwrap().laser;
    let tilts = tilts(&run);
    let tilt_rad = |time_s: f64| {
        let after = tilts.partition_point(|(at_s, _)| *at_s <= time_s);
        let ((from_s, from_rad), (to_s, to_rad)) = (tilts[after - 1], tilts[after]);
        from_rad + (to_rad - from_rad) * (time_s - from_s) / (to_s - from_s)
    };
    let mut hits = 0;
    for (start_s, scan) in scans(&run) {
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
            let in_laser = nalgebra::Point3::new(libm::cos(angle_rad), libm::sin(angle_rad), 0.0)
                * f64::from(*range_m);
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
