//! The alerts of the robot that is shown, and of those that were shown before in this run: what nobody has acknowledged of them,
//! and what they say of themselves since to whoever looks for robots.

use std::collections::BTreeMap;

use protocol::keys::RobotId;
use robot_edge::clock::Monotonic;

use super::{Alarm, Alert, Alerts};
use crate::link::{SEEN_LATELY, Sighting};
use crate::playback::is_recording;

/// Alerts by robot.
#[derive(Clone, Debug, Default)]
pub struct FleetAlerts {
    shown: Option<(RobotId, Alerts)>,
    others: BTreeMap<RobotId, Left>,
}

/// The alerts of a robot that is no longer shown.
#[derive(Clone, Debug)]
struct Left {
    alerts: Alerts,
    /// When it was heard last, by its own link or by whoever looks for robots.
    since: Monotonic,
    /// It said then that its data had ended: its silence is no news.
    had_ended: bool,
}

impl FleetAlerts {
    /// Another robot is shown: what nobody has acknowledged of it is there again.
    pub fn change_to(&mut self, robot: &RobotId, now: Monotonic) {
        self.leave(now);
        let left = self.others.remove(robot);
        let alerts = left.map(|left| left.alerts).unwrap_or_default();
        self.shown = Some((robot.clone(), alerts));
    }

    /// Nothing is shown. A recording's alerts end with it.
    pub fn leave(&mut self, now: Monotonic) {
        let left = self.shown.take();
        if let Some((robot, alerts)) = left.filter(|(robot, _)| !is_recording(robot)) {
            let left = Left {
                alerts,
                since: now,
                had_ended: false,
            };
            self.others.insert(robot, left);
        }
    }

    /// Whether this robot is or was shown in this run.
    pub fn knows(&self, robot: &RobotId) -> bool {
        self.shows(robot) || self.others.contains_key(robot)
    }

    /// Nobody wants to know of this robot any more, which is not shown.
    pub fn forget(&mut self, robot: &RobotId) {
        self.others.remove(robot);
    }

    /// Of what is shown.
    pub fn shown_mut(&mut self) -> Option<&mut Alerts> {
        self.shown.as_mut().map(|(_, alerts)| alerts)
    }

    /// Those of what is shown first, the newest first; then those of other robots, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&RobotId, &Alert)> {
        self.each()
            .flat_map(|(robot, alerts)| alerts.iter().map(move |alert| (robot, alert)))
    }

    /// Whether this robot, or recording, is the one that is shown.
    pub fn shows(&self, robot: &RobotId) -> bool {
        self.shown.as_ref().is_some_and(|(shown, _)| shown == robot)
    }

    /// How many nobody has seen yet.
    pub fn unseen(&self) -> usize {
        self.each().map(|(_, alerts)| alerts.unseen()).sum()
    }

    /// How many of this robot's nobody has seen yet.
    pub fn unseen_of(&self, robot: &RobotId) -> usize {
        let mut all = self.each().filter(|(of, _)| *of == robot);
        all.next().map_or(0, |(_, alerts)| alerts.unseen())
    }

    /// Somebody has seen it.
    pub fn acknowledge(&mut self, robot: &RobotId, alarm: &Alarm) {
        for (_, alerts) in self.each_mut().filter(|(of, _)| *of == robot) {
            alerts.acknowledge(alarm);
        }
    }

    /// Somebody has seen them all.
    pub fn acknowledge_all(&mut self) {
        for (_, alerts) in self.each_mut() {
            alerts.acknowledge_all();
        }
    }

    /// Looks at what robots that are not shown any more say of themselves; what has begun, in words. Of robots that never were
    /// shown nobody is alarmed: the list of robots says how they are.
    pub fn look_around(&mut self, sightings: &[Sighting], now: Monotonic) -> Vec<String> {
        let mut begun = Vec::new();
        for (robot, left) in &mut self.others {
            let mut of_it = sightings.iter().filter(|one| one.found.robot == *robot);
            let of_it = of_it.next();
            // It may have said so while it was shown.
            left.had_ended |= of_it.is_some_and(Sighting::has_ended);
            let alert = match of_it.filter(|one| one.seen > left.since) {
                Some(sighting) => {
                    left.since = sighting.seen;
                    left.had_ended = sighting.has_ended();
                    left.alerts.look_from_afar(sighting.state.as_ref(), now)
                }
                None if now.since(left.since) > SEEN_LATELY && !left.had_ended => {
                    left.alerts.lose(now)
                }
                None => None,
            };
            begun.extend(alert.map(|(_, text)| format!("{robot}: {text}")));
        }
        begun
    }

    fn each(&self) -> impl Iterator<Item = (&RobotId, &Alerts)> {
        let shown = self.shown.iter().map(|(robot, alerts)| (robot, alerts));
        let others = self.others.iter();
        shown.chain(others.map(|(robot, left)| (robot, &left.alerts)))
    }

    fn each_mut(&mut self) -> impl Iterator<Item = (&RobotId, &mut Alerts)> {
        let shown = self.shown.iter_mut();
        let shown = shown.map(|(robot, alerts)| (&*robot, alerts));
        let others = self.others.iter_mut();
        shown.chain(others.map(|(robot, left)| (robot, &mut left.alerts)))
    }
}

