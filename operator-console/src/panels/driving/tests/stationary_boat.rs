//! A boat without thrust that stays where it is.

use super::*;

#[test]
fn a_boat_that_stays_where_it_is_stands_without_being_held() {
    let unheld = "No thrust: wind and current may move it";
    let coasts = "No thrust: it coasts, and wind and current move it";
    for state in [TeleopState::Idle, TeleopState::Held] {
        for (velocity, headline, advice) in [
            ([0.0; 2], "Standing, not held", unheld),
            ([-0.04, 0.01], "Standing, not held", unheld),
            ([0.2, 0.0], "Drifting", coasts),
            ([0.0, 0.1], "Drifting", coasts),
        ] {
            let mut rig = Rig::new();
            rig.teleop.state = state;
            rig.teleop.is_drifting = true;
            rig.is_boat = true;
            rig.velocity = velocity;
            let data = rig.data();
            let said = (data.headline.as_str(), data.advice.as_deref());
            assert_eq!(said, (headline, Some(advice)), "{state:?} {velocity:?}");
            assert_eq!(data.tone, Tone::Warning, "it has no brakes");
        }
    }
}
