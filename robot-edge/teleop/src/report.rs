//! What a console is shown of the arbiter.

use std::time::Duration;

use super::arbiter::{ArbiterState, Mode};
use super::arming::Arming;
use super::config::Rules;
use super::emergency_stop::EStop;
use super::lease::Lease;
use super::refusal::Counters;
use super::speed_limits::CollisionMonitorOutput;
use super::velocity::Velocity;
use measurement::time::Monotonic;

/// Everything an operator must see: who drives, how old commands are, what is asked, what is done and why it differs.
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
    /// What the motors are told.
    pub applied: Velocity,
    /// What made the one differ from the other.
    pub clamp: Option<Clamp>,
    /// The guard's last word; absent where it has not spoken, or too long ago.
    pub collision_monitor: Option<CollisionMonitorOutput>,
    /// How fast the vehicle is, as its sensors tell.
    pub measured: Option<Velocity>,
    /// The emergency stop in force.
    pub estop: Option<EStop>,
    /// What was obeyed and what was refused.
    pub counters: Counters,
}

/// What keeps the applied speed from the requested one now: of several, the tightest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Clamp {
    /// The vehicle's greatest speed.
    Vehicle,
    /// The age of commands: `teleop.max_latency_travel_m`.
    Age,
    /// The collision monitor.
    CollisionMonitor,
    /// The limits of acceleration and jerk.
    Ramp,
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
            arming: self.stream.arming,
            last_seq: self.stream.last_seq,
            age: self.stream.age(now),
            peak_age: self.stream.ages.peak(now),
            speed_allowed_mps: self.speed_allowed_mps(rules, now).min(rules.linear.speed),
            requested: self.stream.requested,
            applied: self.motion.velocity(),
            clamp: self.clamp,
            collision_monitor: self.monitor_output(now),
            measured: self.measured,
            estop: self.estop,
            counters: self.counters,
        }
    }
}
