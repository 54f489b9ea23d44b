//! What ends where another robot, or a recording, is shown.

use protocol::keys::RobotId;
use robot_edge::clock::Monotonic;

use super::ConsoleApp;
use super::obedience::Sort;
use super::watch::Note;
use crate::event_log::Severity;
use crate::helm::{EStopSight, HelmSight};
use crate::link::FoundRobot;

impl ConsoleApp {
    /// The helm of what is shown is about to be left for `next`: notes what that ends.
    pub(super) fn note_leaving(&mut self, next: &FoundRobot, sort: Sort) {
        let Some((shown, _)) = &self.shown else {
            return;
        };
        let mut notes: Vec<_> = self.driving_notes().collect();
        if let Some(helm) = self.hands.sight(Monotonic::now()) {
            notes.extend(ended(&shown.robot, &helm, &next.robot, sort));
        }
        for (severity, kind, text) in notes {
            self.note(severity, kind, text);
        }
    }
}

fn ended(robot: &RobotId, helm: &HelmSight, next: &RobotId, sort: Sort) -> Vec<Note> {
    let mut notes = Vec::new();
    let is_same = robot == next;
    if helm.lease.held().is_some() {
        let why = match sort {
            Sort::Robot if is_same => "it is joined anew: press Drive again".to_owned(),
            Sort::Robot => format!("{next} is shown"),
            Sort::Recording => "a recording is shown".to_owned(),
        };
        let text = format!("Driving {robot} has ended: {why}");
        notes.push((Severity::Warning, "driving", text));
    }
    if helm.is_asking {
        let text =
            format!("{robot} has not answered what it was asked last: show it again and look");
        notes.push((Severity::Warning, "driving", text));
    }
    match helm.estop {
        // By its next link it goes on.
        EStopSight::Sending(_) | EStopSight::Unsendable(_) if !is_same => {
            let text = format!(
                "{robot} has not acknowledged the emergency stop, and is sent it no more: show it again and look"
            );
            notes.push((Severity::Alarm, "driving", text));
        }
        EStopSight::Sending(_)
        | EStopSight::Unsendable(_)
        | EStopSight::Quiet
        | EStopSight::Refused(_) => {}
    }
    notes
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::helm::Lease;
    use crate::pretend::helm_of_anna;

    #[test]
    fn what_ends_with_the_helm_is_told() {
        let [boat, scout]: [RobotId; 2] = ["boat", "scout"].map(|name| name.parse().unwrap());
        let told = |helm: &HelmSight, next, sort| -> Vec<(Severity, String)> {
            let notes = ended(&boat, helm, next, sort).into_iter();
            notes.map(|(severity, _, text)| (severity, text)).collect()
        };
        let mut helm = helm_of_anna();
        assert_eq!(told(&helm, &scout, Sort::Robot), []);
        helm.lease = Lease::Held(3);
        for (next, sort, why) in [
            (&scout, Sort::Robot, "scout is shown"),
            (&boat, Sort::Robot, "it is joined anew: press Drive again"),
            (&scout, Sort::Recording, "a recording is shown"),
        ] {
            let text = format!("Driving boat has ended: {why}");
            assert_eq!(told(&helm, next, sort), [(Severity::Warning, text)]);
        }
        helm.lease = Lease::None;
        helm.is_asking = true;
        let text = "boat has not answered what it was asked last: show it again and look";
        let note = (Severity::Warning, text.to_owned());
        for (next, sort) in [(&boat, Sort::Robot), (&scout, Sort::Recording)] {
            assert_eq!(told(&helm, next, sort), std::slice::from_ref(&note));
        }
        helm.is_asking = false;
        helm.estop = EStopSight::Sending(Duration::from_secs(1));
        assert_eq!(told(&helm, &boat, Sort::Robot), [], "it goes on");
        let [(severity, text)] = &told(&helm, &scout, Sort::Robot)[..] else {
            panic!();
        };
        assert_eq!(*severity, Severity::Alarm);
        assert!(
            text.starts_with("boat has not acknowledged the emergency stop"),
            "{text}"
        );
    }
}
