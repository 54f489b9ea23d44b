//! A live system gives the same map as its recording.

use std::collections::BTreeMap;
use std::path::Path;
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::operator::connected;
use protocol::keys::Topic;
use protocol::message::Status;
use protocol::wire;
use robot_edge::clock::{self, sleep_until};
use serde_json::Value;
use tempfile::tempdir;
use zenoh::Wait as _;

use super::ros_system::{RosMiddleware, RosSystem};
use crate::link::processes::{Running, free_port, program, rooms};

/// Longer than any step takes.
const TIMEOUT: Duration = Duration::from_mins(2);

/// Replay speed.
const RATE: u64 = 10;

/// One message of a recording.
struct Message {
    topic: String,
    type_name: String,
    log_time_ns: u64,
    data: Vec<u8>,
}

fn messages(recording: &Path) -> Vec<Message> {
    let bytes = std::fs::read(recording).unwrap();
    let messages = mcap::MessageStream::new(&bytes).unwrap();
    let message = |message: Result<mcap::Message<'_>, _>| {
        let message = message.unwrap();
        Message {
            topic: message.channel.topic.clone(),
            type_name: message.channel.schema.as_ref().unwrap().name.clone(),
            log_time_ns: message.log_time,
            data: message.data.to_vec(),
        }
    };
    messages.map(message).collect()
}

fn summary(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Summary of a replay of the recording.
fn replayed() -> Value {
    let folder = tempdir().unwrap();
    let path = folder.path().join("replay.json");
    let mut command = program("robot-edge");
    command.arg("replay").arg(rooms());
    command
        .args(["--no-network", "--quiet", "--summary"])
        .arg(&path);
    Running::start(&mut command, "replay").ends_well();
    summary(&path)
}

/// Waits until the edge has received this number of scans.
fn await_scans(port: u16, scans: u64) {
    let session = connected(&format!("tcp/127.0.0.1:{port}"), None);
    let key = Topic::Status.key(&"live".parse().unwrap());
    let statuses = session.declare_subscriber(key).wait().unwrap();
    let started = clock::now();
    let mut seen = 0;
    while seen < scans {
        assert!(clock::elapsed(started) < TIMEOUT, "{seen} of {scans} scans");
        if let Ok(Some(sample)) = statuses.recv_timeout(Duration::from_secs(1)) {
            let (_, status): (_, Status) = wire::decode(&sample.payload().to_bytes()).unwrap();
            seen = status.scans_in;
        }
    }
}

/// Plays the recording to a live edge; returns its summary and that of a replay of its own recording.
fn live(ros_middleware: RosMiddleware, spoil: bool) -> (Value, Value) {
    let folder = tempdir().unwrap();
    let (listen, ros) = (free_port(), free_port());
    let (path, recording) = (
        folder.path().join("live.json"),
        folder.path().join("live.mcap"),
    );
    let mut system = RosSystem::start(ros, ros_middleware);
    let messages = messages(&rooms());
    let mut types: BTreeMap<_, _> = BTreeMap::new();
    for message in &messages {
        types.insert(&message.topic, &message.type_name);
    }
    for (topic, type_name) in types {
        if topic == "/tf_static" {
            let first = messages.iter().find(|message| message.topic == *topic);
            system.keep(topic, type_name, &first.unwrap().data);
        } else {
            system.announce(topic, type_name);
        }
    }
    let mut command = program("robot-edge");
    command.args(["run", "--ros", &system.endpoint(), "--vehicle", "pioneer"]);
    command.args(["--robot", "live", "--wait", "60", "--quiet"]);
    command
        .arg("--listen")
        .arg(format!("tcp/127.0.0.1:{listen}"));
    command.arg("--summary").arg(&path);
    command.arg("--record").arg(&recording);
    if let RosMiddleware::Rmw { domain } = ros_middleware {
        command.env("ROS_DOMAIN_ID", domain.to_string());
    }
    let edge = Running::start(&mut command, "edge");
    for topic in ["/scan", "/tf", "/odom"] {
        system.wait_for_subscriber(topic);
    }

    let (began, first) = (clock::now(), messages[0].log_time_ns);
    let mut scans = 0;
    for (number, message) in messages.iter().enumerate() {
        if message.topic == "/tf_static" {
            continue;
        }
        let due = Duration::from_nanos((message.log_time_ns - first) / RATE);
        sleep_until(began + due, || false);
        system.publish(&message.topic, &message.data);
        scans += u64::from(message.topic == "/scan");
        if spoil && number % 200 == 0 {
            system.publish(&message.topic, &message.data[..message.data.len() / 2]);
            for topic in ["/scan", "/tf"] {
                system.publish(topic, b"garbage");
                system.publish(topic, b"");
            }
        }
    }
    await_scans(listen, scans);
    // Scans wait for poses for up to 50 ms.
    sleep(Duration::from_millis(500));
    edge.signal("INT");
    let (code, printed) = edge.end();
    assert_eq!(code, Some(130), "{printed}");

    let again = folder.path().join("again.json");
    let mut command = program("robot-edge");
    command
        .arg("replay")
        .arg(&recording)
        .args(["--no-network", "--quiet"]);
    command.arg("--summary").arg(&again);
    Running::start(&mut command, "replay of what was recorded").ends_well();
    (summary(&path), summary(&again))
}

#[test]
fn live_rmw_zenoh_gives_the_map_of_its_recording() {
    let replayed = replayed();
    let (live, again) = live(RosMiddleware::Rmw { domain: 7 }, true);
    assert_eq!(live["scans"], replayed["scans"]);
    assert_eq!(live["layers"], replayed["layers"]);
    assert_eq!(again["layers"], replayed["layers"]);
    assert_eq!(
        live["recording"].as_str().unwrap().split('/').next(),
        Some("tcp")
    );
    let undecodable = live["losses"]["undecodable"].as_u64().unwrap();
    assert!(undecodable >= 100, "{}", live["losses"]);
}

#[test]
fn a_live_bridge_gives_the_map_of_its_recording() {
    let replayed = replayed();
    let (live, again) = live(RosMiddleware::Bridge, false);
    assert_eq!(live["scans"], replayed["scans"]);
    assert_eq!(live["layers"], replayed["layers"]);
    assert_eq!(again["layers"], replayed["layers"]);
}

#[test]
fn the_edge_reconnects_to_a_restarted_router() {
    let (listen, ros) = (free_port(), free_port());
    let system = || {
        let mut system = RosSystem::start(ros, RosMiddleware::Rmw { domain: 0 });
        system.announce("/scan", "sensor_msgs/msg/LaserScan");
        system
    };
    let mut first = system();
    let mut command = program("robot-edge");
    command.args([
        "run",
        "--ros",
        &first.endpoint(),
        "--ros-domain",
        "0",
        "--robot",
        "live",
    ]);
    command.args([
        "--set",
        "localization.source=static",
        "--wait",
        "60",
        "--quiet",
    ]);
    command
        .arg("--listen")
        .arg(format!("tcp/127.0.0.1:{listen}"));
    let _edge = Running::start(&mut command, "edge");
    first.wait_for_subscriber("/scan");
    let scans_in = |scans: u64| std::thread::spawn(move || await_scans(listen, scans));
    let seen = scans_in(10);
    let next = first.sweep_until(0, || seen.is_finished());
    seen.join().unwrap();
    drop(first);
    let mut second = system();
    let seen = scans_in(u64::from(next) + 10);
    second.wait_for_subscriber("/scan");
    second.sweep_until(next, || seen.is_finished());
    seen.join().unwrap();
}
