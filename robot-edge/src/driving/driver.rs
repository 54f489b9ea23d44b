//! The loop's mind: what arrives and when a round ends, turned into events of the arbiter, and its actions done.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use protocol::keys::{OperatorId as OperatorName, OperatorTopic, RobotId};
use protocol::message::{Answer, Drive};
use protocol::signed::{Envelope, Route};
use protocol::tile::BootId;

use super::board::{Board, GuardAgain, Notice};
use super::drive_log::DriveLog;
use super::inbox::{Incoming, Reply};
use super::keeper::Keeper;
use super::local::LocalWish;
use super::lookout::Sight;
use super::motors::{MotorReadiness, Motors};
use super::operators::{MAX_OPERATORS, Operators};
use super::presses::Presses;
use super::rate::Rate;
use super::witness::Witness;
use super::words::{self, GuardDetail, Switches};
use crate::actuators::Fault;
use crate::clock::Monotonic;
use crate::teleop::arbiter::StopReason;
use crate::teleop::emergency_stop::StoredEStop;
use crate::teleop::{
    Action, ArbiterState, DriveCommand, Event, GuardVerdict, Happening, Mode, OperatorId, Refusal,
    RequestId, Role, Rules, Velocity, step,
};

/// Tokens are issued this often, with the rounds.
const TOKEN_PERIOD: Duration = Duration::from_millis(20);
/// Answers that are waited for at most.
const MAX_REPLIES: usize = 64;

/// Who drives what.
pub(super) struct Driver {
    pub(super) robot: RobotId,
    pub(super) rules: Rules,
    pub(super) state: ArbiterState,
    pub(super) operators: Operators,
    pub(super) motors: Motors,
    pub(super) board: Arc<Board>,
    pub(super) switches: Switches,
    pub(super) presses: Presses,
    pub(super) sight: Option<Sight>,
    pub(super) keeper: Option<Keeper>,
    pub(super) log: Option<DriveLog>,
    pub(super) witness: Witness,
    rates: [Rate; MAX_OPERATORS],
    motor_readiness: MotorReadiness,
    /// What the run before left; until the self-test, which waits for the motors.
    pub(super) untested: Option<StoredEStop>,
    last_token: Option<Monotonic>,
    notices: VecDeque<Notice>,
    /// Answers that wait, by request; those of emergency stops until these are stored.
    replies: VecDeque<(RequestId, Reply)>,
    next_request: u64,
    told_fault: Option<Fault>,
}

/// Who sent a message, as the key it came with says: not yet proven.
#[derive(Clone, Debug)]
pub(super) struct Sender {
    pub(super) id: OperatorId,
    pub(super) role: Role,
    pub(super) name: OperatorName,
    pub(super) key: protocol::signed::PublicKey,
}

impl Driver {
    pub(super) fn new(
        (robot, boot): (RobotId, BootId),
        rules: Rules,
        operators: Operators,
        motors: Motors,
        board: Arc<Board>,
        now: Monotonic,
    ) -> Self {
        // Those of a list are known before any of them has said a word.
        board.show_names(operators.names());
        Self {
            robot,
            rules,
            state: ArbiterState::new(u128::from_be_bytes(boot.0)),
            operators,
            motors,
            board,
            switches: Switches::default(),
            presses: Presses::new(),
            sight: None,
            keeper: None,
            log: None,
            witness: Witness::default(),
            rates: [Rate::new(now); MAX_OPERATORS],
            motor_readiness: MotorReadiness::Starting,
            untested: None,
            last_token: None,
            notices: VecDeque::new(),
            replies: VecDeque::new(),
            next_request: 0,
            told_fault: None,
        }
    }

    /// Takes one message of an operator.
    ///
    /// In the order of "Security": size, rate, token, epoch, sequence, signature. A flood buys no signature checks.
    pub(super) fn receive(&mut self, incoming: Incoming, now: Monotonic) {
        let (operator, wish) = (incoming.operator.clone(), incoming.wish());
        let refused = match self.sender(&incoming, now) {
            Ok(sender) => self.serve(&sender, incoming, now),
            Err(refusal) => Err((refusal, incoming.reply)),
        };
        if let Err((refusal, reply)) = refused {
            self.witness.refused(&operator, wish, refusal, now);
            self.step(now, Event::Rejected(refusal));
            if let Some(reply) = reply {
                reply(Answer::Refused(words::refusal(refusal)));
            }
        }
    }

    /// Messages for which the inbox had no room.
    pub(super) fn overflown(&mut self, count: u64) {
        if count > 0 {
            self.switches.overflown = self.switches.overflown.saturating_add(count);
            self.board.show_switches(self.switches);
        }
    }

