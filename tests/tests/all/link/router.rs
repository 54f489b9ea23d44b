//! Consoles and robots at one Zenoh router.

use std::thread::sleep;
use std::time::Duration;

use tempfile::tempdir;
use zenoh::Session;

use super::processes::{
    Running, assert_same_maps, console, free_port, program, rooms, zenoh_session,
};

/// A router for one session; bulk needs a second one at the next port.
pub(crate) fn router(port: u16) -> Session {
    zenoh_session("router", &format!("tcp/127.0.0.1:{port}"))
}

fn robots_and_consoles_through_a_router(robots: usize, consoles: usize, rate: &str) {
    let folder = tempdir().unwrap();
    let port = free_port();
    let _routers = [router(port), router(port + 1)];
    let names: Vec<_> = (0..robots).map(|n| format!("robot-{n}")).collect();
    let edges: Vec<_> = names
        .iter()
        .enumerate()
        .map(|(n, name)| {
            let mut command = program("robot-edge");
            // Different maps: tiles of two robots must not be confused.
            command.arg("replay").arg(rooms()).args([
                "--rate",
                rate,
                "--keep-serving",
                "--robot",
                name,
            ]);
            command.args(["--start", &(10 * n).to_string()]);
            command
                .args(["--connect", &format!("tcp/127.0.0.1:{port}"), "--export"])
                .arg(folder.path().join(name));
            Running::start(&mut command, name)
        })
        .collect();
    let watched: Vec<_> = (0..consoles)
        .map(|n| {
            let (robot, export) = (
                &names[n % robots],
                folder.path().join(format!("console-{n}")),
            );
            sleep(Duration::from_millis(200));
            (robot, console(port, robot, &export), export)
        })
        .collect();
    let exports: Vec<_> = watched
        .into_iter()
        .map(|(robot, console, export)| {
            console.ends_well();
            (robot, export)
        })
        .collect();
    for edge in &edges {
        edge.signal("INT");
    }
    for edge in edges {
        edge.ends_well();
    }
    for (robot, export) in exports {
        assert_same_maps(&folder.path().join(robot), &export);
    }
}

#[test]
fn consoles_and_robots_meet_at_a_router() {
    robots_and_consoles_through_a_router(2, 2, "20");
}

#[test]
#[ignore = "a minute, thirteen processes"]
fn ten_consoles_and_three_robots_meet_at_a_router() {
    robots_and_consoles_through_a_router(3, 10, "4");
}
