//! A simulated robot is driven over real Zenoh sessions.

use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::operator::{Input, NEUTRAL, Operator};
use protocol::message::{
    Answer, EStop, LeaseRequest, Refusal, Reset, Setting, StopReason, TeleopState, TeleopStatus,
};
use protocol::signed::SecretKey;

use super::processes::{Running, free_port, simulate};

fn robot(port: u16) -> Running {
    let listen = format!("tcp/127.0.0.1:{port}");
    let mut command = simulate(&["--robot", "scout", "--listen", &listen]);
    Running::start(&mut command, "edge")
}

fn operator(port: u16, name: &str) -> Operator {
    Operator::ready(&format!("tcp/127.0.0.1:{port}"), "scout", name)
}

#[test]
fn silence_old_commands_and_held_keys_move_nothing() {
    let port = free_port();
    let _edge = robot(port);
    let mut anna = operator(port, "anna");
    anna.take_lease();

    // A key held before the grant moves nothing.
    anna.hold(Input::of(0.0, 0.5), NEUTRAL);
    let held = anna.wait_for_status("held", |teleop| teleop.state == TeleopState::Held);
    assert_eq!(held.lease.holder, Some(anna.name.clone()));
    assert!(held.applied.angular_radps.abs() < 1e-6, "{held:?}");

    anna.hold(Input::NEUTRAL, NEUTRAL);
    let driven = anna.hold(Input::of(0.0, 0.5), Duration::from_millis(1500));
    let status = anna.wait_for_status("driving", |teleop| teleop.applied.angular_radps > 0.45);
    assert_eq!(status.state, TeleopState::Driving);
    assert!(anna.turn_rate_radps() > 0.3, "{}", anna.turn_rate_radps());

    // The operator sends nothing any more.
    let stopped = anna.wait_for_status("stopped", |teleop| {
        teleop.state == TeleopState::Held || teleop.state == TeleopState::Idle
    });
    assert_eq!(stopped.last_stop, Some(StopReason::Age));
    assert!(stopped.applied.angular_radps.abs() < 1e-6, "{stopped:?}");
    assert_eq!(stopped.counters.involuntary_stops, 1);

    // Repeated commands move nothing, nor does the key that is still down.
    let refused = |teleop: &TeleopStatus| -> u64 {
        teleop
            .counters
            .refused
            .iter()
            .map(|refused| refused.count)
            .sum()
    };
    let before = refused(&anna.wait_for_status("shown", |_| true));
    for _ in 0..20 {
        anna.put(driven.clone());
    }
    anna.wait_for_status("refused", |teleop| refused(teleop) >= before + 20);
    anna.take_lease();
    anna.hold(Input::of(0.0, 0.5), Duration::from_millis(800));
    let locked = anna.wait_for_status("shown", |_| true);
    assert!(locked.applied.angular_radps.abs() < 1e-6, "{locked:?}");
    sleep(Duration::from_millis(300));
    assert!(
        anna.turn_rate_radps().abs() < 0.02,
        "{}",
        anna.turn_rate_radps()
    );

    // Released and pressed again, it turns.
    anna.hold(Input::NEUTRAL, NEUTRAL);
    anna.hold(Input::of(0.0, -0.5), Duration::from_millis(1200));
    anna.wait_for_status("turning right", |teleop| {
        teleop.applied.angular_radps < -0.3
    });
}

#[test]
fn an_emergency_stop_holds_until_it_is_reset() {
    let port = free_port();
    let _edge = robot(port);
    let (mut anna, mut bert) = (operator(port, "anna"), operator(port, "bert"));
    anna.take_lease();
    assert_eq!(bert.ask(&LeaseRequest::Request), Answer::Waiting);
    anna.hold(Input::NEUTRAL, NEUTRAL);
    anna.hold(Input::of(0.0, 0.5), Duration::from_secs(1));

    // The emergency stop needs no lease.
    let stopped = bert.ask(&EStop { press: 77 });
    let Answer::EStopped(number) = stopped else {
        panic!("{stopped:?}")
    };
    anna.hold(Input::of(0.0, 0.5), Duration::from_millis(400));
    anna.hold(Input::NEUTRAL, NEUTRAL);
    anna.hold(Input::of(0.0, 0.5), Duration::from_millis(400));
    let status = anna.wait_for_status("stopped", |teleop| teleop.state == TeleopState::EStop);
    assert!(status.applied.angular_radps.abs() < 1e-6, "{status:?}");

    assert_eq!(
        bert.ask(&Reset { estop: number + 1 }),
        Answer::Refused(Refusal::OtherEStop)
    );
    assert_eq!(bert.ask(&Reset { estop: number }), Answer::Done);
    anna.wait_for_status("idle", |teleop| teleop.state == TeleopState::Idle);
    // A late repetition of the press is refused.
    assert_eq!(
        bert.ask(&EStop { press: 77 }),
        Answer::Refused(Refusal::NoEStop)
    );
    assert_eq!(bert.ask(&Setting::BudgetKbps(64)), Answer::Done);
    anna.wait_for_status("set", |teleop| teleop.settings.budget_kbps == 64);
}

#[test]
fn a_signature_of_another_operator_moves_nothing() {
    let port = free_port();
    let _edge = robot(port);
    let (mut anna, mut mallory) = (operator(port, "anna"), operator(port, "anna"));
    mallory.key = SecretKey::from_seed(&[9; 32]);
    anna.take_lease();
    assert_eq!(
        mallory.ask(&LeaseRequest::Release),
        Answer::Refused(Refusal::Signature)
    );
    (mallory.epoch, mallory.seq) = (anna.epoch, 1000);
    mallory.hold(Input::NEUTRAL, Duration::from_millis(300));
    mallory.hold(Input::of(0.0, 0.5), Duration::from_millis(300));
    let status = anna.wait_for_status("refused", |teleop| {
        let refused = &teleop.counters.refused;
        let wrong = refused.iter().find(|of| of.reason == Refusal::Signature);
        wrong.is_some_and(|wrong| wrong.count >= 10)
    });
    assert!(status.applied.angular_radps.abs() < 1e-6, "{status:?}");
    assert_eq!(status.counters.accepted, 0);
}
