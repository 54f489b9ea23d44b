//! A folder with keys, made by `robot-edge keys`.

use std::fs;
use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::process::Output;

use network::credentials::Credentials;
use network::sessions::Endpoints;
use tempfile::TempDir;
use zenoh::{Config, Session, Wait as _};

use crate::processes::{command, wait_until};

/// A fleet whose folder is removed at the end of the test.
pub(crate) struct Fleet {
    folder: TempDir,
}

impl Fleet {
    /// A vehicle `scout` with an operator, another, a supervisor and an observer.
    pub(crate) fn new() -> Self {
        Self::with("")
    }

    /// The same, with this address of the vehicle.
    pub(crate) fn reached_at(host: IpAddr) -> Self {
        Self::with(&format!("--host {host}"))
    }

    /// The same, with further options of `robot-edge keys`.
    pub(crate) fn with(options: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let fleet = Self { folder };
        let people = "--operator anna --operator bert --supervisor sam --observer tv";
        let made = fleet.keys(&format!("--robot scout {people} {options}"));
        assert!(made.status.success(), "{made:?}");
        fleet
    }

    /// `robot-edge keys` in this folder.
    pub(crate) fn keys(&self, options: &str) -> Output {
        let line = format!("robot-edge keys {} {options}", self.root().display());
        command(&line).output().unwrap()
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

    /// The options of a console with a person's keys.
    pub(crate) fn console(&self, name: &str, endpoint: &str) -> String {
        let keys = self.person(name);
        format!("--connect {endpoint} --keys {}", keys.display())
    }

    /// The options of an edge with the vehicle's keys; `how` is `--listen` or `--connect`.
    pub(crate) fn edge(&self, how: &str, endpoint: &str) -> String {
        format!("{how} {endpoint} --keys {}", self.vehicle().display())
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

    /// The generated configuration of a router; only the addresses are changed.
    pub(crate) fn router_config(&self, port: u16) -> PathBuf {
        let made = self.keys("--router 127.0.0.1");
        assert!(made.status.success(), "{made:?}");
        let generated = text(self.root().join("router/router.json5"));
        let here = generated
            .replace("[::]:7447", &format!("127.0.0.1:{port}"))
            .replace("[::]:7448", &format!("127.0.0.1:{}", port + 1));
        let path = self.scratch("router.json5");
        fs::write(&path, here).unwrap();
        path
    }

    /// Starts a router, as `zenohd -c router.json5`.
    pub(crate) fn router(&self, port: u16) -> Session {
        let path = self.router_config(port);
        // The port of an earlier router may not be free yet.
        let mut session = None;
        wait_until("a router", || {
            session = zenoh::open(Config::from_file(&path).unwrap()).wait().ok();
            session.is_some()
        });
        session.unwrap()
    }
}

/// The QUIC endpoint of a port of this machine.
pub(crate) fn quic(port: u16) -> String {
    format!("quic/127.0.0.1:{port}")
}

pub(crate) fn text(path: impl AsRef<Path>) -> String {
    fs::read_to_string(path).unwrap()
}
