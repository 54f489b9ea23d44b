//! The robot of a command without a window: search, messages while waiting, and why it was not found.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write as _};
use std::path::PathBuf;
use std::time::Duration;

use anyhow::anyhow;
use edge::exit::{Interrupted, UsageError};
use measurement::time::Monotonic;
use network::clock;
use network::credentials::Credentials;
use network::sessions::Endpoints;
use network::{random_id, zenoh_config_file};
use protocol::keys::RobotId;
use protocol::layer::LayerId;
use protocol::tile::BootId;

use crate::link::{AddressState, Discovery, FoundRobot, RobotSession};
use crate::model::ModelSettings;

const POLL_PERIOD: Duration = Duration::from_millis(20);

#[derive(Clone, Debug)]
pub(crate) struct Target {
    /// Addresses to search; if empty, the network is scouted.
    pub(crate) connect: Vec<String>,
    pub(crate) robot: Option<RobotId>,
    pub(crate) zenoh_config: Option<PathBuf>,
    pub(crate) credentials: Option<Credentials>,
    pub(crate) timeout: Duration,
    pub(crate) quiet: bool,
}

impl Target {
    pub(crate) fn wait_for_robot(&self, found: &FoundRobot) -> WaitForRobot {
        WaitForRobot::new(Self {
            connect: vec![found.endpoint.clone()],
            robot: Some(found.robot.clone()),
            ..self.clone()
        })
    }

    pub(crate) fn open(
        &self,
        found: &FoundRobot,
        layers: BTreeSet<LayerId>,
        tile_store_mb: u32,
    ) -> anyhow::Result<RobotSession> {
        let model = ModelSettings {
            robot: found.robot.clone(),
            session: BootId(random_id()?),
            tile_store_mb,
            layers,
        };
        let endpoints = Endpoints {
            connect: vec![found.endpoint.clone()],
            zenoh_config: zenoh_config_file(self.zenoh_config.clone()),
            credentials: self.credentials.clone(),
            ..Endpoints::default()
        };
        Ok(RobotSession::open(model, &endpoints, || {}))
    }

    fn start_discovery(&self) -> Discovery {
        Discovery::start(
            self.connect.clone(),
            self.connect.is_empty(),
            zenoh_config_file(self.zenoh_config.clone()),
            self.credentials.clone(),
            || {},
        )
    }

    fn place(&self) -> String {
        match &self.connect[..] {
            [] => "on the local network".to_owned(),
            addresses => format!("at {}", addresses.join(", ")),
        }
    }

    pub(crate) fn looking(&self) -> String {
        let place = self.place();
        match &self.robot {
            Some(robot) => format!("looking for robot {robot} {place}"),
            None => format!("looking for a robot {place}"),
        }
    }

    /// Finds the named robot, or the only one.
    pub(crate) fn find(&self, is_interrupted: &impl Fn() -> bool) -> anyhow::Result<FoundRobot> {
        // A named robot at one address needs no search.
        if let (Some(robot), [endpoint]) = (&self.robot, &self.connect[..]) {
            return Ok(FoundRobot {
                robot: robot.clone(),
                endpoint: endpoint.clone(),
            });
        }
        let discovery = self.start_discovery();
        let started = clock::now();
        let deadline = started + self.timeout;
        let mut notice = DelayedNotice::new(self.timeout, self.quiet, started);
        let mut found = Vec::new();
        let is_found = |found: &[FoundRobot]| match &self.robot {
            Some(robot) => found.iter().any(|found| found.robot == *robot),
            None => !found.is_empty(),
        };
        while !is_found(&found) {
            let now = clock::now();
            if deadline.since(now).is_zero() {
                return Err(anyhow!(DiscoveryReport::of(&discovery).conclusion(self)));
            }
            if notice.is_due(now) {
                notice.print_once(&DiscoveryReport::of(&discovery).waiting(self));
            }
            if !clock::sleep_until(now + POLL_PERIOD, is_interrupted) {
                return Err(Interrupted.into());
            }
            found = discovery.found();
        }
        match &self.robot {
            Some(robot) => found.retain(|found| found.robot == *robot),
            None if found.len() > 1 => {
                let names: Vec<_> = found.iter().map(|found| found.robot.to_string()).collect();
                return Err(UsageError(format!(
                    "there are several robots ({}): name one with --robot",
                    names.join(", ")
                ))
                .into());
            }
            None => {}
        }
        found.into_iter().next().ok_or_else(|| anyhow!("no robot"))
    }
}

