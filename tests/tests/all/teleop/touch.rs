//! A pane of glass that the laser does not see: ultrasonic sensors stop the vehicle before it, bumpers at it.

use std::path::Path;
use std::time::Duration;

use foreshore_tests::operator::{Input, NEUTRAL, Operator};
use network::clock;
use protocol::message::{BarrierKind, TeleopState, TeleopStatus};

use super::robot::Robot;
use crate::processes::free_endpoint;

/// From the middle of the vehicle to its front, metres.
const FRONT_M: f64 = 0.75;
/// The face of the pane, metres ahead of the start.
const PANE_M: f64 = 3.0;

/// The elevation map in place of the octree, which takes most of a processor.
const MAPS: &str = "--set mapping.elevation.enabled=true --set mapping.octree.enabled=false \
                    --set mapping.cost.enabled=false --set mapping.rigidity.enabled=false";

const TIMEOUT: Duration = Duration::from_secs(90);

const AHEAD: Input = Input::of(0.3, 0.0);
const BACK: Input = Input::of(-0.3, 0.0);

fn start(options: &str) -> (Robot, Operator, Operator) {
    let world = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robot-edge/tests/cli/glass.toml");
    let endpoint = free_endpoint();
    let options = format!("--listen {endpoint} {MAPS} {options}");
    let robot = Robot::start_with(world.to_str().unwrap(), &endpoint, &options, |_| ());
    let [anna, bert] = ["anna", "bert"].map(|name| robot.operator(name));
    (robot, anna, bert)
}

/// Drives ahead until something of this kind holds the vehicle; returns the gap to the pane, metres.
fn drive_to(kind: BarrierKind, anna: &mut Operator, bert: &Operator) -> f64 {
    let is_held = |teleop: &TeleopStatus| {
        let is_of_kind = teleop.barrier.is_some_and(|barrier| barrier.kind == kind);
        is_of_kind && teleop.applied.linear_mps.abs() < 1e-3
    };
    let started = clock::now();
    // On a busy machine a command becomes too old, and it has to be pressed again.
    while !bert.teleop().as_ref().is_some_and(is_held) {
        assert!(clock::elapsed(started) < TIMEOUT, "{:?}", bert.teleop());
        anna.start_driving(AHEAD);
        let is_over = |teleop: &TeleopStatus| {
            is_held(teleop)
                || teleop.state != TeleopState::Driving
                || clock::elapsed(started) > TIMEOUT
        };
        anna.hold_until(AHEAD, || bert.teleop().as_ref().is_some_and(is_over));
    }
    anna.hold(AHEAD, Duration::from_secs(1));
    gap_m(anna)
}

fn gap_m(operator: &Operator) -> f64 {
    PANE_M - FRONT_M - operator.pose().position_m[0]
}

#[test]
fn ultrasound_stops_the_vehicle_before_glass_that_the_laser_does_not_see() {
    let (robot, mut anna, bert) = start("");
    let gap_m = drive_to(BarrierKind::Detected, &mut anna, &bert);
    // Nearer than 0.2 m the sensor only says that something is nearer, and it stops at once.
    assert!((0.05..0.25).contains(&gap_m), "{gap_m} m");
    robot.verdict(&[&anna.journal]);
}

#[test]
fn a_bumper_stops_the_vehicle_at_glass_and_lets_it_drive_away() {
    let deaf = "--topic ultrasonic_front_left=/none --topic ultrasonic_front_right=/none";
    let (robot, mut anna, bert) = start(deaf);
    let gap_m = drive_to(BarrierKind::Contact, &mut anna, &bert);
    assert!((-0.01..0.02).contains(&gap_m), "{gap_m} m");
    anna.hold(Input::NEUTRAL, NEUTRAL);
    anna.hold(BACK, Duration::from_secs(4));
    let gap_m = self::gap_m(&anna);
    assert!(gap_m > 0.2, "{gap_m} m");
    robot.verdict(&[&anna.journal]);
}
