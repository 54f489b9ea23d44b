//! A live system gives the same map as its recording; a missing sensor, topic or ROS 2 system is an error.

use std::collections::BTreeMap;
use std::path::Path;
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::operator::connected;
use network::clock::{self, sleep_until};
use protocol::keys::Topic;
use protocol::message::{Info, Status};
use protocol::wire;
use serde_json::Value;
use tempfile::tempdir;
use zenoh::Wait as _;

use super::ros_system::{RosMiddleware, RosSystem};
use crate::processes::{Running, command, free_port, rooms, start, tcp};
use crate::shared_data::shared_data;

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

fn messages(recording: &str) -> Vec<Message> {
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

/// Summary of a replay of this recording.
fn replay(recording: &str, options: &str) -> Value {
    let folder = tempdir().unwrap();
    let path = folder.path().join("replay.json");
    start(&format!(
        "robot-edge replay {recording} {options} --no-network --quiet --summary {}",
        path.display()
    ))
    .ends_well();
    summary(&path)
}

/// Waits until the edge has received this number of scans.
fn await_scans(port: u16, scans: u64) {
    let session = connected(&tcp(port), None);
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

/// What is played.
struct Played<'a> {
    recording: &'a str,
    /// Of the vehicle.
    options: &'a str,
    range_topic: &'a str,
    pose_topics: &'a [&'a str],
}

