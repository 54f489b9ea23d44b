//! What this console notices by itself, once each: the link comes, goes and takes another way.

use robot_edge::clock::Monotonic;

use crate::event_log::Severity;
use crate::link::Transport;
use crate::model::{ConsoleModel, LinkState};
use crate::panels::wording::age;

/// How things were at the last look.
#[derive(Clone, Debug, Default)]
pub(super) struct Watch {
    link: Option<LinkState>,
    lost: Option<Monotonic>,
    transport: Option<Transport>,
}

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
        if self.link != Some(link) {
            match link {
                LinkState::Waiting => {}
                LinkState::Live => {
                    let text = match self.lost.take() {
                        Some(lost) => {
                            let silent = age(now.since(lost));
                            format!("{robot} is heard again after {silent}")
                        }
                        None => format!("{robot} is heard"),
                    };
                    notes.push((Severity::Note, "link", text));
                }
                LinkState::Silent => {
                    let silent = model.connection().age(now).unwrap_or_default();
                    self.lost = Some(now);
                    let text = format!("{robot} is not heard any more, for {}", age(silent));
                    notes.push((Severity::Warning, "link", text));
                }
            }
            self.link = Some(link);
        }
        if transport.is_some() && self.transport != transport {
            self.transport = transport;
            notes.extend(transport.and_then(transport_note));
        }
        notes
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
    use protocol::message::Status;

    use super::*;
    use crate::pretend::{at, says, scout};

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
            ["scout is heard again after 6.0 s"]
        );
    }
}
