//! Goals: while the holder's commands name one, the velocities of a planner take the place of pressed keys.
//!
//! A planner signs nothing and has no token. So its velocities count only while a goal runs, and only by when they
//! arrived; the holder's commands, which are signed and young, keep the goal running.

use std::time::Duration;

use crate::arbiter::{Mode, Step};
use crate::command_stream::ArmingState;
use crate::interface::ArbiterEvent;
use crate::motion::Velocity;
use measurement::time::Monotonic;
use protocol::message::{GoalEnd, MapPose, StopReason};

/// Longest wait for the first velocity of a goal, while the vehicle stands: a path is planned first.
pub(crate) const PLANNING_TIME: Duration = Duration::from_secs(10);

/// The goal that runs. The mode is [`Mode::Driving`] then, and the requested velocity is the planner's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct RunningGoal {
    pub(crate) pose: MapPose,
    pub(crate) started: Monotonic,
    /// When the newest velocity since then arrived.
    pub(crate) received: Option<Monotonic>,
}

/// Why a goal ends with a stop.
const fn goal_end(reason: StopReason) -> GoalEnd {
    match reason {
        StopReason::Released => GoalEnd::Cancelled,
        StopReason::Age => GoalEnd::Age,
        StopReason::NotFinite => GoalEnd::NotFinite,
        StopReason::CollisionMonitorStale => GoalEnd::CollisionMonitorStale,
        StopReason::LeaseEnded(_) => GoalEnd::LeaseEnded,
        StopReason::MotorsHeld => GoalEnd::Motors,
        StopReason::PlannerSilent => GoalEnd::PlannerSilent,
        StopReason::PlannerFloods => GoalEnd::PlannerFloods,
    }
}

impl Step<'_> {
    /// A young command of the holder names a goal, and nothing is pressed. A goal starts as a press does: after neutral
    /// commands without one, and at standstill.
    pub(super) fn accept_goal(&mut self, pose: MapPose) {
        self.state.stream.docking = None;
        if let Some(goal) = &mut self.state.goal {
            if goal.pose != pose {
                goal.pose = pose;
                self.notify(ArbiterEvent::GoalStarted(pose));
            }
            return;
        }
        self.state.stream.requested = Velocity::ZERO;
        if self.state.mode == Mode::Driving {
            self.begin_stop(StopReason::Released);
            self.state.stream.arming = ArmingState::Locked;
        }
        let is_armed = match self.state.stream.arming {
            ArmingState::Neutral { since } => self.now.since(since) >= self.rules.neutral,
            ArmingState::Locked | ArmingState::Pressed => false,
        };
        if !is_armed || self.rules.planner.is_none() || !self.monitor_is_available() {
            self.state.stream.arming = ArmingState::Locked;
        } else if self.state.mode == Mode::Held {
            self.state.stream.arming = ArmingState::Pressed;
            self.state.mode = Mode::Driving;
            self.state.goal = Some(RunningGoal {
                pose,
                started: self.now,
                received: None,
            });
            self.notify(ArbiterEvent::GoalStarted(pose));
        }
    }

    /// A velocity of the planner that arrived at `arrived`. What came before the goal is about another one.
    pub(super) fn planned(&mut self, velocity: Velocity, arrived: Monotonic) {
        let (Some(goal), Some(planner)) = (&mut self.state.goal, self.rules.planner) else {
            return;
        };
        if arrived < goal.started {
            return;
        }
        let gap = goal
            .received
            .map_or(Duration::ZERO, |received| arrived.since(received));
        if !velocity.is_finite() {
            self.stop_and_lock(StopReason::NotFinite);
        } else if gap.max(self.now.since(arrived)) > planner.max_gap {
            self.planner_silent();
        } else {
            goal.received = goal.received.max(Some(arrived));
            self.state.stream.requested = velocity;
        }
    }

    pub(super) fn planner_floods(&mut self) {
        if self.state.goal.is_some() {
            self.stop_and_lock(StopReason::PlannerFloods);
        }
    }

    /// A planner that is silent for too long ends the goal.
    pub(super) fn check_planner(&mut self) {
        let (Some(goal), Some(planner)) = (self.state.goal, self.rules.planner) else {
            return;
        };
        let is_silent = match goal.received {
            Some(received) => self.now.since(received) > planner.max_gap,
            None => self.now.since(goal.started) > planner.planning_time,
        };
        if is_silent {
            self.planner_silent();
        }
    }

    fn planner_silent(&mut self) {
        if self.state.motion.is_zero() {
            // As where the goal is reached: no involuntary stop.
            self.end_goal(GoalEnd::PlannerSilent);
            self.begin_stop(StopReason::Released);
            self.state.stream.arming = ArmingState::Locked;
        } else {
            self.stop_and_lock(StopReason::PlannerSilent);
        }
    }

    pub(super) fn end_goal_for(&mut self, reason: StopReason) {
        self.end_goal(goal_end(reason));
    }

    /// From now on the planner's velocities are ignored.
    pub(super) fn end_goal(&mut self, why: GoalEnd) {
        if self.state.goal.take().is_some() {
            self.state.last_goal_end = Some(why);
            self.notify(ArbiterEvent::GoalEnded(why));
        }
    }
}
