//! The two programs, started as users start them.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::{panicking, sleep};
use std::time::Duration;

use foreshore_tests::rig::free_pair;
use network::clock;
use recording::{Selection, open};
use zenoh::{Config, Session, Wait as _};

use crate::skip::skip;

/// Longer than any step takes.
const TIMEOUT: Duration = Duration::from_mins(2);

/// The options of a simulated robot that serves in real time until it is ended.
pub(crate) const SERVED: &str = "--rate 1 --keep-serving --quiet";

/// The project's own recording: the simulated world `rooms`, 116 s.
pub(crate) fn rooms() -> String {
    concat!(env!("CARGO_MANIFEST_DIR"), "/../recordings/rooms.mcap").to_owned()
}

/// The path of a program of this workspace; Cargo builds it beside this test binary.
pub(crate) fn program(name: &str) -> PathBuf {
    let tests = std::env::current_exe().unwrap();
    let path = tests.ancestors().nth(2).unwrap().join(name);
    assert!(
        path.exists(),
        "{}: not built; `cargo test --workspace` builds it, `cargo test -p` may not",
        path.display()
    );
    path
}

/// A command line of a program of this workspace, split at blanks.
pub(crate) fn command(line: &str) -> Command {
    let mut words = line.split_whitespace();
    let mut command = Command::new(program(words.next().unwrap()));
    command.args(words);
    command.env_remove("RUST_LOG").env_remove("ZENOH_CONFIG");
    command
}

pub(crate) fn start(line: &str) -> Running {
    Running::start(&mut command(line), line)
}

/// A simulated robot `scout` in `rooms`, in real time.
pub(crate) fn simulate(options: &str) -> Running {
    start(&format!(
        "robot-edge simulate rooms {SERVED} --robot scout {options}"
    ))
}

/// The router of Zenoh, without multicast; `None`, and a skipped test, where it is not installed.
#[track_caller]
pub(crate) fn zenohd(options: &[&str]) -> Option<Running> {
    let mut command = Command::new("zenohd");
    command.env("RUST_LOG", "error");
    // docs/deployment.md
    command.env("MALLOC_ARENA_MAX", "1");
    command.arg("--no-multicast-scouting").args(options);
    let is_there = Command::new("zenohd").arg("--version").output();
    if !is_there.is_ok_and(|output| output.status.success()) {
        skip("there is no zenohd", "cargo install zenohd");
        return None;
    }
    Some(Running::start(&mut command, "zenohd"))
}

/// A free control port; the next port is free too.
pub(crate) fn free_port() -> u16 {
    free_pair().unwrap()
}

/// The endpoint of a port of this machine, without keys.
pub(crate) fn tcp(port: u16) -> String {
    format!("tcp/127.0.0.1:{port}")
}

/// The endpoint of a free port.
pub(crate) fn free_endpoint() -> String {
    tcp(free_port())
}

/// A process, killed at the end of its test.
pub(crate) struct Running {
    child: Child,
    name: String,
}

