//! How fast it is: each test prints rows of a table, and asserts nothing on time. Needs the machine for itself.

use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::drive_log::{DriveLog, press_latencies};
use foreshore_tests::operator::{Input, Journal, Operator};
use foreshore_tests::rig::Line;
use foreshore_tests::rig::tun::{Conditions, Namespaces, Side};
use robot_edge::clock::Monotonic;
use tempfile::tempdir;

use super::robot::{NAME, Robot};
use crate::link::processes::{Running, free_port, program};

/// Pressed and let go, over and over.
const PRESSED: (Input, Duration) = (Input::of(0.1, 0.5), Duration::from_millis(600));
const LET_GO: (Input, Duration) = (Input::NEUTRAL, Duration::from_millis(450));

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

fn tell_latencies(what: &str, log: &DriveLog, journal: &Journal) {
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

/// 2 Mbit/s, 150 ms round trip, 2 % loss, 32 kB of queue.
fn shaped() -> Conditions {
    Conditions {
        line: Line {
            delay: Duration::from_millis(75),
            rate_bytes_per_s: Some(250_000),
            queue_bytes: 32_000,
        },
        loss: 0.02,
        ..Conditions::default()
    }
}

/// `name` of this workspace inside of a namespace, and its arguments.
fn inside(link: &Namespaces, side: Side, name: &str) -> std::process::Command {
    link.command(side, program(name).get_program())
}

#[test]
#[ignore = "five minutes, needs root: measures"]
fn from_key_to_motors_on_the_shaped_link() {
    let link = match Namespaces::create_seeded(3) {
        Ok(link) => link,
        Err(err) if err.is_for_lack_of_means() => {
            println!("skipped: {err}");
            return;
        }
        Err(err) => panic!("{err}"),
    };
    let endpoint = format!("tcp/{}:7447", Side::A.address());
    for world in ["rooms", "meadow"] {
        let listen = endpoint.clone();
        let edge = inside(&link, Side::A, "robot-edge");
        let robot = Robot::launch(edge, 7447, world, move |command| {
            command.args(["--insecure", "--listen", &listen]);
        });
        link.set_both(shaped()).unwrap();
        let folder = tempdir().unwrap();
        let mut console = inside(&link, Side::B, "operator-console");
        console.args(["--headless", "--for", "600", "--robot", NAME]);
        console.args(["--connect", &endpoint, "--export"]);
        console.arg(folder.path().join("export"));
        let console = Running::start(&mut console, "console");
        let journal = folder.path().join("anna.csv");
        let mut operate = inside(&link, Side::B, "drive-by-wire");
        operate
            .args(["operate", &endpoint, NAME, "anna"])
            .arg(&journal);
        for (input, time) in [LET_GO, PRESSED] {
            let Input {
                linear_mps,
                angular_radps,
            } = input;
            operate.arg(format!(
                "{linear_mps},{angular_radps},{}",
                time.as_secs_f32()
            ));
        }
        let operator = Running::start(&mut operate, "anna");
        sleep(Duration::from_secs(10));
        let bytes = || Side::ALL.map(|side| link.traffic_from(side).sent.bytes);
        let (before, started) = (bytes(), Monotonic::now());
        sleep(Duration::from_mins(2));
        let (after, elapsed_s) = (bytes(), started.elapsed().as_secs_f64());
        drop((operator, console));

        let log = robot.log();
        let journal = Journal::parse(&std::fs::read_to_string(&journal).unwrap()).unwrap();
        tell_latencies(&format!("{world}, 75 ms one way"), &log, &journal);
        let stops = robot.verdict(&[&journal]).stops;
        let during = stops.iter().filter(|stop| stop.issued > started).count();
        let kbps = |side: usize| (after[side] - before[side]) as f64 * 8e-3 / elapsed_s;
        println!(
            "{world}: {:.2} involuntary stops a minute; {:.0} kbit/s towards the console, {:.0} kbit/s back",
            during as f64 * 60.0 / elapsed_s,
            kbps(0),
            kbps(1)
        );
        drop(robot);
        sleep(Duration::from_secs(1));
    }
}
