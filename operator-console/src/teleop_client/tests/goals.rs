//! Goals that commands name.

use protocol::message::{GoalEnd, GoalStatus, MapPose};

use super::*;

const GOAL: MapPose = MapPose {
    x_mm: 4000,
    y_mm: -500,
    yaw_mrad: 0,
};

impl Rig {
    /// A goal that the robot drives to.
    fn going() -> Self {
        let mut rig = Self::held();
        rig.go(Some(GOAL));
        rig.run(100);
        assert!(rig.goals().contains(&Some(GOAL)));
        rig.goal_status(Some(GOAL), None);
        rig.run(500);
        rig.since();
        rig
    }

    fn go(&mut self, goal: Option<MapPose>) {
        self.teleop_client.submit(Intent::Goal(goal), at(self.ms));
    }

    fn goal_status(&mut self, running: Option<MapPose>, last_end: Option<GoalEnd>) {
        self.status(|status| {
            status.goal = GoalStatus {
                has_planner: true,
                running,
                last_end,
            };
        });
    }

    /// Of the commands since the last call.
    fn goals(&mut self) -> Vec<Option<MapPose>> {
        let sent = self.since().into_iter();
        sent.filter_map(|(_, _, read)| match read {
            Read::Drive(drive) => Some(drive.goal),
            Read::EStop(_) | Read::Lease(_) | Read::Other(_) => None,
        })
        .collect()
    }
}

#[test]
fn a_goal_is_named_by_each_command_after_enough_neutral_ones() {
    let mut rig = Rig::held();
    rig.turn(&[W]);
    rig.run(100);
    rig.turn(&[NO_W]);
    rig.since();
    rig.go(Some(GOAL));
    rig.run(230);
    let before = rig.goals();
    assert!(
        before.len() > 8 && before.iter().all(Option::is_none),
        "{before:?}"
    );
    rig.run(1000);
    let goals = rig.goals();
    let named = goals.iter().filter(|goal| **goal == Some(GOAL)).count();
    assert!(
        named >= goals.len() - 2 && named >= 45,
        "{named} of {}",
        goals.len()
    );
    assert_eq!(rig.state().goal, Some(GOAL));
}

#[test]
fn keys_take_over_at_once() {
    let mut rig = Rig::going();
    rig.turn(&[W]);
    let sent = rig.since();
    let Some((_, _, Read::Drive(drive))) = sent.first() else {
        panic!("{sent:?}");
    };
    assert_eq!((drive.linear_mps, drive.goal), (1.0, None));
    rig.turn(&[NO_W]);
    rig.run(1000);
    assert!(
        rig.goals().iter().all(Option::is_none),
        "it does not come back"
    );
}

type Case = (&'static str, fn(&mut Rig));

#[test]
fn what_ends_a_goal() {
    let cases: [Case; 5] = [
        ("Esc", |rig| rig.go(None)),
        ("focus", |rig| rig.turn(&[InputEvent::Focus(false)])),
        ("typing", |rig| rig.turn(&[InputEvent::Typing(true)])),
        ("the robot", |rig| {
            rig.goal_status(None, Some(GoalEnd::PlannerSilent));
        }),
        ("the lease", |rig| rig.ask(LeaseRequest::Release)),
    ];
    for (what, end) in cases {
        let mut rig = Rig::going();
        end(&mut rig);
        rig.since();
        rig.run(1000);
        assert!(rig.goals().iter().all(Option::is_none), "{what}");
        assert_eq!(rig.state().goal, None, "{what}");
    }
}

#[test]
fn a_goal_that_the_robot_does_not_start_is_dropped() {
    let mut rig = Rig::held();
    rig.go(Some(GOAL));
    rig.run(2900);
    rig.goal_status(None, None);
    assert_eq!(rig.state().goal, Some(GOAL));
    rig.run(200);
    rig.goal_status(None, None);
    assert_eq!(rig.state().goal, None);
    assert_eq!(rig.state().notice, Some(TeleopNotification::GoalNotStarted));
}
