//! What this console notices by itself, once each: the link comes, goes and takes another way; the robot has restarted;
//! its data has ended; the collision guard holds it.

use std::time::Duration;

use protocol::message::Status;
use protocol::tile::BootId;
use robot_edge::clock::Monotonic;

use crate::event_log::Severity;
use crate::link::Transport;
use crate::model::{ConsoleModel, LinkState};
use crate::panels::driving::makes_stand;
use crate::panels::wording::age;

/// How things were at the last look.
#[derive(Clone, Debug, Default)]
pub(super) struct Watch {
    link: Option<LinkState>,
    /// When it was seen that the robot is silent, and for how long it was by then.
    lost: Option<(Monotonic, Duration)>,
    /// Which run of the robot was heard.
    run: Option<BootId>,
    transport: Option<Transport>,
    has_ended: bool,
    /// Since when the collision guard makes it stand that is told to go, and whether that was noted.
    held: Option<(Monotonic, bool)>,
}

/// What the guard holds for less is not noted: it looks again with every scan.
const HELD_FOR: Duration = Duration::from_secs(1);

/// What a restart of the robot means.
const ANEW: &str = "its map begins anew";

/// Something to note: how much it matters, its kind, and what it is.
pub(super) type Note = (Severity, &'static str, String);

impl Watch {
    /// Looks at the link.
    pub(super) fn look(
        &mut self,
        model: &ConsoleModel,
        transport: Option<Transport>,
        now: Monotonic,
    ) -> Vec<Note> {
        let mut notes = Vec::new();
        let robot = model.robot();
        let link = model.connection().state(now);
        let had_ended = std::mem::replace(&mut self.has_ended, model.says_ended());
        let mut has_restarted = self.has_restarted(model.run());
        if self.link != Some(link) {
            match link {
                LinkState::Waiting => {}
                LinkState::Live => {
                    let text = match self.lost.take() {
                        Some((seen, silent)) => {
                            let silent = age(silent + now.since(seen));
                            let anew = if std::mem::take(&mut has_restarted) {
                                format!(", restarted: {ANEW}")
                            } else {
                                String::new()
                            };
                            format!("{robot} is heard again after {silent}{anew}")
                        }
                        None => format!("{robot} is heard"),
                    };
                    notes.push((Severity::Note, "link", text));
                }
                LinkState::Silent => {
                    let silent = model.connection().age(now).unwrap_or_default();
                    self.lost = Some((now, silent));
                    let gone = format!("{robot} is not heard any more");
                    notes.push(if model.may_fall_silent() {
                        let text = format!("{gone} (its data had ended)");
                        (Severity::Note, "link", text)
                    } else {
                        let text = format!("{gone}, for {}", age(silent));
                        (Severity::Warning, "link", text)
                    });
                }
            }
            self.link = Some(link);
        }
        if has_restarted {
            let text = format!("{robot} has restarted: {ANEW}");
            notes.push((Severity::Note, "link", text));
        }
        if self.has_ended && !had_ended {
            let text = format!("{robot}'s data has ended");
            notes.push((Severity::Note, "data", text));
        }
        let is_heard = link == LinkState::Live && !model.awaits_status();
        if self.is_held_anew(model, is_heard) {
            let text = format!("{robot} is held back by the collision guard");
            notes.push((Severity::Note, "guard", text));
        }
        if transport.is_some() && self.transport != transport {
            self.transport = transport;
            notes.extend(transport.and_then(transport_note));
        }
        notes
    }

    /// Whether the collision guard has made the vehicle stand for a while, by what it tells, and that was not noted yet.
    fn is_held_anew(&mut self, model: &ConsoleModel, is_heard: bool) -> bool {
        let is_held = |status: &Status| status.teleop.as_ref().is_some_and(makes_stand);
        let told = model.status().filter(|_| is_heard);
        let Some((_, told)) = told.filter(|(status, _)| is_held(status)) else {
            self.held = None;
            return false;
        };
        let (since, is_noted) = self.held.get_or_insert((*told, false));
        let is_anew = !*is_noted && told.since(*since) >= HELD_FOR;
        *is_noted |= is_anew;
        is_anew
    }

    /// Whether another run of the robot is heard than at the last look.
    fn has_restarted(&mut self, run: Option<BootId>) -> bool {
        let Some(run) = run else {
            return false;
        };
        let before = self.run.replace(run);
        before.is_some_and(|before| before != run)
    }
}

fn transport_note(transport: Transport) -> Option<Note> {
    let (severity, text) = match transport {
        Transport::Quic => (Severity::Note, "Connected by QUIC"),
        Transport::Tls => (Severity::Note, "Connected by TLS"),
        Transport::Tcp => (Severity::Note, "Connected by TCP, not secured"),
        Transport::TlsInstead => (
            Severity::Warning,
            "QUIC does not answer: control goes by TLS, where what is lost holds up what follows",
        ),
        Transport::Other => return None,
    };
    Some((severity, "link", text.to_owned()))
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::message::{Clamp, TeleopState};

    use super::*;
    use crate::pretend::{at, says, scout, standing, starts};

    #[test]
    fn the_link_is_noted_when_it_changes_and_not_else() {
        let mut model = scout();
        let mut watch = Watch::default();
        let mut look = |model: &ConsoleModel, transport, ms| -> Vec<String> {
            let notes = watch.look(model, transport, at(ms));
            notes.into_iter().map(|(_, _, text)| text).collect()
        };
        assert_eq!(look(&model, None, 0), [""; 0]);
        says(&mut model, Topic::Status, &Status::default(), at(1_000));
        assert_eq!(look(&model, None, 1_000), ["scout is heard"]);
        let [told] = &look(&model, Some(Transport::TlsInstead), 1_100)[..] else {
            panic!();
        };
        assert!(told.starts_with("QUIC does not answer"), "{told}");
        assert_eq!(look(&model, None, 1_200), [""; 0]);
        assert_eq!(look(&model, Some(Transport::TlsInstead), 1_300), [""; 0]);
        let lost = look(&model, None, 3_000);
        assert_eq!(lost, ["scout is not heard any more, for 2.0 s"]);
        says(&mut model, Topic::Status, &Status::default(), at(9_000));
        assert_eq!(
            look(&model, None, 9_000),
            ["scout is heard again after 8.0 s"]
        );
    }

    #[test]
    fn a_restart_of_the_robot_is_noted_with_the_silence_or_alone() {
        let mut model = scout();
        let mut watch = Watch::default();
        // At these times, the run that is heard there, or none.
        let mut look = |ms, run: Option<u8>| -> Vec<String> {
            if let Some(run) = run {
                starts(&mut model, BootId([run; 16]), at(ms));
            }
            let notes = watch.look(&model, None, at(ms));
            notes.into_iter().map(|(_, _, text)| text).collect()
        };
        assert_eq!(look(1_000, Some(7)), ["scout is heard"]);
        let quick = "scout has restarted: its map begins anew";
        assert_eq!(look(1_500, Some(8)), [quick]);
        assert_eq!(look(4_000, None).len(), 1);
        let again = "scout is heard again after 3.4 s, restarted: its map begins anew";
        assert_eq!(look(4_900, Some(9)), [again]);
        assert_eq!(look(5_000, Some(9)), [""; 0]);
    }

    #[test]
    fn an_end_is_noted_and_the_silence_after_it_is_no_warning() {
        for can_be_driven in [false, true] {
            let mut model = scout();
            let mut watch = Watch::default();
            says(&mut model, Topic::Status, &Status::default(), at(0));
            watch.look(&model, None, at(0));
            let ended = Status {
                has_ended: true,
                teleop: can_be_driven.then(standing),
                ..Status::default()
            };
            says(&mut model, Topic::Status, &ended, at(500));
            let end = (Severity::Note, "data", "scout's data has ended".to_owned());
            assert_eq!(watch.look(&model, None, at(500)), [end]);
            assert_eq!(watch.look(&model, None, at(600)), []);
            let told = watch.look(&model, None, at(2_500));
            let gone = "scout is not heard any more (its data had ended)".to_owned();
            assert_eq!(told, [(Severity::Note, "link", gone)]);
        }
    }

    /// The guard lets a vehicle that is to go do so, m/s.
    fn is_let(model: &mut ConsoleModel, told_mps: f32, ms: u64) {
        let mut teleop = standing();
        teleop.state = TeleopState::Driving;
        teleop.clamp = Some(Clamp::Guard);
        teleop.requested.linear_mps = 0.8;
        teleop.applied.linear_mps = told_mps;
        let status = Status {
            teleop: Some(teleop),
            ..Status::default()
        };
        says(model, Topic::Status, &status, at(ms));
    }

    fn of_guard(notes: Vec<Note>) -> Vec<Note> {
        let of_guard = notes.into_iter().filter(|(_, kind, _)| *kind == "guard");
        of_guard.collect()
    }

    #[test]
    fn what_the_guard_holds_back_for_a_while_is_noted_once() {
        let mut model = scout();
        let mut watch = Watch::default();
        let mut held = Vec::new();
        for (ms, told_mps) in [
            (0, 0.0),
            (900, 0.0),
            (950, 0.3),
            (1_000, 0.0),
            (1_500, 0.0),
            (2_000, 0.0),
            (5_000, 0.0),
            (5_100, 0.3),
            (5_200, 0.0),
            (6_200, 0.0),
        ] {
            is_let(&mut model, told_mps, ms);
            let notes = watch.look(&model, None, at(ms));
            held.extend(of_guard(notes).into_iter().map(|note| (ms, note)));
        }
        let text = "scout is held back by the collision guard".to_owned();
        let noted = |ms| (ms, (Severity::Note, "guard", text.clone()));
        assert_eq!(held, [noted(2_000), noted(6_200)]);
    }

    #[test]
    fn nobody_is_said_to_be_held_who_is_not_heard() {
        let mut model = scout();
        let mut watch = Watch::default();
        let mut held = Vec::new();
        is_let(&mut model, 0.0, 0);
        for ms in [0, 300, 1_100, 5_000] {
            held.extend(of_guard(watch.look(&model, None, at(ms))));
        }
        // What was so before nothing was heard counts no more.
        is_let(&mut model, 0.0, 5_100);
        for ms in [5_100, 5_300] {
            held.extend(of_guard(watch.look(&model, None, at(ms))));
        }
        assert_eq!(held, []);
    }
}
