//! The loop's mind: what arrives and when a round ends, turned into events of the arbiter, and its actions done.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use protocol::keys::{OperatorId as OperatorName, OperatorTopic, RobotId};
use protocol::message::{Answer, Drive};
use protocol::signed::{Envelope, Route};
use protocol::tile::BootId;

use super::audit_recorder::AuditRecorder;
use super::drive_log::DriveLog;
use super::estop_deduplicator::EStopDeduplicator;
use super::estop_store::EStopStore;
use super::inbox::{Incoming, Reply};
use super::local_commands::LocalCommand;
use super::monitor_input::MonitorRunner;
use super::motors::{MotorReadiness, Motors};
use super::operators::{MAX_OPERATORS, Operators};
use super::rate_limiter::RateLimiter;
use super::shared_drive_state::{DriveEvent, MonitorReenabled, SharedDriveState};
use super::status_message::{self, MonitorDetail, RuntimeSettings};
use crate::actuators::Fault;
use crate::clock;
use measurement::time::Monotonic;
use teleop::arbiter::StopReason;
use teleop::emergency_stop::StoredEStop;
use teleop::{
    Action, ArbiterEvent, ArbiterInput, ArbiterState, CollisionMonitorOutput, DriveCommand, Mode,
    OperatorId, Refusal, RequestId, Role, Rules, Velocity, step,
};

/// Tokens are issued this often, with the rounds.
const TOKEN_PERIOD: Duration = Duration::from_millis(20);
/// Answers that are waited for at most.
const MAX_REPLIES: usize = 64;

/// Who drives what.
pub(super) struct DriveLoop {
    pub(super) robot: RobotId,
    pub(super) rules: Rules,
    pub(super) state: ArbiterState,
    pub(super) operators: Operators,
    pub(super) motors: Motors,
    pub(super) drive_state: Arc<SharedDriveState>,
    pub(super) runtime_settings: RuntimeSettings,
    pub(super) estop_deduplicator: EStopDeduplicator,
    pub(super) monitor_runner: Option<MonitorRunner>,
    pub(super) estop_store: Option<EStopStore>,
    pub(super) log: Option<DriveLog>,
    pub(super) audit_recorder: AuditRecorder,
    rate_limiters: [RateLimiter; MAX_OPERATORS],
    motor_readiness: MotorReadiness,
    /// What the run before left; until the self-test, which waits for the motors.
    pub(super) pending_self_test: Option<StoredEStop>,
    last_token: Option<Monotonic>,
    drive_events: VecDeque<DriveEvent>,
    /// Answers that wait, by request; those of emergency stops until these are stored.
    replies: VecDeque<(RequestId, Reply)>,
    next_request: u64,
    reported_fault: Option<Fault>,
}

/// Who sent a message, as the key it came with says: not yet proven.
#[derive(Clone, Debug)]
pub(super) struct Sender {
    pub(super) id: OperatorId,
    pub(super) role: Role,
    pub(super) name: OperatorName,
    pub(super) key: protocol::signed::PublicKey,
}

impl DriveLoop {
    pub(super) fn new(
        (robot, boot): (RobotId, BootId),
        rules: Rules,
        operators: Operators,
        motors: Motors,
        drive_state: Arc<SharedDriveState>,
        now: Monotonic,
    ) -> Self {
        // Those of a list are known before any of them has said a word.
        drive_state.publish_names(operators.names());
        Self {
            robot,
            rules,
            state: ArbiterState::new(u128::from_be_bytes(boot.0)),
            operators,
            motors,
            drive_state,
            runtime_settings: RuntimeSettings::default(),
            estop_deduplicator: EStopDeduplicator::new(),
            monitor_runner: None,
            estop_store: None,
            log: None,
            audit_recorder: AuditRecorder::default(),
            rate_limiters: [RateLimiter::new(now); MAX_OPERATORS],
            motor_readiness: MotorReadiness::Starting,
            pending_self_test: None,
            last_token: None,
            drive_events: VecDeque::new(),
            replies: VecDeque::new(),
            next_request: 0,
            reported_fault: None,
        }
    }

    /// Takes one message of an operator.
    ///
    /// In the order of "Security": size, rate, token, epoch, sequence, signature. A flood buys no signature checks.
    pub(super) fn receive(&mut self, incoming: Incoming, now: Monotonic) {
        let (operator, request_kind) = (incoming.operator.clone(), incoming.request_kind());
        let refused = match self.sender(&incoming, now) {
            Ok(sender) => self.serve(&sender, incoming, now),
            Err(refusal) => Err((refusal, incoming.reply)),
        };
        if let Err((refusal, reply)) = refused {
            self.audit_recorder
                .record_refusal(&operator, request_kind, refusal, now);
            self.step(now, ArbiterInput::Rejected(refusal));
            if let Some(reply) = reply {
                reply(Answer::Refused(status_message::refusal(refusal)));
            }
        }
    }

