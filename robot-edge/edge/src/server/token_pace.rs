//! The interval of tokens while somebody drives, by the ages of the commands that come back. Pure.
//!
//! A link that carries less than 50 tokens and commands a second beside the map keeps them in its buffers: all commands become old.
//! Losses alone make some of them old, and many tokens are what helps against that.

use std::time::Duration;

use measurement::time::Monotonic;

/// The limits of the interval.
const SHORTEST: Duration = Duration::from_millis(20);
const LONGEST: Duration = Duration::from_millis(100);
/// Interval of decisions.
const WINDOW: Duration = Duration::from_secs(1);
/// Decisions in a row that must find young commands before the interval is shortened.
const YOUNG_WINDOWS: u32 = 5;

#[derive(Clone, Debug)]
pub(super) struct TokenPace {
    limit: Duration,
    interval: Duration,
    window: Monotonic,
    /// The least age in this window.
    youngest: Duration,
    young_windows: u32,
}

impl TokenPace {
    /// `limit` is the greatest age of a command that is obeyed.
    pub(super) const fn new(limit: Duration, now: Monotonic) -> Self {
        Self {
            limit,
            interval: SHORTEST,
            window: now,
            youngest: Duration::MAX,
            young_windows: 0,
        }
    }

    /// Takes the age of the last command, if there is one; returns the interval of tokens.
    pub(super) fn interval(&mut self, age: Option<Duration>, now: Monotonic) -> Duration {
        let Some(age) = age else {
            *self = Self::new(self.limit, now);
            return self.interval;
        };
        self.youngest = self.youngest.min(age);
        if now.since(self.window) >= WINDOW {
            // Of the limit, three quarters are left to losses.
            if self.youngest >= self.limit * 3 / 4 {
                self.interval = LONGEST.min(self.interval * 2);
                self.young_windows = 0;
            } else if self.youngest < self.limit / 2 {
                self.young_windows += 1;
            }
            if self.young_windows >= YOUNG_WINDOWS {
                self.interval = SHORTEST.max(self.interval / 2);
                self.young_windows = 0;
            }
            (self.window, self.youngest) = (now, Duration::MAX);
        }
        self.interval
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The interval of tokens after seconds in which the youngest command is this old, and others 50 ms more, milliseconds.
    fn intervals(youngest_ms: &[u64]) -> Vec<u128> {
        let at = |ms: u64| Monotonic::from_nanos(ms * 1_000_000);
        let mut pace = TokenPace::new(Duration::from_millis(400), at(0));
        let seconds = (0_u64..).step_by(1000).zip(youngest_ms);
        seconds
            .map(|(from_ms, youngest_ms)| {
                let mut interval = Duration::ZERO;
                for ms in (from_ms + 20..=from_ms + 1000).step_by(20) {
                    let age_ms = youngest_ms + if ms % 100 == 0 { 0 } else { 50 };
                    interval = pace.interval(Some(Duration::from_millis(age_ms)), at(ms));
                }
                interval.as_millis()
            })
            .collect()
    }

    #[test]
    fn tokens_are_fewer_while_all_commands_are_old() {
        // Some that are old are no reason, and 250 ms none to send more.
        assert_eq!(intervals(&[299, 100, 250]), [20, 20, 20]);
        assert_eq!(intervals(&[300, 700, 700, 250]), [40, 80, 100, 100]);
        let young = [400, 400, 199, 199, 199, 199, 199, 199, 199, 199, 199, 199];
        let expected = [40, 80, 80, 80, 80, 80, 40, 40, 40, 40, 40, 20];
        assert_eq!(intervals(&young), expected);
    }

    #[test]
    fn who_drives_next_begins_with_all_tokens() {
        let at = |s: u64| Monotonic::from_nanos(s * 1_000_000_000);
        let mut pace = TokenPace::new(Duration::from_millis(400), at(0));
        assert_eq!(pace.interval(Some(Duration::MAX), at(1)), SHORTEST * 2);
        assert_eq!(pace.interval(None, at(2)), SHORTEST);
    }
}
