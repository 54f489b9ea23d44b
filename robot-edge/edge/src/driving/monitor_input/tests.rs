use nalgebra::{Point3, Translation3};

use super::*;
use mapping::MappingConfig;
use mapping::obstacle::ObstacleConfig;
use mapping::registered_scan::{BeamOutcome, RegisteredBeam, ScanKind, SensorId};
use mapping::vehicle::VehicleConfig;
use teleop::TeleopConfig;
use teleop::collision_monitor::CollisionMonitorConfig;

const SCAN_PERIOD_MS: i64 = 40;
/// From scan to scan, metres.
const STEP_M: f64 = 0.05;
/// Of a ramp, nose down.
const SLOPE_DEG: f64 = 5.0;

fn rules(is_boat: bool) -> CollisionMonitorRules {
    let teleop = TeleopConfig {
        is_boat,
        ..TeleopConfig::default()
    };
    let (monitor, vehicle) = (CollisionMonitorConfig::default(), VehicleConfig::default());
    CollisionMonitorRules::new(&monitor, &teleop, &vehicle, &ObstacleConfig::default()).unwrap()
}

/// What follows the ground of a vehicle 0.5 m long.
fn tracker() -> GroundTracker {
    let wheelbase_m = VehicleConfig::default().wheelbase_m();
    GroundTracker::new(&MappingConfig::default().ground, wheelbase_m)
}

/// A scan of one beam, from 1 m above the vehicle to a place in its frame, metres.
fn scan(
    (sensor, millis): (u8, i64),
    odom_from_base: Pose,
    end_in_base: [f64; 3],
) -> RegisteredScan {
    let origin_in_odom = odom_from_base * Point3::new(0.0, 0.0, 1.0);
    let end_in_odom = odom_from_base * Point3::from(end_in_base);
    let beam = RegisteredBeam {
        origin_in_odom,
        end_in_odom,
        outcome: BeamOutcome::Hit,
        index: 0,
        range_m: (end_in_odom - origin_in_odom).norm() as f32,
    };
    RegisteredScan {
        stamp: RobotTime::from_nanos(1_000_000 * millis),
        sensor: SensorId(sensor),
        beam_step_rad: 0.01,
        kind: ScanKind::Beams,
        own_body_hits: 0,
        odom_from_base,
        beams: vec![beam],
    }
}

fn pitched([x, z]: [f64; 2], pitch_deg: f64) -> Pose {
    let rotation = UnitQuaternion::from_euler_angles(0.0, pitch_deg.to_radians(), 0.0);
    Pose::from_parts(Translation3::new(x, 0.0, z), rotation)
}

/// Poses on level ground, then on a ramp that leads down.
fn down_a_ramp(level: usize, on_ramp: usize) -> Vec<Pose> {
    let slope_rad = SLOPE_DEG.to_radians();
    let along = [
        STEP_M * libm::cos(slope_rad),
        -STEP_M * libm::sin(slope_rad),
    ];
    let edge_m = STEP_M * level as f64;
    let level = (0..level).map(|n| pitched([STEP_M * n as f64, 0.0], 0.0));
    let on_ramp = (1..=on_ramp).map(|n| {
        let [x, z] = along.map(|along| along * n as f64);
        pitched([edge_m + x, z], SLOPE_DEG)
    });
    level.chain(on_ramp).collect()
}

/// What the newest sweep of the first sensor holds for in the way.
fn in_the_way(monitor_runner: &mut MonitorRunner) -> Vec<[f64; 2]> {
    monitor_runner.newest_scans[0].update();
    let obstacle_scan = monitor_runner.newest_scans[0].output_buffer_mut();
    obstacle_scan.points_in_odom().to_vec()
}

/// A laser that takes 200 ms for a sweep, and a sonar at 10 Hz between its stamps.
#[test]
fn the_map_is_copied_between_scans_of_a_slow_sensor() {
    let config = MappingConfig::default();
    let mut mapper = Mapper::new(&config, VehicleConfig::default().shape(), &[]);
    let (_, mut monitor_map_input, mut monitor_runner) = monitor_input(rules(false), 2, None);
    let (laser, sonar) = (0, 1);
    let mut copied = Vec::new();
    for (millis, sensor) in [
        (1000, laser),
        (1050, sonar),
        (1150, sonar),
        (1200, laser),
        (1250, sonar),
        (1350, sonar),
        (1400, laser),
        (1450, sonar),
        // And where the sonar is silent.
        (1600, laser),
        (1800, laser),
    ] {
        let scan = scan((sensor, millis), Pose::identity(), [2.0, 0.0, 0.0]);
        let measured_at = Monotonic::from_nanos(1_000_000 * millis as u64);
        mapper.integrate(&scan);
        monitor_map_input.update_map(&scan, (&mapper, &Pose::identity()), measured_at);
        if monitor_runner.map.update() {
            copied.push(millis);
            // As old as its scan, and stale after two and a half periods of 200 ms.
            let map = monitor_runner.map.output_buffer_mut();
            let limit = measured_at + Duration::from_millis(500);
            assert!(!map.is_stale(limit), "{millis}");
            assert!(map.is_stale(limit + Duration::from_nanos(1)), "{millis}");
        }
    }
    assert_eq!(copied, [1000, 1150, 1250, 1350, 1450, 1600, 1800]);
}