/// Plays a recording to a live edge; returns its summary and that of a replay of its own recording.
fn live(played: &Played<'_>, ros_middleware: RosMiddleware, spoil: bool) -> (Value, Value) {
    let &Played {
        recording: source,
        options,
        range_topic,
        pose_topics,
    } = played;
    let folder = tempdir().unwrap();
    let (listen, ros) = (free_port(), free_port());
    let (path, recording) = (
        folder.path().join("live.json"),
        folder.path().join("live.mcap"),
    );
    let mut system = RosSystem::start(ros, ros_middleware);
    let messages = messages(source);
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
    let mut edge = command(&format!(
        "robot-edge run --ros {} {options} --robot live --wait 60 --quiet --listen {} --summary {} --record {}",
        system.endpoint(),
        tcp(listen),
        path.display(),
        recording.display()
    ));
    if let RosMiddleware::Rmw { domain } = ros_middleware {
        edge.env("ROS_DOMAIN_ID", domain.to_string());
    }
    let edge = Running::start(&mut edge, "edge");
    for topic in pose_topics.iter().chain([&range_topic]) {
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
        scans += u64::from(message.topic == range_topic);
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
    edge.ends_with(130);
    (summary(&path), replay(recording.to_str().unwrap(), options))
}

#[test]
fn a_live_system_gives_the_map_of_its_recording() {
    let played = Played {
        recording: &rooms(),
        options: "--vehicle pioneer",
        range_topic: "/scan",
        pose_topics: &["/tf", "/odom"],
    };
    let replayed = replay(played.recording, "");
    for (ros_middleware, spoil) in [
        (RosMiddleware::Rmw { domain: 7 }, true),
        (RosMiddleware::Bridge, false),
    ] {
        let (live, again) = live(&played, ros_middleware, spoil);
        assert_eq!(live["scans"], replayed["scans"], "{ros_middleware:?}");
        assert_eq!(live["layers"], replayed["layers"], "{ros_middleware:?}");
        assert_eq!(again["layers"], replayed["layers"], "{ros_middleware:?}");
        let source = live["recording"].as_str().unwrap();
        assert_eq!(source.split('/').next(), Some("tcp"));
        if spoil {
            let undecodable = live["losses"]["undecodable"].as_u64().unwrap();
            assert!(undecodable >= 100, "{}", live["losses"]);
        }
    }
}

/// The same clouds from ROS 2, from an MCAP and from a ROS 1 bag.
#[test]
fn live_clouds_make_the_maps_of_their_recording() {
    let Some(folder) = shared_data("rosbag1") else {
        return;
    };
    let bag = folder.join("lms1xx_with_tf.bag");
    let options = "--vehicle generic3d --set localization.source=static --topic lidar=/cloud";
    let made = tempdir().unwrap();
    let mcap = made.path().join("clouds.mcap");
    let mcap = mcap.to_str().unwrap();
    let of_bag = replay(bag.to_str().unwrap(), &format!("{options} --record {mcap}"));
    assert_eq!(of_bag["scans"]["mapped"], 89);
    let played = Played {
        recording: mcap,
        options,
        range_topic: "/cloud",
        pose_topics: &[],
    };
    let (live, again) = live(&played, RosMiddleware::Rmw { domain: 7 }, false);
    assert_eq!(live["scans"], of_bag["scans"]);
    assert_eq!(live["layers"], of_bag["layers"]);
    assert_eq!(again["layers"], of_bag["layers"]);
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
    let _edge = start(&format!(
        "robot-edge run --ros {} --ros-domain 0 --robot live --set localization.source=static --wait 60 --quiet --listen {}",
        first.endpoint(),
        tcp(listen)
    ));
    first.wait_for_subscriber("/scan");
    let scans_in = |scans: u64| std::thread::spawn(move || await_scans(listen, scans));
    let seen = scans_in(10);
    let next = first.sweep_until(0, || seen.is_finished());
    seen.join().unwrap();
    // Consoles take a vehicle with a source for a replay or a simulation.
    let session = connected(&tcp(listen), None);
    let key = Topic::Info.key(&"live".parse().unwrap());
    let replies = session.get(key).wait().unwrap();
    let reply = replies.recv_timeout(TIMEOUT).unwrap().unwrap();
    let sample = reply.into_result().unwrap();
    let (_, info): (_, Info) = wire::decode(&sample.payload().to_bytes()).unwrap();
    assert_eq!(info.source, "");
    drop(first);
    let mut second = system();
    let seen = scans_in(u64::from(next) + 10);
    second.wait_for_subscriber("/scan");
    second.sweep_until(next, || seen.is_finished());
    seen.join().unwrap();
}

fn run(ros: &str, options: &str) -> Running {
    start(&format!(
        "robot-edge run --ros {ros} --no-network --quiet {options}"
    ))
}

/// Encapsulation and a `geometry_msgs/Twist` of zeros.
const TWIST: [u8; 52] = {
    let mut message = [0; 52];
    message[1] = 1;
    message
};

#[test]
fn a_missing_sensor_is_an_error_that_lists_the_topics() {
    let mut system = RosSystem::start(free_port(), RosMiddleware::Rmw { domain: 0 });
    system.announce("/bot/cmd_vel", "geometry_msgs/msg/Twist");
    system.announce("/bot/camera", "sensor_msgs/msg/Image");
    let edge = run(&system.endpoint(), "--ros-domain 0 --wait 4");
    system.wait_for_subscriber("/bot/cmd_vel");
    for _ in 0..3 {
        system.publish("/bot/cmd_vel", &TWIST);
    }
    let printed = edge.ends_with(2);
    for words in [
        "no scans (sensor_msgs/LaserScan) came",
        "in 4 s, in domain 0 and from bridges, there were:",
        "/bot/cmd_vel (geometry_msgs/Twist): 3 messages",
        "/bot/camera (sensor_msgs/Image): announced, no messages received",
    ] {
        assert!(printed.contains(words), "{printed}");
    }
}

#[test]
fn a_domain_without_topics_is_an_error() {
    let mut system = RosSystem::start(free_port(), RosMiddleware::Rmw { domain: 3 });
    system.announce("/scan", "sensor_msgs/msg/LaserScan");
    let printed = run(&system.endpoint(), "--ros-domain 0 --wait 1").ends_with(2);
    let words =
        "no topic was received or announced in 1 s; does it run in domain 0 (--ros-domain)?";
    assert!(printed.contains(words), "{printed}");
}

#[test]
fn a_missing_ros_system_is_an_error_that_says_what_to_start() {
    let endpoint = tcp(free_port());
    let printed = run(&endpoint, "--wait 1").ends_with(1);
    assert!(
        printed.contains(&format!("{endpoint}: no ROS 2 system. Start")),
        "{printed}"
    );
    run("localhost", "").ends_with(2);
}
