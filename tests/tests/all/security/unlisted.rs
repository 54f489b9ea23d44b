//! Who is not on a vehicle's list is told so, and is let in as soon as they are, while it runs.

use std::fs;
use std::thread::sleep;
use std::time::Duration;

use operator_console::link::{AddressState, Discovery};
use robot_edge::clock;
use robot_edge::credentials::Credentials;
use zenoh::Wait as _;

use super::matrix;
use crate::fleet::{Fleet, text};
use crate::link::processes::{Running, free_port, program};

const TIMEOUT: Duration = Duration::from_mins(1);

fn robot(fleet: &Fleet, endpoint: &str) -> Running {
    let mut command = program("robot-edge");
    command.args([
        "simulate",
        "rooms",
        "--rate",
        "1",
        "--keep-serving",
        "--quiet",
    ]);
    command.args(["--listen", endpoint, "--keys"]);
    Running::start(command.arg(fleet.vehicle()), "edge")
}

/// What asking at `endpoint` with Carl's keys comes to, where that is what is expected.
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
fn who_is_not_on_the_list_is_told_so_and_is_let_in_without_a_restart_once_they_are() {
    let (fleet, port) = (Fleet::new(), free_port());
    let endpoint = format!("quic/127.0.0.1:{port}");
    let list = fleet.vehicle().join("operators.toml");
    let without_carl = text(&list);
    let added = fleet.keys(&["--robot", "scout", "--operator", "carl"]);
    let said = String::from_utf8(added.stdout).unwrap();
    let what_to_do = "the vehicle lets them in once it has this, by `robot-edge install-keys`";
    assert!(said.contains(what_to_do), "{said}");
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
    let (code, said) = Running::start(&mut console, "console").end();
    assert_eq!(code, Some(1), "{said}");
    let first = format!("looking for robot scout at {endpoint}\n");
    assert!(said.starts_with(&first), "{said}");
    let why = format!("scout answers at {endpoint} but denies access: you are not on");
    // While it is waited for, and at the end.
    assert_eq!(said.matches(&why).count(), 2, "{said}");
    assert!(!said.contains("no answer"), "{said}");

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
