//! When a sensor measures.

/// Instants at a fixed rate, in whole nanoseconds so that none drifts.
pub(super) struct Ticks {
    rate_hz: f64,
    next: i64,
    end: i64,
}

impl Ticks {
    /// The instants from 0 to `end_s` inclusive; none where that is negative, without end where it is infinite.
    pub(super) fn until(end_s: f64, rate_hz: f64) -> Self {
        // A tick that falls on the end is not lost to rounding.
        let end = (libm::floor(end_s * rate_hz + 1e-6) as i64).saturating_add(1);
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

    /// Goes on to where `longer` ends; what lies before `from_nanos` is left out.
    pub(super) fn extend(&mut self, longer: &Self, from_nanos: i64) {
        self.end = self.end.max(longer.end);
        while self.next_nanos().is_some_and(|nanos| nanos < from_nanos) {
            self.advance();
        }
    }

    pub(super) fn last_s(&self) -> f64 {
        if self.end == i64::MAX {
            return f64::INFINITY;
        }
        seconds(self.nanos((self.end - 1).max(0)))
    }
}

fn seconds(nanos: i64) -> f64 {
    nanos as f64 / 1e9
}

#[cfg(test)]
mod tests {
    #![expect(clippy::float_cmp, reason = "these values are exact")]

    use super::*;

    #[test]
    fn ticks_that_go_on_do_not_go_back() {
        let mut ticks = Ticks::until(1.0, 10.0);
        while ticks.next_nanos().is_some() {
            ticks.advance();
        }
        ticks.extend(&Ticks::until(2.0, 10.0), 1_200_000_000);
        assert_eq!(ticks.next_nanos(), Some(1_200_000_000));
        assert!((ticks.last_s() - 2.0).abs() < 1e-9);
        ticks.extend(&Ticks::until(f64::INFINITY, 10.0), 1_200_000_001);
        assert_eq!(ticks.next_nanos(), Some(1_300_000_000));
        assert_eq!(ticks.last_s(), f64::INFINITY);
    }
}
