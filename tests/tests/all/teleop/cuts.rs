//! The link breaks, stalls and then delivers old commands at once, or is attacked, while a key is held: over TCP, and over QUIC
//! with keys.

use std::thread::{sleep, spawn};
use std::time::Duration;

use foreshore_tests::drive_log::{Round, Stop};
use foreshore_tests::operator::{NEUTRAL, Operator, refused};
use foreshore_tests::rig::relay::Relay;
use foreshore_tests::rig::udp::UdpRelay;
use foreshore_tests::rig::{Conditions, Direction};
use network::clock;
use protocol::message::Refusal;

use super::robot::{CIRCLE, LIMITS, NAME, ROUND, Robot, drove, while_driving, while_holding};
use crate::fleet::{Fleet, quic};
use crate::processes::free_port;
use crate::rng::SeededRng;

/// A relay to a robot, and an operator behind it.
fn behind_relay(robot: &Robot) -> (Relay, Operator) {
    let target = robot.endpoint.trim_start_matches("tcp/");
    let relay = Relay::start(0, target.parse().unwrap()).unwrap();
    let operator = Operator::ready(&relay.endpoint(), NAME, "anna");
    (relay, operator)
}

#[track_caller]
fn assert_stopped(rounds: &[Round]) {
    assert_eq!(rounds.iter().find(|round| !round.is_stopped()), None);
}

/// Time for an operator to reconnect.
const HELD_ON: Duration = Duration::from_millis(1200);

/// Cuts the link `cuts` times while `driver` holds a key, each time for up to 3 s.
///
/// Returns the stops for age.
fn cut_while_driving(
    robot: &Robot,
    driver: &mut Operator,
    rng: &mut SeededRng,
    cuts: usize,
    (cut, pass): (impl Fn(), impl Fn()),
) -> Vec<Stop> {
    let mut outages = Vec::new();
    for _ in 0..cuts {
        let [before, outage] =
            [(100, 900), (50, 3000)].map(|(least, most)| rng.millis(least, most));
        while_driving(driver, || {
            sleep(before);
            cut();
            let cut_at = clock::now();
            sleep(outage);
            outages.push((cut_at, clock::now()));
            pass();
            sleep(HELD_ON);
        });
    }
    let verdict = robot.verdict(&[&driver.journal]);
    let log = robot.log();
    for (cut_at, passed) in outages {
        // Commands are at least as old as the cut.
        let late = cut_at + LIMITS.max_age + NEUTRAL;
        assert_stopped(log.during(late, passed));
    }
    verdict.stops
}

/// Through a TCP relay.
fn cut_tcp_while_driving(seed: u64, cuts: usize) -> Vec<Stop> {
    let robot = Robot::start();
    let (relay, mut anna) = behind_relay(&robot);
    let link = (|| relay.cut(), || relay.pass());
    cut_while_driving(&robot, &mut anna, &mut SeededRng::new(seed), cuts, link)
}

/// Prints how late the output fell after the greatest age of the last token, and how much later than v/a it was zero. Panics if
/// the median, or on an idle machine any, is late by more than two rounds.
fn assert_prompt(stops: &[Stop], is_idle: bool) {
    assert!(!stops.is_empty(), "no stops for age");
    let fell = stops.iter().map(|stop| stop.fell_after);
    let fell_late = fell.map(|fell| fell.saturating_sub(LIMITS.max_age));
    let stood = stops
        .iter()
        .filter_map(|stop| Some(stop.stood_after?.saturating_sub(stop.ramp)));
    for (what, mut late) in [
        ("fell", fell_late.collect::<Vec<_>>()),
        ("was zero", stood.collect()),
    ] {
        late.sort_unstable();
        let [median, most] = [late.len() / 2, late.len().saturating_sub(1)]
            .map(|at| late.get(at).copied().unwrap_or_default());
        println!("the output {what} {median:?} late (p50, most {most:?})");
        let late = if is_idle { most } else { median };
        assert!(late <= 2 * ROUND, "{late:?} late");
    }
}

#[test]
fn a_broken_link_stops_the_vehicle_until_a_new_press() {
    let stops = cut_tcp_while_driving(1, 3);
    assert_prompt(&stops, false);
}

