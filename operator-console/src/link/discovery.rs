//! Which robots there are: scouts the local network and asks at typed addresses.
//!
//! Scouting finds Zenoh processes; which robots can be reached through one is asked over a short session, by
//! presence tokens. So a router that was found or typed lists every robot behind it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use protocol::keys::{RobotId, Topic, every_robot_alive};
use robot_edge::clock::{self, Monotonic};
use robot_edge::credentials::Credentials;
use robot_edge::link::LinkError;
use robot_edge::link::endpoints::{Channel, bulk_endpoint};
use robot_edge::link::sessions::{self, Endpoints, Side};
use zenoh::Wait;
use zenoh::config::WhatAmI;

use super::lock;

const SCOUT_TIME: Duration = Duration::from_millis(500);
const ASK_TIMEOUT: Duration = Duration::from_secs(1);
/// Between two rounds, while nothing is found.
const PAUSE: Duration = Duration::from_secs(2);
/// Between two rounds otherwise: they use the link that somebody watches a robot over.
const LONG_PAUSE: Duration = Duration::from_secs(10);
/// A robot that did not answer for so many rounds is gone.
const ROUNDS_KEPT: u32 = 3;
/// Processes that are asked in one round.
const MAX_ADDRESSES: usize = 32;
/// Robots that are listed.
const MAX_ROBOTS: usize = 256;

/// A robot that can be watched.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct FoundRobot {
    /// Its name.
    pub robot: RobotId,
    /// Control endpoint through which it is reached.
    pub endpoint: String,
}

/// Looks for robots until it is dropped.
pub struct Discovery {
    state: Arc<State>,
}

struct State {
    typed: Mutex<BTreeSet<String>>,
    zenoh_config: Option<PathBuf>,
    credentials: Option<Credentials>,
    /// With the rounds since it was last heard of.
    found: Mutex<BTreeMap<FoundRobot, u32>>,
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

    /// The robots that are there, by name.
    pub fn found(&self) -> Vec<FoundRobot> {
        lock(&self.state.found).keys().cloned().collect()
    }

    /// What kept the last round from finding more, in words.
    pub fn problem(&self) -> Option<String> {
        lock(&self.state.problem).clone()
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
        let mut found = BTreeSet::new();
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
        let problem = problems.into_iter().next();
        let changed = note(state, found) | (*lock(&state.problem) != problem);
        *lock(&state.problem) = problem;
        if changed {
            wake();
        }
        let is_found = !lock(&state.found).is_empty();
        let pause = if is_found { LONG_PAUSE } else { PAUSE };
        clock::sleep_until(Monotonic::now() + pause, || {
            is_closing() || state.is_hurried.swap(false, Ordering::Relaxed)
        });
    }
}

/// Whether the list is another now.
fn note(state: &State, found: BTreeSet<FoundRobot>) -> bool {
    let mut known = lock(&state.found);
    let before = known.len();
    for rounds in known.values_mut() {
        *rounds += 1;
    }
    known.retain(|_, rounds| *rounds < ROUNDS_KEPT);
    let mut changed = known.len() != before;
    for robot in found {
        // Through several addresses it is still one robot: the first one stays.
        let same = known
            .keys()
            .find(|known| known.robot == robot.robot)
            .cloned();
        changed |= same.is_none();
        if same.is_some() || known.len() < MAX_ROBOTS {
            known.insert(same.unwrap_or(robot), 0);
        }
    }
    changed
}

fn ask_all(
    state: &State,
    addresses: &[String],
    found: &mut BTreeSet<FoundRobot>,
    problems: &mut Vec<String>,
) {
    for address in addresses.iter().take(MAX_ADDRESSES) {
        if state.is_closing.load(Ordering::Relaxed) {
            return;
        }
        match robots_at(state, address) {
            Ok(robots) => found.extend(robots),
            Err(LinkError::Open { .. }) => {
                problems.push(format!("nobody answers at {address}; trying again"));
            }
            Err(why) => problems.push(why.to_string()),
        }
    }
}

fn robots_at(state: &State, address: &str) -> Result<Vec<FoundRobot>, LinkError> {
    let endpoints = Endpoints {
        connect: vec![address.to_owned()],
        zenoh_config: state.zenoh_config.clone(),
        credentials: state.credentials.clone(),
        ..Endpoints::default()
    };
    let session = sessions::open(Side::Console, Channel::Control, &endpoints)?;
    let what = every_robot_alive();
    let tokens = session
        .liveliness()
        .get(what.clone())
        .timeout(ASK_TIMEOUT)
        .wait()
        .map_err(|why| LinkError::Declare { what, why })?;
    let mut robots = Vec::new();
    while let Ok(reply) = tokens.recv() {
        let Ok(sample) = reply.result() else { continue };
        if let Some((robot, Topic::Alive)) = Topic::parse(sample.key_expr().as_str()) {
            robots.push(FoundRobot {
                robot,
                endpoint: address.to_owned(),
            });
        }
    }
    if let Err(why) = session.close().wait() {
        tracing::debug!(%why, "a session did not close");
    }
    Ok(robots)
}

/// The endpoints of the Zenoh processes that answer on the local network.
fn scout(problems: &mut Vec<String>) -> BTreeSet<String> {
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
            problems.push(format!("the local network cannot be searched: {why}"));
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
