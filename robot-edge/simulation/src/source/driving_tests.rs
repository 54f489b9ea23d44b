#![expect(clippy::float_cmp, reason = "these values are exact")]

use super::tests::digest_of;
use super::{ODOM, SCAN, *};
use crate::attitude::Attitude;
use crate::motion::POSTURE_STEP_S;
use crate::velocity::CommandedVelocity;
use measurement::MeasurementData;
use measurement::pose::{self, Pose};

fn command(linear_mps: f64, angular_radps: f64) -> CommandedVelocity {
    CommandedVelocity {
        linear_mps,
        lateral_mps: 0.0,
        angular_radps,
    }
}

fn at(seconds: f64) -> RobotTime {
    START + RobotDuration::from_secs_f64(seconds)
}

fn open(world: &World, options: SimulationOptions) -> SimulatedSource {
    SimulatedSource::new(world, options).unwrap()
}

fn four_seconds() -> SimulationOptions {
    SimulationOptions {
        seed: 3,
        duration_s: Some(4.0),
        ..SimulationOptions::default()
    }
}

fn one_second() -> SimulationOptions {
    SimulationOptions {
        duration_s: Some(1.0),
        ..SimulationOptions::default()
    }
}

fn load(name: &str) -> World {
    World::load(name).unwrap()
}

/// A built-in world whose vehicle starts elsewhere.
fn from_elsewhere(text: &str, was: [&str; 3], [x, y, yaw_deg]: [f64; 3]) -> World {
    let start = |[x, y, yaw]: [&str; 3]| format!("x_m = {x}\ny_m = {y}\nyaw_deg = {yaw}");
    let there = start([&x.to_string(), &y.to_string(), &yaw_deg.to_string()]);
    let moved = text.replacen(&start(was), &there, 1);
    assert_ne!(moved, text);
    World::parse("elsewhere", &moved).unwrap()
}

/// Takes the measurements of which all that they look at has happened.
fn take_until(source: &mut SimulatedSource, seconds: f64) -> Vec<Measurement> {
    let mut taken = Vec::new();
    while next_due(source).is_some_and(|due| due <= at(seconds)) {
        taken.extend(source.next_measurement());
    }
    taken
}

fn next_due(source: &SimulatedSource) -> Option<RobotTime> {
    if let Some(ready) = source.ready.front() {
        return Some(ready.stamp);
    }
    let (nanos, place) = source.next_reading()?;
    let (_, sensor) = &source.timetable[place];
    Some(START + RobotDuration::from_nanos(nanos + lookahead_nanos(sensor)))
}

fn speed_mps(source: &SimulatedSource, seconds: f64) -> f64 {
    source.velocity(at(seconds)).forward_mps
}

fn true_pose(source: &SimulatedSource, seconds: f64) -> Pose {
    source.run.motion.world_from_base(seconds)
}

/// Commands by time, each a whole number of steps. It leaves its path at 1.14 s, a stamp of
/// every odometry that is not 228 times the step in floating point.
const DRIVE: [(f64, f64, f64); 6] = [
    (0.5, 0.0, 0.0),
    (1.14, 0.4, 0.0),
    (1.515, 0.4, 0.6),
    (2.02, -0.2, 0.6),
    (2.745, f64::NAN, 0.0),
    (3.1, 0.3, -0.1),
];

/// All that is measured in 4 s of a drive; `slack_s` says how long measurements wait beyond their time.
fn drive(world: &str, slack_s: f64) -> Vec<Measurement> {
    let mut source = open(&load(world), four_seconds());
    let mut taken = Vec::new();
    for (seconds, linear_mps, angular_radps) in DRIVE {
        taken.extend(take_until(&mut source, seconds - slack_s));
        let effective = source.drive(at(seconds), command(linear_mps, angular_radps));
        assert_eq!(effective, Ok(at(seconds)), "{world}");
    }
    taken.extend(std::iter::from_fn(|| source.next_measurement()));
    taken
}

#[test]
fn measurements_do_not_depend_on_when_they_are_taken() {
    for (world, scans) in [("rooms", 40), ("bumps", 100), ("lake", 20)] {
        let (first, second) = (drive(world, 0.0), drive(world, 0.3));
        assert_eq!(digest_of(&first), digest_of(&second), "{world}");
        assert!(first.windows(2).all(|pair| pair[0].stamp <= pair[1].stamp));
        let taken = first.iter().filter(|m| m.stream == SCAN).count();
        assert_eq!(taken, scans, "{world}");
    }
}

