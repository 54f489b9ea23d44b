//! Detects that mapping does not keep up with the sensors.

use std::time::Duration;

use measurement::time::Monotonic;

/// Maximum delay of mapping.
const MAX_DELAY: Duration = Duration::from_millis(300);
/// Time of continuous delay before an overload: a short peak is none.
const OVERLOAD_AFTER: Duration = Duration::from_secs(2);
/// Time without delay before the overload is cleared.
const CLEAR_AFTER: Duration = Duration::from_secs(5);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OverloadChange {
    Started(Duration),
    Cleared,
}

/// Pure: the current time is a parameter.
#[derive(Clone, Debug, Default)]
pub struct OverloadMonitor {
    is_overloaded: bool,
    /// Since when the delay contradicts the state.
    change_pending_since: Option<Monotonic>,
}

impl OverloadMonitor {
    pub fn update(&mut self, delay: Duration, now: Monotonic) -> Option<OverloadChange> {
        if (delay > MAX_DELAY) == self.is_overloaded {
            self.change_pending_since = None;
            return None;
        }
        let since = *self.change_pending_since.get_or_insert(now);
        let required = if self.is_overloaded {
            CLEAR_AFTER
        } else {
            OVERLOAD_AFTER
        };
        if now.since(since) < required {
            return None;
        }
        self.change_pending_since = None;
        self.is_overloaded = !self.is_overloaded;
        Some(if self.is_overloaded {
            OverloadChange::Started(delay)
        } else {
            OverloadChange::Cleared
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The changes for a series of delays, milliseconds, every 0.5 s.
    fn changes(late_ms: impl IntoIterator<Item = u64>) -> Vec<(u64, OverloadChange)> {
        let mut monitor = OverloadMonitor::default();
        let updates = (0..).step_by(500).zip(late_ms);
        let change = |(at_ms, late_ms)| {
            let now = Monotonic::from_nanos(at_ms * 1_000_000);
            let change = monitor.update(Duration::from_millis(late_ms), now)?;
            Some((at_ms, change))
        };
        updates.filter_map(change).collect()
    }

    #[test]
    fn only_lasting_overload_is_reported_and_once() {
        assert_eq!(changes([0, 900, 0, 900, 900, 900, 900, 10, 900, 900]), []);
        let behind = OverloadChange::Started(Duration::from_millis(800));
        let delay = std::iter::repeat_n(800, 20);
        assert_eq!(changes(delay.clone()), [(2_000, behind)]);
        // A short time without delay clears nothing.
        let moment = std::iter::repeat_n(20, 9).chain([800]);
        let well = std::iter::repeat_n(20, 11);
        assert_eq!(
            changes(delay.chain(moment).chain(well)),
            [(2_000, behind), (20_000, OverloadChange::Cleared)]
        );
    }
}
