//! A console watches and drives a robot over QUIC and TLS, also on networks that pass TCP and drop UDP: then control uses TLS
//! instead of QUIC, and the console reports it.

use std::collections::BTreeSet;
use std::fs;
use std::net::TcpStream;
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::rig::relay::Relay;
use foreshore_tests::rig::udp::UdpRelay;
use foreshore_tests::rig::{Conditions, Direction};
use network::clock;
use operator_console::link::{RobotSession, Transport};
use protocol::layer::LayerId;
use zenoh::Wait as _;
use zenoh::qos::Reliability;
use zenoh::session::Link;

use super::{person, vehicle};
use crate::fleet::{Fleet, quic};
use crate::link::{is_live, open_session};
use crate::processes::{Running, assert_same_maps, free_port, rooms, start, wait_until};

fn robot(fleet: &Fleet, endpoint: &str) -> Running {
    let options = fleet.edge("--listen", endpoint);
    start(&format!(
        "robot-edge simulate rooms --quiet --keep-serving {options}"
    ))
}

/// Starts a console that plays this script.
fn play(fleet: &Fleet, options: &str, script: &str) -> Running {
    let file = fleet.scratch("script.txt");
    fs::write(&file, script).unwrap();
    start(&format!(
        "operator-console --headless {options} drive --script {}",
        file.display()
    ))
}

/// A script that requests the lease, turns for a second and releases the lease.
const TURNS: &str = "\
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
    let endpoint = quic(free_port());
    let edge = start(&format!(
        "robot-edge replay {} --rate 20 --keep-serving {} --export {}",
        rooms(),
        fleet.edge("--listen", &endpoint),
        fleet.scratch("edge").display()
    ));
    start(&format!(
        "operator-console --headless --for 100 {} --export {}",
        fleet.console("tv", &endpoint),
        fleet.scratch("console").display()
    ))
    .ends_well();
    edge.interrupt();
    assert_same_maps(&fleet.scratch("edge"), &fleet.scratch("console"));
}

#[test]
fn a_console_with_keys_drives_under_its_own_name() {
    let fleet = Fleet::new();
    let endpoint = quic(free_port());
    let _edge = robot(&fleet, &endpoint);
    let printed = play(&fleet, &fleet.console("anna", &endpoint), TURNS).ends_well();
    assert!(printed.contains(" Driving, lease of anna"), "{printed}");
}

