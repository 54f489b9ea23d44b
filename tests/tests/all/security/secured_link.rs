//! A console watches a robot over QUIC and TLS.

use std::collections::BTreeSet;
use std::fs;
use std::net::UdpSocket;
use std::time::Duration;

use robot_edge::clock;
use robot_edge::credentials::{Credentials, OperatorList};
use robot_edge::network::endpoints::Channel;
use robot_edge::network::sessions::{self, Endpoints, Side};
use zenoh::qos::Reliability;
use zenoh::session::Link;
use zenoh::{Session, Wait as _};

use crate::link::processes::{Running, assert_same_maps, free_port, program, rooms};

use crate::fleet::Fleet;

/// A script that requests the lease, turns for a second and releases the lease.
pub(super) const TURNS: &str = "\
0.0 lease request
0.0 await lease
0.5 press left
0.5 await driving
1.5 release left
1.5 await held
2.0 lease release
2.0 await idle
";

#[test]
fn a_console_with_keys_gets_the_map_by_quic_and_tls() {
    let fleet = Fleet::new();
    let port = free_port();
    let mut edge = program("robot-edge");
    edge.arg("replay").arg(rooms());
    edge.args(["--rate", "20", "--keep-serving", "--listen"]);
    edge.arg(format!("quic/127.0.0.1:{port}"));
    edge.arg("--keys").arg(fleet.vehicle());
    edge.arg("--export").arg(fleet.scratch("edge"));
    let edge = Running::start(&mut edge, "edge");
    let mut console = program("operator-console");
    console.args(["--headless", "--for", "100", "--connect"]);
    console.arg(format!("quic/127.0.0.1:{port}"));
    console.arg("--keys").arg(fleet.person("tv"));
    console.arg("--export").arg(fleet.scratch("console"));
    Running::start(&mut console, "console").ends_well();
    edge.signal("INT");
    edge.ends_well();
    assert_same_maps(&fleet.scratch("edge"), &fleet.scratch("console"));
}

#[test]
fn a_console_with_keys_drives_under_its_own_name() {
    let fleet = Fleet::new();
    let endpoint = format!("quic/127.0.0.1:{}", free_port());
    let mut edge = program("robot-edge");
    edge.args([
        "simulate",
        "rooms",
        "--quiet",
        "--keep-serving",
        "--listen",
        &endpoint,
    ]);
    let _edge = Running::start(edge.arg("--keys").arg(fleet.vehicle()), "edge");
    let script = fleet.scratch("drive.txt");
    fs::write(&script, TURNS).unwrap();
    let mut console = program("operator-console");
    console.args(["--headless", "--connect", &endpoint]);
    console.arg("--keys").arg(fleet.person("anna"));
    console.args(["drive", "--script"]).arg(&script);
    let printed = Running::start(&mut console, "console").ends_well();
    assert!(printed.contains(" Driving, lease of anna"), "{printed}");
}

/// By its certificate, without a robot.
#[test]
fn an_observers_script_is_refused_at_once() {
    let fleet = Fleet::new();
    let endpoint = format!("quic/127.0.0.1:{}", free_port());
    let script = fleet.scratch("stop.txt");
    fs::write(&script, "0.0 estop\n0.0 await estop 6\n").unwrap();
    let printed_to = |name| {
        let mut console = program("operator-console");
        console.args(["--headless", "--timeout", "1", "--connect", &endpoint]);
        console.arg("--keys").arg(fleet.person(name));
        console.args(["drive", "--script"]).arg(&script);
        let ended = console.output().unwrap();
        (
            ended.status.code(),
            String::from_utf8(ended.stderr).unwrap(),
        )
    };
    let words = "Observers neither drive nor stop the vehicle";
    let (code, printed) = printed_to("tv");
    assert!(
        code == Some(2) && printed.contains(words),
        "{code:?}: {printed}"
    );
    for name in ["anna", "sam"] {
        let (code, printed) = printed_to(name);
        assert!(
            code != Some(2) && !printed.contains(words),
            "{code:?}: {printed}"
        );
    }
}

fn open(side: Side, fleet: &Fleet, endpoint: String) -> Session {
    let (listen, connect, folder) = match side {
        Side::Edge => (vec![endpoint], vec![], fleet.vehicle()),
        Side::Console => (vec![], vec![endpoint], fleet.person("anna")),
    };
    let endpoints = Endpoints {
        listen,
        connect,
        credentials: Some(Credentials::open(&folder).unwrap()),
        operators: OperatorList::read(&fleet.vehicle().join("operators.toml")).unwrap(),
        ..Endpoints::default()
    };
    sessions::open(side, Channel::Control, &endpoints).unwrap()
}

#[test]
fn poses_are_datagrams_beside_a_stream() {
    let (fleet, port) = (Fleet::new(), free_port());
    let endpoint = format!("quic/127.0.0.1:{port}");
    let vehicle = open(Side::Edge, &fleet, endpoint.clone());
    let console = open(Side::Console, &fleet, endpoint);
    let links: Vec<_> = console.info().links().wait().collect();
    let kinds: BTreeSet<_> = links.iter().map(Link::is_streamed).collect();
    assert_eq!(kinds, BTreeSet::from([false, true]), "{links:?}");
    assert!(
        links
            .iter()
            .all(|link| link.auth_identifier() == Some("vehicle:scout"))
    );

    let samples = console
        .declare_subscriber("foreshore/scout/pose")
        .wait()
        .unwrap();
    let started = clock::now();
    for (reliability, expected) in [
        (Reliability::BestEffort, Reliability::BestEffort),
        (Reliability::Reliable, Reliability::Reliable),
    ] {
        let heard = loop {
            assert!(clock::elapsed(started) < Duration::from_secs(20));
            let put = vehicle.put("foreshore/scout/pose", "x");
            put.reliability(reliability).wait().unwrap();
            let sample = samples.recv_timeout(Duration::from_millis(50)).unwrap();
            if let Some(sample) = sample.filter(|sample| sample.reliability() == expected) {
                break sample.reliability();
            }
        };
        assert_eq!(heard, expected);
    }
    console.close().wait().unwrap();
    vehicle.close().wait().unwrap();
}

#[test]
fn control_uses_tls_when_udp_is_blocked() {
    let (fleet, port) = (Fleet::new(), free_port());
    let vehicle = open(Side::Edge, &fleet, format!("tls/127.0.0.1:{port}"));
    // A socket that receives UDP and does not answer.
    let _hole = UdpSocket::bind(("127.0.0.1", port)).unwrap();
    let console = open(Side::Console, &fleet, format!("quic/127.0.0.1:{port}"));
    let link = console.info().links().wait().next().unwrap();
    assert_eq!(link.dst().protocol().as_str(), "tls");
    console.close().wait().unwrap();
    vehicle.close().wait().unwrap();
}
