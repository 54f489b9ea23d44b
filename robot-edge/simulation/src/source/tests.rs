use super::streams::{ODOM, SCAN, TF, TF_STATIC};
use super::*;
use measurement::pose;
use measurement::pose::Pose;
use measurement::{MeasurementData, StreamId};

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

/// Of odometry and transforms.
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
fn senseless_options_are_refused() {
    let world = rooms();
    let message = |options| {
        SimulatedSource::new(&world, options)
            .err()
            .unwrap()
            .to_string()
    };
    let defaults = SimulationOptions::default();
    assert_eq!(
        message(SimulationOptions {
            dropout: Some(1.5),
            ..defaults
        }),
        "`dropout` is 1.5, it must be a probability from 0 to 1"
    );
    for (option, options) in [
        (
            "duration_s",
            SimulationOptions {
                duration_s: Some(f64::NAN),
                ..defaults
            },
        ),
        (
            "range_noise_m",
            SimulationOptions {
                range_noise_m: Some(-0.1),
                ..defaults
            },
        ),
    ] {
        assert!(message(options).starts_with(&format!("`{option}` is")));
    }
}