/// By its certificate, without a robot.
#[test]
fn an_observers_script_is_refused_at_once() {
    let fleet = Fleet::new();
    let endpoint = quic(free_port());
    let printed_to = |name| {
        let options = format!("--timeout 1 {}", fleet.console(name, &endpoint));
        play(&fleet, &options, "0.0 estop\n0.0 await estop 6\n").end()
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

#[test]
fn poses_are_datagrams_beside_a_stream() {
    let (fleet, port) = (Fleet::new(), free_port());
    let vehicle = vehicle(&fleet, &[quic(port)], &[]);
    let console = person(&fleet, "anna", port);
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

/// Twice the head start of QUIC (discovery and session), on a busy machine.
const UP_WITHIN: Duration = Duration::from_secs(6);
/// From the first silence to the first message by TLS. QUIC is given up after 4 s of silence.
const OVER_WITHIN: Duration = Duration::from_secs(15);

/// A robot with keys, and the network between it and its operators.
struct Networked {
    fleet: Fleet,
    /// Of control and of bulk data.
    tcp: [Relay; 2],
    udp: UdpRelay,
    _edge: Running,
}

impl Networked {
    fn start() -> Self {
        let (fleet, port) = (Fleet::new(), free_port());
        let edge = robot(&fleet, &quic(port));
        // The TLS listener starts after that of QUIC.
        wait_until("up", || TcpStream::connect(("127.0.0.1", port)).is_ok());
        let entrance = free_port();
        let tcp = [0, 1].map(|n| {
            let target = ([127, 0, 0, 1], port + n).into();
            Relay::start(entrance + n, target).unwrap()
        });
        let udp = UdpRelay::start(entrance, ([127, 0, 0, 1], port).into(), 0).unwrap();
        Self {
            fleet,
            tcp,
            udp,
            _edge: edge,
        }
    }

    /// A network that drops UDP from the beginning.
    fn without_udp() -> Self {
        let network = Self::start();
        network.swallows_udp(true);
        network
    }

    fn swallows_udp(&self, blackhole: bool) {
        self.udp.set_both(Conditions {
            blackhole,
            ..Conditions::default()
        });
    }

    /// Dropped datagrams of consoles.
    fn swallowed(&self) -> u64 {
        self.udp.blackholed(Direction::ToTarget)
    }

    fn endpoint(&self) -> String {
        format!("quic/{}", self.udp.address())
    }

    /// The session of a console's window.
    fn session(&self) -> RobotSession {
        let endpoints = self.fleet.endpoints("anna", self.endpoint());
        open_session(&endpoints, &[LayerId::Occupancy], || {})
    }
}

fn goes_by(session: &RobotSession, transport: Transport) -> bool {
    session.transport() == Some(transport)
}

#[test]
fn a_console_drives_by_tls_and_says_so() {
    let network = Networked::without_udp();
    let options = network.fleet.console("anna", &network.endpoint());
    let started = clock::now();
    let mut console = play(&network.fleet, &options, TURNS);
    console.wait_for_output("lease held");
    let took = clock::elapsed(started);
    let printed = console.ends_well();
    println!(
        "from the program's start to the lease: {took:?}; {} datagrams were swallowed",
        network.swallowed()
    );
    assert!(printed.contains("control goes by TLS"), "{printed}");
    assert!(printed.contains(" Driving, lease of anna"), "{printed}");
    assert!(printed.contains(" 0 involuntary stops"), "{printed}");
    assert!(network.swallowed() > 0, "QUIC was tried");
    assert!(took < UP_WITHIN, "{took:?}");
}

#[test]
fn a_map_comes_by_tls_and_the_console_shows_it() {
    let network = Networked::without_udp();
    let session = network.session();
    let live = wait_until("live", || is_live(&session.model()));
    let in_step = live
        + wait_until("synchronized", || {
            session.model().is_synchronized(clock::now())
        });
    wait_until("a report of TLS", || {
        goes_by(&session, Transport::TlsInstead)
    });
    let cells = session
        .model()
        .map()
        .store()
        .cells_known(LayerId::Occupancy);
    println!("live after {live:?}, synchronized after {in_step:?} with {cells} cells");
    assert!(cells > 100, "{cells}");
    assert!(live < UP_WITHIN, "{live:?}");
}

/// As where its first packet is lost.
#[test]
fn quic_is_waited_for_after_tls_has_answered() {
    let network = Networked::start();
    network.udp.set_both(Conditions {
        delay: Duration::from_millis(200),
        ..Conditions::default()
    });
    let session = network.session();
    wait_until("live", || is_live(&session.model()));
    assert!(network.tcp[0].connections_accepted() > 0);
    wait_until("by QUIC", || goes_by(&session, Transport::Quic));
}

/// As when a console changes to another network.
#[test]
fn a_quic_link_continues_by_tls_when_udp_stops() {
    let network = Networked::start();
    let session = network.session();
    wait_until("live", || is_live(&session.model()));
    wait_until("by QUIC", || goes_by(&session, Transport::Quic));
    network.swallows_udp(true);
    wait_until("silent", || !is_live(&session.model()));
    let over = wait_until("live again", || is_live(&session.model()));
    wait_until("by TLS", || goes_by(&session, Transport::TlsInstead));
    println!("silent for {over:?}");
    // Tiles continue by TLS, but do not count as signs of life of the control session.
    assert!(over > Duration::from_secs(2), "{over:?}");
    assert!(over < OVER_WITHIN, "{over:?}");
}

/// TLS may connect first when a network comes back, although QUIC works too.
#[test]
fn a_cut_quic_link_returns_to_quic() {
    let network = Networked::start();
    let session = network.session();
    wait_until("live", || is_live(&session.model()));
    wait_until("by QUIC", || goes_by(&session, Transport::Quic));
    network.swallows_udp(true);
    for tcp in &network.tcp {
        tcp.cut();
    }
    let given_up = wait_until("given up", || session.problem().is_some());
    for tcp in &network.tcp {
        tcp.pass();
    }
    let [control, _] = &network.tcp;
    let before = control.connections_accepted();
    wait_until("asked by TLS", || control.connections_accepted() > before);
    network.swallows_udp(false);
    let back = wait_until("live again", || is_live(&session.model()));
    println!("given up after {given_up:?}, live {back:?} after TLS was asked");
    // The transport is checked once a second.
    sleep(Duration::from_millis(1500));
    assert!(
        goes_by(&session, Transport::Quic),
        "{:?}",
        session.transport()
    );
    assert!(is_live(&session.model()));
    assert!(back < UP_WITHIN, "{back:?}");
}
