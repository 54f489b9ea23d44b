//! A robot that restarts at another address is found and shown again.

use std::time::Duration;

use operator_console::link::{Discovery, FoundRobot};
use tempfile::tempdir;

use super::controls::Controls;
use super::processes::{Running, free_port, program, simulate, wait_until};
use super::screen::{Key, Screen};
use super::telemetry::Telemetry;

const ROBOT: &str = "mover";

fn free_endpoint() -> String {
    format!("tcp/127.0.0.1:{}", free_port())
}

fn robot_at(endpoint: &str) -> Running {
    let mut command = simulate(&["--robot", ROBOT, "--listen", endpoint]);
    Running::start(&mut command, "edge")
}

/// Ends it without a farewell, as a power failure does.
fn kill(robot: Running) {
    robot.signal("KILL");
    drop(robot);
}

#[test]
fn a_robot_is_found_at_its_new_address() {
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
    // A typed address is asked at once; it is typed again until the robot answers.
    wait_until("found where it is now", || {
        discovery.add_address(new.clone());
        is_at(&new)
    });
    let complaint = format!("no answer at {old}; trying again");
    wait_until("a complaint", || {
        discovery.complaints().as_ref() == Some(&complaint)
    });

    discovery.forget_address(&old);
    assert_eq!(discovery.complaints(), None);
    assert!(!discovery.asks(&old) && discovery.asks(&new));
    // A request to it may still have been under way.
    let seen = discovery.discovered_robots()[0].seen;
    wait_until("asked again", || {
        discovery.add_address(new.clone());
        assert_eq!(discovery.complaints(), None);
        discovery.discovered_robots()[0].seen > seen + Duration::from_secs(2)
    });
}

#[test]
fn a_pending_emergency_stop_reaches_the_new_address() {
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
    let Some((console, window)) = screen.open_console(&mut command) else {
        return;
    };
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
