//! An unlisted operator is refused with the reason, and gets access as soon as the list has the name.

use std::fs;
use std::thread::sleep;
use std::time::Duration;

use operator_console::link::{AddressState, Discovery};
use robot_edge::clock;
use robot_edge::credentials::Credentials;
use zenoh::Wait as _;

use super::matrix;
use crate::fleet::{Fleet, text};
use crate::link::processes::{Running, free_port, program, simulate};

const TIMEOUT: Duration = Duration::from_mins(1);

fn robot(fleet: &Fleet, endpoint: &str) -> Running {
    let mut command = simulate(&["--listen", endpoint, "--keys"]);
    Running::start(command.arg(fleet.vehicle()), "edge")
}

/// Waits until discovery at `endpoint` with Carl's keys gives the expected state.
fn wait_until(fleet: &Fleet, endpoint: &str, is_expected: impl Fn(&AddressState) -> bool) {
    let keys = Credentials::open(&fleet.person("carl")).unwrap();
    let asked = vec![endpoint.to_owned()];
    let discovery = Discovery::start(asked, false, None, Some(keys), || {});
    let started = clock::now();
    while !is_expected(&discovery.asked()[endpoint]) {
        assert!(clock::elapsed(started) < TIMEOUT, "{:?}", discovery.asked());
        sleep(Duration::from_millis(10));
    }
}

#[test]
fn an_unlisted_operator_gets_access_once_listed() {
    let (fleet, port) = (Fleet::new(), free_port());
    let endpoint = format!("quic/127.0.0.1:{port}");
    let list = fleet.vehicle().join("operators.toml");
    let without_carl = text(&list);
    let added = fleet.keys(&["--robot", "scout", "--operator", "carl"]);
    let printed = String::from_utf8(added.stdout).unwrap();
    let what_to_do = "the vehicle lets them in once it has this, by `robot-edge install-keys`";
    assert!(printed.contains(what_to_do), "{printed}");
    let with_carl = text(&list);
    fs::write(&list, &without_carl).unwrap();
    let edge = robot(&fleet, &endpoint);
    matrix::person(&fleet, "anna", port).close().wait().unwrap();

    wait_until(
        &fleet,
        &endpoint,
        |state| matches!(state, AddressState::AccessDenied { robot, .. } if robot.as_str() == "scout"),
    );
    let mut console = program("operator-console");
    console.args(["--headless", "--timeout", "8", "--robot", "scout"]);
    console.args(["--connect", &endpoint, "--keys"]);
    console.arg(fleet.person("carl"));
    console.arg("--export").arg(fleet.scratch("maps"));
    let (code, printed) = Running::start(&mut console, "console").end();
    assert_eq!(code, Some(1), "{printed}");
    let first = format!("looking for robot scout at {endpoint}\n");
    assert!(printed.starts_with(&first), "{printed}");
    let why = format!("scout answers at {endpoint} but denies access: you are not on");
    // During the wait and at the end.
    assert_eq!(printed.matches(&why).count(), 2, "{printed}");
    assert!(!printed.contains("no answer"), "{printed}");

    let written = clock::now();
    fs::write(&list, &with_carl).unwrap();
    wait_until(&fleet, &endpoint, |state| *state == AddressState::Found);
    println!(
        "found {:.1} s after the list was written",
        clock::elapsed(written).as_secs_f64()
    );
    edge.signal("INT");
    edge.ends_well();
}
