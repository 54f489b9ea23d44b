//! Discovery of robots: scouts the local network and asks at typed addresses.
//!
//! Scouting finds Zenoh processes. The robots behind each are listed over a short session, by their presence tokens, so
//! a router lists every robot behind it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, ScopedJoinHandle};
use std::time::Duration;

use measurement::time::Monotonic;
use network::LinkError;
use network::clock;
use network::credentials::Credentials;
use network::endpoints::{Channel, bulk_endpoint};
use network::sessions::{self, Endpoints, Side};
use protocol::keys::{RobotId, Topic, every_robot_alive};
use protocol::message::Status;
use protocol::wire::{self, MAX_MESSAGE_BYTES};
use zenoh::config::WhatAmI;
use zenoh::sample::Sample;
use zenoh::{Session, Wait};

use super::address_state::AddressState;
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

    /// Known robots in order of discovery, with their last state.
    pub fn discovered_robots(&self) -> Vec<DiscoveredRobot> {
        lock(&self.state.found).discovered_robots().collect()
    }

    pub fn problem(&self) -> Option<String> {
        lock(&self.state.problem).clone()
    }

    /// All problems of the last round: of the network and of each address.
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
            AddressState::of(&why, address)
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
        .map_err(|why| AddressState::of(&LinkError::Declare { what, why }, address))?;
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

/// Endpoints of the Zenoh processes that answer on the local network.
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