/// By then a robot has answered, even over a slow link.
const SOON: Duration = Duration::from_secs(2);
/// A longer request counts as unanswered.
const ASKING_TIME: Duration = Duration::from_secs(8);

/// A notice that is printed once, if there is enough time left.
struct DelayedNotice {
    since: Monotonic,
    is_printed: bool,
}

impl DelayedNotice {
    const fn new(timeout: Duration, is_quiet: bool, since: Monotonic) -> Self {
        Self {
            since,
            is_printed: is_quiet || timeout.as_nanos() <= SOON.as_nanos(),
        }
    }

    fn is_due(&self, now: Monotonic) -> bool {
        !self.is_printed && now.since(self.since) >= SOON
    }

    fn print_once(&mut self, words: &str) {
        self.is_printed = true;
        // A closed standard error is no reason to stop.
        drop(writeln!(io::stderr(), "{words}"));
    }
}

/// Searches for other robots while a link waits for its robot, if that takes long.
pub(crate) struct WaitForRobot {
    target: Target,
    notice: DelayedNotice,
    discovery: Option<Discovery>,
}

impl WaitForRobot {
    fn new(target: Target) -> Self {
        Self {
            notice: DelayedNotice::new(target.timeout, target.quiet, clock::now()),
            target,
            discovery: None,
        }
    }

    fn report(&mut self) -> DiscoveryReport {
        let discovery = self
            .discovery
            .get_or_insert_with(|| self.target.start_discovery());
        DiscoveryReport::of(discovery)
    }

    /// Reports once that the robot has not been found yet, and which robots are there instead.
    pub(crate) fn report_progress(&mut self, now: Monotonic) {
        if !self.notice.is_due(now) {
            return;
        }
        let report = self.report();
        if report.is_known() {
            self.notice.print_once(&report.waiting(&self.target));
        }
    }

    /// The robot has answered: nothing else is searched for.
    pub(crate) fn end(&mut self) {
        self.discovery = None;
    }

