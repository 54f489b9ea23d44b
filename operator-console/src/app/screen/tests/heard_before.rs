//! A robot that is shown again, and heard no more.

use super::*;
use crate::model::HeardBefore;

#[test]
fn a_robot_that_was_heard_before_it_was_shown_is_missed() {
    let rig_at = |now_ms| {
        let mut rig = Rig::with_robot();
        rig.model.as_mut().unwrap().was_heard(HeardBefore {
            last: at(4_000),
            missed_from: at(20_000),
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
        "Link lost: nothing heard for 16 s",
        "16 s ago",
        "Its map is fetched when it is heard",
        "1 alert",
    ];
    check(&missed, &says, &["Waiting", "No map yet", "No alerts"]);
}
