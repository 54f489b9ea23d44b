//! Times of one stage of the pipeline, in bounded memory.

use std::time::Duration;

use hdrhistogram::{CreationError, Histogram};
use serde::Serialize;

/// The longest time told apart from longer ones in the percentiles, nanoseconds.
const LONGEST_NS: u64 = 60_000_000_000;
/// Percentiles are within 1 % of the truth.
const SIGNIFICANT_DIGITS: u8 = 2;

/// How long one stage took, over all its runs: a histogram of 32 kB at most, however many runs there are.
#[derive(Clone, Debug)]
pub struct StageTimer {
    histogram: Histogram<u64>,
    max: Duration,
}

/// How long one stage took, microseconds; all zero where it never ran.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize)]
pub struct StageTimes {
    /// Median.
    pub p50_us: f64,
    /// 99th percentile.
    pub p99_us: f64,
    /// Longest, exact.
    pub max_us: f64,
}

impl StageTimer {
    /// A timer that has seen nothing.
    #[expect(
        clippy::expect_used,
        reason = "constant bounds, which a test constructs"
    )]
    pub fn new() -> Self {
        Self {
            histogram: bounded().expect("bounds are in order"),
            max: Duration::ZERO,
        }
    }

    /// Adds one run.
    pub fn record(&mut self, time: Duration) {
        let nanos = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        self.histogram.saturating_record(nanos);
        self.max = self.max.max(time);
    }

    /// Runs seen.
    pub fn runs(&self) -> u64 {
        self.histogram.len()
    }

    /// The figures so far.
    pub fn times(&self) -> StageTimes {
        let max_us = self.max.as_secs_f64() * 1e6;
        // A bucket reaches past the longest run in it.
        let quantile_us = |q| (self.histogram.value_at_quantile(q) as f64 / 1e3).min(max_us);
        StageTimes {
            p50_us: quantile_us(0.5),
            p99_us: quantile_us(0.99),
            max_us,
        }
    }
}

impl Default for StageTimer {
    fn default() -> Self {
        Self::new()
    }
}

fn bounded() -> Result<Histogram<u64>, CreationError> {
    Histogram::new_with_bounds(1, LONGEST_NS, SIGNIFICANT_DIGITS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_within_one_percent() {
        let mut timer = StageTimer::new();
        for micros in 1..=10_000 {
            timer.record(Duration::from_micros(micros));
        }
        let times = timer.times();
        assert!((times.p50_us / 5_000.0 - 1.0).abs() < 0.01, "{times:?}");
        assert!((times.p99_us / 9_900.0 - 1.0).abs() < 0.01, "{times:?}");
        assert!((times.max_us - 10_000.0).abs() < 1e-9, "{times:?}");
        assert_eq!(timer.runs(), 10_000);
    }

    #[test]
    fn no_runs_and_endless_runs_are_harmless() {
        let mut timer = StageTimer::new();
        assert_eq!(timer.times(), StageTimes::default());
        timer.record(Duration::ZERO);
        assert_eq!(timer.times(), StageTimes::default());
        timer.record(Duration::MAX);
        assert!(timer.times().max_us > 1e24);
        assert!(timer.histogram.distinct_values() * size_of::<u64>() < 32_000);
    }
}
