//! The emergency stop of an operator whose access was revoked while the console runs.

use super::*;

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
        status.estop = Some(EStopStatus {
            number: 3,
            is_stored: true,
        });
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
