//! The link between two namespaces, checked with real packets.

use std::net::{SocketAddr, UdpSocket};
use std::path::Path;
use std::time::Duration;

use foreshore_tests::rig::tun::{Namespaces, Side, Unavailable};
use foreshore_tests::rig::{Conditions, Line};
use robot_edge::clock;

use crate::skip::skip;

/// Longer than any step here takes.
const TIMEOUT: Duration = Duration::from_secs(20);

/// Without data for this long, a socket counts as silent.
const QUIET_PERIOD: Duration = Duration::from_millis(150);

/// An emulated link; `None`, and a skipped test, if this machine or user cannot have one.
pub(crate) fn namespaces(seed: u64) -> Option<Namespaces> {
    match Namespaces::create(seed) {
        Ok(namespaces) => Some(namespaces),
        Err(Unavailable::Lacking(lacks)) => {
            skip(&lacks, "root, the kernel's TUN driver and package iproute2");
            None
        }
        Err(Unavailable::Failed(message)) => panic!("{message}"),
    }
}

fn receive(socket: &UdpSocket) -> (Vec<u8>, SocketAddr) {
    let mut buffer = [0; 2000];
    let (count, from) = socket.recv_from(&mut buffer).unwrap();
    (buffer[..count].to_vec(), from)
}

/// Datagrams until none arrives for [`QUIET_PERIOD`].
fn receive_all(socket: &UdpSocket) -> Vec<Vec<u8>> {
    socket.set_read_timeout(Some(QUIET_PERIOD)).unwrap();
    let mut buffer = [0; 2000];
    let next = || {
        socket
            .recv(&mut buffer)
            .ok()
            .map(|count| buffer[..count].to_vec())
    };
    let received = std::iter::from_fn(next).collect();
    socket.set_read_timeout(Some(TIMEOUT)).unwrap();
    received
}

#[test]
fn namespaces_carry_packets_under_conditions_and_disappear() {
    let Some(link) = namespaces(0) else { return };
    let files = Side::ALL.map(|side| Path::new("/var/run/netns").join(link.name(side)));
    assert!(files.iter().all(|file| file.exists()));
    let [near, far] = Side::ALL.map(|side| {
        let bound = link.within(side, || UdpSocket::bind((side.address(), 4000)));
        bound.unwrap().unwrap()
    });
    near.connect((Side::B.address(), 4000)).unwrap();
    far.set_read_timeout(Some(TIMEOUT)).unwrap();

    link.set_both(Conditions {
        line: Line {
            delay: Duration::from_millis(30),
            rate_bytes_per_s: Some(50_000),
            queue_bytes: 10_000,
        },
        ..Conditions::default()
    })
    .unwrap();
    let start = clock::now();
    for number in 0..100 {
        near.send(&[number; 1000]).unwrap();
    }
    for number in 0..9 {
        assert_eq!(receive(&far).0, [number; 1000]);
    }
    // 8 packets of 1028 bytes at 50 kB/s, and the delay.
    assert!(clock::elapsed(start) >= Duration::from_millis(30 + 164));
    assert!(link.traffic_from(Side::A).overflowed.packets > 0);
    receive_all(&far);

    link.set_both(Conditions {
        loss: 0.2,
        ..Conditions::default()
    })
    .unwrap();
    let before = link.traffic_from(Side::A);
    for number in 0..200 {
        near.send(&[number]).unwrap();
    }
    let received = receive_all(&far).len() as u64;
    let lost = link.traffic_from(Side::A).lost.packets;
    assert!((20..=60).contains(&lost), "{lost} of 200");
    let delivered = link.traffic_from(Side::A).delivered.packets - before.delivered.packets;
    assert_eq!((received, delivered), (200 - lost, 200 - lost));
    drop(link);
    assert!(!files.iter().any(|file| file.exists()), "{files:?}");
}
