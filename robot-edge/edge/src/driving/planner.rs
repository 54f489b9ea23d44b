//! What the teleop loop and the session with a planner hand each other.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use protocol::message::{GoalEnd, MapPose, Plan};

use crate::lock;
use measurement::time::Monotonic;
use teleop::{ArbiterInput, Velocity};

/// More velocities within [`FLOOD_PERIOD`] are a flood: planners send 10 to 50 a second, and a connection holds back 200 ms of
/// them at most.
const FLOOD: u32 = 50;
const FLOOD_PERIOD: Duration = Duration::from_millis(100);

/// Clones share it. Each part is the newest of its kind, in a slot: a flood replaces it and waits for nothing.
#[derive(Clone, Debug, Default)]
pub struct PlannerExchange(Arc<Slots>);

#[derive(Debug, Default)]
struct Slots {
    velocity: Mutex<VelocitySlot>,
    /// The goal that runs, and the number of changes.
    goal: Mutex<(u64, Option<MapPose>)>,
    plan: Mutex<Plan>,
    is_present: AtomicBool,
    goal_ends: [AtomicU64; GoalEnd::ALL.len()],
}

#[derive(Debug, Default)]
struct VelocitySlot {
    newest: Option<(Velocity, Monotonic)>,
    /// Since when velocities are counted, and how many came.
    counted: (Monotonic, u32),
    is_flooded: bool,
}

impl PlannerExchange {
    /// A velocity of the planner. One that is not finite, and a flood, stay until the loop takes them.
    pub fn offer(&self, velocity: Velocity, arrived: Monotonic) {
        let mut slot = lock(&self.0.velocity);
        let (since, count) = slot.counted;
        slot.counted = if arrived.since(since) < FLOOD_PERIOD {
            (since, count + 1)
        } else {
            (arrived, 1)
        };
        slot.is_flooded |= slot.counted.1 > FLOOD;
        let kept = slot.newest.map(|(last, _)| last);
        let kept = kept.filter(|last| !last.is_finite());
        slot.newest = Some((kept.unwrap_or(velocity), arrived));
    }

    /// The newest that the loop has not taken. The lock is held for a copy only.
    pub(super) fn take(&self) -> Option<ArbiterInput> {
        let mut slot = lock(&self.0.velocity);
        let (velocity, arrived) = slot.newest.take()?;
        Some(if std::mem::take(&mut slot.is_flooded) {
            ArbiterInput::PlannerFloods
        } else {
            ArbiterInput::Planned { velocity, arrived }
        })
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
        let taken = |speed, ms| {
            Some(ArbiterInput::Planned {
                velocity: ahead(speed),
                arrived: at(ms),
            })
        };
        assert_eq!(exchange.take(), None);
        // 500 a second is no flood.
        for n in 1..=1000 {
            exchange.offer(ahead(n as f64), at(2 * n));
        }
        assert_eq!(exchange.take(), taken(1000.0, 2000));
        assert_eq!(exchange.take(), None);
        for n in 0..60 {
            exchange.offer(ahead(1.0), at(3000 + n));
        }
        assert_eq!(exchange.take(), Some(ArbiterInput::PlannerFloods));
        assert_eq!(exchange.take(), None);
        exchange.offer(ahead(f64::NAN), at(4001));
        exchange.offer(ahead(1.0), at(4002));
        let Some(ArbiterInput::Planned { velocity, arrived }) = exchange.take() else {
            panic!("no velocity");
        };
        assert!(!velocity.is_finite() && arrived == at(4002));
        exchange.offer(ahead(1.0), at(4003));
        assert_eq!(exchange.take(), taken(1.0, 4003));
    }
}
