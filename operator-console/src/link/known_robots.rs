//! Which robots are known from rounds of asking: each once, by its name, at one of the endpoints where it answers.

use std::collections::BTreeMap;

use protocol::keys::RobotId;
use robot_edge::clock::Monotonic;

use super::fleet_state::FleetState;

/// A robot that did not answer for so many rounds is gone.
const ROUNDS_KEPT: u32 = 3;
/// Robots that are listed.
pub(super) const MAX_ROBOTS: usize = 256;

/// A robot that can be watched.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct FoundRobot {
    /// Its name.
    pub robot: RobotId,
    /// Control endpoint through which it is reached.
    pub endpoint: String,
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

/// What one round has found: a robot may answer at several endpoints.
pub(super) type Round = BTreeMap<FoundRobot, Answer>;

/// A robot has answered.
#[derive(Clone, Debug)]
pub(super) struct Answer {
    /// When.
    pub(super) at: Monotonic,
    /// How it is; none where it has not said so.
    pub(super) state: Option<FleetState>,
}

/// The robots that answered lately.
#[derive(Debug, Default)]
pub(super) struct KnownRobots(BTreeMap<RobotId, Known>);

#[derive(Debug)]
struct Known {
    endpoint: String,
    /// Since it was last heard of.
    rounds: u32,
    seen: Monotonic,
    state: Option<FleetState>,
}

impl KnownRobots {
    /// A round is over; whether the list is another now.
    pub(super) fn take(&mut self, round: Round) -> bool {
        let before = self.0.len();
        for robot in self.0.values_mut() {
            robot.rounds += 1;
        }
        self.0.retain(|_, robot| robot.rounds < ROUNDS_KEPT);
        let mut changed = self.0.len() != before;
        let mut answers: BTreeMap<RobotId, Vec<(String, Answer)>> = BTreeMap::new();
        for (FoundRobot { robot, endpoint }, answer) in round {
            answers.entry(robot).or_default().push((endpoint, answer));
        }
        for (robot, answers) in answers {
            changed |= self.heard(robot, answers);
        }
        changed
    }

    /// A robot said more directly how it was at that time.
    pub(super) fn tell(&mut self, robot: &RobotId, state: FleetState, at: Monotonic) {
        if let Some(known) = self.0.get_mut(robot).filter(|known| known.seen < at) {
            (known.state, known.seen) = (Some(state), at);
        }
    }

    /// The robots, by name.
    pub(super) fn sightings(&self) -> impl Iterator<Item = Sighting> {
        self.0.iter().map(|(robot, known)| Sighting {
            found: FoundRobot {
                robot: robot.clone(),
                endpoint: known.endpoint.clone(),
            },
            seen: known.seen,
            state: known.state.clone(),
        })
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// `robot` has given these answers in one round, at different endpoints; whether anything is new.
    fn heard(&mut self, robot: RobotId, answers: Vec<(String, Answer)>) -> bool {
        let known = self.0.get(&robot);
        if known.is_none() && self.0.len() >= MAX_ROBOTS {
            return false;
        }
        // While it answers where it is known, it stays there; else it is where it answers now.
        let is_known =
            |(endpoint, _): &(String, _)| known.is_some_and(|known| known.endpoint == *endpoint);
        let index = answers.iter().position(is_known).unwrap_or_default();
        let Some((endpoint, mut answer)) = answers.into_iter().nth(index) else {
            return false;
        };
        // While it was asked, it said itself how it was.
        if let Some(known) = known.filter(|known| known.seen > answer.at) {
            answer = Answer {
                at: known.seen,
                state: known.state.clone(),
            };
        }
        let changed =
            known.is_none_or(|known| known.endpoint != endpoint || known.state != answer.state);
        let Answer { at: seen, state } = answer;
        self.0.insert(
            robot,
            Known {
                endpoint,
                rounds: 0,
                seen,
                state,
            },
        );
        changed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pretend::at;

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
        robots
            .sightings()
            .map(|Sighting { found, seen, .. }| (found.robot.to_string(), found.endpoint, seen))
            .collect()
    }

    fn line(robot: &str, endpoint: &str, ms: u64) -> (String, String, Monotonic) {
        (robot.to_owned(), endpoint.to_owned(), at(ms))
    }

    #[test]
    fn a_robot_stays_where_it_answers_and_moves_where_it_does_not() {
        let mut robots = KnownRobots::default();
        assert!(robots.take(round(&[("boat", "tcp/b:1")], 1)));
        // By another way too, which would come first.
        let both = [("boat", "tcp/a:1"), ("boat", "tcp/b:1")];
        assert!(!robots.take(round(&both, 2)), "nothing is new");
        assert_eq!(listed(&robots), [line("boat", "tcp/b:1", 2)]);
        // Its own is dead.
        assert!(
            robots.take(round(&[("boat", "tcp/c:1")], 3)),
            "it has moved"
        );
        assert_eq!(listed(&robots), [line("boat", "tcp/c:1", 3)]);
        assert!(!robots.take(round(&[("boat", "tcp/c:1")], 4)));
        assert!(!robots.take(round(&[("boat", "tcp/c:1"), ("boat", "tcp/b:1")], 5)));
        assert_eq!(listed(&robots), [line("boat", "tcp/c:1", 5)]);
    }

    #[test]
    fn what_a_robot_says_itself_is_newer_than_what_was_found_before() {
        let boat = "boat".parse().unwrap();
        let mut robots = KnownRobots::default();
        let states = |robots: &KnownRobots| -> Vec<_> {
            let seen = robots.sightings();
            seen.map(|sighting| (sighting.state.unwrap(), sighting.seen))
                .collect()
        };
        robots.tell(&boat, FleetState::EStop, at(1));
        assert_eq!(states(&robots), [], "nobody could join it");
        robots.take(round(&[("boat", "tcp/b:1")], 5));
        robots.tell(&boat, FleetState::EStop, at(4));
        assert_eq!(states(&robots), [(FleetState::Free, at(5))]);
        robots.tell(&boat, FleetState::EStop, at(7));
        assert_eq!(states(&robots), [(FleetState::EStop, at(7))]);
        // A round that had begun before.
        assert!(!robots.take(round(&[("boat", "tcp/b:1")], 6)));
        assert_eq!(states(&robots), [(FleetState::EStop, at(7))]);
        assert!(robots.take(round(&[("boat", "tcp/b:1")], 8)));
        assert_eq!(states(&robots), [(FleetState::Free, at(8))]);
    }

    #[test]
    fn a_robot_that_answers_nowhere_is_gone_after_three_rounds() {
        let mut robots = KnownRobots::default();
        robots.take(round(&[("a", "tcp/a:1"), ("b", "tcp/b:1")], 1));
        let only_b = || round(&[("b", "tcp/b:1")], 2);
        assert!(!robots.take(only_b()));
        assert!(!robots.take(only_b()));
        assert_eq!(listed(&robots).len(), 2);
        assert!(robots.take(only_b()), "a is gone");
        assert_eq!(listed(&robots), [line("b", "tcp/b:1", 2)]);
    }

    #[test]
    fn only_so_many_robots_are_listed() {
        let mut robots = KnownRobots::default();
        let names: Vec<_> = (0..=MAX_ROBOTS).map(|n| format!("r{n:04}")).collect();
        let all: Vec<_> = names
            .iter()
            .map(|name| (name.as_str(), "tcp/a:1"))
            .collect();
        assert!(robots.take(round(&all, 1)));
        assert_eq!(listed(&robots).len(), MAX_ROBOTS);
        assert!(!robots.take(round(&all, 2)));
    }
}
