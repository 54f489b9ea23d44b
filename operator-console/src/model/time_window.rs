//! What was heard within the last while.

use std::collections::VecDeque;
use std::time::Duration;

use measurement::time::Monotonic;

/// Whoever tells more often than twenty times a second is heard for a shorter while.
const MAX_ENTRIES: usize = 64;

/// What was heard, the oldest first.
#[derive(Clone, Debug)]
pub(super) struct TimeWindow<T> {
    entries: VecDeque<(T, Monotonic)>,
}

impl<T> Default for TimeWindow<T> {
    /// Nothing was heard, whatever it may be.
    fn default() -> Self {
        Self {
            entries: VecDeque::new(),
        }
    }
}

impl<T> TimeWindow<T> {
    /// One more. Of what is older than `span`, the newest stays: from it on it was so for all of that time.
    pub(super) fn add(&mut self, value: T, span: Duration, now: Monotonic) {
        self.entries.push_back((value, now));
        let is_old = |entries: &VecDeque<(T, Monotonic)>| {
            let second = entries.get(1);
            second.is_some_and(|(_, at)| now.since(*at) >= span) || entries.len() > MAX_ENTRIES
        };
        while is_old(&self.entries) {
            self.entries.pop_front();
        }
    }

    /// None of it counts any more.
    pub(super) fn clear(&mut self) {
        self.entries.clear();
    }

    /// Whether the first was heard so long before the last.
    pub(super) fn spans(&self, span: Duration) -> bool {
        let ends = self.entries.front().zip(self.entries.back());
        ends.is_some_and(|((_, first), (_, last))| last.since(*first) >= span)
    }

    /// What was heard, the oldest first.
    pub(super) fn iter(&self) -> impl DoubleEndedIterator<Item = &T> + Clone {
        self.entries.iter().map(|(value, _)| value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::at;

    const SPAN: Duration = Duration::from_secs(3);

    #[test]
    fn what_is_kept_is_of_the_last_while_and_as_much_as_covers_it() {
        let mut recent = TimeWindow::default();
        let mut kept = |ms: u64| -> (Vec<u64>, bool) {
            recent.add(ms, SPAN, at(ms));
            (recent.iter().copied().collect(), recent.spans(SPAN))
        };
        assert_eq!(kept(0), (vec![0], false));
        assert_eq!(kept(1_000), (vec![0, 1_000], false));
        assert_eq!(kept(3_999), (vec![0, 1_000, 3_999], true));
        assert_eq!(kept(4_000), (vec![1_000, 3_999, 4_000], true));
        assert_eq!(kept(9_000), (vec![4_000, 9_000], true));
        recent.clear();
        assert!(!recent.spans(SPAN));
    }

    #[test]
    fn a_flood_is_not_kept() {
        let mut recent = TimeWindow::default();
        for ms in 0..1_000 {
            recent.add(ms, SPAN, at(ms));
        }
        assert_eq!(recent.iter().count(), MAX_ENTRIES);
    }
}
