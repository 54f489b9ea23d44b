//! Which robots there are: scouts the local network and asks at typed addresses.
//!
//! Scouting finds Zenoh processes; which robots can be reached through one is asked over a short session, by
//! presence tokens. So a router that was found or typed lists every robot behind it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, ScopedJoinHandle};
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::{RobotId, Topic, every_robot_alive};
use protocol::message::Status;
use protocol::wire::{self, MAX_MESSAGE_BYTES};
use robot_edge::clock;
use robot_edge::credentials::Credentials;
use robot_edge::link::LinkError;
use robot_edge::link::endpoints::{Channel, bulk_endpoint};
use robot_edge::link::sessions::{self, Endpoints, Side};
use zenoh::config::WhatAmI;
use zenoh::sample::Sample;
use zenoh::{Session, Wait};

use super::address_state::AddressState;
use super::fleet_state::FleetState;
use super::known_robots::{Answer, DiscoveredRobot, FoundRobot, KnownRobots, MAX_ROBOTS, Round};
use super::opening::close;
use crate::locks::lock;

const SCOUT_TIME: Duration = Duration::from_millis(500);
const ASK_TIMEOUT: Duration = Duration::from_secs(1);
/// A robot says how it is twice a second; so long that is waited for.
const STATUS_TIME: Duration = Duration::from_millis(700);
/// Between two rounds, while nothing is found.
const PAUSE: Duration = Duration::from_secs(2);
/// Between two rounds otherwise: they use the link that somebody watches a robot over.
const LONG_PAUSE: Duration = Duration::from_secs(10);
/// A robot that did not answer for so long has missed a round.
pub const SEEN_RECENTLY: Duration = Duration::from_secs(15);
/// Processes that are asked in one round.
const MAX_ADDRESSES: usize = 32;
/// Of these at once.
const ASKED_AT_ONCE: usize = 8;

/// Looks for robots until it is dropped.
pub struct Discovery {
    state: Arc<State>,
}

struct State {
    /// The addresses that are asked in every round, and what came of it.
    typed: Mutex<BTreeMap<String, AddressState>>,
    zenoh_config: Option<PathBuf>,
    credentials: Option<Credentials>,
    found: Mutex<KnownRobots>,
    /// Why the local network cannot be searched.
    problem: Mutex<Option<String>>,
    /// Somebody typed an address: do not wait for the next round.
    is_hurried: AtomicBool,
    is_closing: AtomicBool,
}

