//! A three-dimensional lidar whose packets come from the network: the same maps as from its recording.

use std::fs;
use std::path::Path;

use emulators::Emulator;
use emulators::packets::Packets;
use foreshore_tests::operator::connected;
use protocol::keys::Topic;
use protocol::message::DeviceState;
use serde_json::Value;
use tempfile::tempdir;
use zenoh::Wait as _;

use super::wait_for_status;
use crate::processes::{free_port, start, tcp};
use crate::shared_data::shared_data;

fn summary(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// Compared are the digests of all layers: of a run with the packets of `vlp16_packets.db3` from a socket; of a replay of what it
/// recorded; and of a replay of that file, whose unfinished last revolution is left out, for a socket has no end.
#[test]
fn packets_from_the_network_make_the_maps_of_their_recording() {
    let Some(folder) = shared_data("velodyne") else {
        return;
    };
    let packets = folder.join("vlp16_packets.db3");
    let made = tempdir().unwrap();
    let path = |name: &str| made.path().join(name);
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let host = socket.local_addr().unwrap();
    drop(socket);
    let mut device = Packets::of_velodyne(&packets);
    device.rounds = 1;
    let lidar = Emulator::to_udp(device, host);
    lidar.power(false);
    fs::write(
        path("rover.toml"),
        format!(
            "preset = \"generic3d\"\n[localization]\nsource = \"static\"\n\
             [devices.lidar]\nkind = \"velodyne\"\nudp_listen = \"{host}\"\n"
        ),
    )
    .unwrap();
    let vehicle = path("rover.toml");
    let [recording, live, again, original] =
        ["run.mcap", "live.json", "again.json", "original.json"].map(path);

    let endpoint = tcp(free_port());
    let edge = start(&format!(
        "robot-edge run --vehicle {} --robot rover --quiet --listen {endpoint} --record {} --summary {}",
        vehicle.display(),
        recording.display(),
        live.display()
    ));
    let session = connected(&endpoint, None);
    let key = Topic::Status.key(&"rover".parse().unwrap());
    let statuses = session.declare_subscriber(key).wait().unwrap();
    wait_for_status(&statuses, "listens", &|status| {
        status
            .devices
            .iter()
            .all(|device| device.state == DeviceState::Configuring)
    });
    lidar.power(true);
    // The fifth revolution never ends.
    wait_for_status(&statuses, "maps", &|status| status.scans_mapped == 4);
    edge.signal("INT");
    edge.ends_with(130);

    start(&format!(
        "robot-edge replay {} --vehicle {} --no-network --quiet --summary {}",
        recording.display(),
        vehicle.display(),
        again.display()
    ))
    .ends_well();
    start(&format!(
        "robot-edge replay {} --duration 0.39 --vehicle generic3d --set localization.source=static --no-network --quiet \
         --summary {}",
        packets.display(),
        original.display()
    ))
    .ends_well();
    let [live, again, original] = [live, again, original].map(|path| summary(&path));
    for summary in [&live, &again, &original] {
        assert_eq!(summary["scans"]["mapped"], 4, "{summary:#}");
        assert!(summary["layers"].as_object().unwrap().len() >= 5);
    }
    assert_eq!(
        live["layers"], original["layers"],
        "digests live and of the file"
    );
    assert_eq!(
        again["layers"], original["layers"],
        "digests of the recording and of the file"
    );
}
