//! How many bytes of tiles may be pushed: a token bucket. Pure: the present is a parameter.

use std::time::Duration;

use measurement::time::Monotonic;

/// What may be sent at once after a pause, as time at the full rate.
const BURST: Duration = Duration::from_millis(250);

/// A budget of bytes over time.
#[derive(Clone, Copy, Debug)]
pub struct TokenBucket {
    bytes_per_s: f64,
    /// Bytes that may be sent now; negative while what was sent is being paid off.
    credit: f64,
    updated: Monotonic,
}

impl TokenBucket {
    /// A full budget of `kbps` kilobits (10³ bits) per second.
    pub fn new(kbps: f64, now: Monotonic) -> Self {
        let bytes_per_s = kbps * 125.0;
        Self {
            bytes_per_s,
            credit: bytes_per_s * BURST.as_secs_f64(),
            updated: now,
        }
    }

    /// Goes on at another rate, kilobits per second.
    pub fn set_rate(&mut self, kbps: f64) {
        self.bytes_per_s = kbps * 125.0;
    }

    /// Whether something may be sent. What is sent at once may overdraw the credit: what it took is paid off first.
    pub fn allows(&mut self, now: Monotonic) -> bool {
        let earned = self.bytes_per_s * now.since(self.updated).as_secs_f64();
        self.credit = (self.credit + earned).min(self.bytes_per_s * BURST.as_secs_f64());
        self.updated = now;
        self.credit > 0.0
    }

    /// Takes what was sent.
    pub fn spend(&mut self, bytes: usize) {
        self.credit -= bytes as f64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn over_time_the_rate_is_kept() {
        let at = |ms: u64| Monotonic::from_nanos(ms * 1_000_000);
        let mut token_bucket = TokenBucket::new(256.0, at(0));
        let mut sent = 0;
        for ms in 0..10_000 {
            while token_bucket.allows(at(ms)) {
                token_bucket.spend(3_000);
                sent += 3_000;
            }
        }
        // 32 kB/s over 10 s, and the burst at the beginning.
        assert!((320_000..=334_000).contains(&sent), "{sent}");
        // A long pause does not save up for a flood.
        let mut burst = 0;
        while token_bucket.allows(at(100_000)) {
            token_bucket.spend(1_000);
            burst += 1_000;
        }
        assert!((7_000..=9_000).contains(&burst), "{burst}");
    }
}
