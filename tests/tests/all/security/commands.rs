//! Invalid commands of authorized operators, and commands of removed ones.

use std::fs;
use std::time::Duration;

use foreshore_tests::operator::{Input, NEUTRAL, refused};
use protocol::keys::{OperatorTopic, operator_key};
use protocol::message::{
    Answer, Drive, EStop, LeaseEnd, LeaseRequest, Refusal, Reset, StopReason, TeleopState,
    TeleopStatus,
};
use protocol::signed::{ENVELOPE_BYTES, Route, sign};
use zenoh::Wait as _;

use super::{TURN, audit, operator, position, robot, take_off};
use crate::fleet::{Fleet, text};
use crate::processes::free_port;

const ON: Drive = Drive {
    linear_mps: 0.0,
    lateral_mps: 0.0,
    angular_radps: 0.5,
    estop: None,
    docking: None,
    goal: None,
};

/// Sends commands that were changed, or signed for another time, robot or operator: none moves the vehicle.
fn nothing_that_was_changed_moves_the_vehicle(fleet: &Fleet, port: u16) {
    let (mut anna, bert) = (operator(fleet, "anna", port), operator(fleet, "bert", port));
    anna.take_lease();
    anna.hold(Input::NEUTRAL, NEUTRAL);
    let before = anna.wait_for_status("at rest", |teleop| teleop.state == TeleopState::Held);
    let count = |teleop: &TeleopStatus, why| refused(teleop, why) - refused(&before, why);
    let signature = |expected: u64| {
        move |teleop: &TeleopStatus| refused(teleop, Refusal::Signature) >= expected
    };
    let start = refused(&before, Refusal::Signature);

    // Tampered: another speed, epoch, number or signature.
    let places = [
        ENVELOPE_BYTES + 4,
        2 + 16 + 16,
        2 + 16 + 24,
        ENVELOPE_BYTES - 1,
    ];
    for (n, place) in places.into_iter().enumerate() {
        let mut message = anna.signed(&ON);
        message[place] ^= 1;
        anna.put(message);
        // Another epoch or number may be refused before the signature is checked.
        if n == 0 || n == 3 {
            anna.wait_for_status("refused", signature(start + n as u64 / 3 + 1));
        }
    }
    // Re-stamped: an older command with the newest token.
    let mut old = anna.signed(&ON);
    std::thread::sleep(Duration::from_millis(100));
    let newer = anna.signed(&ON);
    old[18..34].copy_from_slice(&newer[18..34]);
    let signatures = refused(&anna.wait_for_status("shown", |_| true), Refusal::Signature);
    anna.put(old);
    anna.wait_for_status("re-stamped refused", signature(signatures + 1));

    // Re-addressed: for another robot, and on another operator's key.
    let stamp = anna.stamp();
    let barge = "barge".parse().unwrap();
    let route = Route {
        robot: &barge,
        operator: &anna.name,
    };
    anna.put(sign(&anna.key, route, &stamp, &ON).unwrap());
    anna.wait_for_status("that for another robot refused", signature(signatures + 2));
    let message = anna.signed(&ON);
    bert.put(message.clone());
    let is_refused = |teleop: &TeleopStatus| refused(teleop, Refusal::NotHolder) > 0;
    bert.wait_for_status("that of another operator refused", is_refused);
    // On Anna's key by Bert: access control drops it without an answer.
    let key = operator_key(anna.robot(), &anna.name, OperatorTopic::Drive);
    bert.session().put(key, message).wait().unwrap();
    // A request on the key of another kind.
    let reset = anna.signed(&Reset { estop: 1 });
    let key = operator_key(anna.robot(), &anna.name, OperatorTopic::EStop);
    let replies = anna.session().get(key).payload(reset).wait().unwrap();
    let reply = replies
        .recv_timeout(Duration::from_secs(20))
        .unwrap()
        .unwrap();
    let bytes = reply.result().unwrap().payload().to_bytes();
    let answer: Answer = protocol::wire::decode(&bytes).unwrap().1;
    assert_eq!(answer, Answer::Refused(Refusal::Signature));

    let after = anna.wait_for_status("shown", |teleop| count(teleop, Refusal::Signature) >= 5);
    assert!(after.applied.angular_radps.abs() < 1e-6, "{after:?}");
    assert!(after.requested.angular_radps.abs() < 1e-6, "{after:?}");

    // A repeated command does not move the vehicle.
    anna.take_lease();
    anna.hold(Input::NEUTRAL, NEUTRAL);
    let last = anna.hold(TURN, Duration::from_secs(1));
    anna.wait_for_status("driving", |teleop| teleop.applied.angular_radps > 0.3);
    let stopped = anna.wait_for_status("stopped", |teleop| teleop.state != TeleopState::Driving);
    let accepted = stopped.counters.accepted;
    let all =
        |teleop: &TeleopStatus| -> u64 { teleop.counters.refused.iter().map(|of| of.count).sum() };
    let before = all(&stopped);
    // Slowly: datagrams of a burst may be lost.
    let mut after = stopped;
    while all(&after) < before + 20 {
        for _ in 0..10 {
            anna.put(last.clone());
            std::thread::sleep(Duration::from_millis(5));
        }
        after = anna.wait_for_new_status();
    }
    assert_eq!(after.counters.accepted, accepted);
    anna.session().close().wait().unwrap();
    bert.session().close().wait().unwrap();
}

