//! How fast tiles may be pushed: the budget, or less where the link carries less. Pure.
//!
//! What the fastest console says it holds tells what the link carries: if even the fastest lags, the uplink is
//! the bottleneck, and more would only wait in buffers.

use std::collections::VecDeque;
use std::time::Duration;

use super::token_bucket::TokenBucket;
use measurement::time::Monotonic;

/// A push that no console has acknowledged after this long means that the link lags.
const LAG_THRESHOLD: Duration = Duration::from_millis(1500);
/// A push that is lost is never acknowledged; consoles ask for it themselves.
const ACK_TIMEOUT: Duration = Duration::from_secs(10);
/// Between two changes of the rate.
const ADJUST_PERIOD: Duration = Duration::from_secs(1);
/// Never slower than this part of the budget, or nothing would tell that the link is better again.
const MIN_SHARE: f64 = 1.0 / 16.0;
/// Of what was acknowledged, this much is sent on, so that buffers drain.
const DRAIN_SHARE: f64 = 0.8;
const RECOVERY: f64 = 1.1;

/// The rate of pushes.
#[derive(Clone, Debug)]
pub struct BandwidthLimiter {
    token_bucket: TokenBucket,
    max_kbps: f64,
    kbps: f64,
    /// Revision, bytes and time of each push that is not acknowledged.
    unacknowledged: VecDeque<(u64, usize, Monotonic)>,
    acknowledged_bytes: usize,
    adjusted: Monotonic,
}

impl BandwidthLimiter {
    /// A flow of at most `budget_kbps` kilobits (10³ bits) per second.
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

    /// Another budget, kilobits per second; nothing where it is the same.
    pub fn set_budget(&mut self, budget_kbps: u32) {
        let max_kbps = f64::from(budget_kbps);
        if (self.max_kbps - max_kbps).abs() >= 0.5 {
            self.max_kbps = max_kbps;
            self.kbps = max_kbps;
            self.token_bucket.set_rate(max_kbps);
        }
    }

    /// Whether something may be pushed now.
    pub fn allows(&mut self, now: Monotonic) -> bool {
        self.token_bucket.allows(now)
    }

    /// A tile was pushed.
    pub fn pushed(&mut self, revision: u64, bytes: usize, now: Monotonic) {
        self.token_bucket.spend(bytes);
        self.unacknowledged.push_back((revision, bytes, now));
    }

    /// Something was pushed that no console acknowledges.
    pub fn spent(&mut self, bytes: usize) {
        self.token_bucket.spend(bytes);
    }

    /// The fastest console holds tiles up to `revision`.
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

    /// The present rate, kilobits per second.
    pub const fn kbps(&self) -> f64 {
        self.kbps
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
