//! Discovery of robots: scouts the local network and asks at typed addresses.
//!
//! Scouting finds Zenoh processes. The robots behind each are listed over a short session, by their presence tokens, so
//! a router lists every robot behind it.

use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::net::{IpAddr, SocketAddr, TcpStream, ToSocketAddrs};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, ScopedJoinHandle};
use std::time::Duration;

use measurement::time::Monotonic;
use network::certificate_probe::certificate_problem;
use network::credentials::{Credentials, Identity};
use network::endpoints::{Channel, bulk_endpoint, place};
use network::sessions::{self, Endpoints, Side};
use network::{LinkError, clock};
use protocol::keys::{RobotId, Topic, every_robot_alive};
use protocol::message::Status;
use protocol::wire::{self, MAX_MESSAGE_BYTES};
use zenoh::config::WhatAmI;
use zenoh::sample::Sample;
use zenoh::{Session, Wait};

use super::close;
use super::known_robots::{
    Answer, DiscoveredRobot, FleetState, FoundRobot, KnownRobots, MAX_ROBOTS, Round,
};
use crate::lock;

const SCOUT_TIME: Duration = Duration::from_millis(500);
const ASK_TIMEOUT: Duration = Duration::from_secs(1);
/// A robot sends two statuses a second.
const STATUS_TIME: Duration = Duration::from_millis(700);
const PAUSE: Duration = Duration::from_secs(2);
/// Pause afterwards: rounds use the link of the robot that is watched.
const LONG_PAUSE: Duration = Duration::from_secs(10);
/// A robot without an answer for longer has missed a round.
pub const SEEN_RECENTLY: Duration = Duration::from_secs(15);
const MAX_ADDRESSES: usize = 32;
const ASKED_AT_ONCE: usize = 8;

pub struct Discovery {
    state: Arc<State>,
}

struct State {
    typed: Mutex<BTreeMap<String, AddressState>>,
    zenoh_config: Option<PathBuf>,
    credentials: Option<Credentials>,
    found: Mutex<KnownRobots>,
    problem: Mutex<Option<String>>,
    /// An address was typed: begin the next round at once.
    is_hurried: AtomicBool,
    is_closing: AtomicBool,
}

impl Discovery {
    /// Starts with `addresses` and, if `scouts`, scouting. `wake` is called when the list changes.
    pub fn start(
        addresses: Vec<String>,
        scouts: bool,
        zenoh_config: Option<PathBuf>,
        credentials: Option<Credentials>,
        wake: impl Fn() + Send + 'static,
    ) -> Self {
        let typed = addresses.into_iter();
        let typed = typed.map(|address| (address, AddressState::Asking));
        let state = Arc::new(State {
            typed: Mutex::new(typed.collect()),
            zenoh_config,
            credentials,
            found: Mutex::default(),
            problem: Mutex::default(),
            is_hurried: AtomicBool::new(false),
            is_closing: AtomicBool::new(false),
        });
        thread::spawn({
            let state = Arc::clone(&state);
            move || run(&state, scouts, &wake)
        });
        Self { state }
    }

    pub fn add_address(&self, address: String) {
        let mut typed = lock(&self.state.typed);
        let state = typed.entry(address).or_default();
        if *state != AddressState::Found {
            // The operator waits for a new result.
            *state = AddressState::Asking;
        }
        drop(typed);
        self.state.is_hurried.store(true, Ordering::Relaxed);
    }

    /// Stops asking at `address`. Robots found there stay listed until they are missed.
    pub fn forget_address(&self, address: &str) {
        lock(&self.state.typed).remove(address);
    }

    pub fn asks(&self, address: &str) -> bool {
        lock(&self.state.typed).contains_key(address)
    }

    pub fn asked(&self) -> BTreeMap<String, AddressState> {
        lock(&self.state.typed).clone()
    }

    pub fn access_denied(&self) -> BTreeSet<RobotId> {
        let asked = lock(&self.state.typed);
        let access_denied = asked.values().filter_map(AddressState::access_denied);
        access_denied.cloned().collect()
    }

