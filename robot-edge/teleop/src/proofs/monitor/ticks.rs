//! What must hold over a tick: P1, P6, P7 and P9.

use std::time::Duration;

use super::{Monitor, Violation, ensure};
use crate::arbiter::{ArbiterState, Mode, step};
use crate::config::Rules;
use crate::input::ArbiterInput;
use crate::input::CollisionMonitorOutput;
use crate::motion::Velocity;
use crate::motion::{AxisLimits, Caps};
use crate::proofs::millis;
use measurement::time::Monotonic;

const MAX_STEP: Duration = millis(40);
const ROUNDING: f64 = 1e-9;
/// Of an acceleration that is found by dividing what ended at a target by a small `dt`.
const ACCEL_ROUNDING: f64 = 1e-3;

impl Monitor {
    pub(super) fn observe_tick(
        &mut self,
        rules: &Rules,
        before: &ArbiterState,
        now: Monotonic,
        was: Velocity,
        after: &ArbiterState,
        is: Velocity,
    ) -> Result<(), Violation> {
        let is_held = self.holder.is_some() && now.since(self.renewed) <= rules.lease;
        ensure(
            is_held || self.holder.is_none(),
            "P2: a lease lives on that nobody renews",
        )?;
        let dt = self
            .last_tick
            .map_or(Duration::ZERO, |last| now.since(last));
        self.last_tick = Some(now);
        let is_young = self
            .in_force
            .is_some_and(|last| now.since(last.issued) <= rules.max_age);
        if self.in_force.is_some() && !is_young {
            self.licence.too_old(now);
        }
        if !self.monitor_is_available(now) {
            self.licence.monitor_unavailable();
        }
        let may_grow = is_young
            && self.holder.is_some()
            && self.in_force.is_some_and(|last| last.is_pressed)
            && self.licence.is_given()
            && self.monitor_is_available(now)
            && self.estop.is_none()
            && !self.has_fault
            // On the way to a stop a press that counts must wait until the vehicle stands.
            && after.mode() == Mode::Driving;

        let output = self
            .collision_monitor
            .map_or(CollisionMonitorOutput::Stale, |(output, _)| output);
        let caps = output.caps();
        let caps = (caps.0.at_most(after.speed_allowed_mps(rules, now)), caps.1);
        let linear = AxisTick::new(was.linear_mps, is.linear_mps, caps.0);
        let angular = AxisTick::new(was.angular_radps, is.angular_radps, caps.1);
        let accel = self.accel;
        self.accel = Velocity {
            linear_mps: linear.judge(&rules.linear, dt, may_grow, accel.linear_mps)?,
            angular_radps: angular.judge(&rules.angular, dt, may_grow, accel.angular_radps)?,
        };
        compare_without_guard(rules, before, now, was, is)
    }
}

/// P9: from the same state the output without a guard is at least as fast, unless it is already on its way to the
/// other direction, in which case the guard still makes nothing faster than it was.
fn compare_without_guard(
    rules: &Rules,
    before: &ArbiterState,
    now: Monotonic,
    was: Velocity,
    is: Velocity,
) -> Result<(), Violation> {
    let mut unguarded = *before;
    unguarded.collision_monitor = Some((CollisionMonitorOutput::Off, now));
    let (_, actions) = step(rules, unguarded, now, ArbiterInput::Tick);
    let free = actions.output;
    let is_slower = |is: f64, free: f64, was: f64| is.abs() <= free.abs().max(was.abs()) + ROUNDING;
    ensure(
        is_slower(is.linear_mps, free.linear_mps, was.linear_mps)
            && is_slower(is.angular_radps, free.angular_radps, was.angular_radps),
        "P9: the guard makes it faster",
    )
}

/// One axis over one tick.
struct AxisTick {
    was: f64,
    is: f64,
    cap: f64,
    /// It was faster than a cap, so that it brakes without regard to jerk.
    is_braked: bool,
}

impl AxisTick {
    fn new(was: f64, is: f64, caps: Caps) -> Self {
        // Where it stands, it may be because it must not go on to the other side.
        let least = caps.towards(1.0).min(caps.towards(-1.0));
        let cap = if is.abs() > 0.0 {
            caps.towards(is)
        } else {
            least
        };
        let is_braked = was.abs() > caps.towards(was) + ROUNDING;
        Self {
            was,
            is,
            cap,
            is_braked,
        }
    }

    /// P1 and P7; returns the acceleration that the next tick's jerk counts from.
    fn judge(
        &self,
        limits: &AxisLimits,
        dt: Duration,
        may_grow: bool,
        accel: f64,
    ) -> Result<f64, Violation> {
        let (was, is) = (self.was, self.is);
        let dt_s = dt.as_secs_f64();
        let ramp = (was.abs() - limits.stop_decel * dt_s).max(0.0);
        ensure(
            is.abs() <= limits.speed + ROUNDING,
            "P7: faster than the vehicle may be",
        )?;
        ensure(
            (is - was).abs() <= limits.stop_decel.max(limits.accel) * dt_s + ROUNDING,
            "P7: harder than any limit",
        )?;
        ensure(
            is.abs() <= self.cap.max(ramp) + ROUNDING,
            "P1, P9: faster than age or guard allow, and not braking",
        )?;
        if !may_grow {
            ensure(
                is.abs() <= ramp + ROUNDING,
                "P1, P6: above the stopping ramp without a young press that counts",
            )?;
            ensure(is * was >= 0.0, "P1: the stopping ramp passes zero")?;
            return Ok(0.0);
        }
        if dt_s <= 0.0 {
            return Ok(accel);
        }
        if self.is_braked {
            ensure(
                is.abs() <= was.abs() + ROUNDING,
                "P7: it speeds up above a cap",
            )?;
            return Ok(0.0);
        }
        let dt_s = dt.min(MAX_STEP).as_secs_f64();
        let next = (is - was) / dt_s;
        ensure(
            next.abs() <= limits.accel + ACCEL_ROUNDING,
            "P7: more than the greatest acceleration",
        )?;
        // What speeds up when a cap comes down stops doing so at once.
        let is_capped = is.abs() > self.cap - ROUNDING;
        let is_let_go = is_capped
            && next * accel >= -ACCEL_ROUNDING
            && next.abs() <= accel.abs() + ACCEL_ROUNDING;
        let change = (next - accel).abs();
        ensure(
            is_let_go || change <= limits.jerk * dt_s + ACCEL_ROUNDING,
            "P7: more than the greatest jerk",
        )?;
        Ok(if is_capped { 0.0 } else { next })
    }
}