#[cfg(test)]
mod tests {
    use std::slice;

    use protocol::keys::Topic;
    use protocol::message::{EStopStatus, Status};

    use super::*;
    use crate::alerts::Subject;
    use crate::link::{FleetState, FoundRobot};
    use crate::pretend::{at, console, says, standing};

    /// The robot that is shown says that an emergency stop is in force, or that none is; how many alerts that begins.
    fn stop(alerts: &mut FleetAlerts, robot: &RobotId, is_stopped: bool) -> usize {
        let mut model = console(robot.as_str(), &[]);
        let mut teleop = standing();
        teleop.estop = is_stopped.then_some(EStopStatus {
            number: 3,
            is_stored: true,
        });
        let status = Status {
            teleop: Some(teleop),
            ..Status::default()
        };
        says(&mut model, Topic::Status, &status, at(1_000));
        let shown = alerts.shown_mut().unwrap();
        shown.look(&model, Subject::Robot, &[], at(1_100)).len()
    }

    fn counts(alerts: &FleetAlerts) -> (usize, usize) {
        (alerts.iter().count(), alerts.unseen())
    }

    fn sighting(robot: &RobotId, seen_ms: u64, state: FleetState) -> Sighting {
        Sighting {
            found: FoundRobot {
                robot: robot.clone(),
                endpoint: "tcp/a:7447".to_owned(),
            },
            seen: at(seen_ms),
            state: Some(state),
        }
    }

    #[test]
    fn what_nobody_acknowledged_stays_with_its_robot() {
        let [boat, scout, recording]: [RobotId; 3] =
            ["boat", "scout", "recording-1a2b3c"].map(|name| name.parse().unwrap());
        let mut alerts = FleetAlerts::default();
        alerts.change_to(&boat, at(0));
        assert_eq!(stop(&mut alerts, &boat, true), 1);
        alerts.change_to(&scout, at(0));
        assert_eq!(stop(&mut alerts, &scout, true), 1);
        let listed: Vec<_> = alerts.iter().map(|(robot, _)| robot.as_str()).collect();
        assert_eq!(listed, ["scout", "boat"]);
        assert_eq!((alerts.unseen(), alerts.unseen_of(&boat)), (2, 1));
        assert!(alerts.shows(&scout) && !alerts.shows(&boat));
        alerts.acknowledge(&scout, &Alarm::EStop);
        assert_eq!((alerts.unseen_of(&scout), alerts.unseen_of(&boat)), (0, 1));

        // By another link, too; and as it was until it speaks again.
        for _ in 0..2 {
            alerts.change_to(&boat, at(0));
            let shown = alerts.shown_mut().unwrap();
            let silent = console("boat", &[]);
            assert_eq!(shown.look(&silent, Subject::Robot, &[], at(500)), []);
            assert_eq!((counts(&alerts), alerts.unseen_of(&boat)), ((2, 1), 1));
            let is_active = |(_, alert): (&RobotId, &Alert)| alert.is_active;
            assert!(alerts.iter().all(is_active));
            assert_eq!(stop(&mut alerts, &boat, true), 0, "it is known");
        }
        alerts.acknowledge_all();
        assert_eq!(counts(&alerts), (2, 0), "both are in force");
        assert_eq!(stop(&mut alerts, &boat, false), 0);
        assert_eq!(counts(&alerts), (1, 0));

        alerts.change_to(&recording, at(0));
        assert_eq!(stop(&mut alerts, &recording, true), 1);
        assert_eq!(counts(&alerts), (2, 1));
        alerts.leave(at(0));
        assert_eq!(counts(&alerts), (1, 0), "it ended with the recording");
    }