    /// Messages for which the inbox had no room.
    pub(super) fn dropped(&mut self, count: u64) {
        if count > 0 {
            self.runtime_settings.dropped = self.runtime_settings.dropped.saturating_add(count);
            self.drive_state.publish_settings(self.runtime_settings);
        }
    }

    /// Ends a round: tells the motors what to do now.
    pub(super) fn tick(&mut self, now: Monotonic) {
        self.apply_pending_operators(now);
        if let Some(id) = self.estop_store.as_mut().and_then(EStopStore::take_stored) {
            self.step(now, ArbiterInput::EStopStored(id));
        }
        self.test_motors(now);
        let output = self.monitor_output(now);
        self.step(now, ArbiterInput::CollisionMonitor(output));
        if self
            .last_token
            .is_none_or(|last| now.since(last) >= TOKEN_PERIOD)
            && let Ok(nonce) = getrandom::u64()
        {
            // Without randomness there are no tokens, and so nobody drives.
            self.last_token = Some(now);
            self.step(now, ArbiterInput::Token { nonce });
        }
        self.step(now, ArbiterInput::Tick);
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
        let detail =
            self.monitor_runner
                .as_ref()
                .map_or_else(MonitorDetail::default, |monitor_runner| MonitorDetail {
                    barrier: monitor_runner.barrier(),
                    side_ground_ages: monitor_runner.side_ground_ages(),
                });
        self.drive_state.publish_report(&report, detail);
        // Again, where somebody was reading when they changed.
        self.drive_state.publish_settings(self.runtime_settings);
        self.drive_state.publish_events(&mut self.drive_events);
    }

    /// The self-test, once the motors are found; later, whether they still obey.
    fn test_motors(&mut self, now: Monotonic) {
        let is_fault = match self.motor_readiness {
            MotorReadiness::Starting => return,
            MotorReadiness::Ready => false,
            MotorReadiness::Absent => true,
            MotorReadiness::Faulty(fault) => {
                if self.reported_fault != Some(fault) {
                    self.reported_fault = Some(fault);
                    tracing::error!(%fault, "motors");
                    self.drive_event(DriveEvent::Motors(fault), now);
                }
                true
            }
        };
        if let Some(stored) = self.pending_self_test.take() {
            let has_passed = !is_fault;
            self.step(now, ArbiterInput::SelfTest { has_passed, stored });
        } else if is_fault {
            self.step(now, ArbiterInput::ActuatorFault);
        }
    }

    /// Somebody at the vehicle says so.
    pub(super) fn execute_local(&mut self, command: LocalCommand, now: Monotonic) {
        match command {
            LocalCommand::Stop => self.step(now, ArbiterInput::LocalEStop),
            LocalCommand::Reset => {
                self.step(now, ArbiterInput::LocalReset);
                // Out of a fault it goes through the self-test again.
                if self.state.mode() == Mode::SafeBoot && self.pending_self_test.is_none() {
                    self.pending_self_test = Some(StoredEStop::None);
                }
            }
        }
    }

    fn monitor_output(&mut self, now: Monotonic) -> CollisionMonitorOutput {
        let report = self.state.report(&self.rules, now);
        match &mut self.monitor_runner {
            // Also where it is switched off: what it remembers must be whole when it is switched on again.
            Some(monitor_runner) => {
                let output = monitor_runner.output((report.applied, report.requested), now);
                if self.runtime_settings.collision_monitor {
                    output
                } else {
                    CollisionMonitorOutput::Off
                }
            }
            None => CollisionMonitorOutput::Off,
        }
    }

    /// Nobody drives any more.
    pub(super) fn stop(&mut self) {
        let _whatever_it_says = self.motors.apply(Velocity::ZERO, clock::now());
    }

    /// One event of the arbiter, and what follows from it.
    pub(super) fn step(&mut self, now: Monotonic, input: ArbiterInput) {
        let (state, actions) = step(&self.rules, self.state, now, input);
        self.state = state;
        let motors = self.motors.apply(actions.output, now);
        if let Some(measured) = motors.measured {
            self.state = step(
                &self.rules,
                self.state,
                now,
                ArbiterInput::Measured(measured),
            )
            .0;
        }
        self.motor_readiness = motors.readiness;
        for action in actions.iter() {
            match action {
                Action::PublishToken(token) => self.drive_state.publish_token(token),
                Action::Answer { request, answer } => {
                    self.reply(request, status_message::answer(answer));
                }
                Action::AcknowledgeEStop(id) => {
                    for (_, reply) in self.replies.drain(..) {
                        reply(Answer::EStopped(id.0));
                    }
                }
                Action::StoreEStop(id) => match &mut self.estop_store {
                    Some(estop_store) => estop_store.store(id),
                    None => self.step(now, ArbiterInput::EStopStored(id)),
                },
                Action::ClearEStop(_) => {
                    if let Some(estop_store) = &mut self.estop_store {
                        estop_store.clear();
                    }
                }
                Action::Notify(event) => self.on_arbiter_event(event, now),
            }
        }
    }

