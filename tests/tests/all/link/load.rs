//! Benchmarks of processor load: streaming with consoles that follow and that are stopped, and the window of a standing
//! robot.

use std::thread::sleep;
use std::time::Duration;

use protocol::message::TeleopState;
use tempfile::tempdir;

use super::console;
use super::desktop::{Controls, Key, Screen, Telemetry, take_lease};
use crate::processes::{Running, command, free_endpoint, free_port, rooms, start, tcp};

const MEASURED: Duration = Duration::from_secs(30);

/// 25 scans a second: the recording has 10.
fn edge(network: &str) -> Running {
    let rooms = rooms();
    start(&format!(
        "robot-edge replay {rooms} --rate 2.5 --robot scout {network}"
    ))
}

#[test]
#[ignore = "two minutes: measures"]
fn streaming_costs_little_with_fast_and_stopped_consoles() {
    let folder = tempdir().unwrap();
    let alone = edge("--no-network");
    sleep(Duration::from_secs(2));
    let alone = alone.load(MEASURED);

    let port = free_port();
    let listen = format!("--listen {}", tcp(port));
    let robot = edge(&listen);
    let watching = console(port, "scout", &folder.path().join("a"));
    sleep(Duration::from_secs(2));
    let watched = robot.load(MEASURED);
    let console_load = watching.processor_s();
    drop((watching, robot));
    println!(
        "at 25 scans/s: edge alone {alone:.2} %, with a console {watched:.2} %: streaming {:.2} % of a core; the headless console took {console_load:.2} s in 32 s",
        watched - alone
    );

    let robot = edge(&listen);
    let frozen = console(port, "scout", &folder.path().join("b"));
    let watching = console(port, "scout", &folder.path().join("c"));
    sleep(Duration::from_secs(2));
    frozen.signal("STOP");
    let beside_frozen = robot.load(MEASURED);
    println!("with a console and one that is stopped: {beside_frozen:.2} % of a core");
    let printed = watching.ends_well();
    let synchronized = printed.lines().find(|line| line.contains("synchronized"));
    println!(
        "the console beside it: {}",
        synchronized.unwrap_or_default()
    );
    assert!(!printed.contains("console too slow"), "{printed}");
}

#[test]
#[ignore = "two minutes: measures, and needs an idle machine"]
fn a_window_of_a_standing_robot_costs_little() {
    let Some(screen) = Screen::open() else { return };
    let endpoint = free_endpoint();
    let _edge = start(&format!(
        "robot-edge simulate rooms --keep-serving --quiet --robot scout --listen {endpoint}"
    ));
    let telemetry = Telemetry::of("scout", &endpoint);
    let home = tempdir().unwrap();
    let controls = Controls(home.path().join("controls"));
    let open = |options: &str| {
        let settings = home.path().join("console.json");
        let mut console = command(&format!(
            "operator-console --robot scout --connect {endpoint} --operator anna --config {} {options}",
            settings.display()
        ));
        screen.show(&mut console);
        Running::start(&mut console, "the window")
    };
    // Once with the accessibility tree, which costs more, to know what it shows.
    let named = open(&format!("--controls {}", controls.0.display()));
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
    let console = open("");
    sleep(Duration::from_secs(8));
    let alone = console.load(MEASURED);
    println!(
        "{alone:.1} % of a core; with every control's name written to a file {with_names:.1} %"
    );
}
