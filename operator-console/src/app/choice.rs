//! Automatic choice of the robot to show.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::RobotId;

use crate::demo::DemoFailure;
use crate::link::{DiscoveredRobot, FoundRobot};
use crate::panels::robots::SearchTarget;

/// Present robots answer within this time of each other. Before, a single one may be the first of several.
const SETTLED_AFTER: Duration = Duration::from_millis(600);

/// By then Zenoh has tried several times to reconnect to a silent robot.
const GONE_AFTER: Duration = Duration::from_secs(3);

/// The new address of the shown robot, which is silent for `silent` and has answered elsewhere since.
pub(super) fn moved_to(
    shown: &FoundRobot,
    silent: Duration,
    discovered_robots: &[DiscoveredRobot],
    now: Monotonic,
) -> Option<FoundRobot> {
    let is_it = |discovered: &&DiscoveredRobot| {
        discovered.found.robot == shown.robot
            && discovered.found.endpoint != shown.endpoint
            && now.since(discovered.seen) < silent
    };
    let elsewhere = discovered_robots.iter().find(is_it)?;
    (silent >= GONE_AFTER).then(|| elsewhere.found.clone())
}

#[derive(Clone, Debug, Default)]
pub(super) struct RobotChoice {
    named: Option<RobotId>,
    demo: Option<DemoFailure>,
    is_end_reported: bool,
    first_found: Option<Monotonic>,
}

impl RobotChoice {
    pub(super) const fn new(named: Option<RobotId>, demo: Option<DemoFailure>) -> Self {
        Self {
            named,
            demo,
            is_end_reported: false,
            first_found: None,
        }
    }

    pub(super) fn sought(&self) -> SearchTarget<'_> {
        match (&self.named, &self.demo) {
            (_, Some(failure)) => SearchTarget::Demo {
                failure: failure.message(),
            },
            (Some(named), None) => SearchTarget::Named(named),
            (None, None) => SearchTarget::Any,
        }
    }

    pub(super) fn take_end(&mut self) -> Option<String> {
        let why = self.demo.as_ref()?.message()?;
        (!std::mem::replace(&mut self.is_end_reported, true)).then_some(why)
    }

    /// The robot to connect to: the named one, or the only one.
    pub(super) fn choose<'a>(
        &mut self,
        found: &'a [FoundRobot],
        now: Monotonic,
    ) -> Option<&'a FoundRobot> {
        let first = found.first()?;
        let first_found = *self.first_found.get_or_insert(now);
        if let Some(named) = &self.named {
            return found.iter().find(|robot| robot.robot == *named);
        }
        let is_only = found.iter().all(|other| other.robot == first.robot);
        (is_only && now.since(first_found) >= SETTLED_AFTER).then_some(first)
    }

    pub(super) fn look_again_after(&self, now: Monotonic) -> Option<Duration> {
        let since = now.since(self.first_found?);
        SETTLED_AFTER.checked_sub(since)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::at;

    fn found(robot: &str) -> FoundRobot {
        FoundRobot {
            robot: robot.parse().unwrap(),
            endpoint: format!("tcp/{robot}:7447"),
        }
    }

    #[test]
    fn only_robot_is_chosen_after_others_had_time() {
        let mut choice = RobotChoice::default();
        let robots = [found("a"), found("b")];
        assert_eq!(choice.choose(&[], at(0)), None);
        assert_eq!(choice.choose(&robots[..1], at(100)), None);
        assert_eq!(
            choice.look_again_after(at(500)),
            Some(Duration::from_millis(200))
        );
        assert_eq!(choice.choose(&robots[..1], at(700)), Some(&robots[0]));
        assert_eq!(
            choice.choose(&robots, at(700)),
            None,
            "the operator must choose"
        );
    }

    #[test]
    fn silent_robot_that_answers_elsewhere_has_moved() {
        let shown = found("a");
        let discovered = |robot: &str, port: u16, seen_ms: u64| DiscoveredRobot {
            found: FoundRobot {
                robot: robot.parse().unwrap(),
                endpoint: format!("tcp/{robot}:{port}"),
            },
            seen: at(seen_ms),
            state: None,
        };
        let moved_to = |discovered_robots: &[DiscoveredRobot], silent_ms: u64| {
            let silent = Duration::from_millis(silent_ms);
            moved_to(&shown, silent, discovered_robots, at(20_000)).map(|found| found.endpoint)
        };
        let others = [discovered("b", 9, 19_000), discovered("a", 9, 19_000)];
        assert_eq!(moved_to(&others, 3_000).as_deref(), Some("tcp/a:9"));
        assert_eq!(moved_to(&others, 2_999), None, "it may come back");
        assert_eq!(moved_to(&others[..1], 3_000), None, "another robot");
        let same = [discovered("a", 7447, 19_000)];
        assert_eq!(moved_to(&same, 9_000), None, "it is where it was");
        let before = [discovered("a", 9, 15_000)];
        assert_eq!(moved_to(&before, 5_000), None, "it is silent there as well");
    }

    #[test]
    fn named_robot_is_chosen_at_once() {
        let mut choice = RobotChoice::new(Some("b".parse().unwrap()), None);
        let robots = [found("a"), found("b")];
        assert_eq!(choice.choose(&robots[..1], at(5_000)), None);
        assert_eq!(choice.choose(&robots, at(5_000)), Some(&robots[1]));
    }
}
