//! Who may only watch.

use teleop::Role;

use super::*;
use crate::role::{OBSERVER_HINT, OPERATOR_HINT};

#[test]
fn an_observer_is_offered_nothing_and_told_why() {
    let mut rig = Rig::new();
    rig.teleop_client.role = Some(Role::Observer);
    rig.teleop_client.notice = Some(TeleopNotification::ObserverOnly);
    let data = rig.data();
    assert_eq!(
        (data.lease, &data.estop),
        (LeaseButtons::ReadOnly, &EStopButton::ReadOnly)
    );
    assert_eq!(data.notice, None, "the panel says so already");
    assert!(data.is_at_rest());
    for label in ["EMERGENCY STOP", "Request control"] {
        assert_eq!(rig.click(&format!("{label}. {OBSERVER_HINT}")), None);
    }
    assert_eq!(rig.click(OBSERVER_HINT), None, "it is said in the panel");

    rig.teleop.estop = Some(EStopStatus {
        number: 3,
        is_stored: true,
    });
    let in_force = EStopButton::InForce {
        number: 3,
        is_stored: true,
    };
    assert_eq!(rig.data().estop, in_force, "what is so is shown to all");
    assert_eq!(rig.click("Reset e-stop"), None);
    rig.teleop_client.role = Some(Role::Operator);
    let reset = Some(Command::Drive(Intent::Reset(3)));
    assert_eq!(rig.click("Reset e-stop"), reset, "an operator's");
}

#[test]
fn who_is_no_supervisor_can_only_ask_to_hand_over() {
    let mut rig = Rig::driving();
    rig.teleop.lease.holder = Some("bert".parse().unwrap());
    rig.teleop_client.lease = Lease::None;
    rig.teleop_client.role = Some(Role::Operator);
    assert_eq!(rig.data().lease, LeaseButtons::HeldByOther);
    assert_eq!(rig.click(&format!("Take over. {OPERATOR_HINT}")), None);
    let ask = Some(lease(LeaseRequest::Request));
    assert_eq!(rig.click("Request handover"), ask);
    for role in [None, Some(Role::Supervisor)] {
        rig.teleop_client.role = role;
        let take = Some(lease(LeaseRequest::TakeOver));
        assert_eq!(rig.click("Take over"), take, "{role:?}");
    }
}

#[test]
fn a_take_over_that_the_role_does_not_allow_says_whose_it_is() {
    for (request, says) in [
        (
            LeaseRequest::TakeOver,
            "Lease take-over refused: only supervisors take over",
        ),
        (
            LeaseRequest::Request,
            "Lease request refused: the sender's role does not allow it",
        ),
    ] {
        let mut rig = Rig::new();
        let refused = Answer::Refused(Refusal::Role);
        rig.teleop_client.notice = Some(TeleopNotification::Answered(
            RequestKind::Lease(request),
            refused,
        ));
        assert_eq!(rig.data().notice.as_deref(), Some(says));
    }
}
