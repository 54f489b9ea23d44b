//! An operator, a router or a stranger as a process, which tests stop, kill or start in a namespace.
//!
//! ```text
//! drive-by-wire operate ENDPOINT ROBOT NAME JOURNAL.csv INPUT ...
//! drive-by-wire operate-with-keys ENDPOINT ROBOT FOLDER JOURNAL.csv INPUT ...
//! drive-by-wire route ENDPOINT
//! drive-by-wire connect ENDPOINT FOLDER
//! drive-by-wire knock FROM TO PORT KNOCKS_PER_S SECONDS PACKETS
//! ```
//!
//! An INPUT is `LINEAR_MPS,ANGULAR_RADPS,SECONDS`. The inputs are held in turn, repeatedly, until the
//! process is ended. `operate` prints `holds the lease` once it does, `route` prints `routes`.
//!
//! `connect` opens a control session with the keys of that folder and prints its duration, `N ms PROTOCOL`. `knock` is a
//! stranger that begins connections from the address FROM: TCP, and QUIC with the files of the folder PACKETS.

#![allow(
    clippy::unwrap_used,
    reason = "part of the tests: a panic here fails the test"
)]

use std::fs;
use std::io::{self, Write};
use std::net::{IpAddr, TcpStream, UdpSocket};
use std::path::Path;
use std::time::Duration;

use foreshore_tests::operator::{Input, Operator};
use network::clock::{self, sleep_until};
use network::credentials::Credentials;
use network::endpoints::Channel;
use network::sessions::{self, Endpoints, Side};
use zenoh::{Config, Wait as _};

fn main() {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let arguments: Vec<_> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["operate", endpoint, robot, name, journal, ref inputs @ ..] => {
            operate(Operator::ready(endpoint, robot, name), journal, inputs)
        }
        [
            "operate-with-keys",
            endpoint,
            robot,
            folder,
            journal,
            ref inputs @ ..,
        ] => operate(
            Operator::with_keys(endpoint, robot, Path::new(folder)),
            journal,
            inputs,
        ),
        ["route", endpoint] => route(endpoint),
        ["connect", endpoint, folder] => connect(endpoint, Path::new(folder)),
        ["knock", from, to, port, knocks_per_s, seconds, packets] => knock(
            from.parse().unwrap(),
            (to.parse().unwrap(), port.parse().unwrap()),
            knocks_per_s.parse().unwrap(),
            Duration::from_secs(seconds.parse().unwrap()),
            Path::new(packets),
        ),
        _ => panic!("{arguments:?}: see the head of drive-by-wire.rs"),
    }
}

fn operate(mut operator: Operator, journal: &str, inputs: &[&str]) -> ! {
    let inputs: Vec<_> = inputs.iter().map(|input| parse(input).unwrap()).collect();
    assert!(!inputs.is_empty(), "nothing to do");
    operator.write_journal(Path::new(journal)).unwrap();
    operator.take_lease();
    say("holds the lease");
    loop {
        for (input, time) in &inputs {
            operator.hold(*input, *time);
        }
    }
}

fn route(endpoint: &str) -> ! {
    let mut config = Config::default();
    for (key, value) in [
        ("mode", "\"router\"".to_owned()),
        ("listen/endpoints", format!("[{endpoint:?}]")),
        ("scouting/multicast/enabled", "false".to_owned()),
    ] {
        config.insert_json5(key, &value).unwrap();
    }
    let _router = zenoh::open(config).wait().unwrap();
    say("routes");
    loop {
        std::thread::park();
    }
}

fn connect(endpoint: &str, folder: &Path) {
    let endpoints = Endpoints {
        connect: vec![endpoint.to_owned()],
        credentials: Some(Credentials::open(folder).unwrap()),
        ..Endpoints::default()
    };
    let started = clock::now();
    let session = sessions::open(Side::Console, Channel::Control, &endpoints);
    let taken_ms = clock::elapsed(started).as_millis();
    let session = match session {
        Ok(session) => session,
        Err(err) => return say(&format!("{taken_ms} ms {err}")),
    };
    let link = session.info().links().wait().next().unwrap();
    say(&format!("{taken_ms} ms {}", link.dst().protocol()));
    session.close().wait().unwrap();
}

fn knock(
    from: IpAddr,
    (to, port): (IpAddr, u16),
    knocks_per_s: u32,
    time: Duration,
    packets: &Path,
) {
    let files = fs::read_dir(packets).unwrap();
    let packets: Vec<_> = files
        .map(|file| fs::read(file.unwrap().path()).unwrap())
        .collect();
    let started = clock::now();
    let (mut open, mut knocks) = (Vec::new(), 0_u32);
    while clock::elapsed(started) < time {
        let due = started + Duration::from_secs(1) * knocks / knocks_per_s;
        sleep_until(due, || false);
        // From another port each time, so that it is another connection.
        for _ in 0..2 {
            let socket = UdpSocket::bind((from, 0)).unwrap();
            let packet = &packets[knocks as usize % packets.len()];
            socket.send_to(packet, (to, port)).unwrap();
        }
        for port in [port, port + 1] {
            let knocked = TcpStream::connect_timeout(&(to, port).into(), Duration::from_millis(2));
            open.extend(knocked.ok());
        }
        open.drain(..open.len().saturating_sub(500));
        knocks += 1;
    }
    say(&format!("{knocks} knocks"));
}

fn parse(input: &str) -> Option<(Input, Duration)> {
    let mut numbers = input.split(',').map(str::parse::<f32>);
    let mut next = || numbers.next()?.ok();
    let (linear_mps, angular_radps, seconds) = (next()?, next()?, next()?);
    let time = Duration::try_from_secs_f32(seconds).ok()?;
    Some((Input::of(linear_mps, angular_radps), time))
}

fn say(words: &str) {
    let mut out = io::stdout();
    writeln!(out, "{words}").unwrap();
    out.flush().unwrap();
}
