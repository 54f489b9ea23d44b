use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::thread;
use std::time::Duration;

use foreshore_tests::rig::Line;
use foreshore_tests::rig::tun::{Conditions, Namespaces, Side, Traffic};
use robot_edge::clock;

use super::{namespaces, uninterrupted};

/// Longer than anything here takes: only a hang meets it.
const TIMEOUT: Duration = Duration::from_secs(20);

/// Long enough to see that nothing comes.
const QUIET_PERIOD: Duration = Duration::from_millis(150);

/// IPv4 and UDP headers.
const UDP_HEADERS_BYTES: u64 = 28;

/// A socket on each side, connected to each other.
fn sockets(link: &Namespaces) -> [UdpSocket; 2] {
    let bind = |side: Side| {
        let bound = link.within(side, || UdpSocket::bind((side.address(), 4000)));
        bound.unwrap().unwrap()
    };
    let sockets = Side::ALL.map(bind);
    for (side, socket) in Side::ALL.into_iter().zip(&sockets) {
        socket.connect((side.other().address(), 4000)).unwrap();
        socket.set_read_timeout(Some(TIMEOUT)).unwrap();
    }
    sockets
}

fn receive(socket: &UdpSocket, packet: &mut [u8]) {
    uninterrupted(|| socket.recv(packet)).unwrap();
}

fn is_silent(socket: &UdpSocket) -> bool {
    socket.set_read_timeout(Some(QUIET_PERIOD)).unwrap();
    let outcome = uninterrupted(|| socket.recv(&mut [0; 2000]));
    socket.set_read_timeout(Some(TIMEOUT)).unwrap();
    outcome.is_err_and(|err| err.kind() == ErrorKind::WouldBlock)
}

/// Waits until nothing from `side` is under way, and that `packets` have been sent.
fn arrived(link: &Namespaces, side: Side, packets: u64) -> Traffic {
    let start = clock::now();
    loop {
        let traffic = link.traffic_from(side);
        let done = [
            traffic.delivered,
            traffic.lost,
            traffic.overflowed,
            traffic.blackholed,
            traffic.refused,
        ];
        let (done_packets, done_bytes) = done
            .iter()
            .fold((0, 0), |sum, one| (sum.0 + one.packets, sum.1 + one.bytes));
        if done_packets >= packets {
            assert_eq!(traffic.sent.packets, packets, "{traffic:?}");
            assert_eq!(traffic.sent.bytes, done_bytes, "{traffic:?}");
            return traffic;
        }
        assert!(clock::elapsed(start) < TIMEOUT, "{traffic:?}");
        thread::sleep(Duration::from_millis(1));
    }
}

fn line(delay_ms: u64) -> Line {
    Line {
        delay: Duration::from_millis(delay_ms),
        ..Line::default()
    }
}

#[test]
fn a_packet_takes_the_delay_each_way() {
    let Some(link) = namespaces(0) else { return };
    let [near, far] = sockets(&link);
    link.set_both(Conditions {
        line: line(30),
        jitter: Duration::from_millis(10),
        ..Conditions::default()
    })
    .unwrap();
    let mut round_trips_ms = Vec::new();
    for ping in 0..8 {
        let start = clock::now();
        near.send(&[ping; 50]).unwrap();
        let mut packet = [0; 50];
        receive(&far, &mut packet);
        far.send(&packet).unwrap();
        packet.fill(0xff);
        receive(&near, &mut packet);
        assert_eq!(packet, [ping; 50]);
        round_trips_ms.push(clock::elapsed(start).as_secs_f64() * 1e3);
    }
    round_trips_ms.sort_by(f64::total_cmp);
    println!("round trips of 60 to 80 ms: {round_trips_ms:.1?}");
    assert!(round_trips_ms[0] >= 60.0);
    assert!(round_trips_ms[0] < 1000.0, "{round_trips_ms:?}");
    for side in Side::ALL {
        let traffic = link.traffic_from(side);
        assert_eq!(traffic.delivered.packets, 8);
        assert_eq!(traffic.delivered.bytes, 8 * (50 + UDP_HEADERS_BYTES));
        assert_eq!(traffic.delivered, traffic.sent, "nothing but what was sent");
    }
}

