//! Latency benchmarks on the shaped link while tiles use their whole budget: each test prints rows of a table
//! and fails, except for TCP, if a figure is far off. Needs an idle machine and root.

use std::path::Path;
use std::process::Command;
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::operator::{Input, Journal};
use foreshore_tests::rig::tun::{Namespaces, Side};
use foreshore_tests::rig::{Conditions, Line};
use robot_edge::clock;
use tempfile::tempdir;

use super::figures::{LET_GO, PRESSED, at, latencies};
use super::robot::{NAME, Robot};
use crate::fleet::Fleet;
use crate::link::processes::{Running, program};
use crate::rig::namespaces;

const MEASURED: Duration = Duration::from_mins(2);

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

/// Protocols and keys.
enum Transport {
    /// Commands and tiles over TCP, without keys.
    Open,
    /// Commands over QUIC, tiles over TLS, with keys.
    Secured(Fleet),
}

impl Transport {
    fn endpoint(&self) -> String {
        let scheme = match self {
            Self::Open => "tcp",
            Self::Secured(_) => "quic",
        };
        format!("{scheme}/{}:7447", Side::A.address())
    }

    /// Options of the edge.
    fn listens(&self) -> Vec<String> {
        let listen = ["--listen".to_owned(), self.endpoint()];
        let trust = match self {
            Self::Open => vec!["--insecure".to_owned()],
            Self::Secured(fleet) => vec!["--keys".to_owned(), text(&fleet.vehicle())],
        };
        [&listen[..], &trust].concat()
    }

    /// Options of a console.
    fn connects(&self, name: &str) -> Vec<String> {
        let connect = ["--connect".to_owned(), self.endpoint()];
        let trust = match self {
            Self::Open => vec![],
            Self::Secured(fleet) => vec!["--keys".to_owned(), text(&fleet.person(name))],
        };
        [&connect[..], &trust].concat()
    }

    /// Arguments of `drive-by-wire` before the journal.
    fn operates(&self, name: &str) -> [String; 4] {
        let (verb, who) = match self {
            Self::Open => ("operate", name.to_owned()),
            Self::Secured(fleet) => ("operate-with-keys", text(&fleet.person(name))),
        };
        [verb.to_owned(), self.endpoint(), NAME.to_owned(), who]
    }
}

fn text(path: &Path) -> String {
    path.to_str().unwrap().to_owned()
}

/// Program `name` of this workspace inside a namespace.
fn inside(link: &Namespaces, side: Side, name: &str) -> Command {
    link.command(side, program(name).get_program())
}

/// A robot, a console that fetches all tiles, and an operator who presses and releases a key.
fn measure(link: &Namespaces, what: &str, transport: &Transport, world: &'static str) {
    link.set_both(Conditions::default()).unwrap();
    let edge = inside(link, Side::A, "robot-edge");
    let listens = transport.listens();
    let robot = Robot::launch(edge, 7447, world, move |command| {
        command.args(&listens);
    });
    link.set_both(shaped()).unwrap();
    let folder = tempdir().unwrap();
    let mut console = inside(link, Side::B, "operator-console");
    console.args(["--headless", "--for", "600", "--robot", NAME]);
    console.args(transport.connects("bert")).arg("--export");
    console.arg(folder.path().join("export"));
    let console = Running::start(&mut console, "console");
    let journal = folder.path().join("anna.csv");
    let mut operate = inside(link, Side::B, "drive-by-wire");
    operate.args(transport.operates("anna")).arg(&journal);
    for (input, time) in [LET_GO, PRESSED] {
        let Input {
            linear_mps,
            angular_radps,
        } = input;
        let time_s = time.as_secs_f32();
        operate.arg(format!("{linear_mps},{angular_radps},{time_s}"));
    }
    let operator = Running::start(&mut operate, "anna");
    sleep(Duration::from_secs(10));
    let bytes = || Side::ALL.map(|side| link.traffic_from(side).sent.bytes);
    let (before, started) = (bytes(), clock::now());
    sleep(MEASURED);
    let (after, elapsed_s) = (bytes(), clock::elapsed(started).as_secs_f64());
    drop((operator, console));

    let log = robot.log();
    let journal = Journal::parse(&std::fs::read_to_string(&journal).unwrap()).unwrap();
    let what = format!("{what}, {world}");
    let (latencies, without_effect) = latencies(&format!("{what}, 75 ms one way"), &log, &journal);
    let stops = robot.verdict(&[&journal]).stops;
    let during = stops.iter().filter(|stop| stop.issued > started).count();
    let kbps = |side: usize| (after[side] - before[side]) as f64 * 8e-3 / elapsed_s;
    println!(
        "{what}: {:.2} involuntary stops a minute; {:.0} kbit/s towards the console, {:.0} kbit/s back",
        during as f64 * 60.0 / elapsed_s,
        kbps(0),
        kbps(1)
    );
    // Over TCP a loss delays all later commands, so limits hold for QUIC only.
    if matches!(transport, Transport::Secured(_)) {
        assert!(during as f64 <= elapsed_s / 60.0, "{during} stops");
        assert!(without_effect <= 1, "{without_effect} presses");
        assert!(at(&latencies, 0.99) <= Duration::from_millis(150));
    }
}

#[test]
#[ignore = "five minutes, needs root: measures"]
fn from_key_to_motors_over_quic_on_the_shaped_link() {
    let Some(link) = namespaces(3) else { return };
    let transport = Transport::Secured(Fleet::reached_at(Side::A.address().into()));
    for world in ["rooms", "meadow"] {
        measure(&link, "quic and keys", &transport, world);
    }
}

#[test]
#[ignore = "five minutes, needs root: measures"]
fn from_key_to_motors_over_tcp_on_the_shaped_link() {
    let Some(link) = namespaces(3) else { return };
    for world in ["rooms", "meadow"] {
        measure(&link, "tcp", &Transport::Open, world);
    }
}
