//! A router as `zenohd -c router.json5` is one.

use std::fs;

use zenoh::{Config, Session, Wait as _};

use crate::fleet::{Fleet, text};

/// Starts a router with the generated file, of which only the addresses are changed.
pub(super) fn start(fleet: &Fleet, port: u16) -> Session {
    let made = fleet.keys(&["--router", "127.0.0.1"]);
    assert!(made.status.success(), "{made:?}");
    let generated = text(fleet.root().join("router/router.json5"));
    let here = generated
        .replace("[::]:7447", &format!("127.0.0.1:{port}"))
        .replace("[::]:7448", &format!("127.0.0.1:{}", port + 1));
    let path = fleet.scratch("router.json5");
    fs::write(&path, here).unwrap();
    zenoh::open(Config::from_file(path).unwrap())
        .wait()
        .unwrap()
}