#[test]
fn jitter_keeps_packets_in_order() {
    let Some(link) = namespaces(0) else { return };
    let [near, far] = sockets(&link);
    link.set_both(Conditions {
        jitter: Duration::from_millis(20),
        ..Conditions::default()
    })
    .unwrap();
    for number in 0..100 {
        near.send(&[number]).unwrap();
    }
    for number in 0..100 {
        let mut packet = [0];
        receive(&far, &mut packet);
        assert_eq!(packet, [number]);
    }
}

#[test]
fn losses_are_as_many_as_set_and_the_same_for_a_seed() {
    let lossy = Conditions {
        loss: 0.2,
        ..Conditions::default()
    };
    let mut outcomes = Vec::new();
    for _ in 0..2 {
        let Some(link) = namespaces(0) else { return };
        let [near, far] = sockets(&link);
        link.set(Side::A, lossy).unwrap();
        far.set_nonblocking(true).unwrap();
        let mut received = Vec::new();
        for block in 1..=20_u64 {
            for number in 0..50 {
                near.send(&[number]).unwrap();
            }
            arrived(&link, Side::A, block * 50);
            let mut packet = [0];
            while far.recv(&mut packet).is_ok() {
                received.push(packet[0]);
            }
        }
        let traffic = link.traffic_from(Side::A);
        println!("{} of 1000 lost", traffic.lost.packets);
        assert!((150..=250).contains(&traffic.lost.packets), "{traffic:?}");
        assert_eq!(traffic.delivered.packets, received.len() as u64);
        far.send(&[1]).unwrap();
        receive(&near, &mut [0]);
        outcomes.push(received);
    }
    assert_eq!(outcomes[0], outcomes[1]);
}

#[test]
fn a_full_queue_drops_its_tail() {
    const QUEUE_BYTES: usize = 10_000;
    const RATE_BYTES_PER_S: u64 = 50_000;
    const PACKET_BYTES: u64 = 1000 + UDP_HEADERS_BYTES;
    let Some(link) = namespaces(0) else { return };
    let [near, far] = sockets(&link);
    link.set_both(Conditions {
        line: Line {
            rate_bytes_per_s: Some(RATE_BYTES_PER_S),
            queue_bytes: QUEUE_BYTES,
            ..Line::default()
        },
        ..Conditions::default()
    })
    .unwrap();
    let start = clock::now();
    for number in 0..100 {
        near.send(&[number; 1000]).unwrap();
    }
    let traffic = arrived(&link, Side::A, 100);
    println!("{traffic:?}");
    let elapsed_s = clock::elapsed(start).as_secs_f64();
    assert!(traffic.delivered.packets >= 9 && traffic.overflowed.packets > 0);
    assert!(
        traffic.delivered.bytes as f64 <= RATE_BYTES_PER_S as f64 * elapsed_s + 1.0,
        "{traffic:?} in {elapsed_s} s"
    );
    assert_eq!(traffic.sent.bytes, 100 * PACKET_BYTES);
    for number in 0..9 {
        let mut packet = [0; 1000];
        receive(&far, &mut packet);
        assert_eq!(
            packet, [number; 1000],
            "the first are those that found room"
        );
    }
}

