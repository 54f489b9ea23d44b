//! A live vehicle with an emulated Roboteq AX3500 at a pseudo-terminal, in a room: a closed loop of motors, pose and sensors.

use std::fs;
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::operator::{Input, Operator, PERIOD};
use measurement::pose::planar;
use measurement::scan::Scan;
use measurement::time::{Monotonic, RobotTime};
use measurement::{Measurement, MeasurementData, StreamId};
use nalgebra::{Isometry2, UnitComplex, Vector2};
use network::clock::{self, sleep_until};
use protocol::message::{Answer, CollisionMonitorState, EStop, TeleopState};
use recording::ros;
use rustix::process::Signal;

use super::emulator::on_terminal::EmulatorOnTerminal;
use super::live_rig::{AHEAD, LiveRig, TIMEOUT, VEHICLE, guard_of, roboteq, signal};
use super::ros_system::{RosMiddleware, RosSystem};
use crate::processes::{Running, free_port, wait_until};

/// Positions of the walls, metres; the vehicle starts at 0, along x.
const WALLS_X_M: [f64; 2] = [-3.0, 4.0];
const WALLS_Y_M: [f64; 2] = [-3.0, 3.0];

/// Period of odometry; every fifth time there is a scan.
const STEP: Duration = Duration::from_millis(20);

/// Half length and safety margin of the preset `generic2d`, metres.
const HALF_LENGTH_M: f64 = 0.25;
const MARGIN_M: f64 = 0.1;

/// Speeds of a vehicle, m/s and rad/s.
type Speeds = [f64; 2];

/// The pose of the vehicle.
#[derive(Debug, Default)]
struct Room(Mutex<Isometry2<f64>>);

impl Room {
    /// Moves the vehicle by its `speeds` and publishes odometry and scans until it `is_over`.
    fn play(
        &self,
        system: &mut RosSystem,
        speeds: impl Fn() -> Speeds,
        is_over: impl Fn() -> bool,
    ) {
        let mut last = clock::now();
        for step in 0_u32.. {
            let now = clock::now();
            let pose = self.drive(speeds(), now.since(last).as_secs_f64());
            last = now;
            let stamp = 1_790_000_000_000_000_000 + now.since(Monotonic::default()).as_nanos();
            let stamp = RobotTime::from_nanos(stamp as i64);
            system.publish("/odom", &odometry(stamp, pose));
            if step % 5 == 0 {
                if is_over() {
                    return;
                }
                system.publish("/scan", &scan(stamp, pose));
            }
            sleep_until(now + STEP, || false);
        }
    }

    fn drive(&self, [linear_mps, angular_radps]: Speeds, time_s: f64) -> Isometry2<f64> {
        let mut pose = self.0.lock().unwrap();
        *pose *= Isometry2::new(
            Vector2::new(linear_mps * time_s, 0.0),
            angular_radps * time_s,
        );
        *pose
    }

    /// Distance from its front to the wall ahead, metres.
    fn gap_m(&self) -> f64 {
        WALLS_X_M[1] - HALF_LENGTH_M - self.0.lock().unwrap().translation.x
    }
}

fn message(stamp: RobotTime, frame: &str, data: MeasurementData) -> Vec<u8> {
    let measurement = Measurement {
        stamp,
        stream: StreamId(0),
        frame: frame.into(),
        data,
    };
    ros::encode(&measurement, "").unwrap().1
}

fn odometry(stamp: RobotTime, pose: Isometry2<f64>) -> Vec<u8> {
    let (place, yaw) = (pose.translation, pose.rotation.angle());
    let data = MeasurementData::Odometry {
        child: "base_link".into(),
        odom_from_base: planar(place.x, place.y, yaw),
    };
    message(stamp, "odom", data)
}

/// A beam per degree, all around.
fn scan(stamp: RobotTime, pose: Isometry2<f64>) -> Vec<u8> {
    let beam = |degrees: u32| {
        let angle = (f64::from(degrees) - 180.0).to_radians();
        let along = pose * UnitComplex::new(angle) * Vector2::x();
        let to_wall =
            |walls: [f64; 2], at: f64, along: f64| (walls[usize::from(along > 0.0)] - at) / along;
        let place = pose.translation;
        to_wall(WALLS_X_M, place.x, along.x).min(to_wall(WALLS_Y_M, place.y, along.y)) as f32
    };
    let scan = Scan {
        angle_min_rad: -std::f32::consts::PI,
        angle_increment_rad: 1_f32.to_radians(),
        time_increment_s: 0.0,
        range_min_m: 0.1,
        range_max_m: 20.0,
        ranges_m: (0..360).map(beam).collect(),
    };
    let own_pose = None;
    message(stamp, "laser", MeasurementData::Scan { scan, own_pose })
}

/// A vehicle with one laser, in a room.
struct Rover {
    edge: Running,
    live_rig: LiveRig,
    room: Arc<Room>,
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
    fn with_roboteq() -> (Self, Arc<EmulatorOnTerminal>, Operator) {
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
    signal(guard, Signal::KILL);
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
    const RMW: RosMiddleware = RosMiddleware::Rmw { domain: 0 };
    for (ros_middleware, type_name) in [
        (RMW, "geometry_msgs/msg/Twist"),
        (RMW, "geometry_msgs/msg/TwistStamped"),
        (RosMiddleware::Bridge, "geometry_msgs/msg/Twist"),
        (RosMiddleware::Bridge, "geometry_msgs/msg/TwistStamped"),
    ] {
        let mut system = RosSystem::start(free_port(), ros_middleware);
        let received = system.subscribe_twist("/bot/cmd_vel", type_name);
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

#[test]
fn real_motors_stop_before_a_wall_with_the_key_held() {
    let (rover, controller, mut anna) = Rover::with_roboteq();
    let (fast, gap_m) = (Input::of(0.6, 0.0), || rover.room.gap_m());
    let stands = || controller.with(|emulator| emulator.motors() == [0, 0]);
    let started = clock::now();
    // On a busy machine it may stop for another reason before.
    while gap_m() > MARGIN_M + 0.2 {
        assert!(clock::elapsed(started) < TIMEOUT, "{} m", gap_m());
        anna.start_driving(fast);
        anna.hold(fast, PERIOD * 25);
        anna.hold_until(fast, || stands() || gap_m() < 0.0);
    }
    // After the last creeping it stands, with the key down.
    anna.hold(fast, PERIOD * 100);
    let held = clock::now();
    anna.hold_until(fast, || {
        assert!(clock::elapsed(held) < TIMEOUT, "{} m", gap_m());
        stands()
    });
    let gap = gap_m();
    println!("{gap:.3} m are left");
    assert!((0.5 * MARGIN_M..MARGIN_M + 0.2).contains(&gap), "{gap} m");
    let status = anna.wait_for_new_status();
    assert!(
        matches!(status.collision_monitor, CollisionMonitorState::On(_)),
        "{status:?}"
    );
    // Backwards the way is free.
    anna.start_driving(Input::of(-0.3, 0.0));
    anna.hold(Input::of(-0.3, 0.0), PERIOD * 100);
    assert!(gap_m() > gap + 0.2, "{} m", gap_m());
}
