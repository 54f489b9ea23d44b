//! The rate at which tiles may be pushed: the budget, or less if the link carries less. Pure.
//!
//! The fastest console's acknowledgement measures the link: if even that one lags, the uplink is the bottleneck, and
//! more tiles would wait in buffers.

use std::collections::VecDeque;
use std::time::Duration;

use measurement::time::Monotonic;

/// The link lags if a push is not acknowledged after this time.
const LAG_THRESHOLD: Duration = Duration::from_millis(1500);
/// A lost push is never acknowledged; consoles request the tile.
const ACK_TIMEOUT: Duration = Duration::from_secs(10);
/// Interval of changes of the rate.
const ADJUST_PERIOD: Duration = Duration::from_secs(1);
/// Minimum share of the budget, so that an improvement can be measured.
const MIN_SHARE: f64 = 1.0 / 16.0;
/// Share of the acknowledged rate that is sent, so that buffers drain.
const DRAIN_SHARE: f64 = 0.8;
const RECOVERY: f64 = 1.1;

#[derive(Clone, Debug)]
pub struct BandwidthLimiter {
    token_bucket: TokenBucket,
    max_kbps: f64,
    kbps: f64,
    /// Revision, bytes and time of each unacknowledged push.
    unacknowledged: VecDeque<(u64, usize, Monotonic)>,
    acknowledged_bytes: usize,
    adjusted: Monotonic,
}

impl BandwidthLimiter {
    /// `budget_kbps`: kilobits (10³ bits) per second.
    pub fn new(budget_kbps: u32, now: Monotonic) -> Self {
        let max_kbps = f64::from(budget_kbps);
        Self {
            token_bucket: TokenBucket::new(max_kbps, now),
            max_kbps,
            kbps: max_kbps,
            unacknowledged: VecDeque::new(),
            acknowledged_bytes: 0,
            adjusted: now,
        }
    }

    pub fn set_budget(&mut self, budget_kbps: u32) {
        let max_kbps = f64::from(budget_kbps);
        if (self.max_kbps - max_kbps).abs() >= 0.5 {
            self.max_kbps = max_kbps;
            self.kbps = max_kbps;
            self.token_bucket.set_rate(max_kbps);
        }
    }

    pub fn allows(&mut self, now: Monotonic) -> bool {
        self.token_bucket.allows(now)
    }

    pub fn pushed(&mut self, revision: u64, bytes: usize, now: Monotonic) {
        self.token_bucket.spend(bytes);
        self.unacknowledged.push_back((revision, bytes, now));
    }

    /// Counts a push that no console acknowledges.
    pub fn spent(&mut self, bytes: usize) {
        self.token_bucket.spend(bytes);
    }

    /// The fastest console has tiles up to `revision`.
    pub fn acknowledged(&mut self, revision: u64, now: Monotonic) {
        let acknowledged_bytes = &mut self.acknowledged_bytes;
        self.unacknowledged.retain(|(pushed, bytes, at)| {
            if *pushed <= revision {
                *acknowledged_bytes += bytes;
            }
            *pushed > revision && now.since(*at) < ACK_TIMEOUT
        });
        let elapsed = now.since(self.adjusted);
        if elapsed >= ADJUST_PERIOD {
            let throughput_kbps = self.acknowledged_bytes as f64 * 8e-3 / elapsed.as_secs_f64();
            self.adjust(throughput_kbps, now);
            self.acknowledged_bytes = 0;
            self.adjusted = now;
        }
    }

    fn adjust(&mut self, throughput_kbps: f64, now: Monotonic) {
        let lags = self
            .unacknowledged
            .front()
            .is_some_and(|(_, _, at)| now.since(*at) >= LAG_THRESHOLD);
        let kbps = if lags {
            self.kbps.min(DRAIN_SHARE * throughput_kbps)
        } else {
            self.kbps * RECOVERY
        };
        self.kbps = kbps.clamp(MIN_SHARE * self.max_kbps, self.max_kbps);
        self.token_bucket.set_rate(self.kbps);
    }

    pub const fn kbps(&self) -> f64 {
        self.kbps
    }
}

/// Burst after a pause, as time at the full rate.
const BURST: Duration = Duration::from_millis(250);

#[derive(Clone, Copy, Debug)]
pub struct TokenBucket {
    bytes_per_s: f64,
    /// Bytes that may be sent now; negative after an overdraft.
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

    pub fn set_rate(&mut self, kbps: f64) {
        self.bytes_per_s = kbps * 125.0;
    }

    /// Whether something may be sent. It may overdraw the budget; the overdraft is paid off first.
    pub fn allows(&mut self, now: Monotonic) -> bool {
        let earned = self.bytes_per_s * now.since(self.updated).as_secs_f64();
        self.credit = (self.credit + earned).min(self.bytes_per_s * BURST.as_secs_f64());
        self.updated = now;
        self.credit > 0.0
    }

    pub fn spend(&mut self, bytes: usize) {
        self.credit -= bytes as f64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pushes as fast as it may over a link of `link_kbps` for `seconds`; what waits in its buffer at the end,
    /// as seconds of the link.
    fn backlog_s(
        bandwidth_limiter: &mut BandwidthLimiter,
        link_kbps: f64,
        from_ms: u64,
        seconds: u64,
    ) -> f64 {
        let at = |ms: u64| Monotonic::from_nanos(ms * 1_000_000);
        let mut buffer: VecDeque<(u64, f64)> = VecDeque::new();
        let (mut revision, mut held) = (from_ms, 0);
        for ms in from_ms..from_ms + seconds * 1000 {
            while bandwidth_limiter.allows(at(ms)) {
                revision += 1;
                bandwidth_limiter.pushed(revision, 2000, at(ms));
                buffer.push_back((revision, 2000.0));
            }
            let mut carried = link_kbps / 8.0;
            while let Some((revision, left)) = buffer.front_mut() {
                if *left > carried {
                    *left -= carried;
                    break;
                }
                carried -= *left;
                held = *revision;
                buffer.pop_front();
            }
            if ms % 500 == 0 {
                bandwidth_limiter.acknowledged(held, at(ms));
            }
        }
        buffer.iter().map(|(_, left)| left).sum::<f64>() / (link_kbps * 125.0)
    }

    #[test]
    fn a_slow_link_is_followed_down_and_a_good_one_used_again() {
        let mut bandwidth_limiter = BandwidthLimiter::new(256, Monotonic::default());
        let waiting_s = backlog_s(&mut bandwidth_limiter, 64.0, 1, 60);
        assert!(waiting_s < 3.0, "{waiting_s} s wait in buffers");
        assert!(
            (16.0..80.0).contains(&bandwidth_limiter.kbps()),
            "{}",
            bandwidth_limiter.kbps()
        );
        backlog_s(&mut bandwidth_limiter, 2000.0, 60_001, 60);
        assert!(
            (bandwidth_limiter.kbps() - 256.0).abs() < 1e-9,
            "{}",
            bandwidth_limiter.kbps()
        );
    }

    #[test]
    fn pushes_that_are_lost_do_not_hold_the_flow_down_for_ever() {
        let mut bandwidth_limiter = BandwidthLimiter::new(256, Monotonic::default());
        bandwidth_limiter.pushed(9, 1000, Monotonic::default());
        for s in 1..40 {
            bandwidth_limiter.acknowledged(8, Monotonic::from_nanos(s * 1_000_000_000));
        }
        assert!((bandwidth_limiter.kbps() - 256.0).abs() < 1e-9);
        assert!(bandwidth_limiter.unacknowledged.is_empty());
    }
}

#[cfg(test)]
mod token_bucket_tests {
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
