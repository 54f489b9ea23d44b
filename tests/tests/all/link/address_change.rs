//! A robot that comes back at another address is found there, and shown again.

use std::thread::sleep;
use std::time::Duration;

use operator_console::link::{Discovery, FoundRobot};
use robot_edge::clock;
use tempfile::tempdir;

use super::controls::Controls;
use super::processes::{Running, free_port, program};
use super::screen::{Key, Screen, skip_without_window};
use super::telemetry::{TIMEOUT, Telemetry};

const ROBOT: &str = "mover";

/// A place on this machine where a robot may be.
fn free_endpoint() -> String {
    format!("tcp/127.0.0.1:{}", free_port())
}

fn robot_at(endpoint: &str) -> Running {
    let mut command = program("robot-edge");
    command.args([
        "simulate",
        "rooms",
        "--rate",
        "1",
        "--keep-serving",
        "--quiet",
    ]);
    command.args(["--robot", ROBOT, "--listen", endpoint]);
    Running::start(&mut command, "edge")
}

/// It ends without a word, as a vehicle whose battery is taken out.
fn kill(robot: Running) {
    robot.signal("KILL");
    drop(robot);
}

fn wait_until(what: &str, mut is_so: impl FnMut() -> bool) {
    let started = clock::now();
    while !is_so() {
        assert!(clock::elapsed(started) < TIMEOUT, "not {what}");
        sleep(Duration::from_millis(10));
    }
}

#[test]
fn a_robot_is_found_where_it_answers_now_and_a_forgotten_address_is_told_of_no_more() {
    let [old, new] = [free_endpoint(), free_endpoint()];
    let first = robot_at(&old);
    let discovery = Discovery::start(vec![old.clone()], false, None, None, || {});
    let is_at = |endpoint: &str| {
        let found = FoundRobot {
            robot: ROBOT.parse().unwrap(),
            endpoint: endpoint.to_owned(),
        };
        discovery.found() == [found]
    };
    wait_until("found", || is_at(&old));
    kill(first);
    let _second = robot_at(&new);
    // Whoever types an address is not kept waiting for the next round; where no answer there yet, it is typed again.
    wait_until("found where it is now", || {
        discovery.add_address(new.clone());
        is_at(&new)
    });
    let nobody = format!("no answer at {old}; trying again");
    wait_until("told", || discovery.complaints().as_ref() == Some(&nobody));

    discovery.forget_address(&old);
    assert_eq!(discovery.complaints(), None);
    assert!(!discovery.asks(&old) && discovery.asks(&new));
    // A round that asked it may have been under way.
    let seen = discovery.discovered_robots()[0].seen;
    wait_until("asked again", || {
        discovery.add_address(new.clone());
        assert_eq!(discovery.complaints(), None);
        discovery.discovered_robots()[0].seen > seen + Duration::from_secs(2)
    });
}

#[test]
fn the_window_follows_a_robot_to_another_address_with_a_stop_that_is_on_its_way() {
    let Some(screen) = Screen::open() else {
        return;
    };
    let [old, new] = [free_endpoint(), free_endpoint()];
    let first = robot_at(&old);
    let folder = tempdir().unwrap();
    let controls = Controls(folder.path().join("controls"));
    let mut command = program("operator-console");
    screen.show(&mut command);
    command.arg("--config").arg(folder.path().join("a.json"));
    command.arg("--controls").arg(&controls.0);
    command.args(["--operator", "anna", "--robot", ROBOT, "--connect", &old]);
    let mut console = Running::start(&mut command, "the window");
    let Some(window) = screen.window("Foreshore", || !console.is_running()) else {
        let (_, said) = console.end();
        skip_without_window(&said);
        return;
    };
    screen.focus(window);
    controls.beginning("Live");
    controls.beginning("Synchronized");

    kill(first);
    controls.beginning("Silent");
    screen.tap(Key::Space);
    let _second = robot_at(&new);
    let telemetry = Telemetry::of(ROBOT, &new);
    telemetry.wait_for_status("free", |status| status.estop.is_none());
    screen.tap_with(Key::Control, Key::L);
    screen.write(&new);
    screen.tap(Key::Enter);
    controls.beginning("Live");
    controls.beginning("Synchronized");
    telemetry.wait_for_status("stopped", |status| status.estop.is_some());
    screen.close(window);
    console.ends_well();
}
