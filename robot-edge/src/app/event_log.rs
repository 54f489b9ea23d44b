//! What happened on the way, for the summary: the first of it, and how much more there was.

use crate::pipeline::Happening;
use crate::summary::Event;

/// Events that are kept.
const MAX_EVENTS: usize = 1000;

/// A bounded log.
#[derive(Debug, Default)]
pub(super) struct EventLog {
    events: Vec<Event>,
    left_out: u64,
}

impl EventLog {
    /// A log of these and what is to come.
    pub(super) const fn beginning_with(events: Vec<Event>) -> Self {
        Self {
            events,
            left_out: 0,
        }
    }

    pub(super) fn add(&mut self, happening: Happening) {
        if self.events.len() < MAX_EVENTS {
            self.events.push(Event {
                stamp_s: Some(happening.stamp.as_secs_f64()),
                kind: happening.kind.to_owned(),
                message: happening.message,
            });
        } else {
            self.left_out += 1;
        }
    }

    pub(super) fn into_events(self) -> Vec<Event> {
        let mut events = self.events;
        if self.left_out > 0 {
            events.push(Event {
                stamp_s: None,
                kind: "events".to_owned(),
                message: format!(
                    "{} more happened, only the first {MAX_EVENTS} are listed",
                    self.left_out
                ),
            });
        }
        events
    }
}
