//! Time of the data, and this machine's steady clock.

use std::fmt;
use std::ops::{Add, Sub};
use std::time::Duration;

/// A sensor stamp: nanoseconds since the epoch of the clock that stamped the data.
///
/// The epoch may be Unix, the start of a simulation or any other; only differences and order have a
/// meaning. It is never compared with a clock of this machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct RobotTime(i64);

/// A difference of two [`RobotTime`]s, in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct RobotDuration(i64);

impl RobotTime {
    /// The smallest representable stamp.
    pub const MIN: Self = Self(i64::MIN);
    /// The greatest representable stamp.
    pub const MAX: Self = Self(i64::MAX);

    /// A stamp from whole nanoseconds.
    pub const fn from_nanos(nanos: i64) -> Self {
        Self(nanos)
    }

    /// A stamp from seconds; `None` if not finite or out of range (±292 years).
    pub fn from_secs_f64(secs: f64) -> Option<Self> {
        nanos_from_secs(secs).map(Self)
    }

    /// Whole nanoseconds.
    pub const fn as_nanos(self) -> i64 {
        self.0
    }

    /// Seconds, rounded to the nearest f64.
    pub fn as_secs_f64(self) -> f64 {
        self.0 as f64 / 1e9
    }

    /// The time from `earlier` to `self`, negative if `earlier` is later; saturates.
    pub const fn since(self, earlier: Self) -> RobotDuration {
        RobotDuration(self.0.saturating_sub(earlier.0))
    }
}

impl RobotDuration {
    /// Zero.
    pub const ZERO: Self = Self(0);

    /// A duration from whole nanoseconds.
    pub const fn from_nanos(nanos: i64) -> Self {
        Self(nanos)
    }

    /// A duration from whole milliseconds.
    pub const fn from_millis(millis: i64) -> Self {
        Self(millis.saturating_mul(1_000_000))
    }

    /// A duration from seconds; NaN is zero, the rest saturates.
    pub fn from_secs_f64(secs: f64) -> Self {
        // `as` saturates and maps NaN to zero.
        Self(libm::round(secs * 1e9) as i64)
    }

    /// Whole nanoseconds.
    pub const fn as_nanos(self) -> i64 {
        self.0
    }

    /// Seconds, rounded to the nearest f64.
    pub fn as_secs_f64(self) -> f64 {
        self.0 as f64 / 1e9
    }
}

fn nanos_from_secs(secs: f64) -> Option<i64> {
    let nanos = libm::round(secs * 1e9);
    (nanos.is_finite() && nanos.abs() < 9.2e18).then_some(nanos as i64)
}

impl Add for RobotDuration {
    type Output = Self;
    fn add(self, rhs: Self) -> Self {
        Self(self.0.saturating_add(rhs.0))
    }
}

impl Add<RobotDuration> for RobotTime {
    type Output = Self;
    fn add(self, rhs: RobotDuration) -> Self {
        Self(self.0.saturating_add(rhs.0))
    }
}

impl Sub<RobotDuration> for RobotTime {
    type Output = Self;
    fn sub(self, rhs: RobotDuration) -> Self {
        Self(self.0.saturating_sub(rhs.0))
    }
}

impl fmt::Display for RobotTime {
    /// In seconds.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let nanos = self.0.unsigned_abs();
        write!(
            f,
            "{sign}{}.{:09}",
            nanos / 1_000_000_000,
            nanos % 1_000_000_000
        )
    }
}

/// A time of this machine's steady clock: nanoseconds since it started.
///
/// On Linux `CLOCK_BOOTTIME`, which continues while the machine is suspended.
/// [`std::time::Instant`] does not, so that a command would look recent after a suspension.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Monotonic(u64);

impl Monotonic {
    /// From nanoseconds since the clock's start.
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// Nanoseconds since the clock's start; saturates after 292 years.
    pub const fn nanos(self) -> i64 {
        if self.0 > i64::MAX as u64 {
            i64::MAX
        } else {
            self.0.cast_signed()
        }
    }

    /// The time from `earlier` to `self`; zero if `earlier` is later.
    pub const fn since(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }
}

impl Add<Duration> for Monotonic {
    type Output = Self;
    fn add(self, rhs: Duration) -> Self {
        let nanos = u64::try_from(rhs.as_nanos()).unwrap_or(u64::MAX);
        Self(self.0.saturating_add(nanos))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_become_nanoseconds_and_back() {
        let stamp = RobotTime::from_secs_f64(1_600_000_002.198_3).unwrap();
        assert_eq!(stamp.as_nanos() / 10_000, 160_000_000_219_829);
        assert_eq!(
            RobotTime::from_nanos(-42_000_000).to_string(),
            "-0.042000000"
        );
    }

    #[test]
    fn senseless_seconds_are_refused() {
        for secs in [f64::NAN, f64::INFINITY, -1e300, 1e11] {
            assert_eq!(RobotTime::from_secs_f64(secs), None, "{secs}");
        }
    }

    #[test]
    fn arithmetic_saturates() {
        let end = RobotTime::from_nanos(i64::MAX);
        assert_eq!(end + RobotDuration::from_millis(1), end);
        assert_eq!(
            end.since(RobotTime::MIN),
            RobotDuration::from_nanos(i64::MAX)
        );
    }
}