    fn on_arbiter_event(&mut self, event: ArbiterEvent, now: Monotonic) {
        if let ArbiterEvent::ModeChanged {
            to: Mode::Stopping { reason, .. },
            ..
        } = event
        {
            self.runtime_settings.last_stop = Some(reason);
            self.drive_state.publish_settings(self.runtime_settings);
            if reason == StopReason::CollisionMonitorStale {
                let unavailable_reason = self
                    .monitor_runner
                    .as_ref()
                    .and_then(MonitorRunner::unavailable_reason);
                self.drive_event(DriveEvent::MonitorUnavailable { unavailable_reason }, now);
                return;
            }
        }
        self.drive_event(DriveEvent::Arbiter(event), now);
        if let Some(why) = monitor_reenabled(&event) {
            self.reenable_monitor(why, now);
        }
    }

    /// Off is for one driver and one drive. A stop by age alone ends neither: the holder keeps the lease, and the guard
    /// as they left it.
    fn reenable_monitor(&mut self, why: MonitorReenabled, now: Monotonic) {
        if self.monitor_runner.is_some() && !self.runtime_settings.collision_monitor {
            self.runtime_settings.collision_monitor = true;
            self.drive_state.publish_settings(self.runtime_settings);
            self.drive_event(DriveEvent::MonitorReenabled(why), now);
        }
    }

    /// Something that people and the audit log should know.
    pub(super) fn drive_event(&mut self, drive_event: DriveEvent, now: Monotonic) {
        self.audit_recorder
            .record(&drive_event, &self.operators, now);
        self.drive_events.push_back(drive_event);
    }

    /// Keeps the way for an answer; the oldest goes where there are too many.
    pub(super) fn register_reply(&mut self, reply: Option<Reply>) -> RequestId {
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
            self.drive_state.publish_names(self.operators.names());
        }
        let rate = self.rate_limiters.get_mut(id.0 as usize);
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
        let envelope =
            Envelope::parse(bytes).map_err(|error| status_message::refusal_for(&error))?;
        let stamp = envelope.unverified_header();
        let claimed: Drive = envelope
            .unverified_command()
            .map_err(|error| status_message::refusal_for(&error))?;
        let press = claimed.estop.map(|estop| estop.press);
        let mut command = DriveCommand {
            operator: sender.id,
            epoch: stamp.epoch,
            seq: stamp.seq,
            token: status_message::token(&stamp),
            requested: status_message::velocity(&claimed),
            estop: press.is_some(),
        };
        if !command.estop {
            self.state
                .precheck(&self.rules, now, sender.role, &command)?;
        }
        envelope
            .open::<Drive>(self.route(sender), &sender.key)
            .map_err(|error| status_message::refusal_for(&error))?;
        if press.is_some_and(|press| self.is_repeated_press(sender, press)) {
            // It is in force, or was reset. What else the command says is judged as ever.
            command.estop = false;
        }
        let role = sender.role;
        self.step(now, ArbiterInput::Command { role, command });
        Ok(())
    }

    /// Whether this press of an emergency stop was heard before. One of whoever may not stop the vehicle is none, and is
    /// refused for that, by whichever way it comes and however often.
    pub(super) fn is_repeated_press(&mut self, sender: &Sender, press: u64) -> bool {
        sender.role.may_drive() && self.estop_deduplicator.is_duplicate(press)
    }

    pub(super) fn route<'a>(&'a self, sender: &'a Sender) -> Route<'a> {
        Route {
            robot: &self.robot,
            operator: &sender.name,
        }
    }
}

/// Why the collision monitor is on from now on, if it was off.
const fn monitor_reenabled(event: &ArbiterEvent) -> Option<MonitorReenabled> {
    match *event {
        ArbiterEvent::LeaseGranted { to, .. } => Some(MonitorReenabled::Granted(to)),
        ArbiterEvent::EStopped { .. } => Some(MonitorReenabled::EStopped),
        ArbiterEvent::Reset { .. }
        | ArbiterEvent::ModeChanged {
            from: Mode::Fault(_),
            to: Mode::SafeBoot,
        } => Some(MonitorReenabled::Reset),
        ArbiterEvent::ModeChanged { .. }
        | ArbiterEvent::LeaseRequested { .. }
        | ArbiterEvent::LeaseEnded { .. }
        | ArbiterEvent::Refused { .. } => None,
    }
}

#[cfg(test)]
mod tests;
