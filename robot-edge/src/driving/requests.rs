//! Requests that are answered: emergency stop, reset, lease, settings.

use protocol::message::{Answer, EStop, LeaseRequest, Reset, Setting};
use protocol::signed::{Command, Envelope, Stamp};

use super::board::Notice;
use super::driver::{Driver, Sender};
use super::inbox::Reply;
use super::words;
use crate::clock::Monotonic;
use crate::teleop::{Caller, EStopId, Event, LeaseVerb, Refusal, Role};

/// A refusal before the arbiter was asked, and where it goes.
type Refused = (Refusal, Option<Reply>);

impl Driver {
    pub(super) fn estop(
        &mut self,
        sender: &Sender,
        bytes: &[u8],
        reply: Option<Reply>,
        now: Monotonic,
    ) -> Result<(), Refused> {
        let (_, EStop { press }, reply) = self.open(sender, bytes, reply)?;
        let report = self.state.report(&self.rules, now);
        if self.is_repetition(sender, press) {
            // It hears what became of the stop, and does not make another one.
            if let Some(reply) = reply {
                match report.estop {
                    Some(estop) if estop.is_stored => reply(Answer::EStopped(estop.id.0)),
                    Some(_) => {} // not stored yet: it asks again
                    None => reply(Answer::Refused(protocol::message::Refusal::NoEStop)),
                }
            }
            return Ok(());
        }
        let caller = self.caller(sender, reply);
        self.step(now, Event::EStop(caller));
        Ok(())
    }

    pub(super) fn reset(
        &mut self,
        sender: &Sender,
        bytes: &[u8],
        reply: Option<Reply>,
        now: Monotonic,
    ) -> Result<(), Refused> {
        let (stamp, Reset { estop }, reply) = self.open(sender, bytes, reply)?;
        let caller = self.caller(sender, reply);
        self.step(
            now,
            Event::Reset {
                caller,
                token: words::token(&stamp),
                id: EStopId(estop),
            },
        );
        Ok(())
    }

    pub(super) fn lease(
        &mut self,
        sender: &Sender,
        bytes: &[u8],
        reply: Option<Reply>,
        now: Monotonic,
    ) -> Result<(), Refused> {
        let (stamp, request, reply) = self.open::<LeaseRequest>(sender, bytes, reply)?;
        let verb = match request {
            LeaseRequest::Request => LeaseVerb::Request,
            LeaseRequest::Release => LeaseVerb::Release,
            LeaseRequest::TakeOver => LeaseVerb::TakeOver,
            LeaseRequest::Consent(to) => match self.operators.find(&to) {
                Some((to, _)) => LeaseVerb::Consent { to },
                None => return Err((Refusal::NotWaiting, reply)),
            },
            LeaseRequest::Refuse(whom) => match self.operators.find(&whom) {
                Some((whom, _)) => LeaseVerb::Refuse { whom },
                None => return Err((Refusal::NotWaiting, reply)),
            },
        };
        let caller = self.caller(sender, reply);
        self.step(
            now,
            Event::Lease {
                caller,
                token: words::token(&stamp),
                verb,
            },
        );
        Ok(())
    }

    pub(super) fn set(
        &mut self,
        sender: &Sender,
        bytes: &[u8],
        reply: Option<Reply>,
        now: Monotonic,
    ) -> Result<(), Refused> {
        let (stamp, setting, reply) = self.open::<Setting>(sender, bytes, reply)?;
        let answer = match self.change(sender, &stamp, setting, now) {
            Ok(()) => Answer::Done,
            Err(refusal) => Answer::Refused(refusal),
        };
        if let Some(reply) = reply {
            reply(answer);
        }
        Ok(())
    }

    fn change(
        &mut self,
        sender: &Sender,
        stamp: &Stamp,
        setting: Setting,
        now: Monotonic,
    ) -> Result<(), protocol::message::Refusal> {
        use protocol::message::Refusal as No;
        if !sender.role.may_drive() {
            return Err(No::Role);
        }
        let age = self.state.tokens().age(words::token(stamp), now);
        let age = age.map_err(|fault| words::refusal(fault.into()))?;
        if age > self.rules.max_age() {
            return Err(No::TooOld);
        }
        match setting {
            Setting::BudgetKbps(kbps) if (1..=1_000_000).contains(&kbps) => {
                self.switches.budget_kbps = kbps;
            }
            Setting::BudgetKbps(_) => return Err(No::OutOfRange),
            Setting::Guard(_) if self.sight.is_none() => return Err(No::Unavailable),
            Setting::Guard(is_on) => {
                let lease = self.state.report(&self.rules, now).lease;
                // Whoever looks on does not take the guard of whoever drives away.
                let may = is_on || lease.is_held_by(sender.id) || sender.role == Role::Supervisor;
                if !may {
                    return Err(No::NotHolder);
                }
                if self.switches.guard != is_on {
                    let by = sender.id;
                    self.notice(Notice::Guard { is_on, by }, now);
                }
                self.switches.guard = is_on;
            }
            Setting::Recording(_) if !self.switches.can_record => return Err(No::Unavailable),
            Setting::Recording(is_on) => {
                if !self.board.wish_recording(is_on) {
                    return Err(No::Busy);
                }
                let by = sender.id;
                self.notice(Notice::Recording { is_on, by }, now);
            }
        }
        self.board.show_switches(self.switches);
        Ok(())
    }

    /// What somebody wants, and when, once it is proven that they do; and the way for the answer, either way.
    fn open<T: Command>(
        &self,
        sender: &Sender,
        bytes: &[u8],
        reply: Option<Reply>,
    ) -> Result<(Stamp, T, Option<Reply>), Refused> {
        let opened = Envelope::parse(bytes).and_then(|envelope| {
            let command = envelope.open(self.route(sender), &sender.key)?;
            Ok((envelope.claimed_stamp(), command))
        });
        match opened {
            Ok((stamp, command)) => Ok((stamp, command, reply)),
            Err(error) => Err((words::refused(&error), reply)),
        }
    }

    fn caller(&mut self, sender: &Sender, reply: Option<Reply>) -> Caller {
        Caller {
            operator: sender.id,
            role: sender.role,
            request: self.expect_reply(reply),
        }
    }
}
