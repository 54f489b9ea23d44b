use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::Duration;

use foreshore_tests::rig::Line;
use foreshore_tests::rig::relay::Direction::{self, FromTarget, ToTarget};
use foreshore_tests::rig::udp::{CAPTURED, Conditions, UdpRelay};
use robot_edge::clock;

use super::uninterrupted;

/// Longer than anything here takes: only a hang meets it.
const TIMEOUT: Duration = Duration::from_secs(20);

/// Long enough to see that nothing comes.
const QUIET_PERIOD: Duration = Duration::from_millis(150);

/// A relay, somebody who sends to it, and the target, which has heard of them.
struct Link {
    relay: UdpRelay,
    client: UdpSocket,
    target: UdpSocket,
    /// The client as the target sees it.
    flow: SocketAddr,
}

fn socket() -> UdpSocket {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    socket.set_read_timeout(Some(TIMEOUT)).unwrap();
    socket
}

fn linked() -> Link {
    let target = socket();
    let relay = UdpRelay::to(target.local_addr().unwrap()).unwrap();
    let client = socket();
    client.connect(relay.address()).unwrap();
    client.send(b"hello").unwrap();
    let (bytes, flow) = receive_from(&target);
    assert_eq!(bytes, b"hello");
    Link {
        relay,
        client,
        target,
        flow,
    }
}

fn receive_from(socket: &UdpSocket) -> (Vec<u8>, SocketAddr) {
    let mut buffer = [0; 2000];
    let (count, from) = uninterrupted(|| socket.recv_from(&mut buffer)).unwrap();
    (buffer[..count].to_vec(), from)
}

fn receive(socket: &UdpSocket) -> Vec<u8> {
    receive_from(socket).0
}

/// Everything that comes until nothing does for a while.
fn receive_all(socket: &UdpSocket) -> Vec<Vec<u8>> {
    socket.set_read_timeout(Some(QUIET_PERIOD)).unwrap();
    let mut buffer = [0; 2000];
    let mut received = Vec::new();
    let err = loop {
        match uninterrupted(|| socket.recv(&mut buffer)) {
            Ok(count) => received.push(buffer[..count].to_vec()),
            Err(err) => break err,
        }
    };
    assert_eq!(err.kind(), ErrorKind::WouldBlock);
    socket.set_read_timeout(Some(TIMEOUT)).unwrap();
    received
}

fn numbered(count: u8) -> Vec<Vec<u8>> {
    (0..count).map(|number| vec![number; 20]).collect()
}

fn send_all(socket: &UdpSocket, datagrams: &[Vec<u8>]) {
    for datagram in datagrams {
        socket.send(datagram).unwrap();
    }
}

#[test]
fn each_sender_has_a_flow_and_gets_its_own_answers() {
    let Link {
        relay,
        client,
        target,
        flow,
    } = linked();
    let other = socket();
    other.connect(relay.address()).unwrap();
    other.send(b"other").unwrap();
    let (bytes, other_flow) = receive_from(&target);
    assert_eq!(bytes, b"other");
    assert_ne!(flow, other_flow);
    target.send_to(b"to the one", flow).unwrap();
    target.send_to(b"to the other", other_flow).unwrap();
    assert_eq!(receive(&client), b"to the one");
    assert_eq!(receive(&other), b"to the other");
    assert_eq!(relay.traffic(ToTarget).delivered.packets, 2);
    assert_eq!(relay.traffic(FromTarget).delivered.bytes, 22);
}

#[test]
fn each_datagram_takes_the_delay_each_way() {
    let link = linked();
    let slow = Conditions {
        line: Line {
            delay: Duration::from_millis(30),
            ..Line::default()
        },
        jitter: Duration::from_millis(5),
        ..Conditions::default()
    };
    link.relay.set_both(slow).unwrap();
    for _ in 0..3 {
        let start = clock::now();
        link.client.send(&[7]).unwrap();
        assert_eq!(receive(&link.target), [7]);
        assert!(clock::elapsed(start) >= Duration::from_millis(30));
        link.target.send_to(&[8], link.flow).unwrap();
        assert_eq!(receive(&link.client), [8]);
        assert!(clock::elapsed(start) >= Duration::from_millis(60));
    }
}

#[test]
fn losses_copies_and_disorder_are_those_that_are_counted() {
    let link = linked();
    link.relay
        .set(
            ToTarget,
            Conditions {
                loss: 0.1,
                duplication: 0.2,
                reordering: (0.3, Duration::from_millis(20)),
                ..Conditions::default()
            },
        )
        .unwrap();
    let sent = numbered(200);
    send_all(&link.client, &sent);
    let received = receive_all(&link.target);
    let traffic = link.relay.traffic(ToTarget);
    let [lost, duplicated, reordered] =
        [traffic.lost, traffic.duplicated, traffic.reordered].map(|count| count.packets);
    assert!(lost > 5 && duplicated > 10 && reordered > 20, "{traffic:?}");
    assert_eq!(received.len() as u64, 200 + duplicated - lost);
    assert!(received.iter().all(|datagram| sent.contains(datagram)));
    assert!(!received.is_sorted());
    assert_eq!(traffic.delivered.packets, 1 + received.len() as u64);
}

