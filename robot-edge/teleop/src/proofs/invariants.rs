//! The invariants P1 to P9, P12 and P13: what must hold after every step, whatever the input. An independent reading of the
//! rules, which every sequence of the property tests and every transition of the model checker is held against.
//!
//! The monitor believes the arbiter in nothing but the tokens (tested by themselves) and in whom it grants the lease to;
//! what follows from that it works out by itself.

use std::time::Duration;

use super::millis;
use super::permission::Permission;
use crate::arbiter::{ArbiterState, Mode, axis_cap_mps, step};
use crate::command_stream::DriveCommand;
use crate::config::Rules;
use crate::interface::{
    Action, Actions, ArbiterEvent, ArbiterInput, CollisionMonitorOutput, LeaseVerb,
};
use crate::lease::{EStopId, OperatorId, Role, StoredEStop};
use crate::locomotion::LocomotionMode;
use crate::motion::{AxisLimits, Caps, MotionLimits, Velocity};
use crate::token::AgeToken;
use measurement::time::Monotonic;
use protocol::message::{Answer, LeaseEnd};

const MONITOR_TIMEOUT: Duration = millis(300);
const MAX_STEP: Duration = millis(40);
const ROUNDING: f64 = 1e-9;
/// Of two axes whose speed together is above a limit, as a share of the deceleration of stops: (1 − ½)/√2.
const SLOWEST_BRAKING: f64 = 0.353;
/// Of an acceleration that is found by dividing what ended at a target by a small `dt`.
const ACCEL_ROUNDING: f64 = 1e-3;

/// An invariant that does not hold.
pub(super) type Violation = &'static str;

/// One step of the arbiter.
pub(super) struct Transition<'a> {
    pub(super) rules: &'a Rules,
    pub(super) before: &'a ArbiterState,
    pub(super) now: Monotonic,
    pub(super) input: ArbiterInput,
    pub(super) after: &'a ArbiterState,
    pub(super) actions: &'a Actions,
}

impl Transition<'_> {
    fn is_young(&self, token: AgeToken) -> bool {
        let age = self.before.tokens().age(token, self.now);
        age.is_ok_and(|age| age <= self.rules.max_age)
    }
}

/// The emergency stop as asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Latched {
    pub(super) id: EStopId,
    pub(super) is_stored: bool,
    pub(super) requested_at: Monotonic,
}

/// The holder's newest command that is to be obeyed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct InForce {
    pub(super) issued: Monotonic,
    pub(super) is_pressed: bool,
}

/// What is remembered of the steps so far.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub(super) struct Monitor {
    pub(super) epoch: u64,
    pub(super) holder: Option<OperatorId>,
    pub(super) renewed: Monotonic,
    pub(super) last_seq: Option<u64>,
    pub(super) in_force: Option<InForce>,
    pub(super) permission: Permission,
    /// Operators that asked for the lease, a bit each.
    pub(super) requested_at: u32,
    pub(super) estop: Option<Latched>,
    pub(super) is_booted: bool,
    pub(super) has_fault: bool,
    pub(super) collision_monitor: Option<(CollisionMonitorOutput, Monotonic)>,
    pub(super) last_tick: Option<Monotonic>,
    /// In which mode it moved last, and when.
    pub(super) moved_in: Option<(LocomotionMode, Monotonic)>,
    /// Accelerations of the last tick that was free of stops: the least and the greatest that its output allows.
    pub(super) accel: [Velocity; 2],
}

impl Monitor {
    /// Checks one transition.
    pub(super) fn observe(&mut self, transition: &Transition<'_>) -> Result<(), Violation> {
        let (before, after) = (transition.before, transition.after);
        let (was, is) = (before.motion.velocity(), transition.actions.output);
        ensure(is.is_finite(), "P8: the output is not finite")?;
        ensure(
            !transition.actions.is_full(),
            "more actions than there is room for",
        )?;
        ensure(
            is == after.motion.velocity(),
            "the state has another output",
        )?;
        let reported = after.report(transition.rules, transition.now).applied;
        ensure(is == reported, "the report has another output")?;
        self.observe_input(transition)?;
        self.observe_actions(transition)?;

        let is_zero = is == Velocity::ZERO;
        if transition.input == ArbiterInput::Tick {
            self.observe_tick(transition, was, is)?;
        } else {
            ensure(
                is_zero || is == was,
                "an input other than a tick moves the vehicle",
            )?;
            if after.mode() != Mode::Driving && is_zero {
                self.accel = [Velocity::ZERO; 2];
            }
        }
        ensure(
            after.goal.is_some() == self.permission.goal.is_some(),
            "a goal runs, or does not, against the rules",
        )?;
        let must_stand = self.estop.is_some() || self.has_fault || !self.is_booted;
        ensure(
            is_zero || !must_stand,
            "P5: it moves in spite of an emergency stop, a fault or the boot",
        )?;
        let may_move = matches!(after.mode(), Mode::Driving | Mode::Stopping { .. });
        ensure(
            is_zero || may_move,
            "it moves in a state whose output is zero",
        )?;
        if is_zero {
            self.permission.stand();
        }
        Ok(())
    }

