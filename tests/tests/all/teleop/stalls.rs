//! The link stalls and then delivers old commands at once.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{scope, sleep};
use std::time::Duration;

use foreshore_tests::operator::{NEUTRAL, Operator};
use foreshore_tests::rig::relay::{Direction, Relay};
use protocol::message::Refusal;
use robot_edge::clock;

use super::robot::{CIRCLE, NAME, Robot, refused};

/// Time for held commands to arrive and for a broken session to reconnect.
const AFTERWARDS: Duration = Duration::from_secs(3);

/// What is stalled.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Held {
    /// Both directions: no new token arrives either.
    Both,
    /// Commands only: their tokens were new when they were built.
    Commands,
}

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
fn stall_while_driving(held: Held, stall: Duration) -> Late {
    let robot = Robot::start();
    let relay = Relay::to(([127, 0, 0, 1], robot.port).into()).unwrap();
    let mut anna = Operator::ready(&relay.endpoint(), NAME, "anna");
    // Not affected by the stall.
    let observer = Operator::ready(&robot.endpoint(), NAME, "observer");
    let stale = || {
        let status = observer.wait_for_new_status();
        let of = |reason| refused(&status, reason);
        let too_old = of(Refusal::TooOld) + of(Refusal::UnknownToken);
        (too_old, of(Refusal::TooMany))
    };
    anna.start_driving(CIRCLE);
    let before = stale();
    let is_over = AtomicBool::new(false);
    let stalled = scope(|scope| {
        scope.spawn(|| anna.hold_until(CIRCLE, || is_over.load(Ordering::Relaxed)));
        sleep(Duration::from_millis(300));
        match held {
            Held::Both => relay.stall(&Direction::ALL),
            Held::Commands => relay.stall(&[Direction::ToTarget]),
        }
        let stalled = clock::now();
        sleep(stall);
        relay.pass().unwrap();
        sleep(AFTERWARDS);
        is_over.store(true, Ordering::Relaxed);
        stalled
    });
    let log = robot.log();
    let end = clock::now();
    // The stall stops the vehicle, and no late command moves it, although the key is held.
    let late = stalled + super::robot::LIMITS.max_age + NEUTRAL;
    let moves = log
        .during(late, end)
        .iter()
        .find(|round| !round.is_stopped());
    assert_eq!(moves, None, "{held:?} {stall:?}");
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
    let stalls = [Held::Both, Held::Commands].map(|held| {
        let stall = move || stall_while_driving(held, Duration::from_secs(2));
        (held, std::thread::spawn(stall))
    });
    for (held, stall) in stalls {
        let late = stall.join().unwrap();
        println!("{held:?}, 2 s: {late:?}");
        late.is_of(Duration::from_secs(2));
    }
}

#[test]
#[ignore = "three minutes: stalls of up to 30 s"]
fn stalls_of_one_to_thirty_seconds() {
    for seconds in [1, 2, 3, 4, 5, 8, 12, 20, 30] {
        let stall = Duration::from_secs(seconds);
        let rows = [Held::Both, Held::Commands]
            .map(|held| std::thread::spawn(move || stall_while_driving(held, stall)))
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
