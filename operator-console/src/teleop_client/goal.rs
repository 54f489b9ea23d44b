//! The goal that drive commands name: from the click until it ends on the robot, or this operator ends it.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{GoalStatus, MapPose};

/// A robot that has not started it by then does not: longer than neutral commands and a status on a bad link take.
const START: Duration = Duration::from_secs(3);

#[derive(Clone, Copy, Debug)]
pub(super) struct NamedGoal {
    pub(super) pose: MapPose,
    since: Monotonic,
    /// The robot has said that it runs.
    is_running: bool,
}

/// What a status says of the goal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GoalNews {
    Goes,
    Ended,
    NotStarted,
}

impl NamedGoal {
    pub(super) const fn new(pose: MapPose, now: Monotonic) -> Self {
        Self {
            pose,
            since: now,
            is_running: false,
        }
    }

    pub(super) fn receive(&mut self, status: &GoalStatus, now: Monotonic) -> GoalNews {
        let is_running = status.running == Some(self.pose);
        self.is_running |= is_running;
        match (self.is_running, is_running) {
            (true, false) => GoalNews::Ended,
            (false, _) if now.since(self.since) > START => GoalNews::NotStarted,
            (true, true) | (false, _) => GoalNews::Goes,
        }
    }
}