#[test]
fn tcp_comes_through_whole() {
    const BYTES: usize = 150_000;
    let Some(link) = namespaces(0) else { return };
    link.set_both(Conditions {
        line: line(5),
        loss: 0.01,
        ..Conditions::default()
    })
    .unwrap();
    let listener = link.within(Side::B, || TcpListener::bind((Side::B.address(), 4000)));
    let listener = listener.unwrap().unwrap();
    let client = link.within(Side::A, || TcpStream::connect((Side::B.address(), 4000)));
    let (mut client, (mut server, _)) = (client.unwrap().unwrap(), listener.accept().unwrap());
    let content: Vec<u8> = (0..BYTES).map(|k| (k % 251) as u8).collect();
    thread::scope(|scope| {
        scope.spawn(|| {
            client.write_all(&content).unwrap();
            drop(client);
        });
        let mut received = Vec::new();
        server.set_read_timeout(Some(TIMEOUT)).unwrap();
        server.read_to_end(&mut received).unwrap();
        assert!(received == content);
    });
    let traffic = link.traffic_from(Side::A);
    println!("{BYTES} bytes of TCP: {traffic:?}");
    // 40 bytes of headers or more for each 1460 of content.
    assert!(traffic.sent.bytes > BYTES as u64 * 1500 / 1460);
    assert!(
        link.traffic_from(Side::B).sent.packets > 10,
        "acknowledgements"
    );
}

#[test]
fn a_blackhole_passes_nothing_and_ends() {
    let Some(link) = namespaces(0) else { return };
    let [near, far] = sockets(&link);
    link.set(
        Side::A,
        Conditions {
            line: line(100),
            ..Conditions::default()
        },
    )
    .unwrap();
    near.send(b"under way").unwrap();
    let hole = Conditions {
        blackhole: true,
        ..Conditions::default()
    };
    link.set_both(hole).unwrap();
    near.send(b"into it").unwrap();
    far.send(b"the other way").unwrap();
    assert!(is_silent(&far) && is_silent(&near));
    assert_eq!(arrived(&link, Side::A, 2).blackholed.packets, 2);
    assert_eq!(arrived(&link, Side::B, 1).blackholed.packets, 1);

    link.set_both(Conditions::default()).unwrap();
    near.send(b"healed").unwrap();
    let mut packet = [0; 6];
    receive(&far, &mut packet);
    assert_eq!(&packet, b"healed");
}

#[test]
fn a_loss_that_is_no_probability_is_refused() {
    let Some(link) = namespaces(0) else { return };
    for loss in [-0.1, 1.1, f64::NAN] {
        let conditions = Conditions {
            loss,
            ..Conditions::default()
        };
        let refused = link.set_both(conditions).unwrap_err();
        assert_eq!(refused.kind(), ErrorKind::InvalidInput);
    }
}

#[test]
fn commands_run_inside_and_outside_nothing_is_seen() {
    let Some(link) = namespaces(0) else { return };
    for side in Side::ALL {
        let output = link.command(side, "ip").args(["-o", "addr"]).output();
        let inside = String::from_utf8(output.unwrap().stdout).unwrap();
        assert!(
            inside.contains(&format!("{}/30", side.address())),
            "{inside}"
        );
        assert!(!inside.contains("inet6 fe80"), "{inside}");
    }
    let outside = UdpSocket::bind((Side::A.address(), 0)).unwrap_err();
    assert_eq!(outside.kind(), ErrorKind::AddrNotAvailable);
}

#[test]
fn namespaces_are_gone_afterwards_even_after_a_panic() {
    let Some(link) = namespaces(0) else { return };
    let files = Side::ALL.map(|side| Path::new("/var/run/netns").join(link.name(side)));
    assert!(files.iter().all(|file| file.exists()));
    let Some(other) = namespaces(0) else { return };
    assert_ne!(other.name(Side::A), link.name(Side::A));
    let panicked = catch_unwind(AssertUnwindSafe(move || {
        let result = link.within(Side::A, || panic!("on purpose"));
        result.unwrap()
    }));
    let message = panicked.unwrap_err();
    assert_eq!(*message.downcast::<&str>().unwrap(), "on purpose");
    assert!(!files.iter().any(|file| file.exists()), "{files:?}");
    assert!(other.within(Side::B, || ()).is_ok(), "others stay");
}