/// Mapping may be any time behind: here it has mapped nothing yet.
#[test]
fn a_scan_on_a_ramp_is_judged_by_the_ramp_without_a_map() {
    let (mut monitor_input, _, mut monitor_runner) =
        monitor_input(rules(false), 1, Some(tracker()));
    // 0.2 m above the ground that the vehicle stands on, and above the level before the ramp less than 0.1 m.
    let obstacle_in_base = [1.2, 0.0, 0.2];
    let mut seen_since_m = None;
    for (number, pose) in (0_i64..).zip(down_a_ramp(20, 40)) {
        let is_on_ramp = pose.translation.z < 0.0;
        let scan = scan((0, SCAN_PERIOD_MS * number), pose, obstacle_in_base);
        monitor_input.add_scan(&scan, Monotonic::from_nanos(1));
        let is_in_the_way = !in_the_way(&mut monitor_runner).is_empty();
        if !is_on_ramp {
            assert!(is_in_the_way, "{number}");
        } else if is_in_the_way {
            seen_since_m.get_or_insert(-pose.translation.z / libm::sin(SLOPE_DEG.to_radians()));
        } else {
            assert_eq!(seen_since_m, None, "it is lost again in scan {number}");
        }
    }
    // It must have driven a wheelbase of 0.5 m on it; the first steps show that it is one.
    let seen_since_m = seen_since_m.unwrap();
    assert!((0.5..0.7).contains(&seen_since_m), "{seen_since_m}");
    let end = *down_a_ramp(20, 40).last().unwrap();
    let plane = monitor_input.ground_plane().unwrap();
    let ahead = end * Point3::new(1.2, 0.0, 0.2);
    assert!((plane.height_m(&ahead) - 0.2).abs() < 1e-9, "{plane:?}");
}

#[test]
fn the_ground_is_that_of_a_mapper_of_the_same_scans() {
    let mut config = MappingConfig::default();
    config.elevation.enabled = true;
    let mut mapper = Mapper::new(&config, VehicleConfig::default().shape(), &[]);
    let (mut monitor_input, _, _) = monitor_input(rules(false), 1, Some(tracker()));
    let mut changes = 0;
    for (number, pose) in (0_i64..).zip(down_a_ramp(30, 60)) {
        // It shakes a little: the plane is a mean.
        let shaken = 0.02 * [1.0, -2.0, 1.5][number as usize % 3];
        let pose = pose * pitched([0.0, 0.0], shaken);
        let before = mapper.terrain().unwrap().ground_plane();
        assert_eq!(monitor_input.ground_plane(), before, "{number}");
        // Of a second sensor too: the mapper takes every scan.
        let scan = scan(
            ((number % 2) as u8, SCAN_PERIOD_MS * number),
            pose,
            [1.2, 0.0, 0.0],
        );
        monitor_input.add_scan(&scan, Monotonic::from_nanos(1));
        changes += u32::from(mapper.integrate(&scan).ground_plane_reset.is_some());
    }
    let ground = mapper.terrain().unwrap().ground_plane();
    assert_eq!(
        (monitor_input.ground_plane(), ground.is_some()),
        (ground, true)
    );
    assert_eq!(changes, 1);
}

#[test]
fn ground_that_is_forgotten_is_that_of_the_next_scan() {
    let (mut monitor_input, _, mut monitor_runner) =
        monitor_input(rules(false), 1, Some(tracker()));
    let now = Monotonic::from_nanos(1);
    // 0.2 m above the ground is an obstacle, and 0.05 m none.
    let (above, below) = (pitched([0.0, 0.0], 0.0), pitched([0.0, -0.15], 0.0));
    let see = |monitor_input: &mut MonitorSensorInput, millis, pose| {
        monitor_input.add_scan(&scan((0, millis), pose, [1.2, 0.0, 0.2]), now)
    };
    see(&mut monitor_input, 0, above);
    assert_eq!(in_the_way(&mut monitor_runner).len(), 1);
    see(&mut monitor_input, 40, below);
    assert_eq!(in_the_way(&mut monitor_runner).len(), 0);
    assert_eq!(
        monitor_input.ground_plane(),
        Some(GroundPlane::under(&above))
    );
    // The map keeps its ground, whatever the clock does.
    monitor_input.reset_clock();
    assert_eq!(
        monitor_input.ground_plane(),
        Some(GroundPlane::under(&above))
    );
    monitor_input.reset_ground();
    assert_eq!(monitor_input.ground_plane(), None);
    see(&mut monitor_input, 80, below);
    assert_eq!(in_the_way(&mut monitor_runner).len(), 1);
    assert_eq!(
        monitor_input.ground_plane(),
        Some(GroundPlane::under(&below))
    );
}

