//! Who may only watch.

use robot_edge::teleop::Role;

use super::*;
use crate::role::{ASKS, WATCHES};

#[test]
fn an_observer_is_offered_nothing_and_told_why() {
    let mut rig = Rig::new();
    rig.helm.role = Some(Role::Observer);
    rig.helm.notice = Some(Note::OnlyWatches);
    let data = rig.data();
    assert_eq!(
        (data.lease, &data.estop),
        (LeaseFace::Watching, &EStopFace::Watching)
    );
    assert_eq!(data.notice, None, "the panel says so already");
    assert!(data.is_at_rest());
    for label in ["EMERGENCY STOP", "Drive"] {
        assert_eq!(rig.click(&format!("{label}. {WATCHES}")), None);
    }
    assert_eq!(rig.click(WATCHES), None, "it is said in the panel");

    rig.teleop.estop = Some(EStopStatus {
        number: 3,
        is_stored: true,
    });
    let in_force = EStopFace::InForce {
        number: 3,
        is_stored: true,
    };
    assert_eq!(rig.data().estop, in_force, "what is so is shown to all");
    assert_eq!(rig.click("Reset it"), None);
    rig.helm.role = Some(Role::Operator);
    let reset = Some(Command::Drive(Intent::Reset(3)));
    assert_eq!(rig.click("Reset it"), reset, "an operator's");
}

#[test]
fn who_is_no_supervisor_can_only_ask_to_hand_over() {
    let mut rig = Rig::driving();
    rig.teleop.lease.holder = Some("bert".parse().unwrap());
    rig.helm.lease = Lease::None;
    rig.helm.role = Some(Role::Operator);
    assert_eq!(rig.data().lease, LeaseFace::Others);
    assert_eq!(rig.click(&format!("Take over. {ASKS}")), None);
    let ask = Some(lease(LeaseRequest::Request));
    assert_eq!(rig.click("Ask to hand over"), ask);
    for role in [None, Some(Role::Supervisor)] {
        rig.helm.role = role;
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
        rig.helm.notice = Some(Note::Answered(Asked::Lease(request), refused));
        assert_eq!(rig.data().notice.as_deref(), Some(says));
    }
}
