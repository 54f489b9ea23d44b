//! Operators without the right to drive or to stop: observers, and a role that was revoked while the console runs.

use protocol::message::Setting;
use teleop::Role;

use super::*;

/// The client of an operator with this role, connected to a robot.
fn teleop_client(role: Option<Role>) -> TeleopClient {
    let identity = Identity {
        role,
        ..Identity::without_keys("tv".parse().unwrap())
    };
    let mut teleop_client = TeleopClient::new("scout".parse().unwrap(), identity, 7);
    let newest = LatestPose {
        boot: BOOT,
        token: Some(AgeToken { n: 1, nonce: 2 }),
        velocity: [0.0; 3],
        at: at(1_000),
    };
    teleop_client.begin(Some(newest), at(1_000));
    teleop_client.apply(InputEvent::Focus(true));
    teleop_client
}

fn end(teleop_client: &mut TeleopClient) -> (usize, Vec<TeleopNotification>) {
    let sent = teleop_client.end(at(1_010)).len();
    (sent, teleop_client.take_notifications().into())
}

#[test]
fn observer_sends_nothing_and_gets_a_notice() {
    let rejected = (0, vec![TeleopNotification::ObserverOnly]);
    for intent in [
        Intent::EStop,
        Intent::Lease(LeaseRequest::Request),
        Intent::Reset(3),
        Intent::Set(Setting::CollisionMonitor(false)),
    ] {
        let mut teleop_client = teleop_client(Some(Role::Observer));
        teleop_client.submit(intent.clone(), at(1_005));
        assert_eq!(end(&mut teleop_client), rejected, "{intent:?}");
        assert_eq!(teleop_client.state(at(1_010)).estop, EStopState::Quiet);
        assert_eq!(end(&mut teleop_client), (0, Vec::new()), "once a press");
    }
    for (key, expected) in [
        (DriveKey::W, rejected),
        // It moves the map without a lease.
        (DriveKey::Up, (0, Vec::new())),
    ] {
        let mut teleop_client = teleop_client(Some(Role::Observer));
        teleop_client.apply(InputEvent::Press(key));
        assert_eq!(end(&mut teleop_client), expected, "{key:?}");
    }
}

#[test]
fn possible_operators_can_stop() {
    for role in [None, Some(Role::Operator), Some(Role::Supervisor)] {
        let mut teleop_client = teleop_client(role);
        teleop_client.submit(Intent::EStop, at(1_005));
        let (sent, notifications) = end(&mut teleop_client);
        assert!(sent > 0, "{role:?}");
        assert_eq!(
            notifications,
            [TeleopNotification::EStopPressed],
            "{role:?}"
        );
    }
}

const REFUSED: EStopState = EStopState::Refused(Refusal::Role);

/// Presses once with this answer; returns the sent presses and the notifications.
fn press(rig: &mut Rig, answer: Answer) -> (Vec<u64>, Vec<TeleopNotification>) {
    rig.since();
    rig.turn(&[InputEvent::EStop]);
    assert!(matches!(rig.state().estop, EStopState::Sending(_)));
    rig.answer(answer);
    rig.run(300);
    let sent = rig.since().into_iter().filter_map(|(_, _, read)| {
        if let Read::EStop(estop) = read {
            Some(estop.press)
        } else {
            None
        }
    });
    (sent.collect(), rig.notes())
}

#[test]
fn each_press_is_sent_and_refusal_stays() {
    let mut rig = Rig::new();
    let mut presses = Vec::new();
    for (answer, says) in [
        (
            Refusal::Role,
            TeleopNotification::EStopRefused(Refusal::Role),
        ),
        // Its copy in a drive command has overtaken the query: the robot takes the query for a repetition.
        (Refusal::NoEStop, TeleopNotification::EStopNotInForce),
        (
            Refusal::Role,
            TeleopNotification::EStopRefused(Refusal::Role),
        ),
    ] {
        let (sent, notifications) = press(&mut rig, Answer::Refused(answer));
        assert_eq!(notifications, [TeleopNotification::EStopPressed, says]);
        assert_eq!(sent.len(), 1, "{answer:?}");
        presses.extend(sent);
        assert_eq!(rig.state().estop, REFUSED, "{answer:?}");
        rig.run(60_000);
        assert_eq!(rig.state().estop, REFUSED, "a minute later");
    }
    presses.dedup();
    assert_eq!(presses.len(), 3, "each is another: {presses:?}");
}

#[test]
fn inactive_stop_shows_a_notice() {
    let mut rig = Rig::new();
    press(&mut rig, Answer::Refused(Refusal::NoEStop));
    let state = rig.state();
    assert_eq!(state.estop, EStopState::Quiet);
    assert_eq!(state.notice, Some(TeleopNotification::EStopNotInForce));
}

#[test]
fn notice_of_inactive_stop_clears_with_a_new_stop() {
    let says_none = |rig: &Rig| {
        let state = rig.state();
        state.notice == Some(TeleopNotification::EStopNotInForce)
    };
    let mut rig = Rig::new();
    press(&mut rig, Answer::Refused(Refusal::NoEStop));
    assert!(says_none(&rig));
    rig.turn(&[InputEvent::EStop]);
    assert!(!says_none(&rig), "a new press is unacknowledged");
    // Another operator stops the robot.
    let mut rig = Rig::new();
    press(&mut rig, Answer::Refused(Refusal::NoEStop));
    rig.status(|status| status.estop = None);
    assert!(says_none(&rig), "there is none");
    rig.status(|status| {
        status.state = TeleopState::EStop;
        status.estop = Some(STORED_ESTOP);
    });
    assert!(!says_none(&rig), "there is one");
}

#[test]
fn refusal_ends_when_the_robot_accepts_stops() {
    for change in [
        |rig: &mut Rig| {
            rig.ask(LeaseRequest::Request);
            rig.run(20);
            rig.answer(Answer::Granted(4));
        },
        |rig: &mut Rig| {
            press(rig, Answer::EStopped(1));
        },
        |rig: &mut Rig| {
            rig.boot = BootId([8; 16]);
            rig.run(100);
        },
    ] {
        let mut rig = Rig::new();
        press(&mut rig, Answer::Refused(Refusal::Role));
        assert_eq!(rig.state().estop, REFUSED);
        change(&mut rig);
        assert_eq!(rig.state().estop, EStopState::Quiet);
    }
}