    #[test]
    fn a_robot_that_is_not_shown_any_more_is_heard_of() {
        let [boat, scout]: [RobotId; 2] = ["boat", "scout"].map(|name| name.parse().unwrap());
        let mut alerts = FleetAlerts::default();
        alerts.change_to(&boat, at(0));
        alerts.change_to(&scout, at(5_000));
        let none: [&str; 0] = [];
        let before = sighting(&boat, 4_000, FleetState::EStop { has_ended: false });
        assert_eq!(alerts.look_around(&[before], at(6_000)), none);
        let stopped = sighting(&boat, 7_000, FleetState::EStop { has_ended: false });
        let text = "boat: An emergency stop is in force";
        assert_eq!(
            alerts.look_around(slice::from_ref(&stopped), at(7_000)),
            [text]
        );
        assert_eq!(alerts.look_around(&[stopped], at(8_000)), none);
        let others = [
            sighting(&boat, 17_000, FleetState::EStop { has_ended: false }),
            sighting(&scout, 17_000, FleetState::EStop { has_ended: false }),
            sighting(
                &"stranger".parse().unwrap(),
                17_000,
                FleetState::Fault { has_ended: false },
            ),
        ];
        assert_eq!(alerts.look_around(&others, at(17_000)), none);
        assert_eq!(counts(&alerts), (1, 1));
        let free = sighting(&boat, 27_000, FleetState::Free);
        assert_eq!(alerts.look_around(slice::from_ref(&free), at(27_000)), none);
        let texts: Vec<_> = alerts
            .iter()
            .map(|(_, alert)| alert.text.as_str())
            .collect();
        assert_eq!(texts, ["An emergency stop was in force"]);
        alerts.acknowledge(&boat, &Alarm::EStop);
        assert_eq!(counts(&alerts), (0, 0));
        // Whether it is listed still or not.
        let seen = slice::from_ref(&free);
        assert_eq!(alerts.look_around(seen, at(42_000)), none);
        let silent = "boat: Nothing is heard of the robot";
        assert_eq!(alerts.look_around(seen, at(42_001)), [silent]);
        assert_eq!(alerts.look_around(&[], at(43_000)), none);
        assert_eq!((counts(&alerts), alerts.unseen_of(&boat)), ((1, 1), 1));
        let mut heard = sighting(&boat, 44_000, FleetState::Free);
        heard.state = None;
        assert_eq!(alerts.look_around(&[heard], at(44_000)), none);
        assert!(alerts.iter().all(|(_, alert)| !alert.is_active));
        alerts.acknowledge_all();
        let faulty = sighting(&boat, 45_000, FleetState::Fault { has_ended: false });
        let text = "boat: The vehicle is at fault";
        assert_eq!(alerts.look_around(&[faulty], at(45_000)), [text]);
        // What it says itself is more.
        assert!(alerts.knows(&boat) && alerts.knows(&scout));
        alerts.change_to(&boat, at(46_000));
        assert_eq!(stop(&mut alerts, &boat, true), 1);
        assert_eq!(counts(&alerts), (2, 2));
        alerts.change_to(&scout, at(46_000));
        let stopped = sighting(&boat, 47_000, FleetState::EStop { has_ended: false });
        assert_eq!(alerts.look_around(&[stopped], at(47_000)), none);
        let first = alerts.iter().map(|(_, alert)| alert.text.as_str()).next();
        assert_eq!(first, Some("Emergency stop 3 is in force"));
        // A fault ends no stop.
        let faulty = sighting(&boat, 57_000, FleetState::Fault { has_ended: false });
        assert_eq!(alerts.look_around(&[faulty], at(57_000)).len(), 1);
        let active = alerts.iter().filter(|(_, alert)| alert.is_active);
        assert_eq!(active.count(), 2);
        alerts.forget(&boat);
        assert_eq!((counts(&alerts), alerts.knows(&boat)), ((0, 0), false));
        assert_eq!(
            alerts.look_around(&[], at(99_000)),
            none,
            "it is not missed"
        );
    }