    /// P3, P4: exactly those commands are obeyed that are the holder's, of this grant, young and in sequence.
    fn is_to_be_obeyed(
        &self,
        transition: &Transition<'_>,
        role: Role,
        command: &DriveCommand,
    ) -> bool {
        role != Role::Observer
            && self.holder == Some(command.operator)
            && self.epoch == command.epoch
            && self.last_seq.is_none_or(|last| command.seq > last)
            && transition.is_young(command.token)
    }

    fn observe_input(&mut self, transition: &Transition<'_>) -> Result<(), Violation> {
        let Transition {
            before, now, after, ..
        } = *transition;
        let mut is_obeyed = false;
        match transition.input {
            ArbiterInput::Command { role, command } => {
                let requested = command.requested;
                if command.estop && role != Role::Observer {
                    self.emergency_stop(now, after)?;
                } else if self.is_to_be_obeyed(transition, role, &command) {
                    self.last_seq = Some(command.seq);
                    if requested.is_finite() {
                        is_obeyed = true;
                        self.obey(transition, &command);
                    } else {
                        self.permission.lock();
                        self.in_force = self.in_force.map(|last| InForce {
                            is_pressed: false,
                            ..last
                        });
                    }
                }
            }
            ArbiterInput::Lease {
                caller,
                token,
                verb,
            } => {
                let may = transition.is_young(token) && caller.role != Role::Observer;
                let asks = match verb {
                    LeaseVerb::Request => may,
                    LeaseVerb::TakeOver => may && caller.role == Role::Supervisor,
                    LeaseVerb::HandOver { .. } | LeaseVerb::Refuse { .. } | LeaseVerb::Release => {
                        false
                    }
                };
                if asks {
                    self.requested_at |= bit(caller.operator);
                }
            }
            ArbiterInput::Revoked(operator) => {
                self.requested_at &= !bit(operator);
                ensure(
                    !after.lease.is_held_by(operator),
                    "P3: who was revoked holds the lease",
                )?;
            }
            ArbiterInput::EStop(caller) if caller.role != Role::Observer => {
                self.emergency_stop(now, after)?;
            }
            ArbiterInput::LocalEStop => {
                self.emergency_stop(now, after)?;
            }
            ArbiterInput::EStopStored(id) => {
                if let Some(estop) = self.estop.as_mut().filter(|estop| estop.id == id) {
                    estop.is_stored = true;
                }
            }
            ArbiterInput::Reset { caller, token, id } => {
                let may = caller.role == Role::Supervisor
                    || caller.role == Role::Operator && self.holder == Some(caller.operator);
                let knows = |estop: Latched| {
                    let issued = before.tokens().issued(token, now);
                    estop.id == id
                        && estop.is_stored
                        && issued.is_ok_and(|then| then > estop.requested_at)
                };
                let is_right = may
                    && transition.is_young(token)
                    && self.estop.is_some_and(knows)
                    && self.is_booted
                    && !self.has_fault;
                self.reset(is_right, after)?;
            }
            ArbiterInput::LocalReset => {
                if self.has_fault {
                    (self.has_fault, self.is_booted) = (false, false);
                } else if self.is_booted {
                    self.reset(self.estop.is_some(), after)?;
                }
            }
            ArbiterInput::SelfTest { has_passed, stored } => {
                self.self_test(now, has_passed, stored, after);
            }
            ArbiterInput::CollisionMonitor(output) => self.collision_monitor = Some((output, now)),
            ArbiterInput::ActuatorFault => self.fault(),
            ArbiterInput::Planned { velocity, arrived } => {
                let had_goal = self.permission.goal.is_some();
                if let Some(planner) = transition.rules.planner {
                    self.permission
                        .planned(now, velocity, arrived, planner.max_gap);
                }
                let same = ArbiterState {
                    now: after.now,
                    ..*before
                };
                ensure(
                    had_goal || same == *after,
                    "a planner has an effect without a goal",
                )?;
            }
            ArbiterInput::PlannerFloods if self.permission.goal.is_some() => self.permission.lock(),
            ArbiterInput::MotorsHeld => {
                self.permission.lock();
                self.in_force = self.in_force.map(|last| InForce {
                    is_pressed: false,
                    ..last
                });
            }
            ArbiterInput::Tick
            | ArbiterInput::Token { .. }
            | ArbiterInput::Rejected(_)
            | ArbiterInput::EStop(_)
            | ArbiterInput::PlannerFloods
            | ArbiterInput::Measured(_) => {}
        }
        let more = after.counters.accepted - before.counters.accepted;
        ensure(
            more == u64::from(is_obeyed),
            "P3, P4: another command is obeyed than should be",
        )
    }

