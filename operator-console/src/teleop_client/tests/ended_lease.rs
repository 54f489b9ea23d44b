//! Keys that are down when the lease ends, or is granted anew: what is said of them is true.

use super::*;

/// What was noted since the last call.
fn notifications(rig: &mut Rig) -> Vec<TeleopNotification> {
    let notifications = rig.teleop_client.take_notifications().into_iter();
    notifications.map(|(_, note)| note).collect()
}

/// A key drives that was pressed after the grant.
fn driving() -> Rig {
    let mut rig = Rig::held();
    rig.turn(&[W]);
    rig.run(100);
    assert!(rig.moves());
    notifications(&mut rig);
    rig
}

#[test]
fn of_a_lease_that_ends_with_a_key_down_the_end_alone_is_said() {
    type End = fn(&mut Rig);
    let ends: [(End, TeleopNotification); 3] = [
        (
            |rig| rig.ask(LeaseRequest::Release),
            TeleopNotification::LeaseReleased,
        ),
        (
            |rig| rig.status(|status| status.lease.holder = None),
            TeleopNotification::LeaseLost,
        ),
        (
            |rig| rig.status(|status| status.lease.epoch = 5),
            TeleopNotification::LeaseLost,
        ),
    ];
    for (end, note) in ends {
        let mut rig = driving();
        end(&mut rig);
        rig.run(100);
        assert_eq!(notifications(&mut rig), [note]);
        assert!(!rig.moves());
    }
}

#[test]
fn a_key_that_is_down_when_the_first_grant_comes_was_down_before() {
    for waits in [false, true] {
        let mut rig = Rig::new();
        rig.ask(LeaseRequest::Request);
        rig.run(20);
        if waits {
            rig.answer(Answer::Waiting);
            rig.run(20);
        }
        notifications(&mut rig);
        // It comes before the queue that this is in has been dealt with.
        rig.teleop_client.apply(W);
        if waits {
            rig.status(|status| status.lease.epoch = 5);
        } else {
            rig.answer(Answer::Granted(5));
        }
        let lost = TeleopNotification::InputLocked(InputLockReason::Lease);
        assert!(notifications(&mut rig).contains(&lost), "{waits}");
    }
}

#[test]
fn a_key_that_drove_by_another_grant_was_not_down_before_anybody_drove() {
    let mut rig = driving();
    rig.ask(LeaseRequest::Request);
    rig.run(20);
    rig.answer(Answer::Granted(5));
    let granted = TeleopNotification::Answered(
        RequestKind::Lease(LeaseRequest::Request),
        Answer::Granted(5),
    );
    let lost = TeleopNotification::InputLocked(InputLockReason::LeaseRenewed);
    assert_eq!(
        notifications(&mut rig),
        [granted, lost, TeleopNotification::LeaseGained(5)]
    );
    rig.run(500);
    assert_eq!(
        rig.teleop_client.state(at(rig.ms)).ignored,
        Some(InputLockReason::LeaseRenewed)
    );
}
