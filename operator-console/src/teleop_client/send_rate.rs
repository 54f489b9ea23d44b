//! Times of drive commands: 50 a second, and three within 20 ms after a change of the input.

use std::time::Duration;

use measurement::time::Monotonic;

pub(super) const PERIOD: Duration = Duration::from_millis(20);
/// Each change of the input is sent three times within 20 ms.
const SENDINGS: u32 = 3;
/// The third leaves 14 ms after the first.
const BETWEEN: Duration = Duration::from_millis(7);
/// The robot accepts 100 messages a second of one operator: ten for an emergency stop, a few for requests.
const PER_SECOND: f64 = 80.0;
/// Commands at once beyond that rate: three changes.
const BURST: f64 = 9.0;

#[derive(Clone, Debug)]
pub(super) struct SendRateLimiter {
    due: Monotonic,
    /// Repetitions of the last change that are still due.
    left: u32,
    allowance: f64,
    counted: Monotonic,
}

impl SendRateLimiter {
    pub(super) const fn new(now: Monotonic) -> Self {
        Self {
            due: now,
            left: 0,
            allowance: BURST,
            counted: now,
        }
    }

    /// Whether to send a command now; if so, it counts as sent.
    pub(super) fn is_due(&mut self, now: Monotonic, is_changed: bool) -> bool {
        let elapsed_s = now.since(self.counted).as_secs_f64();
        self.counted = self.counted.max(now);
        self.allowance = (self.allowance + PER_SECOND * elapsed_s).min(BURST);
        if is_changed {
            self.left = SENDINGS;
            self.due = self.due.min(now);
        }
        if now < self.due {
            return false;
        }
        if self.allowance < 1.0 {
            self.due = now + Duration::from_secs_f64((1.0 - self.allowance) / PER_SECOND);
            return false;
        }
        self.allowance -= 1.0;
        self.left = self.left.saturating_sub(1);
        // A slightly late loop keeps the rate; a suspended one restarts.
        let on_time = self.due + PERIOD;
        self.due = if self.left > 0 {
            now + BETWEEN
        } else if on_time > now {
            on_time
        } else {
            now + PERIOD
        };
        true
    }

    pub(super) const fn due(&self) -> Monotonic {
        self.due
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::at;

    fn sent(changes: impl Fn(u64) -> bool, until_ms: u64) -> Vec<u64> {
        let mut send_rate = SendRateLimiter::new(at(0));
        let times = (0..until_ms).filter(|ms| send_rate.is_due(at(*ms), changes(*ms)));
        times.collect()
    }

    #[test]
    fn fifty_a_second_without_a_change() {
        assert_eq!(sent(|_| false, 100), [0, 20, 40, 60, 80]);
        assert_eq!(sent(|_| false, 10_000).len(), 500);
    }

    #[test]
    fn late_loop_still_sends_50_hz() {
        let mut send_rate = SendRateLimiter::new(at(0));
        let (mut ms, mut sent) = (0, 0);
        while ms < 10_000 {
            sent += usize::from(send_rate.is_due(at(ms), false));
            ms = send_rate.due().since(at(0)).as_millis() as u64 + 3;
        }
        assert!((498..=500).contains(&sent), "{sent}");
    }

    #[test]
    fn change_is_sent_three_times_within_20_ms() {
        assert_eq!(sent(|ms| ms == 31, 80), [0, 20, 31, 38, 45, 65]);
        assert_eq!(
            sent(|ms| ms == 31 || ms == 36, 80),
            [0, 20, 31, 36, 43, 50, 70]
        );
    }

    #[test]
    fn moving_stick_stays_within_the_rate_limit() {
        for every_ms in [1, 10, 15] {
            let sent = sent(|ms| ms % every_ms == 0, 10_000).len();
            assert!((500..=809).contains(&sent), "{every_ms}: {sent}");
        }
    }
}
