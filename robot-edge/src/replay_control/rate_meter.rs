//! How fast a replay really is. Pure: the present is a parameter.

use std::collections::VecDeque;
use std::time::Duration;

use measurement::time::Monotonic;
use measurement::time::RobotDuration;

/// Over this much of the past.
const WINDOW: Duration = Duration::from_secs(1);
/// Less says nothing.
const MIN_SPAN: Duration = Duration::from_millis(100);
/// Positions are kept this far apart.
const SAMPLE_INTERVAL: Duration = Duration::from_millis(20);

/// Time of the data per time, over the last second.
#[derive(Clone, Debug, Default)]
pub(crate) struct RateMeter {
    samples: VecDeque<(Monotonic, RobotDuration)>,
}

impl RateMeter {
    /// The replay is at `position` at `now`.
    pub(crate) fn record(&mut self, position: RobotDuration, now: Monotonic) {
        let is_due = self
            .samples
            .back()
            .is_none_or(|(at, _)| now.since(*at) >= SAMPLE_INTERVAL);
        if is_due {
            self.samples.push_back((now, position));
        }
        while self
            .samples
            .front()
            .is_some_and(|(at, _)| now.since(*at) > WINDOW)
        {
            self.samples.pop_front();
        }
    }

    /// The rate, once there is enough to tell.
    pub(crate) fn rate(&self) -> Option<f64> {
        let ((start, from), (end, to)) = (*self.samples.front()?, *self.samples.back()?);
        let time = end.since(start);
        let data_s = to.as_secs_f64() - from.as_secs_f64();
        (time >= MIN_SPAN).then(|| data_s / time.as_secs_f64())
    }

    /// It stands still, or jumps.
    pub(crate) fn reset(&mut self) {
        self.samples.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_that_of_the_last_second() {
        let mut meter = RateMeter::default();
        let mut position_ms = 0;
        let mut record = |meter: &mut RateMeter, at_ms: u64, step_ms: i64| {
            position_ms += step_ms;
            meter.record(
                RobotDuration::from_millis(position_ms),
                Monotonic::from_nanos(at_ms * 1_000_000),
            );
        };
        record(&mut meter, 0, 0);
        record(&mut meter, 50, 500);
        assert_eq!(meter.rate(), None, "too early to tell");
        for at_ms in (100..=1000).step_by(50) {
            record(&mut meter, at_ms, 500);
        }
        assert!((meter.rate().unwrap() - 10.0).abs() < 1e-9);
        for at_ms in (1050..=2100).step_by(50) {
            record(&mut meter, at_ms, 100);
        }
        assert!((meter.rate().unwrap() - 2.0).abs() < 1e-9);
        meter.reset();
        assert_eq!(meter.rate(), None);
    }
}
