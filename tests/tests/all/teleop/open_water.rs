//! A boat on open water, and a covered laser.

use std::cell::Cell;
use std::fs;
use std::path::Path;
use std::time::Duration;

use foreshore_tests::drive_log::Round;
use foreshore_tests::operator::{Input, Operator};
use protocol::message::{CollisionMonitorState, SensorFault};
use tempfile::tempdir;

use super::robot::{NAME, Robot};
use crate::link::processes::{free_port, program};

/// `teleop.collision_monitor.no_return_speed_mps` and `creep_mps` of the boat's preset.
const OPEN_MPS: f64 = 1.5;
const CREEP_MPS: f64 = 0.3;

const AHEAD: Input = Input::of(3.0, 0.0);

/// The lake with another start of the boat and with `noise` for its sensors.
fn lake(folder: &Path, start_x_m: f64, noise: &str) -> &'static str {
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
    path.to_str().unwrap().to_owned().leak()
}

/// The boat, its driver and an observer.
fn boat(world: &'static str) -> (Robot, Operator, Operator) {
    let port = free_port();
    let robot = Robot::launch(program("robot-edge"), port, world, move |command| {
        command.args(["--listen", &format!("tcp/127.0.0.1:{port}")]);
    });
    let [anna, bert] = ["anna", "bert"].map(|name| Operator::ready(&robot.endpoint(), NAME, name));
    (robot, anna, bert)
}

fn fastest_mps(rounds: &[Round]) -> f64 {
    let speeds = rounds.iter().map(|round| round.output[0]);
    speeds.fold(0.0, f64::max)
}

#[test]
fn on_open_water_a_covered_laser_slows_the_boat_to_creep() {
    let folder = tempdir().unwrap();
    let world = lake(folder.path(), 5000.0, "laser_covered_s = [20.0, 1e6]");
    let (robot, mut anna, bert) = boat(world);
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
    let fastest_mps = fastest_mps(&log.rounds);
    assert!(
        (OPEN_MPS - 0.1..OPEN_MPS + 0.05).contains(&fastest_mps),
        "{fastest_mps}"
    );
    // It slows down to creep.
    anna.hold(AHEAD, Duration::from_secs(5));
    let log = robot.log();
    let last = log.rounds.last().unwrap();
    assert_eq!(last.guard, "blind");
    assert!(last.output[0] <= CREEP_MPS + 1e-6, "{last:?}");
}

#[test]
fn near_shores_a_covered_laser_is_a_sensor_fault() {
    let folder = tempdir().unwrap();
    let world = lake(folder.path(), -6.0, "laser_covered_s = [12.0, 1e6]");
    let (robot, mut anna, bert) = boat(world);
    anna.start_driving(AHEAD);
    let fault = || {
        let sensors = bert.sensors();
        let laser = sensors.into_iter().find(|sensor| sensor.name == "laser")?;
        laser.fault
    };
    anna.hold_until(AHEAD, || fault().is_some());
    assert_eq!(fault(), Some(SensorFault::Blocked));
    anna.hold(AHEAD, Duration::from_secs(5));
    let log = robot.log();
    let last = log.rounds.last().unwrap();
    assert_eq!(last.guard, "blind");
    assert!(last.output[0] <= CREEP_MPS + 1e-6, "{last:?}");
}
