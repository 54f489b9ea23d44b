//! Garbage on every key and queryable is refused and counted; memory and map are not affected.

use std::thread::sleep;
use std::time::Duration;

use protocol::keys::{RobotId, Topic};
use protocol::layer::LayerId;
use protocol::message::Status;
use protocol::wire;
use tempfile::tempdir;
use zenoh::Wait as _;

use super::console;
use super::maps::routers;
use crate::processes::{assert_same_maps, free_port, rooms, start, tcp, zenoh_session};
use crate::rng::SeededRng;

/// Allowed growth of either program.
const GROWTH_BYTES: u64 = 20_000_000;

/// One invalid message of each kind.
fn garbage() -> Vec<Vec<u8>> {
    let mut rng = SeededRng::new(7);
    let lengths = [0, 1, 2, 33, 34, 35, 100, 1000, 60_000, 200_000];
    let mut garbage: Vec<_> = lengths.map(|length| rng.bytes(length)).into();
    // A valid header before garbage, and other versions.
    for version in [wire::PROTOCOL, wire::PROTOCOL + 1, 999] {
        for length in [0, 1, 20, 5000] {
            let header = version.to_le_bytes();
            garbage.push([&header[..], &rng.bytes(32 + length)].concat());
        }
    }
    // Sequences that claim 2⁶³ elements.
    let mut giant = wire::PROTOCOL.to_le_bytes().to_vec();
    giant.extend([0; 32]);
    giant.extend([0xFF; 9]);
    giant.push(0x7F);
    garbage.push(giant);
    garbage
}

fn topics() -> Vec<Topic> {
    let mut topics = vec![
        Topic::Info,
        Topic::Pose,
        Topic::Status,
        Topic::Event,
        Topic::MapHead,
        Topic::Ping,
    ];
    for layer in LayerId::ALL {
        topics.extend([
            Topic::Changes(layer),
            Topic::Tiles(layer),
            Topic::Overviews(layer),
            Topic::Digests(layer),
        ]);
    }
    topics
}

#[test]
fn garbage_is_refused_and_counted_and_nothing_grows() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    // Through routers, the garbage reaches consoles too.
    let port = free_port();
    let _routers = routers(port);
    let mut robot = start(&format!(
        "robot-edge replay {} --rate 10 --keep-serving --robot scout --connect {} --export {}",
        rooms(),
        tcp(port),
        at("edge").display()
    ));
    let mut watching = console(port, "scout", &at("console"));
    sleep(Duration::from_secs(3));
    let before = [robot.memory(), watching.memory()];

    let id: RobotId = "scout".parse().unwrap();
    let sessions = [port, port + 1].map(|port| zenoh_session("client", &tcp(port)));
    let status = sessions[0]
        .declare_subscriber(Topic::Status.key(&id))
        .wait()
        .unwrap();
    for round in 0..5 {
        for session in &sessions {
            for message in garbage() {
                for topic in topics() {
                    session.put(topic.key(&id), message.clone()).wait().unwrap();
                    if round == 0 {
                        session
                            .get(topic.key(&id))
                            .payload(message.clone())
                            .timeout(Duration::from_secs(1))
                            .wait()
                            .unwrap();
                    }
                }
                for key in [&format!("view/x{round}"), "view/y/z", "map/snow/1/2"] {
                    let put = session.put(format!("foreshore/scout/{key}"), message.clone());
                    put.wait().unwrap();
                }
            }
        }
    }
    sleep(Duration::from_secs(2));
    assert!(robot.is_running() && watching.is_running());
    let after = [robot.memory(), watching.memory()];
    for (before, after) in before.into_iter().zip(after) {
        assert!(
            after < before + GROWTH_BYTES,
            "{before} bytes grew to {after}"
        );
    }
    let statuses = status
        .drain()
        .filter_map(|sample| wire::decode::<Status>(&sample.payload().to_bytes()).ok());
    let refused = statuses.map(|(_, status)| status.refused).max().unwrap();
    println!("the edge refused {refused} messages; memory {before:?} → {after:?}");
    assert!(refused >= 100, "{refused} were counted");

    let printed = watching.ends_well();
    println!("{printed}");
    assert!(
        printed.contains("× malformed") && printed.contains("× other protocol version"),
        "{printed}"
    );
    robot.interrupt();
    assert_same_maps(&at("edge"), &at("console"));
}