    pub fn update_state(&self, robot: &RobotId, state: FleetState, at: Monotonic) {
        lock(&self.state.found).update_state(robot, state, at);
    }

    pub fn mark_seen(&self, robot: &RobotId, at: Monotonic) {
        lock(&self.state.found).mark_seen(robot, at);
    }

    pub fn forget_robot(&self, robot: &RobotId) {
        lock(&self.state.found).forget(robot);
    }

    pub fn found(&self) -> Vec<FoundRobot> {
        let known = lock(&self.state.found);
        let mut found: Vec<_> = known.present().cloned().collect();
        found.sort();
        found
    }

    pub fn discovered_robots(&self) -> Vec<DiscoveredRobot> {
        lock(&self.state.found).discovered_robots().collect()
    }

    pub fn problem(&self) -> Option<String> {
        lock(&self.state.problem).clone()
    }

    pub fn complaints(&self) -> Option<String> {
        let asked = lock(&self.state.typed);
        let of_addresses = asked
            .iter()
            .filter_map(|(address, state)| state.complaint(address));
        let all: Vec<_> = self.problem().into_iter().chain(of_addresses).collect();
        (!all.is_empty()).then(|| all.join("; "))
    }
}

impl Drop for Discovery {
    fn drop(&mut self) {
        self.state.is_closing.store(true, Ordering::Relaxed);
    }
}

fn run(state: &State, scouts: bool, wake: &dyn Fn()) {
    let is_closing = || state.is_closing.load(Ordering::Relaxed);
    let mut is_first = true;
    while !is_closing() {
        let typed: Vec<String> = lock(&state.typed).keys().cloned().collect();
        let mut problem = None;
        let mut found = Round::new();
        let mut changed = false;
        ask_all(state, &typed, &mut found, |address, came_of_it| {
            changed |= state.update_state(address, came_of_it);
        });
        if changed {
            // Results of addresses do not wait for scouting.
            wake();
        }
        if !is_first || typed.is_empty() || found.is_empty() {
            let mut scouted = Vec::new();
            if scouts {
                scouted.extend(scout(&mut problem));
                scouted.retain(|address| !typed.contains(address));
            }
            // Failures at scouted addresses are not the operator's problem.
            ask_all(state, &scouted, &mut found, |_, _| {});
        }
        is_first = false;
        let changed = lock(&state.found).take(found);
        let before = std::mem::replace(&mut *lock(&state.problem), problem.clone());
        if before != problem || changed {
            wake();
        }
        let is_found = lock(&state.found).present().next().is_some();
        let pause = if is_found { LONG_PAUSE } else { PAUSE };
        clock::sleep_until(clock::now() + pause, || {
            is_closing() || state.is_hurried.swap(false, Ordering::Relaxed)
        });
    }
}

impl State {
    fn update_state(&self, address: &str, came_of_it: AddressState) -> bool {
        // It may have been removed while it was asked.
        let mut typed = lock(&self.typed);
        let state = typed.get_mut(address).filter(|state| **state != came_of_it);
        state.map(|state| *state = came_of_it).is_some()
    }
}

fn ask_all(
    state: &State,
    addresses: &[String],
    found: &mut Round,
    mut update_state: impl FnMut(&str, AddressState),
) {
    let addresses = &addresses[..addresses.len().min(MAX_ADDRESSES)];
    // In parallel: one without an answer does not delay the others.
    for some in addresses.chunks(ASKED_AT_ONCE) {
        if state.is_closing.load(Ordering::Relaxed) {
            return;
        }
        let answers: Vec<_> = thread::scope(|scope| {
            let asked: Vec<_> = some
                .iter()
                .map(|address| scope.spawn(move || ask(state, address)))
                .collect();
            asked.into_iter().map(ScopedJoinHandle::join).collect()
        });
        for (address, answer) in some.iter().zip(answers) {
            let came_of_it = match answer {
                Ok(Ok(robots)) => {
                    found.extend(robots);
                    AddressState::Found
                }
                Ok(Err(why)) => why,
                Err(_panic) => AddressState::Problem(format!("{address} could not be asked")),
            };
            update_state(address, came_of_it);
        }
    }
}

