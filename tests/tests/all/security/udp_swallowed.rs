//! Networks that pass TCP and drop UDP: control uses TLS instead of QUIC, and the
//! console reports it.

use std::fs;
use std::net::TcpStream;
use std::process::Command;
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::rig::Conditions;
use foreshore_tests::rig::relay::{Direction, Relay};
use foreshore_tests::rig::udp::UdpRelay;
use operator_console::link::{RobotSession, Transport};
use operator_console::model::LinkState;
use protocol::layer::LayerId;
use robot_edge::clock;

use super::secured_link::TURNS;
use crate::fleet::Fleet;
use crate::link::processes::{Running, free_port, open_session, program, wait_until};

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
        let mut edge = program("robot-edge");
        edge.args(["simulate", "rooms", "--quiet", "--keep-serving", "--listen"]);
        edge.arg(format!("quic/127.0.0.1:{port}"));
        let edge = Running::start(edge.arg("--keys").arg(fleet.vehicle()), "edge");
        // The TLS listener starts after that of QUIC.
        wait_until("up", || TcpStream::connect(("127.0.0.1", port)).is_ok());
        let entrance = free_port();
        let tcp = [0, 1].map(|n| {
            let target = ([127, 0, 0, 1], port + n).into();
            Relay::at(entrance + n, target).unwrap()
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
        let conditions = Conditions {
            blackhole,
            ..Conditions::default()
        };
        self.udp.set_both(conditions).unwrap();
    }

    /// Dropped datagrams of consoles.
    fn swallowed(&self) -> u64 {
        self.udp.traffic(Direction::ToTarget).blackholed.packets
    }

    fn endpoint(&self) -> String {
        format!("quic/{}", self.udp.address())
    }

    /// A console that knows the address only.
    fn console(&self, person: &str) -> Command {
        let mut console = program("operator-console");
        console.args(["--connect", &self.endpoint(), "--keys"]);
        console.arg(self.fleet.person(person));
        console
    }

    /// The session of a console's window.
    fn session(&self) -> RobotSession {
        let endpoints = self.fleet.endpoints("anna", self.endpoint());
        open_session(&endpoints, &[LayerId::Occupancy], || {})
    }
}

fn is_live(session: &RobotSession) -> bool {
    session.model().connection().state(clock::now()) == LinkState::Live
}

fn goes_by(session: &RobotSession, transport: Transport) -> bool {
    session.transport() == Some(transport)
}

#[test]
fn a_console_drives_by_tls_and_says_so() {
    let network = Networked::without_udp();
    let script = network.fleet.scratch("drive.txt");
    fs::write(&script, TURNS).unwrap();
    let mut console = network.console("anna");
    console.args(["--headless", "drive", "--script"]);
    let started = clock::now();
    let mut console = Running::start(console.arg(script), "console");
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
    let live = wait_until("live", || is_live(&session));
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

/// As when a console changes to another network.
#[test]
fn a_quic_link_continues_by_tls_when_udp_stops() {
    let network = Networked::start();
    let session = network.session();
    wait_until("live", || is_live(&session));
    wait_until("by QUIC", || goes_by(&session, Transport::Quic));
    network.swallows_udp(true);
    wait_until("silent", || !is_live(&session));
    let over = wait_until("live again", || is_live(&session));
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
    wait_until("live", || is_live(&session));
    wait_until("by QUIC", || goes_by(&session, Transport::Quic));
    network.swallows_udp(true);
    for tcp in &network.tcp {
        tcp.cut();
    }
    let given_up = wait_until("given up", || session.problem().is_some());
    for tcp in &network.tcp {
        tcp.pass().unwrap();
    }
    let [control, _] = &network.tcp;
    let before = control.connections_accepted();
    wait_until("asked by TLS", || control.connections_accepted() > before);
    network.swallows_udp(false);
    let back = wait_until("live again", || is_live(&session));
    println!("given up after {given_up:?}, live {back:?} after TLS was asked");
    // The transport is checked once a second.
    sleep(Duration::from_millis(1500));
    assert!(
        goes_by(&session, Transport::Quic),
        "{:?}",
        session.transport()
    );
    assert!(is_live(&session));
    assert!(back < UP_WITHIN, "{back:?}");
}
