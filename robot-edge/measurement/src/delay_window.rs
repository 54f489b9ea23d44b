//! Smallest and greatest delay of a stream whose stamps are of another clock.
//!
//! Only differences between the clocks are known: a message's delay is its (arrival − stamp) minus the
//! least of its stream, which the promptest message had.

use crate::time::Monotonic;

/// The least is taken over the last one or two periods, nanoseconds: clocks drift apart by about 50 µs/s.
const PERIOD_NS: i64 = 10_000_000_000;

/// Arrival minus stamp, nanoseconds, over the last one or two periods.
#[derive(Clone, Copy, Debug)]
pub struct DelayWindow {
    since: Monotonic,
    now: Range,
    before: Range,
}

#[derive(Clone, Copy, Debug)]
struct Range {
    least: i64,
    greatest: i64,
}

impl Range {
    const fn of(behind_ns: i64) -> Self {
        Self {
            least: behind_ns,
            greatest: behind_ns,
        }
    }

    fn join(self, other: Self) -> Self {
        Self {
            least: self.least.min(other.least),
            greatest: self.greatest.max(other.greatest),
        }
    }
}

impl DelayWindow {
    /// With the first message.
    pub const fn new(behind_ns: i64, received_at: Monotonic) -> Self {
        Self {
            since: received_at,
            now: Range::of(behind_ns),
            before: Range::of(behind_ns),
        }
    }

    /// Adds a message; its delay, nanoseconds.
    pub fn add(&mut self, behind_ns: i64, received_at: Monotonic) -> i64 {
        // At most one step per arrival, so that a long pause does not remove the least.
        if received_at.nanos().saturating_sub(self.since.nanos()) >= PERIOD_NS {
            *self = Self {
                since: received_at,
                now: Range::of(behind_ns),
                before: self.now,
            };
        }
        self.now = self.now.join(Range::of(behind_ns));
        behind_ns.saturating_sub(self.least_ns())
    }

    /// The offset between the clocks, with the unknown delay of the promptest message.
    pub fn least_ns(&self) -> i64 {
        self.now.join(self.before).least
    }

    /// The greatest delay.
    pub fn spread_ns(&self) -> i64 {
        let range = self.now.join(self.before);
        range.greatest.saturating_sub(range.least)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    fn at_ms(ms: u64) -> Monotonic {
        Monotonic::from_nanos(ms * 1_000_000)
    }

    #[test]
    fn the_promptest_message_has_no_delay() {
        let mut window = DelayWindow::new(7 * MS, at_ms(0));
        assert_eq!(window.add(9 * MS, at_ms(100)), 2 * MS);
        assert_eq!(window.add(4 * MS, at_ms(200)), 0);
        assert_eq!(window.add(9 * MS, at_ms(300)), 5 * MS);
        assert_eq!((window.least_ns(), window.spread_ns()), (4 * MS, 5 * MS));
    }

    #[test]
    fn delays_are_forgotten_after_two_periods() {
        let mut window = DelayWindow::new(0, at_ms(0));
        assert_eq!(window.add(3 * MS, at_ms(10_000)), 3 * MS);
        assert_eq!(window.add(3 * MS, at_ms(19_999)), 3 * MS);
        assert_eq!(window.add(3 * MS, at_ms(20_000)), 0);
        assert_eq!(window.spread_ns(), 0);
    }

    #[test]
    fn extreme_values_do_not_overflow() {
        let mut window = DelayWindow::new(i64::MIN, at_ms(0));
        assert_eq!(window.add(i64::MAX, at_ms(1)), i64::MAX);
        assert_eq!(window.spread_ns(), i64::MAX);
    }
}
