//! Which robots there are: scouts the local network and asks at typed addresses.
//!
//! Scouting finds Zenoh processes; which robots can be reached through one is asked over a short session, by
//! presence tokens. So a router that was found or typed lists every robot behind it.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, ScopedJoinHandle};
use std::time::Duration;

use protocol::keys::{OperatorId, RobotId, Topic, every_robot_alive};
use protocol::message::{Status, TeleopState};
use protocol::wire::{self, MAX_MESSAGE_BYTES};
use robot_edge::clock::{self, Monotonic};
use robot_edge::credentials::Credentials;
use robot_edge::link::LinkError;
use robot_edge::link::endpoints::{Channel, bulk_endpoint};
use robot_edge::link::sessions::{self, Endpoints, Side};
use zenoh::Wait;
use zenoh::config::WhatAmI;
use zenoh::sample::Sample;

use super::known_robots::{Answer, KnownRobots, MAX_ROBOTS, Round};
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
/// Processes that are asked in one round.
const MAX_ADDRESSES: usize = 32;
/// Of these at once.
const ASKED_AT_ONCE: usize = 8;

/// A robot that can be watched.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct FoundRobot {
    /// Its name.
    pub robot: RobotId,
    /// Control endpoint through which it is reached.
    pub endpoint: String,
}

/// How a robot is, by its own word.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FleetState {
    /// It cannot be driven: a recording, or a robot without motors.
    Undriven,
    /// Nobody drives it.
    Free,
    /// This operator does.
    DrivenBy(OperatorId),
    /// An emergency stop is in force.
    EStop,
    /// It does not trust itself.
    Fault,
}

impl FleetState {
    /// What a status says.
    pub fn of(status: &Status) -> Self {
        let Some(teleop) = &status.teleop else {
            return Self::Undriven;
        };
        match (&teleop.state, teleop.estop, &teleop.lease.holder) {
            (TeleopState::Fault(_), ..) => Self::Fault,
            (_, Some(_), _) => Self::EStop,
            (_, None, Some(holder)) => Self::DrivenBy(holder.clone()),
            (_, None, None) => Self::Free,
        }
    }
}

/// A robot that was found, and what is known of it from looking for robots.
#[derive(Clone, Debug, PartialEq)]
pub struct Sighting {
    /// The robot.
    pub found: FoundRobot,
    /// When it answered last.
    pub seen: Monotonic,
    /// How it is; none where it has not said so.
    pub state: Option<FleetState>,
}

/// Looks for robots until it is dropped.
pub struct Discovery {
    state: Arc<State>,
}

struct State {
    typed: Mutex<BTreeSet<String>>,
    zenoh_config: Option<PathBuf>,
    credentials: Option<Credentials>,
    found: Mutex<KnownRobots>,
    problem: Mutex<Option<Problem>>,
    /// Somebody typed an address: do not wait for the next round.
    is_hurried: AtomicBool,
    is_closing: AtomicBool,
}

/// What kept a round from finding more.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Problem {
    /// The address that it is about.
    address: Option<String>,
    words: String,
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
            typed: Mutex::new(addresses.into_iter().collect()),
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
        lock(&self.state.typed).insert(address);
        self.state.is_hurried.store(true, Ordering::Relaxed);
    }

    /// Asks at `address` no longer, and says no more of it. What was found there stays until it is missed.
    pub fn forget_address(&self, address: &str) {
        let mut typed = lock(&self.state.typed);
        typed.remove(address);
        lock(&self.state.problem).take_if(|problem| problem.address.as_deref() == Some(address));
    }

    /// Whether it is asked at `address` in every round.
    pub fn asks(&self, address: &str) -> bool {
        lock(&self.state.typed).contains(address)
    }

    /// The robots that are there, by name.
    pub fn found(&self) -> Vec<FoundRobot> {
        let known = lock(&self.state.found);
        known.sightings().map(|sighting| sighting.found).collect()
    }

    /// The robots that are there, by name, with what they say of themselves.
    pub fn sightings(&self) -> Vec<Sighting> {
        lock(&self.state.found).sightings().collect()
    }

    /// What kept the last round from finding more, in words.
    pub fn problem(&self) -> Option<String> {
        let problem = lock(&self.state.problem);
        problem.as_ref().map(|problem| problem.words.clone())
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
        let typed: Vec<String> = lock(&state.typed).iter().cloned().collect();
        let mut problems = Vec::new();
        let mut found = Round::new();
        ask_all(state, &typed, &mut found, &mut problems);
        if !is_first || typed.is_empty() || found.is_empty() {
            let scouted = if scouts {
                scout(&mut problems)
            } else {
                BTreeSet::new()
            };
            let scouted: Vec<String> = scouted
                .into_iter()
                .filter(|address| !typed.contains(address))
                .collect();
            // Nobody typed these: that one of them does not answer is no problem of the operator's.
            ask_all(state, &scouted, &mut found, &mut Vec::new());
        }
        is_first = false;
        let changed = lock(&state.found).take(found);
        if state.tell(problems) | changed {
            wake();
        }
        let is_found = !lock(&state.found).is_empty();
        let pause = if is_found { LONG_PAUSE } else { PAUSE };
        clock::sleep_until(Monotonic::now() + pause, || {
            is_closing() || state.is_hurried.swap(false, Ordering::Relaxed)
        });
    }
}

