//! What happened on the way, for the summary: the first of it, and how much more there was.

use crate::pipeline::MapEvent;
use crate::summary::Event;

/// Events that are kept.
const MAX_EVENTS: usize = 1000;

/// A bounded log.
#[derive(Debug, Default)]
pub(super) struct EventLog {
    events: Vec<Event>,
    omitted: u64,
}

impl EventLog {
    /// A log of these and what is to come.
    pub(super) const fn with_events(events: Vec<Event>) -> Self {
        Self { events, omitted: 0 }
    }

    pub(super) fn add(&mut self, map_event: MapEvent) {
        if self.events.len() < MAX_EVENTS {
            self.events.push(Event {
                stamp_s: Some(map_event.stamp.as_secs_f64()),
                kind: map_event.kind.to_owned(),
                message: map_event.message,
            });
        } else {
            self.omitted += 1;
        }
    }

    pub(super) fn into_events(self) -> Vec<Event> {
        let mut events = self.events;
        if self.omitted > 0 {
            events.push(Event {
                stamp_s: None,
                kind: "events".to_owned(),
                message: format!(
                    "{} more happened, only the first {MAX_EVENTS} are listed",
                    self.omitted
                ),
            });
        }
        events
    }
}
