//! Alerts of the shown robot, and of robots shown before: unacknowledged ones, and new ones by discovery.

use std::collections::BTreeMap;

use measurement::time::Monotonic;
use protocol::keys::RobotId;

use super::{Alarm, Alert, Alerts};
use crate::link::{DiscoveredRobot, SEEN_RECENTLY};
use crate::playback::is_recording;

#[derive(Clone, Debug, Default)]
pub struct FleetAlerts {
    shown: Option<(RobotId, Alerts)>,
    others: BTreeMap<RobotId, BackgroundRobot>,
}

#[derive(Clone, Debug)]
struct BackgroundRobot {
    alerts: Alerts,
    /// Last contact, by its own link or by discovery.
    since: Monotonic,
    /// Its data had ended, so its silence is expected.
    had_ended: bool,
}

impl FleetAlerts {
    /// Another robot is shown; its saved alerts continue.
    pub fn change_to(&mut self, robot: &RobotId, now: Monotonic) {
        self.leave(now);
        let left = self.others.remove(robot);
        let alerts = left.map(|left| left.alerts).unwrap_or_default();
        self.shown = Some((robot.clone(), alerts));
    }

    /// No robot is shown. The alerts of a recording end with it.
    pub fn leave(&mut self, now: Monotonic) {
        let left = self.shown.take();
        if let Some((robot, alerts)) = left.filter(|(robot, _)| !is_recording(robot)) {
            let left = BackgroundRobot {
                alerts,
                since: now,
                had_ended: false,
            };
            self.others.insert(robot, left);
        }
    }

    pub fn knows(&self, robot: &RobotId) -> bool {
        self.shows(robot) || self.others.contains_key(robot)
    }

    pub fn forget(&mut self, robot: &RobotId) {
        self.others.remove(robot);
    }

    pub fn shown_mut(&mut self) -> Option<&mut Alerts> {
        self.shown.as_mut().map(|(_, alerts)| alerts)
    }

