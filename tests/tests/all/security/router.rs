//! A router, as `zenohd -c router.json5`.

use std::fs;
use std::thread::sleep;
use std::time::Duration;

use robot_edge::clock;
use zenoh::{Config, Session, Wait as _};

use crate::fleet::{Fleet, text};

const TIMEOUT: Duration = Duration::from_mins(1);

/// Starts a router with the generated file; only the addresses are changed.
pub(super) fn start(fleet: &Fleet, port: u16) -> Session {
    let made = fleet.keys(&["--router", "127.0.0.1"]);
    assert!(made.status.success(), "{made:?}");
    let generated = text(fleet.root().join("router/router.json5"));
    let here = generated
        .replace("[::]:7447", &format!("127.0.0.1:{port}"))
        .replace("[::]:7448", &format!("127.0.0.1:{}", port + 1));
    let path = fleet.scratch("router.json5");
    fs::write(&path, here).unwrap();
    // The port of an earlier router may not be free yet.
    let started = clock::now();
    loop {
        match zenoh::open(Config::from_file(&path).unwrap()).wait() {
            Ok(session) => return session,
            Err(why) => assert!(clock::elapsed(started) < TIMEOUT, "{why}"),
        }
        sleep(Duration::from_millis(100));
    }
}
