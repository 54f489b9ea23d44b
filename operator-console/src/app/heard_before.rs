//! What this run of the console has heard of a robot before it is shown, or shown again.

use std::time::Duration;

use protocol::keys::RobotId;
use robot_edge::clock::Monotonic;

use super::ConsoleApp;
use crate::link::SEEN_LATELY;
use crate::model::{HeardBefore, SLOWLY_SILENT_AFTER};

/// A first link takes several round trips until something comes by it: more by QUIC and TLS, and where it is slow.
const FIRST_LINK: Duration = Duration::from_secs(5);

impl ConsoleApp {
    /// When a robot that is to be shown was heard last, by being shown or by being looked for.
    pub(super) fn heard_before(&self, robot: &RobotId, now: Monotonic) -> Option<HeardBefore> {
        let sightings = self.discovery.sightings();
        let sighting = sightings.iter().find(|one| one.found.robot == *robot)?;
        Some(HeardBefore {
            had_ended: sighting.has_ended(),
            ..before(sighting.seen, self.alerts.knows(robot), now)
        })
    }
}

/// Of a robot that was heard last at `last`; `was_shown`: its link is known to work.
fn before(last: Monotonic, was_shown: bool, now: Monotonic) -> HeardBefore {
    let patience = if now.since(last) > SEEN_LATELY {
        // Who was missed already is not waited for calmly.
        Duration::ZERO
    } else if was_shown {
        SLOWLY_SILENT_AFTER
    } else {
        FIRST_LINK
    };
    HeardBefore {
        last,
        missed_from: now + patience,
        had_ended: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pretend::at;

    #[test]
    fn a_robot_that_was_shown_is_missed_soon_and_one_that_was_silent_at_once() {
        for (last_ms, was_shown, missed_from_ms) in [
            (19_000, true, 21_500),
            (19_000, false, 25_000),
            (5_000, true, 21_500),
            (4_999, true, 20_000),
            (4_999, false, 20_000),
        ] {
            let expected = HeardBefore {
                last: at(last_ms),
                missed_from: at(missed_from_ms),
                had_ended: false,
            };
            let told = before(at(last_ms), was_shown, at(20_000));
            assert_eq!(told, expected, "{last_ms} {was_shown}");
        }
    }
}
