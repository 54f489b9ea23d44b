//! Somebody drives a circle while something else happens.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::scope;
use std::time::Duration;

use foreshore_tests::drive_log::DriveLog;
use foreshore_tests::operator::Operator;
use measurement::time::Monotonic;
use robot_edge::clock;

use super::figures::at;
use super::robot::CIRCLE;

/// Runs `attack` while `driver` holds [`CIRCLE`]; when it began and ended.
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

/// How much of the time the vehicle drove, from 0 to 1: on a busy machine it may not have been all.
pub(super) fn drove(what: &str, log: &DriveLog, (began, ended): (Monotonic, Monotonic)) -> f64 {
    let driving_s = log.during(began, ended).windows(2).map(|pair| {
        let is_driving = pair[0].mode == "driving";
        f64::from(u8::from(is_driving)) * pair[1].at.since(pair[0].at).as_secs_f64()
    });
    let share = driving_s.sum::<f64>() / ended.since(began).as_secs_f64();
    println!("{what}: it drove {:.1} % of the time", 100.0 * share);
    share
}

/// A round ends at the latest so long after the one before (`robot-edge/src/driving/thread.rs`).
pub(super) const ROUND: Duration = Duration::from_millis(20);

/// How much later than [`ROUND`] rounds ended.
pub(super) struct Lateness {
    /// The latest last.
    late: Vec<Duration>,
    /// The share of the time that went by in rounds which were later than another [`ROUND`], from 0 to 1.
    delayed: f64,
}

impl Lateness {
    /// Of the rounds of a drive. Prints it.
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

    /// Of that share of all rounds, the latest.
    pub(super) fn at(&self, share: f64) -> Duration {
        at(&self.late, share)
    }

    /// Fails where these rounds were delayed and those of the same machine without a flood, shortly before, were not. A
    /// busy machine delays some by itself.
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

    /// Fails where any round was delayed: for a machine that has nothing else to do.
    pub(super) fn is_none(&self) {
        for (share, limit) in [(0.99, ROUND / 4), (1.0, ROUND)] {
            let late = self.at(share);
            assert!(late <= limit, "{share} of all rounds: late by {late:?}");
        }
    }
}
