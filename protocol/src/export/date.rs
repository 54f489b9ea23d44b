//! Calendar dates of stamps.

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

/// Earlier stamps are of a clock that was not set: 1980-01-01.
const FIRST_DATE_NS: i64 = 315_532_800_000_000_000;

/// Two stamps as dates: `2000-01-01 00:00:00 to 00:01:55 UTC`; `None` if the clock was not set.
pub fn span_label(first_ns: i64, last_ns: i64) -> Option<String> {
    if first_ns < FIRST_DATE_NS || last_ns < first_ns {
        return None;
    }
    let [from, to] = [first_ns, last_ns].map(|stamp_ns| {
        utc_label(stamp_ns.unsigned_abs() / 1_000_000_000)
            .trim_end_matches('Z')
            .replace('T', " ")
    });
    let (day, _) = from.split_once(' ')?;
    let to = to.strip_prefix(day).map_or(&*to, str::trim_start);
    Some(format!("{from} to {to} UTC"))
}

#[cfg(test)]
mod tests {
    use super::*;

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
    }

    #[test]
    fn spans_name_a_day_once() {
        let label =
            |first_s: i64, last_s: i64| span_label(first_s * 1_000_000_000, last_s * 1_000_000_000);
        for (first_s, last_s, expected) in [
            (
                946_684_800,
                946_684_915,
                Some("2000-01-01 00:00:00 to 00:01:55 UTC"),
            ),
            (
                946_684_800,
                946_771_200,
                Some("2000-01-01 00:00:00 to 2000-01-02 00:00:00 UTC"),
            ),
            (32, 2683, None),
            (-5, 946_684_800, None),
            (946_684_800, 946_684_799, None),
        ] {
            assert_eq!(label(first_s, last_s).as_deref(), expected);
        }
    }
}