impl Discovery {
    /// Begins to look: at `addresses` first, then by scouting too, unless `scouts` is false. `wake` is called
    /// when the list changes.
    pub fn start(
        addresses: Vec<String>,
        scouts: bool,
        zenoh_config: Option<PathBuf>,
        credentials: Option<Credentials>,
        wake: impl Fn() + Send + 'static,
    ) -> Self {
        let state = Arc::new(State {
            typed: Mutex::new(addresses.into_iter().map(asking).collect()),
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

    /// Also asks at `address`, a control endpoint.
    pub fn add_address(&self, address: String) {
        let mut typed = lock(&self.state.typed);
        let state = typed.entry(address).or_default();
        if *state != AddressState::Found {
            // Whoever types it again waits for what comes of it now.
            *state = AddressState::Asking;
        }
        drop(typed);
        self.state.is_hurried.store(true, Ordering::Relaxed);
    }

    /// Asks at `address` no longer, and says no more of it. What was found there stays until it is missed.
    pub fn forget_address(&self, address: &str) {
        lock(&self.state.typed).remove(address);
    }

    /// Whether it is asked at `address` in every round.
    pub fn asks(&self, address: &str) -> bool {
        lock(&self.state.typed).contains_key(address)
    }

    /// The addresses that are asked in every round, and what came of it.
    pub fn asked(&self) -> BTreeMap<String, AddressState> {
        lock(&self.state.typed).clone()
    }

    /// The robots that surely answer at an address that is asked, and tell this console nothing.
    pub fn access_denied(&self) -> BTreeSet<RobotId> {
        let asked = lock(&self.state.typed);
        let access_denied = asked.values().filter_map(AddressState::access_denied);
        access_denied.cloned().collect()
    }

    /// A robot was heard by its own link: it was so then, whatever was found before.
    pub fn update_state(&self, robot: &RobotId, state: FleetState, at: Monotonic) {
        lock(&self.state.found).update_state(robot, state, at);
    }

    /// A robot was heard by its own link at that time, whatever it said.
    pub fn mark_seen(&self, robot: &RobotId, at: Monotonic) {
        lock(&self.state.found).mark_seen(robot, at);
    }

    /// This robot is listed no more, unless it answers again.
    pub fn forget_robot(&self, robot: &RobotId) {
        lock(&self.state.found).forget(robot);
    }

    /// The robots that are there, by name.
    pub fn found(&self) -> Vec<FoundRobot> {
        let known = lock(&self.state.found);
        let mut found: Vec<_> = known.present().cloned().collect();
        found.sort();
        found
    }

    /// The robots that were found and not forgotten since, in the order in which they were first found, with what they
    /// said of themselves last.
    pub fn discovered_robots(&self) -> Vec<DiscoveredRobot> {
        lock(&self.state.found).discovered_robots().collect()
    }

    /// Why the local network cannot be searched, in words.
    pub fn problem(&self) -> Option<String> {
        lock(&self.state.problem).clone()
    }

    /// All that kept the last round from finding more, in words: of the network, and of each address that is asked.
    pub fn complaints(&self) -> Option<String> {
        let asked = lock(&self.state.typed);
        let of_addresses = asked
            .iter()
            .filter_map(|(address, state)| state.complaint(address));
        let all: Vec<_> = self.problem().into_iter().chain(of_addresses).collect();
        (!all.is_empty()).then(|| all.join("; "))
    }
}

fn asking(address: String) -> (String, AddressState) {
    (address, AddressState::Asking)
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
            // What is known of an address waits for no scouting.
            wake();
        }
        if !is_first || typed.is_empty() || found.is_empty() {
            let scouted = if scouts {
                scout(&mut problem)
            } else {
                BTreeSet::new()
            };
            let scouted: Vec<String> = scouted
                .into_iter()
                .filter(|address| !typed.contains(address))
                .collect();
            // Nobody typed these: that one of them does not answer is no problem of the operator's.
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
    /// Notes what came of asking at an address that was typed; whether that is another than before.
    fn update_state(&self, address: &str, came_of_it: AddressState) -> bool {
        // It may have been forgotten while it was asked.
        let mut typed = lock(&self.typed);
        typed.get_mut(address).is_some_and(|state| {
            let before = std::mem::replace(state, came_of_it);
            before != *state
        })
    }
}

/// Asks at addresses, and tells what came of it at each.
fn ask_all(
    state: &State,
    addresses: &[String],
    found: &mut Round,
    mut update_state: impl FnMut(&str, AddressState),
) {
    let addresses = &addresses[..addresses.len().min(MAX_ADDRESSES)];
    // Side by side: one that does not answer holds up no other.
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
        // Whom nobody typed, nobody wants to know more of.
        let is_typed = lock(&state.typed).contains_key(address);
        if is_typed {
            AddressState::of(&why, address)
        } else {
            AddressState::Silent
        }
    })?;
    let robots = robots_at(&session, address);
    close(&session);
    robots
}

/// The robots that are told of over `session`, with somebody at `address`.
fn robots_at(session: &Session, address: &str) -> Result<Round, AddressState> {
    let (sender, heard) = sync_channel(MAX_ROBOTS);
    // Before the question who is there, so that what is said meanwhile is heard. Where access control keeps it from this
    // console, nothing is.
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
                // What does not fit is said again.
                drop(sender.try_send((robot, FleetState::of(&status))));
            }
        })
        .wait();
    if let Err(why) = &statuses {
        tracing::debug!(%why, "how robots are is not heard");
    }
    let what = every_robot_alive();
    let tokens = session
        .liveliness()
        .get(what.clone())
        .timeout(ASK_TIMEOUT)
        .wait()
        .map_err(|why| AddressState::of(&LinkError::Declare { what, why }, address))?;
    let mut robots = Round::new();
    let mut is_late = false;
    while let Ok(reply) = tokens.recv() {
        let Ok(sample) = reply.result() else {
            // Who is there, or may not tell, says at once that this was all.
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

/// The status of every robot.
fn every_robot_status() -> String {
    let alive = every_robot_alive();
    format!("{}status", alive.trim_end_matches("alive"))
}

/// The endpoints of the Zenoh processes that answer on the local network.
fn scout(problem: &mut Option<String>) -> BTreeSet<String> {
    let (sender, hellos): (SyncSender<Vec<String>>, _) = sync_channel(MAX_ADDRESSES);
    let scouting = zenoh::scout(WhatAmI::Peer | WhatAmI::Router, zenoh::Config::default())
        .callback(move |hello| {
            let locators = hello
                .locators()
                .iter()
                .map(|locator| locator.as_str().to_owned())
                .collect();
            // Whoever does not fit is heard again.
            drop(sender.try_send(locators));
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
        let address = locator
            .split(['?', '#'])
            .next()
            .unwrap_or_default()
            .to_owned();
        bulk_endpoint(&address).is_ok().then_some(address)
    };
    hellos.try_iter().flatten().filter_map(plain).collect()
}
