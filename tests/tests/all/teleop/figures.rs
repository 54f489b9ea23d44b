//! Latency benchmarks: each test prints rows of a table and fails if a figure is far off. Needs an idle machine.

use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::drive_log::{DriveLog, press_latencies};
use foreshore_tests::operator::{Input, Journal, Operator};
use robot_edge::clock;
use tempfile::tempdir;

use super::drive::Lateness;
use super::robot::{NAME, Robot};
use crate::link::processes::{Running, free_port, program};

/// Pressed and released in turn.
pub(super) const PRESSED: (Input, Duration) = (Input::of(0.1, 0.5), Duration::from_millis(600));
pub(super) const LET_GO: (Input, Duration) = (Input::NEUTRAL, Duration::from_millis(450));

const PRESSES: usize = 120;

/// Sorted times from a press to the first round that moves, and the number of presses without effect; prints them.
pub(super) fn latencies(what: &str, log: &DriveLog, journal: &Journal) -> (Vec<Duration>, usize) {
    let latencies = press_latencies(log, journal);
    let mut effective: Vec<_> = latencies.iter().copied().flatten().collect();
    effective.sort_unstable();
    let without_effect = latencies.len() - effective.len();
    println!(
        "{what}: key to motors, {} presses, {without_effect} without effect: p50 {:.1?}, p99 {:.1?}, most {:.1?}",
        latencies.len(),
        at(&effective, 0.5),
        at(&effective, 0.99),
        at(&effective, 1.0)
    );
    (effective, without_effect)
}

/// The quantile `share` of sorted times.
pub(super) fn at(times: &[Duration], share: f64) -> Duration {
    let last = times.len().checked_sub(1).expect("figures");
    times[(last as f64 * share).round() as usize]
}

fn press_and_let_go(operator: &mut Operator) {
    for _ in 0..PRESSES {
        operator.hold(LET_GO.0, LET_GO.1);
        operator.hold(PRESSED.0, PRESSED.1);
    }
}

/// A robot with all maps, a console that follows, a console that is stopped, and an operator.
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

    let (idle, load) = (clock::now(), robot.edge.processor_s());
    sleep(Duration::from_secs(20));
    let load = (robot.edge.processor_s() - load) / clock::elapsed(idle).as_secs_f64();
    anna.start_driving(PRESSED.0);
    let driven = clock::now();
    press_and_let_go(&mut anna);
    let (log, over) = (robot.log(), clock::now());
    println!(
        "{world}: the edge takes {:.0} % of a core, all its threads",
        100.0 * load
    );
    let (latencies, without_effect) = latencies(world, &log, &anna.journal);
    let nobody = Lateness::of(&format!("{world}, standing"), &log, (idle, driven));
    let somebody = Lateness::of(&format!("{world}, driving"), &log, (driven, over));
    let status = anna.wait_for_new_status();
    println!(
        "{world}: {} involuntary stops",
        status.counters.involuntary_stops
    );
    drop((watching, frozen));
    robot.verdict(&[&anna.journal]);
    // Twice the target.
    assert_eq!(without_effect, 0);
    assert!(at(&latencies, 0.99) <= Duration::from_millis(20));
    for late in [nobody, somebody] {
        assert!(late.at(0.99) <= Duration::from_millis(10));
    }
}

#[test]
#[ignore = "five minutes: measures"]
fn from_key_to_motors_and_jitter_on_this_machine() {
    for world in ["rooms", "yard", "meadow"] {
        measure_locally(world);
    }
}