/// Waves turn it, not the water.
#[test]
fn a_boat_is_judged_by_the_water_whatever_its_ground() {
    let (mut monitor_input, _, mut monitor_runner) = monitor_input(rules(true), 1, Some(tracker()));
    for (number, pitch_deg) in (0_i64..).zip([0.0, 5.0, -5.0]) {
        let pose = pitched([0.0, 0.0], pitch_deg);
        // 0.2 m above the water, 1.2 m ahead.
        let end_in_base = pose.inverse() * Point3::new(1.2, 0.0, 0.2);
        let scan = scan((0, SCAN_PERIOD_MS * number), pose, end_in_base.into());
        monitor_input.add_scan(&scan, Monotonic::from_nanos(1));
        let points = in_the_way(&mut monitor_runner);
        assert_eq!(points.len(), 1, "{pitch_deg}");
        assert!((points[0][0] - 1.2).abs() < 1e-9, "{points:?}");
    }
    assert_eq!(monitor_input.ground_plane(), None);
}

/// One gap that is too short, and one that is too long, change nothing.
#[test]
fn the_period_of_a_sensor_is_the_median_of_its_gaps() {
    let (mut monitor_input, _, _) = monitor_input(rules(false), 1, None);
    let sensor = &mut monitor_input.sensors[0];
    let mut stamp_ms = 0;
    let mut period_ms = |gap_ms: i64| {
        stamp_ms += gap_ms;
        let stamp = RobotTime::from_nanos(1_000_000 * stamp_ms);
        sensor.period_at(stamp).as_millis()
    };
    assert_eq!(period_ms(0), 100, "nothing is known yet");
    for gap_ms in [200, 200, 200, 5, 195, 200, 2000, 200] {
        assert_eq!(period_ms(gap_ms), 200, "{gap_ms}");
    }
    // Another rate is known by its fifth gap.
    let slower = [500; 5].map(&mut period_ms);
    assert_eq!((slower[0], slower[4]), (200, 500));
}

#[test]
fn what_waits_grows_older() {
    let stamp = RobotTime::from_nanos;
    let at = Monotonic::from_nanos;
    let mut receive_times = ReceiveTimes::default();
    assert_eq!(receive_times.received_at(stamp(5), at(9)), at(9));
    receive_times.record(stamp(10), at(100));
    receive_times.record(stamp(20), at(120));
    receive_times.record(stamp(20), at(130));
    receive_times.record(stamp(15), at(140));
    assert_eq!(receive_times.received_at(stamp(10), at(200)), at(100));
    assert_eq!(
        receive_times.received_at(stamp(11), at(200)),
        at(120),
        "not before 20 came"
    );
    assert_eq!(receive_times.received_at(stamp(21), at(200)), at(200));
    for n in 0..5000 {
        receive_times.record(stamp(100 + n), at(1000));
    }
    assert_eq!(receive_times.0.len(), CAPACITY);
    receive_times.clear();
    assert_eq!(receive_times.received_at(stamp(10), at(300)), at(300));
}

/// A cone without an echo is no covered window, and its scans are not those that ground and map are renewed by.
#[test]
fn arcs_change_neither_the_ground_nor_the_map_nor_the_belief_in_the_window() {
    let (mut input, mut map_input, mut runner) = monitor_input(rules(false), 2, Some(tracker()));
    let mapper = Mapper::new(
        &MappingConfig::default(),
        VehicleConfig::default().shape(),
        &[],
    );
    for millis in (0..4000).step_by(100) {
        let mut arc = scan((1, millis), Pose::identity(), [2.0, 0.0, 1.0]);
        arc.kind = ScanKind::Arc;
        if millis > 2000 {
            arc.beams.clear();
        }
        let measured_at = input.add_scan(&arc, Monotonic::from_nanos(1_000_000 * millis as u64));
        map_input.update_map(&arc, (&mapper, &Pose::identity()), measured_at);
    }
    assert_eq!(input.ground_plane(), None);
    assert!(!input.is_blocked(SensorId(1)));
    assert!(!runner.map.update());
    runner.newest_scans[1].update();
    let obstacle_scan = runner.newest_scans[1].output_buffer_mut();
    assert_eq!(obstacle_scan.points_in_odom().len(), 0);
}
