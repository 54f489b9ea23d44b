//! A live vehicle's motors: a Roboteq AX3500, emulated, at the far end of a pseudo-terminal; everything before it is real.

use std::fs;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{JoinHandle, sleep};
use std::time::Duration;

use foreshore_tests::operator::{Input, Operator, PERIOD};
use protocol::message::{Answer, EStop, TeleopState};
use robot_edge::clock;
use tempfile::{TempDir, tempdir};

use super::emulator::on_terminal::EmulatorOnTerminal;
use super::room::{Room, Speeds};
use super::ros_system::{RosMiddleware, RosSystem};
use crate::link::processes::{Running, free_port, program};

const NAME: &str = "rover";

/// Straight ahead.
const AHEAD: Input = Input::of(0.3, 0.0);

/// Nothing that is waited for takes longer.
pub(super) const TIMEOUT: Duration = Duration::from_mins(1);

/// A vehicle with one laser, in a room.
pub(super) struct Rover {
    edge: Running,
    port: u16,
    folder: TempDir,
    pub(super) room: Arc<Room>,
    is_over: Arc<AtomicBool>,
    play: Option<JoinHandle<()>>,
}

impl Rover {
    /// With the motors that this table of its configuration says, in this ROS 2 system; it moves with these speeds.
    fn start(
        motors: &str,
        mut system: RosSystem,
        speeds: impl Fn() -> Speeds + Send + 'static,
    ) -> Self {
        let port = free_port();
        let folder = tempdir().unwrap();
        let is_over = Arc::new(AtomicBool::new(false));
        system.announce("/scan", "sensor_msgs/msg/LaserScan");
        system.announce("/odom", "nav_msgs/msg/Odometry");
        let config = folder.path().join("rover.toml");
        fs::write(&config, format!("{VEHICLE}{motors}")).unwrap();
        let mut command = program("robot-edge");
        command.args(["run", "--ros", &system.endpoint(), "--wait", "60"]);
        command
            .args(["--robot", NAME, "--quiet", "--vehicle"])
            .arg(&config);
        command.arg("--listen").arg(format!("tcp/127.0.0.1:{port}"));
        command.env("STATE_DIRECTORY", folder.path().join("state"));
        command.env("ROS_DOMAIN_ID", "0");
        let edge = Running::start(&mut command, "edge");
        let room = Arc::new(Room::default());
        let play = std::thread::spawn({
            let (room, is_over) = (Arc::clone(&room), Arc::clone(&is_over));
            move || room.play(&mut system, speeds, || is_over.load(Ordering::Relaxed))
        });
        Self {
            edge,
            port,
            folder,
            room,
            is_over,
            play: Some(play),
        }
    }

    /// With the emulated controller, and somebody who drives it: its motors turn.
    pub(super) fn with_roboteq() -> (Self, Arc<EmulatorOnTerminal>, Operator) {
        let controller = Arc::new(EmulatorOnTerminal::start(|_| ()));
        let motors = format!(
            "[motors.roboteq]\nport = \"{}\"\nleft_channel = \"one\"\n\
             drive = {{ track_width_m = 0.5, full_speed_mps = 1.0 }}\n",
            controller.path().display()
        );
        let system = RosSystem::start(free_port(), RosMiddleware::Rmw { domain: 0 });
        let wheels = Arc::clone(&controller);
        let rover = Self::start(&motors, system, move || {
            let [left, right] = wheels.with(|emulator| emulator.motors());
            let [left, right] = [left, right].map(|power| f64::from(power) / 127.0);
            [0.5 * (left + right), (right - left) / 0.5]
        });
        let mut anna = rover.operator();
        anna.start_driving(AHEAD);
        let started = clock::now();
        anna.hold_until(AHEAD, || {
            assert!(clock::elapsed(started) < TIMEOUT, "the motors never turn");
            controller.with(|emulator| emulator.motors().iter().all(|&power| power > 0))
        });
        (rover, controller, anna)
    }

    /// Somebody who may drive, as soon as the motors are found.
    fn operator(&self) -> Operator {
        let operator = Operator::ready(&format!("tcp/127.0.0.1:{}", self.port), NAME, "anna");
        operator.wait_for_status("ready", |teleop| teleop.state == TeleopState::Idle);
        operator
    }
}

impl Drop for Rover {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(play) = self.play.take() {
            // What failed there fails the test elsewhere.
            drop(play.join());
        }
    }
}

/// As shipped, with its collision monitor.
const VEHICLE: &str = "preset = \"generic2d\"\n";

