//! The only file that reads clocks.
//!
//! Deadlines and ages use [`Monotonic`]; wall-clock time only labels. Data is ordered by its own stamps,
//! [`measurement::time::RobotTime`], which no clock here is ever compared with.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use measurement::time::Monotonic;

/// Longest time that [`sleep_until`] sleeps without asking whether it is still wanted.
const MAX_SLEEP: Duration = Duration::from_millis(50);

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

/// Sleeps until `deadline`, or until `is_cancelled`, which is asked at least every 50 ms.
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
#[expect(clippy::disallowed_methods, reason = "this file is the clock")]
pub fn seconds_since_1970() -> u64 {
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH);
    since_epoch.map_or(0, |duration| duration.as_secs())
}

/// UTC in the form of RFC 3339.
pub fn utc_label(secs_since_epoch: u64) -> String {
    let (days, secs) = (secs_since_epoch / 86_400, secs_since_epoch % 86_400);
    // Howard Hinnant, "chrono-compatible low-level date algorithms", civil_from_days: years begin in March,
    // so that the leap day is their last.
    let shifted = days + 719_468;
    let era = shifted / 146_097;
    let day_of_era = shifted % 146_097;
    let year_of_era =
        (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 {
        month_from_march + 3
    } else {
        month_from_march - 9
    };
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    let (hour, minute, second) = (secs / 3_600, secs / 60 % 60, secs % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    #[test]
    fn labels_are_calendar_dates() {
        for (secs, expected) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_399, "2000-02-28T23:59:59Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (1_772_368_496, "2026-03-01T12:34:56Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ] {
            assert_eq!(utc_label(secs), expected);
        }
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
