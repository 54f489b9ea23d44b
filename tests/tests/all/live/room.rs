//! A vehicle in a room, in a closed loop of motors, pose and sensors.

use std::sync::Mutex;
use std::time::Duration;

use foreshore_tests::operator::{Input, PERIOD};
use measurement::pose::planar;
use measurement::scan::Scan;
use measurement::time::Monotonic;
use measurement::time::RobotTime;
use measurement::{Measurement, MeasurementData, StreamId};
use nalgebra::{Isometry2, UnitComplex, Vector2};
use protocol::message::CollisionMonitorState;
use recording::ros;
use robot_edge::clock::{self, sleep_until};

use super::driven::Rover;
use super::live_rig::TIMEOUT;
use super::ros_system::RosSystem;

/// Positions of the walls, metres; the vehicle starts at 0, along x.
const WALLS_X_M: [f64; 2] = [-3.0, 4.0];
const WALLS_Y_M: [f64; 2] = [-3.0, 3.0];

/// Period of odometry; every fifth time there is a scan.
const STEP: Duration = Duration::from_millis(20);

/// Half length and safety margin of the preset `generic2d`, metres.
const HALF_LENGTH_M: f64 = 0.25;
const MARGIN_M: f64 = 0.1;

/// Speeds of a vehicle, m/s and rad/s.
pub(super) type Speeds = [f64; 2];

/// The pose of the vehicle.
#[derive(Debug, Default)]
pub(super) struct Room(Mutex<Isometry2<f64>>);

impl Room {
    /// Moves the vehicle by its `speeds` and publishes odometry and scans until it `is_over`.
    pub(super) fn play(
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
    ros::encode(&measurement).unwrap().1
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
    let gap = gap_m();
    println!("{gap:.3} m are left");
    assert!((0.5 * MARGIN_M..MARGIN_M + 0.2).contains(&gap), "{gap} m");
    assert!(stands());
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
