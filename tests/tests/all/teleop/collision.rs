//! The collision monitor stops the vehicle before obstacles while a key is held, and slows a boat with a covered laser.

use std::cell::Cell;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use foreshore_tests::operator::{Input, NEUTRAL, Operator};
use nalgebra::{Point3, Quaternion, UnitQuaternion, Vector2, Vector3};
use protocol::message::{Answer, Clamp, CollisionMonitorState, SensorFault, Setting, TeleopState};
use simulation::World;
use simulation::scene::Scene;
use tempfile::tempdir;
use zenoh::Wait as _;

use super::robot::{CIRCLE, Robot};

/// Half of the Pioneer's length and width, metres.
const HALF_M: [f64; 2] = [0.2275, 0.1905];
/// Safety margin of its preset, metres.
const MARGIN_M: f64 = 0.1;

/// Distance from the front of the vehicle to the next wall, metres.
fn gap_m(operator: &Operator) -> f64 {
    let world = World::load("rooms").unwrap();
    let scene = Scene::new(world.solids());
    let pose = operator.pose();
    let [x, y, _] = pose.position_m;
    let [i, j, k, w] = pose.quaternion_xyzw.map(f64::from);
    let attitude = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
    let heading = |along: Vector2<f64>| (attitude * Vector3::new(along.x, along.y, 0.0)).xy();
    let ahead = heading(Vector2::x());
    let gaps = [-1.0, -0.5, 0.0, 0.5, 1.0].map(|side| {
        let front = heading(Vector2::new(HALF_M[0], side * HALF_M[1]));
        let origin = Point3::new(x + front.x, y + front.y, 0.25);
        let hit = scene.cast(origin, Vector3::new(ahead.x, ahead.y, 0.0), 50.0, 0.0);
        hit.expect("a wall ahead").distance_m
    });
    gaps.into_iter().fold(f64::INFINITY, f64::min)
}

#[test]
fn the_collision_monitor_stops_before_a_wall() {
    let robot = Robot::start();
    let mut anna = robot.operator("anna");
    // Across the corridor of 3 m.
    anna.start_driving(Input::of(0.0, 0.8));
    anna.hold(Input::of(0.0, 0.8), Duration::from_millis(1600));
    anna.hold(Input::of(0.6, 0.0), Duration::from_secs(6));
    let status = anna.wait_for_status("stopped by the collision monitor", |teleop| {
        teleop.clamp == Some(Clamp::CollisionMonitor) && teleop.applied.linear_mps.abs() < 1e-3
    });
    assert_eq!(status.state, TeleopState::Driving, "the key is still down");
    assert!(
        matches!(status.collision_monitor, CollisionMonitorState::On(_)),
        "{status:?}"
    );
    anna.hold(Input::of(0.6, 0.0), Duration::from_secs(1));
    let gap = gap_m(&anna);
    // Noise of the laser on either side of the margin.
    assert!((MARGIN_M - 0.06..MARGIN_M + 0.15).contains(&gap), "{gap} m");

    // Backwards the way is free, but not observed recently: it creeps.
    anna.hold(Input::NEUTRAL, NEUTRAL);
    anna.hold(Input::of(-0.3, 0.0), Duration::from_secs(4));
    assert!(gap_m(&anna) > gap + 0.2);
    robot.verdict(&[&anna.journal]);
}

#[test]
fn the_driver_switches_the_collision_monitor_off_and_on() {
    let robot = Robot::start();
    let mut anna = robot.operator("anna");
    anna.take_lease();
    assert!(anna.wait_for_new_status().settings.collision_monitor);
    assert_eq!(anna.ask(&Setting::CollisionMonitor(false)), Answer::Done);
    let off = anna.wait_for_status("off", |teleop| !teleop.settings.collision_monitor);
    assert_eq!(off.collision_monitor, CollisionMonitorState::Off);
    assert_eq!(anna.ask(&Setting::CollisionMonitor(true)), Answer::Done);
    anna.wait_for_status("on", |teleop| {
        teleop.settings.collision_monitor
            && matches!(teleop.collision_monitor, CollisionMonitorState::On(_))
    });
}

