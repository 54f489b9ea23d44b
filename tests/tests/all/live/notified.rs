//! Notifications to a service manager.

use std::fs;
use std::os::unix::net::UnixDatagram;
use std::thread::sleep;
use std::time::Duration;

use super::live_rig::{LiveRig, guard_of};
use crate::processes::{Running, command, rooms};

/// Notifications of the next second.
fn notified(socket: &UnixDatagram) -> Vec<String> {
    sleep(Duration::from_secs(1));
    let mut buffer = [0; 64];
    std::iter::from_fn(|| {
        let count = socket.recv(&mut buffer).ok()?;
        Some(String::from_utf8(buffer[..count].to_vec()).unwrap())
    })
    .collect()
}

#[test]
fn only_the_teleop_loop_feeds_the_service_watchdog() {
    let (live_rig, _controller) = LiveRig::with_roboteq(|_| ());
    let path = live_rig.folder().join("notify");
    let socket = UnixDatagram::bind(&path).unwrap();
    socket.set_nonblocking(true).unwrap();
    let edge = live_rig.start_edge(|command| {
        command.env("NOTIFY_SOCKET", &path);
    });
    let _anna = live_rig.operator();
    let states = notified(&socket);
    assert_eq!(states[0], "READY=1", "{states:?}");
    assert!(
        states[1..].iter().all(|state| state == "WATCHDOG=1"),
        "{states:?}"
    );
    let states = notified(&socket);
    assert!(states.contains(&"WATCHDOG=1".to_owned()), "{states:?}");
    // The motor guard must not notify.
    let guard = fs::read(format!("/proc/{}/environ", guard_of(edge.id()))).unwrap();
    assert!(!String::from_utf8_lossy(&guard).contains("NOTIFY_SOCKET"));

    edge.signal("STOP");
    notified(&socket);
    assert_eq!(notified(&socket), [""; 0]);
    edge.signal("CONT");
    assert!(
        notified(&socket).contains(&"WATCHDOG=1".to_owned()),
        "it continues"
    );
    edge.signal("INT");
    edge.ends_with(130);
    assert_eq!(notified(&socket).last().unwrap(), "WATCHDOG_USEC=0");
}

#[test]
fn a_replay_is_ready_without_a_watchdog() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notify");
    let socket = UnixDatagram::bind(&path).unwrap();
    socket.set_nonblocking(true).unwrap();
    let mut replay = command(&format!(
        "robot-edge replay {} --no-network --quiet",
        rooms()
    ));
    Running::start(replay.env("NOTIFY_SOCKET", &path), "replay").ends_well();
    assert_eq!(notified(&socket), ["READY=1\nWATCHDOG_USEC=0"]);
}
