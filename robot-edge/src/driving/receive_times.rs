//! When measurements came, on this machine's clock.

use std::collections::VecDeque;

use measurement::time::Monotonic;
use measurement::time::RobotTime;

/// Measurements that are remembered: those of a second of fast sensors.
const CAPACITY: usize = 1024;

/// The last measurements: their stamps, rising, and when they came.
///
/// What waits for a pose before it can be placed, or for its turn, is as old as its measurement and not as young as the
/// moment at which it is used.
#[derive(Clone, Debug, Default)]
pub(super) struct ReceiveTimes(VecDeque<(RobotTime, Monotonic)>);

impl ReceiveTimes {
    /// Something stamped `stamp` came.
    pub(super) fn record(&mut self, stamp: RobotTime, received: Monotonic) {
        if self.0.back().is_some_and(|&(last, _)| last >= stamp) {
            return;
        }
        if self.0.len() >= CAPACITY {
            self.0.pop_front();
        }
        self.0.push_back((stamp, received));
    }

    /// When the first of those came that were measured at `stamp` or later: no later than what was stamped so itself. `now`
    /// where nothing has come since.
    pub(super) fn received_at(&self, stamp: RobotTime, now: Monotonic) -> Monotonic {
        let at = self.0.partition_point(|&(stored, _)| stored < stamp);
        self.0.get(at).map_or(now, |&(_, received)| received)
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
        let mut receive_times = ReceiveTimes::default();
        assert_eq!(receive_times.received_at(stamp(5), at(9)), at(9));
        receive_times.record(stamp(10), at(100));
        receive_times.record(stamp(20), at(120));
        receive_times.record(stamp(20), at(130));
        receive_times.record(stamp(15), at(140));
        assert_eq!(receive_times.received_at(stamp(10), at(200)), at(100));
        assert_eq!(
            receive_times.received_at(stamp(11), at(200)),
            at(120),
            "not before 20 came"
        );
        assert_eq!(receive_times.received_at(stamp(21), at(200)), at(200));
        for n in 0..5000 {
            receive_times.record(stamp(100 + n), at(1000));
        }
        assert_eq!(receive_times.0.len(), CAPACITY);
        receive_times.clear();
        assert_eq!(receive_times.received_at(stamp(10), at(300)), at(300));
    }
}
