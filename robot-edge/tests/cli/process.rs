//! Runs the program and keeps what it said.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

/// The project's own recording: the simulated world `rooms`.
pub(crate) fn rooms() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../recordings/rooms.mcap")
}

/// The program with `words` as its arguments; paths are added with [`Command::arg`].
pub(crate) fn robot_edge(words: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_robot-edge"));
    let mut words = words.split_whitespace();
    let name = words.next();
    command.args(name);
    // Tests run side by side, and there is one default port.
    if matches!(name, Some("replay" | "simulate")) {
        command.arg("--no-network");
    }
    command
        .args(words)
        .env_remove("RUST_LOG")
        .env_remove("ZENOH_CONFIG");
    command
}

/// How a process ended.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl From<Output> for Ended {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }
}

impl Ended {
    /// Asserts a refusal: exit code `code`, nothing on standard output, and one line that holds all of
    /// `says`. (clap's messages are several lines.)
    #[track_caller]
    pub(crate) fn refuses(&self, code: i32, says: &[&str]) {
        assert_eq!(self.code, Some(code), "{self:#?}");
        assert_eq!(self.stdout, "");
        for part in says {
            assert!(
                self.stderr.contains(part),
                "no {part:?} in:\n{}",
                self.stderr
            );
        }
        let is_one_line =
            self.stderr.starts_with("robot-edge: ") && self.stderr.lines().count() == 1;
        assert!(
            is_one_line || self.stderr.starts_with("error: "),
            "{}",
            self.stderr
        );
    }

    /// Asserts exit code 0.
    #[track_caller]
    pub(crate) fn succeeds(self) -> Self {
        assert_eq!(self.code, Some(0), "{self:#?}");
        self
    }
}

/// Runs a command to its end.
#[track_caller]
pub(crate) fn run(command: &mut Command) -> Ended {
    command.output().unwrap().into()
}

/// The summary of a `replay` or `simulate` that has to succeed and, being told to be quiet, say nothing.
#[track_caller]
pub(crate) fn summary_of(command: &mut Command) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("summary.json");
    let ended = run(command.arg("--quiet").arg("--summary").arg(&path)).succeeds();
    assert_eq!((ended.stdout.as_str(), ended.stderr.as_str()), ("", ""));
    read_json(&path)
}

pub(crate) fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// The digest of the occupancy layer.
#[track_caller]
pub(crate) fn digest(summary: &Value) -> &str {
    let digest = summary["layers"]["occupancy"]["digest"].as_str().unwrap();
    assert_eq!(digest.len(), 64, "{digest}");
    digest
}

/// `events` of a summary as lines, kind first.
pub(crate) fn events(summary: &Value) -> Vec<String> {
    let events = summary["events"].as_array().unwrap().iter();
    events
        .map(|event| {
            format!(
                "{}: {}",
                event["kind"].as_str().unwrap(),
                event["message"].as_str().unwrap()
            )
        })
        .collect()
}