    /// Ends a round: tells the motors what to do now.
    pub(super) fn tick(&mut self, now: Monotonic) {
        self.take_newer_list(now);
        if let Some(id) = self.keeper.as_mut().and_then(Keeper::take_stored) {
            self.step(now, Event::EStopStored(id));
        }
        self.test_motors(now);
        let verdict = self.guard_verdict(now);
        self.step(now, Event::Guard(verdict));
        if self
            .last_token
            .is_none_or(|last| now.since(last) >= TOKEN_PERIOD)
            && let Ok(nonce) = getrandom::u64()
        {
            // Without randomness there are no tokens, and so nobody drives.
            self.last_token = Some(now);
            self.step(now, Event::Token { nonce });
        }
        self.step(now, Event::Tick);
        match self.state.mode() {
            Mode::SafeBoot | Mode::Idle => {}
            Mode::Held | Mode::Driving | Mode::Stopping { .. } | Mode::EStop | Mode::Fault(_) => {
                self.motors.take_over();
            }
        }
        let report = self.state.report(&self.rules, now);
        if let Some(log) = &mut self.log {
            log.add(now, &report);
        }
        let detail = self
            .sight
            .as_ref()
            .map_or_else(GuardDetail::default, |sight| GuardDetail {
                barrier: sight.barrier(),
                side_ages: sight.side_ages(),
            });
        self.board.show_report(&report, detail);
        // Again, where somebody was reading when they changed.
        self.board.show_switches(self.switches);
        self.board.tell(&mut self.notices);
    }

    /// The self-test, once the motors are found; later, whether they still obey.
    fn test_motors(&mut self, now: Monotonic) {
        let is_fault = match self.motor_readiness {
            MotorReadiness::Starting => return,
            MotorReadiness::Ready => false,
            MotorReadiness::Absent => true,
            MotorReadiness::Faulty(fault) => {
                if self.told_fault != Some(fault) {
                    self.told_fault = Some(fault);
                    tracing::error!(%fault, "motors");
                    self.notice(Notice::Motors(fault), now);
                }
                true
            }
        };
        if let Some(stored) = self.untested.take() {
            let has_passed = !is_fault;
            self.step(now, Event::SelfTest { has_passed, stored });
        } else if is_fault {
            self.step(now, Event::ActuatorFault);
        }
    }

    /// Somebody at the vehicle says so.
    pub(super) fn local(&mut self, wish: LocalWish, now: Monotonic) {
        match wish {
            LocalWish::Stop => self.step(now, Event::LocalEStop),
            LocalWish::Reset => {
                self.step(now, Event::LocalReset);
                // Out of a fault it goes through the self-test again.
                if self.state.mode() == Mode::SafeBoot && self.untested.is_none() {
                    self.untested = Some(StoredEStop::None);
                }
            }
        }
    }

    fn guard_verdict(&mut self, now: Monotonic) -> GuardVerdict {
        let report = self.state.report(&self.rules, now);
        match &mut self.sight {
            // Also where it is switched off: what it remembers must be whole when it is switched on again.
            Some(sight) => {
                let verdict = sight.verdict((report.applied, report.requested), now);
                if self.switches.guard {
                    verdict
                } else {
                    GuardVerdict::Off
                }
            }
            None => GuardVerdict::Off,
        }
    }

    /// Nobody drives any more.
    pub(super) fn stop(&mut self) {
        let _whatever_it_says = self.motors.apply(Velocity::ZERO, Monotonic::now());
    }

    /// One event of the arbiter, and what follows from it.
    pub(super) fn step(&mut self, now: Monotonic, event: Event) {
        let (state, actions) = step(&self.rules, self.state, now, event);
        self.state = state;
        let motors = self.motors.apply(actions.output, now);
        if let Some(measured) = motors.measured {
            self.state = step(&self.rules, self.state, now, Event::Measured(measured)).0;
        }
        self.motor_readiness = motors.readiness;
        for action in actions.iter() {
            match action {
                Action::Publish(token) => self.board.show_token(token),
                Action::Answer { request, answer } => self.reply(request, words::answer(answer)),
                Action::AcknowledgeEStop(id) => {
                    for (_, reply) in self.replies.drain(..) {
                        reply(Answer::EStopped(id.0));
                    }
                }
                Action::StoreEStop(id) => match &mut self.keeper {
                    Some(keeper) => keeper.store(id),
                    None => self.step(now, Event::EStopStored(id)),
                },
                Action::ClearEStop(_) => {
                    if let Some(keeper) = &mut self.keeper {
                        keeper.clear();
                    }
                }
                Action::Tell(happening) => self.tell(happening, now),
            }
        }
    }

    fn tell(&mut self, happening: Happening, now: Monotonic) {
        if let Happening::Mode {
            to: Mode::Stopping { reason, .. },
            ..
        } = happening
        {
            self.switches.last_stop = Some(reason);
            self.board.show_switches(self.switches);
            if reason == StopReason::GuardStale {
                let lack = self.sight.as_ref().and_then(Sight::lack);
                self.notice(Notice::Unguarded { lack }, now);
                return;
            }
        }
        self.notice(Notice::Arbiter(happening), now);
        if let Some(why) = guard_again(&happening) {
            self.switch_guard_on(why, now);
        }
    }

    /// Off is for one driver and one drive. A stop by age alone ends neither: the holder keeps the lease, and the guard
    /// as they left it.
    fn switch_guard_on(&mut self, why: GuardAgain, now: Monotonic) {
        if self.sight.is_some() && !self.switches.guard {
            self.switches.guard = true;
            self.board.show_switches(self.switches);
            self.notice(Notice::GuardAgain(why), now);
        }
    }

