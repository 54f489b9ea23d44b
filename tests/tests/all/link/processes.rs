//! The two programs, started as users start them.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU8, Ordering};
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::rig::ports::free_pair;
use operator_console::link::RobotSession;
use operator_console::model::ModelSettings;
use protocol::layer::LayerId;
use protocol::tile::BootId;
use robot_edge::clock;
use robot_edge::network::sessions::Endpoints;
use zenoh::{Config, Session, Wait as _};

/// Longer than any step takes.
const TIMEOUT: Duration = Duration::from_mins(2);

/// The project's own recording: the simulated world `rooms`, 116 s.
pub(crate) fn rooms() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../recordings/rooms.mcap")
}

/// A program of this workspace; Cargo builds it beside this test binary.
pub(crate) fn program(name: &str) -> Command {
    let tests = std::env::current_exe().unwrap();
    let path = tests.ancestors().nth(2).unwrap().join(name);
    assert!(
        path.exists(),
        "{}: not built; `cargo test --workspace` builds it, `cargo test -p` may not",
        path.display()
    );
    let mut command = Command::new(path);
    command.env_remove("RUST_LOG").env_remove("ZENOH_CONFIG");
    command
}

/// A free control port; the next port is free too.
pub(crate) fn free_port() -> u16 {
    free_pair().unwrap()
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

    /// Resident memory, bytes.
    pub(crate) fn memory(&self) -> u64 {
        let status = fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = status
            .lines()
            .find(|line| line.starts_with("VmRSS:"))
            .unwrap();
        line.split_whitespace()
            .nth(1)
            .unwrap()
            .parse::<u64>()
            .unwrap()
            * 1024
    }

    /// Processor time so far, seconds.
    pub(crate) fn processor_s(&self) -> f64 {
        let stat = fs::read_to_string(format!("/proc/{}/stat", self.child.id())).unwrap();
        // utime and stime, in hundredths of a second; the name in parentheses before them is arbitrary.
        let fields: Vec<_> = stat
            .rsplit(')')
            .next()
            .unwrap()
            .split_whitespace()
            .collect();
        let ticks = [11, 12].map(|field| fields[field].parse::<f64>().unwrap());
        (ticks[0] + ticks[1]) / 100.0
    }

    /// Processor time during `measured`, per cent of a core.
    pub(crate) fn load(&self, measured: Duration) -> f64 {
        let (before_s, started) = (self.processor_s(), clock::now());
        sleep(measured);
        100.0 * (self.processor_s() - before_s) / clock::elapsed(started).as_secs_f64()
    }

    /// Whether this library is loaded.
    pub(crate) fn has_loaded(&self, library: &str) -> bool {
        let maps = fs::read_to_string(format!("/proc/{}/maps", self.child.id())).unwrap();
        maps.contains(library)
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
        let started = clock::now();
        let code = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status.code();
            }
            assert!(
                clock::elapsed(started) < TIMEOUT,
                "{} does not end",
                self.name
            );
            sleep(Duration::from_millis(20));
        };
        let mut printed = String::new();
        self.child
            .stdout
            .take()
            .unwrap()
            .read_to_string(&mut printed)
            .unwrap();
        self.child
            .stderr
            .take()
            .unwrap()
            .read_to_string(&mut printed)
            .unwrap();
        (code, printed)
    }

    /// Waits for the end, which must be without an error.
    pub(crate) fn ends_well(self) -> String {
        let name = self.name.clone();
        let (code, printed) = self.end();
        assert_eq!(code, Some(0), "{name}: {printed}");
        printed
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended already.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// `robot-edge simulate rooms` in real time, which serves until it is ended.
pub(crate) fn simulate(arguments: &[&str]) -> Command {
    let mut command = program("robot-edge");
    command
        .args(["simulate", "rooms", "--rate", "1"])
        .args(["--keep-serving", "--quiet"])
        .args(arguments);
    command
}

/// A Zenoh session without discovery: a router listens at `endpoint`, a client connects to it and tries again.
pub(crate) fn zenoh_session(mode: &str, endpoint: &str) -> Session {
    let side = if mode == "router" {
        "listen"
    } else {
        "connect"
    };
    let endpoints = format!("{side}/endpoints");
    let started = clock::now();
    loop {
        let mut config = Config::default();
        for (key, value) in [
            ("mode", format!("{mode:?}")),
            (endpoints.as_str(), format!("[{endpoint:?}]")),
            ("scouting/multicast/enabled", "false".to_owned()),
        ] {
            config.insert_json5(key, &value).unwrap();
        }
        match zenoh::open(config).wait() {
            Ok(session) => return session,
            Err(err) => assert!(clock::elapsed(started) < TIMEOUT, "{err}"),
        }
        sleep(Duration::from_millis(50));
    }
}

/// The session of a console's window with robot `scout`, which shows these layers.
pub(crate) fn open_session(
    endpoints: &Endpoints,
    layers: &[LayerId],
    wake: impl Fn() + Send + 'static,
) -> RobotSession {
    static OPENED: AtomicU8 = AtomicU8::new(1);
    let settings = ModelSettings {
        robot: "scout".parse().unwrap(),
        session: BootId([OPENED.fetch_add(1, Ordering::Relaxed); 16]),
        tile_store_mb: 64,
        layers: layers.iter().copied().collect(),
    };
    RobotSession::open(settings, endpoints, wake).unwrap()
}

/// The endpoints of a console that connects without keys.
pub(crate) fn connect_to(endpoint: String) -> Endpoints {
    Endpoints {
        connect: vec![endpoint],
        ..Endpoints::default()
    }
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

/// `robot-edge replay rooms`, which serves after the recording has ended.
pub(crate) fn edge(port: u16, robot: &str, rate: &str, export: &Path) -> Running {
    let mut command = program("robot-edge");
    command
        .arg("replay")
        .arg(rooms())
        .args(["--rate", rate, "--keep-serving", "--robot", robot]);
    command
        .args(["--listen", &format!("tcp/127.0.0.1:{port}"), "--export"])
        .arg(export);
    Running::start(&mut command, &format!("edge {robot}"))
}

/// A headless console that exports when the data ends.
pub(crate) fn console(port: u16, robot: &str, export: &Path) -> Running {
    let mut command = program("operator-console");
    command.args([
        "--headless",
        "--for",
        "100",
        "--connect",
        &format!("tcp/127.0.0.1:{port}"),
    ]);
    command.args(["--robot", robot, "--export"]).arg(export);
    Running::start(
        &mut command,
        &format!("console of {robot} to {}", export.display()),
    )
}

/// Panics unless both folders have the same maps, byte for byte.
pub(crate) fn assert_same_maps(edge: &Path, console: &Path) {
    // occupancy.tif, .png, .pgm and .yaml, and trajectory.tum
    assert_same_files(edge, console, 5);
}

/// As [`assert_same_maps`], with this number of files.
pub(crate) fn assert_same_files(edge: &Path, console: &Path, files: usize) {
    let mut compared = 0;
    for entry in fs::read_dir(edge).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap();
        let [edge, console] = [&path, &console.join(name)].map(|path| fs::read(path).unwrap());
        assert!(
            edge == console,
            "{}: edge and console differ",
            name.display()
        );
        compared += 1;
    }
    assert_eq!(compared, files);
}
