#![expect(clippy::float_cmp, reason = "these values are exact")]

use measurement::cloud::CloudPoint;
use measurement::pose::Pose;
use measurement::{MeasurementData, StreamId, pose};

use super::{ODOM, SCAN, TF, TF_STATIC, *};

fn rooms() -> World {
    World::load("rooms").unwrap()
}

fn run(options: SimulationOptions) -> Vec<Measurement> {
    let mut source = SimulatedSource::new(&rooms(), options).unwrap();
    std::iter::from_fn(|| source.next_measurement()).collect()
}

fn seconds_of(seed: u64, duration_s: f64) -> SimulationOptions {
    SimulationOptions {
        seed,
        duration_s: Some(duration_s),
        ..SimulationOptions::default()
    }
}

fn pose_of(measurement: &Measurement) -> Option<Pose> {
    if let MeasurementData::Odometry {
        odom_from_base: pose,
        ..
    }
    | MeasurementData::Transform {
        parent_from_child: pose,
        ..
    } = &measurement.data
    {
        Some(*pose)
    } else {
        None
    }
}

/// BLAKE3 over stamps, scans and poses.
fn digest(measurements: &[Measurement]) -> String {
    let mut hasher = blake3::Hasher::new();
    for measurement in measurements {
        hasher.update(&measurement.stamp.as_nanos().to_le_bytes());
        if let MeasurementData::Scan { scan, .. } = &measurement.data {
            for range_m in &scan.ranges_m {
                hasher.update(&range_m.to_bits().to_le_bytes());
            }
        } else {
            let pose = pose_of(measurement).unwrap();
            for value in pose.to_homogeneous().iter() {
                hasher.update(&value.to_bits().to_le_bytes());
            }
        }
    }
    hasher.finalize().to_string()
}

fn count(measurements: &[Measurement], stream: StreamId) -> usize {
    measurements.iter().filter(|m| m.stream == stream).count()
}

#[test]
fn the_same_seed_measures_the_same_and_another_does_not() {
    let first = run(seconds_of(1, 10.1));
    assert_eq!(count(&first, SCAN), 101);
    assert_eq!(digest(&first), digest(&run(seconds_of(1, 10.1))));
    assert_ne!(digest(&first), digest(&run(seconds_of(2, 10.1))));
    // Written down once: what changes it changes every experiment.
    assert_eq!(digest(&first), FIRST_10_SECONDS_OF_ROOMS);
}

const FIRST_10_SECONDS_OF_ROOMS: &str =
    "5b4b03d09a5c49a01ade9fc6346abc38db1bd6359c63221109246dd846750277";

#[test]
fn a_longer_run_begins_with_the_shorter_one() {
    let (short, long) = (run(seconds_of(1, 2.0)), run(seconds_of(1, 3.0)));
    let scans = |run: &[Measurement]| -> Vec<Measurement> {
        run.iter().filter(|m| m.stream == SCAN).cloned().collect()
    };
    let (short, long) = (scans(&short), scans(&long));
    assert!(short.len() < long.len());
    // Not-a-number is not equal to itself.
    assert_eq!(format!("{short:?}"), format!("{:?}", &long[..short.len()]));
}

#[test]
fn measurements_come_in_the_order_of_stamps_at_their_rates() {
    let run = run(seconds_of(1, 2.0));
    assert!(run.windows(2).all(|pair| pair[0].stamp <= pair[1].stamp));
    assert_eq!(run[0].stamp, START);
    assert_eq!(run[0].stream, TF_STATIC);
    // Scans at 0, 0.1 … 1.9 s; at 1.9 s the sweep ends 1.967 s after the start, before the last pose.
    let counts = [TF_STATIC, TF, ODOM, SCAN].map(|stream| count(&run, stream));
    assert_eq!(counts, [1, 101, 101, 20]);
    assert_eq!(
        run.last().unwrap().stamp.since(START).as_nanos(),
        2_000_000_000
    );
}

