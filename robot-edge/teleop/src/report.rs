//! The state of the arbiter for consoles, and its counters.

use std::time::Duration;

use crate::arbiter::{ArbiterState, Mode};
use crate::command_stream::ArmingState;
use crate::config::Rules;
use crate::interface::CollisionMonitorOutput;
use crate::lease::{EStop, Lease};
use crate::motion::Velocity;
use measurement::time::Monotonic;
use protocol::message::{Arming, Clamp, DockingChoice, GoalEnd, MapPose, Refusal};

/// What an operator needs to know: the driver, the age of commands, the requested and the applied velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TeleopReport {
    /// The state, and why.
    pub mode: Mode,
    /// Nothing holds the vehicle where it is: a boat without thrust.
    pub is_drifting: bool,
    /// Who holds the lease, who will, who asks.
    pub lease: Lease,
    /// Whether a key that goes down now would count.
    pub arming: Arming,
    /// Sequence number of the last command taken under this epoch.
    pub last_seq: Option<u64>,
    /// Age of the command in force; absent where there is none.
    pub age: Option<Duration>,
    /// The greatest age within the last second; absent where no command came.
    pub peak_age: Option<Duration>,
    /// What that age allows, metres per second; at most the vehicle's greatest speed.
    pub speed_allowed_mps: f64,
    /// What the holder asks.
    pub requested: Velocity,
    /// The velocity sent to the motors.
    pub applied: Velocity,
    /// Why the applied velocity differs from the requested one.
    pub clamp: Option<Clamp>,
    /// The collision monitor's last output; absent if there is none or it is too old.
    pub collision_monitor: Option<CollisionMonitorOutput>,
    /// The velocity measured by the sensors.
    pub measured: Option<Velocity>,
    /// The emergency stop in force.
    pub estop: Option<EStop>,
    /// The docking site into whose vegetation the vehicle may push.
    pub docking: Option<DockingChoice>,
    /// The goal that runs.
    pub goal: Option<MapPose>,
    /// Why the last goal ended.
    pub last_goal_end: Option<GoalEnd>,
    /// What was obeyed and what was refused.
    pub counters: Counters,
}

impl ArbiterState {
    /// The state as a console is shown it.
    pub fn report(&self, rules: &Rules, now: Monotonic) -> TeleopReport {
        let now = self.clamp_time(now);
        TeleopReport {
            mode: self.mode,
            is_drifting: match self.mode {
                Mode::Idle | Mode::Held => rules.is_boat,
                Mode::SafeBoot
                | Mode::Driving
                | Mode::Stopping { .. }
                | Mode::EStop
                | Mode::Fault(_) => false,
            },
            lease: self.lease,
            arming: match self.stream.arming {
                ArmingState::Locked => Arming::Locked,
                ArmingState::Neutral { .. } => Arming::Neutral,
                ArmingState::Pressed => Arming::Pressed,
            },
            last_seq: self.stream.last_seq,
            age: self.stream.age(now),
            peak_age: self.stream.ages.peak(now),
            speed_allowed_mps: self
                .speed_allowed_mps(rules, now)
                .min(rules.limits.linear.speed),
            requested: self.stream.requested,
            applied: self.motion.velocity(),
            clamp: self.clamp,
            collision_monitor: self.monitor_output(now),
            measured: self.measured,
            estop: self.estop,
            docking: self.docking(),
            goal: self.goal.map(|goal| goal.pose),
            last_goal_end: self.last_goal_end,
            counters: self.counters,
        }
    }
}

/// What was obeyed and what was not, since the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Counters {
    /// Commands of the holder that were taken, neutral ones too.
    pub accepted: u64,
    /// Times that a moving vehicle stopped without its operator having asked for it.
    pub involuntary_stops: u64,
    refused: [u64; Refusal::ALL.len()],
}

impl Counters {
    /// How often something was refused for this reason.
    pub const fn refused(&self, refusal: Refusal) -> u64 {
        self.refused[refusal as usize]
    }

    pub(super) const fn refuse(&mut self, refusal: Refusal) {
        let count = &mut self.refused[refusal as usize];
        *count = count.saturating_add(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reason_has_its_own_counter() {
        let mut counters = Counters::default();
        for (times, refusal) in Refusal::ALL.into_iter().enumerate() {
            for _ in 0..times {
                counters.refuse(refusal);
            }
        }
        for (times, refusal) in Refusal::ALL.into_iter().enumerate() {
            assert_eq!(counters.refused(refusal), times as u64, "{refusal}");
        }
    }
}
