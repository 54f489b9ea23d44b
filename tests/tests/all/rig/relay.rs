use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::thread;
use std::time::Duration;

use foreshore_tests::rig::Line;
use foreshore_tests::rig::ports::free_pair;
use foreshore_tests::rig::relay::{Direction, Relay};
use robot_edge::clock;

use super::uninterrupted;

/// Longer than anything here takes: only a hang meets it.
const TIMEOUT: Duration = Duration::from_secs(20);

/// Long enough to see that nothing comes.
const QUIET_PERIOD: Duration = Duration::from_millis(150);

fn listener() -> (TcpListener, SocketAddr) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let address = listener.local_addr().unwrap();
    (listener, address)
}

fn connect(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(TIMEOUT)).unwrap();
    stream.set_write_timeout(Some(TIMEOUT)).unwrap();
    stream.set_nodelay(true).unwrap();
    stream
}

/// A relay and both ends of a connection through it: whoever connected, and the target.
fn connected() -> (Relay, TcpStream, TcpStream) {
    let (listener, address) = listener();
    let relay = Relay::to(address).unwrap();
    let client = connect(relay.address());
    let (target, _) = listener.accept().unwrap();
    target.set_read_timeout(Some(TIMEOUT)).unwrap();
    target.set_write_timeout(Some(TIMEOUT)).unwrap();
    (relay, client, target)
}

/// Bytes of which no part is like another.
fn content(seed: u32, count: usize) -> Vec<u8> {
    let mut state = seed | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        state as u8
    };
    (0..count).map(|_| next()).collect()
}

fn read(mut stream: &TcpStream, count: usize) -> Vec<u8> {
    let mut bytes = vec![0; count];
    stream.read_exact(&mut bytes).unwrap();
    bytes
}

/// Whether not a byte comes for a while.
fn is_silent(stream: &TcpStream) -> bool {
    stream.set_read_timeout(Some(QUIET_PERIOD)).unwrap();
    let outcome = uninterrupted(|| { stream }.read(&mut [0]));
    stream.set_read_timeout(Some(TIMEOUT)).unwrap();
    outcome.is_err_and(|err| err.kind() == ErrorKind::WouldBlock)
}

/// Writes until nobody takes more; returns how many bytes that were.
fn fill(mut stream: &TcpStream) -> usize {
    stream.set_write_timeout(Some(QUIET_PERIOD)).unwrap();
    let block = content(9, 1 << 16);
    let mut total = 0;
    while let Ok(count) = uninterrupted(|| stream.write(&block)) {
        total += count;
    }
    total
}

