//! A stranger who begins 100 connections a second, in network namespaces, with the shipped rate limit.

use std::ffi::OsStr;
use std::fs;
use std::net::UdpSocket;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use network::clock;
use network::endpoints::Channel;
use network::sessions::{self, Side};

use crate::fleet::Fleet;
use crate::processes::{Running, SERVED, program};

const VEHICLE: &str = "10.77.0.1";
const STRANGER: &str = "10.77.0.66";
const OPERATOR: &str = "10.77.0.2";
/// The ports of the shipped rules.
const PORT: u16 = 7447;
const KNOCKS_PER_S: u32 = 100;
const FLOOD: Duration = Duration::from_secs(20);

fn ip(arguments: &str) {
    let mut ip = Command::new("ip");
    let done = ip.args(arguments.split(' ')).status().unwrap();
    assert!(done.success(), "ip {arguments}");
}

/// Three namespaces on one bridge, removed on drop.
struct Lan(String);

impl Lan {
    fn new() -> Self {
        let lan = Self(format!("fs{}", std::process::id()));
        let vehicle = format!("{}v", lan.0);
        ip(&format!("netns add {vehicle}"));
        ip(&format!("-n {vehicle} link add name lan type bridge"));
        ip(&format!("-n {vehicle} addr add {VEHICLE}/24 dev lan"));
        ip(&format!("-n {vehicle} link set dev lan up"));
        for (part, address) in [("s", STRANGER), ("o", OPERATOR)] {
            let name = format!("{}{part}", lan.0);
            let peer = format!("type veth peer name eth0 netns {name}");
            ip(&format!("netns add {name}"));
            ip(&format!("-n {vehicle} link add {part} {peer}"));
            ip(&format!("-n {vehicle} link set dev {part} master lan up"));
            ip(&format!("-n {name} addr add {address}/24 dev eth0"));
            ip(&format!("-n {name} link set dev eth0 up"));
        }
        lan
    }

    /// A command in one of the namespaces.
    fn within(&self, part: &str, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &format!("{}{part}", self.0)]);
        command.arg(program);
        command
    }
}

impl Drop for Lan {
    fn drop(&mut self) {
        for part in ["s", "o", "v"] {
            let name = format!("{}{part}", self.0);
            drop(Command::new("ip").args(["netns", "del", &name]).status());
        }
    }
}

/// The first QUIC packets of a console.
fn first_packets(fleet: &Fleet) -> Vec<Vec<u8>> {
    let sink = UdpSocket::bind("127.0.0.1:0").unwrap();
    sink.set_read_timeout(Some(Duration::from_millis(200)))
        .unwrap();
    let endpoints = fleet.endpoints("tv", format!("quic/{}", sink.local_addr().unwrap()));
    let mut packets: Vec<Vec<u8>> = Vec::new();
    for _ in 0..4 {
        assert!(sessions::open(Side::Console, Channel::Control, &endpoints).is_err());
        let mut packet = [0; 2048];
        while let Ok((bytes, _)) = sink.recv_from(&mut packet) {
            packets.push(packet[..bytes].to_vec());
        }
    }
    packets
}

#[test]
#[ignore = "needs root and nft, takes half a minute"]
fn a_flood_of_connections_keeps_no_operator_out() {
    let fleet = Fleet::new();
    let root = fleet.root();
    // A certificate with the vehicle's address.
    let vehicle = root.join("vehicles/scout");
    fs::remove_file(vehicle.join("link.pem")).unwrap();
    let made = fleet.keys(&format!("--robot scout --host {VEHICLE}"));
    assert!(made.status.success(), "{made:?}");
    let packets = fleet.scratch("packets");
    fs::create_dir(&packets).unwrap();
    for (number, packet) in first_packets(&fleet).into_iter().enumerate() {
        fs::write(packets.join(number.to_string()), packet).unwrap();
    }

    let lan = Lan::new();
    let rules = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robot-edge/deploy/foreshore.nft");
    let is_limited = std::env::var_os("FORESHORE_NO_NFT").is_none();
    if is_limited {
        let mut load = lan.within("v", "nft");
        let loaded = load.arg("-f").arg(rules).status().unwrap();
        assert!(loaded.success(), "package nftables");
    }
    let mut edge = lan.within("v", program("robot-edge"));
    let options = fleet.edge("--listen", &format!("quic/{VEHICLE}:{PORT}"));
    edge.args(format!("simulate rooms {SERVED} {options}").split(' '));
    let mut edge = Running::start(&mut edge, "edge");
    clock::sleep_until(clock::now() + Duration::from_secs(3), || false);
    let (person, drive_by_wire) = (root.join("people/anna"), program("drive-by-wire"));
    let connect = || {
        let mut connect = lan.within("o", &drive_by_wire);
        connect.args(["connect", &format!("quic/{VEHICLE}:{PORT}")]);
        let printed = Running::start(connect.arg(&person), "operator").ends_well();
        print!("connected after {printed}");
        assert!(["quic", "tls"].contains(&printed.trim_end().rsplit(' ').next().unwrap()));
        printed.split(' ').next().unwrap().parse::<u64>().unwrap()
    };
    let quiet_ms = connect();
    let before = edge.memory();
    let mut knock = lan.within("s", &drive_by_wire);
    knock.args(["knock", STRANGER, VEHICLE, &PORT.to_string()]);
    knock.args([KNOCKS_PER_S, FLOOD.as_secs() as u32].map(|number| number.to_string()));
    let flood = Running::start(knock.arg(&packets), "stranger");
    clock::sleep_until(clock::now() + Duration::from_secs(3), || false);
    let mut slowest_ms = 0;
    for _ in 0..10 {
        slowest_ms = slowest_ms.max(connect());
        clock::sleep_until(clock::now() + Duration::from_millis(700), || false);
    }
    let grown = edge.memory().saturating_sub(before);
    let printed = flood.ends_well();
    assert!(printed.contains("knocks"), "{printed}");
    println!(
        "quiet {quiet_ms} ms, slowest {slowest_ms} ms, memory +{} kB",
        grown / 1024
    );
    assert!(edge.is_running());
    assert!(slowest_ms <= 1000, "{slowest_ms} ms");
    assert!(grown < 20 << 20, "{grown} bytes");
}
