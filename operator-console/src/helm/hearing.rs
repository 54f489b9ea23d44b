//! What the robot says changes what this console may do.

use protocol::message::{Answer, LeaseRequest, StopReason, TeleopState, TeleopStatus};
use protocol::tile::BootId;
use robot_edge::clock::Monotonic;

use super::emergency::{Outcome, Pending};
use super::heard::{Asked, Heard, Note, RequestNumber};
use super::lease::{Lease, LeaseChange};
use super::neutral::goes_until;
use super::pace::Pace;
use super::{Helm, Wish};
use crate::teleop_input::Loss;

impl Helm {
    /// Something that the link brought.
    pub fn hear(&mut self, heard: Heard, now: Monotonic) {
        match heard {
            Heard::Status { boot, teleop } => {
                self.is_of(boot, now);
                match teleop {
                    Some(status) => self.hear_status(*status, now),
                    None => self.hear_of_no_driving(now),
                }
            }
            Heard::Answer {
                request,
                boot,
                answer,
            } => {
                if self.boot == Some(boot) {
                    self.hear_answer(request, answer, now);
                }
            }
            Heard::NoAnswer { request } => {
                if let Some(asked) = self.requests.take(request) {
                    self.warn(now, Note::NotAnswered(asked));
                }
            }
        }
    }

    /// The robot was restarted, or is heard for the first time: nothing that was so before is so now, but that an
    /// emergency stop is still to be told.
    pub(super) fn is_of(&mut self, boot: BootId, now: Monotonic) {
        if self.boot == Some(boot) {
            return;
        }
        let was_known = self.boot.replace(boot).is_some();
        self.epoch = 0;
        self.last_grant = None;
        self.newest = None;
        self.status = None;
        self.goes_until = None;
        self.estop_refused = None;
        if let Some(estop) = &self.estop {
            self.estop = Some(Pending::new(estop.body().press, None, estop.since));
        }
        if was_known {
            let unanswered: Vec<Asked> = self.requests.clear().collect();
            for asked in unanswered {
                self.warn(now, Note::NotAnswered(asked));
            }
            self.lose(Loss::Robot, now);
        }
        if self.lease.held().is_some() {
            self.lease = Lease::None;
            self.warn(now, Note::LeaseLost);
        }
        self.lose_lease(now);
    }

    /// It cannot be driven: who would be told to stop does not exist.
    fn hear_of_no_driving(&mut self, now: Monotonic) {
        self.status = None;
        self.goes_until = None;
        if self.estop.take().is_some() {
            self.warn(now, Note::NothingToStop);
        }
    }

    fn hear_status(&mut self, status: TeleopStatus, now: Monotonic) {
        self.epoch = self.epoch.max(status.lease.epoch);
        match self.lease.hear(&status.lease, &self.identity.operator, now) {
            Some(LeaseChange::Gained(epoch)) => self.gain_lease(epoch, Loss::Lease, now),
            Some(LeaseChange::Lost) => {
                self.lease = Lease::None;
                self.lose_with_lease();
                let note = self.why_lost(&status);
                self.warn(now, note);
            }
            None => {}
        }
        if let Some(number) = self
            .estop
            .as_ref()
            .and_then(|pending| pending.is_acknowledged_by(status.estop))
        {
            self.acknowledge_estop(number, now);
        }
        if status.estop.is_some() {
            self.forget_that_no_stop_is_in_force();
        }
        let before = self.status.as_ref().map(|status| status.state);
        match status.state {
            TeleopState::SafeBoot | TeleopState::EStop | TeleopState::Fault(_) => {
                self.lose(Loss::Stopped, now);
            }
            TeleopState::Idle | TeleopState::Held => {
                let moved = matches!(
                    before,
                    Some(TeleopState::Driving | TeleopState::Stopping(_))
                );
                // Who let go and pressed again meanwhile has not stopped against their will.
                if moved && status.last_stop != Some(StopReason::Released) {
                    self.lose(Loss::Stopped, now);
                }
            }
            TeleopState::Driving | TeleopState::Stopping(_) => {}
        }
        let is_mine = self.lease.held() == Some(status.lease.epoch);
        self.goes_until = goes_until(&status, self.stop_decel, now).filter(|_| is_mine);
        self.status = Some(status);
    }

