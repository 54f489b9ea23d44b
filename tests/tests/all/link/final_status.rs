//! A robot that goes in good order says before that its data has ended, so that nobody takes it for a link that is lost.

use std::collections::BTreeSet;
use std::time::Duration;

use operator_console::link::RobotSession;
use operator_console::model::{ConsoleModel, LinkState, ModelSettings};
use protocol::tile::BootId;
use robot_edge::clock;
use robot_edge::link::sessions::Endpoints;

use super::processes::{Running, free_port, program, rooms};

const TIMEOUT: Duration = Duration::from_secs(20);

#[track_caller]
fn wait_until(session: &RobotSession, what: &str, is_so: impl Fn(&ConsoleModel) -> bool) {
    let is_late = clock::sleep_until(clock::now() + TIMEOUT, || is_so(&session.model()));
    assert!(!is_late, "{what}");
}

#[test]
fn a_replay_that_is_interrupted_says_that_it_has_ended_before_it_goes() {
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let mut command = program("robot-edge");
    command.arg("replay").arg(rooms()).args(["--rate", "1"]);
    command.args(["--robot", "scout", "--insecure", "--listen", &endpoint]);
    let robot = Running::start(&mut command, "edge");
    let settings = ModelSettings {
        robot: "scout".parse().unwrap(),
        session: BootId([4; 16]),
        tile_store_mb: 16,
        layers: BTreeSet::new(),
    };
    let endpoints = Endpoints {
        connect: vec![endpoint],
        ..Endpoints::default()
    };
    let session = RobotSession::open(settings, &endpoints, || {}).unwrap();
    wait_until(&session, "its data comes", |model| {
        model.status().is_some() && model.vehicle().pose().is_some()
    });
    assert!(!session.model().reports_ended());
    robot.signal("INT");
    drop(robot.end());
    wait_until(&session, "it is silent", |model| {
        model.connection().state(clock::now()) == LinkState::Silent
    });
    assert!(session.model().is_silence_expected());
}
