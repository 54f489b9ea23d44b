//! How old what was measured is, by the stamps of the robot: who joins late is told the age of the map, not of its arrival.
//!
//! Stamps are of the clock of the robot's sensors, which no clock here is compared with. Only how far two stamps lie apart
//! counts: that of what was measured, and the newest that the robot told of when it came. Once it came, this machine's own
//! clock tells how much older it gets, so that it ages by what it should even where the robot's clock is set.

use std::time::Duration;

use robot_edge::clock::Monotonic;

/// The clock of a robot's data, as its messages tell of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DataClock {
    /// The stamp that was told last, nanoseconds, and when.
    told: Option<(i64, Monotonic)>,
}

/// When something was measured that came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Measured {
    stamp_ns: i64,
    came: Monotonic,
    /// How old it was when it came.
    before: Duration,
}

impl DataClock {
    /// The robot told of its newest data, `stamp_ns` being its stamp.
    pub(super) const fn tell(&mut self, stamp_ns: i64, now: Monotonic) {
        self.told = Some((stamp_ns, now));
    }

    /// What has this stamp came.
    pub(super) fn measured(&self, stamp_ns: i64, now: Monotonic) -> Measured {
        let before = self.told.map_or(Duration::ZERO, |(newest_ns, told)| {
            // The data went on since it was told of; a new stamp would have been told.
            apart(newest_ns, stamp_ns).map_or(Duration::ZERO, |apart| {
                apart.saturating_add(now.since(told))
            })
        });
        Measured {
            stamp_ns,
            came: now,
            before,
        }
    }

    /// How long before the newest data something was measured; zero where the clock of the data was set back in between.
    pub fn before_newest(&self, measured: Measured) -> Duration {
        let apart = self
            .told
            .and_then(|(newest_ns, _)| apart(newest_ns, measured.stamp_ns));
        apart.unwrap_or_default()
    }
}

impl Measured {
    /// How old it is.
    pub const fn age(self, now: Monotonic) -> Duration {
        now.since(self.came).saturating_add(self.before)
    }

    /// When it came.
    pub const fn came(self) -> Monotonic {
        self.came
    }

    /// Whether it is younger.
    pub fn is_newer_than(self, other: Self) -> bool {
        let latest = self.came.max(other.came);
        self.age(latest) < other.age(latest)
    }
}

/// From one stamp to a later one.
fn apart(later_ns: i64, earlier_ns: i64) -> Option<Duration> {
    let apart_ns = i128::from(later_ns) - i128::from(earlier_ns);
    u64::try_from(apart_ns).ok().map(Duration::from_nanos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pretend::at;

    const SECOND_NS: i64 = 1_000_000_000;

    #[test]
    fn what_comes_late_is_as_old_as_it_is() {
        let mut clock = DataClock::default();
        clock.tell(100 * SECOND_NS, at(5_000));
        let old = clock.measured(60 * SECOND_NS, at(5_020));
        assert_eq!(old.age(at(5_020)), Duration::from_millis(40_020));
        assert_eq!(old.age(at(8_020)), Duration::from_millis(43_020));
        assert_eq!(old.came(), at(5_020));
        // While the robot's own clock is set, it ages on by this one.
        clock.tell(5_000 * SECOND_NS, at(6_000));
        assert_eq!(old.age(at(8_020)), Duration::from_millis(43_020));
        let new = clock.measured(4_999 * SECOND_NS, at(6_000));
        assert_eq!(new.age(at(6_000)), Duration::from_secs(1));
        assert!(new.is_newer_than(old) && !old.is_newer_than(new));
        assert!(!new.is_newer_than(new));
    }

    #[test]
    fn nothing_is_younger_than_since_it_came() {
        let nothing_told = DataClock::default().measured(7, at(1_000));
        assert_eq!(nothing_told.age(at(1_500)), Duration::from_millis(500));
        let mut clock = DataClock::default();
        clock.tell(SECOND_NS, at(1_000));
        let ahead = clock.measured(2 * SECOND_NS, at(1_900));
        assert_eq!(ahead.age(at(2_000)), Duration::from_millis(100));
        clock.tell(i64::MIN, at(3_000));
        assert_eq!(clock.before_newest(ahead), Duration::ZERO);
        let huge = DataClock {
            told: Some((i64::MAX, at(1))),
        };
        let oldest = huge.measured(i64::MIN, at(u64::MAX / 2_000_000));
        assert_eq!(oldest.age(at(1)), oldest.age(at(0)));
    }

    #[test]
    fn what_stands_is_as_old_as_it_was_at_its_end() {
        let mut clock = DataClock::default();
        clock.tell(9 * SECOND_NS, at(1_000));
        let held = clock.measured(8 * SECOND_NS, at(1_010));
        clock.tell(12 * SECOND_NS, at(4_000));
        for ms in [4_000, 9_000] {
            clock.tell(12 * SECOND_NS, at(ms));
            assert_eq!(clock.before_newest(held), Duration::from_secs(4));
        }
    }
}
