//! The helm of who may only watch: nothing is sent, and every attempt is answered in words.

use measurement::time::Monotonic;

use super::{Intent, TeleopClient, TeleopNotification};
use crate::role::is_observer;
use crate::teleop_input::{DriveKey, InputEvent};

impl TeleopClient {
    /// Whether its operator is proven to be an observer.
    pub(super) const fn is_observer(&self) -> bool {
        is_observer(self.identity.role)
    }

    /// What was applied last may be an attempt to drive. The arrows move the map where nobody drives, and are none.
    pub(super) fn detect_drive_attempt(&mut self, event: InputEvent) {
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
        self.has_attempted_to_drive |=
            drives && self.is_observer() && !self.input.drive_input().is_neutral();
    }

    /// Whether it is not for who only watches, which is then said.
    pub(super) fn rejects(&mut self, intent: &Intent, now: Monotonic) -> bool {
        let is_denied = self.is_observer()
            && match intent {
                // Said in the iteration that takes the press.
                Intent::EStop | Intent::Step(_) => false,
                Intent::Reset(_) | Intent::Lease(_) | Intent::Set(_) => true,
            };
        if is_denied {
            self.warn(now, TeleopNotification::ObserverOnly);
        }
        is_denied
    }
}

#[cfg(test)]
mod tests {
    use protocol::message::{AgeToken, LeaseRequest, Setting};
    use teleop::Role;

    use super::*;
    use crate::identity::Identity;
    use crate::teleop_client::{EStopState, LatestPose};
    use crate::test_support::{BOOT, at};

    /// The helm of somebody of this role, at a robot that is heard.
    fn teleop_client(role: Option<Role>) -> TeleopClient {
        let identity = Identity {
            role,
            ..Identity::without_keys("tv".parse().unwrap())
        };
        let mut teleop_client = TeleopClient::new("scout".parse().unwrap(), identity, 7);
        let newest = LatestPose {
            boot: BOOT,
            token: Some(AgeToken { n: 1, nonce: 2 }),
            velocity: [0.0; 2],
            at: at(1_000),
        };
        teleop_client.begin(Some(newest), at(1_000));
        teleop_client.apply(InputEvent::Focus(true));
        teleop_client
    }

    /// How many messages were sent, and what was noted.
    fn end(teleop_client: &mut TeleopClient) -> (usize, Vec<TeleopNotification>) {
        let sent = teleop_client.end(at(1_010)).len();
        let notifications = teleop_client.take_notifications().into_iter();
        (sent, notifications.map(|(_, note)| note).collect())
    }

    #[test]
    fn whatever_an_observer_presses_nothing_is_sent_and_they_are_told_why() {
        let rejected = (0, vec![TeleopNotification::ObserverOnly]);
        for intent in [
            Intent::EStop,
            Intent::Lease(LeaseRequest::Request),
            Intent::Reset(3),
            Intent::Set(Setting::CollisionMonitor(false)),
        ] {
            let mut teleop_client = teleop_client(Some(Role::Observer));
            teleop_client.submit(intent.clone(), at(1_005));
            assert_eq!(end(&mut teleop_client), rejected, "{intent:?}");
            assert_eq!(teleop_client.state(at(1_010)).estop, EStopState::Quiet);
            assert_eq!(end(&mut teleop_client), (0, Vec::new()), "once a press");
        }
        for (key, expected) in [
            (DriveKey::W, rejected),
            // The map's, where nobody drives.
            (DriveKey::Up, (0, Vec::new())),
        ] {
            let mut teleop_client = teleop_client(Some(Role::Observer));
            teleop_client.apply(InputEvent::Press(key));
            assert_eq!(end(&mut teleop_client), expected, "{key:?}");
        }
    }

    #[test]
    fn whoever_may_have_the_right_sends_the_stop() {
        for role in [None, Some(Role::Operator), Some(Role::Supervisor)] {
            let mut teleop_client = teleop_client(role);
            teleop_client.submit(Intent::EStop, at(1_005));
            let (sent, notifications) = end(&mut teleop_client);
            assert!(sent > 0, "{role:?}");
            assert_eq!(
                notifications,
                [TeleopNotification::EStopPressed],
                "{role:?}"
            );
        }
    }
}
