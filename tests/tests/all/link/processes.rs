//! The two programs as their users start them.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use foreshore_tests::rig::ports::free_pair;
use robot_edge::clock;

/// Nothing that these tests wait for takes longer.
const TIMEOUT: Duration = Duration::from_mins(2);

/// The project's own recording: the simulated world `rooms`, 116 s.
pub(crate) fn rooms() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../recordings/rooms.mcap")
}

/// A program of this workspace. Cargo has built it, for its own package's tests, beside this one.
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

/// A control port of this machine that is free, and the next one too.
pub(crate) fn free_port() -> u16 {
    free_pair().unwrap()
}

/// A process that does not outlive its test.
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
        // utime and stime, in hundredths; the name in parentheses before them may hold anything.
        let fields: Vec<_> = stat
            .rsplit(')')
            .next()
            .unwrap()
            .split_whitespace()
            .collect();
        let ticks = [11, 12].map(|field| fields[field].parse::<f64>().unwrap());
        (ticks[0] + ticks[1]) / 100.0
    }

    /// Processor time over the wall time in which it was used, per cent of a core.
    pub(crate) fn load(&self, measured: Duration) -> f64 {
        let (before_s, started) = (self.processor_s(), clock::now());
        std::thread::sleep(measured);
        100.0 * (self.processor_s() - before_s) / clock::elapsed(started).as_secs_f64()
    }

    /// Whether a library of that name is loaded into it.
    pub(crate) fn has_loaded(&self, library: &str) -> bool {
        let maps = fs::read_to_string(format!("/proc/{}/maps", self.child.id())).unwrap();
        maps.contains(library)
    }

    pub(crate) fn is_running(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }

    /// Reads standard output up to the line that holds `words`, which is returned.
    pub(crate) fn wait_for_output(&mut self, words: &str) -> String {
        let mut said = BufReader::new(self.child.stdout.as_mut().unwrap());
        loop {
            let mut line = String::new();
            let bytes = said.read_line(&mut line).unwrap();
            assert!(bytes > 0, "{} ended before it said {words:?}", self.name);
            if line.contains(words) {
                return line;
            }
        }
    }

    /// Waits for the end; what it said, standard output first.
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
            std::thread::sleep(Duration::from_millis(20));
        };
        let mut said = String::new();
        self.child
            .stdout
            .take()
            .unwrap()
            .read_to_string(&mut said)
            .unwrap();
        self.child
            .stderr
            .take()
            .unwrap()
            .read_to_string(&mut said)
            .unwrap();
        (code, said)
    }

    /// Waits for the end, which must be a good one.
    pub(crate) fn ends_well(self) -> String {
        let name = self.name.clone();
        let (code, said) = self.end();
        assert_eq!(code, Some(0), "{name}: {said}");
        said
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may be stopped, and have ended long ago.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// `robot-edge replay rooms`, which stays when the recording ends.
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

/// A headless console that watches until the data ends, then exports.
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

/// Fails unless both folders hold the same maps, byte for byte.
pub(crate) fn assert_same_maps(edge: &Path, console: &Path) {
    // occupancy.tif, .png, .pgm and .yaml, and trajectory.tum
    assert_same_files(edge, console, 5);
}

/// The same of any layers, which have so many files.
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
