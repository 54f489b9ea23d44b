//! Whether the holder's commands, or a planner by a goal, may move the vehicle: the rules of presses, releases and goals once more.

use std::time::Duration;

use super::millis;
use crate::motion::Velocity;
use measurement::time::Monotonic;

/// How long after a stop began a young press takes it back.
const RESUME_WINDOW: Duration = millis(200);

/// P6: whether the holder's pressed key counts, by their commands so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub(super) struct Permission {
    pub(super) is_given: bool,
    /// It was lost at that moment by age or release, so that a young press soon after brings it back.
    pub(super) lost: Option<Monotonic>,
    pub(super) neutral_since: Option<Monotonic>,
    /// It is that of a planner, by a goal.
    pub(super) goal: Option<GoalInForce>,
}

/// A goal that is to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct GoalInForce {
    pub(super) started: Monotonic,
    /// When the planner's newest velocity since then arrived.
    pub(super) received: Option<Monotonic>,
}

impl Permission {
    /// After anything that calls for release and press.
    pub(super) fn lock(&mut self) {
        *self = Self::default();
    }

    pub(super) fn neutral(&mut self, now: Monotonic) {
        self.lose(now);
        self.neutral_since.get_or_insert(now);
    }

    /// `may_recover`: the vehicle still moves, and the collision monitor gives limits.
    pub(super) fn press(&mut self, now: Monotonic, neutral: Duration, may_recover: bool) {
        self.goal = None;
        if self.is_given {
            return;
        }
        let is_soon = self
            .lost
            .is_some_and(|lost| now.since(lost) <= RESUME_WINDOW);
        let was_neutral = self.neutral_since.take();
        if is_soon && may_recover || was_neutral.is_some_and(|since| now.since(since) >= neutral) {
            self.lock();
            self.is_given = true;
        }
    }

    /// A command names a goal. `may_start`: the vehicle stands, held, and can be driven by a planner; `must_lock`: it could not be
    /// at all.
    pub(super) fn name_goal(
        &mut self,
        now: Monotonic,
        neutral: Duration,
        (may_start, must_lock): (bool, bool),
    ) {
        if self.goal.is_some() {
            return;
        }
        let is_enough = |since: &Monotonic| now.since(*since) >= neutral;
        if must_lock || !self.neutral_since.as_ref().is_some_and(is_enough) {
            // As a release, without neutral: a key that is pressed again soon drives on.
            self.lose(now);
            self.neutral_since = None;
            return;
        }
        if may_start {
            self.lock();
            self.is_given = true;
            self.goal = Some(GoalInForce {
                started: now,
                received: None,
            });
        }
    }

    /// A planner's velocity arrived.
    pub(super) fn planned(
        &mut self,
        now: Monotonic,
        velocity: Velocity,
        arrived: Monotonic,
        max_gap: Duration,
    ) {
        let Some(goal) = self.goal.as_mut().filter(|goal| arrived >= goal.started) else {
            return;
        };
        let has_gap = goal
            .received
            .is_some_and(|received| arrived.since(received) > max_gap);
        if velocity.is_finite() && now.since(arrived) <= max_gap && !has_gap {
            goal.received = goal.received.max(Some(arrived));
        } else {
            self.lock();
        }
    }

    /// The last command is too old.
    pub(super) fn too_old(&mut self, now: Monotonic) {
        self.lose(now);
        self.neutral_since = None;
    }

    /// The collision monitor gives no limits.
    pub(super) fn monitor_unavailable(&mut self) {
        if self.is_given {
            self.lock();
        }
    }

    /// The vehicle stands.
    pub(super) fn stand(&mut self) {
        if !self.is_given {
            self.lost = None;
        }
    }

    fn lose(&mut self, now: Monotonic) {
        self.goal = None;
        if self.is_given {
            self.is_given = false;
            self.lost = Some(now);
        }
    }
}