impl State {
    /// Says the first of these problems that still concerns anybody; whether that is another than before.
    fn tell(&self, problems: Vec<Problem>) -> bool {
        let typed = lock(&self.typed);
        let problem = problems.into_iter().find(|problem| {
            let address = problem.address.as_ref();
            // It may have been forgotten while it was asked.
            address.is_none_or(|address| typed.contains(address))
        });
        let mut told = lock(&self.problem);
        let changed = *told != problem;
        *told = problem;
        changed
    }
}

fn ask_all(state: &State, addresses: &[String], found: &mut Round, problems: &mut Vec<Problem>) {
    let addresses = &addresses[..addresses.len().min(MAX_ADDRESSES)];
    // Side by side: one that does not answer holds up no other.
    for some in addresses.chunks(ASKED_AT_ONCE) {
        if state.is_closing.load(Ordering::Relaxed) {
            return;
        }
        let answers: Vec<_> = thread::scope(|scope| {
            let asked: Vec<_> = some
                .iter()
                .map(|address| scope.spawn(move || robots_at(state, address)))
                .collect();
            asked.into_iter().map(ScopedJoinHandle::join).collect()
        });
        for (address, answer) in some.iter().zip(answers) {
            let words = match answer {
                Ok(Ok(robots)) => {
                    found.extend(robots);
                    continue;
                }
                Ok(Err(LinkError::Open { .. })) => {
                    format!("nobody answers at {address}; trying again")
                }
                Ok(Err(why)) => why.to_string(),
                Err(_panic) => format!("{address} could not be asked"),
            };
            problems.push(Problem {
                address: Some(address.clone()),
                words,
            });
        }
    }
}

fn robots_at(state: &State, address: &str) -> Result<Round, LinkError> {
    let endpoints = Endpoints {
        connect: vec![address.to_owned()],
        zenoh_config: state.zenoh_config.clone(),
        credentials: state.credentials.clone(),
        ..Endpoints::default()
    };
    let session = sessions::open(Side::Console, Channel::Control, &endpoints)?;
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
        .map_err(|why| LinkError::Declare { what, why })?;
    let mut robots = Round::new();
    while let Ok(reply) = tokens.recv() {
        let Ok(sample) = reply.result() else { continue };
        if let Some((robot, Topic::Alive)) = Topic::parse(sample.key_expr().as_str()) {
            let endpoint = address.to_owned();
            let at = Monotonic::now();
            robots.insert(FoundRobot { robot, endpoint }, Answer { at, state: None });
        }
    }
    let deadline = Monotonic::now() + STATUS_TIME;
    while robots.values().any(|answer| answer.state.is_none())
        && let Ok((robot, said)) = heard.recv_timeout(deadline.since(Monotonic::now()))
    {
        let mut robots = robots.iter_mut();
        if let Some((_, answer)) = robots.find(|(found, _)| found.robot == robot) {
            answer.state = Some(said);
        }
    }
    close(&session);
    Ok(robots)
}

/// The status of every robot.
fn every_robot_status() -> String {
    let alive = every_robot_alive();
    format!("{}status", alive.trim_end_matches("alive"))
}

/// The endpoints of the Zenoh processes that answer on the local network.
fn scout(problems: &mut Vec<Problem>) -> BTreeSet<String> {
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
            let words = format!("the local network cannot be searched: {why}");
            problems.push(Problem {
                address: None,
                words,
            });
            return BTreeSet::new();
        }
    };
    clock::sleep_until(Monotonic::now() + SCOUT_TIME, || false);
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
