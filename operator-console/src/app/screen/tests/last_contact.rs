//! A robot that is shown again, and heard no more.

use super::*;
use crate::model::LastContact;

#[test]
fn a_robot_that_was_heard_before_it_was_shown_is_missed() {
    let rig_at = |now_ms| {
        let mut rig = Rig::with_robot();
        rig.model.as_mut().unwrap().set_last_contact(LastContact {
            last: at(4_000),
            expected_from: at(20_000),
            had_ended: false,
        });
        rig.now = at(now_ms);
        rig.window()
    };
    let calm = rig_at(19_000);
    check(&calm, &["Waiting", "15 s ago"], &["Link lost", "Silent"]);
    let missed = rig_at(20_000);
    let says = [
        "Silent",
        "Link lost: no data for 16 s",
        "16 s ago",
        "Its map is fetched on reconnection",
        "1 alert",
    ];
    check(&missed, &says, &["Waiting", "No map yet", "No alerts"]);
}
