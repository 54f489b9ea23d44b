//! Somebody drives a circle while something else happens.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::scope;

use foreshore_tests::drive_log::DriveLog;
use foreshore_tests::operator::Operator;
use robot_edge::clock::Monotonic;

use super::robot::CIRCLE;

/// Runs `attack` while `driver` holds [`CIRCLE`]; when it began and ended.
pub(super) fn while_driving(
    driver: &mut Operator,
    attack: impl FnOnce(),
) -> (Monotonic, Monotonic) {
    driver.sets_off(CIRCLE);
    let is_over = AtomicBool::new(false);
    scope(|scope| {
        scope.spawn(|| driver.hold_until(CIRCLE, || is_over.load(Ordering::Relaxed)));
        let began = Monotonic::now();
        attack();
        let ended = Monotonic::now();
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

/// Prints how late rounds were.
pub(super) fn tell_periods(what: &str, log: &DriveLog, (began, ended): (Monotonic, Monotonic)) {
    let rounds = log.during(began, ended).to_vec();
    let log = DriveLog { rounds, missing: 0 };
    let mut millis: Vec<_> = log
        .periods()
        .iter()
        .map(|period| period.as_secs_f64() * 1e3)
        .collect();
    millis.sort_by(f64::total_cmp);
    let at = |share: f64| millis[((millis.len() - 1) as f64 * share) as usize];
    println!(
        "{what}: {} rounds, from one to the next p50 {:.1} ms, p99 {:.1} ms, most {:.1} ms",
        millis.len() + 1,
        at(0.5),
        at(0.99),
        at(1.0)
    );
}
