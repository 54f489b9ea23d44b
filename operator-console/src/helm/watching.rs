//! The helm of who may only watch: nothing is sent, and every attempt is answered in words.

use robot_edge::clock::Monotonic;

use super::{Helm, Intent, Note};
use crate::role::only_watches;
use crate::teleop_input::{DriveKey, InputEvent};

impl Helm {
    /// Whether its operator is proven to be an observer.
    pub(super) const fn only_watches(&self) -> bool {
        only_watches(self.identity.role)
    }

    /// What was applied last may be an attempt to drive. The arrows move the map where nobody drives, and are none.
    pub(super) fn look_for_attempt(&mut self, event: InputEvent) {
        let drives = match event {
            InputEvent::Press(key) => match key {
                DriveKey::W | DriveKey::A | DriveKey::S | DriveKey::D => true,
                DriveKey::Up | DriveKey::Left | DriveKey::Down | DriveKey::Right => false,
            },
            InputEvent::Pad(_) => true,
            InputEvent::StillDown(_)
            | InputEvent::Release(_)
            | InputEvent::EStop
            | InputEvent::Step(_)
            | InputEvent::PadGone
            | InputEvent::Focus(_)
            | InputEvent::Visible(_)
            | InputEvent::Typing(_) => false,
        };
        self.has_attempted |= drives && self.only_watches() && !self.input.wish().is_neutral();
    }

    /// Whether it is not for who only watches, which is then said.
    pub(super) fn denies(&mut self, intent: &Intent, now: Monotonic) -> bool {
        let is_denied = self.only_watches()
            && match intent {
                // Said in the iteration that takes the press.
                Intent::EStop | Intent::Step(_) => false,
                Intent::Reset(_) | Intent::Lease(_) | Intent::Set(_) => true,
            };
        if is_denied {
            self.warn(now, Note::OnlyWatches);
        }
        is_denied
    }
}

#[cfg(test)]
mod tests {
    use protocol::message::{AgeToken, LeaseRequest, Setting};
    use robot_edge::teleop::Role;

    use super::*;
    use crate::helm::{EStopSight, Newest};
    use crate::identity::Identity;
    use crate::pretend::{BOOT, at};

    /// The helm of somebody of this role, at a robot that is heard.
    fn helm(role: Option<Role>) -> Helm {
        let identity = Identity {
            role,
            ..Identity::without_keys("tv".parse().unwrap())
        };
        let mut helm = Helm::new("scout".parse().unwrap(), identity, 7);
        let newest = Newest {
            boot: BOOT,
            token: Some(AgeToken { n: 1, nonce: 2 }),
            velocity: [0.0; 2],
            at: at(1_000),
        };
        helm.begin(Some(newest), at(1_000));
        helm.apply(InputEvent::Focus(true));
        helm
    }

    /// How many messages were sent, and what was noted.
    fn end(helm: &mut Helm) -> (usize, Vec<Note>) {
        let sent = helm.end(at(1_010)).len();
        let notes = helm.take_notes().into_iter();
        (sent, notes.map(|(_, note)| note).collect())
    }

    #[test]
    fn whatever_an_observer_presses_nothing_is_sent_and_they_are_told_why() {
        let told = (0, vec![Note::OnlyWatches]);
        for intent in [
            Intent::EStop,
            Intent::Lease(LeaseRequest::Request),
            Intent::Reset(3),
            Intent::Set(Setting::Guard(false)),
        ] {
            let mut helm = helm(Some(Role::Observer));
            helm.want(intent.clone(), at(1_005));
            assert_eq!(end(&mut helm), told, "{intent:?}");
            assert_eq!(helm.sight(at(1_010)).estop, EStopSight::Quiet);
            assert_eq!(end(&mut helm), (0, Vec::new()), "once a press");
        }
        for (key, expected) in [
            (DriveKey::W, told),
            // The map's, where nobody drives.
            (DriveKey::Up, (0, Vec::new())),
        ] {
            let mut helm = helm(Some(Role::Observer));
            helm.apply(InputEvent::Press(key));
            assert_eq!(end(&mut helm), expected, "{key:?}");
        }
    }

    #[test]
    fn whoever_may_have_the_right_sends_the_stop() {
        for role in [None, Some(Role::Operator), Some(Role::Supervisor)] {
            let mut helm = helm(role);
            helm.want(Intent::EStop, at(1_005));
            let (sent, notes) = end(&mut helm);
            assert!(sent > 0, "{role:?}");
            assert_eq!(notes, [Note::EStopPressed], "{role:?}");
        }
    }
}
