//! A fleet's folder, made by the program itself.

use std::path::{Path, PathBuf};
use std::process::Output;

use tempfile::TempDir;

use crate::link::processes::program;

/// The folder of a fleet that lasts as long as a test.
pub(super) struct Fleet {
    folder: TempDir,
}

impl Fleet {
    /// A vehicle `scout` with an operator, another, a supervisor and an observer.
    pub(super) fn new() -> Self {
        let fleet = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        let made = fleet.keys(&[
            "--robot",
            "scout",
            "--operator",
            "anna",
            "--operator",
            "bert",
            "--supervisor",
            "sam",
            "--observer",
            "tv",
        ]);
        assert!(made.status.success(), "{made:?}");
        fleet
    }

    /// `robot-edge keys` in this folder.
    pub(super) fn keys(&self, arguments: &[&str]) -> Output {
        let mut command = program("robot-edge");
        command.arg("keys").arg(self.root()).args(arguments);
        command.output().unwrap()
    }

    pub(super) fn root(&self) -> PathBuf {
        self.folder.path().join("fleet")
    }

    pub(super) fn vehicle(&self) -> PathBuf {
        self.root().join("vehicles/scout")
    }

    pub(super) fn person(&self, name: &str) -> PathBuf {
        self.root().join("people").join(name)
    }

    pub(super) fn scratch(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

/// The text of a file.
pub(super) fn text(path: impl AsRef<Path>) -> String {
    std::fs::read_to_string(path).unwrap()
}