#[test]
fn streams_name_what_comes_in_them() {
    let source = SimulatedSource::new(&rooms(), seconds_of(1, 0.2)).unwrap();
    for measurement in run(seconds_of(1, 0.2)) {
        let Stream { name, type_name } = &source.streams()[usize::from(measurement.stream.0)];
        let is_scan = matches!(measurement.data, MeasurementData::Scan { .. });
        let child = if let MeasurementData::Odometry { child, .. }
        | MeasurementData::Transform { child, .. } = &measurement.data
        {
            child
        } else {
            ""
        };
        let is_static = matches!(
            measurement.data,
            MeasurementData::Transform { is_static, .. } if is_static
        );
        let said = (
            name.as_str(),
            type_name.as_str(),
            &*measurement.frame,
            child,
        );
        let expected = [
            ("/tf_static", "tf2_msgs/TFMessage", "base_link", "laser"),
            ("/tf", "tf2_msgs/TFMessage", "odom", "base_link"),
            ("/odom", "nav_msgs/Odometry", "odom", "base_link"),
            ("/scan", "sensor_msgs/LaserScan", "laser", ""),
        ];
        assert_eq!(said, expected[usize::from(measurement.stream.0)]);
        assert_eq!(is_scan, name == "/scan");
        assert_eq!(is_static, name == "/tf_static");
    }
}

#[test]
fn odometry_and_tf_say_the_true_pose() {
    let world = rooms();
    let run = run(seconds_of(1, 6.0));
    for measurement in run.iter().filter(|m| [TF, ODOM].contains(&m.stream)) {
        let time_s = measurement.stamp.since(START).as_secs_f64();
        let truth = world.path().planar_pose(time_s);
        let pose = pose_of(measurement).unwrap();
        assert!((pose.translation.vector.xy() - truth.position_m.coords).norm() < 1e-12);
        assert!((pose::yaw_rad(&pose) - truth.yaw_rad).abs() < 1e-12);
    }
}

#[test]
fn the_end_of_the_path_ends_the_run() {
    let world = rooms();
    let source = SimulatedSource::new(&world, SimulationOptions::default()).unwrap();
    assert!((world.path().duration_s() - source.duration_s()).abs() <= 0.02);
    let longer = SimulatedSource::new(&world, seconds_of(0, 1e9)).unwrap();
    assert!((longer.duration_s() - source.duration_s()).abs() < 1e-12);
    assert_eq!(count(&run(seconds_of(0, 0.0)), SCAN), 0);
    assert_eq!(count(&run(seconds_of(0, 0.0)), ODOM), 1);
}

#[test]
fn invalid_options_are_refused() {
    type Change = fn(&mut SimulationOptions);
    let changes: [(Change, &str); 8] = [
        (
            |o| o.dropout = Some(1.5),
            "`dropout` is 1.5, it must be a probability from 0 to 1",
        ),
        (|o| o.duration_s = Some(f64::NAN), "`duration_s` is NaN"),
        (|o| o.range_noise_m = Some(-0.1), "`range_noise_m` is -0.1"),
        (
            |o| o.attitude_noise_rad = Some(f64::INFINITY),
            "`attitude_noise_rad` is inf",
        ),
        (|o| o.encoder_error = Some(-1.0), "`encoder_error` is -1"),
        (|o| o.wheel_slip = Some(f64::NAN), "`wheel_slip` is NaN"),
        (|o| o.joint_lag_s = Some(-0.1), "`joint_lag_s` is -0.1"),
        (|o| o.fix_noise_m = Some(f64::NAN), "`fix_noise_m` is NaN"),
    ];
    let world = rooms();
    for (change, expected) in changes {
        let mut options = SimulationOptions::default();
        change(&mut options);
        let error = SimulatedSource::new(&world, options).err().unwrap();
        assert!(error.to_string().starts_with(expected), "{error}");
    }
}

#[test]
fn ticks_that_go_on_do_not_go_back() {
    let mut ticks = Ticks::until(1.0, 10.0);
    while ticks.next_nanos().is_some() {
        ticks.advance();
    }
    ticks.extend(&Ticks::until(2.0, 10.0), 1_200_000_000);
    assert_eq!(ticks.next_nanos(), Some(1_200_000_000));
    assert!((ticks.last_s() - 2.0).abs() < 1e-9);
    ticks.extend(&Ticks::until(f64::INFINITY, 10.0), 1_200_000_001);
    assert_eq!(ticks.next_nanos(), Some(1_300_000_000));
    assert_eq!(ticks.last_s(), f64::INFINITY);
}

