//! What must hold after every step, whatever the event: an independent reading of the design.
//!
//! The monitor believes the arbiter in nothing but the tokens (tested by themselves) and whom it says it grants the
//! lease to; what follows from that it works out anew.

mod actions;
mod ticks;

use std::time::Duration;

use super::licence::Licence;
use super::millis;
use crate::action::Actions;
use crate::arbiter::{ArbiterState, Mode};
use crate::command_stream::DriveCommand;
use crate::config::Rules;
use crate::input::CollisionMonitorOutput;
use crate::input::{ArbiterInput, LeaseVerb};
use crate::lease::{EStopId, StoredEStop};
use crate::lease::{OperatorId, Role};
use crate::motion::Velocity;
use crate::token::AgeToken;
use measurement::time::Monotonic;

const MONITOR_TIMEOUT: Duration = millis(300);

/// A property that does not hold, and where.
pub(super) type Violation = &'static str;

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

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Monitor {
    pub(super) epoch: u64,
    pub(super) holder: Option<OperatorId>,
    pub(super) renewed: Monotonic,
    pub(super) last_seq: Option<u64>,
    pub(super) in_force: Option<InForce>,
    pub(super) licence: Licence,
    /// Operators that asked for the lease, a bit each.
    pub(super) requested_at: u32,
    pub(super) estop: Option<Latched>,
    pub(super) is_booted: bool,
    pub(super) has_fault: bool,
    pub(super) collision_monitor: Option<(CollisionMonitorOutput, Monotonic)>,
    pub(super) last_tick: Option<Monotonic>,
    /// Accelerations of the last tick that was free of stops.
    pub(super) accel: Velocity,
}

impl Monitor {
    pub(super) fn new() -> Self {
        Self {
            epoch: 0,
            holder: None,
            renewed: Monotonic::default(),
            last_seq: None,
            in_force: None,
            licence: Licence::default(),
            requested_at: 0,
            estop: None,
            is_booted: false,
            has_fault: false,
            collision_monitor: None,
            last_tick: None,
            accel: Velocity::ZERO,
        }
    }

    /// Looks on as `input` turns `before` into `after`.
    pub(super) fn observe(
        &mut self,
        rules: &Rules,
        before: &ArbiterState,
        now: Monotonic,
        input: ArbiterInput,
        after: &ArbiterState,
        actions: &Actions,
    ) -> Result<(), Violation> {
        let was = before.report(rules, now).applied;
        let is = actions.output;
        ensure(is.is_finite(), "P8: the output is not finite")?;
        ensure(!actions.is_full(), "more actions than there is room for")?;
        ensure(
            is == after.report(rules, now).applied,
            "the report tells another output",
        )?;
        self.observe_input(rules, before, now, input, after)?;
        self.observe_actions(rules, now, actions)?;

        let is_zero = is == Velocity::ZERO;
        if input == ArbiterInput::Tick {
            self.observe_tick(rules, before, now, was, after, is)?;
        } else {
            ensure(
                is_zero || is == was,
                "an event other than a tick moves the vehicle",
            )?;
            if after.mode() != Mode::Driving && is_zero {
                self.accel = Velocity::ZERO;
            }
        }
        let must_stand = self.estop.is_some() || self.has_fault || !self.is_booted;
        ensure(
            is_zero || !must_stand,
            "P5: it moves in spite of an emergency stop, a fault or the boot",
        )?;
        match after.mode() {
            Mode::Driving | Mode::Stopping { .. } => {}
            Mode::SafeBoot | Mode::Idle | Mode::Held | Mode::EStop | Mode::Fault(_) => {
                ensure(is_zero, "it moves in a state whose output is zero")?;
            }
        }
        if is_zero {
            self.licence.stand();
        }
        Ok(())
    }

    /// P3, P4: exactly those commands are obeyed that are the holder's, of this grant, young and in sequence.
    fn is_to_be_obeyed(
        &self,
        rules: &Rules,
        before: &ArbiterState,
        now: Monotonic,
        role: Role,
        command: &DriveCommand,
    ) -> bool {
        role != Role::Observer
            && self.holder == Some(command.operator)
            && self.epoch == command.epoch
            && self.last_seq.is_none_or(|last| command.seq > last)
            && is_young(rules, before, now, command.token)
    }

    fn observe_input(
        &mut self,
        rules: &Rules,
        before: &ArbiterState,
        now: Monotonic,
        input: ArbiterInput,
        after: &ArbiterState,
    ) -> Result<(), Violation> {
        let accepted = |state: &ArbiterState| state.report(rules, now).counters.accepted;
        let mut is_obeyed = false;
        match input {
            ArbiterInput::Command { role, command } => {
                let requested = command.requested;
                if command.estop && role != Role::Observer {
                    self.emergency_stop(now, after)?;
                } else if self.is_to_be_obeyed(rules, before, now, role, &command) {
                    self.last_seq = Some(command.seq);
                    if requested.is_finite() {
                        is_obeyed = true;
                        self.obey(rules, before, now, &command);
                    } else {
                        self.licence.lock();
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
                let may = is_young(rules, before, now, token) && caller.role != Role::Observer;
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
                    && is_young(rules, before, now, token)
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
            ArbiterInput::Tick
            | ArbiterInput::Token { .. }
            | ArbiterInput::Rejected(_)
            | ArbiterInput::EStop(_)
            | ArbiterInput::Measured(_) => {}
        }
        let more = accepted(after) - accepted(before);
        ensure(
            more == u64::from(is_obeyed),
            "P3, P4: another command is obeyed than should be",
        )
    }

    fn obey(
        &mut self,
        rules: &Rules,
        before: &ArbiterState,
        now: Monotonic,
        command: &DriveCommand,
    ) {
        let is_pressed = !command.requested.is_neutral();
        if let Ok(issued) = before.tokens().issued(command.token, now) {
            self.in_force = Some(InForce { issued, is_pressed });
        }
        self.renewed = now;
        if is_pressed {
            let moves = before.motion.velocity() != Velocity::ZERO;
            let may_recover = moves && self.monitor_is_available(now);
            self.licence.press(now, rules.neutral, may_recover);
        } else {
            self.licence.neutral(now);
        }
    }

    fn emergency_stop(&mut self, now: Monotonic, after: &ArbiterState) -> Result<(), Violation> {
        self.licence.lock();
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
            self.licence.lock();
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
        self.licence.lock();
    }

    fn forget_commands(&mut self) {
        self.last_seq = None;
        self.in_force = None;
        self.licence.lock();
    }

    fn monitor_is_available(&self, now: Monotonic) -> bool {
        self.collision_monitor.is_some_and(|(output, received_at)| {
            output != CollisionMonitorOutput::Stale && now.since(received_at) <= MONITOR_TIMEOUT
        })
    }
}

fn is_young(rules: &Rules, state: &ArbiterState, now: Monotonic, token: AgeToken) -> bool {
    state
        .tokens()
        .age(token, now)
        .is_ok_and(|age| age <= rules.max_age)
}

fn bit(operator: OperatorId) -> u32 {
    1 << operator.0.min(31)
}

fn ensure(holds: bool, otherwise: Violation) -> Result<(), Violation> {
    if holds { Ok(()) } else { Err(otherwise) }
}
