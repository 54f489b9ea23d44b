//! The link breaks at any moment, with a key held.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{scope, sleep};
use std::time::Duration;

use foreshore_tests::drive_log::Stop;
use foreshore_tests::operator::{NEUTRAL, Operator};
use foreshore_tests::rig::relay::Relay;
use robot_edge::clock::Monotonic;

use super::robot::{CIRCLE, LIMITS, NAME, Robot};
use crate::chance::Chance;

/// Long enough for a console to reconnect, which it tries twice a second.
const HELD_ON: Duration = Duration::from_millis(1200);

/// Cuts the link `cuts` times while `driver` drives, each for up to 3 s, and holds the key through all of it.
///
/// All stops for age.
pub(super) fn cut_while_driving(
    robot: &Robot,
    driver: &mut Operator,
    chance: &mut Chance,
    cuts: usize,
    (cut, pass): (impl Fn(), impl Fn()),
) -> Vec<Stop> {
    let mut outages = Vec::new();
    for _ in 0..cuts {
        driver.sets_off(CIRCLE);
        let [before, outage] =
            [(100, 900), (50, 3000)].map(|(least, most)| chance.millis(least, most));
        let is_over = AtomicBool::new(false);
        scope(|scope| {
            scope.spawn(|| driver.hold_until(CIRCLE, || is_over.load(Ordering::Relaxed)));
            sleep(before);
            cut();
            let cut_at = Monotonic::now();
            sleep(outage);
            outages.push((cut_at, Monotonic::now()));
            pass();
            sleep(HELD_ON);
            is_over.store(true, Ordering::Relaxed);
        });
    }
    let verdict = robot.verdict(&[&driver.journal]);
    let log = robot.log();
    for (cut_at, passed) in outages {
        // Commands are as old as the cut at least: an edge that reckoned wrongly would be seen here.
        let late = cut_at + LIMITS.max_age + NEUTRAL;
        let rounds = log.during(late, passed);
        let moves = rounds.iter().find(|round| !round.stands());
        assert_eq!(moves, None, "cut at {cut_at:?}");
    }
    verdict.stops
}

/// The same through a relay of TCP.
fn cut_tcp_while_driving(seed: u64, cuts: usize) -> Vec<Stop> {
    let robot = Robot::start();
    let relay = Relay::to(([127, 0, 0, 1], robot.port).into()).unwrap();
    let mut anna = Operator::ready(&relay.endpoint(), NAME, "anna");
    let link = (|| relay.cut().unwrap(), || relay.pass().unwrap());
    cut_while_driving(&robot, &mut anna, &mut Chance::new(seed), cuts, link)
}

/// Prints how long after the issue of the last token the output fell, and how long it took to zero.
pub(super) fn tell(stops: &[Stop]) {
    if stops.is_empty() {
        println!("no stops for age");
        return;
    }
    let millis = |time: Duration| time.as_secs_f64() * 1e3;
    let mut fell: Vec<_> = stops.iter().map(|stop| millis(stop.fell_after)).collect();
    fell.sort_by(f64::total_cmp);
    let longer = stops
        .iter()
        .filter_map(|stop| Some(millis(stop.stood_after?) - millis(stop.ramp)));
    println!(
        "{} stops for age: the output fell {:.1} to {:.1} ms (p50 {:.1}) after the issue of the last token taken, and was \
         zero {:.1} ms later than v/a at most",
        fell.len(),
        fell[0],
        fell[fell.len() - 1],
        fell[fell.len() / 2],
        longer.fold(f64::NEG_INFINITY, f64::max)
    );
}

#[test]
fn a_vehicle_whose_link_breaks_stops_and_waits_for_a_press() {
    let stops = cut_tcp_while_driving(1, 3);
    assert!(!stops.is_empty());
    tell(&stops);
}

#[test]
#[ignore = "four minutes: 200 cuts"]
fn two_hundred_cuts() {
    let robots: Vec<_> = (0..4)
        .map(|seed| std::thread::spawn(move || cut_tcp_while_driving(100 + seed, 50)))
        .collect();
    let robots = robots.into_iter().flat_map(|robot| robot.join().unwrap());
    let stops: Vec<_> = robots.collect();
    tell(&stops);
    assert!(stops.len() > 100, "{}", stops.len());
}
