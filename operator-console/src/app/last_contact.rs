//! What this run of the console has heard of a robot before it is shown, or shown again.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::RobotId;

use super::ConsoleApp;
use crate::link::SEEN_RECENTLY;
use crate::model::{LastContact, SILENT_AFTER_UNSTEADY};

/// A first link takes several round trips until something comes by it: more by QUIC and TLS, and where it is slow.
const FIRST_LINK: Duration = Duration::from_secs(5);

impl ConsoleApp {
    /// When a robot that is to be shown was heard last, by being shown or by being looked for.
    pub(super) fn last_contact(&self, robot: &RobotId, now: Monotonic) -> Option<LastContact> {
        let discovered_robots = self.discovery.discovered_robots();
        let discovered = discovered_robots
            .iter()
            .find(|one| one.found.robot == *robot)?;
        Some(LastContact {
            had_ended: discovered.has_ended(),
            ..before(discovered.seen, self.alerts.knows(robot), now)
        })
    }
}

/// Of a robot that was heard last at `last`; `was_shown`: its link is known to work.
fn before(last: Monotonic, was_shown: bool, now: Monotonic) -> LastContact {
    let patience = if now.since(last) > SEEN_RECENTLY {
        // Who was missed already is not waited for calmly.
        Duration::ZERO
    } else if was_shown {
        SILENT_AFTER_UNSTEADY
    } else {
        FIRST_LINK
    };
    LastContact {
        last,
        expected_from: now + patience,
        had_ended: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::at;

    #[test]
    fn a_robot_that_was_shown_is_missed_soon_and_one_that_was_silent_at_once() {
        for (last_ms, was_shown, missed_from_ms) in [
            (19_000, true, 21_500),
            (19_000, false, 25_000),
            (5_000, true, 21_500),
            (4_999, true, 20_000),
            (4_999, false, 20_000),
        ] {
            let expected = LastContact {
                last: at(last_ms),
                expected_from: at(missed_from_ms),
                had_ended: false,
            };
            let actual = before(at(last_ms), was_shown, at(20_000));
            assert_eq!(actual, expected, "{last_ms} {was_shown}");
        }
    }
}