/// The process that guards the motors of `edge`.
fn guard_of(edge: u32) -> u32 {
    let tasks = fs::read_dir(format!("/proc/{edge}/task")).unwrap();
    let children =
        tasks.filter_map(|task| fs::read_to_string(task.unwrap().path().join("children")).ok());
    let children: Vec<u32> = children
        .flat_map(|children| {
            let pids = children.split_whitespace().map(|pid| pid.parse().unwrap());
            pids.collect::<Vec<u32>>()
        })
        .collect();
    let is_guard = |pid: &u32| {
        let words = fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        words.split('\0').any(|word| word == "motor-guard")
    };
    let guard = children.into_iter().find(is_guard);
    guard.expect("a process that guards the motors")
}

#[test]
fn an_operator_drives_real_motors_and_silence_stops_them() {
    let (_rover, controller, mut anna) = Rover::with_roboteq();
    // Not one more word.
    controller.assert_stops_for_good();
    let stopped = anna.wait_for_status("stopped", |teleop| {
        matches!(teleop.state, TeleopState::Held | TeleopState::Idle)
    });
    assert!(stopped.applied.linear_mps.abs() < 1e-6, "{stopped:?}");
    // It drives again, and to let go is to stop.
    anna.start_driving(AHEAD);
    anna.hold(Input::NEUTRAL, PERIOD * 10);
    controller.assert_stops_for_good();
}

#[test]
fn an_edge_that_is_killed_or_hangs_leaves_motors_that_stand() {
    for signal in ["KILL", "STOP"] {
        let (rover, controller, _anna) = Rover::with_roboteq();
        rover.edge.signal(signal);
        controller.assert_stops_for_good();
        rover.edge.signal("KILL");
        controller.assert_stops_for_good();
    }
}

#[test]
fn motors_without_their_guard_stand_and_are_a_fault() {
    let (rover, controller, mut anna) = Rover::with_roboteq();
    let guard = guard_of(rover.edge.id());
    let killed = std::process::Command::new("kill")
        .args(["-KILL", &guard.to_string()])
        .status();
    assert!(killed.unwrap().success());
    // The key stays down.
    anna.hold(AHEAD, Duration::from_secs(1));
    controller.assert_stops_for_good();
    let status = anna.wait_for_status("a fault", |teleop| {
        matches!(teleop.state, TeleopState::Fault(_))
    });
    assert!(status.applied.linear_mps.abs() < 1e-6, "{status:?}");
}

#[test]
fn an_emergency_stop_is_kept_where_systemd_says() {
    let (rover, controller, mut anna) = Rover::with_roboteq();
    let answer = anna.ask(&EStop { press: 5 });
    assert!(matches!(answer, Answer::EStopped(_)), "{answer:?}");
    controller.assert_stops_for_good();
    let kept = fs::read_dir(rover.folder.path().join("state")).unwrap();
    assert!(kept.count() > 0);
}

#[test]
fn a_ros_system_is_told_velocities_and_zero_at_every_stop_and_at_the_end() {
    for ros_middleware in [RosMiddleware::Rmw { domain: 0 }, RosMiddleware::Bridge] {
        let mut system = RosSystem::start(free_port(), ros_middleware);
        let received = system.subscribe_twist("/bot/cmd_vel");
        let moves = Arc::clone(&received);
        let motors = "[motors.ros2_twist]\ntopic = \"/bot/cmd_vel\"\n";
        let rover = Rover::start(motors, system, move || {
            let last = moves.lock().unwrap().last().copied();
            last.map_or([0.0, 0.0], |twist| [twist.linear_x, twist.angular_z])
        });
        let mut anna = rover.operator();
        anna.start_driving(AHEAD);
        let last = || received.lock().unwrap().last().copied();
        let started = clock::now();
        anna.hold_until(AHEAD, || {
            assert!(
                clock::elapsed(started) < TIMEOUT,
                "{ros_middleware:?}: {:?}",
                last()
            );
            last().is_some_and(|twist| twist.linear_x > 0.1)
        });
        // Not one more word of the operator.
        let started = clock::now();
        while !last().unwrap().is_zero() {
            assert!(
                clock::elapsed(started) < TIMEOUT,
                "{ros_middleware:?}: {:?}",
                last()
            );
            sleep(PERIOD);
        }
        anna.start_driving(AHEAD);
        rover.edge.signal("INT");
        let started = clock::now();
        while !last().unwrap().is_zero() {
            assert!(
                clock::elapsed(started) < TIMEOUT,
                "{ros_middleware:?}: {:?}",
                last()
            );
            sleep(PERIOD);
        }
        sleep(PERIOD * 20);
        let received = received.lock().unwrap();
        assert!(received.last().unwrap().is_zero());
        assert!(
            received
                .iter()
                .all(|twist| twist.linear_x <= 0.31 && twist.angular_z.abs() < 1e-9)
        );
        if ros_middleware != RosMiddleware::Bridge {
            assert!(received.is_sorted_by(|a, b| a.sequence < b.sequence));
        }
    }
}