#[test]
#[ignore = "four minutes: 200 cuts"]
fn two_hundred_cuts() {
    cuts_of_four_robots(|seed| cut_tcp_while_driving(100 + seed, 50));
}

fn cuts_of_four_robots(cut: impl Fn(u64) -> Vec<Stop> + Copy + Send + 'static) {
    let robots: Vec<_> = (0..4).map(|seed| spawn(move || cut(seed))).collect();
    let robots = robots.into_iter().flat_map(|robot| robot.join().unwrap());
    let stops: Vec<_> = robots.collect();
    assert_prompt(&stops, true);
    assert!(stops.len() > 100, "{}", stops.len());
}

/// Time for held commands to arrive and for a broken session to reconnect.
const AFTERWARDS: Duration = Duration::from_secs(3);

/// What is stalled: both directions, so that no new token arrives either, or commands only, whose tokens were new when they
/// were built.
const STALLED: [&[Direction]; 2] = [&Direction::ALL, &[Direction::ToTarget]];

/// Commands that a stall made too old.
#[derive(Clone, Copy, Debug)]
struct Late {
    /// Refused for their age.
    too_old: u64,
    /// Refused before the age was checked: too many at once.
    too_many: u64,
}

impl Late {
    /// Panics if fewer commands arrived than the stall must have held.
    fn is_of(self, stall: Duration) {
        let Self { too_old, too_many } = self;
        // Commands of the last 400 ms are young enough; a busy machine may lose some.
        let sent = (stall.as_secs_f64() - 0.6) * 50.0;
        assert!(
            too_old > 0 && (too_old + too_many) as f64 >= sent,
            "{stall:?}: {self:?}"
        );
    }
}

/// Stalls the link while a key is held; returns the commands that arrived late.
fn stall_while_driving(stalled: &[Direction], stall: Duration) -> Late {
    let robot = Robot::start();
    let (relay, mut anna) = behind_relay(&robot);
    // Not affected by the stall.
    let observer = robot.operator("observer");
    let stale = || {
        let status = observer.wait_for_new_status();
        let of = |reason| refused(&status, reason);
        let too_old = of(Refusal::TooOld) + of(Refusal::UnknownToken);
        (too_old, of(Refusal::TooMany))
    };
    anna.start_driving(CIRCLE);
    let before = stale();
    let mut from = clock::now();
    let (_, end) = while_holding(&mut anna, || {
        sleep(Duration::from_millis(300));
        relay.stall(stalled);
        from = clock::now();
        sleep(stall);
        relay.pass();
        sleep(AFTERWARDS);
    });
    // The stall stops the vehicle, and no late command moves it, although the key is held.
    let late = from + LIMITS.max_age + NEUTRAL;
    assert_stopped(robot.log().during(late, end));
    let after = stale();
    anna.start_driving(CIRCLE);
    robot.verdict(&[&anna.journal]);
    Late {
        too_old: after.0 - before.0,
        too_many: after.1 - before.1,
    }
}

#[test]
fn commands_of_a_stalled_link_move_nothing() {
    let stall = Duration::from_secs(2);
    let stalls = STALLED.map(|stalled| spawn(move || stall_while_driving(stalled, stall)));
    for (stalled, late) in STALLED.into_iter().zip(stalls) {
        let late = late.join().unwrap();
        println!("{stalled:?}, 2 s: {late:?}");
        late.is_of(stall);
    }
}

#[test]
#[ignore = "three minutes: stalls of up to 30 s"]
fn stalls_of_one_to_thirty_seconds() {
    for seconds in [1, 2, 3, 4, 5, 8, 12, 20, 30] {
        let stall = Duration::from_secs(seconds);
        let rows = STALLED
            .map(|stalled| spawn(move || stall_while_driving(stalled, stall)))
            .map(|robot| robot.join().unwrap());
        // Longer stalls exceed Zenoh's lease of 4 s, and most commands under way are lost.
        if seconds <= 3 {
            for late in rows {
                late.is_of(stall);
            }
        }
        let rows = rows.map(|Late { too_old, too_many }| format!("{too_old} | {too_many}"));
        println!("| {seconds} s | {} |", rows.join(" | "));
    }
}

/// A robot with keys behind a relay.
struct Secured {
    robot: Robot,
    relay: UdpRelay,
    fleet: Fleet,
}