#[test]
fn a_changed_bit_arrives_and_nothing_else_changes() {
    let link = linked();
    let tampering = Conditions {
        tampering: 0.5,
        ..Conditions::default()
    };
    link.relay.set(FromTarget, tampering).unwrap();
    for datagram in numbered(100) {
        link.target.send_to(&datagram, link.flow).unwrap();
    }
    let received = receive_all(&link.client);
    assert_eq!(received.len(), 100);
    let changed_bits = |(sent, received): (&Vec<u8>, &Vec<u8>)| -> u32 {
        let pairs = sent.iter().zip(received);
        pairs.map(|(one, other)| (one ^ other).count_ones()).sum()
    };
    let changed: Vec<_> = numbered(100)
        .iter()
        .zip(&received)
        .map(changed_bits)
        .collect();
    assert!(changed.iter().all(|bits| *bits <= 1));
    let tampered = link.relay.traffic(FromTarget).tampered.packets;
    assert_eq!(u64::from(changed.iter().sum::<u32>()), tampered);
    assert!((20..80).contains(&tampered));
}

#[test]
fn a_cut_swallows_what_is_under_way_and_ends() {
    let link = linked();
    let slow = Conditions {
        line: Line {
            delay: Duration::from_mins(1),
            ..Line::default()
        },
        ..Conditions::default()
    };
    link.relay.set_both(slow).unwrap();
    send_all(&link.client, &numbered(5));
    let cut = Conditions {
        blackhole: true,
        ..Conditions::default()
    };
    link.relay.set_both(cut).unwrap();
    send_all(&link.client, &numbered(5));
    link.target.send_to(b"back", link.flow).unwrap();
    assert_eq!(link.relay.traffic(ToTarget).blackholed.packets, 10);
    assert_eq!(link.relay.traffic(FromTarget).blackholed.packets, 1);
    link.relay.set_both(Conditions::default()).unwrap();
    link.client.send(b"again").unwrap();
    assert_eq!(receive_all(&link.target), [b"again"]);
    assert_eq!(receive_all(&link.client), [[0; 0]; 0]);
}

#[test]
fn a_stall_holds_everything_and_then_delivers_it() {
    let link = linked();
    let held = Conditions {
        line: Line {
            rate_bytes_per_s: Some(0),
            queue_bytes: 1 << 20,
            ..Line::default()
        },
        ..Conditions::default()
    };
    link.relay.set(ToTarget, held).unwrap();
    send_all(&link.client, &numbered(100));
    assert_eq!(receive_all(&link.target), [[0; 0]; 0]);
    link.relay.set(ToTarget, Conditions::default()).unwrap();
    assert_eq!(receive_all(&link.target), numbered(100));
}

#[test]
fn what_was_captured_can_be_sent_again() {
    let link = linked();
    send_all(&link.client, &numbered(3));
    link.target.send_to(b"answer", link.flow).unwrap();
    assert_eq!(receive(&link.client), b"answer");
    let captured = link.relay.captured(ToTarget);
    assert_eq!(captured[0], b"hello");
    assert_eq!(captured[1..], numbered(3));
    assert_eq!(link.relay.captured(FromTarget), [b"answer"]);

    assert_eq!(receive_all(&link.target), numbered(3));
    link.relay.inject(ToTarget, captured).unwrap();
    let (first, from) = receive_from(&link.target);
    assert_eq!(first, b"hello");
    assert_eq!(from, link.flow, "it cannot be told from the sender");
    assert_eq!(receive_all(&link.target), numbered(3));
    link.relay
        .inject(FromTarget, vec![b"forged".to_vec()])
        .unwrap();
    assert_eq!(receive(&link.client), b"forged");
    assert_eq!(link.relay.traffic(ToTarget).injected.packets, 4);

    for _ in 0..CAPTURED + 50 {
        link.client.send(b"x").unwrap();
        receive(&link.target);
    }
    let captured = link.relay.captured(ToTarget);
    assert_eq!(captured.len(), CAPTURED);
    assert!(captured.iter().all(|datagram| datagram == b"x"));
}

#[test]
fn a_target_that_is_away_and_comes_back_is_found_again() {
    let Link {
        relay,
        client,
        target,
        ..
    } = linked();
    let address = target.local_addr().unwrap();
    drop(target);
    for _ in 0..20 {
        client.send(b"into the void").unwrap();
        relay.traffic(ToTarget);
    }
    let target = UdpSocket::bind(address).unwrap();
    target.set_read_timeout(Some(TIMEOUT)).unwrap();
    // The kernel tells of what was refused before in place of the first of these, or the first two.
    for _ in 0..5 {
        client.send(b"back").unwrap();
        relay.traffic(ToTarget);
    }
    assert_eq!(receive(&target), b"back");
}

#[test]
fn nonsense_is_refused() {
    let relay = UdpRelay::to(([127, 0, 0, 1], 9).into()).unwrap();
    for direction in Direction::ALL {
        for rng in [-0.1, 1.1, f64::NAN] {
            let conditions = Conditions {
                tampering: rng,
                ..Conditions::default()
            };
            let refused = relay.set(direction, conditions).unwrap_err();
            assert!(refused.to_string().contains("tampering"), "{refused}");
        }
        let nobody = relay.inject(direction, vec![vec![1]]).unwrap_err();
        assert!(nobody.to_string().contains("nobody"), "{nobody}");
    }
}
