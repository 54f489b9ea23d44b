//! A live vehicle with an emulated Roboteq AX3500 at a pseudo-terminal.

use std::fs;
use std::sync::Arc;
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::operator::{Input, Operator, PERIOD};
use protocol::message::{Answer, EStop, TeleopState};
use robot_edge::clock;

use super::emulator::on_terminal::EmulatorOnTerminal;
use super::live_rig::{AHEAD, LiveRig, TIMEOUT, VEHICLE, roboteq};
use super::room::{Room, Speeds};
use super::ros_system::{RosMiddleware, RosSystem};
use super::service_manager::guard_of;
use crate::link::processes::{Running, free_port, wait_until};

/// A vehicle with one laser, in a room.
pub(super) struct Rover {
    edge: Running,
    live_rig: LiveRig,
    pub(super) room: Arc<Room>,
}

impl Rover {
    /// `motors` is the table of its configuration; it moves with `speeds`.
    fn start(
        motors: &str,
        mut system: RosSystem,
        speeds: impl Fn() -> Speeds + Send + 'static,
    ) -> Self {
        system.announce("/odom", "nav_msgs/msg/Odometry");
        let room = Arc::new(Room::default());
        let live_rig = LiveRig::new(format!("{VEHICLE}{motors}"), system, {
            let room = Arc::clone(&room);
            move |system: &mut RosSystem, is_over: &dyn Fn() -> bool| {
                room.play(system, speeds, is_over);
            }
        });
        let edge = live_rig.start_edge(|_| ());
        Self {
            edge,
            live_rig,
            room,
        }
    }

    /// With the emulated controller and an operator who drives: the motors turn.
    pub(super) fn with_roboteq() -> (Self, Arc<EmulatorOnTerminal>, Operator) {
        let controller = Arc::new(EmulatorOnTerminal::start(|_| ()));
        let system = RosSystem::start(free_port(), RosMiddleware::Rmw { domain: 0 });
        let wheels = Arc::clone(&controller);
        let rover = Self::start(&roboteq(&controller), system, move || {
            let [left, right] = wheels.with(|emulator| emulator.motors());
            let [left, right] = [left, right].map(|power| f64::from(power) / 127.0);
            [0.5 * (left + right), (right - left) / 0.5]
        });
        let anna = rover.live_rig.start_driving(&controller);
        (rover, controller, anna)
    }
}

#[test]
fn an_operator_drives_real_motors_and_silence_stops_them() {
    let (_rover, controller, mut anna) = Rover::with_roboteq();
    // The operator sends nothing any more.
    controller.assert_stops_for_good();
    let stopped = anna.wait_for_status("stopped", |teleop| {
        matches!(teleop.state, TeleopState::Held | TeleopState::Idle)
    });
    assert!(stopped.applied.linear_mps.abs() < 1e-6, "{stopped:?}");
    // It drives again and stops on release.
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
fn motors_stop_with_a_fault_when_their_guard_dies() {
    let (rover, controller, mut anna) = Rover::with_roboteq();
    let guard = guard_of(rover.edge.id());
    let killed = std::process::Command::new("kill")
        .args(["-KILL", &guard.to_string()])
        .status();
    assert!(killed.unwrap().success());
    // The key is held.
    anna.hold(AHEAD, Duration::from_secs(1));
    controller.assert_stops_for_good();
    let status = anna.wait_for_status("a fault", |teleop| {
        matches!(teleop.state, TeleopState::Fault(_))
    });
    assert!(status.applied.linear_mps.abs() < 1e-6, "{status:?}");
}

#[test]
fn an_emergency_stop_is_stored_in_the_state_directory() {
    let (rover, controller, mut anna) = Rover::with_roboteq();
    let answer = anna.ask(&EStop { press: 5 });
    assert!(matches!(answer, Answer::EStopped(_)), "{answer:?}");
    controller.assert_stops_for_good();
    let kept = fs::read_dir(rover.live_rig.state()).unwrap();
    assert!(kept.count() > 0);
}

#[test]
fn a_ros_system_gets_velocities_and_zero_at_every_stop() {
    for ros_middleware in [RosMiddleware::Rmw { domain: 0 }, RosMiddleware::Bridge] {
        let mut system = RosSystem::start(free_port(), ros_middleware);
        let received = system.subscribe_twist("/bot/cmd_vel");
        let moves = Arc::clone(&received);
        let motors = "[motors.ros2_twist]\ntopic = \"/bot/cmd_vel\"\n";
        let rover = Rover::start(motors, system, move || {
            let last = moves.lock().unwrap().last().copied();
            last.map_or([0.0, 0.0], |twist| [twist.linear_x, twist.angular_z])
        });
        let mut anna = rover.live_rig.operator();
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
        // The operator sends nothing any more.
        wait_until("zero", || last().unwrap().is_zero());
        anna.start_driving(AHEAD);
        rover.edge.signal("INT");
        wait_until("zero", || last().unwrap().is_zero());
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