fn ask(state: &State, address: &str) -> Result<Round, AddressState> {
    let endpoints = Endpoints {
        connect: vec![address.to_owned()],
        zenoh_config: state.zenoh_config.clone(),
        credentials: state.credentials.clone(),
        ..Endpoints::default()
    };
    let session = sessions::open(Side::Console, Channel::Control, &endpoints).map_err(|why| {
        // Only typed addresses get a diagnosis.
        let is_typed = lock(&state.typed).contains_key(address);
        if is_typed {
            AddressState::of(&why, address, state.credentials.as_ref())
        } else {
            AddressState::Silent
        }
    })?;
    let robots = robots_at(&session, address);
    close(&session);
    robots
}

fn robots_at(session: &Session, address: &str) -> Result<Round, AddressState> {
    let (sender, heard) = sync_channel(MAX_ROBOTS);
    // Subscribed before the list is requested, so that no status is missed. Access control may block all.
    let statuses = session
        .declare_subscriber(every_robot_status())
        .callback(move |sample: Sample| {
            let payload = sample.payload();
            let Some((robot, Topic::Status)) = Topic::parse(sample.key_expr().as_str()) else {
                return;
            };
            if payload.len() <= MAX_MESSAGE_BYTES
                && let Ok((_, status)) = wire::decode::<Status>(&payload.to_bytes())
            {
                // A status that does not fit is sent again.
                drop(sender.try_send((robot, FleetState::of(&status))));
            }
        })
        .wait();
    if let Err(why) = &statuses {
        tracing::debug!(%why, "cannot subscribe to statuses");
    }
    let what = every_robot_alive();
    let tokens = session
        .liveliness()
        .get(what.clone())
        .timeout(ASK_TIMEOUT)
        .wait()
        .map_err(|why| AddressState::Problem(LinkError::Declare { what, why }.to_string()))?;
    let mut robots = Round::new();
    let mut is_late = false;
    while let Ok(reply) = tokens.recv() {
        let Ok(sample) = reply.result() else {
            // A peer that answers ends its replies at once.
            is_late = true;
            continue;
        };
        if let Some((robot, Topic::Alive)) = Topic::parse(sample.key_expr().as_str()) {
            let endpoint = address.to_owned();
            let at = clock::now();
            robots.insert(FoundRobot { robot, endpoint }, Answer { at, state: None });
        }
    }
    if robots.is_empty() {
        return Err(if is_late {
            AddressState::Silent
        } else {
            AddressState::of_no_robot(session)
        });
    }
    let deadline = clock::now() + STATUS_TIME;
    while robots.values().any(|answer| answer.state.is_none())
        && let Ok((robot, said)) = heard.recv_timeout(deadline.since(clock::now()))
    {
        let mut robots = robots.iter_mut();
        if let Some((_, answer)) = robots.find(|(found, _)| found.robot == robot) {
            answer.state = Some(said);
        }
    }
    Ok(robots)
}

fn every_robot_status() -> String {
    let alive = every_robot_alive();
    format!("{}status", alive.trim_end_matches("alive"))
}

fn scout(problem: &mut Option<String>) -> BTreeSet<String> {
    let (sender, hellos): (SyncSender<Vec<String>>, _) = sync_channel(MAX_ADDRESSES);
    let scouting = zenoh::scout(WhatAmI::Peer | WhatAmI::Router, zenoh::Config::default())
        .callback(move |hello| {
            let locators = hello.locators().iter();
            let locators = locators.map(|locator| locator.as_str().to_owned());
            // A process that does not fit is found again.
            drop(sender.try_send(locators.collect()));
        })
        .wait();
    let scouting = match scouting {
        Ok(scouting) => scouting,
        Err(why) => {
            *problem = Some(format!("the local network cannot be searched: {why}"));
            return BTreeSet::new();
        }
    };
    clock::sleep_until(clock::now() + SCOUT_TIME, || false);
    scouting.stop();
    let plain = |locator: String| {
        let address = locator.split(['?', '#']).next()?;
        bulk_endpoint(address).is_ok().then(|| address.to_owned())
    };
    hellos.try_iter().flatten().filter_map(plain).collect()
}

