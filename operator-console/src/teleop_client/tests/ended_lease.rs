//! Keys that are pressed when the lease ends or is renewed.

use super::*;

/// A key that was pressed after the grant drives.
fn driving() -> Rig {
    let mut rig = Rig::held();
    rig.turn(&[W]);
    rig.run(100);
    assert!(rig.moves());
    rig.notes();
    rig
}

#[test]
fn lease_end_with_pressed_key_has_one_notice() {
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
        assert_eq!(rig.notes(), [note]);
        assert!(!rig.moves());
    }
}

#[test]
fn key_pressed_at_first_grant_is_locked_by_lease() {
    for waits in [false, true] {
        let mut rig = Rig::new();
        rig.ask(LeaseRequest::Request);
        rig.run(20);
        if waits {
            rig.answer(Answer::Waiting);
            rig.run(20);
        }
        rig.notes();
        // It comes before the queue with this event is drained.
        rig.teleop_client.apply(W);
        if waits {
            rig.status(|status| status.lease.epoch = 5);
        } else {
            rig.answer(Answer::Granted(5));
        }
        let lost = TeleopNotification::InputLocked(InputLockReason::Lease);
        assert!(rig.notes().contains(&lost), "{waits}");
    }
}

#[test]
fn key_of_renewed_lease_is_locked_by_renewal() {
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
        rig.notes(),
        [granted, lost, TeleopNotification::LeaseGained(5)]
    );
    rig.run(500);
    assert_eq!(rig.state().ignored, Some(InputLockReason::LeaseRenewed));
}
