//! How fast it is: each test prints rows of a table, and asserts nothing on time. Needs the machine for itself.

use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::drive_log::{DriveLog, press_latencies};
use foreshore_tests::operator::{Input, Journal, Operator};
use robot_edge::clock::Monotonic;
use tempfile::tempdir;

use super::robot::{NAME, Robot};
use crate::link::processes::{Running, free_port, program};

/// Pressed and let go, over and over.
pub(super) const PRESSED: (Input, Duration) = (Input::of(0.1, 0.5), Duration::from_millis(600));
pub(super) const LET_GO: (Input, Duration) = (Input::NEUTRAL, Duration::from_millis(450));

/// How many presses are measured.
const PRESSES: usize = 120;

/// `p50, p99, most` of durations, in milliseconds.
fn percentiles(mut times: Vec<Duration>) -> String {
    times.sort_unstable();
    let at = |share: f64| {
        let index = ((times.len().max(1) - 1) as f64 * share).round() as usize;
        let time = times.get(index).copied().unwrap_or_default();
        format!("{:.1}", time.as_secs_f64() * 1e3)
    };
    format!(
        "p50 {} ms, p99 {} ms, most {} ms",
        at(0.5),
        at(0.99),
        at(1.0)
    )
}

pub(super) fn tell_latencies(what: &str, log: &DriveLog, journal: &Journal) {
    let latencies = press_latencies(log, journal);
    let effective: Vec<_> = latencies.iter().copied().flatten().collect();
    println!(
        "{what}: key to motors, {} presses, {} without effect: {}",
        latencies.len(),
        latencies.len() - effective.len(),
        percentiles(effective)
    );
}

/// How much later than 20 ms after the one before rounds ended.
fn tell_lateness(what: &str, log: &DriveLog, from: Monotonic, to: Monotonic) {
    let rounds = log.during(from, to).to_vec();
    let log = DriveLog { rounds, missing: 0 };
    let late = log.periods();
    let late: Vec<_> = late
        .into_iter()
        .map(|period| period.saturating_sub(Duration::from_millis(20)))
        .collect();
    println!(
        "{what}: {} rounds late by {}",
        late.len(),
        percentiles(late)
    );
}

fn press_and_let_go(operator: &mut Operator) {
    for _ in 0..PRESSES {
        operator.hold(LET_GO.0, LET_GO.1);
        operator.hold(PRESSED.0, PRESSED.1);
    }
}

/// A robot with as many maps as it has, a console that follows, and one that is frozen; somebody presses and lets go.
fn measure_locally(world: &'static str) {
    let port = free_port();
    let robot = Robot::launch(program("robot-edge"), port, world, move |command| {
        command.args(["--listen", &format!("tcp/127.0.0.1:{port}")]);
    });
    let folder = tempdir().unwrap();
    let mut anna = Operator::ready(&robot.endpoint(), NAME, "anna");
    let console = |name: &str| {
        let mut command = program("operator-console");
        command.args(["--headless", "--for", "600", "--robot", NAME]);
        command.args(["--connect", &format!("tcp/127.0.0.1:{port}"), "--export"]);
        Running::start(command.arg(folder.path().join(name)), name)
    };
    let (watching, frozen) = (console("watching"), console("frozen"));
    sleep(Duration::from_secs(5));
    frozen.signal("STOP");

    let (idle, load) = (Monotonic::now(), robot.edge.processor_s());
    sleep(Duration::from_secs(20));
    let load = (robot.edge.processor_s() - load) / idle.elapsed().as_secs_f64();
    anna.sets_off(PRESSED.0);
    let driven = Monotonic::now();
    press_and_let_go(&mut anna);
    let (log, over) = (robot.log(), Monotonic::now());
    println!(
        "{world}: the edge takes {:.0} % of a core, all its threads",
        100.0 * load
    );
    tell_latencies(world, &log, &anna.journal);
    tell_lateness(&format!("{world}, nobody drives"), &log, idle, driven);
    tell_lateness(&format!("{world}, somebody drives"), &log, driven, over);
    let status = anna.sees_anew();
    println!(
        "{world}: {} involuntary stops",
        status.counters.involuntary_stops
    );
    drop((watching, frozen));
}

#[test]
#[ignore = "five minutes: measures"]
fn from_key_to_motors_and_jitter_on_this_machine() {
    for world in ["rooms", "yard", "meadow"] {
        measure_locally(world);
    }
}
