//! Time from a cut of the link to the data of the banner.

use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

use foreshore_tests::rig::relay::Relay;
use measurement::time::Monotonic;
use operator_console::model::LinkState;
use operator_console::panels::stale::StaleData;
use protocol::layer::LayerId;
use robot_edge::clock::{self, sleep_until};

use super::processes::{
    Running, connect_to, free_port, open_session, program, rooms, simulate, wait_until,
};

const MAX_DETECTION_TIME: Duration = Duration::from_millis(500);
/// Longer than any step takes.
const TIMEOUT: Duration = Duration::from_mins(1);
const CUTS: usize = 5;

#[test]
fn a_cut_link_is_reported_within_half_a_second() {
    let port = free_port();
    let relay = Relay::pair(port).unwrap();
    let listen = format!("tcp/127.0.0.1:{port}");
    let mut command = simulate(&["--robot", "scout", "--listen", &listen]);
    let _edge = Running::start(&mut command, "edge");

    let (waker, woken) = sync_channel(1);
    // One wake-up is enough until the window is drawn.
    let wake = move || {
        let _is_pending = waker.try_send(());
    };
    let endpoints = connect_to(relay.endpoint());
    let session = open_session(&endpoints, &[LayerId::Occupancy], wake);

    // As a window: it updates on a wake-up, and once a second for the ages.
    let wait_for = |what: &str, longest: Duration, is_so: &dyn Fn(Monotonic) -> bool| {
        let started = clock::now();
        while !is_so(clock::now()) {
            assert!(clock::elapsed(started) < longest, "not {what}");
            match woken.recv_timeout(Duration::from_secs(1)) {
                Ok(()) | Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => panic!("the link's thread is gone"),
            }
        }
        clock::elapsed(started)
    };
    let is_reported = |now| StaleData::new(&session.model(), now).is_some();
    let is_live = |now| session.model().connection().state(now) == LinkState::Live;
    let mut took = Vec::new();
    let mut false_alarms = 0;
    for cut in 0..CUTS {
        wait_for("live", TIMEOUT, &is_live);
        // Not synchronized with events that happen twice a second.
        let until = clock::now() + Duration::from_millis(2_500 + 77 * cut as u64);
        while clock::now() < until {
            false_alarms += usize::from(is_reported(clock::now()));
            sleep_until(clock::now() + Duration::from_millis(10), || false);
        }
        relay.cut();
        took.push(wait_for("the banner", TIMEOUT, &is_reported));
        relay.pass().unwrap();
    }
    took.sort_unstable();
    println!("from the cut to the banner: {took:?}; {false_alarms} looks saw one without a cut");
    // A busy machine may exceed the limit in some.
    assert!(took[CUTS / 2] <= MAX_DETECTION_TIME, "{took:?}");
    assert!(
        took[0] >= Duration::from_millis(300),
        "{took:?}: jitter alone would raise the banner"
    );
}

/// A robot that ends regularly reports the end of its data, so the console does not report a lost link.
#[test]
fn an_interrupted_replay_reports_its_end() {
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let mut command = program("robot-edge");
    command.arg("replay").arg(rooms()).args(["--rate", "1"]);
    command.args(["--robot", "scout", "--insecure", "--listen", &endpoint]);
    let robot = Running::start(&mut command, "edge");
    let session = open_session(&connect_to(endpoint), &[], || {});
    wait_until("its data arrives", || {
        let model = session.model();
        model.status().is_some() && model.vehicle().pose().is_some()
    });
    assert!(!session.model().reports_ended());
    robot.signal("INT");
    drop(robot.end());
    wait_until("it is silent", || {
        session.model().connection().state(clock::now()) == LinkState::Silent
    });
    assert!(session.model().is_silence_expected());
}