    fn obey(&mut self, transition: &Transition<'_>, command: &DriveCommand) {
        let Transition {
            rules, before, now, ..
        } = *transition;
        let is_neutral = command.requested.is_neutral();
        let names_goal = is_neutral && command.goal.is_some();
        if names_goal {
            let is_available = rules.planner.is_some() && self.monitor_is_available(now);
            let may_start = before.mode() == Mode::Held;
            self.permission
                .name_goal(now, rules.neutral, (may_start, !is_available));
        }
        let is_pressed = !is_neutral || names_goal && self.permission.goal.is_some();
        if let Ok(issued) = before.tokens().issued(command.token, now) {
            self.in_force = Some(InForce { issued, is_pressed });
        }
        self.renewed = now;
        if names_goal {
            return;
        }
        if is_pressed {
            let moves = before.motion.velocity() != Velocity::ZERO;
            let may_recover = moves && self.monitor_is_available(now);
            self.permission.press(now, rules.neutral, may_recover);
        } else {
            self.permission.neutral(now);
        }
    }

    fn emergency_stop(&mut self, now: Monotonic, after: &ArbiterState) -> Result<(), Violation> {
        self.permission.lock();
        let id = after.estop.ok_or("P5: an emergency stop is not heard")?.id;
        let latched = Latched {
            id,
            is_stored: false,
            requested_at: now,
        };
        self.estop.get_or_insert(latched).requested_at = now;
        Ok(())
    }

    fn reset(&mut self, is_right: bool, after: &ArbiterState) -> Result<(), Violation> {
        if is_right {
            self.estop = None;
            self.permission.lock();
        }
        ensure(
            after.estop.is_none() == self.estop.is_none(),
            "P5: an emergency stop ends, or does not, against the rules",
        )
    }

    fn self_test(
        &mut self,
        now: Monotonic,
        has_passed: bool,
        stored: StoredEStop,
        after: &ArbiterState,
    ) {
        if !self.is_booted && !self.has_fault {
            self.is_booted = true;
            if stored != StoredEStop::None && self.estop.is_none() {
                self.estop = after.estop.map(|estop| Latched {
                    id: estop.id,
                    is_stored: stored != StoredEStop::Unreadable,
                    requested_at: now,
                });
            }
        }
        if !has_passed {
            self.fault();
        }
    }

    fn fault(&mut self) {
        self.has_fault = true;
        self.permission.lock();
    }

    fn forget_commands(&mut self) {
        self.last_seq = None;
        self.in_force = None;
        self.permission.lock();
    }

    fn monitor_is_available(&self, now: Monotonic) -> bool {
        self.collision_monitor.is_some_and(|(output, received_at)| {
            output != CollisionMonitorOutput::Stale && now.since(received_at) <= MONITOR_TIMEOUT
        })
    }