impl Secured {
    fn start(seed: u64) -> Self {
        let (fleet, port) = (Fleet::new(), free_port());
        let endpoint = quic(port);
        let options = fleet.edge("--listen", &endpoint);
        let robot = Robot::start_with("rooms", &endpoint, &options, |_| ());
        let relay = UdpRelay::start(0, ([127, 0, 0, 1], port).into(), seed).unwrap();
        Self {
            robot,
            relay,
            fleet,
        }
    }

    /// An operator behind the relay.
    fn operator(&self, name: &str) -> Operator {
        let endpoint = format!("quic/{}", self.relay.address());
        Operator::with_keys(&endpoint, NAME, &self.fleet.person(name))
    }

    /// An operator with a direct link.
    fn observer(&self) -> Operator {
        Operator::with_keys(&self.robot.endpoint, NAME, &self.fleet.person("bert"))
    }
}

fn cut_quic_while_driving(seed: u64, cuts: usize) -> Vec<Stop> {
    let secured = Secured::start(seed);
    let mut anna = secured.operator("anna");
    let gone = Conditions {
        blackhole: true,
        ..Conditions::default()
    };
    let link = (
        || secured.relay.set_both(gone),
        || secured.relay.set_both(Conditions::default()),
    );
    cut_while_driving(
        &secured.robot,
        &mut anna,
        &mut SeededRng::new(seed),
        cuts,
        link,
    )
}

#[test]
fn a_broken_quic_link_stops_the_vehicle_until_a_new_press() {
    let stops = cut_quic_while_driving(1, 3);
    assert_prompt(&stops, false);
}

#[test]
#[ignore = "four minutes: 200 cuts"]
fn two_hundred_cuts_of_quic() {
    cuts_of_four_robots(|seed| cut_quic_while_driving(200 + seed, 50));
}

/// Datagrams are held and then arrive all at once, as on a radio link.
#[test]
fn commands_of_a_stalled_quic_link_move_nothing() {
    let secured = Secured::start(2);
    let mut anna = secured.operator("anna");
    let observer = secured.observer();
    let late = || {
        let status = observer.wait_for_new_status();
        [Refusal::TooOld, Refusal::UnknownToken, Refusal::TooMany]
            .map(|reason| refused(&status, reason))
            .iter()
            .sum::<u64>()
    };
    let before = late();
    let held = Conditions {
        rate_bytes_per_s: Some(0),
        queue_bytes: 1 << 20,
        ..Conditions::default()
    };
    let mut stalled = clock::now();
    let (_, ended) = while_driving(&mut anna, || {
        sleep(NEUTRAL);
        secured.relay.set(Direction::ToTarget, held);
        stalled = clock::now();
        sleep(Duration::from_millis(1800));
        let passes = Conditions::default();
        secured.relay.set(Direction::ToTarget, passes);
        sleep(NEUTRAL * 3);
    });
    // The key was held all the time.
    let from = stalled + LIMITS.max_age + NEUTRAL;
    assert_stopped(secured.robot.log().during(from, ended));
    let late = late() - before;
    println!("{late} commands came too late");
    assert!(late > 20, "{late}");
    anna.start_driving(CIRCLE);
    secured.robot.verdict(&[&anna.journal]);
}

/// Datagrams are duplicated, late, reordered, changed, lost and repeated.
#[test]
fn attacked_datagrams_move_nothing() {
    let secured = Secured::start(3);
    let mut anna = secured.operator("anna");
    let bad = Conditions {
        delay: Duration::from_millis(20),
        jitter: Duration::from_millis(10),
        loss: 0.02,
        duplication: 0.2,
        reordering: (0.1, Duration::from_millis(60)),
        tampering: 0.05,
        ..Conditions::default()
    };
    secured.relay.set_both(bad);
    let drive = while_driving(&mut anna, || {
        for _ in 0..20 {
            sleep(Duration::from_millis(200));
            for direction in Direction::ALL {
                let captured = secured.relay.captured(direction);
                assert!(captured.len() >= 20, "{} captured", captured.len());
                secured.relay.inject(direction, captured);
            }
        }
    });
    drove("datagrams attacked", &secured.robot.log(), drive);
    secured.relay.set_both(Conditions::default());
    anna.start_driving(CIRCLE);
    secured.robot.verdict(&[&anna.journal]);
}