/// A name that is not resolved within this time counts as unknown.
const LOOKUP_TIMEOUT: Duration = Duration::from_secs(2);
const PROBE_TIMEOUT: Duration = Duration::from_millis(700);

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AddressState {
    #[default]
    Asking,
    Found,
    /// Zenoh answers and reports no robot.
    NoRobot,
    /// A robot answers, as its certificate says, but its access control hides it from this console.
    AccessDenied {
        robot: RobotId,
        /// Whether by QUIC, as at its control port; otherwise the port may be that for tiles.
        by_quic: bool,
    },
    UnknownName,
    /// The computer answers, but nothing listens at the port.
    Refused,
    Silent,
    /// Something answers with another protocol, or with or without keys unlike this console.
    WrongProtocol,
    /// Whose certificate is wrong, and why.
    WrongCertificate(String),
    Problem(String),
}

impl AddressState {
    /// Diagnoses a failure at `address`. May resolve its name and try its port: takes seconds at most.
    pub(super) fn of(why: &LinkError, address: &str, credentials: Option<&Credentials>) -> Self {
        match why {
            LinkError::Open { .. } => {
                place(address).map_or(Self::Silent, |place| probe_port(place, credentials))
            }
            _ => Self::Problem(why.to_string()),
        }
    }

    /// A vehicle hides itself from operators not on its list, but its certificate identifies it.
    pub(super) fn of_no_robot(session: &Session) -> Self {
        let mut links = session.info().links().wait();
        links.next().map_or(Self::NoRobot, |link| {
            Self::of_silent(link.auth_identifier(), link.dst().protocol().as_str())
        })
    }

    fn of_silent(common_name: Option<&str>, protocol: &str) -> Self {
        match common_name.and_then(|name| name.parse().ok()) {
            Some(Identity::Vehicle(robot)) => Self::AccessDenied {
                robot,
                by_quic: protocol == "quic",
            },
            _ => Self::NoRobot,
        }
    }

    pub const fn access_denied(&self) -> Option<&RobotId> {
        match self {
            Self::AccessDenied {
                robot,
                by_quic: true,
            } => Some(robot),
            _ => None,
        }
    }

    pub fn complaint(&self, address: &str) -> Option<String> {
        match self {
            Self::Asking | Self::Found | Self::NoRobot => None,
            Self::AccessDenied { robot, by_quic } => {
                let tiles = if *by_quic {
                    ""
                } else {
                    "; or this is its port for tiles"
                };
                Some(format!(
                    "{robot} answers at {address} but denies access: you are not on its list of operators; \
                     access is granted within two seconds of being added{tiles}"
                ))
            }
            Self::UnknownName => Some(format!("the name in {address} is not known")),
            Self::Refused | Self::Silent => Some(format!("no answer at {address}; trying again")),
            Self::WrongProtocol => Some(format!(
                "what listens at {address} does not answer as a robot: keys on one side only, or of another fleet?"
            )),
            Self::WrongCertificate(why) => Some(format!("{address}: {why}")),
            Self::Problem(why) => Some(why.clone()),
        }
    }
}

/// Tries the port by TCP, which every robot has open: with keys it offers TLS beside QUIC.
fn probe_port((host, port): (&str, u16), credentials: Option<&Credentials>) -> AddressState {
    let Some(found) = look_up(host, port) else {
        return AddressState::UnknownName;
    };
    match TcpStream::connect_timeout(&found, PROBE_TIMEOUT) {
        Ok(stream) => credentials
            .and_then(|credentials| certificate_problem(stream, host, credentials))
            .map_or(AddressState::WrongProtocol, AddressState::WrongCertificate),
        Err(why) if why.kind() == ErrorKind::ConnectionRefused => AddressState::Refused,
        Err(_) => AddressState::Silent,
    }
}

