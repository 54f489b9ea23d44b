//! A three-dimensional lidar whose packets come from the network: the same maps as from its recording.

use std::fs;
use std::path::Path;
use std::time::Duration;

use emulators::Emulator;
use emulators::packets::Packets;
use foreshore_tests::operator::connected;
use network::clock;
use protocol::keys::Topic;
use protocol::message::{DeviceState, Status};
use protocol::wire;
use serde_json::Value;
use tempfile::tempdir;
use zenoh::Wait as _;

use crate::processes::{free_port, start, tcp};
use crate::shared_data::shared_data;

const TIMEOUT: Duration = Duration::from_mins(1);

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
    let wait_for = |what: &str, is_so: &dyn Fn(&Status) -> bool| {
        let started = clock::now();
        let mut last = None;
        loop {
            assert!(
                clock::elapsed(started) < TIMEOUT,
                "{what} in vain: {last:?}"
            );
            let Ok(Some(sample)) = statuses.recv_timeout(Duration::from_secs(1)) else {
                continue;
            };
            let (_, status): (_, Status) = wire::decode(&sample.payload().to_bytes()).unwrap();
            if is_so(&status) {
                return;
            }
            last = Some(status);
        }
    };
    wait_for("listens", &|status| {
        status
            .devices
            .iter()
            .all(|device| device.state == DeviceState::Configuring)
    });
    lidar.power(true);
    // The fifth revolution never ends.
    wait_for("maps", &|status| status.scans_mapped == 4);
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