    #[test]
    fn a_robot_that_left_is_missed_from_when_it_was_seen_and_not_from_when_that_was_looked_at() {
        let boat: RobotId = "boat".parse().unwrap();
        let mut alerts = FleetAlerts::default();
        alerts.change_to(&boat, at(0));
        alerts.leave(at(5_000));
        let since = |alerts: &FleetAlerts| alerts.others[&boat].since;
        assert_eq!(since(&alerts), at(5_000));
        let mut look = |sighting: Sighting, now_ms: u64| {
            let begun = alerts.look_around(&[sighting], at(now_ms));
            (begun.len(), since(&alerts))
        };
        let free = |seen_ms| sighting(&boat, seen_ms, FleetState::Free);
        assert_eq!(look(free(4_000), 6_000), (0, at(5_000)), "older than that");
        assert_eq!(look(free(7_000), 9_000), (0, at(7_000)));
        // Seen before the look that came before, and told of since.
        let stopped = sighting(&boat, 8_000, FleetState::EStop { has_ended: false });
        assert_eq!(look(stopped.clone(), 9_500), (1, at(8_000)));
        assert_eq!(look(stopped.clone(), 23_000), (0, at(8_000)));
        assert_eq!(look(stopped, 23_001), (1, at(8_000)), "it is missed");
    }

    #[test]
    fn a_robot_whose_data_had_ended_is_not_missed() {
        let boat: RobotId = "boat".parse().unwrap();
        let mut alerts = FleetAlerts::default();
        alerts.change_to(&boat, at(0));
        alerts.leave(at(5_000));
        let mut look =
            |sighting: Sighting, now_ms: u64| alerts.look_around(&[sighting], at(now_ms)).len();
        assert_eq!(look(sighting(&boat, 6_000, FleetState::Ended), 7_000), 0);
        assert_eq!(look(sighting(&boat, 6_000, FleetState::Ended), 60_000), 0);
        assert_eq!(look(sighting(&boat, 61_000, FleetState::Free), 62_000), 0);
        assert_eq!(look(sighting(&boat, 61_000, FleetState::Free), 90_000), 1);
    }

    #[test]
    fn nor_is_one_that_had_said_so_while_it_was_shown() {
        let boat: RobotId = "boat".parse().unwrap();
        let ended = FleetState::EStop { has_ended: true };
        for (state, begun) in [(FleetState::Ended, 0), (ended, 0), (FleetState::Free, 1)] {
            let mut alerts = FleetAlerts::default();
            alerts.change_to(&boat, at(0));
            alerts.leave(at(5_000));
            // Its own link was heard last; then it was closed, and answers nobody any more.
            let heard = [sighting(&boat, 4_000, state.clone())];
            for now_ms in [6_000, 60_000] {
                let told = alerts.look_around(&heard, at(now_ms)).len();
                let expected = if now_ms > 20_000 { begun } else { 0 };
                assert_eq!(told, expected, "{state:?} {now_ms}");
            }
        }
    }
}
