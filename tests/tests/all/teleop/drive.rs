//! Drives a circle while something else happens, and measures the rounds.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::scope;
use std::time::Duration;

use foreshore_tests::drive_log::DriveLog;
use foreshore_tests::operator::Operator;
use measurement::time::Monotonic;
use robot_edge::clock;

use super::figures::at;
use super::robot::CIRCLE;

/// Runs `attack` while `driver` holds [`CIRCLE`]; returns its begin and end.
pub(super) fn while_driving(
    driver: &mut Operator,
    attack: impl FnOnce(),
) -> (Monotonic, Monotonic) {
    driver.start_driving(CIRCLE);
    let is_over = AtomicBool::new(false);
    scope(|scope| {
        scope.spawn(|| driver.hold_until(CIRCLE, || is_over.load(Ordering::Relaxed)));
        let began = clock::now();
        attack();
        let ended = clock::now();
        is_over.store(true, Ordering::Relaxed);
        (began, ended)
    })
}

/// Share of the time in which the vehicle drove, from 0 to 1; below 1 on a busy machine.
pub(super) fn drove(what: &str, log: &DriveLog, (began, ended): (Monotonic, Monotonic)) -> f64 {
    let driving_s = log.during(began, ended).windows(2).map(|pair| {
        let is_driving = pair[0].mode == "driving";
        f64::from(u8::from(is_driving)) * pair[1].at.since(pair[0].at).as_secs_f64()
    });
    let share = driving_s.sum::<f64>() / ended.since(began).as_secs_f64();
    println!("{what}: it drove {:.1} % of the time", 100.0 * share);
    share
}

/// Period of the teleop loop.
pub(super) const ROUND: Duration = Duration::from_millis(20);

/// Delays of rounds beyond [`ROUND`].
pub(super) struct Lateness {
    /// Sorted.
    late: Vec<Duration>,
    /// Share of the time in rounds that were late by more than [`ROUND`], from 0 to 1.
    delayed: f64,
}

impl Lateness {
    /// Of the rounds of a drive; prints them.
    pub(super) fn of(what: &str, log: &DriveLog, (began, ended): (Monotonic, Monotonic)) -> Self {
        let rounds = log.during(began, ended).to_vec();
        let periods = DriveLog { rounds, missing: 0 }.periods();
        let delayed = periods.iter().filter(|&&period| period > 2 * ROUND);
        let delayed = delayed.sum::<Duration>().as_secs_f64() / ended.since(began).as_secs_f64();
        let late = periods.iter().map(|period| period.saturating_sub(ROUND));
        let mut late: Vec<_> = late.collect();
        late.sort_unstable();
        println!(
            "{what}: {} rounds, late by p50 {:.1?}, p99 {:.1?}, most {:.1?}",
            late.len(),
            at(&late, 0.5),
            at(&late, 0.99),
            at(&late, 1.0)
        );
        Self { late, delayed }
    }

    /// The quantile `share`.
    pub(super) fn at(&self, share: f64) -> Duration {
        at(&self.late, share)
    }

    /// Panics if these rounds are later than those without a flood. A busy machine delays some in
    /// both.
    pub(super) fn is_no_worse_than(&self, quiet: &Self) {
        assert!(
            self.delayed <= 0.1 + 2.0 * quiet.delayed,
            "{:.1} % of the time was in rounds that were delayed by more than {ROUND:?}, and {:.1} % without a flood",
            100.0 * self.delayed,
            100.0 * quiet.delayed
        );
        let (median, limit) = (self.at(0.5), quiet.at(0.5) + ROUND / 4);
        assert!(median <= limit, "every second round is late by {median:?}");
    }

    /// Panics if any round is late: for an idle machine.
    pub(super) fn is_none(&self) {
        for (share, limit) in [(0.99, ROUND / 4), (1.0, ROUND)] {
            let late = self.at(share);
            assert!(late <= limit, "{share} of all rounds: late by {late:?}");
        }
    }
}
