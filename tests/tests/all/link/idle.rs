//! Processor load of a window that shows a standing robot. A benchmark.

use std::thread::sleep;
use std::time::Duration;

use protocol::message::TeleopState;
use tempfile::tempdir;

use super::controls::Controls;
use super::driver::take_lease;
use super::processes::{Running, free_port, program};
use super::screen::{Key, Screen};
use super::telemetry::Telemetry;

const MEASURED: Duration = Duration::from_secs(30);

#[test]
#[ignore = "two minutes: measures, and needs an idle machine"]
fn a_window_of_a_standing_robot_costs_little() {
    let Some(screen) = Screen::open() else { return };
    let port = free_port();
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let mut command = program("robot-edge");
    command.args([
        "simulate",
        "rooms",
        "--keep-serving",
        "--quiet",
        "--robot",
        "scout",
    ]);
    let _edge = Running::start(command.args(["--listen", &endpoint]), "edge");
    let telemetry = Telemetry::of("scout", &endpoint);
    let home = tempdir().unwrap();
    let controls = Controls(home.path().join("controls"));
    let console = || {
        let mut command = program("operator-console");
        screen.show(&mut command);
        command.args(["--robot", "scout", "--connect", &endpoint, "--config"]);
        command.arg(home.path().join("console.json"));
        command.args(["--operator", "anna"]);
        command
    };
    // Once with the accessibility tree, which costs more, to know what it shows.
    let named = Running::start(console().arg("--controls").arg(&controls.0), "the window");
    controls.beginning("Synchronized");
    screen.focus(screen.window("Foreshore", || false).unwrap());
    // The lease stops the simulated drive; the sensors continue.
    take_lease(&screen, &telemetry);
    screen.tap_with(Key::Control, Key::G);
    telemetry.wait_for_status("released and standing", |status| {
        status.lease.holder.is_none() && status.state == TeleopState::Idle
    });
    sleep(Duration::from_secs(5));
    let with_names = named.load(MEASURED);
    drop(named);
    let console = Running::start(&mut console(), "the window");
    sleep(Duration::from_secs(8));
    let alone = console.load(MEASURED);
    println!(
        "{alone:.1} % of a core; with every control's name written to a file {with_names:.1} %"
    );
}
