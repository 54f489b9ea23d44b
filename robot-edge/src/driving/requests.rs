//! Requests that are answered: emergency stop, reset, lease, settings.

use protocol::message::{Answer, EStop, LeaseRequest, Reset, Setting};
use protocol::signed::{Command, CommandHeader, Envelope};

use super::drive_loop::{DriveLoop, Sender};
use super::inbox::Reply;
use super::shared_drive_state::DriveEvent;
use super::status_message;
use measurement::time::Monotonic;
use teleop::{ArbiterInput, Caller, EStopId, LeaseVerb, Refusal, Role};

/// A refusal before the arbiter was asked, and where it goes.
type Refused = (Refusal, Option<Reply>);

impl DriveLoop {
    pub(super) fn estop(
        &mut self,
        sender: &Sender,
        bytes: &[u8],
        reply: Option<Reply>,
        now: Monotonic,
    ) -> Result<(), Refused> {
        let (_, EStop { press }, reply) = self.open(sender, bytes, reply)?;
        let report = self.state.report(&self.rules, now);
        if self.is_repeated_press(sender, press) {
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
        self.step(now, ArbiterInput::EStop(caller));
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
            ArbiterInput::Reset {
                caller,
                token: status_message::token(&stamp),
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
            LeaseRequest::HandOver(to) => match self.operators.find(&to) {
                Some((to, _)) => LeaseVerb::HandOver { to },
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
            ArbiterInput::Lease {
                caller,
                token: status_message::token(&stamp),
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
        stamp: &CommandHeader,
        setting: Setting,
        now: Monotonic,
    ) -> Result<(), protocol::message::Refusal> {
        use protocol::message::Refusal as No;
        if !sender.role.may_drive() {
            return Err(No::Role);
        }
        let age = self.state.tokens().age(status_message::token(stamp), now);
        let age = age.map_err(|fault| status_message::refusal(fault.into()))?;
        if age > self.rules.max_age() {
            return Err(No::TooOld);
        }
        match setting {
            Setting::BudgetKbps(kbps) if (1..=1_000_000).contains(&kbps) => {
                self.runtime_settings.budget_kbps = kbps;
            }
            Setting::BudgetKbps(_) => return Err(No::OutOfRange),
            Setting::CollisionMonitor(_) if self.monitor_runner.is_none() => {
                return Err(No::Unavailable);
            }
            Setting::CollisionMonitor(is_on) => {
                let lease = self.state.report(&self.rules, now).lease;
                // Whoever looks on does not take the guard of whoever drives away.
                let may = is_on || lease.is_held_by(sender.id) || sender.role == Role::Supervisor;
                if !may {
                    return Err(No::NotHolder);
                }
                if self.runtime_settings.collision_monitor != is_on {
                    let by = sender.id;
                    self.drive_event(DriveEvent::MonitorSwitched { is_on, by }, now);
                }
                self.runtime_settings.collision_monitor = is_on;
            }
            Setting::Recording(_) if !self.runtime_settings.can_record => {
                return Err(No::Unavailable);
            }
            Setting::Recording(is_on) => {
                if !self.drive_state.request_recording(is_on) {
                    return Err(No::Busy);
                }
                let by = sender.id;
                self.drive_event(DriveEvent::Recording { is_on, by }, now);
            }
        }
        self.drive_state.publish_settings(self.runtime_settings);
        Ok(())
    }

    /// What somebody wants, and when, once it is proven that they do; and the way for the answer, either way.
    fn open<T: Command>(
        &self,
        sender: &Sender,
        bytes: &[u8],
        reply: Option<Reply>,
    ) -> Result<(CommandHeader, T, Option<Reply>), Refused> {
        let opened = Envelope::parse(bytes).and_then(|envelope| {
            let command = envelope.open(self.route(sender), &sender.key)?;
            Ok((envelope.unverified_header(), command))
        });
        match opened {
            Ok((stamp, command)) => Ok((stamp, command, reply)),
            Err(error) => Err((status_message::refusal_for(&error), reply)),
        }
    }

    fn caller(&mut self, sender: &Sender, reply: Option<Reply>) -> Caller {
        Caller {
            operator: sender.id,
            role: sender.role,
            request: self.register_reply(reply),
        }
    }
}
