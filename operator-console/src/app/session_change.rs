//! What ends where another robot, or a recording, is shown.

use protocol::keys::RobotId;
use robot_edge::clock;

use super::ConsoleApp;
use super::commands::SourceKind;
use super::session_monitor::LogNote;
use crate::event_log::Severity;
use crate::link::FoundRobot;
use crate::teleop_client::{EStopState, TeleopClientState};

impl ConsoleApp {
    /// The helm of what is shown is about to be left for `next`: notes what that ends.
    pub(super) fn log_session_change(&mut self, next: &FoundRobot, source_kind: SourceKind) {
        let Some((shown, _)) = &self.shown else {
            return;
        };
        let mut notes: Vec<_> = self.teleop_notes().collect();
        if let Some(teleop_client) = self.teleop_handle.state(clock::now()) {
            notes.extend(ended(
                &shown.robot,
                &teleop_client,
                &next.robot,
                source_kind,
            ));
        }
        for (severity, kind, text) in notes {
            self.note(severity, kind, text);
        }
    }
}

fn ended(
    robot: &RobotId,
    teleop_client: &TeleopClientState,
    next: &RobotId,
    source_kind: SourceKind,
) -> Vec<LogNote> {
    let mut notes = Vec::new();
    let is_same = robot == next;
    if teleop_client.lease.held().is_some() {
        let why = match source_kind {
            SourceKind::Robot if is_same => {
                "it is reconnected: press Request control again".to_owned()
            }
            SourceKind::Robot => format!("{next} is shown"),
            SourceKind::Recording => "a recording is shown".to_owned(),
        };
        let text = format!("Driving {robot} has ended: {why}");
        notes.push((Severity::Warning, "driving", text));
    }
    if teleop_client.is_asking {
        let text = format!("{robot} has not answered the last request: show it again to check");
        notes.push((Severity::Warning, "driving", text));
    }
    match teleop_client.estop {
        // By its next link it goes on.
        EStopState::Sending(_) | EStopState::Unsendable(_) if !is_same => {
            let text = format!(
                "{robot} has not acknowledged the emergency stop, and is sent it no more: show it again and look"
            );
            notes.push((Severity::Alarm, "driving", text));
        }
        EStopState::Sending(_)
        | EStopState::Unsendable(_)
        | EStopState::Quiet
        | EStopState::Refused(_) => {}
    }
    notes
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::teleop_client::Lease;
    use crate::test_support::idle_teleop_client;

    #[test]
    fn what_ends_with_the_helm_is_told() {
        let [boat, scout]: [RobotId; 2] = ["boat", "scout"].map(|name| name.parse().unwrap());
        let actual =
            |teleop_client: &TeleopClientState, next, source_kind| -> Vec<(Severity, String)> {
                let notes = ended(&boat, teleop_client, next, source_kind).into_iter();
                notes.map(|(severity, _, text)| (severity, text)).collect()
            };
        let mut teleop_client = idle_teleop_client();
        assert_eq!(actual(&teleop_client, &scout, SourceKind::Robot), []);
        teleop_client.lease = Lease::Held(3);
        for (next, source_kind, why) in [
            (&scout, SourceKind::Robot, "scout is shown"),
            (
                &boat,
                SourceKind::Robot,
                "it is reconnected: press Request control again",
            ),
            (&scout, SourceKind::Recording, "a recording is shown"),
        ] {
            let text = format!("Driving boat has ended: {why}");
            assert_eq!(
                actual(&teleop_client, next, source_kind),
                [(Severity::Warning, text)]
            );
        }
        teleop_client.lease = Lease::None;
        teleop_client.is_asking = true;
        let text = "boat has not answered the last request: show it again to check";
        let note = (Severity::Warning, text.to_owned());
        for (next, source_kind) in [(&boat, SourceKind::Robot), (&scout, SourceKind::Recording)] {
            assert_eq!(
                actual(&teleop_client, next, source_kind),
                std::slice::from_ref(&note)
            );
        }
        teleop_client.is_asking = false;
        teleop_client.estop = EStopState::Sending(Duration::from_secs(1));
        assert_eq!(
            actual(&teleop_client, &boat, SourceKind::Robot),
            [],
            "it goes on"
        );
        let [(severity, text)] = &actual(&teleop_client, &scout, SourceKind::Robot)[..] else {
            panic!();
        };
        assert_eq!(*severity, Severity::Alarm);
        assert!(
            text.starts_with("boat has not acknowledged the emergency stop"),
            "{text}"
        );
    }
}