/// Waits for what another thread is about to do.
fn eventually(what: &str, is_true: impl Fn() -> bool) {
    let start = clock::now();
    while !is_true() {
        assert!(clock::elapsed(start) < TIMEOUT, "never: {what}");
        thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn delay_and_rate_keep_order_and_content() {
    let (relay, client, target) = connected();
    let slow = Line {
        delay: Duration::from_millis(20),
        rate_bytes_per_s: Some(1_000_000),
        queue_bytes: 8_000,
    };
    for direction in Direction::ALL {
        relay.set_line(direction, slow).unwrap();
    }
    let (up, down) = (content(1, 200_000), content(2, 150_000));
    let start = clock::now();
    thread::scope(|scope| {
        scope.spawn(|| (&client).write_all(&up).unwrap());
        scope.spawn(|| (&target).write_all(&down).unwrap());
        let received = scope.spawn(|| read(&client, down.len()));
        assert!(read(&target, up.len()) == up);
        assert!(received.join().unwrap() == down);
    });
    assert!(clock::elapsed(start) >= Duration::from_millis(220));
    assert_eq!(relay.bytes_forwarded(Direction::ToTarget), 200_000);
    assert_eq!(relay.bytes_forwarded(Direction::FromTarget), 150_000);
}

#[test]
fn each_byte_takes_the_delay_each_way() {
    let (relay, mut client, mut target) = connected();
    relay.set_delay(Duration::from_millis(30)).unwrap();
    for _ in 0..3 {
        let start = clock::now();
        client.write_all(&[7]).unwrap();
        assert_eq!(read(&target, 1), [7]);
        assert!(clock::elapsed(start) >= Duration::from_millis(30));
        target.write_all(&[8]).unwrap();
        assert_eq!(read(&client, 1), [8]);
        assert!(clock::elapsed(start) >= Duration::from_millis(60));
    }
}

#[test]
fn a_stall_holds_everything_and_then_delivers_it() {
    let (relay, mut client, mut target) = connected();
    client.write_all(b"before").unwrap();
    assert_eq!(read(&target, 6), b"before");
    relay.stall().unwrap();
    let (up, down) = (content(3, 40_000), content(4, 30_000));
    client.write_all(&up).unwrap();
    target.write_all(&down).unwrap();
    let late = connect(relay.address());
    assert!(is_silent(&target) && is_silent(&client) && is_silent(&late));
    assert_eq!(relay.bytes_forwarded(Direction::ToTarget), 6);
    assert_eq!(relay.bytes_forwarded(Direction::FromTarget), 0);
    assert_eq!(relay.connections(), 1);
    relay.pass().unwrap();
    assert!(read(&target, up.len()) == up);
    assert!(read(&client, down.len()) == down);
    eventually("the late one is accepted", || {
        relay.connections_accepted() == 2
    });
}

#[test]
fn what_is_under_way_waits_for_the_end_of_a_stall() {
    let (relay, mut client, target) = connected();
    relay.set_delay(Duration::from_millis(40)).unwrap();
    client.write_all(b"under way").unwrap();
    thread::sleep(Duration::from_millis(10));
    relay.stall().unwrap();
    assert!(is_silent(&target));
    relay.set_delay(Duration::ZERO).unwrap();
    assert!(is_silent(&target), "a setting wakes the relay and no more");
    relay.pass().unwrap();
    assert_eq!(read(&target, 9), b"under way");
}

#[test]
fn a_stall_is_no_time_to_catch_up_in() {
    const RATE_BYTES_PER_S: u64 = 20_000;
    let (relay, mut client, _target) = connected();
    relay.set_rate(Some(RATE_BYTES_PER_S)).unwrap();
    let start = clock::now();
    client.write_all(&content(6, 6_000)).unwrap();
    eventually("the first bytes", || {
        relay.bytes_forwarded(Direction::ToTarget) > 0
    });
    relay.stall().unwrap();
    thread::sleep(2 * QUIET_PERIOD);
    relay.pass().unwrap();
    let forwarded = relay.bytes_forwarded(Direction::ToTarget);
    let passing_s = clock::elapsed(start)
        .saturating_sub(2 * QUIET_PERIOD)
        .as_secs_f64();
    assert!(
        forwarded as f64 <= RATE_BYTES_PER_S as f64 * passing_s + 1.0,
        "{forwarded} bytes in {passing_s} s"
    );
}

#[test]
fn a_stalled_or_slow_link_pushes_back() {
    let (relay, client, target) = connected();
    // The kernel's buffers at both ends, which grow to 4 MB each, and the relay's own.
    let most = 12 << 20;
    relay.stall().unwrap();
    let taken = fill(&client);
    assert!(taken < most, "{taken} bytes went into a stalled link");
    assert_eq!(relay.bytes_forwarded(Direction::ToTarget), 0);

    relay.set_rate(Some(1_000)).unwrap();
    relay.pass().unwrap();
    let taken = fill(&target);
    assert!(taken < most, "{taken} bytes went into a slow link");
}

#[test]
fn a_receiver_that_reads_nothing_holds_up_its_own_connection_only() {
    let (listener, address) = listener();
    let relay = Relay::to(address).unwrap();
    let greedy = connect(relay.address());
    let (_deaf, _) = listener.accept().unwrap();
    let taken = fill(&greedy);
    assert!(taken < 16 << 20, "{taken} bytes for one that reads nothing");

    let mut other = connect(relay.address());
    let (target, _) = listener.accept().unwrap();
    other.write_all(b"through").unwrap();
    assert_eq!(read(&target, 7), b"through");
}

#[test]
fn the_rate_is_kept_and_is_shared() {
    const RATE_BYTES_PER_S: u64 = 400_000;
    const BYTES: u64 = 200_000;
    let (listener, address) = listener();
    let relay = Relay::to(address).unwrap();
    relay.set_rate(Some(RATE_BYTES_PER_S)).unwrap();
    let start = clock::now();
    let pairs: Vec<_> = (0..2)
        .map(|_| (connect(relay.address()), listener.accept().unwrap().0))
        .collect();
    let counts: Vec<u64> = thread::scope(|scope| {
        let mut sinks = Vec::new();
        for (source, sink) in &pairs {
            scope.spawn(move || while uninterrupted(|| { source }.write(&[5; 4096])).is_ok() {});
            sinks.push(scope.spawn(move || {
                let mut count = 0;
                while let Ok(bytes @ 1..) = uninterrupted(|| { sink }.read(&mut [0; 4096])) {
                    count += bytes as u64;
                }
                count
            }));
        }
        eventually("enough bytes", || {
            relay.bytes_forwarded(Direction::ToTarget) >= BYTES
        });
        let elapsed_s = clock::elapsed(start).as_secs_f64();
        relay.cut().unwrap();
        let forwarded = relay.bytes_forwarded(Direction::ToTarget) as f64;
        let allowed = RATE_BYTES_PER_S as f64 * clock::elapsed(start).as_secs_f64();
        assert!(
            forwarded <= allowed,
            "{forwarded} bytes in place of {allowed}"
        );
        let expected = RATE_BYTES_PER_S as f64 * elapsed_s;
        assert!(forwarded >= 0.2 * expected, "{forwarded} of {expected}");
        sinks.into_iter().map(|sink| sink.join().unwrap()).collect()
    });
    let least = counts.iter().min().unwrap();
    assert!(*least > BYTES / 5, "one connection took it all: {counts:?}");
}

#[test]
fn a_cut_closes_refuses_and_heals() {
    let (listener, address) = listener();
    let relay = Relay::to(address).unwrap();
    for round in 1..=3 {
        let client = connect(relay.address());
        let (target, _) = listener.accept().unwrap();
        target.set_read_timeout(Some(TIMEOUT)).unwrap();
        (&client).write_all(b"hello").unwrap();
        assert_eq!(read(&target, 5), b"hello");

        relay.cut().unwrap();
        assert_eq!(relay.connections(), 0);
        for end in [&client, &target] {
            let broken = uninterrupted(|| { end }.read(&mut [0])).unwrap_err();
            assert_eq!(broken.kind(), ErrorKind::ConnectionReset);
        }
        let refused = TcpStream::connect(relay.address()).unwrap_err();
        assert_eq!(refused.kind(), ErrorKind::ConnectionRefused);
        assert_eq!(relay.connections_accepted(), round);
        relay.pass().unwrap();
    }
}

#[test]
fn the_end_of_one_stream_leaves_the_other() {
    let (relay, client, target) = connected();
    relay.set_delay(Duration::from_millis(10)).unwrap();
    (&client).write_all(b"question").unwrap();
    client.shutdown(Shutdown::Write).unwrap();
    let mut question = Vec::new();
    (&target).read_to_end(&mut question).unwrap();
    assert_eq!(question, b"question");
    (&target).write_all(b"answer").unwrap();
    drop(target);
    let mut answer = Vec::new();
    (&client).read_to_end(&mut answer).unwrap();
    assert_eq!(answer, b"answer");
    eventually("the connection is over", || relay.connections() == 0);
}

#[test]
fn a_target_that_is_not_there_resets() {
    let relay = Relay::pair(free_pair().unwrap()).unwrap();
    let client = connect(relay.address());
    let broken = uninterrupted(|| { &client }.read(&mut [0])).unwrap_err();
    assert_eq!(broken.kind(), ErrorKind::ConnectionReset);
    eventually("the connection is over", || relay.connections() == 0);
}

#[test]
fn a_pair_relays_control_and_bulk_as_one_link() {
    let target_port = free_pair().unwrap();
    let listeners = [0, 1].map(|k| TcpListener::bind((Ipv4Addr::LOCALHOST, target_port + k)));
    let relay = Relay::pair(target_port).unwrap();
    assert_eq!(relay.endpoint(), format!("tcp/127.0.0.1:{}", relay.port()));
    for (offset, listener) in (0..).zip(listeners) {
        let port = relay.port() + offset;
        let mut client = connect(SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
        let (target, _) = listener.unwrap().accept().unwrap();
        client.write_all(&[offset as u8; 3]).unwrap();
        assert_eq!(read(&target, 3), [offset as u8; 3]);
    }
    relay.cut().unwrap();
    for port in [relay.port(), relay.port() + 1] {
        let refused = TcpStream::connect((Ipv4Addr::LOCALHOST, port)).unwrap_err();
        assert_eq!(refused.kind(), ErrorKind::ConnectionRefused);
    }
}

#[test]
fn ports_that_do_not_exist_are_refused() {
    let refused = Relay::pair(u16::MAX).unwrap_err();
    assert_eq!(refused.kind(), ErrorKind::InvalidInput);
    assert!(refused.to_string().contains("65535"), "{refused}");
    let (_taken, address) = listener();
    let taken = Relay::at(address.port(), address).unwrap_err();
    assert_eq!(taken.kind(), ErrorKind::AddrInUse);
    assert!(taken.to_string().contains(&address.to_string()), "{taken}");
}

#[test]
fn nothing_is_left_of_a_dropped_relay() {
    let (relay, client, target) = connected();
    (&client).write_all(b"lost").unwrap();
    let name = format!("relay-{}", relay.port());
    let threads = || {
        let tasks = fs::read_dir("/proc/self/task").unwrap();
        let names = tasks.map(|task| fs::read_to_string(task.unwrap().path().join("comm")));
        names
            .filter(|found| found.as_ref().is_ok_and(|found| found.trim() == name))
            .count()
    };
    assert_eq!(threads(), 1);
    let address = relay.address();
    drop(relay);
    eventually("the thread is gone", || threads() == 0);
    assert!(TcpStream::connect(address).is_err());
    drop((client, target));
    let _again = Relay::at(address.port(), address).unwrap();
}
