//! Paces a replay at the recorded speed or a multiple of it.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use measurement::time::Monotonic;
use measurement::time::{RobotDuration, RobotTime};

/// Longer steps of the stamps, forward or backward, are skipped: they are pauses of the recording or invalid stamps.
pub const MAX_GAP: RobotDuration = RobotDuration::from_millis(5_000);
/// A replay that is later than this (the machine slept, or mapping was slow) continues from where it is, without
/// catching up.
const MAX_LAG: Duration = Duration::from_secs(5);

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// Multiple of the recorded speed; finite, above zero.
    Times(f64),
    /// As fast as mapping allows.
    Max,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a rate is a number above 0 (1 is the speed of the recording), or `max`")]
pub struct RateError;

impl Rate {
    pub fn is_real_time(self) -> bool {
        matches!(self, Self::Times(rate) if (rate - 1.0).abs() < 1e-9)
    }
}

impl FromStr for Rate {
    type Err = RateError;

    fn from_str(text: &str) -> Result<Self, RateError> {
        if text == "max" {
            return Ok(Self::Max);
        }
        match text.parse() {
            Ok(times) if f64::is_finite(times) && times > 0.0 => Ok(Self::Times(times)),
            Ok(_) | Err(_) => Err(RateError),
        }
    }
}

impl fmt::Display for Rate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Times(times) => write!(f, "{times}"),
            Self::Max => f.write_str("max"),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Skipped {
    pub gaps: u64,
    /// Total time of the data in them.
    pub gap_time: RobotDuration,
    /// Steps back by more than [`MAX_GAP`].
    pub steps_back: u64,
    /// Number of times that the replay was too late and continued from where it was.
    pub lags: u64,
}

/// Pure: the current time is a parameter.
#[derive(Clone, Debug)]
pub struct Pacer {
    rate: Rate,
    anchor: Option<Anchor>,
    skipped: Skipped,
    lag: Duration,
}

/// A stamp and the time at which it was due; later stamps are relative to it.
#[derive(Clone, Copy, Debug)]
struct Anchor {
    stamp: RobotTime,
    due: Monotonic,
    latest: RobotTime,
}

impl Pacer {
    pub const fn new(rate: Rate) -> Self {
        Self {
            rate,
            anchor: None,
            skipped: Skipped {
                gaps: 0,
                gap_time: RobotDuration::ZERO,
                steps_back: 0,
                lags: 0,
            },
            lag: Duration::ZERO,
        }
    }

    /// Time to wait from `now` until data with this stamp is due.
    pub fn wait(&mut self, stamp: RobotTime, now: Monotonic) -> Duration {
        let Rate::Times(times) = self.rate else {
            return Duration::ZERO;
        };
        let fresh = Anchor {
            stamp,
            due: now,
            latest: stamp,
        };
        let anchor = self.anchor.get_or_insert(fresh);
        let step = stamp.since(anchor.latest);
        if step > MAX_GAP {
            self.skipped.gaps += 1;
            let total = self
                .skipped
                .gap_time
                .as_nanos()
                .saturating_add(step.as_nanos());
            self.skipped.gap_time = RobotDuration::from_nanos(total);
            *anchor = fresh;
        } else if anchor.latest.since(stamp) > MAX_GAP {
            self.skipped.steps_back += 1;
            *anchor = fresh;
        }
        anchor.latest = anchor.latest.max(stamp);
        let due = anchor.due + real_time(stamp.since(anchor.stamp), times);
        // Late data does not move the schedule.
        if stamp == anchor.latest {
            self.lag = now.since(due);
        }
        if now.since(due) > MAX_LAG && stamp == anchor.latest {
            self.skipped.lags += 1;
            *anchor = fresh;
        }
        due.since(now)
    }

    /// The clock of the data was reset: the next stamp is due at once.
    pub const fn reset(&mut self) {
        self.anchor = None;
    }

    /// Delay of the newest data; zero without pacing.
    pub const fn lag(&self) -> Duration {
        self.lag
    }

    pub const fn skipped(&self) -> Skipped {
        self.skipped
    }
}

