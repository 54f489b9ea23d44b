//! What a window costs that shows a robot which stands still. Measures.

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
#[ignore = "two minutes: measures, and wants the machine for itself"]
fn a_window_beside_a_robot_that_stands_costs_little() {
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
    // Once with what a screen reader would be told, which costs more, to know that it shows what it should.
    let named = Running::start(console().arg("--controls").arg(&controls.0), "the window");
    controls.beginning("Synchronized");
    screen.focus(screen.window("Foreshore", || false).unwrap());
    // Whoever takes it over stops what it does by itself; its sensors go on.
    take_lease(&screen, &telemetry);
    screen.tap_with(Key::Control, Key::G);
    telemetry.wait_for_status("nobody's, and standing", |status| {
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
