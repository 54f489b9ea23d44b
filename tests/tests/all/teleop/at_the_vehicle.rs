//! An emergency stop outlives the program, and somebody at the vehicle has a say.

use std::time::Duration;

use foreshore_tests::operator::{Input, Operator};
use protocol::message::{Answer, EStop, Refusal, Reset, TeleopState};
use tempfile::tempdir;

use super::robot::{CIRCLE, NAME, Robot};
use crate::link::processes::free_port;

#[test]
fn an_emergency_stop_is_found_again_after_the_program_was_killed() {
    let state = tempdir().unwrap();
    let port = free_port();
    let mut robot = Robot::start_with(
        port,
        &[
            "--listen",
            &format!("tcp/127.0.0.1:{port}"),
            "--state-dir",
            state.path().to_str().unwrap(),
        ],
    );
    let mut anna = Operator::ready(&robot.endpoint(), NAME, "anna");
    anna.start_driving(CIRCLE);
    let answer = anna.ask(&EStop { press: 1 });
    let Answer::EStopped(number) = answer else {
        panic!("{answer:?}")
    };
    robot.edge.signal("KILL");
    robot.restart();

    let mut bert = Operator::ready(&robot.endpoint(), NAME, "bert");
    let found = bert.wait_for_status("stopped", |teleop| teleop.state == TeleopState::EStop);
    assert_eq!(found.estop.map(|estop| estop.number), Some(number));
    bert.take_lease();
    bert.hold(Input::NEUTRAL, Duration::from_millis(400));
    bert.hold(CIRCLE, Duration::from_millis(400));
    let still = bert.wait_for_new_status();
    assert_eq!(still.state, TeleopState::EStop);
    assert!(still.applied.angular_radps.abs() < 1e-9, "{still:?}");
    assert_eq!(bert.ask(&Reset { estop: number }), Answer::Done);
    bert.start_driving(CIRCLE);

    // What was reset is not found again.
    robot.edge.signal("KILL");
    robot.restart();
    let mut carla = Operator::ready(&robot.endpoint(), NAME, "carla");
    carla.start_driving(CIRCLE);
}

#[test]
fn whoever_is_at_the_vehicle_stops_it_and_lets_it_go_again() {
    let robot = Robot::start();
    let mut anna = Operator::ready(&robot.endpoint(), NAME, "anna");
    anna.start_driving(CIRCLE);
    robot.edge.signal("USR2");
    anna.hold(CIRCLE, Duration::from_millis(600));
    let stopped = anna.wait_for_status("stopped", |teleop| teleop.state == TeleopState::EStop);
    assert!(stopped.applied.angular_radps.abs() < 1e-9, "{stopped:?}");
    let number = stopped.estop.unwrap().number;
    robot.edge.signal("USR1");
    anna.wait_for_status("let go", |teleop| teleop.state == TeleopState::Idle);
    assert_eq!(
        anna.ask(&Reset { estop: number }),
        Answer::Refused(Refusal::NoEStop)
    );
    anna.start_driving(CIRCLE);
    robot.verdict(&[&anna.journal]);
}
