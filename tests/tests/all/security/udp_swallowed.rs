//! Networks that carry TCP and swallow UDP, as those of many a company do: control goes by TLS instead of QUIC, soon, and the
//! console says so.

use std::fs;
use std::net::TcpStream;
use std::process::Command;
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::rig::relay::{Direction, Relay};
use foreshore_tests::rig::udp::{Conditions, UdpRelay};
use operator_console::link::{RobotSession, Transport};
use operator_console::model::{LinkState, ModelSettings};
use protocol::layer::LayerId;
use protocol::tile::BootId;
use robot_edge::clock;
use robot_edge::credentials::Credentials;
use robot_edge::link::sessions::Endpoints;

use super::secured_link::TURNS;
use crate::fleet::Fleet;
use crate::link::processes::{Running, free_port, program};

/// Longer than any of this takes.
const TIMEOUT: Duration = Duration::from_mins(1);
/// The head start of QUIC, twice where the robot has to be looked for first, and a machine that is busy with other tests.
const UP_WITHIN: Duration = Duration::from_secs(6);
/// From the first silence to the first message by another way. Nothing is given up before 4 s of silence.
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
        // QUIC is listened for before TLS, and a robot that is not up yet answers neither.
        takes("up", || TcpStream::connect(("127.0.0.1", port)).is_ok());
        let entrance = free_port();
        let tcp = [0, 1].map(|n| {
            let target = ([127, 0, 0, 1], port + n).into();
            Relay::at(entrance + n, target).unwrap()
        });
        let udp = UdpRelay::seeded(entrance, ([127, 0, 0, 1], port).into(), 0).unwrap();
        Self {
            fleet,
            tcp,
            udp,
            _edge: edge,
        }
    }

    /// One that swallows UDP from the beginning.
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

    /// Datagrams of a console that were swallowed.
    fn swallowed(&self) -> u64 {
        self.udp.traffic(Direction::ToTarget).blackholed.packets
    }

    fn endpoint(&self) -> String {
        format!("quic/{}", self.udp.address())
    }

    /// `operator-console` as an operator starts it, who knows the address and nothing else.
    fn console(&self, person: &str) -> Command {
        let mut console = program("operator-console");
        console.args(["--connect", &self.endpoint(), "--keys"]);
        console.arg(self.fleet.person(person));
        console
    }

    /// What a console's window is made of.
    fn session(&self) -> RobotSession {
        let settings = ModelSettings {
            robot: "scout".parse().unwrap(),
            session: BootId([9; 16]),
            tile_store_mb: 64,
            layers: [LayerId::Occupancy].into(),
        };
        let endpoints = Endpoints {
            connect: vec![self.endpoint()],
            credentials: Some(Credentials::open(&self.fleet.person("anna")).unwrap()),
            ..Endpoints::default()
        };
        RobotSession::open(settings, &endpoints, || {}).unwrap()
    }
}

/// How long it takes until it is so.
fn takes(what: &str, is_so: impl Fn() -> bool) -> Duration {
    takes_or_says(|| what.to_owned(), is_so)
}

/// The same, where it is worth saying how it is instead.
fn takes_or_says(what: impl Fn() -> String, is_so: impl Fn() -> bool) -> Duration {
    let started = clock::now();
    while !is_so() {
        assert!(clock::elapsed(started) < TIMEOUT, "not {}", what());
        sleep(Duration::from_millis(5));
    }
    clock::elapsed(started)
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
    let said = console.ends_well();
    println!(
        "from the program's start to the lease: {took:?}; {} datagrams were swallowed",
        network.swallowed()
    );
    assert!(said.contains("control goes by TLS"), "{said}");
    assert!(said.contains(" Driving, lease of anna"), "{said}");
    assert!(said.contains(" 0 involuntary stops"), "{said}");
    assert!(network.swallowed() > 0, "QUIC was tried");
    assert!(took < UP_WITHIN, "{took:?}");
}

#[test]
fn a_map_comes_by_tls_and_the_window_is_told() {
    let network = Networked::without_udp();
    let session = network.session();
    let live = takes("live", || is_live(&session));
    let in_step = live
        + takes("synchronized", || {
            session.model().is_synchronized(clock::now())
        });
    takes("told", || goes_by(&session, Transport::TlsInstead));
    let cells = session
        .model()
        .map()
        .store()
        .cells_known(LayerId::Occupancy);
    println!("live after {live:?}, synchronized after {in_step:?} with {cells} cells");
    assert!(cells > 100, "{cells}");
    assert!(live < UP_WITHIN, "{live:?}");
}

/// Who walks out of one network into another.
#[test]
fn a_link_by_quic_goes_on_by_tls_where_udp_is_swallowed_from_now_on() {
    let network = Networked::start();
    let session = network.session();
    takes("live", || is_live(&session));
    takes("by QUIC", || goes_by(&session, Transport::Quic));
    network.swallows_udp(true);
    takes("silent", || !is_live(&session));
    let [control, _] = &network.tcp;
    let before = control.connections_accepted();
    let how_it_is = || {
        format!(
            "live again: {:?}, {:?}, {} connections asked for by TLS",
            session.problem(),
            session.transport(),
            control.connections_accepted() - before
        )
    };
    let over = takes_or_says(how_it_is, || is_live(&session));
    takes("by TLS", || goes_by(&session, Transport::TlsInstead));
    println!("silent for {over:?}");
    // The map goes on coming by TLS all the time, and is no sign of life of what drives.
    assert!(over > Duration::from_secs(2), "{over:?}");
    assert!(over < OVER_WITHIN, "{over:?}");
}

/// TLS may be first to get through when a network comes back, and QUIC would do as well.
#[test]
fn a_link_by_quic_that_was_cut_is_by_quic_again() {
    let network = Networked::start();
    let session = network.session();
    takes("live", || is_live(&session));
    takes("by QUIC", || goes_by(&session, Transport::Quic));
    network.swallows_udp(true);
    for tcp in &network.tcp {
        tcp.cut().unwrap();
    }
    let given_up = takes("given up", || session.problem().is_some());
    for tcp in &network.tcp {
        tcp.pass().unwrap();
    }
    let [control, _] = &network.tcp;
    let before = control.connections_accepted();
    takes("asked by TLS", || control.connections_accepted() > before);
    network.swallows_udp(false);
    let back = takes("live again", || is_live(&session));
    println!("given up after {given_up:?}, live {back:?} after TLS was asked");
    // By what way it goes is looked at once a second.
    sleep(Duration::from_millis(1500));
    assert!(
        goes_by(&session, Transport::Quic),
        "{:?}",
        session.transport()
    );
    assert!(is_live(&session));
    assert!(back < UP_WITHIN, "{back:?}");
}
