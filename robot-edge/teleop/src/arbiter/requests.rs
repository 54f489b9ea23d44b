//! Requests: the lease (granted only at standstill, each grant with a new epoch), emergency stops, faults and resets.

use crate::arbiter::{CommandStream, Mode, Step};
use crate::interface::{Action, ArbiterEvent, LeaseVerb};
use crate::lease::{
    Caller, EStop, EStopId, EStopSource, GrantReason, Lease, OperatorId, Role, StoredEStop,
};
use crate::token::AgeToken;
use measurement::time::Monotonic;
use protocol::keys::OperatorTopic;
use protocol::message::{Answer, FaultReason, GoalEnd, LeaseEnd, Refusal, StopReason};

impl Step<'_> {
    pub(super) fn lease_request(&mut self, caller: Caller, token: AgeToken, verb: LeaseVerb) {
        let answer = self.change_lease(caller, token, verb);
        self.answer_or_refuse(OperatorTopic::Lease, caller, answer);
    }

    /// Answers a request; a refusal is counted and reported.
    pub(super) fn answer_or_refuse(
        &mut self,
        request_kind: OperatorTopic,
        caller: Caller,
        answer: Result<Answer, Refusal>,
    ) {
        if let Err(refusal) = answer {
            self.state.counters.refuse(refusal);
            self.notify(ArbiterEvent::Refused {
                request_kind,
                caller,
                refusal,
            });
        }
        self.answer(caller.request, answer.unwrap_or_else(Answer::Refused));
    }

    /// Checks role and token of a request; returns when the token was issued.
    pub(super) fn check_token(&self, role: Role, token: AgeToken) -> Result<Monotonic, Refusal> {
        if !role.may_drive() {
            return Err(Refusal::Role);
        }
        let issued = self.state.tokens.issued(token, self.now)?;
        if self.now.since(issued) > self.rules.max_age {
            return Err(Refusal::TooOld);
        }
        Ok(issued)
    }

    fn change_lease(
        &mut self,
        caller: Caller,
        token: AgeToken,
        verb: LeaseVerb,
    ) -> Result<Answer, Refusal> {
        self.check_token(caller.role, token)?;
        match self.state.mode {
            Mode::SafeBoot | Mode::Fault(_) => return Err(Refusal::NotReady),
            Mode::Idle | Mode::Held | Mode::Driving | Mode::Stopping { .. } | Mode::EStop => {}
        }
        let operator = caller.operator;
        let is_holder = self.state.lease.is_held_by(operator);
        match verb {
            LeaseVerb::Request => self.request_lease(operator),
            LeaseVerb::TakeOver if caller.role != Role::Supervisor => Err(Refusal::Role),
            LeaseVerb::TakeOver => {
                self.end_lease(LeaseEnd::TakenOver, Some((operator, GrantReason::TakeOver)));
                Ok(self.granted_or_waiting(operator))
            }
            LeaseVerb::Release if !is_holder => {
                let was_wanted = self.state.lease.withdraw(operator);
                was_wanted.then_some(Answer::Done).ok_or(Refusal::NotHolder)
            }
            LeaseVerb::HandOver { .. } | LeaseVerb::Refuse { .. } if !is_holder => {
                Err(Refusal::NotHolder)
            }
            LeaseVerb::HandOver { to } => {
                let waiting = self.state.lease.waiting;
                if waiting.is_none_or(|waiting| waiting.operator != to) {
                    return Err(Refusal::NotWaiting);
                }
                self.end_lease(LeaseEnd::HandedOver, Some((to, GrantReason::HandOver)));
                Ok(Answer::Done)
            }
            LeaseVerb::Refuse { whom } => {
                let waiting = &mut self.state.lease.waiting;
                if waiting.is_none_or(|waiting| waiting.operator != whom) {
                    return Err(Refusal::NotWaiting);
                }
                *waiting = None;
                Ok(Answer::Done)
            }
            LeaseVerb::Release => {
                self.end_lease(LeaseEnd::Released, None);
                Ok(Answer::Done)
            }
        }
    }

    fn request_lease(&mut self, operator: OperatorId) -> Result<Answer, Refusal> {
        let lease = &mut self.state.lease;
        if lease.is_held_by(operator) {
            self.end_lease(LeaseEnd::Renewed, Some((operator, GrantReason::Request)));
            return Ok(self.granted_or_waiting(operator));
        }
        if lease.holder.is_some() {
            if !lease.wait(operator, self.now) {
                return Err(Refusal::Busy);
            }
            self.notify(ArbiterEvent::LeaseRequested { by: operator });
            return Ok(Answer::Waiting);
        }
        if lease.next.is_some_and(|(next, _)| next != operator) {
            return Err(Refusal::Busy);
        }
        lease.next.get_or_insert((operator, GrantReason::Request));
        match self.state.mode {
            Mode::Idle | Mode::Held | Mode::EStop => self.grant_next(),
            Mode::SafeBoot | Mode::Driving | Mode::Stopping { .. } | Mode::Fault(_) => {}
        }
        Ok(self.granted_or_waiting(operator))
    }

    fn granted_or_waiting(&self, operator: OperatorId) -> Answer {
        let lease = &self.state.lease;
        if lease.is_held_by(operator) {
            Answer::Granted(lease.epoch)
        } else {
            Answer::Waiting
        }
    }

    pub(super) fn revoke(&mut self, operator: OperatorId) {
        let lease = &mut self.state.lease;
        lease.waiting = lease.waiting.filter(|waiting| waiting.operator != operator);
        lease.next = lease.next.filter(|(next, _)| *next != operator);
        if lease.is_held_by(operator) {
            self.end_lease(LeaseEnd::Revoked, None);
        }
    }

    /// Ends the lease at once: no command is obeyed from now on. After the stop, `next` or the waiting operator gets
    /// it.
    pub(super) fn end_lease(&mut self, why: LeaseEnd, next: Option<(OperatorId, GrantReason)>) {
        if let Some(holder) = self.state.lease.holder.take() {
            self.notify(ArbiterEvent::LeaseEnded {
                operator: holder.operator,
                why,
            });
        }
        self.state.stream = CommandStream::default();
        let waiting = self.state.lease.waiting;
        self.state.lease.next =
            next.or(waiting.map(|waiting| (waiting.operator, GrantReason::HandOver)));
        match self.state.mode {
            Mode::Driving => self.begin_stop(StopReason::LeaseEnded(why)),
            Mode::Stopping { since, .. } => {
                let reason = StopReason::LeaseEnded(why);
                self.state.mode = Mode::Stopping { reason, since };
            }
            Mode::Held => {
                self.state.mode = Mode::Idle;
                self.grant_next();
            }
            Mode::Idle | Mode::EStop => self.grant_next(),
            Mode::SafeBoot | Mode::Fault(_) => self.state.lease.next = None,
        }
    }

    /// Grants the lease to the next holder, if there is one. Only called while the output is zero.
    pub(super) fn grant_next(&mut self) {
        let Some((operator, how)) = self.state.lease.next else {
            return;
        };
        self.state.lease.grant(operator, self.now);
        self.state.stream = CommandStream::default();
        match self.state.mode {
            Mode::Idle | Mode::Held => self.state.mode = Mode::Held,
            Mode::SafeBoot
            | Mode::Driving
            | Mode::Stopping { .. }
            | Mode::EStop
            | Mode::Fault(_) => {}
        }
        self.notify(ArbiterEvent::LeaseGranted {
            to: operator,
            epoch: self.state.lease.epoch,
            how,
        });
    }
}