#[test]
fn zero_commands_on_the_path_change_nothing() {
    for world in ["rooms", "lake"] {
        let mut source = open(&load(world), four_seconds());
        let mut taken = Vec::new();
        for n in 0..200 {
            let now_s = 0.02 * f64::from(n);
            taken.extend(take_until(&mut source, now_s));
            source.drive(at(now_s), CommandedVelocity::ZERO).unwrap();
        }
        taken.extend(std::iter::from_fn(|| source.next_measurement()));
        assert!(!source.is_driven());
        let mut undriven = open(&load(world), four_seconds());
        let undriven: Vec<_> = std::iter::from_fn(|| undriven.next_measurement()).collect();
        assert_eq!(digest_of(&taken), digest_of(&undriven));
    }
}

#[test]
fn it_leaves_the_path_at_its_pose_and_speed_there() {
    let world = load("rooms");
    let mut source = open(&world, SimulationOptions::default());
    take_until(&mut source, 2.0);
    assert_eq!(source.drive(at(2.001), command(0.3, 0.0)), Ok(at(2.005)));
    let left = world.path().world_from_base(2.005);
    assert_eq!(true_pose(&source, 2.005), left);
    assert_eq!(speed_mps(&source, 2.005), 0.55);
    take_until(&mut source, 4.0);
    assert_eq!(speed_mps(&source, 4.0), 0.3);
    let way_m = (true_pose(&source, 4.0).translation.vector - left.translation.vector).norm();
    // Its lag keeps the difference of speeds for 0.1 s.
    assert!(
        (way_m - (0.3 * 1.995 + 0.25 * 0.1)).abs() < 0.005,
        "{way_m}"
    );
    // What came before is what it was.
    assert_eq!(true_pose(&source, 1.0), world.path().world_from_base(1.0));
}

#[test]
fn a_command_waits_only_for_an_already_taken_sweep() {
    for (world, look_ahead_s) in [
        ("rooms", 0.067),
        ("turn", 0.014),
        ("meadow", 0.031),
        ("lake", 0.2),
    ] {
        let mut source = open(&load(world), SimulationOptions::default());
        source.drive(at(0.0), command(0.2, 0.1)).unwrap();
        let (mut longest_s, mut last) = (0.0_f64, at(0.0));
        for _ in 0..400 {
            let stamp = source.next_measurement().unwrap().stamp;
            let effective = source.drive(stamp, command(0.2, 0.1)).unwrap();
            assert!(effective >= stamp && effective >= last);
            longest_s = longest_s.max(effective.since(stamp).as_secs_f64());
            last = effective;
        }
        let most_s = look_ahead_s + POSTURE_STEP_S;
        assert!(
            (look_ahead_s - 0.001..most_s).contains(&longest_s),
            "{world}: {longest_s}"
        );
    }
}

#[test]
fn too_far_ahead_is_refused_and_the_vehicle_stops() {
    let mut source = open(&load("rooms"), SimulationOptions::default());
    take_until(&mut source, 1.0);
    assert_eq!(source.drive(at(1.0), command(0.2, 0.0)), Ok(at(1.0)));
    let refused = source.drive(at(6.1), command(0.3, 0.0)).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "a command for 6.100 s, where the last measurement is of 1.000 s: take measurements up to 5 s before it \
         first"
    );
    assert!(speed_mps(&source, 1.0) > 0.2);
    take_until(&mut source, 3.0);
    assert_eq!(speed_mps(&source, 3.0), 0.0);
    // A time before the beginning is now.
    assert_eq!(
        source.drive(RobotTime::MIN, CommandedVelocity::ZERO),
        Ok(at(3.0))
    );
}

#[test]
fn a_driven_run_ends_with_its_duration_only() {
    let world = load("bumps");
    let path_s = world.path().duration_s();
    let mut source = open(&world, SimulationOptions::default());
    let last = std::iter::from_fn(|| source.next_measurement())
        .last()
        .unwrap();
    assert!(last.stamp <= at(path_s));
    assert_eq!(next_due(&source), None);
    // Taking over after the end of the path.
    source.drive(last.stamp, command(-0.2, 0.0)).unwrap();
    let more = take_until(&mut source, path_s + 3.0);
    assert!(
        more.iter()
            .all(|measurement| measurement.stamp >= last.stamp)
    );
    assert!(more.iter().filter(|m| m.stream == SCAN).count() > 70);
    assert_eq!(source.duration_s(), f64::INFINITY);

    let mut source = open(&world, one_second());
    source.drive(at(0.0), command(0.2, 0.0)).unwrap();
    let last = std::iter::from_fn(|| source.next_measurement())
        .last()
        .unwrap();
    assert_eq!(last.stamp, at(1.0));
}

