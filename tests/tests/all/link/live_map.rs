//! Edge and consoles export the same maps after cuts and stops.

use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::rig::relay::Relay;
use tempfile::tempdir;

use super::processes::{
    Running, assert_same_files, assert_same_maps, console, edge, free_port, program, rooms,
};

const fn seconds(seconds: u64) -> Duration {
    Duration::from_secs(seconds)
}

/// Longer than the lease of the link (4 s), so that the session ends.
const SHORT: Duration = seconds(6);

/// A replay at `rate`; a console from the start, one that joins in the middle, one whose link is cut for
/// `trouble`, one that is stopped for as long.
fn all_consoles_have_the_edges_map(rate: &str, trouble: Duration) {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let port = free_port();
    let relay = Relay::pair(port).unwrap();

    // The first console starts before its robot.
    let early = console(port, "scout", &at("early"));
    sleep(seconds(1));
    let robot = edge(port, "scout", rate, &at("edge"));
    let cut = console(relay.port(), "scout", &at("cut"));
    let stopped = console(port, "scout", &at("stopped"));
    sleep(seconds(2));
    relay.cut();
    stopped.signal("STOP");
    let late = console(port, "scout", &at("late"));
    sleep(trouble);
    relay.pass().unwrap();
    stopped.signal("CONT");

    for console in [early, late, cut, stopped] {
        console.ends_well();
    }
    robot.signal("INT");
    robot.ends_well();
    for name in ["early", "late", "cut", "stopped"] {
        assert_same_maps(&at("edge"), &at(name));
    }
}

#[test]
fn late_cut_off_and_stopped_consoles_have_the_edges_map() {
    all_consoles_have_the_edges_map("10", SHORT);
}

#[test]
#[ignore = "a minute: cut for 10 s"]
fn a_link_cut_for_ten_seconds_recovers() {
    all_consoles_have_the_edges_map("4", seconds(10));
}

#[test]
#[ignore = "a minute: stopped for 30 s"]
fn a_console_stopped_for_thirty_seconds_recovers() {
    all_consoles_have_the_edges_map("3", seconds(30));
}

#[test]
fn a_console_follows_its_robot_through_a_restart() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let port = free_port();
    // The cells of the first run have another size and must all be erased.
    let first = {
        let mut command = program("robot-edge");
        command.arg("replay").arg(rooms());
        command.args(["--rate", "20", "--keep-serving", "--robot", "scout"]);
        command.args(["--set", "mapping.occupancy.cell_m=0.2"]);
        command.args(["--listen", &format!("tcp/127.0.0.1:{port}"), "--export"]);
        Running::start(command.arg(at("first")), "first edge")
    };
    let console = console(port, "scout", &at("console"));
    sleep(seconds(3));
    first.signal("KILL");
    drop(first);
    let second = edge(port, "scout", "20", &at("second"));
    let printed = console.ends_well();
    second.signal("INT");
    second.ends_well();
    assert!(printed.contains("synchronized"), "{printed}");
    assert_same_maps(&at("second"), &at("console"));
    assert!(!at("first").join("occupancy.tif").exists(), "it was killed");
}

#[test]
fn a_replay_that_ends_waits_for_its_consoles() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let port = free_port();
    let mut command = program("robot-edge");
    command
        .arg("replay")
        .arg(rooms())
        .args(["--rate", "40", "--robot", "scout"]);
    command
        .args(["--listen", &format!("tcp/127.0.0.1:{port}"), "--export"])
        .arg(at("edge"));
    let robot = Running::start(&mut command, "edge");
    let console = console(port, "scout", &at("console"));
    console.ends_well();
    robot.ends_well();
    assert_same_maps(&at("edge"), &at("console"));
}

/// Elevation and obstacle maps, erased because the ground plane is reset.
#[test]
fn maps_erased_during_a_run_are_the_same_in_the_console() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let port = free_port();
    let mut record = program("robot-edge");
    record.args([
        "simulate",
        "ramp",
        "--rate",
        "max",
        "--no-network",
        "--quiet",
        "--record",
    ]);
    Running::start(record.arg(at("ramp.mcap")), "recorder").ends_well();

    let console = console(port, "scout", &at("console"));
    let mut command = program("robot-edge");
    command.arg("replay").arg(at("ramp.mcap"));
    command.args(["--rate", "12", "--robot", "scout"]);
    command.args(["--listen", &format!("tcp/127.0.0.1:{port}"), "--export"]);
    let printed = Running::start(command.arg(at("edge")), "edge").ends_well();
    console.ends_well();
    assert!(
        printed.contains("ground_plane: the ground plane was reset"),
        "{printed}"
    );
    assert_same_files(&at("edge"), &at("console"), 7);
}

/// The octree's files are made on the vehicle and fetched in parts.
#[test]
fn voxels_are_the_same_in_the_console() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let port = free_port();
    let console = console(port, "scout", &at("console"));
    let mut command = program("robot-edge");
    command.args(["simulate", "yard", "--duration", "8", "--rate", "max"]);
    command.args(["--robot", "scout", "--quiet"]);
    command.args(["--listen", &format!("tcp/127.0.0.1:{port}"), "--export"]);
    Running::start(command.arg(at("edge")), "edge").ends_well();
    console.ends_well();
    for name in ["voxels.bt", "points.ply"] {
        assert!(at("console").join(name).exists(), "{name}");
    }
    // Two files each of cost and rigidity, and of the octree, and the trajectory.
    assert_same_files(&at("edge"), &at("console"), 7);
}
