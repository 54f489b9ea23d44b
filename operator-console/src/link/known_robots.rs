//! Which robots are known from rounds of asking: each once, in the order in which they were first found, at one of the
//! endpoints where it answers. Who answers no more stays known until it is forgotten.

use std::collections::BTreeMap;

use measurement::time::Monotonic;
use protocol::keys::RobotId;

use super::fleet_state::FleetState;

/// A robot that did not answer for so many rounds is not there.
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
pub struct DiscoveredRobot {
    /// The robot.
    pub found: FoundRobot,
    /// When it answered last.
    pub seen: Monotonic,
    /// How it is; none where it has not said so.
    pub state: Option<FleetState>,
}

impl DiscoveredRobot {
    /// Whether it had said that its data has ended.
    pub fn has_ended(&self) -> bool {
        self.state.as_ref().is_some_and(FleetState::has_ended)
    }
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

/// The robots that have answered, in the order in which they did so first.
#[derive(Debug, Default)]
pub(super) struct KnownRobots(Vec<Known>);

#[derive(Debug)]
struct Known {
    found: FoundRobot,
    /// Since it was last heard of.
    rounds: u32,
    seen: Monotonic,
    state: Option<FleetState>,
}

impl KnownRobots {
    /// A round is over; whether anything is another than before.
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

    /// A robot said more directly how it was at that time.
    pub(super) fn update_state(&mut self, robot: &RobotId, state: FleetState, at: Monotonic) {
        if let Some(known) = self.known(robot).filter(|known| known.seen < at) {
            (known.state, known.seen) = (Some(state), at);
        }
    }

    /// A robot was heard at that time, whatever it said.
    pub(super) fn mark_seen(&mut self, robot: &RobotId, at: Monotonic) {
        if let Some(known) = self.known(robot) {
            known.seen = known.seen.max(at);
        }
    }

    /// Nobody wants to know of this robot any more, unless it answers again.
    pub(super) fn forget(&mut self, robot: &RobotId) {
        self.0.retain(|known| known.found.robot != *robot);
    }

    /// All robots, in the order in which they were first found.
    pub(super) fn discovered_robots(&self) -> impl Iterator<Item = DiscoveredRobot> {
        self.0.iter().map(|known| DiscoveredRobot {
            found: known.found.clone(),
            seen: known.seen,
            state: known.state.clone(),
        })
    }

    /// Those that are there: they answered in one of the last rounds.
    pub(super) fn present(&self) -> impl Iterator<Item = &FoundRobot> {
        let present = self.0.iter().filter(|known| known.rounds < ROUNDS_KEPT);
        present.map(|known| &known.found)
    }

    fn known(&mut self, robot: &RobotId) -> Option<&mut Known> {
        self.0.iter_mut().find(|known| known.found.robot == *robot)
    }

    /// Whether there is room for one more; where all places are taken, who has not answered for longest gives up its
    /// own.
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

    /// `robot` has given these answers in one round, at different endpoints; whether anything is new.
    fn add_answers(&mut self, robot: RobotId, answers: Vec<(String, Answer)>) -> bool {
        let mut all = self.0.iter();
        let known = all.find(|known| known.found.robot == robot);
        // While it answers where it is known, it stays there; else it is where it answers now.
        let is_known = |(endpoint, _): &(String, _)| {
            known.is_some_and(|known| known.found.endpoint == *endpoint)
        };
        let index = answers.iter().position(is_known).unwrap_or_default();
        let Some((endpoint, mut answer)) = answers.into_iter().nth(index) else {
            return false;
        };
        // While it was asked, it said itself how it was.
        if let Some(known) = known.filter(|known| known.seen > answer.at) {
            answer = Answer {
                at: known.seen,
                state: known.state.clone().or(answer.state),
            };
        }
        let changed = known
            .is_none_or(|known| known.found.endpoint != endpoint || known.state != answer.state);
        let Answer { at: seen, state } = answer;
        let now_known = Known {
            found: FoundRobot { robot, endpoint },
            rounds: 0,
            seen,
            state,
        };
        if let Some(known) = self.known(&now_known.found.robot) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::at;

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
            .discovered_robots()
            .map(|DiscoveredRobot { found, seen, .. }| {
                (found.robot.to_string(), found.endpoint, seen)
            })
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
            let seen = robots.discovered_robots();
            seen.map(|discovered| (discovered.state.unwrap(), discovered.seen))
                .collect()
        };
        robots.update_state(&boat, FleetState::EStop { has_ended: false }, at(1));
        assert_eq!(states(&robots), [], "nobody could join it");
        robots.take(round(&[("boat", "tcp/b:1")], 5));
        robots.update_state(&boat, FleetState::EStop { has_ended: false }, at(4));
        assert_eq!(states(&robots), [(FleetState::Free, at(5))]);
        robots.update_state(&boat, FleetState::EStop { has_ended: false }, at(7));
        assert_eq!(
            states(&robots),
            [(FleetState::EStop { has_ended: false }, at(7))]
        );
        // A round that had begun before.
        assert!(!robots.take(round(&[("boat", "tcp/b:1")], 6)));
        assert_eq!(
            states(&robots),
            [(FleetState::EStop { has_ended: false }, at(7))]
        );
        assert!(robots.take(round(&[("boat", "tcp/b:1")], 8)));
        assert_eq!(states(&robots), [(FleetState::Free, at(8))]);
    }

    #[test]
    fn a_robot_that_answers_no_more_is_not_there_and_keeps_its_place_until_it_is_forgotten() {
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
    fn a_robot_that_is_heard_without_a_word_of_its_state_was_seen() {
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
        let all: Vec<_> = names
            .iter()
            .map(|name| (name.as_str(), "tcp/a:1"))
            .collect();
        assert!(robots.take(round(&all, 1)));
        assert_eq!(listed(&robots).len(), MAX_ROBOTS);
        assert!(!robots.take(round(&all, 2)));
        // Who is silent gives up its place, but not while it may have missed a round.
        for newest in ["r0255", "r0255", "r0256"] {
            robots.take(round(&all[1..], 3));
            let listed = listed(&robots);
            assert_eq!(
                (listed.len(), &*listed[MAX_ROBOTS - 1].0),
                (MAX_ROBOTS, newest)
            );
        }
    }
}