impl Step<'_> {
    /// Any operator may stop the vehicle: without the lease, and with a token of any age.
    pub(super) fn estop_request(&mut self, caller: Caller) {
        if !caller.role.may_drive() {
            self.answer_or_refuse(OperatorTopic::EStop, caller, Err(Refusal::Role));
            return;
        }
        self.emergency_stop(Some(EStopSource::Operator(caller.operator)));
        if let Some(estop) = self.state.estop
            && estop.is_stored
        {
            self.answer(caller.request, Answer::EStopped(estop.id.0));
        }
    }

    pub(super) fn local_estop(&mut self) {
        self.emergency_stop(Some(EStopSource::Local));
    }

    /// Zero at once. If an emergency stop is already active, a reset must be younger than this request too.
    pub(super) fn emergency_stop(&mut self, by: Option<EStopSource>) {
        self.halt(GoalEnd::EStop);
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
            // Latched, but the self-test is not skipped and a fault is kept.
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
        self.answer_or_refuse(OperatorTopic::Reset, caller, answer);
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

    /// A reset at the vehicle ends the emergency stop or the fault. After a fault the self-test runs again.
    pub(super) fn local_reset(&mut self) {
        match self.state.mode {
            Mode::EStop => self.release_estop(None),
            Mode::Fault(_) => self.state.mode = Mode::SafeBoot,
            Mode::SafeBoot | Mode::Idle | Mode::Held | Mode::Driving | Mode::Stopping { .. } => {}
        }
    }

    /// To [`Mode::Idle`], without a lease: the next driver must request it, release all keys and press again.
    fn release_estop(&mut self, by: Option<Caller>) {
        if let Some(EStop { id, .. }) = self.state.estop.take() {
            self.actions.push(Action::ClearEStop(id));
            self.notify(ArbiterEvent::Reset { id, by });
        }
        self.state.mode = Mode::Idle;
        self.state.lease.waiting = None;
        self.end_lease(LeaseEnd::Reset, None);
    }

    /// The self-test has ended. A test that fails in a later mode leads to a fault as well.
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

    /// Restores the emergency stop of the previous run, unless a newer one is in force.
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
        self.halt(GoalEnd::Motors);
        self.state.mode = Mode::Fault(reason);
        self.state.lease = Lease {
            next: None,
            waiting: None,
            ..self.state.lease
        };
        self.end_lease(LeaseEnd::Fault, None);
    }
}
