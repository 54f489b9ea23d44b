//! Elapsed time of the data, across clock resets.

use measurement::time::{RobotDuration, RobotTime};

/// Sums the steps between stamps; backward steps count as zero.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DataClock {
    newest: Option<RobotTime>,
    elapsed: RobotDuration,
}

impl DataClock {
    /// Advances to `stamp` and returns the time since the first one.
    pub(super) fn advance(&mut self, stamp: RobotTime) -> RobotDuration {
        let newest = *self.newest.get_or_insert(stamp);
        if stamp > newest {
            self.elapsed = self.elapsed + stamp.since(newest);
            self.newest = Some(stamp);
        }
        self.elapsed
    }

    /// Keeps the elapsed time at a clock reset.
    pub(super) const fn reset(&mut self) {
        self.newest = None;
    }

    /// The elapsed time at `stamp`, which is before the newest one.
    pub(super) fn at(&self, stamp: RobotTime) -> RobotDuration {
        let Some(newest) = self.newest else {
            return self.elapsed;
        };
        let before = newest.since(stamp).max(RobotDuration::ZERO);
        let nanos = self.elapsed.as_nanos().saturating_sub(before.as_nanos());
        RobotDuration::from_nanos(nanos.max(0))
    }

    pub(super) const fn has_started(&self) -> bool {
        self.newest.is_some()
    }

    pub(super) const fn elapsed(&self) -> RobotDuration {
        self.elapsed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_adds_up_over_clocks() {
        let at = |ms: i64| RobotTime::from_nanos(ms * 1_000_000);
        let mut clock = DataClock::default();
        for ms in [500_000, 500_100, 500_050, 500_200] {
            clock.advance(at(ms));
        }
        clock.reset();
        for ms in [0, 100] {
            clock.advance(at(ms));
        }
        assert_eq!(clock.elapsed(), RobotDuration::from_millis(300));
        for (stamp_ms, elapsed_ms) in [(100, 300), (40, 240), (900, 300), (-1000, 0)] {
            assert_eq!(
                clock.at(at(stamp_ms)),
                RobotDuration::from_millis(elapsed_ms)
            );
        }
    }
}