#[test]
fn the_collision_monitor_is_on_again_for_the_next_driver() {
    let robot = Robot::start();
    let mut anna = robot.operator("anna");
    let mut bert = robot.operator("bert");
    anna.take_lease();
    assert_eq!(anna.ask(&Setting::CollisionMonitor(false)), Answer::Done);
    anna.start_driving(CIRCLE);
    anna.wait_for_status("driving without", |teleop| {
        teleop.collision_monitor == CollisionMonitorState::Off
    });
    // Her session is closed, and the lease ends.
    anna.session().close().wait().unwrap();
    bert.wait_for_status("free", |teleop| teleop.lease.holder.is_none());
    bert.take_lease();
    bert.wait_for_status("guarded", |teleop| {
        let is_his = teleop.lease.holder.as_ref() == Some(&bert.name);
        is_his
            && teleop.settings.collision_monitor
            && teleop.collision_monitor != CollisionMonitorState::Off
    });
}

/// `teleop.collision_monitor.no_return_speed_mps` and `creep_mps` of the boat's preset.
const OPEN_MPS: f64 = 1.5;
const CREEP_MPS: f64 = 0.3;

const AHEAD: Input = Input::of(3.0, 0.0);

/// The lake with another start of the boat and with `noise` for its sensors.
fn lake(folder: &Path, start_x_m: f64, noise: &str) -> PathBuf {
    let world =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../robot-edge/simulation/worlds/lake.toml");
    let text = fs::read_to_string(world).unwrap();
    let (before, path_and_rest) = text.split_once("waypoints = [").unwrap();
    let (_, after) = path_and_rest.split_once("\n]\n").unwrap();
    let way = format!(
        "waypoints = [{{ x_m = {:.1}, y_m = 0.0 }}]\n",
        start_x_m + 40.0
    );
    let moved = [before, &way, after]
        .concat()
        .replacen("x_m = -6.0", &format!("x_m = {start_x_m:.1}"), 1)
        .replacen("[noise]", &format!("[noise]\n{noise}"), 1);
    let path = folder.join("lake.toml");
    fs::write(&path, moved).unwrap();
    path
}

/// The boat, its driver and an observer.
fn boat(world: &Path) -> (Robot, Operator, Operator) {
    let robot = Robot::start_in(world.to_str().unwrap());
    let [anna, bert] = ["anna", "bert"].map(|name| robot.operator(name));
    (robot, anna, bert)
}

/// The last round must be slow, because nothing is observed.
fn assert_creeps(robot: &Robot) {
    let log = robot.log();
    let last = log.rounds.last().unwrap();
    assert_eq!(last.collision_monitor, "unknown_space");
    assert!(last.output[0] <= CREEP_MPS + 1e-6, "{last:?}");
}

#[test]
fn on_open_water_a_covered_laser_slows_the_boat_to_creep() {
    let folder = tempdir().unwrap();
    let world = lake(folder.path(), 5000.0, "laser_covered_s = [20.0, 1e6]");
    let (robot, mut anna, bert) = boat(&world);
    anna.start_driving(AHEAD);
    let no_return_speed_mps = Cell::new(0.0_f64);
    anna.hold_until(AHEAD, || {
        match bert.teleop().map(|teleop| teleop.collision_monitor) {
            Some(CollisionMonitorState::On(limits)) => {
                no_return_speed_mps.set(no_return_speed_mps.get().max(limits.forward_mps.into()));
                false
            }
            Some(CollisionMonitorState::UnknownSpace(_)) => no_return_speed_mps.get() > 0.0,
            Some(
                CollisionMonitorState::Silent
                | CollisionMonitorState::Off
                | CollisionMonitorState::Stale,
            )
            | None => false,
        }
    });
    assert!(
        (no_return_speed_mps.get() - OPEN_MPS).abs() < 1e-6,
        "{no_return_speed_mps:?}"
    );
    let log = robot.log();
    let speeds = log.rounds.iter().map(|round| round.output[0]);
    let fastest_mps = speeds.fold(0.0, f64::max);
    assert!(
        (OPEN_MPS - 0.1..OPEN_MPS + 0.05).contains(&fastest_mps),
        "{fastest_mps}"
    );
    // It slows down to creep.
    anna.hold(AHEAD, Duration::from_secs(5));
    assert_creeps(&robot);
}

#[test]
fn near_shores_a_covered_laser_is_a_sensor_fault() {
    let folder = tempdir().unwrap();
    let world = lake(folder.path(), -6.0, "laser_covered_s = [12.0, 1e6]");
    let (robot, mut anna, bert) = boat(&world);
    anna.start_driving(AHEAD);
    let fault = || {
        let sensors = bert.sensors();
        let laser = sensors.into_iter().find(|sensor| sensor.name == "laser")?;
        laser.fault
    };
    anna.hold_until(AHEAD, || fault().is_some());
    assert_eq!(fault(), Some(SensorFault::Blocked));
    anna.hold(AHEAD, Duration::from_secs(5));
    assert_creeps(&robot);
}