/// Duration of `data` at this rate; zero if it is negative.
fn real_time(data: RobotDuration, times: f64) -> Duration {
    let secs = data.as_secs_f64().max(0.0) / times;
    Duration::try_from_secs_f64(secs).unwrap_or(Duration::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: u64 = 1_000_000;

    fn at(ms: i64) -> RobotTime {
        RobotTime::from_nanos(ms * 1_000_000)
    }

    /// Waits, milliseconds, of a replay that needs no processing time.
    fn waits(rate: Rate, stamps_ms: &[i64]) -> (Vec<u128>, Skipped) {
        let mut pacer = Pacer::new(rate);
        let mut now = Monotonic::from_nanos(7 * MS);
        let waits = stamps_ms.iter().map(|&ms| {
            let wait = pacer.wait(at(ms), now);
            now = now + wait;
            wait.as_millis()
        });
        (waits.collect(), pacer.skipped())
    }

    #[test]
    fn data_comes_at_its_rate() {
        let stamps = [1000, 1100, 1100, 1300];
        assert_eq!(waits(Rate::Times(1.0), &stamps).0, [0, 100, 0, 200]);
        assert_eq!(waits(Rate::Times(2.5), &stamps).0, [0, 40, 0, 80]);
        assert_eq!(waits(Rate::Max, &stamps).0, [0, 0, 0, 0]);
    }

    #[test]
    fn gaps_and_junk_stamps_are_passed_over_and_counted() {
        let (pause, skipped) = waits(Rate::Times(1.0), &[0, 100, 60_100, 60_200]);
        assert_eq!(pause, [0, 100, 0, 100]);
        assert_eq!(
            (skipped.gaps, skipped.gap_time),
            (1, RobotDuration::from_millis(60_000))
        );

        let (junk, skipped) = waits(Rate::Times(1.0), &[0, 100, 4_290_000_000_000, 200, 300]);
        assert_eq!(junk, [0, 100, 0, 0, 100]);
        assert_eq!((skipped.gaps, skipped.steps_back), (1, 1));
    }

    #[test]
    fn a_late_straggler_is_due_at_once_and_changes_nothing() {
        let (stragglers, skipped) = waits(Rate::Times(1.0), &[0, 100, 40, 200]);
        assert_eq!(stragglers, [0, 100, 0, 100]);
        assert_eq!(skipped, Skipped::default());
    }

    #[test]
    fn small_lag_is_made_up_and_large_lag_forgotten() {
        let mut pacer = Pacer::new(Rate::Times(1.0));
        pacer.wait(at(0), Monotonic::from_nanos(0));
        // 0.3 s late: the next one is due on the old schedule.
        assert_eq!(
            pacer.wait(at(100), Monotonic::from_nanos(400 * MS)),
            Duration::ZERO
        );
        assert_eq!(pacer.lag(), Duration::from_millis(300));
        // Late data does not count as a delay of the machine.
        pacer.wait(at(50), Monotonic::from_nanos(400 * MS));
        assert_eq!(pacer.lag(), Duration::from_millis(300));
        assert_eq!(
            pacer.wait(at(500), Monotonic::from_nanos(400 * MS)),
            Duration::from_millis(100)
        );
        assert_eq!(pacer.lag(), Duration::ZERO);
        // An hour late: the schedule restarts.
        let later = 3_600_000 * MS;
        assert_eq!(
            pacer.wait(at(600), Monotonic::from_nanos(later)),
            Duration::ZERO
        );
        assert_eq!(
            pacer.wait(at(700), Monotonic::from_nanos(later)),
            Duration::from_millis(100)
        );
        assert_eq!(pacer.skipped().lags, 1);
    }

    #[test]
    fn rates_are_checked() {
        assert_eq!("2.5".parse(), Ok(Rate::Times(2.5)));
        assert_eq!("max".parse(), Ok(Rate::Max));
        for text in ["0", "-1", "inf", "nan", "", "fast", "1x"] {
            assert_eq!(text.parse::<Rate>(), Err(RateError), "{text}");
        }
    }

    proptest! {
        /// No wait is longer than the longest gap at this rate, whatever the stamps are.
        #[test]
        fn no_wait_is_longer_than_a_gap(
            stamps in prop::collection::vec(any::<i64>().prop_map(|nanos| nanos >> 20), 1..40),
            small in prop::collection::vec(-20_000_000_000_i64..20_000_000_000, 0..40),
            times in 0.1..100.0_f64,
        ) {
            let mut pacer = Pacer::new(Rate::Times(times));
            let mut now = Monotonic::from_nanos(0);
            let longest = real_time(MAX_GAP, times) + Duration::from_micros(1);
            for nanos in stamps.into_iter().chain(small) {
                let wait = pacer.wait(RobotTime::from_nanos(nanos), now);
                prop_assert!(wait <= longest, "{wait:?} for {nanos}");
                now = now + wait;
            }
        }
    }
}
