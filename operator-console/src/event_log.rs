//! Log of events of the robot and of this console. Bounded: the oldest entry is removed first.

use std::collections::VecDeque;

use measurement::time::Monotonic;
use network::clock::utc_label;
use protocol::message::{self, Event};

use crate::model::ConsoleModel;

const MAX_ENTRIES: usize = 2_000;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    #[default]
    Info,
    Warning,
    /// The operator must act, or the vehicle is unsafe.
    Alarm,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Source {
    Robot(String),
    Console,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    pub at: Monotonic,
    /// Wall clock, UTC: `12:34:56`.
    pub time: String,
    pub severity: Severity,
    pub source: Source,
    pub kind: String,
    pub text: String,
}

#[derive(Clone, Debug, Default)]
pub struct EventLog {
    entries: VecDeque<Entry>,
    /// Arrival of the robot's newest event, and the number of events at that time.
    last_event: Option<(Monotonic, usize)>,
}

impl Severity {
    pub const ALL: [Self; 3] = [Self::Info, Self::Warning, Self::Alarm];

    pub const fn label(self) -> &'static str {
        match self {
            Self::Info => "Note",
            Self::Warning => "Warning",
            Self::Alarm => "Alarm",
        }
    }

    pub const fn of(event: &Event) -> Self {
        match event.severity {
            message::Severity::Info => Self::Info,
            message::Severity::Warning => Self::Warning,
            message::Severity::Alarm => Self::Alarm,
        }
    }
}

impl EventLog {
    pub const fn entries(&self) -> &VecDeque<Entry> {
        &self.entries
    }

    /// Adds an entry of this console. `unix_s`: wall clock, seconds since 1970.
    pub fn note(
        &mut self,
        severity: Severity,
        kind: &str,
        text: impl Into<String>,
        now: Monotonic,
        unix_s: u64,
    ) {
        self.add(Entry {
            at: now,
            time: time_of_day(unix_s),
            severity,
            source: Source::Console,
            kind: kind.to_owned(),
            text: text.into(),
        });
    }

    /// Another robot is shown: its events are all new.
    pub const fn forget_robot(&mut self) {
        self.last_event = None;
    }

    pub fn add_robot_events(
        &mut self,
        model: &ConsoleModel,
        name: &str,
        now: Monotonic,
        unix_s: u64,
    ) -> Vec<Event> {
        let mut skip = self.last_event.map_or(0, |(_, count)| count);
        let since = self.last_event.map(|(at, _)| at);
        let mut new_events = Vec::new();
        for (event, at) in model.events() {
            if since.is_some_and(|since| *at < since) {
                continue;
            }
            if Some(*at) == since && skip > 0 {
                skip -= 1;
                continue;
            }
            self.last_event = Some(match self.last_event {
                Some((before, count)) if before == *at => (before, count + 1),
                Some(_) | None => (*at, 1),
            });
            let ago_s = now.since(*at).as_secs();
            self.add(Entry {
                at: *at,
                time: time_of_day(unix_s.saturating_sub(ago_s)),
                severity: Severity::of(event),
                source: Source::Robot(name.to_owned()),
                kind: kind_label(&event.kind),
                text: event.message.clone(),
            });
            new_events.push(event.clone());
        }
        new_events
    }

    fn add(&mut self, entry: Entry) {
        if self.entries.len() >= MAX_ENTRIES {
            self.entries.pop_front();
        }
        self.entries.push_back(entry);
    }
}

pub(crate) fn kind_label(kind: &str) -> String {
    match kind {
        "teleop_state" => "driving".to_owned(),
        "estop" => "emergency stop".to_owned(),
        _ => kind.replace('_', " "),
    }
}

fn time_of_day(unix_s: u64) -> String {
    let label = utc_label(unix_s);
    label.get(11..19).unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;

    use super::*;
    use crate::test_support::{self, at, scout};

    fn inject(model: &mut ConsoleModel, kind: &str, now: Monotonic) {
        let severity = match kind {
            "estop" => message::Severity::Alarm,
            "jump" => message::Severity::Warning,
            _ => message::Severity::Info,
        };
        let event = Event {
            kind: kind.to_owned(),
            severity,
            message: format!("{kind} happened"),
        };
        test_support::inject(model, Topic::Event, &event, now);
    }

    #[test]
    fn every_event_of_the_robot_is_noted_once() {
        let mut model = scout();
        let mut log = EventLog::default();
        inject(&mut model, "jump", at(1_000));
        inject(&mut model, "ground", at(1_000));
        let kinds = |new_events: Vec<Event>| -> Vec<String> {
            new_events.into_iter().map(|event| event.kind).collect()
        };
        assert_eq!(
            kinds(log.add_robot_events(&model, "scout", at(1_000), 0)),
            ["jump", "ground"]
        );
        inject(&mut model, "estop", at(1_000));
        assert_eq!(
            kinds(log.add_robot_events(&model, "scout", at(2_000), 0)),
            ["estop"]
        );
        assert_eq!(
            kinds(log.add_robot_events(&model, "scout", at(2_000), 0)),
            [""; 0]
        );
        inject(&mut model, "jump", at(3_000));
        log.note(Severity::Info, "export", "done", at(3_500), 3_723);
        assert_eq!(
            kinds(log.add_robot_events(&model, "scout", at(4_000), 3_724)),
            ["jump"]
        );
        let actual: Vec<_> = log
            .entries()
            .iter()
            .map(|entry| (entry.kind.as_str(), entry.severity, entry.time.as_str()))
            .collect();
        assert_eq!(
            actual[2..],
            [
                ("emergency stop", Severity::Alarm, "00:00:00"),
                ("export", Severity::Info, "01:02:03"),
                ("jump", Severity::Warning, "01:02:03"),
            ]
        );
    }

    #[test]
    fn the_log_is_bounded() {
        let mut log = EventLog::default();
        for n in 0..5_000 {
            log.note(Severity::Info, "n", n.to_string(), at(n), n);
        }
        assert_eq!(log.entries().len(), MAX_ENTRIES);
        assert_eq!(log.entries().back().unwrap().text, "4999");
    }
}
