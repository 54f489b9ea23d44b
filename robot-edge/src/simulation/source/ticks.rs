//! When a sensor measures.

/// Instants at a fixed rate, in whole nanoseconds so that none drifts.
pub(super) struct Ticks {
    rate_hz: f64,
    next: i64,
    end: i64,
}

impl Ticks {
    /// The instants from 0 to `end_s` inclusive; none where that is negative.
    pub(super) fn until(end_s: f64, rate_hz: f64) -> Self {
        // A tick that falls on the end is not lost to rounding.
        let end = libm::floor(end_s * rate_hz + 1e-6) as i64 + 1;
        Self {
            rate_hz,
            next: 0,
            end: end.max(0),
        }
    }

    fn nanos(&self, tick: i64) -> i64 {
        libm::round(tick as f64 * 1e9 / self.rate_hz) as i64
    }

    pub(super) fn next_nanos(&self) -> Option<i64> {
        (self.next < self.end).then(|| self.nanos(self.next))
    }

    pub(super) fn advance(&mut self) {
        self.next += 1;
    }

    pub(super) fn last_s(&self) -> f64 {
        seconds(self.nanos((self.end - 1).max(0)))
    }
}

fn seconds(nanos: i64) -> f64 {
    nanos as f64 / 1e9
}