    fn observe_actions(&mut self, transition: &Transition<'_>) -> Result<(), Violation> {
        let Transition {
            rules,
            now,
            actions,
            ..
        } = *transition;
        for action in actions.iter() {
            match action {
                Action::Notify(ArbiterEvent::LeaseEnded { operator, why }) => {
                    ensure(
                        self.holder == Some(operator),
                        "P2: a lease ends that nobody has",
                    )?;
                    let is_due = now.since(self.renewed) > rules.lease;
                    ensure(
                        is_due || why != LeaseEnd::Expired,
                        "P12: a lease expires too early",
                    )?;
                    self.holder = None;
                    self.forget_commands();
                }
                Action::Notify(ArbiterEvent::LeaseGranted { to, epoch, .. }) => {
                    ensure(self.holder.is_none(), "P2: a second holder")?;
                    ensure(epoch > self.epoch, "P3: the epoch does not grow")?;
                    ensure(
                        self.requested_at & bit(to) != 0,
                        "P2: a lease for who did not ask",
                    )?;
                    ensure(
                        actions.output == Velocity::ZERO,
                        "P2: the lease changes hands on a moving vehicle",
                    )?;
                    (self.holder, self.epoch) = (Some(to), epoch);
                    self.renewed = now;
                    self.requested_at &= !bit(to);
                    self.forget_commands();
                }
                Action::AcknowledgeEStop(EStopId(id))
                | Action::Answer {
                    answer: Answer::EStopped(id),
                    ..
                } => {
                    let is_stored = self
                        .estop
                        .is_some_and(|estop| estop.is_stored && estop.id.0 == id);
                    ensure(
                        is_stored,
                        "P5: an emergency stop is acknowledged before it is stored",
                    )?;
                }
                Action::PublishToken(_)
                | Action::Answer { .. }
                | Action::StoreEStop(_)
                | Action::ClearEStop(_)
                | Action::Notify(_) => {}
            }
        }
        Ok(())
    }

    /// P1, P6, P7 and P9.
    fn observe_tick(
        &mut self,
        transition: &Transition<'_>,
        was: Velocity,
        is: Velocity,
    ) -> Result<(), Violation> {
        let Transition {
            rules, now, after, ..
        } = *transition;
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
            self.permission.too_old(now);
        }
        if !self.monitor_is_available(now) {
            self.permission.monitor_unavailable();
        }
        if let (Some(goal), Some(planner)) = (self.permission.goal, rules.planner) {
            let is_silent = match goal.received {
                Some(received) => now.since(received) > planner.max_gap,
                None => now.since(goal.started) > planner.planning_time,
            };
            if is_silent {
                self.permission.lock();
            }
        }
        let may_grow = is_young
            && self.holder.is_some()
            && self.in_force.is_some_and(|last| last.is_pressed)
            && self.permission.is_given
            // Of a goal, only what the planner says moves it.
            && self.permission.goal.is_none_or(|goal| goal.received.is_some())
            && self.monitor_is_available(now)
            && self.estop.is_none()
            && !self.has_fault
            // On the way to a stop a press that counts must wait until the vehicle stands.
            && after.mode() == Mode::Driving;

        let output = self
            .collision_monitor
            .map_or(CollisionMonitorOutput::Stale, |(output, _)| output);
        let age_cap = after.speed_allowed_mps(rules, now);
        if was.linear_mps.abs() > 0.0 && was.lateral_mps.abs() > 0.0 {
            // One axis brakes as in a stop, while the other may speed up by half of that.
            let brakes_mps = SLOWEST_BRAKING * rules.limits.linear.stop_decel * dt.as_secs_f64();
            ensure(
                is.ground_speed_mps()
                    <= age_cap.max(was.ground_speed_mps() - brakes_mps) + ROUNDING,
                "P1: both axes together are faster than age allows, and do not brake",
            )?;
        }
        self.observe_mode(transition, is)?;
        let mode = after.locomotion.unwrap_or(LocomotionMode::Differential);
        let caps = output.caps();
        // With two axes in use each gets less; with one, all of it.
        let target = after.possible_request();
        let axis_cap = axis_cap_mps(age_cap, was, target);
        let linear = AxisTick::new(was.linear_mps, is.linear_mps, caps.linear.at_most(axis_cap));
        let lateral = AxisTick::new(
            was.lateral_mps,
            is.lateral_mps,
            caps.lateral.at_most(axis_cap),
        );
        let turn_rate = rules.locomotion.max_turn_rate_radps(mode, is.linear_mps);
        let angular_caps = caps.angular.at_most(turn_rate);
        let angular = AxisTick::new(was.angular_radps, is.angular_radps, angular_caps);
        let accel = self.accel;
        let MotionLimits {
            linear: along,
            angular: about,
        } = &rules.limits;
        let judge = |axis: AxisTick, limits, part: fn(&Velocity) -> f64| {
            axis.judge(limits, dt, may_grow, accel.map(|accel| part(&accel)))
        };
        let linear = judge(linear, along, |accel| accel.linear_mps)?;
        let lateral = judge(lateral, along, |accel| accel.lateral_mps)?;
        let angular = judge(angular, about, |accel| accel.angular_radps)?;
        self.accel = [0, 1].map(|end| Velocity {
            linear_mps: linear[end],
            lateral_mps: lateral[end],
            angular_radps: angular[end],
        });
        compare_without_monitor(transition, was, is)
    }

    /// P13: every motion is one of a locomotion mode, and between two modes the vehicle stands long enough.
    fn observe_mode(&mut self, transition: &Transition<'_>, is: Velocity) -> Result<(), Violation> {
        if is == Velocity::ZERO {
            return Ok(());
        }
        let (now, rules) = (transition.now, transition.rules);
        let mode = transition
            .after
            .locomotion
            .ok_or("P13: it moves without a mode")?;
        let part = mode.part_of(is);
        let off = [
            part.linear_mps - is.linear_mps,
            part.lateral_mps - is.lateral_mps,
            part.angular_radps - is.angular_radps,
        ];
        ensure(
            off.iter().all(|off| off.abs() < ROUNDING),
            "P13: its wheels are not set for that motion",
        )?;
        if let Some((last, at)) = self.moved_in.replace((mode, now)) {
            ensure(
                last == mode || now.since(at) >= rules.locomotion.change,
                "P13: between two modes it does not stand long enough",
            )?;
        }
        Ok(())
    }
}