    /// Something that people and the audit log should know.
    pub(super) fn notice(&mut self, notice: Notice, now: Monotonic) {
        self.witness.saw(&notice, &self.operators, now);
        self.notices.push_back(notice);
    }

    /// Keeps the way for an answer; the oldest goes where there are too many.
    pub(super) fn expect_reply(&mut self, reply: Option<Reply>) -> RequestId {
        self.next_request += 1;
        let request = RequestId(self.next_request);
        if let Some(reply) = reply {
            if self.replies.len() >= MAX_REPLIES {
                self.replies.pop_front();
            }
            self.replies.push_back((request, reply));
        }
        request
    }

    fn reply(&mut self, request: RequestId, answer: Answer) {
        let at = self.replies.iter().position(|(of, _)| *of == request);
        if let Some((_, reply)) = at.and_then(|at| self.replies.remove(at)) {
            reply(answer);
        }
    }

    fn sender(&mut self, incoming: &Incoming, now: Monotonic) -> Result<Sender, Refusal> {
        if incoming.bytes.len() > protocol::signed::MAX_SIGNED_BYTES {
            return Err(Refusal::Malformed);
        }
        let known = self.operators.names().count();
        let found = self.operators.find(&incoming.operator);
        // Whom the vehicle does not know cannot have signed anything.
        let (id, operator) = found.ok_or(Refusal::Signature)?;
        let sender = Sender {
            id,
            role: operator.role,
            name: operator.name.clone(),
            key: operator.key,
        };
        if self.operators.names().count() != known {
            self.board.show_names(self.operators.names());
        }
        let rate = self.rates.get_mut(id.0 as usize);
        if rate.is_some_and(|rate| rate.allows(now)) {
            Ok(sender)
        } else {
            Err(Refusal::TooMany)
        }
    }

    fn serve(
        &mut self,
        sender: &Sender,
        incoming: Incoming,
        now: Monotonic,
    ) -> Result<(), (Refusal, Option<Reply>)> {
        let Incoming {
            topic,
            bytes,
            reply,
            ..
        } = incoming;
        match topic {
            OperatorTopic::Drive => self
                .drive(sender, &bytes, now)
                .map_err(|refusal| (refusal, None)),
            OperatorTopic::EStop => self.estop(sender, &bytes, reply, now),
            OperatorTopic::Reset => self.reset(sender, &bytes, reply, now),
            OperatorTopic::Lease => self.lease(sender, &bytes, reply, now),
            OperatorTopic::Set => self.set(sender, &bytes, reply, now),
        }
    }

    fn drive(&mut self, sender: &Sender, bytes: &[u8], now: Monotonic) -> Result<(), Refusal> {
        let envelope = Envelope::parse(bytes).map_err(|error| words::refused(&error))?;
        let stamp = envelope.claimed_stamp();
        let claimed: Drive = envelope
            .claimed_command()
            .map_err(|error| words::refused(&error))?;
        let press = claimed.estop.map(|estop| estop.press);
        let mut command = DriveCommand {
            operator: sender.id,
            epoch: stamp.epoch,
            seq: stamp.seq,
            token: words::token(&stamp),
            requested: words::velocity(&claimed),
            estop: press.is_some(),
        };
        if !command.estop {
            self.state.screen(&self.rules, now, sender.role, &command)?;
        }
        envelope
            .open::<Drive>(self.route(sender), &sender.key)
            .map_err(|error| words::refused(&error))?;
        if press.is_some_and(|press| self.is_repetition(sender, press)) {
            // It is in force, or was reset. What else the command says is judged as ever.
            command.estop = false;
        }
        let role = sender.role;
        self.step(now, Event::Command { role, command });
        Ok(())
    }

    /// Whether this press of an emergency stop was heard before. One of whoever may not stop the vehicle is none, and is
    /// refused for that, by whichever way it comes and however often.
    pub(super) fn is_repetition(&mut self, sender: &Sender, press: u64) -> bool {
        sender.role.may_drive() && self.presses.was_seen(press)
    }

    pub(super) fn route<'a>(&'a self, sender: &'a Sender) -> Route<'a> {
        Route {
            robot: &self.robot,
            operator: &sender.name,
        }
    }
}

/// Why the collision guard is on from now on, if it was off.
const fn guard_again(happening: &Happening) -> Option<GuardAgain> {
    match *happening {
        Happening::LeaseGranted { to, .. } => Some(GuardAgain::Granted(to)),
        Happening::EStopped { .. } => Some(GuardAgain::EStopped),
        Happening::Reset { .. }
        | Happening::Mode {
            from: Mode::Fault(_),
            to: Mode::SafeBoot,
        } => Some(GuardAgain::Reset),
        Happening::Mode { .. }
        | Happening::LeaseRequested { .. }
        | Happening::LeaseEnded { .. }
        | Happening::Refused { .. } => None,
    }
}

#[cfg(test)]
mod tests;
