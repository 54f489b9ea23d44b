//! TLS links that break while both ends send.

#![cfg(test)]

use std::collections::BTreeMap;
use std::io::{Read as _, Write as _};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::{self, sleep};
use std::time::Duration;

use network::credentials::{Credentials, FleetFolder, IssueRequest, issue};
use serde_json::json;
use zenoh::{Config, Session, Wait as _};

const BREAKS: usize = 400;
const AT_ONCE: usize = 8;

/// Both ends are let in by their certificates, and may do anything.
fn session(credentials: &Credentials, mode: &str, [listen, connect]: [Option<u16>; 2]) -> Session {
    let endpoint = |port: u16| format!("tls/127.0.0.1:{port}");
    let settings = json!({
        "mode": mode,
        "listen": { "endpoints": listen.map(endpoint).as_slice() },
        "connect": { "endpoints": connect.map(endpoint).as_slice(), "timeout_ms": 6000 },
        "scouting": { "multicast": { "enabled": false } },
        "transport": { "link": { "tls": {
            "enable_mtls": true,
            "root_ca_certificate": credentials.ca_certificate(),
            "listen_certificate": credentials.link_certificate(),
            "listen_private_key": credentials.link_key(),
            "connect_certificate": credentials.link_certificate(),
            "connect_private_key": credentials.link_key(),
        } } },
    });
    zenoh::open(Config::from_json5(&settings.to_string()).unwrap())
        .wait()
        .unwrap()
}

fn pass_on(mut from: TcpStream, mut to: TcpStream, bytes: &AtomicUsize) {
    let mut buffer = vec![0; 1 << 16];
    while let Ok(length @ 1..) = from.read(&mut buffer) {
        bytes.fetch_add(length, Ordering::Relaxed);
        if to.write_all(&buffer[..length]).is_err() {
            break;
        }
    }
}

/// Passes one connection on to `to`, and breaks it once both ends have sent much.
fn relay(listener: &TcpListener, to: SocketAddr) {
    let (client, _) = listener.accept().unwrap();
    let server = TcpStream::connect(to).unwrap();
    let bytes = [AtomicUsize::new(0), AtomicUsize::new(0)];
    thread::scope(|scope| {
        let [a, b] =
            [&client, &server].map(|end| (end.try_clone().unwrap(), end.try_clone().unwrap()));
        scope.spawn(|| pass_on(a.0, b.0, &bytes[0]));
        scope.spawn(|| pass_on(b.1, a.1, &bytes[1]));
        while bytes
            .iter()
            .any(|bytes| bytes.load(Ordering::Relaxed) < 1 << 18)
        {
            sleep(Duration::from_millis(1));
        }
        for end in [&client, &server] {
            drop(end.shutdown(Shutdown::Both));
        }
    });
}

#[test]
fn links_that_break_while_both_ends_send_end_in_errors() {
    let folder = tempfile::tempdir().unwrap();
    let fleet = FleetFolder::new(folder.path().join("fleet"));
    let (robot, person) = ("scout".parse().unwrap(), "anna".parse().unwrap());
    issue(&IssueRequest {
        folder: folder.path().join("fleet"),
        vehicles: vec![robot],
        people: BTreeMap::from([(person, teleop::Role::Operator)]),
        days: 1,
        ..IssueRequest::default()
    })
    .unwrap();
    let [vehicle, person] = [
        fleet.vehicle(&"scout".parse().unwrap()),
        fleet.person(&"anna".parse().unwrap()),
    ]
    .map(|folder| Credentials::open(&folder).unwrap());
    let free = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    let edge = session(&vehicle, "peer", [Some(free.port()), None]);
    let _views = edge.declare_subscriber("up").callback(drop).wait().unwrap();
    let (is_over, begun) = (AtomicBool::new(false), AtomicUsize::new(0));
    thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::Relaxed) {
                edge.put("down", vec![0; 1 << 14]).wait().unwrap();
            }
        });
        let console = || {
            while begun.fetch_add(1, Ordering::Relaxed) < BREAKS {
                let listener = TcpListener::bind("127.0.0.1:0").unwrap();
                let port = listener.local_addr().unwrap().port();
                let relayed = thread::spawn(move || relay(&listener, free));
                let console = session(&person, "client", [None, Some(port)]);
                let tiles = console.declare_subscriber("down").callback(drop);
                let _tiles = tiles.wait().unwrap();
                while !relayed.is_finished() {
                    console.put("up", vec![0; 1 << 14]).wait().unwrap();
                }
                relayed.join().unwrap();
                console.close().wait().unwrap();
            }
        };
        let consoles: Vec<_> = (0..AT_ONCE).map(|_| scope.spawn(console)).collect();
        let ended: Vec<_> = consoles
            .into_iter()
            .map(thread::ScopedJoinHandle::join)
            .collect();
        is_over.store(true, Ordering::Relaxed);
        assert!(ended.iter().all(Result::is_ok));
    });
    edge.close().wait().unwrap();
}
