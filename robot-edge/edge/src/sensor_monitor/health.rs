//! The rate and the faults of one sensor.

use std::collections::VecDeque;
use std::time::Duration;

use protocol::message::SensorFault;

use measurement::time::RobotTime;

const RATE_WINDOW: Duration = Duration::from_secs(5);
/// Maximum number of messages in the window; for faster sensors it is shorter.
const MAX_RECENT: usize = 1024;
/// Time, and number of periods, without a message before the sensor is silent.
const SILENT_AFTER: Duration = Duration::from_secs(1);
const SILENT_PERIODS: u32 = 5;
const FIRST_MESSAGE_TIMEOUT: Duration = Duration::from_secs(3);
/// Time, and number of periods, of only invalid measurements before a fault.
const INVALID_AFTER: Duration = Duration::from_secs(1);
const INVALID_PERIODS: u32 = 3;
/// Deviation between stamps and time that counts as a jump of the clock.
const STAMP_JUMP: Duration = Duration::from_secs(1);
/// Duration of the fault after a jump.
const STAMP_JUMP_SHOWN: Duration = Duration::from_secs(5);
/// Share of the usual rate below which a sensor is slow.
const SLOW_SHARE: f64 = 0.5;
/// Number of intervals whose median is the period: a pause does not change it.
const MAX_GAPS: usize = 9;

#[derive(Clone, Debug)]
pub(super) struct SensorHealth {
    nominal_hz: Option<f64>,
    messages: u64,
    since: Duration,
    first: Option<Duration>,
    /// Arrival times of the newest messages in the window.
    recent: VecDeque<Duration>,
    last: Option<Duration>,
    /// Time of the last valid measurement, or of the first message before one.
    valid: Option<Duration>,
    stamp: Option<RobotTime>,
    stamp_jumped_at: Option<Duration>,
    gaps: VecDeque<Duration>,
    is_blocked: bool,
}

impl SensorHealth {
    pub(super) fn new(nominal_hz: Option<f32>) -> Self {
        Self {
            nominal_hz: nominal_hz.map(f64::from).filter(|rate_hz| *rate_hz > 0.0),
            messages: 0,
            since: Duration::ZERO,
            first: None,
            recent: VecDeque::new(),
            last: None,
            valid: None,
            stamp: None,
            stamp_jumped_at: None,
            gaps: VecDeque::new(),
            is_blocked: false,
        }
    }

    pub(super) const fn set_blocked(&mut self, is_blocked: bool) {
        self.is_blocked = is_blocked;
    }

    pub(super) fn take(&mut self, stamp: RobotTime, is_valid: bool, at: Duration) {
        self.messages += 1;
        self.first.get_or_insert(at);
        if let (Some(last), Some(before)) = (self.last, self.stamp) {
            let gap = at.saturating_sub(last);
            if is_stamp_jump(before, stamp, gap) {
                self.stamp_jumped_at = Some(at);
            }
            self.gaps.push_back(gap);
            if self.gaps.len() > MAX_GAPS {
                self.gaps.pop_front();
            }
        }
        self.stamp = Some(stamp);
        self.last = Some(self.last.map_or(at, |last| last.max(at)));
        if is_valid || self.valid.is_none() {
            self.valid = self.last;
        }
        self.recent.push_back(at);
        if self.recent.len() > MAX_RECENT {
            self.recent.pop_front();
        }
        while self
            .recent
            .front()
            .is_some_and(|first| at.saturating_sub(*first) > RATE_WINDOW)
        {
            self.recent.pop_front();
        }
    }

    pub(super) const fn reset_stamp(&mut self) {
        self.stamp = None;
    }

    /// The time is `to`, earlier or later than before. Only the number of messages is kept.
    pub(super) fn seek(&mut self, to: Duration) {
        *self = Self {
            messages: self.messages,
            since: to,
            nominal_hz: self.nominal_hz,
            ..Self::new(None)
        };
    }

    pub(super) const fn messages(&self) -> u64 {
        self.messages
    }

    pub(super) fn age(&self, now: Duration) -> Option<Duration> {
        self.last.map(|last| now.saturating_sub(last))
    }

    pub(super) fn rate_hz(&self, now: Duration) -> f64 {
        let Some(last) = self.last else { return 0.0 };
        let is_silent = now.saturating_sub(last) > self.silent_after();
        let within = |at: &&Duration| now.saturating_sub(**at) <= RATE_WINDOW;
        let count = self.recent.iter().filter(within).count();
        let oldest = self.recent.iter().find(within);
        // Rate between the messages while they arrive, so that it does not vary for a slow sensor; afterwards,
        // over the time since the last ones.
        let until = if is_silent { now } else { last };
        let span_s = oldest.map_or(0.0, |oldest| until.saturating_sub(*oldest).as_secs_f64());
        let gap_s = self.median_gap().as_secs_f64();
        if count >= 2 && span_s > 0.0 {
            (count - 1) as f64 / span_s
        } else if count < 2 && !is_silent && gap_s > 0.0 {
            // Fewer than two messages in the window.
            1.0 / gap_s
        } else {
            0.0
        }
    }

    pub(super) fn fault(&self, now: Duration) -> Option<SensorFault> {
        let Some((last, first)) = self.last.zip(self.first) else {
            return (now.saturating_sub(self.since) >= FIRST_MESSAGE_TIMEOUT)
                .then_some(SensorFault::Silent);
        };
        if now.saturating_sub(last) > self.silent_after() {
            return Some(SensorFault::Silent);
        }
        if self
            .stamp_jumped_at
            .is_some_and(|stamp_jumped_at| now.saturating_sub(stamp_jumped_at) < STAMP_JUMP_SHOWN)
        {
            return Some(SensorFault::Clock);
        }
        let invalid_after = INVALID_AFTER.max(self.periods(INVALID_PERIODS));
        if self
            .valid
            .is_some_and(|valid| last.saturating_sub(valid) >= invalid_after)
        {
            return Some(SensorFault::AllInvalid);
        }
        let is_known = now.saturating_sub(first) >= RATE_WINDOW;
        let is_slow = self
            .nominal_hz
            .is_some_and(|nominal_hz| self.rate_hz(now) < SLOW_SHARE * nominal_hz);
        if is_known && is_slow {
            return Some(SensorFault::Slow);
        }
        self.is_blocked.then_some(SensorFault::Blocked)
    }

    fn median_gap(&self) -> Duration {
        let mut gaps: Vec<_> = self.gaps.iter().copied().collect();
        gaps.sort_unstable();
        gaps.get(gaps.len() / 2).copied().unwrap_or_default()
    }

    fn silent_after(&self) -> Duration {
        SILENT_AFTER.max(self.periods(SILENT_PERIODS))
    }

    /// `periods` of the sensor; `None` if the period is unknown.
    fn periods(&self, count: u32) -> Duration {
        let period = match self.nominal_hz {
            Some(rate_hz) => Duration::try_from_secs_f64(1.0 / rate_hz).unwrap_or(Duration::MAX),
            None => self.median_gap(),
        };
        period.saturating_mul(count)
    }
}

/// Whether the stamps of two messages `gap` apart come from different clocks.
fn is_stamp_jump(before: RobotTime, stamp: RobotTime, gap: Duration) -> bool {
    let step_ns = i128::from(stamp.as_nanos()) - i128::from(before.as_nanos());
    let gap_ns = i128::try_from(gap.as_nanos()).unwrap_or(i128::MAX);
    step_ns.saturating_sub(gap_ns).unsigned_abs() > STAMP_JUMP.as_nanos()
}
