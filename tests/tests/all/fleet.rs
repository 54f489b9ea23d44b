//! A folder with keys, made by `robot-edge keys`.

use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::process::Output;

use robot_edge::credentials::Credentials;
use robot_edge::network::sessions::Endpoints;
use tempfile::TempDir;

use crate::link::processes::program;

/// A fleet whose folder is removed at the end of the test.
pub(crate) struct Fleet {
    folder: TempDir,
}

impl Fleet {
    /// A vehicle `scout` with an operator, another, a supervisor and an observer.
    pub(crate) fn new() -> Self {
        Self::with(&[])
    }

    /// The same, with this address of the vehicle.
    pub(crate) fn reached_at(host: IpAddr) -> Self {
        Self::with(&["--host", &host.to_string()])
    }

    fn with(options: &[&str]) -> Self {
        let fleet = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        let people = [
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
        ];
        let made = fleet.keys(&[&people[..], options].concat());
        assert!(made.status.success(), "{made:?}");
        fleet
    }

    /// `robot-edge keys` in this folder.
    pub(crate) fn keys(&self, arguments: &[&str]) -> Output {
        let mut command = program("robot-edge");
        command.arg("keys").arg(self.root()).args(arguments);
        command.output().unwrap()
    }

    pub(crate) fn root(&self) -> PathBuf {
        self.folder.path().join("fleet")
    }

    pub(crate) fn vehicle(&self) -> PathBuf {
        self.root().join("vehicles/scout")
    }

    pub(crate) fn person(&self, name: &str) -> PathBuf {
        self.root().join("people").join(name)
    }

    /// A console's endpoints: connects to `endpoint` with a person's keys.
    pub(crate) fn endpoints(&self, name: &str, endpoint: String) -> Endpoints {
        Endpoints {
            connect: vec![endpoint],
            credentials: Some(Credentials::open(&self.person(name)).unwrap()),
            ..Endpoints::default()
        }
    }

    pub(crate) fn scratch(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

pub(crate) fn text(path: impl AsRef<Path>) -> String {
    std::fs::read_to_string(path).unwrap()
}
