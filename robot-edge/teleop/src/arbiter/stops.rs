//! The vehicle is stopped for good, or let go again: emergency stop, fault, self-test, resets.

use super::{FaultReason, Mode, Step};
use crate::action::{Action, Answer, ArbiterEvent};
use crate::emergency_stop::{EStop, EStopId, EStopSource, StoredEStop};
use crate::lease::{Lease, LeaseEnd};
use crate::operator::{Caller, Role};
use crate::refusal::{Refusal, RequestKind};
use crate::token::AgeToken;

impl Step<'_> {
    /// "Any operator may e-stop": without the lease, and with a token of any age.
    pub(super) fn estop_request(&mut self, caller: Caller) {
        if !caller.role.may_drive() {
            self.answer_or_refuse(RequestKind::EStop, caller, Err(Refusal::Role));
            return;
        }
        self.emergency_stop(Some(EStopSource::Operator(caller.operator)));
        if let Some(estop) = self.state.estop
            && estop.is_stored
        {
            self.answer(caller.request, Answer::EStopped(estop.id));
        }
    }

    pub(super) fn local_estop(&mut self) {
        self.emergency_stop(Some(EStopSource::Local));
    }

    /// Zero at once. Where an emergency stop is active already, whoever resets it must know of this one too.
    pub(super) fn emergency_stop(&mut self, by: Option<EStopSource>) {
        self.halt();
        if let Some(estop) = &mut self.state.estop {
            estop.last_requested = self.now;
            return;
        }
        self.latch(self.next_estop(), false, by);
        match self.state.mode {
            Mode::Idle | Mode::Held | Mode::Driving | Mode::Stopping { .. } => {
                self.state.mode = Mode::EStop;
                self.grant_next();
            }
            // Latched, but what comes first stays first: the self-test is not skipped, nor a fault forgotten.
            Mode::SafeBoot | Mode::EStop | Mode::Fault(_) => {}
        }
    }

    fn latch(&mut self, id: EStopId, is_stored: bool, by: Option<EStopSource>) {
        self.state.last_estop = id;
        self.state.estop = Some(EStop {
            id,
            is_stored,
            last_requested: self.now,
            store_requested: self.now,
        });
        if !is_stored {
            self.actions.push(Action::StoreEStop(id));
        }
        self.notify(ArbiterEvent::EStopped { id, by });
    }

    pub(super) fn estop_stored(&mut self, id: EStopId) {
        if let Some(estop) = &mut self.state.estop
            && estop.id == id
            && !estop.is_stored
        {
            estop.is_stored = true;
            self.actions.push(Action::AcknowledgeEStop(id));
        }
    }

    pub(super) fn reset_request(&mut self, caller: Caller, token: AgeToken, id: EStopId) {
        let answer = self.check_reset(caller, token, id).map(|()| {
            self.release_estop(Some(caller));
            Answer::Done
        });
        self.answer_or_refuse(RequestKind::Reset, caller, answer);
    }

    fn check_reset(&self, caller: Caller, token: AgeToken, id: EStopId) -> Result<(), Refusal> {
        let issued = self.check_token(caller.role, token)?;
        let is_holder = self.state.lease.is_held_by(caller.operator);
        if !is_holder && caller.role != Role::Supervisor {
            return Err(Refusal::NotHolder);
        }
        let estop = self.state.estop.ok_or(Refusal::NoEStop)?;
        if estop.id != id {
            return Err(Refusal::OtherEStop);
        }
        if issued <= estop.last_requested {
            return Err(Refusal::EStopSince);
        }
        if !estop.is_stored {
            return Err(Refusal::EStopNotStored);
        }
        match self.state.mode {
            Mode::EStop => Ok(()),
            Mode::SafeBoot
            | Mode::Idle
            | Mode::Held
            | Mode::Driving
            | Mode::Stopping { .. }
            | Mode::Fault(_) => Err(Refusal::NotReady),
        }
    }

    /// Somebody at the vehicle ends the emergency stop, or the fault, after which the self-test must pass anew.
    pub(super) fn local_reset(&mut self) {
        match self.state.mode {
            Mode::EStop => self.release_estop(None),
            Mode::Fault(_) => self.state.mode = Mode::SafeBoot,
            Mode::SafeBoot | Mode::Idle | Mode::Held | Mode::Driving | Mode::Stopping { .. } => {}
        }
    }

    /// To [`Mode::Idle`], without a lease: whoever drives next asks for it, lets go and presses.
    fn release_estop(&mut self, by: Option<Caller>) {
        if let Some(EStop { id, .. }) = self.state.estop.take() {
            self.actions.push(Action::ClearEStop(id));
            self.notify(ArbiterEvent::Reset { id, by });
        }
        self.state.mode = Mode::Idle;
        self.state.lease.waiting = None;
        self.end_lease(LeaseEnd::Reset, None);
    }

    /// The self-test ends: [`Mode::SafeBoot`] is left. A test that fails later ends in a fault as well.
    pub(super) fn finish_self_test(&mut self, has_passed: bool, stored: StoredEStop) {
        match self.state.mode {
            Mode::SafeBoot => {
                self.restore_estop(stored);
                self.state.mode = if self.state.estop.is_some() {
                    Mode::EStop
                } else {
                    Mode::Idle
                };
            }
            Mode::Idle
            | Mode::Held
            | Mode::Driving
            | Mode::Stopping { .. }
            | Mode::EStop
            | Mode::Fault(_) => {}
        }
        if !has_passed {
            self.fail(FaultReason::SelfTest);
        }
    }

    /// What the run before left on disk, unless something newer is in force.
    fn restore_estop(&mut self, stored: StoredEStop) {
        if self.state.estop.is_some() {
            return;
        }
        match stored {
            StoredEStop::None => {}
            StoredEStop::Latched(id) => self.latch(id, true, None),
            StoredEStop::Unreadable => self.latch(self.next_estop(), false, None),
        }
    }

    fn next_estop(&self) -> EStopId {
        EStopId(self.state.last_estop.0.saturating_add(1))
    }

    pub(super) fn fail(&mut self, reason: FaultReason) {
        self.halt();
        self.state.mode = Mode::Fault(reason);
        self.state.lease = Lease {
            next: None,
            waiting: None,
            ..self.state.lease
        };
        self.end_lease(LeaseEnd::Fault, None);
    }
}
