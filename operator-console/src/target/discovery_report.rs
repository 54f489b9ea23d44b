//! Who is there instead of a robot that is not, in words.

use std::collections::{BTreeMap, BTreeSet};

use protocol::keys::RobotId;

use super::Target;
use crate::link::{AddressState, Discovery, FoundRobot};

/// What looking for robots has found so far.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct DiscoveryReport {
    /// The robots that answer.
    pub(super) found: Vec<FoundRobot>,
    /// The addresses that are asked, and what came of it.
    pub(super) asked: BTreeMap<String, AddressState>,
    /// Why the local network cannot be searched.
    pub(super) problem: Option<String>,
}

impl DiscoveryReport {
    /// As it is known now.
    pub(super) fn of(discovery: &Discovery) -> Self {
        Self {
            // Before the robots: who answers at an address is told a moment after that somebody does.
            asked: discovery.asked(),
            found: discovery.found(),
            problem: discovery.problem(),
        }
    }

    /// Whether every address was asked, and who answered is known.
    pub(super) fn is_known(&self) -> bool {
        let is = |wanted: &AddressState| self.asked.values().any(|state| state == wanted);
        !is(&AddressState::Asking) && (!is(&AddressState::Found) || !self.found.is_empty())
    }

    fn has(&self, robot: &RobotId) -> bool {
        self.found.iter().any(|found| found.robot == *robot)
    }

    /// "scout answers at tcp/boat:7447"; `None` where nobody does.
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

    /// Why the robot that is meant tells nothing, where that is known.
    fn access_denied(&self, target: &Target) -> Option<String> {
        let is_meant = |state: &AddressState| match state {
            AddressState::AccessDenied { robot, .. } => {
                target.robot.as_ref().is_none_or(|meant| meant == robot)
            }
            AddressState::Asking
            | AddressState::Found
            | AddressState::NoRobot
            | AddressState::UnknownName
            | AddressState::Refused
            | AddressState::Silent
            | AddressState::WrongProtocol
            | AddressState::Problem(_) => false,
        };
        let mut asked = self.asked.iter();
        let (address, state) = asked.find(|&(_, state)| is_meant(state))?;
        state.complaint(address)
    }

    /// What is said while `target` has not been heard yet.
    pub(super) fn waiting(&self, target: &Target) -> String {
        let seconds = format!("{:.0}", target.timeout.as_secs_f64());
        if let Some(why) = self.access_denied(target) {
            return format!("{why}. Trying for {seconds} s");
        }
        match (self.answering_robots(target), &target.robot) {
            (Some(others), Some(robot)) if !self.has(robot) => {
                format!("{others}, and no robot called {robot} yet: trying for {seconds} s")
            }
            (Some(it), _) => format!("{it} and sends nothing yet: trying for {seconds} s"),
            (None, _) => {
                let place = target.place();
                format!("no answer {place} yet: trying for {seconds} s")
            }
        }
    }

    /// Why `target` was not heard in time, and what to do.
    pub(super) fn conclusion(&self, target: &Target) -> String {
        if let Some(why) = self.access_denied(target) {
            return why;
        }
        match (self.answering_robots(target), &target.robot) {
            (Some(others), Some(robot)) if !self.has(robot) => {
                let elsewhere = if target.connect.is_empty() {
                    "say where it is with --connect"
                } else {
                    "the address after --connect"
                };
                format!(
                    "{others}: no robot there is called {robot}; check the name after --robot, or {elsewhere}"
                )
            }
            (Some(it), _) => format!("{it}, and has sent nothing"),
            (None, _) => {
                let advice = if target.connect.is_empty() {
                    "start one with `robot-edge`, or name its address with --connect"
                } else {
                    "start one with `robot-edge ... --listen`, or check the address"
                };
                let place = target.place();
                let why = self
                    .discovery_problems()
                    .map(|why| format!(" ({why})"))
                    .unwrap_or_default();
                format!("there is no robot {place}{why}; {advice}")
            }
        }
    }

    /// What kept robots from being found. Nobody is trying again by then.
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
                AddressState::Asking
                | AddressState::Found
                | AddressState::NoRobot
                | AddressState::AccessDenied { .. }
                | AddressState::UnknownName
                | AddressState::WrongProtocol
                | AddressState::Problem(_) => state.complaint(address),
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
    fn who_is_there_instead_is_named() {
        let nobody = target(&["tcp/a:1"], Some("nobody"));
        let scout = report(&["scout"], &[("tcp/a:1", AddressState::Found)]);
        assert_eq!(
            scout.waiting(&nobody),
            "scout answers at tcp/a:1, and no robot called nobody yet: trying for 5 s"
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
    fn where_nobody_is_the_advice_is_what_was_not_done_yet() {
        let refused = ("tcp/a:1", AddressState::Refused);
        let one = report(&[], std::slice::from_ref(&refused));
        assert_eq!(
            one.waiting(&target(&["tcp/a:1"], None)),
            "no answer at tcp/a:1 yet: trying for 5 s"
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
    fn a_robot_that_answers_and_tells_nothing_is_not_called_absent() {
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
    fn nothing_is_said_of_an_address_that_is_still_asked() {
        let asked = |state: AddressState| [("tcp/a:1", state)];
        assert!(!report(&[], &asked(AddressState::Asking)).is_known());
        assert!(!report(&[], &asked(AddressState::Found)).is_known());
        assert!(report(&["scout"], &asked(AddressState::Found)).is_known());
        assert!(report(&[], &asked(AddressState::Silent)).is_known());
    }
}