#[test]
fn until_stopped_it_waits_at_the_end_of_the_path() {
    let world = load("rooms");
    let mut source = open(&world, SimulationOptions::default()).until_stopped();
    assert_eq!(source.duration_s(), f64::INFINITY);
    let end_s = world.path().duration_s();
    let beyond = take_until(&mut source, end_s + 2.0);
    let last = beyond.iter().rfind(|m| m.stream == ODOM).unwrap();
    assert!(last.stamp > at(end_s + 1.9));
    let MeasurementData::Odometry { odom_from_base, .. } = &last.data else {
        panic!("{last:?}");
    };
    assert_eq!(*odom_from_base, world.path().world_from_base(end_s));
    assert!(!source.is_driven());
    let short = open(&world, one_second()).until_stopped();
    assert_eq!(short.duration_s(), 1.0);
}

#[test]
fn a_wall_of_the_rooms_stops_it_and_the_laser_sees_why() {
    let mut source = open(&load("rooms"), SimulationOptions::default());
    // To the left across the corridor, whose wall is at y = 5.285, 0.965 m beside the start.
    source.drive(at(0.0), command(0.0, 1.0)).unwrap();
    let mut now_s = 0.0;
    while pose::yaw_rad(&true_pose(&source, now_s)) < 1.5 {
        now_s += 0.02;
        take_until(&mut source, now_s);
    }
    source.drive(at(now_s), command(0.5, 0.0)).unwrap();
    let taken = take_until(&mut source, now_s + 5.0);
    let stopped = true_pose(&source, now_s + 5.0);
    // A corner of its front touches: within 2.5 mm, a step's way at 0.5 m/s.
    let front_m =
        [0.1905, -0.1905].map(|side| (stopped * nalgebra::Point3::new(0.2275, side, 0.2)).y);
    let front_m = front_m[0].max(front_m[1]);
    assert!(
        (5.285 - 0.003..=5.285 + 1e-9).contains(&front_m),
        "{front_m}"
    );
    let scan = taken.iter().rfind(|m| m.stream == SCAN).unwrap();
    let MeasurementData::Scan { scan, .. } = &scan.data else {
        panic!("{scan:?}");
    };
    let ahead_m = f64::from(scan.ranges_m[341]);
    // The laser is 0.16 m ahead of the middle.
    assert!((ahead_m - 0.0675).abs() < 0.04, "{ahead_m}");
}

const STREET: &str = include_str!("../../worlds/street.toml");

#[test]
fn kerbs_stop_the_vehicle_only_upwards() {
    let driven = |start| {
        let world = from_elsewhere(STREET, ["0.0"; 3], start);
        let mut source = open(&world, SimulationOptions::default());
        source.drive(at(0.0), command(0.5, 0.0)).unwrap();
        let mut pitch_deg = [0.0_f64; 2];
        for n in 1..=250 {
            let now_s = 0.02 * f64::from(n);
            source.drive(at(now_s), command(0.5, 0.0)).unwrap();
            let pitch = Attitude::of(&true_pose(&source, now_s).rotation).pitch_rad;
            pitch_deg = [
                pitch_deg[0].min(pitch.to_degrees()),
                pitch_deg[1].max(pitch.to_degrees()),
            ];
        }
        let end = true_pose(&source, 5.0).translation.vector;
        (pitch_deg, end)
    };
    // Up the slope of the gateway, 15 cm in 0.41 m: 20°, of which the axles 0.55 m apart see the 15 cm.
    let ([up, _], end) = driven([20.0, 2.6, 90.0]);
    assert!((-16.0..-12.0).contains(&up), "{up}");
    assert!((end.z - 0.15).abs() < 1e-3, "{end}");
    // Down from the pavement.
    let ([_, down], end) = driven([17.0, 5.3, -90.0]);
    assert!((14.0..17.0).contains(&down), "{down}");
    assert!(end.z.abs() < 1e-3, "{end}");
    // And not up again.
    let (_, end) = driven([17.0, 2.6, 90.0]);
    // The path has turned it by some degrees: a corner comes first, 0.45 m ahead and 0.35 m to the side.
    assert!((3.57..3.62).contains(&end.y), "{end}");
}

#[test]
fn a_boat_goes_on_in_its_waves() {
    let mut source = open(&load("lake"), SimulationOptions::default());
    take_until(&mut source, 3.0);
    assert_eq!(speed_mps(&source, 3.0), 1.5);
    source.take_over(at(3.0)).unwrap();
    take_until(&mut source, 5.0);
    let speed_mps = speed_mps(&source, 5.0);
    assert!((0.3..0.7).contains(&speed_mps), "{speed_mps}");
    let moved =
        true_pose(&source, 5.0).translation.vector - true_pose(&source, 3.0).translation.vector;
    assert!((1.2..2.0).contains(&moved.xy().norm()), "{moved}");
}