fn look_up(host: &str, port: u16) -> Option<SocketAddr> {
    if let Ok(ip) = host.parse::<IpAddr>() {
        return Some(SocketAddr::new(ip, port));
    }
    let (sender, found): (SyncSender<Option<SocketAddr>>, _) = sync_channel(1);
    let name = host.to_owned();
    // The system's lookup cannot be interrupted.
    thread::spawn(move || {
        let found = (name.as_str(), port).to_socket_addrs();
        let first = found.ok().and_then(|mut all| all.next());
        if sender.send(first).is_err() {
            tracing::debug!(name, "the lookup finished too late");
        }
    });
    found.recv_timeout(LOOKUP_TIMEOUT).ok().flatten()
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use network::endpoints::Channel;

    use super::*;

    fn of(address: &str) -> AddressState {
        let why = LinkError::Open {
            channel: Channel::Control,
            endpoints: address.to_owned(),
            why: "no".into(),
        };
        AddressState::of(&why, address, None)
    }

    #[test]
    fn causes_of_failure_are_distinguished() {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let address = format!("tcp/{}", listener.local_addr().unwrap());
        assert_eq!(of(&address), AddressState::WrongProtocol);
        drop(listener);
        assert_eq!(of(&address), AddressState::Refused);
        // RFC 6761: this name never exists.
        let unknown = "tcp/nosuchhost.invalid:7447";
        assert_eq!(of(unknown), AddressState::UnknownName);
        let why = LinkError::UnexpectedPeer {
            endpoints: "quic/boat:7447".to_owned(),
            name: "eve".to_owned(),
        };
        let AddressState::Problem(words) = AddressState::of(&why, "quic/boat:7447", None) else {
            panic!("a stranger is a problem");
        };
        assert!(words.contains("certificate of eve"), "{words}");
    }

    #[test]
    fn silent_vehicle_differs_from_empty_router() {
        let access_denied = |by_quic| AddressState::AccessDenied {
            robot: "scout".parse().unwrap(),
            by_quic,
        };
        for (name, protocol, expected) in [
            (Some("vehicle:scout"), "quic", access_denied(true)),
            (Some("vehicle:scout"), "tls", access_denied(false)),
            (Some("router:"), "quic", AddressState::NoRobot),
            (None, "tcp", AddressState::NoRobot),
        ] {
            assert_eq!(AddressState::of_silent(name, protocol), expected);
        }
        let words = access_denied(true).complaint("quic/boat:7447").unwrap();
        assert_eq!(
            words,
            "scout answers at quic/boat:7447 but denies access: you are not on its list of operators; \
             access is granted within two seconds of being added"
        );
        let words = access_denied(false).complaint("quic/boat:7448").unwrap();
        assert!(
            words.ends_with("; or this is its port for tiles"),
            "{words}"
        );
    }

    #[test]
    fn an_endpoint_has_a_place() {
        for (address, expected) in [
            ("tcp/boat:7447", Some(("boat", 7447))),
            ("quic/10.0.0.5:9?mixed_rel=1#a=b", Some(("10.0.0.5", 9))),
            ("tcp/[::1]:7447", Some(("::1", 7447))),
            ("boat:7447", None),
            ("tcp/boat", None),
        ] {
            assert_eq!(place(address), expected, "{address}");
        }
    }

    #[test]
    fn complaints_cover_failures_only() {
        let complaint = |state: AddressState| state.complaint("tcp/boat:7447");
        for quiet in [
            AddressState::Asking,
            AddressState::Found,
            AddressState::NoRobot,
        ] {
            assert_eq!(complaint(quiet), None);
        }
        let nobody = Some("no answer at tcp/boat:7447; trying again".to_owned());
        assert_eq!(complaint(AddressState::Silent), nobody);
        assert_eq!(complaint(AddressState::Refused), nobody);
        let unknown = Some("the name in tcp/boat:7447 is not known".to_owned());
        assert_eq!(complaint(AddressState::UnknownName), unknown);
    }
}