    /// Why the robot was not found. Waits for the search if it has just begun.
    pub(crate) fn conclusion(mut self, is_interrupted: &impl Fn() -> bool) -> anyhow::Error {
        let deadline = clock::now() + ASKING_TIME;
        loop {
            let report = self.report();
            if report.is_known() || deadline.since(clock::now()).is_zero() {
                return anyhow!(report.conclusion(&self.target));
            }
            if !clock::sleep_until(clock::now() + POLL_PERIOD, is_interrupted) {
                return Interrupted.into();
            }
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
struct DiscoveryReport {
    found: Vec<FoundRobot>,
    asked: BTreeMap<String, AddressState>,
    problem: Option<String>,
}

impl DiscoveryReport {
    fn of(discovery: &Discovery) -> Self {
        Self {
            // Read before the robots: an address is marked a moment before its robots are listed.
            asked: discovery.asked(),
            found: discovery.found(),
            problem: discovery.problem(),
        }
    }

    /// Whether every address was asked and the answers are complete.
    fn is_known(&self) -> bool {
        let is = |wanted: &AddressState| self.asked.values().any(|state| state == wanted);
        !is(&AddressState::Asking) && (!is(&AddressState::Found) || !self.found.is_empty())
    }

    fn has(&self, robot: &RobotId) -> bool {
        self.found.iter().any(|found| found.robot == *robot)
    }

    fn answering_robots(&self, target: &Target) -> Option<String> {
        let names: BTreeSet<_> = self
            .found
            .iter()
            .map(|found| found.robot.to_string())
            .collect();
        let answer = match names.len() {
            0 => return None,
            1 => "answers",
            _ => "answer",
        };
        let names: Vec<_> = names.into_iter().collect();
        Some(format!("{} {answer} {}", names.join(", "), target.place()))
    }

    fn access_denied(&self, target: &Target) -> Option<String> {
        let is_meant = |state: &AddressState| match state {
            AddressState::AccessDenied { robot, .. } => {
                target.robot.as_ref().is_none_or(|meant| meant == robot)
            }
            _ => false,
        };
        let mut asked = self.asked.iter();
        let (address, state) = asked.find(|&(_, state)| is_meant(state))?;
        state.complaint(address)
    }

    fn state(&self, target: &Target) -> (String, &'static str) {
        if let Some(why) = self.access_denied(target) {
            return (why, "");
        }
        let is_scouting = target.connect.is_empty();
        match (self.answering_robots(target), &target.robot) {
            (Some(others), Some(robot)) if !self.has(robot) => {
                let advice = if is_scouting {
                    "; check the name after --robot, or say where it is with --connect"
                } else {
                    "; check the name after --robot, or the address after --connect"
                };
                let state = format!("{others}: no robot there is called {robot}");
                (state, advice)
            }
            (Some(it), _) => (format!("{it}, and has sent nothing"), ""),
            (None, _) => {
                let advice = if is_scouting {
                    "; start one with `robot-edge`, or name its address with --connect"
                } else {
                    "; start one with `robot-edge ... --listen`, or check the address"
                };
                let why = self.discovery_problems();
                let why = why.map(|why| format!(" ({why})")).unwrap_or_default();
                (format!("there is no robot {}{why}", target.place()), advice)
            }
        }
    }

    fn waiting(&self, target: &Target) -> String {
        let (state, _) = self.state(target);
        let seconds = target.timeout.as_secs_f64();
        format!("{state}. Trying for {seconds:.0} s")
    }

    fn conclusion(&self, target: &Target) -> String {
        let (state, advice) = self.state(target);
        format!("{state}{advice}")
    }

    fn discovery_problems(&self) -> Option<String> {
        let is_single = self.asked.len() == 1;
        let of_addresses = self
            .asked
            .iter()
            .filter_map(|(address, state)| match state {
                AddressState::Refused | AddressState::Silent if is_single => {
                    Some("no answer there".to_owned())
                }
                AddressState::Refused | AddressState::Silent => {
                    Some(format!("no answer at {address}"))
                }
                _ => state.complaint(address),
            });
        let all: Vec<_> = self
            .problem
            .clone()
            .into_iter()
            .chain(of_addresses)
            .collect();
        (!all.is_empty()).then(|| all.join("; "))
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn silence_is_reported_once_and_soon() {
        const fn at(s: u64) -> Monotonic {
            Monotonic::from_nanos(s * 1_000_000_000)
        }
        let minute = Duration::from_mins(1);
        let mut notice = DelayedNotice::new(minute, false, at(10));
        assert!(!notice.is_due(at(11)));
        assert!(notice.is_due(at(12)));
        notice.print_once("no answer");
        assert!(!notice.is_due(at(13)));
        for silent in [
            DelayedNotice::new(minute, true, at(10)),
            DelayedNotice::new(Duration::from_secs(1), false, at(10)),
        ] {
            assert!(!silent.is_due(at(30)));
        }
    }

    fn target(connect: &[&str], robot: Option<&str>) -> Target {
        Target {
            connect: connect.iter().copied().map(str::to_owned).collect(),
            robot: robot.map(|name| name.parse().unwrap()),
            zenoh_config: None,
            credentials: None,
            timeout: Duration::from_secs(5),
            quiet: false,
        }
    }

    fn report(robots: &[&str], asked: &[(&str, AddressState)]) -> DiscoveryReport {
        let found = |name: &&str| FoundRobot {
            robot: name.parse().unwrap(),
            endpoint: "tcp/a:1".to_owned(),
        };
        DiscoveryReport {
            found: robots.iter().map(found).collect(),
            asked: asked
                .iter()
                .map(|(address, state)| ((*address).to_owned(), state.clone()))
                .collect(),
            problem: None,
        }
    }

    #[test]
    fn other_robots_are_named() {
        let nobody = target(&["tcp/a:1"], Some("nobody"));
        let scout = report(&["scout"], &[("tcp/a:1", AddressState::Found)]);
        assert_eq!(
            scout.waiting(&nobody),
            "scout answers at tcp/a:1: no robot there is called nobody. Trying for 5 s"
        );
        assert_eq!(
            scout.conclusion(&nobody),
            "scout answers at tcp/a:1: no robot there is called nobody; \
             check the name after --robot, or the address after --connect"
        );
        let two = report(&["scout", "spare"], &[]);
        assert_eq!(
            two.conclusion(&target(&[], Some("nobody"))),
            "scout, spare answer on the local network: no robot there is called nobody; \
             check the name after --robot, or say where it is with --connect"
        );
        assert_eq!(
            scout.conclusion(&target(&["tcp/a:1"], Some("scout"))),
            "scout answers at tcp/a:1, and has sent nothing"
        );
    }

    #[test]
    fn advice_depends_on_the_search() {
        let refused = ("tcp/a:1", AddressState::Refused);
        let one = report(&[], std::slice::from_ref(&refused));
        assert_eq!(
            one.waiting(&target(&["tcp/a:1"], None)),
            "there is no robot at tcp/a:1 (no answer there). Trying for 5 s"
        );
        assert_eq!(
            one.conclusion(&target(&["tcp/a:1"], None)),
            "there is no robot at tcp/a:1 (no answer there); \
             start one with `robot-edge ... --listen`, or check the address"
        );
        let two = report(&[], &[refused, ("tcp/b:2", AddressState::UnknownName)]);
        assert_eq!(
            two.conclusion(&target(&["tcp/a:1", "tcp/b:2"], None)),
            "there is no robot at tcp/a:1, tcp/b:2 (no answer at tcp/a:1; the name in tcp/b:2 is not known); \
             start one with `robot-edge ... --listen`, or check the address"
        );
        assert_eq!(
            DiscoveryReport::default().conclusion(&target(&[], None)),
            "there is no robot on the local network; \
             start one with `robot-edge`, or name its address with --connect"
        );
    }

    #[test]
    fn robot_that_denies_access_is_not_absent() {
        let access_denied = |robot: &str| AddressState::AccessDenied {
            robot: robot.parse().unwrap(),
            by_quic: true,
        };
        let there = report(&[], &[("quic/a:1", access_denied("scout"))]);
        let why = "scout answers at quic/a:1 but denies access: you are not on its list of operators; \
                   access is granted within two seconds of being added";
        for robot in [None, Some("scout")] {
            let target = target(&["quic/a:1"], robot);
            assert_eq!(there.conclusion(&target), why);
            let waiting = format!("{why}. Trying for 5 s");
            assert_eq!(there.waiting(&target), waiting);
        }
        let other = there.conclusion(&target(&["quic/a:1"], Some("spare")));
        assert!(
            other.starts_with("there is no robot at quic/a:1 (scout answers"),
            "{other}"
        );
    }

    #[test]
    fn pending_address_has_no_complaint() {
        let asked = |state: AddressState| [("tcp/a:1", state)];
        assert!(!report(&[], &asked(AddressState::Asking)).is_known());
        assert!(!report(&[], &asked(AddressState::Found)).is_known());
        assert!(report(&["scout"], &asked(AddressState::Found)).is_known());
        assert!(report(&[], &asked(AddressState::Silent)).is_known());
    }
}
