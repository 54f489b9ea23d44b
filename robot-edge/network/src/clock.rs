//! The only file that reads clocks.
//!
//! Deadlines and ages use [`Monotonic`]; wall-clock time only labels. Data is ordered by its own stamps,
//! [`measurement::time::RobotTime`], which no clock here is ever compared with.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use measurement::time::Monotonic;
pub use protocol::export::utc_label;

/// Longest time that [`sleep_until`] sleeps without asking whether it is still wanted.
const MAX_SLEEP: Duration = Duration::from_millis(100);

#[cfg(target_os = "linux")]
pub fn now() -> Monotonic {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Boottime);
    let nanos = now
        .tv_sec
        .saturating_mul(1_000_000_000)
        .saturating_add(now.tv_nsec);
    Monotonic::from_nanos(u64::try_from(nanos).unwrap_or(0))
}

#[cfg(not(target_os = "linux"))]
#[expect(clippy::disallowed_methods, reason = "this file is the clock")]
pub fn now() -> Monotonic {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    let start = START.get_or_init(std::time::Instant::now);
    Monotonic::from_nanos(u64::try_from(elapsed(start).as_nanos()).unwrap_or(u64::MAX))
}

pub fn elapsed(moment: Monotonic) -> Duration {
    now().since(moment)
}

/// Sleeps until `deadline`, or until `is_cancelled`, which is asked at least every 100 ms.
///
/// Returns whether the deadline was reached.
pub fn sleep_until(deadline: Monotonic, is_cancelled: impl Fn() -> bool) -> bool {
    loop {
        if is_cancelled() {
            return false;
        }
        let rest = deadline.since(now());
        if rest.is_zero() {
            return true;
        }
        std::thread::sleep(rest.min(MAX_SLEEP));
    }
}

/// The present by the wall clock, for labels only: `2026-03-01T12:34:56Z`.
pub fn wall_clock_label() -> String {
    utc_label(seconds_since_1970())
}

/// The present by the wall clock, for labels and the dates of certificates: seconds since 1970, UTC.
pub fn seconds_since_1970() -> u64 {
    since_1970().as_secs()
}

/// The present by the wall clock, for messages to other programs: nanoseconds since 1970, UTC.
pub fn nanos_since_1970() -> i64 {
    i64::try_from(since_1970().as_nanos()).unwrap_or(i64::MAX)
}

#[expect(clippy::disallowed_methods, reason = "this file is the clock")]
fn since_1970() -> Duration {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    #[test]
    fn the_present_has_a_label() {
        assert_eq!(wall_clock_label().len(), "2026-03-01T12:34:56Z".len());
    }

    #[test]
    fn the_clock_runs_and_sleep_reaches_its_deadline() {
        let start = now();
        assert!(sleep_until(start + Duration::from_millis(20), || false));
        assert!(elapsed(start) >= Duration::from_millis(20));
        assert!(
            sleep_until(start, || false),
            "a deadline in the past is reached"
        );
    }

    #[test]
    fn sleep_ends_when_it_is_no_longer_wanted() {
        let asked = Cell::new(0);
        let reached = sleep_until(Monotonic::from_nanos(u64::MAX), || {
            asked.replace(asked.get() + 1) == 2
        });
        assert!(!reached);
        assert_eq!(asked.get(), 3);
    }

    #[test]
    fn moments_saturate() {
        let end = Monotonic::from_nanos(u64::MAX);
        assert_eq!(end + Duration::MAX, end);
        assert_eq!(Monotonic::from_nanos(1).since(end), Duration::ZERO);
    }
}
