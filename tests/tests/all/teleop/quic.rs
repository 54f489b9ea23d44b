//! Cuts, stalls and attacks of a QUIC link with keys.

use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::drive_log::Stop;
use foreshore_tests::operator::{NEUTRAL, Operator};
use foreshore_tests::rig::relay::Direction;
use foreshore_tests::rig::udp::UdpRelay;
use foreshore_tests::rig::{Conditions, Line};
use protocol::message::Refusal;
use robot_edge::clock;

use super::cuts::{Promptness, cut_while_driving};
use super::drive::{drove, while_driving};
use super::robot::{CIRCLE, LIMITS, NAME, Robot, refused};
use crate::fleet::Fleet;
use crate::link::processes::free_port;
use crate::rng::SeededRng;

/// A robot with keys behind a relay.
struct Secured {
    robot: Robot,
    relay: UdpRelay,
    fleet: Fleet,
}

impl Secured {
    fn start(seed: u64) -> Self {
        let fleet = Fleet::new();
        let port = free_port();
        let robot = Robot::start_with(
            port,
            &[
                "--listen",
                &format!("quic/127.0.0.1:{port}"),
                "--keys",
                fleet.vehicle().to_str().unwrap(),
            ],
        );
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
        let endpoint = format!("quic/127.0.0.1:{}", self.robot.port);
        Operator::with_keys(&endpoint, NAME, &self.fleet.person("bert"))
    }
}

const HELD: Conditions = Conditions {
    line: Line {
        delay: Duration::ZERO,
        rate_bytes_per_s: Some(0),
        queue_bytes: 1 << 20,
    },
    jitter: Duration::ZERO,
    loss: 0.0,
    duplication: 0.0,
    reordering: (0.0, Duration::ZERO),
    tampering: 0.0,
    blackhole: false,
};

fn cut_quic_while_driving(seed: u64, cuts: usize) -> Vec<Stop> {
    let secured = Secured::start(seed);
    let mut anna = secured.operator("anna");
    let gone = Conditions {
        blackhole: true,
        ..Conditions::default()
    };
    let link = (
        || secured.relay.set_both(gone).unwrap(),
        || secured.relay.set_both(Conditions::default()).unwrap(),
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
    Promptness::of(&stops).is_within_two_rounds(false);
}

#[test]
#[ignore = "four minutes: 200 cuts"]
fn two_hundred_cuts_of_quic() {
    let robots: Vec<_> = (0..4)
        .map(|seed| std::thread::spawn(move || cut_quic_while_driving(200 + seed, 50)))
        .collect();
    let robots = robots.into_iter().flat_map(|robot| robot.join().unwrap());
    let stops: Vec<_> = robots.collect();
    Promptness::of(&stops).is_within_two_rounds(true);
    assert!(stops.len() > 100, "{}", stops.len());
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
    let mut stalled = clock::now();
    let (_, ended) = while_driving(&mut anna, || {
        sleep(NEUTRAL);
        secured.relay.set(Direction::ToTarget, HELD).unwrap();
        stalled = clock::now();
        sleep(Duration::from_millis(1800));
        let passes = Conditions::default();
        secured.relay.set(Direction::ToTarget, passes).unwrap();
        sleep(NEUTRAL * 3);
    });
    let log = secured.robot.log();
    let from = stalled + LIMITS.max_age + NEUTRAL;
    let moves = log
        .during(from, ended)
        .iter()
        .find(|round| !round.is_stopped());
    assert_eq!(moves, None, "the key was held all the time");
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
        line: Line {
            delay: Duration::from_millis(20),
            ..Line::default()
        },
        jitter: Duration::from_millis(10),
        loss: 0.02,
        duplication: 0.2,
        reordering: (0.1, Duration::from_millis(60)),
        tampering: 0.05,
        ..Conditions::default()
    };
    secured.relay.set_both(bad).unwrap();
    let drive = while_driving(&mut anna, || {
        for _ in 0..20 {
            sleep(Duration::from_millis(200));
            for direction in Direction::ALL {
                let captured = secured.relay.captured(direction);
                secured.relay.inject(direction, captured).unwrap();
            }
        }
    });
    drove("datagrams attacked", &secured.robot.log(), drive);
    println!("{:?}", secured.relay.traffic(Direction::ToTarget));
    secured.relay.set_both(Conditions::default()).unwrap();
    anna.start_driving(CIRCLE);
    secured.robot.verdict(&[&anna.journal]);
}
