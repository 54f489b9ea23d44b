//! Known robots in order of discovery, each at one of its endpoints. Silent robots stay until removed.

use std::collections::BTreeMap;

use measurement::time::Monotonic;
use protocol::keys::{OperatorId, RobotId};
use protocol::message::{Status, TeleopState};

/// A robot that misses this many rounds is absent.
const ROUNDS_KEPT: u32 = 3;
pub(super) const MAX_ROBOTS: usize = 256;

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct FoundRobot {
    pub robot: RobotId,
    pub endpoint: String,
}

#[derive(Clone, Debug, PartialEq)]
pub struct DiscoveredRobot {
    pub found: FoundRobot,
    pub seen: Monotonic,
    pub state: Option<FleetState>,
}

impl DiscoveredRobot {
    pub fn has_ended(&self) -> bool {
        self.state.as_ref().is_some_and(FleetState::has_ended)
    }
}

/// Result of one round: a robot may answer at several endpoints.
pub(super) type Round = BTreeMap<FoundRobot, Answer>;

#[derive(Clone, Debug)]
pub(super) struct Answer {
    pub(super) at: Monotonic,
    pub(super) state: Option<FleetState>,
}

#[derive(Debug, Default)]
pub(super) struct KnownRobots(Vec<Known>);

#[derive(Debug)]
struct Known {
    robot: DiscoveredRobot,
    rounds: u32,
}

impl KnownRobots {
    /// Takes the result of a round; returns whether the list changed.
    pub(super) fn take(&mut self, round: Round) -> bool {
        for known in &mut self.0 {
            known.rounds = known.rounds.saturating_add(1);
        }
        let mut answers: BTreeMap<RobotId, Vec<(String, Answer)>> = BTreeMap::new();
        for (FoundRobot { robot, endpoint }, answer) in round {
            answers.entry(robot).or_default().push((endpoint, answer));
        }
        let mut changed = false;
        for (robot, answers) in answers {
            changed |= self.add_answers(robot, answers);
        }
        changed || self.0.iter().any(|known| known.rounds == ROUNDS_KEPT)
    }

    pub(super) fn update_state(&mut self, robot: &RobotId, state: FleetState, at: Monotonic) {
        if let Some(known) = self.known(robot).filter(|known| known.robot.seen < at) {
            (known.robot.state, known.robot.seen) = (Some(state), at);
        }
    }

    pub(super) fn mark_seen(&mut self, robot: &RobotId, at: Monotonic) {
        if let Some(known) = self.known(robot) {
            known.robot.seen = known.robot.seen.max(at);
        }
    }

    pub(super) fn forget(&mut self, robot: &RobotId) {
        self.0.retain(|known| known.robot.found.robot != *robot);
    }

    pub(super) fn discovered_robots(&self) -> impl Iterator<Item = DiscoveredRobot> {
        self.0.iter().map(|known| known.robot.clone())
    }

    pub(super) fn present(&self) -> impl Iterator<Item = &FoundRobot> {
        let present = self.0.iter().filter(|known| known.rounds < ROUNDS_KEPT);
        present.map(|known| &known.robot.found)
    }

    fn known(&mut self, robot: &RobotId) -> Option<&mut Known> {
        let mut all = self.0.iter_mut();
        all.find(|known| known.robot.found.robot == *robot)
    }

    fn make_room(&mut self) -> bool {
        if self.0.len() < MAX_ROBOTS {
            return true;
        }
        let all = self.0.iter().enumerate();
        let silent = all.filter(|(_, known)| known.rounds >= ROUNDS_KEPT);
        let longest = silent.max_by_key(|(_, known)| known.rounds);
        let index = longest.map(|(index, _)| index);
        index.map(|index| self.0.remove(index)).is_some()
    }

