//! The streams of a boat: tilting laser, sonar, satellite receiver, and waves under it.

use nalgebra::Point3;

use super::*;
use crate::attitude::Attitude;
use crate::gps::{Datum, FixNoise};
use measurement::scan::Scan;
use measurement::{GeodeticFix, MeasurementData};
use recording::writer::McapWriter;
use recording::{self, Selection};

mod refused;

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

fn world_with(changes: &[(&str, &str)]) -> World {
    let mut text = LAKE.to_owned();
    for (from, to) in changes {
        assert!(text.contains(from));
        text = text.replace(from, to);
    }
    World::parse("lake.toml", &text).unwrap()
}

fn seeded(seed: u64) -> SimulationOptions {
    SimulationOptions {
        seed,
        ..SimulationOptions::default()
    }
}

fn run(world: &World, options: SimulationOptions) -> Vec<(String, Measurement)> {
    let mut source = SimulatedSource::new(world, options).unwrap();
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

fn scans<'a>(run: &'a [(String, Measurement)], stream: &str) -> Vec<(f64, &'a Scan)> {
    let scan = |(name, measurement): &'a (String, Measurement)| {
        let MeasurementData::Scan { scan, .. } = &measurement.data else {
            return None;
        };
        (name == stream).then(|| (seconds(measurement), scan))
    };
    run.iter().filter_map(scan).collect()
}

fn fixes(run: &[(String, Measurement)]) -> Vec<(f64, GeodeticFix)> {
    let fix = |(_, measurement): &(String, Measurement)| {
        let MeasurementData::Fix(fix) = measurement.data else {
            return None;
        };
        Some((seconds(measurement), fix))
    };
    run.iter().filter_map(fix).collect()
}

#[test]
fn streams_come_at_their_rates_in_their_frames() {
    let run = run(&world_with(&[]), seeded(1));
    // 4 s: poses and encoder at 50 Hz, AHRS at 100, receiver and sonar at 10; the laser's sweeps follow each
    // other without a gap, so the last ends at 4 s less one beam.
    for (name, frame, expected) in [
        ("/tf", "odom", 201),
        ("/odom", "odom", 201),
        ("/scan", "laser", 20),
        ("/sonar", "sonar", 41),
        ("/joint_states", "base_link", 201),
        ("/imu/data", "imu_link", 401),
        ("/fix", "gps_link", 41),
    ] {
        let of_stream = || run.iter().filter(|(stream, _)| stream == name);
        assert_eq!(of_stream().count(), expected, "{name}");
        assert!(of_stream().all(|(_, measurement)| &*measurement.frame == frame));
    }
    let mounts: Vec<&str> = run
        .iter()
        .filter(|(stream, _)| stream == "/tf_static")
        .map(|(_, measurement)| {
            let MeasurementData::Transform { child, .. } = &measurement.data else {
                panic!("{measurement:?}")
            };
            &**child
        })
        .collect();
    assert_eq!(mounts, ["sonar", "imu_link", "gps_link"]);
    let at_once: Vec<&str> = run
        .iter()
        .filter(|(_, measurement)| measurement.stamp.since(START).as_nanos() == 200_000_000)
        .map(|(name, _)| name.as_str())
        .collect();
    let expected = [
        "/tf",
        "/odom",
        "/joint_states",
        "/imu/data",
        "/fix",
        "/scan",
        "/sonar",
    ];
    assert_eq!(at_once, expected);
}

#[test]
fn the_sonar_looks_ahead_and_down_on_a_flat_bed() {
    let run = run(&world_with(&[]), seeded(1));
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
    let world = world_with(&[("y_m = 6.0", "y_m = 9.0"), ("-5.5", "0.0")]);
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
    let world = world_with(&[("y_m = 6.0", "y_m = 90.0"), ("33.0", "133.0")]);
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
                status: 2
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
        let (exact, noisy) = (fix(0.0), fix(world.fix_noise_m()));
        for axis in 0..3 {
            sums[axis] += ((noisy[axis] - exact[axis]) * scale_m[axis]).powi(2);
        }
    }
    let [east_m, north_m, up_m] = sums.map(|sum| libm::sqrt(sum / 2000.0));
    assert!((east_m - 0.02).abs() < 0.001, "{east_m}");
    assert!((north_m - 0.02).abs() < 0.001, "{north_m}");
    assert!((up_m - 0.04).abs() < 0.002, "{up_m}");
    let of_world = world_with(&[("dropout = 0.0", "dropout = 0.0, fix_m = 0.5")]);
    assert!((of_world.fix_noise_m() - 0.5).abs() < f64::EPSILON);
}

#[test]
fn beam_seas_roll_the_boat_and_its_attitude_sensor_says_so() {
    // A swell to the east, 8 s and 100 m long, meets a boat that hardly moves and heads north on its beam.
    let waves = "[waves]\nheight_m = 0.8\nperiod_s = 8.0\nheading_deg = 0.0\n\n[path]";
    let world = world_with(&[
        ("y_m = 6.0", "y_m = 0.8"),
        ("speed_mps = 1.5", "speed_mps = 0.01"),
        ("[path]", waves),
    ]);
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
        .filter_map(|(_, measurement)| {
            let MeasurementData::Imu(sample) = measurement.data else {
                return None;
            };
            let read = measurement::pose::from_parts([0.0; 3], sample.orientation_xyzw?)?;
            Some((seconds(&measurement), read.rotation))
        })
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
    let noisy = world_with(&[(
        "range_m = 0.0, dropout = 0.0",
        "range_m = 0.01, dropout = 0.2",
    )]);
    let exact = run(&world_with(&[]), seeded(1));
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

#[test]
fn a_recording_holds_every_stream() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lake.mcap");
    let options = SimulationOptions {
        duration_s: Some(1.0),
        ..seeded(1)
    };
    let mut source = SimulatedSource::new(&world_with(&[]), options).unwrap();
    let streams = source.streams().to_vec();
    let mut writer = McapWriter::create(&path, Some("riverwatch")).unwrap();
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
        assert_eq!(format!("{numbered_alike:?}"), format!("{measurement:?}"));
    }
    assert!(reader.next_measurement().unwrap().is_none());
}