fn bit(operator: OperatorId) -> u32 {
    1 << operator.0.min(31)
}

fn ensure(holds: bool, otherwise: Violation) -> Result<(), Violation> {
    if holds { Ok(()) } else { Err(otherwise) }
}

/// P9: from the same state the output without a collision monitor is at least as fast, unless it is already on its way
/// to the other direction, in which case it still makes nothing faster than it was.
fn compare_without_monitor(
    transition: &Transition<'_>,
    was: Velocity,
    is: Velocity,
) -> Result<(), Violation> {
    let mut unlimited = *transition.before;
    unlimited.collision_monitor = Some((CollisionMonitorOutput::Off, transition.now));
    let (_, actions) = step(
        transition.rules,
        unlimited,
        transition.now,
        ArbiterInput::Tick,
    );
    let free = actions.output;
    let is_slower = |is: f64, free: f64, was: f64| is.abs() <= free.abs().max(was.abs()) + ROUNDING;
    ensure(
        is_slower(is.linear_mps, free.linear_mps, was.linear_mps)
            && is_slower(is.lateral_mps, free.lateral_mps, was.lateral_mps)
            && is_slower(is.angular_radps, free.angular_radps, was.angular_radps),
        "P9: the collision monitor makes it faster",
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

    /// P1 and P7; returns the least and the greatest acceleration that the next tick's jerk may count from: at a cap it is let go,
    /// and where the speed came to the cap by itself it goes on. Which of both it was, rounding hides.
    fn judge(
        &self,
        limits: &AxisLimits,
        dt: Duration,
        may_grow: bool,
        accel: [f64; 2],
    ) -> Result<[f64; 2], Violation> {
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
            "P1, P9: faster than age or collision monitor allow, and not braking",
        )?;
        if !may_grow {
            ensure(
                is.abs() <= ramp + ROUNDING,
                "P1, P6: above the stopping ramp without a young press that counts",
            )?;
            ensure(is * was >= 0.0, "P1: the stopping ramp passes zero")?;
            return Ok([0.0; 2]);
        }
        if dt_s <= 0.0 {
            return Ok(accel);
        }
        if self.is_braked {
            ensure(
                is.abs() <= was.abs() + ROUNDING,
                "P7: it speeds up above a cap",
            )?;
            return Ok([0.0; 2]);
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
            && accel.iter().any(|accel| {
                next * accel >= -ACCEL_ROUNDING && next.abs() <= accel.abs() + ACCEL_ROUNDING
            });
        let change = (next - next.clamp(accel[0], accel[1])).abs();
        ensure(
            is_let_go || change <= limits.jerk * dt_s + ACCEL_ROUNDING,
            "P7: more than the greatest jerk",
        )?;
        let least = if is_capped { 0.0 } else { next };
        Ok([next.min(least), next.max(least)])
    }
}
