//! Time passes: what has become too old, and what the motors are told.

use std::time::Duration;

use super::{ArbiterState, Mode, Step, StopReason};
use crate::action::Action;
use crate::arming::Arming;
use crate::config::Rules;
use crate::lease::LeaseEnd;
use crate::motion::{Caps, Motion, MotionTarget};
use crate::report::Clamp;
use crate::speed_limits::CollisionMonitorOutput;
use crate::velocity::Velocity;
use measurement::time::Monotonic;

/// Smallest age that is reckoned with, so that there is always a speed to divide for.
const MIN_AGE: Duration = Duration::from_millis(1);

/// An emergency stop that is not on disk is given to be stored again after this.
const STORE_RETRY: Duration = Duration::from_secs(1);

/// Difference from what is asked that is worth an explanation, metres or radians per second.
const SPEED_TOLERANCE: f64 = 1e-3;

impl ArbiterState {
    /// The speed at which the vehicle goes `max_latency_travel_m` within the greatest age of the last second, metres per
    /// second. Where nothing is known of the age, the greatest that is allowed is assumed.
    pub(crate) fn speed_allowed_mps(&self, rules: &Rules, now: Monotonic) -> f64 {
        let age = self.stream.ages.peak(now).unwrap_or(rules.max_age);
        rules.max_latency_travel_m / age.max(MIN_AGE).as_secs_f64()
    }
}

impl Step<'_> {
    pub(super) fn tick(&mut self) {
        let last_tick = self.state.last_tick.replace(self.now);
        let dt = last_tick.map_or(Duration::ZERO, |last| self.now.since(last));
        self.state
            .lease
            .expire_request(self.now, self.rules.request_timeout);
        self.check_age();
        if self.state.lease.is_expired(self.now, self.rules.lease) {
            self.end_lease(LeaseEnd::Expired, None);
        }
        self.check_monitor();
        match self.state.mode {
            Mode::SafeBoot | Mode::Idle | Mode::Held | Mode::EStop | Mode::Fault(_) => {
                self.state.motion = Motion::default();
                self.state.clamp = None;
            }
            Mode::Driving => self.drive(dt),
            Mode::Stopping { .. } => {
                let limits = (&self.rules.linear, &self.rules.angular);
                self.state.motion = self.state.motion.stopping(dt, limits);
                self.state.clamp = None;
                if self.state.motion.is_zero() {
                    self.enter_standstill();
                }
            }
        }
        self.retry_estop_store();
    }

    /// Takes note of the age of the command in force; where it is too old, the vehicle stops, and what was pressed no
    /// longer counts.
    fn check_age(&mut self) {
        let Some(age) = self.state.stream.age(self.now) else {
            return;
        };
        let most = self.rules.max_age;
        self.state.stream.ages.record(self.now, age.min(most));
        if age > most {
            self.state.stream.arming = Arming::Locked;
            if self.state.mode == Mode::Driving {
                self.begin_stop(StopReason::Age);
            }
        }
    }

    /// Where the guard knows too little, the vehicle stops, and what was pressed no longer counts.
    fn check_monitor(&mut self) {
        if self.state.stream.arming != Arming::Pressed || self.monitor_is_available() {
            return;
        }
        self.state.stream.arming = Arming::Locked;
        if self.state.mode == Mode::Driving {
            self.begin_stop(StopReason::CollisionMonitorStale);
        }
    }

    /// One tick nearer to what is asked, within every limit.
    fn drive(&mut self, dt: Duration) {
        let limits = (&self.rules.linear, &self.rules.angular);
        let output = self
            .state
            .monitor_output(self.now)
            .unwrap_or(CollisionMonitorOutput::Stale);
        let monitor_caps = output.caps();
        let age_cap = self.state.speed_allowed_mps(self.rules, self.now);
        let requested = self.state.stream.requested;

        let (mut target, mut clamp) = (requested, None);
        for (cause, caps) in [
            (
                Clamp::Vehicle,
                (
                    Caps::NONE.at_most(limits.0.speed),
                    Caps::NONE.at_most(limits.1.speed),
                ),
            ),
            (Clamp::Age, (Caps::NONE.at_most(age_cap), Caps::NONE)),
            (Clamp::CollisionMonitor, monitor_caps),
        ] {
            let factor = factor_within(target, caps);
            if factor < 1.0 {
                let slower = target.scaled(factor);
                // What the wire rounds up is no more than what is allowed.
                if differ(target, slower) {
                    clamp = Some(cause);
                }
                target = slower;
            }
        }

        let aim = MotionTarget {
            target,
            caps: (monitor_caps.0.at_most(age_cap), monitor_caps.1),
        };
        self.state.motion = self.state.motion.towards(&aim, dt, limits);
        self.state.clamp = active_clamp(clamp, target, self.state.motion.velocity());
    }

    /// The output has become zero: who is next, drives; else who drove may go on after a press.
    fn enter_standstill(&mut self) {
        self.state.mode = if self.state.lease.holder.is_some() {
            Mode::Held
        } else {
            Mode::Idle
        };
        self.grant_next();
    }

    fn retry_estop_store(&mut self) {
        if let Some(estop) = &mut self.state.estop
            && !estop.is_stored
            && self.now.since(estop.store_requested) >= STORE_RETRY
        {
            estop.store_requested = self.now;
            self.actions.push(Action::StoreEStop(estop.id));
        }
    }
}

fn differ(one: Velocity, other: Velocity) -> bool {
    let differ = |one: f64, other: f64| (one - other).abs() > SPEED_TOLERANCE;
    differ(one.linear_mps, other.linear_mps) || differ(one.angular_radps, other.angular_radps)
}

/// What keeps the output from what is asked in this very tick. `limit` is why no more than `target` may be told: it
/// binds once the output is there, and while the output brakes towards it. On the way up, acceleration does.
fn active_clamp(limit: Option<Clamp>, target: Velocity, applied: Velocity) -> Option<Clamp> {
    // In the direction of the target; negative where the output is faster. A target of zero keeps the sign of what was
    // asked.
    let missing = |target: f64, applied: f64| target.abs() - applied * 1.0_f64.copysign(target);
    let missing = [
        missing(target.linear_mps, applied.linear_mps),
        missing(target.angular_radps, applied.angular_radps),
    ];
    let is_braking = missing.iter().any(|missing| *missing < -SPEED_TOLERANCE);
    let is_short = missing.iter().any(|missing| *missing > SPEED_TOLERANCE);
    match (is_braking, is_short) {
        (true, _) => limit.or(Some(Clamp::Ramp)),
        (false, true) => Some(Clamp::Ramp),
        (false, false) => limit,
    }
}

/// What `velocity` must be scaled by to be within `caps`, linear and angular: both parts alike, so that the arc that was
/// asked for, and that the guard looked at, keeps its shape.
fn factor_within(velocity: Velocity, caps: (Caps, Caps)) -> f64 {
    let within = |speed: f64, caps: Caps| {
        let cap = caps.towards(speed);
        if speed.abs() > cap {
            cap / speed.abs()
        } else {
            1.0
        }
    };
    within(velocity.linear_mps, caps.0).min(within(velocity.angular_radps, caps.1))
}
