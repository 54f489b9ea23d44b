//! When a drive command is due: 50 times a second, and three times within 20 ms when the input changes.

use std::time::Duration;

use measurement::time::Monotonic;

/// Between two commands ("Teleop": 50 Hz).
pub(super) const PERIOD: Duration = Duration::from_millis(20);
/// "Every change of input is sent 3 times within 20 ms."
const SENDINGS: u32 = 3;
/// Between those: the third leaves 14 ms after the first.
const BETWEEN: Duration = Duration::from_millis(7);
/// The robot takes 100 messages a second of one operator; ten of these are an emergency stop's, a few are requests.
const PER_SECOND: f64 = 80.0;
/// Commands beyond that rate at once: three changes.
const BURST: f64 = 9.0;

/// The times of commands.
#[derive(Clone, Debug)]
pub(super) struct SendRateLimiter {
    due: Monotonic,
    /// Sendings of the last change that are still to come.
    left: u32,
    allowance: f64,
    counted: Monotonic,
}

impl SendRateLimiter {
    /// A command is due now.
    pub(super) const fn new(now: Monotonic) -> Self {
        Self {
            due: now,
            left: 0,
            allowance: BURST,
            counted: now,
        }
    }

    /// Whether a command is to be sent now, where the input changed or did not; then it is taken for sent.
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
        // A loop that is a little late keeps the rate; one that was away begins anew.
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

    /// When the next one is due.
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
    fn a_loop_that_is_always_late_sends_fifty_a_second_all_the_same() {
        let mut send_rate = SendRateLimiter::new(at(0));
        let (mut ms, mut sent) = (0, 0);
        while ms < 10_000 {
            sent += usize::from(send_rate.is_due(at(ms), false));
            ms = send_rate.due().since(at(0)).as_millis() as u64 + 3;
        }
        assert!((498..=500).contains(&sent), "{sent}");
    }

    #[test]
    fn a_change_is_sent_at_once_and_three_times_within_20_ms() {
        assert_eq!(sent(|ms| ms == 31, 80), [0, 20, 31, 38, 45, 65]);
        // The next change begins anew.
        assert_eq!(
            sent(|ms| ms == 31 || ms == 36, 80),
            [0, 20, 31, 36, 43, 50, 70]
        );
    }

    #[test]
    fn a_stick_that_never_rests_stays_within_what_the_robot_takes() {
        for every_ms in [1, 10, 15] {
            let sent = sent(|ms| ms % every_ms == 0, 10_000).len();
            assert!((500..=809).contains(&sent), "{every_ms}: {sent}");
        }
    }
}
