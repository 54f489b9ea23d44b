//! Who may only watch.

use super::*;
use crate::role::WATCHES;

#[test]
fn an_observer_is_offered_nothing_and_told_why() {
    let mut rig = Rig::new();
    rig.helm.only_watches = true;
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
    rig.helm.only_watches = false;
    let reset = Some(Command::Drive(Intent::Reset(3)));
    assert_eq!(rig.click("Reset it"), reset, "an operator's");
}