    /// What was said of an earlier press is no longer so: another one is on its way, or in force.
    pub(super) fn forget_that_no_stop_is_in_force(&mut self) {
        if matches!(self.notice, Some((_, Note::EStopNotInForce))) {
            self.notice = None;
        }
    }

    /// Why a status tells that this console has no lease any more.
    fn why_lost(&self, status: &TeleopStatus) -> Note {
        let was_stopped = self.status.as_ref().is_some_and(|was| was.estop.is_some());
        let is_reset = was_stopped && status.estop.is_none() && status.lease.holder.is_none();
        if is_reset {
            Note::ResetEndedDriving
        } else {
            Note::LeaseLost
        }
    }

    fn hear_answer(&mut self, request: RequestNumber, answer: Answer, now: Monotonic) {
        if self
            .estop
            .as_ref()
            .is_some_and(|pending| pending.is_mine(request))
        {
            match Pending::answered(answer) {
                Some(Outcome::Stopped(number)) => self.acknowledge_estop(number, now),
                Some(Outcome::Over) => {
                    self.estop = None;
                    self.warn(now, Note::EStopNotInForce);
                }
                Some(Outcome::Refused(refusal)) => {
                    self.estop = None;
                    self.estop_refused = Some(refusal);
                    self.note(now, Note::EStopRefused(refusal));
                }
                None => {}
            }
            return;
        }
        let Some(asked) = self.requests.take(request) else {
            return;
        };
        match (&asked, answer) {
            (
                Asked::Lease(LeaseRequest::Request | LeaseRequest::TakeOver),
                Answer::Granted(epoch),
            ) => {
                self.note(now, Note::Answered(asked, answer));
                // Who had it already drove with what is down.
                let loss = if self.lease.held().is_some() {
                    Loss::Renewed
                } else {
                    Loss::Lease
                };
                self.gain_lease(epoch, loss, now);
                return;
            }
            (Asked::Lease(LeaseRequest::Request | LeaseRequest::TakeOver), Answer::Waiting) => {
                self.lose_lease(now);
                self.lease = Lease::Waiting {
                    after: self.epoch,
                    since: now,
                };
            }
            (Asked::Lease(LeaseRequest::Consent(_)), Answer::Done | Answer::Waiting) => {
                self.lose_lease(now);
            }
            (Asked::Lease(_) | Asked::Reset(_) | Asked::Set(_), _) => {}
        }
        let note = Note::Answered(asked, answer);
        let is_of_reset = matches!(self.notice, Some((_, Note::ResetEndedDriving)));
        if matches!(answer, Answer::Refused(_)) {
            self.warn(now, note);
        } else {
            // A status may overtake the answer to a reset: what it ended is still to be read.
            if !(is_of_reset && matches!(note, Note::Answered(Asked::Reset(_), _))) {
                self.notice = None;
            }
            self.note(now, note);
        }
    }

    /// A new grant: whatever was held down before counts for nothing, by this loss.
    fn gain_lease(&mut self, epoch: u64, loss: Loss, now: Monotonic) {
        self.notice = None;
        self.estop_refused = None;
        self.epoch = self.epoch.max(epoch);
        self.lease = Lease::Held(epoch);
        self.last_grant = Some(epoch);
        self.neutral_since = None;
        self.goes_until = None;
        self.sent = Wish::NEUTRAL;
        self.pace = Pace::new(now);
        // The loop had no reason to run until now.
        self.last_end = None;
        self.lose(loss, now);
        self.note(now, Note::LeaseGained(epoch));
    }

    pub(super) fn lose_lease(&mut self, now: Monotonic) {
        self.end_lease(Note::LeaseLost, now);
    }

    pub(super) fn end_lease(&mut self, why: Note, now: Monotonic) {
        let was_held = self.lease.held().is_some();
        self.lease = Lease::None;
        self.lose_with_lease();
        if was_held {
            self.note(now, why);
        }
    }

    /// Keys drive no more: the note that the lease is over says so.
    fn lose_with_lease(&mut self) {
        self.input.lose(Loss::Lease);
        self.neutral_since = None;
    }

    fn acknowledge_estop(&mut self, number: u64, now: Monotonic) {
        self.estop = None;
        self.estop_refused = None;
        self.forget_that_no_stop_is_in_force();
        self.note(now, Note::EStopAcknowledged(number));
    }
}