impl Running {
    pub(crate) fn start(command: &mut Command, name: &str) -> Self {
        let child = command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        Self {
            child,
            name: name.to_owned(),
        }
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    pub(crate) fn signal(&self, signal: &str) {
        let sent = Command::new("kill")
            .args([&format!("-{signal}"), &self.child.id().to_string()])
            .status()
            .unwrap();
        assert!(sent.success(), "{}: {signal}", self.name);
    }

    fn proc(&self, file: &str) -> String {
        fs::read_to_string(format!("/proc/{}/{file}", self.child.id())).unwrap()
    }

    /// Resident memory, bytes.
    pub(crate) fn memory(&self) -> u64 {
        let status = self.proc("status");
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let kib = line.unwrap().split_whitespace().next().unwrap();
        kib.parse::<u64>().unwrap() * 1024
    }

    /// Processor time so far, seconds.
    pub(crate) fn processor_s(&self) -> f64 {
        let stat = self.proc("stat");
        // utime and stime, in hundredths of a second; the name in parentheses before them is arbitrary.
        let fields = stat.rsplit(')').next().unwrap().split_whitespace();
        let ticks = fields.skip(11).take(2).map(str::parse::<f64>);
        ticks.map(Result::unwrap).sum::<f64>() / 100.0
    }

    /// Processor time during `measured`, per cent of a core.
    pub(crate) fn load(&self, measured: Duration) -> f64 {
        let (before_s, started) = (self.processor_s(), clock::now());
        sleep(measured);
        100.0 * (self.processor_s() - before_s) / clock::elapsed(started).as_secs_f64()
    }

    pub(crate) fn has_loaded(&self, library: &str) -> bool {
        self.proc("maps").contains(library)
    }

    pub(crate) fn is_running(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }

    /// Reads standard output up to a line that contains `words`; returns the line.
    pub(crate) fn wait_for_output(&mut self, words: &str) -> String {
        let mut printed = BufReader::new(self.child.stdout.as_mut().unwrap());
        loop {
            let mut line = String::new();
            let bytes = printed.read_line(&mut line).unwrap();
            assert!(bytes > 0, "{} ended before {words:?}", self.name);
            if line.contains(words) {
                return line;
            }
        }
    }

    /// Waits for the end; returns exit code and output, standard output first.
    pub(crate) fn end(mut self) -> (Option<i32>, String) {
        wait_until(&format!("{} ends", self.name), || !self.is_running());
        let mut printed = String::new();
        let mut out = self.child.stdout.take().unwrap();
        out.read_to_string(&mut printed).unwrap();
        let mut err = self.child.stderr.take().unwrap();
        err.read_to_string(&mut printed).unwrap();
        (self.child.wait().unwrap().code(), printed)
    }

    /// Waits for the end, which must be with this exit code.
    pub(crate) fn ends_with(self, expected: i32) -> String {
        let name = self.name.clone();
        let (code, printed) = self.end();
        assert_eq!(code, Some(expected), "{name}: {printed}");
        printed
    }

    /// Waits for the end, which must be without an error.
    pub(crate) fn ends_well(self) -> String {
        self.ends_with(0)
    }

    /// Interrupts it; it must end without an error.
    pub(crate) fn interrupt(self) -> String {
        self.signal("INT");
        self.ends_well()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended already.
        drop(self.child.kill());
        drop(self.child.wait());
        if panicking()
            && let Some(err) = &mut self.child.stderr
        {
            let mut printed = String::new();
            drop(err.read_to_string(&mut printed));
            println!("{}: {printed}", self.name);
        }
    }
}

/// A Zenoh session without discovery: a router listens at `endpoint`, a client connects to it and tries again.
pub(crate) fn zenoh_session(mode: &str, endpoint: &str) -> Session {
    let side = if mode == "router" {
        "listen"
    } else {
        "connect"
    };
    let mut config = Config::default();
    for (key, value) in [
        ("mode", format!("{mode:?}")),
        (&format!("{side}/endpoints"), format!("[{endpoint:?}]")),
        ("scouting/multicast/enabled", "false".to_owned()),
    ] {
        config.insert_json5(key, &value).unwrap();
    }
    let mut session = None;
    wait_until(endpoint, || {
        session = zenoh::open(config.clone()).wait().ok();
        session.is_some()
    });
    session.unwrap()
}

/// Waits until `is_so`; returns how long it took.
#[track_caller]
pub(crate) fn wait_until(what: &str, mut is_so: impl FnMut() -> bool) -> Duration {
    let started = clock::now();
    while !is_so() {
        assert!(clock::elapsed(started) < TIMEOUT, "timed out: {what}");
        sleep(Duration::from_millis(5));
    }
    clock::elapsed(started)
}

pub(crate) fn measurements_in(recording: &Path) -> usize {
    let mut reader = open(recording, Selection::All).unwrap();
    std::iter::from_fn(|| reader.next_measurement().unwrap()).count()
}

/// Panics unless both folders have the same files, byte for byte, in this number.
#[track_caller]
pub(crate) fn assert_same_files(edge: &Path, console: &Path, files: usize) {
    let mut compared = 0;
    for entry in fs::read_dir(edge).unwrap() {
        let name = entry.unwrap().file_name();
        let [edge, console] = [edge, console].map(|folder| fs::read(folder.join(&name)).unwrap());
        let name = name.display();
        assert!(edge == console, "{name}: edge and console differ");
        compared += 1;
    }
    assert_eq!(compared, files);
}

/// As [`assert_same_files`], for `occupancy.tif`, `.png`, `.pgm` and `.yaml`, and `trajectory.tum` and `.geojson`.
#[track_caller]
pub(crate) fn assert_same_maps(edge: &Path, console: &Path) {
    assert_same_files(edge, console, 6);
}