#[test]
fn commands_changed_on_the_way_move_nothing() {
    let (fleet, port) = (Fleet::new(), free_port());
    let _edge = robot(&fleet, "--listen", port);
    nothing_that_was_changed_moves_the_vehicle(&fleet, port);
}

#[test]
fn commands_changed_behind_a_router_move_nothing() {
    let (fleet, port) = (Fleet::new(), free_port());
    let _router = fleet.router(port);
    let _edge = robot(&fleet, "--connect", port);
    nothing_that_was_changed_moves_the_vehicle(&fleet, port);
}

/// Behind a router, which still forwards the commands of a removed operator.
#[test]
fn a_removed_operator_cannot_drive_and_the_audit_log_says_so() {
    let (fleet, port) = (Fleet::new(), free_port());
    let _router = fleet.router(port);
    let edge = robot(&fleet, "--connect", port);
    let (mut anna, mut bert) = (
        operator(&fleet, "anna", port),
        operator(&fleet, "bert", port),
    );
    anna.take_lease();
    anna.hold(Input::NEUTRAL, NEUTRAL);
    anna.hold(TURN, Duration::from_secs(1));
    anna.wait_for_status("driving", |teleop| teleop.applied.angular_radps > 0.3);

    // A broken list stays without effect.
    let path = fleet.vehicle().join("operators.toml");
    let whole = text(&path);
    fs::write(&path, &whole[..whole.len() - 30]).unwrap();
    anna.hold(TURN, Duration::from_millis(1500));
    anna.wait_for_status("driving still", |teleop| teleop.applied.angular_radps > 0.3);

    fs::write(&path, &whole).unwrap();
    take_off(&fleet, "anna");
    // She holds the key.
    anna.hold(TURN, Duration::from_millis(1500));
    let revoked = StopReason::LeaseEnded(LeaseEnd::Revoked);
    let status = bert.wait_for_status("revoked", |teleop| {
        teleop.last_stop == Some(revoked) && teleop.state == TeleopState::Idle
    });
    assert_eq!(status.lease.holder, None);
    assert!(status.applied.angular_radps.abs() < 1e-6, "{status:?}");
    for answer in [
        anna.ask(&LeaseRequest::Request),
        anna.ask(&EStop { press: 5 }),
    ] {
        assert_eq!(answer, Answer::Refused(Refusal::Signature));
    }
    // Bert is still on the list.
    bert.take_lease();
    let Answer::EStopped(number) = bert.ask(&EStop { press: 6 }) else {
        panic!("no emergency stop")
    };
    let mut sam = operator(&fleet, "sam", port);
    // His token may be older than the emergency stop; then he asks again.
    let too_early = Answer::Refused(Refusal::EStopSince);
    let answer = (0..100).find_map(|_| {
        std::thread::sleep(Duration::from_millis(50));
        let answer = sam.ask(&Reset { estop: number });
        (answer != too_early).then_some(answer)
    });
    assert_eq!(answer, Some(Answer::Done));
    for operator in [&anna, &bert, &sam] {
        operator.session().close().wait().unwrap();
    }
    edge.interrupt();

    let log = audit(&fleet);
    let at = |kind: &str, says: &str| position(&log, kind, says);
    let order = [
        at("start", "configuration "),
        at("connect", "router: connects, control, from "),
        at("lease_granted", "anna drives"),
        at("operators_unreadable", "stays in force"),
        at("operators", "off it operator:anna"),
        at(
            "lease_ended",
            "anna no longer drives: the leave to drive was taken away",
        ),
        at(
            "refused",
            "a driving command in the name of anna: its signature is wrong",
        ),
        at("lease_granted", "bert drives"),
        at("estop", "by bert"),
        at("estop_reset", "by sam"),
    ];
    assert!(order.is_sorted(), "{order:?} {log:#?}");
    at("disconnect", "router: is gone, control, from ");
    // Each kind of refused request has a line of its own.
    let unsigned = "in the name of anna: its signature is wrong";
    at("refused", &format!("a request of the lease {unsigned}"));
    at("refused", &format!("an emergency stop {unsigned}"));
    let refusals = log.iter().filter(|(kind, _)| kind == "refused").count();
    assert!(
        refusals < 14,
        "at most one a second for each request and reason: {refusals}"
    );
}
