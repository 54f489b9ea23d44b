//! The lease changes hands ("Lease"): always at standstill, always by a new epoch.

use super::{CommandStream, Mode, Step, StopReason};
use crate::action::{Answer, ArbiterEvent};
use crate::input::LeaseVerb;
use crate::lease::{GrantReason, LeaseEnd};
use crate::operator::{Caller, OperatorId, Role};
use crate::refusal::{Refusal, RequestKind};
use crate::token::AgeToken;
use measurement::time::Monotonic;

impl Step<'_> {
    pub(super) fn lease_request(&mut self, caller: Caller, token: AgeToken, verb: LeaseVerb) {
        let answer = self.change_lease(caller, token, verb);
        self.answer_or_refuse(RequestKind::Lease, caller, answer);
    }

    /// Answers a request; a refusal is counted and told.
    pub(super) fn answer_or_refuse(
        &mut self,
        request_kind: RequestKind,
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

    /// When the token of a request was issued, which must be lately, by somebody who may drive.
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
            Answer::Granted { epoch: lease.epoch }
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

    /// Ends the lease at once, where there is one: from now on nobody's commands are obeyed. The vehicle stops, then
    /// `next` is granted it, or else who waits for it.
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

    /// Grants the lease to who is next, if anybody is. Only where the output is zero.
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