/// World, seconds and BLAKE3 over all that is measured in them, written down before vehicles could be driven; of
/// the boat, since its laser sees its own posts. What changes them changes every experiment.
const FIRST_SECONDS: &str = "\
rooms 6.0 4e4fe87b2c18c91f4979522162e6f585ac003ee0d897ad0f994afd202274dc79
street 3.0 2fb7ec96a601e9febbdcad95ed3e7e5edb9f73e6f4b5480f523ddc4207ec3804
bumps 6.0 73bf0f5bc07fc9cdba882313fa5609887e3d05d7c2b3ffe80e378b2ab2a7724c
turn 3.0 1434bc932c62ae2db4676cba1ef08cbf5de8faa95a43724b8783b890d219e7d6
meadow 2.0 4ef7104b3cf7d9ff77c3c3ff71c3907065fe47635f1d61acedd2d81aaf6ff649
lake 2.0 ae10ac00c56712ad4cf9e8435d559437c80e39d98447702ca6cbbb74babe6751
dock 2.0 66faea7b73ec1321cfd884b8abb4dd244b71eb358ca32c2f8d98ea97a2efbfb5";

#[test]
fn measurements_along_the_path_match_stored_digests() {
    let found = FIRST_SECONDS.lines().map(|line| {
        let [world, duration_s, _] = line.split(' ').collect::<Vec<_>>()[..] else {
            panic!("{line}")
        };
        let options = seconds_of(1, duration_s.parse().unwrap());
        let mut source = SimulatedSource::new(&World::load(world).unwrap(), options).unwrap();
        let mut measured: Vec<_> = std::iter::from_fn(|| source.next_measurement()).collect();
        // Ultrasonic sensors and bumpers change nothing of the others.
        let is_digested = |data: &MeasurementData| {
            !matches!(data, MeasurementData::Range(_) | MeasurementData::Bool(_))
        };
        measured.retain(|measurement| is_digested(&measurement.data));
        format!("{world} {duration_s} {}", digest_of(&measured))
    });
    let expected: Vec<&str> = FIRST_SECONDS.lines().collect();
    assert_eq!(found.collect::<Vec<_>>(), expected);
}

/// BLAKE3 over stamps and all numbers.
pub(super) fn digest_of(measurements: &[Measurement]) -> String {
    let mut hasher = blake3::Hasher::new();
    for measurement in measurements {
        hasher.update(&measurement.stamp.as_nanos().to_le_bytes());
        hasher.update(&measurement.stream.0.to_le_bytes());
        for bits in bits(measurement) {
            hasher.update(&bits.to_le_bytes());
        }
    }
    hasher.finalize().to_string()
}

fn bits(measurement: &Measurement) -> Vec<u64> {
    let of_pose = |pose: &Pose| {
        pose.to_homogeneous()
            .iter()
            .map(|value| value.to_bits())
            .collect()
    };
    let of = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect();
    match &measurement.data {
        MeasurementData::Scan { scan, .. } => scan
            .ranges_m
            .iter()
            .map(|range_m| u64::from(range_m.to_bits()))
            .collect(),
        MeasurementData::Transform {
            parent_from_child, ..
        } => of_pose(parent_from_child),
        MeasurementData::Odometry { odom_from_base, .. } => of_pose(odom_from_base),
        MeasurementData::Imu(sample) => of(&[
            &sample.orientation_xyzw.unwrap()[..],
            &sample.angular_velocity_radps,
            &sample.linear_acceleration_mps2,
        ]
        .concat()),
        MeasurementData::Joints(joints) => {
            joints.iter().map(|(_, angle)| angle.to_bits()).collect()
        }
        MeasurementData::Fix(fix) => of(&[fix.latitude_deg, fix.longitude_deg, fix.altitude_m]),
        MeasurementData::Range(reading) => vec![u64::from(reading.range_m.to_bits())],
        MeasurementData::Bool(is_pressed) => vec![u64::from(*is_pressed)],
        MeasurementData::Cloud(cloud) => {
            let of = |point: &CloudPoint| point.position_m.map(|m| u64::from(m.to_bits()));
            cloud.points.iter().flat_map(of).collect()
        }
        MeasurementData::Twist(_) => panic!("a simulated vehicle gives none: {measurement:?}"),
    }
}