    fn add_answers(&mut self, robot: RobotId, answers: Vec<(String, Answer)>) -> bool {
        let mut all = self.0.iter().map(|known| &known.robot);
        let known = all.find(|known| known.found.robot == robot);
        // A known endpoint stays as long as it answers.
        let is_known = |(endpoint, _): &(String, _)| {
            known.is_some_and(|known| known.found.endpoint == *endpoint)
        };
        let index = answers.iter().position(is_known).unwrap_or_default();
        let Some((endpoint, mut answer)) = answers.into_iter().nth(index) else {
            return false;
        };
        // Its own link may have reported meanwhile.
        if let Some(known) = known.filter(|known| known.seen > answer.at) {
            answer = Answer {
                at: known.seen,
                state: known.state.clone().or(answer.state),
            };
        }
        let changed = known
            .is_none_or(|known| known.found.endpoint != endpoint || known.state != answer.state);
        let Answer { at: seen, state } = answer;
        let found = FoundRobot { robot, endpoint };
        let now_known = Known {
            robot: DiscoveredRobot { found, seen, state },
            rounds: 0,
        };
        if let Some(known) = self.known(&now_known.robot.found.robot) {
            *known = now_known;
            return changed;
        }
        let has_room = self.make_room();
        if has_room {
            self.0.push(now_known);
        }
        has_room
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FleetState {
    /// A recording, or a robot without motors.
    NotDrivable,
    Ended,
    Free,
    DrivenBy(OperatorId),
    EStop {
        has_ended: bool,
    },
    Fault {
        has_ended: bool,
    },
}

impl FleetState {
    pub fn of(status: &Status) -> Self {
        let Some(teleop) = &status.teleop else {
            return if status.has_ended {
                Self::Ended
            } else {
                Self::NotDrivable
            };
        };
        let has_ended = status.has_ended;
        match (&teleop.state, teleop.estop, &teleop.lease.holder) {
            (TeleopState::Fault(_), ..) => Self::Fault { has_ended },
            (_, Some(_), _) => Self::EStop { has_ended },
            (_, None, _) if has_ended => Self::Ended,
            (_, None, Some(holder)) => Self::DrivenBy(holder.clone()),
            (_, None, None) => Self::Free,
        }
    }

    pub const fn has_ended(&self) -> bool {
        match self {
            Self::Ended => true,
            Self::EStop { has_ended } | Self::Fault { has_ended } => *has_ended,
            Self::NotDrivable | Self::Free | Self::DrivenBy(_) => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use protocol::message::{FaultReason, TeleopStatus};

    use super::*;
    use crate::test_support::{STORED_ESTOP, at, idle_teleop_status, status_of};

    fn round(found: &[(&str, &str)], ms: u64) -> Round {
        let answer = Answer {
            at: at(ms),
            state: Some(FleetState::Free),
        };
        found
            .iter()
            .map(|(robot, endpoint)| {
                let found = FoundRobot {
                    robot: robot.parse().unwrap(),
                    endpoint: (*endpoint).to_owned(),
                };
                (found, answer.clone())
            })
            .collect()
    }

    fn listed(robots: &KnownRobots) -> Vec<(String, String, Monotonic)> {
        let line =
            |DiscoveredRobot { found, seen, .. }| (found.robot.to_string(), found.endpoint, seen);
        robots.discovered_robots().map(line).collect()
    }

    fn line(robot: &str, endpoint: &str, ms: u64) -> (String, String, Monotonic) {
        (robot.to_owned(), endpoint.to_owned(), at(ms))
    }

    #[test]
    fn robot_keeps_its_endpoint_while_it_answers() {
        let mut robots = KnownRobots::default();
        assert!(robots.take(round(&[("boat", "tcp/b:1")], 1)));
        // At another endpoint too, which would come first.
        let both = [("boat", "tcp/a:1"), ("boat", "tcp/b:1")];
        assert!(!robots.take(round(&both, 2)), "no change");
        assert_eq!(listed(&robots), [line("boat", "tcp/b:1", 2)]);
        // Its known endpoint is dead.
        let moved = round(&[("boat", "tcp/c:1")], 3);
        assert!(robots.take(moved));
        assert_eq!(listed(&robots), [line("boat", "tcp/c:1", 3)]);
        assert!(!robots.take(round(&[("boat", "tcp/c:1")], 4)));
        assert!(!robots.take(round(&[("boat", "tcp/c:1"), ("boat", "tcp/b:1")], 5)));
        assert_eq!(listed(&robots), [line("boat", "tcp/c:1", 5)]);
    }

    #[test]
    fn own_link_is_newer_than_discovery() {
        let boat = "boat".parse().unwrap();
        let mut robots = KnownRobots::default();
        let states = |robots: &KnownRobots| -> Vec<_> {
            let seen = robots.discovered_robots();
            seen.map(|discovered| (discovered.state.unwrap(), discovered.seen))
                .collect()
        };
        let estop = FleetState::EStop { has_ended: false };
        robots.update_state(&boat, estop.clone(), at(1));
        assert_eq!(states(&robots), [], "no endpoint");
        robots.take(round(&[("boat", "tcp/b:1")], 5));
        robots.update_state(&boat, estop.clone(), at(4));
        assert_eq!(states(&robots), [(FleetState::Free, at(5))]);
        robots.update_state(&boat, estop.clone(), at(7));
        assert_eq!(states(&robots), [(estop.clone(), at(7))]);
        // A round that had begun before.
        assert!(!robots.take(round(&[("boat", "tcp/b:1")], 6)));
        assert_eq!(states(&robots), [(estop, at(7))]);
        assert!(robots.take(round(&[("boat", "tcp/b:1")], 8)));
        assert_eq!(states(&robots), [(FleetState::Free, at(8))]);
    }

    #[test]
    fn silent_robot_stays_listed_until_removed() {
        let mut robots = KnownRobots::default();
        robots.take(round(&[("b", "tcp/b:1")], 1));
        robots.take(round(&[("a", "tcp/a:1"), ("b", "tcp/b:1")], 2));
        let only_a = || round(&[("a", "tcp/a:1")], 3);
        assert!(!robots.take(only_a()));
        assert!(!robots.take(only_a()));
        assert_eq!(robots.present().count(), 2);
        assert!(robots.take(only_a()), "b is missed");
        assert!(!robots.take(only_a()), "that is known");
        let present: Vec<_> = robots.present().map(|found| &*found.endpoint).collect();
        assert_eq!(present, ["tcp/a:1"]);
        let (a, b) = (line("a", "tcp/a:1", 3), line("b", "tcp/b:1", 2));
        assert_eq!(listed(&robots), [b, a.clone()], "as first found");
        robots.forget(&"b".parse().unwrap());
        assert_eq!(listed(&robots), [a]);
    }

    #[test]
    fn contact_without_state_counts_as_seen() {
        let boat = "boat".parse().unwrap();
        let mut robots = KnownRobots::default();
        robots.take(round(&[("boat", "tcp/b:1")], 5));
        for (heard_ms, seen_ms) in [(4, 5), (7, 7)] {
            robots.mark_seen(&boat, at(heard_ms));
            assert_eq!(listed(&robots), [line("boat", "tcp/b:1", seen_ms)]);
        }
    }

    #[test]
    fn only_so_many_robots_are_listed() {
        let mut robots = KnownRobots::default();
        let names: Vec<_> = (0..=MAX_ROBOTS).map(|n| format!("r{n:04}")).collect();
        let all = names.iter().map(|name| (name.as_str(), "tcp/a:1"));
        let all: Vec<_> = all.collect();
        assert!(robots.take(round(&all, 1)));
        assert_eq!(listed(&robots).len(), MAX_ROBOTS);
        assert!(!robots.take(round(&all, 2)));
        // A silent robot is removed, but not after a single missed round.
        for newest in ["r0255", "r0255", "r0256"] {
            robots.take(round(&all[1..], 3));
            let listed = listed(&robots);
            assert_eq!(
                (listed.len(), &*listed[MAX_ROBOTS - 1].0),
                (MAX_ROBOTS, newest)
            );
        }
    }

    #[test]
    fn most_important_state_is_shown() {
        let state = |teleop: &TeleopStatus| FleetState::of(&status_of(teleop.clone()));
        let mut teleop = idle_teleop_status();
        let anna: OperatorId = "anna".parse().unwrap();
        teleop.lease.holder = Some(anna.clone());
        assert_eq!(state(&teleop), FleetState::DrivenBy(anna));
        teleop.estop = Some(STORED_ESTOP);
        let has_ended = false;
        assert_eq!(state(&teleop), FleetState::EStop { has_ended });
        teleop.state = TeleopState::Fault(FaultReason::Actuator);
        assert_eq!(state(&teleop), FleetState::Fault { has_ended });
    }

    #[test]
    fn a_robot_whose_data_has_ended_is_not_free() {
        let state = |teleop, has_ended| {
            FleetState::of(&Status {
                teleop,
                has_ended,
                ..Status::default()
            })
        };
        let mut teleop = idle_teleop_status();
        assert_eq!(state(Some(teleop.clone()), false), FleetState::Free);
        assert_eq!(state(Some(teleop.clone()), true), FleetState::Ended);
        assert_eq!(state(None, true), FleetState::Ended);
        assert_eq!(state(None, false), FleetState::NotDrivable);
        teleop.state = TeleopState::Fault(FaultReason::Actuator);
        let fault = FleetState::Fault { has_ended: true };
        assert_eq!(
            state(Some(teleop.clone()), true),
            fault,
            "that matters more"
        );
        teleop.state = TeleopState::EStop;
        teleop.estop = Some(STORED_ESTOP);
        // An operator who stops a vehicle and closes it sees both.
        for has_ended in [false, true] {
            let stopped = state(Some(teleop.clone()), has_ended);
            assert_eq!(stopped, FleetState::EStop { has_ended });
            assert_eq!(stopped.has_ended(), has_ended);
        }
        assert!(FleetState::Ended.has_ended() && !FleetState::Free.has_ended());
    }
}