    /// Alerts of the shown robot first, newest first; then those of other robots, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&RobotId, &Alert)> {
        self.each()
            .flat_map(|(robot, alerts)| alerts.iter().map(move |alert| (robot, alert)))
    }

    pub fn shows(&self, robot: &RobotId) -> bool {
        self.shown.as_ref().is_some_and(|(shown, _)| shown == robot)
    }

    pub fn unacknowledged(&self) -> usize {
        self.each().map(|(_, alerts)| alerts.unacknowledged()).sum()
    }

    pub fn unacknowledged_of(&self, robot: &RobotId) -> usize {
        let mut all = self.each().filter(|(of, _)| *of == robot);
        all.next().map_or(0, |(_, alerts)| alerts.unacknowledged())
    }

    pub fn acknowledge(&mut self, robot: &RobotId, alarm: &Alarm) {
        for (_, alerts) in self.each_mut().filter(|(of, _)| *of == robot) {
            alerts.acknowledge(alarm);
        }
    }

    pub fn acknowledge_all(&mut self) {
        for (_, alerts) in self.each_mut() {
            alerts.acknowledge_all();
        }
    }

    /// Takes the states of robots that are not shown any more; returns the alerts that begin.
    pub fn update_background(
        &mut self,
        discovered_robots: &[DiscoveredRobot],
        now: Monotonic,
    ) -> Vec<String> {
        let mut begun = Vec::new();
        for (robot, left) in &mut self.others {
            let mut discovered = discovered_robots.iter();
            let of_it = discovered.find(|one| one.found.robot == *robot);
            // It may have reported so while it was shown.
            left.had_ended |= of_it.is_some_and(DiscoveredRobot::has_ended);
            let alert = match of_it.filter(|one| one.seen > left.since) {
                Some(discovered) => {
                    left.since = discovered.seen;
                    left.had_ended = discovered.has_ended();
                    left.alerts
                        .update_from_discovery(discovered.state.as_ref(), now)
                }
                None if now.since(left.since) > SEEN_RECENTLY && !left.had_ended => {
                    left.alerts.mark_lost(now)
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
    use protocol::keys::Topic;

    use super::*;
    use crate::alerts::AlertSource;
    use crate::link::{FleetState, FoundRobot};
    use crate::test_support::{STORED_ESTOP, at, console, idle_teleop_status, inject, status_of};

    fn stop(alerts: &mut FleetAlerts, robot: &RobotId, is_stopped: bool) -> usize {
        let mut model = console(robot.as_str(), &[]);
        let mut teleop = idle_teleop_status();
        teleop.estop = is_stopped.then_some(STORED_ESTOP);
        let status = status_of(teleop);
        inject(&mut model, Topic::Status, &status, at(1_000));
        let shown = alerts.shown_mut().unwrap();
        shown
            .update(&model, AlertSource::Robot, &[], at(1_100))
            .len()
    }

    fn counts(alerts: &FleetAlerts) -> (usize, usize) {
        (alerts.iter().count(), alerts.unacknowledged())
    }

    fn discovered(robot: &RobotId, seen_ms: u64, state: FleetState) -> DiscoveredRobot {
        DiscoveredRobot {
            found: FoundRobot {
                robot: robot.clone(),
                endpoint: "tcp/a:7447".to_owned(),
            },
            seen: at(seen_ms),
            state: Some(state),
        }
    }

    #[test]
    fn unacknowledged_alerts_stay_with_their_robot() {
        let [boat, scout, recording]: [RobotId; 3] =
            ["boat", "scout", "recording-1a2b3c"].map(|name| name.parse().unwrap());
        let mut alerts = FleetAlerts::default();
        alerts.change_to(&boat, at(0));
        assert_eq!(stop(&mut alerts, &boat, true), 1);
        alerts.change_to(&scout, at(0));
        assert_eq!(stop(&mut alerts, &scout, true), 1);
        let listed: Vec<_> = alerts.iter().map(|(robot, _)| robot.as_str()).collect();
        assert_eq!(listed, ["scout", "boat"]);
        let unacknowledged =
            |alerts: &FleetAlerts| [&scout, &boat].map(|robot| alerts.unacknowledged_of(robot));
        assert_eq!(
            (alerts.unacknowledged(), unacknowledged(&alerts)),
            (2, [1, 1])
        );
        assert!(alerts.shows(&scout) && !alerts.shows(&boat));
        alerts.acknowledge(&scout, &Alarm::EStop);
        assert_eq!(unacknowledged(&alerts), [0, 1]);

        // By another link too; the state stays until the next report.
        for _ in 0..2 {
            alerts.change_to(&boat, at(0));
            let shown = alerts.shown_mut().unwrap();
            let silent = console("boat", &[]);
            assert_eq!(shown.update(&silent, AlertSource::Robot, &[], at(500)), []);
            assert_eq!((counts(&alerts), unacknowledged(&alerts)[1]), ((2, 1), 1));
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

    const ESTOP: FleetState = FleetState::EStop { has_ended: false };
    const FAULT: FleetState = FleetState::Fault { has_ended: false };

    fn check(alerts: &mut FleetAlerts, heard: &[DiscoveredRobot], ms: u64, begun: &[&str]) {
        assert_eq!(alerts.update_background(heard, at(ms)), begun, "{ms}");
    }

    #[test]
    fn background_robot_raises_alerts() {
        let [boat, scout]: [RobotId; 2] = ["boat", "scout"].map(|name| name.parse().unwrap());
        let mut alerts = FleetAlerts::default();
        alerts.change_to(&boat, at(0));
        alerts.change_to(&scout, at(5_000));
        let alerts = &mut alerts;
        let boat_is = |seen_ms, state| [discovered(&boat, seen_ms, state)];
        check(alerts, &boat_is(4_000, ESTOP), 6_000, &[]);
        let stopped = boat_is(7_000, ESTOP);
        check(
            alerts,
            &stopped,
            7_000,
            &["boat: An emergency stop is active"],
        );
        check(alerts, &stopped, 8_000, &[]);
        let others = [
            discovered(&boat, 17_000, ESTOP),
            discovered(&scout, 17_000, ESTOP),
            discovered(&"stranger".parse().unwrap(), 17_000, FAULT),
        ];
        check(alerts, &others, 17_000, &[]);
        assert_eq!(counts(alerts), (1, 1));
        let free = boat_is(27_000, FleetState::Free);
        check(alerts, &free, 27_000, &[]);
        let texts = alerts.iter().map(|(_, alert)| alert.text.as_str());
        assert_eq!(texts.collect::<Vec<_>>(), ["An emergency stop was active"]);
        alerts.acknowledge(&boat, &Alarm::EStop);
        assert_eq!(counts(alerts), (0, 0));
        // Listed or not.
        check(alerts, &free, 42_000, &[]);
        check(alerts, &free, 42_001, &["boat: No data from the robot"]);
        check(alerts, &[], 43_000, &[]);
        assert_eq!(
            (counts(alerts), alerts.unacknowledged_of(&boat)),
            ((1, 1), 1)
        );
        let mut heard = boat_is(44_000, FleetState::Free);
        heard[0].state = None;
        check(alerts, &heard, 44_000, &[]);
        assert!(alerts.iter().all(|(_, alert)| !alert.is_active));
        alerts.acknowledge_all();
        let text = "boat: The vehicle is at fault";
        check(alerts, &boat_is(45_000, FAULT), 45_000, &[text]);
        assert!(alerts.knows(&boat) && alerts.knows(&scout));
        alerts.change_to(&boat, at(46_000));
        assert_eq!(stop(alerts, &boat, true), 1);
        assert_eq!(counts(alerts), (2, 2));
        alerts.change_to(&scout, at(46_000));
        check(alerts, &boat_is(47_000, ESTOP), 47_000, &[]);
        let first = alerts.iter().map(|(_, alert)| alert.text.as_str()).next();
        assert_eq!(first, Some("Emergency stop 3 is active"));
        // A fault does not end a stop.
        check(alerts, &boat_is(57_000, FAULT), 57_000, &[text]);
        let active = alerts.iter().filter(|(_, alert)| alert.is_active);
        assert_eq!(active.count(), 2);
        alerts.forget(&boat);
        assert_eq!((counts(alerts), alerts.knows(&boat)), ((0, 0), false));
        // It is not missed.
        check(alerts, &[], 99_000, &[]);
    }

    #[test]
    fn silence_counts_from_last_contact() {
        let boat: RobotId = "boat".parse().unwrap();
        let mut alerts = FleetAlerts::default();
        alerts.change_to(&boat, at(0));
        alerts.leave(at(5_000));
        let since = |alerts: &FleetAlerts| alerts.others[&boat].since;
        assert_eq!(since(&alerts), at(5_000));
        let mut update = |discovered: DiscoveredRobot, now_ms: u64| {
            let begun = alerts.update_background(&[discovered], at(now_ms));
            (begun.len(), since(&alerts))
        };
        let free = |seen_ms| discovered(&boat, seen_ms, FleetState::Free);
        assert_eq!(
            update(free(4_000), 6_000),
            (0, at(5_000)),
            "older than that"
        );
        assert_eq!(update(free(7_000), 9_000), (0, at(7_000)));
        // Acknowledged before the update, and reported since.
        let stopped = discovered(&boat, 8_000, ESTOP);
        assert_eq!(update(stopped.clone(), 9_500), (1, at(8_000)));
        assert_eq!(update(stopped.clone(), 23_000), (0, at(8_000)));
        assert_eq!(update(stopped, 23_001), (1, at(8_000)), "it is missed");
    }

    #[test]
    fn ended_robot_raises_no_link_alert() {
        let boat: RobotId = "boat".parse().unwrap();
        let mut alerts = FleetAlerts::default();
        alerts.change_to(&boat, at(0));
        alerts.leave(at(5_000));
        for (seen_ms, state, ms, begun) in [
            (6_000, FleetState::Ended, 7_000, 0),
            (6_000, FleetState::Ended, 60_000, 0),
            (61_000, FleetState::Free, 62_000, 0),
            (61_000, FleetState::Free, 90_000, 1),
        ] {
            let heard = [discovered(&boat, seen_ms, state)];
            assert_eq!(
                alerts.update_background(&heard, at(ms)).len(),
                begun,
                "{ms}"
            );
        }
    }

    #[test]
    fn end_reported_while_shown_raises_no_link_alert() {
        let boat: RobotId = "boat".parse().unwrap();
        let ended = FleetState::EStop { has_ended: true };
        for (state, begun) in [(FleetState::Ended, 0), (ended, 0), (FleetState::Free, 1)] {
            let mut alerts = FleetAlerts::default();
            alerts.change_to(&boat, at(0));
            alerts.leave(at(5_000));
            // Its link was the last contact; then it was closed and is silent.
            let heard = [discovered(&boat, 4_000, state.clone())];
            for now_ms in [6_000, 60_000] {
                let actual = alerts.update_background(&heard, at(now_ms)).len();
                let expected = if now_ms > 20_000 { begun } else { 0 };
                assert_eq!(actual, expected, "{state:?} {now_ms}");
            }
        }
    }
}
