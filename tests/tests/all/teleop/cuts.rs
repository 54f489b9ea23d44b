//! The link breaks at random times while a key is held.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{scope, sleep};
use std::time::Duration;

use foreshore_tests::drive_log::Stop;
use foreshore_tests::operator::{NEUTRAL, Operator};
use foreshore_tests::rig::relay::Relay;
use robot_edge::clock;

use super::drive::ROUND;
use super::robot::{CIRCLE, LIMITS, NAME, Robot};
use crate::rng::SeededRng;

/// Time for an operator to reconnect.
const HELD_ON: Duration = Duration::from_millis(1200);

/// Cuts the link `cuts` times while `driver` holds a key, each time for up to 3 s.
///
/// Returns the stops for age.
pub(super) fn cut_while_driving(
    robot: &Robot,
    driver: &mut Operator,
    rng: &mut SeededRng,
    cuts: usize,
    (cut, pass): (impl Fn(), impl Fn()),
) -> Vec<Stop> {
    let mut outages = Vec::new();
    for _ in 0..cuts {
        driver.start_driving(CIRCLE);
        let [before, outage] =
            [(100, 900), (50, 3000)].map(|(least, most)| rng.millis(least, most));
        let is_over = AtomicBool::new(false);
        scope(|scope| {
            scope.spawn(|| driver.hold_until(CIRCLE, || is_over.load(Ordering::Relaxed)));
            sleep(before);
            cut();
            let cut_at = clock::now();
            sleep(outage);
            outages.push((cut_at, clock::now()));
            pass();
            sleep(HELD_ON);
            is_over.store(true, Ordering::Relaxed);
        });
    }
    let verdict = robot.verdict(&[&driver.journal]);
    let log = robot.log();
    for (cut_at, passed) in outages {
        // Commands are at least as old as the cut.
        let late = cut_at + LIMITS.max_age + NEUTRAL;
        let rounds = log.during(late, passed);
        let moves = rounds.iter().find(|round| !round.is_stopped());
        assert_eq!(moves, None, "cut at {cut_at:?}");
    }
    verdict.stops
}

/// Through a TCP relay.
fn cut_tcp_while_driving(seed: u64, cuts: usize) -> Vec<Stop> {
    let robot = Robot::start();
    let relay = Relay::to(([127, 0, 0, 1], robot.port).into()).unwrap();
    let mut anna = Operator::ready(&relay.endpoint(), NAME, "anna");
    let link = (|| relay.cut(), || relay.pass().unwrap());
    cut_while_driving(&robot, &mut anna, &mut SeededRng::new(seed), cuts, link)
}

/// Delays of stops for age.
pub(super) struct Promptness {
    /// From the issue of the last accepted token until the output fell, beyond the greatest age.
    fell_late: Vec<Duration>,
    /// From then until it was zero, beyond v/a.
    stood_late: Vec<Duration>,
}

impl Promptness {
    /// Prints the delays.
    pub(super) fn of(stops: &[Stop]) -> Self {
        let sorted = |times: Vec<Duration>| {
            let mut times = times;
            times.sort_unstable();
            times
        };
        let fell = stops.iter().map(|stop| stop.fell_after);
        let fell_late = fell.map(|fell| fell.saturating_sub(LIMITS.max_age));
        let stood = stops
            .iter()
            .filter_map(|stop| Some(stop.stood_after?.saturating_sub(stop.ramp)));
        let late = Self {
            fell_late: sorted(fell_late.collect()),
            stood_late: sorted(stood.collect()),
        };
        assert!(!late.fell_late.is_empty(), "no stops for age");
        println!(
            "{} stops for age: the output fell {:?} after its last token's greatest age (p50, most {:?}), and was zero {:?} \
             later than v/a at most",
            stops.len(),
            late.fell_late[stops.len() / 2],
            late.fell_late.last(),
            late.stood_late.last(),
        );
        late
    }

    /// Panics if the median stop, or any stop on an idle machine, is late by more than two rounds.
    pub(super) fn is_within_two_rounds(&self, any: bool) {
        for late in [&self.fell_late, &self.stood_late] {
            let at = if any {
                late.len().saturating_sub(1)
            } else {
                late.len() / 2
            };
            let late = late.get(at).copied().unwrap_or_default();
            assert!(late <= 2 * ROUND, "{late:?} late");
        }
    }
}

#[test]
fn a_broken_link_stops_the_vehicle_until_a_new_press() {
    let stops = cut_tcp_while_driving(1, 3);
    Promptness::of(&stops).is_within_two_rounds(false);
}

#[test]
#[ignore = "four minutes: 200 cuts"]
fn two_hundred_cuts() {
    let robots: Vec<_> = (0..4)
        .map(|seed| std::thread::spawn(move || cut_tcp_while_driving(100 + seed, 50)))
        .collect();
    let robots = robots.into_iter().flat_map(|robot| robot.join().unwrap());
    let stops: Vec<_> = robots.collect();
    Promptness::of(&stops).is_within_two_rounds(true);
    assert!(stops.len() > 100, "{}", stops.len());
}
