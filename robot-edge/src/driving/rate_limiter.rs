//! How often one operator may send.

use std::time::Duration;

use measurement::time::Monotonic;

/// Messages that an operator may send a second ("Security": 100/s).
const PER_SECOND: f64 = 100.0;
/// Messages that may come at once, after a pause of the link.
const BURST: f64 = 25.0;

/// A bucket of permissions that fills by the second.
#[derive(Clone, Copy, Debug)]
pub(super) struct RateLimiter {
    left: f64,
    at: Monotonic,
}

impl RateLimiter {
    pub(super) const fn new(now: Monotonic) -> Self {
        Self {
            left: BURST,
            at: now,
        }
    }

    /// Whether one more may come now.
    pub(super) fn allows(&mut self, now: Monotonic) -> bool {
        let elapsed: Duration = now.since(self.at);
        self.at = self.at.max(now);
        self.left = (self.left + PER_SECOND * elapsed.as_secs_f64()).min(BURST);
        let is_allowed = self.left >= 1.0;
        if is_allowed {
            self.left -= 1.0;
        }
        is_allowed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hundred_a_second_pass_and_no_more() {
        let at = |ms: u64| Monotonic::from_nanos(ms * 1_000_000);
        let mut rate = RateLimiter::new(at(0));
        let passed = |rate: &mut RateLimiter, step_us: u64, from_ms: u64| {
            let times = (0..1_000_000 / step_us).map(|n| n * step_us * 1000);
            let times = times.map(|nanos| Monotonic::from_nanos(from_ms * 1_000_000 + nanos));
            times.filter(|&now| rate.allows(now)).count()
        };
        // What a console sends that drives: 50 a second, all of them.
        assert_eq!(passed(&mut rate, 20_000, 0), 50);
        let flood = passed(&mut rate, 100, 1000);
        assert!((100..=126).contains(&flood), "{flood} of 10,000");
        // Time that goes back fills nothing.
        while rate.allows(at(2000)) {}
        assert!(!rate.allows(at(0)) && !rate.allows(at(2000)));
    }
}
