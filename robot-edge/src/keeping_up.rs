//! Whether a machine keeps up with what its sensors measure.

use std::time::Duration;

use crate::clock::Monotonic;

/// Data that is mapped so much later than it could be is late.
const LATE: Duration = Duration::from_millis(300);
/// A machine that is late in every look for so long does not keep up: a moment's work is no reason to say so.
const BEHIND_AFTER: Duration = Duration::from_secs(2);
/// One that is never late for so long keeps up again.
const UP_AFTER: Duration = Duration::from_secs(5);

/// What has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// It does not keep up: what is mapped now could have been mapped so long ago.
    Behind(Duration),
    /// It keeps up again.
    Up,
}

/// Looks at how late data is. Pure: the present is a parameter.
#[derive(Clone, Debug, Default)]
pub struct KeepingUp {
    is_behind: bool,
    /// Since when every look has said the contrary.
    contrary_since: Option<Monotonic>,
}

impl KeepingUp {
    /// Data is `late` at `now`; what that changes.
    pub fn look(&mut self, late: Duration, now: Monotonic) -> Option<Change> {
        if (late > LATE) == self.is_behind {
            self.contrary_since = None;
            return None;
        }
        let since = *self.contrary_since.get_or_insert(now);
        let patience = if self.is_behind {
            UP_AFTER
        } else {
            BEHIND_AFTER
        };
        if now.since(since) < patience {
            return None;
        }
        self.contrary_since = None;
        self.is_behind = !self.is_behind;
        Some(if self.is_behind {
            Change::Behind(late)
        } else {
            Change::Up
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is told of these latenesses in a row, milliseconds, looked at every 0.5 s.
    fn told(late_ms: impl IntoIterator<Item = u64>) -> Vec<(u64, Change)> {
        let mut keeping_up = KeepingUp::default();
        let looks = (0..).step_by(500).zip(late_ms);
        let change = |(at_ms, late_ms)| {
            let now = Monotonic::from_nanos(at_ms * 1_000_000);
            let change = keeping_up.look(Duration::from_millis(late_ms), now)?;
            Some((at_ms, change))
        };
        looks.filter_map(change).collect()
    }

    #[test]
    fn only_what_lasts_is_told_and_once() {
        assert_eq!(told([0, 900, 0, 900, 900, 900, 900, 10, 900, 900]), []);
        let behind = Change::Behind(Duration::from_millis(800));
        let late = std::iter::repeat_n(800, 20);
        assert_eq!(told(late.clone()), [(2_000, behind)]);
        // A moment without delay is no recovery.
        let moment = std::iter::repeat_n(20, 9).chain([800]);
        let well = std::iter::repeat_n(20, 11);
        assert_eq!(
            told(late.chain(moment).chain(well)),
            [(2_000, behind), (20_000, Change::Up)]
        );
    }
}
