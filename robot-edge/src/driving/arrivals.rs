//! When measurements came, on this machine's clock.

use std::collections::VecDeque;

use crate::clock::Monotonic;
use crate::robot_time::RobotTime;

/// Measurements that are remembered: those of a second of fast sensors.
const REMEMBERED: usize = 1024;

/// The last measurements: their stamps, rising, and when they came.
///
/// What waits for a pose before it can be placed, or for its turn, is as old as its measurement and not as young as the
/// moment at which it is used.
#[derive(Clone, Debug, Default)]
pub(super) struct Arrivals(VecDeque<(RobotTime, Monotonic)>);

impl Arrivals {
    /// Something stamped `stamp` came.
    pub(super) fn note(&mut self, stamp: RobotTime, came: Monotonic) {
        if self.0.back().is_some_and(|&(last, _)| last >= stamp) {
            return;
        }
        if self.0.len() >= REMEMBERED {
            self.0.pop_front();
        }
        self.0.push_back((stamp, came));
    }

    /// When the first of those came that were measured at `stamp` or later: no later than what was stamped so itself. `now`
    /// where nothing has come since.
    pub(super) fn of(&self, stamp: RobotTime, now: Monotonic) -> Monotonic {
        let at = self.0.partition_point(|&(noted, _)| noted < stamp);
        self.0.get(at).map_or(now, |&(_, came)| came)
    }

    /// The clock of the data starts anew.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_waits_grows_older() {
        let stamp = RobotTime::from_nanos;
        let at = Monotonic::from_nanos;
        let mut arrivals = Arrivals::default();
        assert_eq!(arrivals.of(stamp(5), at(9)), at(9));
        arrivals.note(stamp(10), at(100));
        arrivals.note(stamp(20), at(120));
        arrivals.note(stamp(20), at(130));
        arrivals.note(stamp(15), at(140));
        assert_eq!(arrivals.of(stamp(10), at(200)), at(100));
        assert_eq!(
            arrivals.of(stamp(11), at(200)),
            at(120),
            "not before 20 came"
        );
        assert_eq!(arrivals.of(stamp(21), at(200)), at(200));
        for n in 0..5000 {
            arrivals.note(stamp(100 + n), at(1000));
        }
        assert_eq!(arrivals.0.len(), REMEMBERED);
        arrivals.clear();
        assert_eq!(arrivals.of(stamp(10), at(300)), at(300));
    }
}
