//! Estimates when live measurements were made.
//!
//! Stamps are of another clock, so that only differences are known: the delay of a measurement is its (arrival − stamp)
//! minus the minimum of its stream. Data that a connection held back is therefore old, and the collision monitor does
//! not treat it as current.

use measurement::StreamId;
use measurement::delay_window::DelayWindow;
use measurement::time::Monotonic;
use measurement::time::RobotTime;

/// The delays of each stream, by number.
#[derive(Debug, Default)]
pub(super) struct DelayEstimator(Vec<Option<DelayWindow>>);

impl DelayEstimator {
    /// When the measurement would have arrived with the minimum delay: at `received_at` or before.
    pub(super) fn measured_at(
        &mut self,
        stream: StreamId,
        stamp: RobotTime,
        received_at: Monotonic,
    ) -> Monotonic {
        let behind = received_at.nanos().saturating_sub(stamp.as_nanos());
        let index = usize::from(stream.0);
        if self.0.len() <= index {
            self.0.resize(index + 1, None);
        }
        let window = self.0[index].get_or_insert_with(|| DelayWindow::new(behind, received_at));
        let late = u64::try_from(window.add(behind, received_at)).unwrap_or(0);
        Monotonic::from_nanos(received_at.nanos().unsigned_abs().saturating_sub(late))
    }

    pub(super) fn reset_clock(&mut self) {
        self.0.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;
    const MS: u64 = 1_000_000;

    const EPOCH_NS: i64 = 1_790_000_000_000_000_000;

    fn stamp(nanos: u64) -> RobotTime {
        RobotTime::from_nanos(EPOCH_NS + i64::try_from(nanos).unwrap())
    }

    fn at(nanos: u64) -> Monotonic {
        Monotonic::from_nanos(nanos)
    }

    #[test]
    fn data_that_was_held_back_is_old() {
        let mut delay_estimator = DelayEstimator::default();
        let mut measured_at = |ms: u64, came_ms: u64| {
            delay_estimator.measured_at(StreamId(3), stamp(ms * MS), at(came_ms * MS))
        };
        for tick in 0..1200 {
            let ms = 100 * tick;
            assert_eq!(measured_at(ms, 500 + ms), at((500 + ms) * MS));
        }
        // Nothing arrives for 60 s, and then everything at once.
        for tick in 0..600 {
            let ms = 120_000 + 100 * tick;
            assert_eq!(measured_at(ms, 180_500), at((500 + ms) * MS));
        }
        assert_eq!(measured_at(180_000, 180_530), at(180_500 * MS));
    }

    #[test]
    fn drifting_clocks_are_followed() {
        let mut delay_estimator = DelayEstimator::default();
        let mut oldest = 0;
        for second in 0..10_800 {
            let received_at = at(second * SECOND + second * 100_000);
            let measured_at =
                delay_estimator.measured_at(StreamId(0), stamp(second * SECOND), received_at);
            oldest = oldest.max(received_at.since(measured_at).as_micros());
        }
        assert!((1..=2_100).contains(&oldest), "{oldest} µs");
    }

    #[test]
    fn each_stream_has_its_own_clock() {
        let mut delay_estimator = DelayEstimator::default();
        for (stream, received_at) in [(0, 10), (1, 5_000), (0, 10), (1, 5_000)] {
            let received_at = at(received_at * MS);
            assert_eq!(
                delay_estimator.measured_at(StreamId(stream), stamp(0), received_at),
                received_at
            );
        }
        delay_estimator.reset_clock();
        assert_eq!(
            delay_estimator.measured_at(StreamId(0), stamp(0), at(SECOND)),
            at(SECOND)
        );
    }

    #[test]
    fn extreme_stamps_do_not_overflow() {
        let mut delay_estimator = DelayEstimator::default();
        for stamp in [RobotTime::MIN, RobotTime::MAX, RobotTime::MIN] {
            let measured_at = delay_estimator.measured_at(StreamId(0), stamp, at(SECOND));
            assert!(measured_at <= at(SECOND));
        }
    }
}
