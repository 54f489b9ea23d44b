//! What the teleop loop and the session with a planner hand each other.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use protocol::message::{GoalEnd, MapPose, Plan};

use crate::lock;
use measurement::time::Monotonic;
use teleop::Velocity;

/// Clones share it. Each part is the newest of its kind, in a slot: a flood replaces it and waits for nothing.
#[derive(Clone, Debug, Default)]
pub struct PlannerExchange(Arc<Slots>);

#[derive(Debug, Default)]
struct Slots {
    velocity: Mutex<Option<(Velocity, Monotonic)>>,
    /// The goal that runs, and the number of changes.
    goal: Mutex<(u64, Option<MapPose>)>,
    plan: Mutex<Plan>,
    is_present: AtomicBool,
    goal_ends: [AtomicU64; GoalEnd::ALL.len()],
}

impl PlannerExchange {
    /// A velocity of the planner. One that is not finite stays until the loop takes it.
    pub fn offer(&self, velocity: Velocity, arrived: Monotonic) {
        let mut slot = lock(&self.0.velocity);
        let kept = slot.map(|(last, _)| last).filter(|last| !last.is_finite());
        *slot = Some((kept.unwrap_or(velocity), arrived));
    }

    /// The newest velocity that was not taken, and when it arrived. The lock is held for a copy only.
    pub(super) fn take(&self) -> Option<(Velocity, Monotonic)> {
        lock(&self.0.velocity).take()
    }

    /// The goal that runs, and a number that grows with each start and end.
    pub fn goal(&self) -> (u64, Option<MapPose>) {
        *lock(&self.0.goal)
    }

    pub(super) fn start_goal(&self, goal: MapPose) {
        self.set_goal(Some(goal));
    }

    fn set_goal(&self, goal: Option<MapPose>) {
        let mut slot = lock(&self.0.goal);
        *slot = (slot.0 + 1, goal);
    }

    pub(super) fn end_goal(&self, why: GoalEnd) {
        self.set_goal(None);
        self.0.goal_ends[why as usize].fetch_add(1, Ordering::Relaxed);
    }

    /// How many goals ended, by reason.
    pub fn goal_ends(&self) -> impl Iterator<Item = (GoalEnd, u64)> {
        let count = |why: GoalEnd| self.0.goal_ends[why as usize].load(Ordering::Relaxed);
        GoalEnd::ALL.into_iter().map(move |why| (why, count(why)))
    }

    /// Whether a planner takes goals.
    pub fn is_present(&self) -> bool {
        self.0.is_present.load(Ordering::Relaxed)
    }

    pub fn set_present(&self, is_present: bool) {
        self.0.is_present.store(is_present, Ordering::Relaxed);
    }

    /// The path to the goal, for consoles.
    pub fn plan(&self) -> Plan {
        lock(&self.0.plan).clone()
    }

    pub fn set_plan(&self, plan: Plan) {
        *lock(&self.0.plan) = plan;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_wins_but_what_is_not_finite_is_not_lost() {
        let exchange = PlannerExchange::default();
        let at = |ms: u64| Monotonic::from_nanos(ms * 1_000_000);
        let ahead = |speed| Velocity::new(speed, 0.0);
        assert_eq!(exchange.take(), None);
        for n in 1..=1000 {
            exchange.offer(ahead(n as f64), at(n));
        }
        assert_eq!(exchange.take(), Some((ahead(1000.0), at(1000))));
        assert_eq!(exchange.take(), None);
        exchange.offer(ahead(f64::NAN), at(1));
        exchange.offer(ahead(1.0), at(2));
        let (velocity, arrived) = exchange.take().unwrap();
        assert!(!velocity.is_finite() && arrived == at(2));
        exchange.offer(ahead(1.0), at(3));
        assert_eq!(exchange.take(), Some((ahead(1.0), at(3))));
    }
}
