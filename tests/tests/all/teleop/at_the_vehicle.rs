//! An emergency stop survives the program; signals at the vehicle stop and release it.

use std::time::Duration;

use foreshore_tests::operator::{Input, Operator};
use protocol::message::{Answer, EStop, Refusal, Reset, TeleopState};
use tempfile::tempdir;

use super::robot::{CIRCLE, NAME, Robot};
use crate::link::processes::free_port;

#[test]
fn an_emergency_stop_survives_a_kill() {
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

    // A reset one is not restored.
    robot.edge.signal("KILL");
    robot.restart();
    let mut carla = Operator::ready(&robot.endpoint(), NAME, "carla");
    carla.start_driving(CIRCLE);
}

#[test]
fn signals_at_the_vehicle_stop_and_release_it() {
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
