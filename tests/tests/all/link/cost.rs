//! Processor load of streaming, with consoles that follow and that are stopped. A benchmark.

use std::thread::sleep;
use std::time::Duration;

use tempfile::tempdir;

use super::processes::{Running, console, free_port, program, rooms};

const MEASURED: Duration = Duration::from_secs(30);

/// 25 scans a second: the recording has 10.
fn edge(network: &[&str]) -> Running {
    let mut command = program("robot-edge");
    command
        .arg("replay")
        .arg(rooms())
        .args(["--rate", "2.5", "--robot", "scout"])
        .args(network);
    Running::start(&mut command, "edge")
}

#[test]
#[ignore = "two minutes: measures"]
fn streaming_costs_little_with_fast_and_stopped_consoles() {
    let folder = tempdir().unwrap();
    let alone = edge(&["--no-network"]);
    sleep(Duration::from_secs(2));
    let alone = alone.load(MEASURED);

    let port = free_port();
    let listen = format!("tcp/127.0.0.1:{port}");
    let robot = edge(&["--listen", &listen]);
    let watching = console(port, "scout", &folder.path().join("a"));
    sleep(Duration::from_secs(2));
    let watched = robot.load(MEASURED);
    let console_load = watching.processor_s();
    drop((watching, robot));
    println!(
        "at 25 scans/s: edge alone {alone:.2} %, with a console {watched:.2} %: streaming {:.2} % of a core; the headless console took {console_load:.2} s in 32 s",
        watched - alone
    );

    let robot = edge(&["--listen", &listen]);
    let frozen = console(port, "scout", &folder.path().join("b"));
    let watching = console(port, "scout", &folder.path().join("c"));
    sleep(Duration::from_secs(2));
    frozen.signal("STOP");
    let beside_frozen = robot.load(MEASURED);
    println!("with a console and one that is stopped: {beside_frozen:.2} % of a core");
    let printed = watching.ends_well();
    println!(
        "the console beside it: {}",
        printed
            .lines()
            .find(|line| line.contains("synchronized"))
            .unwrap_or_default()
    );
    assert!(!printed.contains("console too slow"), "{printed}");
    drop((frozen, robot));
}
