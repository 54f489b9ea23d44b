//! The teleop loop: turns messages and rounds into inputs of the arbiter, and executes its actions.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use protocol::keys::OperatorId as OperatorName;
use protocol::keys::{OperatorTopic, RobotId, is_name};
use protocol::message::{Answer, Drive, EStop, LeaseRequest, Refusal, Reset, Setting, StopReason};
use protocol::signed::{Command, CommandHeader, Envelope, Route};
use protocol::tile::BootId;

use crate::actuators::Fault;
use crate::driving::audit_recorder::AuditRecorder;
use crate::driving::drive_log::DriveLog;
use crate::driving::estop_store::EStopStore;
use crate::driving::inbox::{EStopDeduplicator, Incoming, LocalCommand, RateLimiter, Reply};
use crate::driving::monitor_input::MonitorRunner;
use crate::driving::motors::{MotorReadiness, Motors};
use crate::driving::operators::{MAX_OPERATORS, Operators};
use crate::driving::planner::PlannerExchange;
use crate::driving::shared_drive_state::{
    DriveEvent, MapRequest, MonitorReenabled, SharedDriveState,
};
use crate::driving::status_message::{self, MonitorDetail, RuntimeSettings};
use measurement::time::Monotonic;
use network::clock;
use teleop::{
    Action, ArbiterEvent, ArbiterInput, ArbiterState, Caller, CollisionMonitorOutput, DriveCommand,
    EStopId, LeaseVerb, Mode, OperatorId, RequestId, Role, Rules, StoredEStop, Velocity, step,
};

/// Tokens are issued this often, with the rounds.
const TOKEN_PERIOD: Duration = Duration::from_millis(20);
/// The collision monitor decides this often while nobody drives, otherwise in each round. The arbiter takes its output for missing
/// after 300 ms.
const IDLE_MONITOR_PERIOD: Duration = Duration::from_millis(100);
const MAX_REPLIES: usize = 64;

pub(super) struct DriveLoop {
    pub(super) robot: RobotId,
    pub(super) rules: Rules,
    pub(super) state: ArbiterState,
    pub(super) operators: Operators,
    pub(super) motors: Motors,
    pub(super) drive_state: Arc<SharedDriveState>,
    pub(super) runtime_settings: RuntimeSettings,
    pub(super) can_save_maps: bool,
    pub(super) estop_deduplicator: EStopDeduplicator,
    pub(super) monitor_runner: Option<MonitorRunner>,
    pub(super) estop_store: Option<EStopStore>,
    pub(super) log: Option<DriveLog>,
    pub(super) audit_recorder: AuditRecorder,
    pub(super) planner: Option<PlannerExchange>,
    rate_limiters: [RateLimiter; MAX_OPERATORS],
    pub(super) motor_check: MotorCheck,
    last_token: Option<Monotonic>,
    /// When the collision monitor last decided, and whether it was on.
    last_monitored: Option<(Monotonic, bool)>,
    drive_events: VecDeque<DriveEvent>,
    replies: Replies,
}

pub(super) struct MotorCheck {
    readiness: MotorReadiness,
    reported_fault: Option<Fault>,
    /// What the previous run left, until the self-test.
    pub(super) pending_self_test: Option<StoredEStop>,
}

/// Pending answers by request; an emergency stop is answered when it is stored.
#[derive(Default)]
struct Replies {
    pending: VecDeque<(RequestId, Reply)>,
    last_request: u64,
}

impl Replies {
    /// Stores a pending answer; the oldest is dropped if there are too many.
    fn register(&mut self, reply: Option<Reply>) -> RequestId {
        self.last_request += 1;
        let request = RequestId(self.last_request);
        if let Some(reply) = reply {
            if self.pending.len() >= MAX_REPLIES {
                self.pending.pop_front();
            }
            self.pending.push_back((request, reply));
        }
        request
    }

    fn answer(&mut self, request: RequestId, answer: Answer) {
        let at = self.pending.iter().position(|(of, _)| *of == request);
        if let Some((_, reply)) = at.and_then(|at| self.pending.remove(at)) {
            reply(answer);
        }
    }
}

/// The claimed sender of a message, from its key; not yet verified.
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
        // The names of a list are known from the start.
        drive_state.publish_names(operators.names());
        Self {
            robot,
            rules,
            state: ArbiterState::new(u128::from_be_bytes(boot.0)),
            operators,
            motors,
            drive_state,
            runtime_settings: RuntimeSettings::default(),
            can_save_maps: false,
            estop_deduplicator: EStopDeduplicator::new(),
            monitor_runner: None,
            estop_store: None,
            log: None,
            audit_recorder: AuditRecorder::default(),
            planner: None,
            rate_limiters: [RateLimiter::new(now); MAX_OPERATORS],
            motor_check: MotorCheck {
                readiness: MotorReadiness::Starting,
                reported_fault: None,
                pending_self_test: None,
            },
            last_token: None,
            last_monitored: None,
            drive_events: VecDeque::new(),
            replies: Replies::default(),
        }
    }

    /// Handles one message of an operator.
    ///
    /// A command is checked in this order: size, rate, token, epoch, sequence, signature; requests and emergency stops:
    /// size, rate, signature, and then what they ask for. Beyond the rate nothing costs a signature check.
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
                reply(Answer::Refused(refusal));
            }
        }
    }

    pub(super) fn dropped(&mut self, count: u64) {
        if count > 0 {
            self.runtime_settings.dropped = self.runtime_settings.dropped.saturating_add(count);
            self.drive_state.publish_settings(self.runtime_settings);
        }
    }

    /// Ends a round: commands the motors and publishes the state.
    pub(super) fn tick(&mut self, now: Monotonic) {
        self.apply_pending_operators(now);
        if let Some(id) = self.estop_store.as_mut().and_then(EStopStore::take_stored) {
            self.step(now, ArbiterInput::EStopStored(id));
        }
        self.test_motors(now);
        // Before the collision monitor, which judges what is requested.
        self.take_planned(now);
        // Nothing moves before there is a lease, which ends these modes.
        let is_idle = matches!(self.state.mode(), Mode::SafeBoot | Mode::Idle);
        let is_on = self.runtime_settings.collision_monitor;
        let is_recent = |(at, was_on)| was_on == is_on && now.since(at) < IDLE_MONITOR_PERIOD;
        if !(is_idle && self.last_monitored.is_some_and(is_recent)) {
            self.last_monitored = Some((now, is_on));
            let output = self.monitor_output(now);
            self.step(now, ArbiterInput::CollisionMonitor(output));
        }
        if self
            .last_token
            .is_none_or(|last| now.since(last) >= TOKEN_PERIOD)
            && let Ok(nonce) = getrandom::u64()
        {
            // Without randomness there are no tokens, and no command is accepted.
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
        // Again, in case a reader held the lock when they changed.
        self.drive_state.publish_settings(self.runtime_settings);
        self.drive_state.publish_events(&mut self.drive_events);
    }

    fn take_planned(&mut self, now: Monotonic) {
        if let Some(input) = self.planner.as_ref().and_then(PlannerExchange::take) {
            self.step(now, input);
        }
    }

    /// Runs the self-test once the motors are found; later checks whether they still obey.
    fn test_motors(&mut self, now: Monotonic) {
        let is_fault = match self.motor_check.readiness {
            MotorReadiness::Starting => return,
            MotorReadiness::Ready | MotorReadiness::Held(..) => false,
            MotorReadiness::Absent => true,
            MotorReadiness::Faulty(fault) => {
                if self.motor_check.reported_fault != Some(fault) {
                    self.motor_check.reported_fault = Some(fault);
                    tracing::error!(%fault, "motors");
                    self.drive_event(DriveEvent::Motors(fault), now);
                }
                true
            }
        };
        if let Some(stored) = self.motor_check.pending_self_test.take() {
            let has_passed = !is_fault;
            self.step(now, ArbiterInput::SelfTest { has_passed, stored });
        } else if is_fault {
            self.step(now, ArbiterInput::ActuatorFault);
        }
        let (hold, fault) = match self.motor_check.readiness {
            MotorReadiness::Held(hold, fault) => (Some(hold), fault),
            _ => (None, None),
        };
        if self.runtime_settings.motor_hold != hold {
            self.runtime_settings.motor_hold = hold;
            self.drive_event(DriveEvent::MotorsHeld(hold), now);
            if let Some(fault) = fault {
                self.drive_event(DriveEvent::Motors(fault), now);
            }
        }
        if hold.is_some() {
            self.step(now, ArbiterInput::MotorsHeld);
        }
        for text in self.motors.take_texts(now) {
            self.drive_event(DriveEvent::Autopilot(text), now);
        }
    }

    pub(super) fn execute_local(&mut self, command: LocalCommand, now: Monotonic) {
        match command {
            LocalCommand::Stop => self.step(now, ArbiterInput::LocalEStop),
            LocalCommand::Reset => {
                self.step(now, ArbiterInput::LocalReset);
                // After a fault the self-test runs again.
                if self.state.mode() == Mode::SafeBoot
                    && self.motor_check.pending_self_test.is_none()
                {
                    self.motor_check.pending_self_test = Some(StoredEStop::None);
                }
            }
        }
    }

    fn monitor_output(&mut self, now: Monotonic) -> CollisionMonitorOutput {
        let report = self.state.report(&self.rules, now);
        match &mut self.monitor_runner {
            // Also while it is switched off: its history must be complete when it is switched on again.
            Some(monitor_runner) => {
                let velocities = (report.applied, self.state.possible_request());
                let output = monitor_runner.output(velocities, self.state.docking(), now);
                if self.runtime_settings.collision_monitor {
                    output
                } else {
                    CollisionMonitorOutput::Off
                }
            }
            None => CollisionMonitorOutput::Off,
        }
    }

    pub(super) fn stop(&mut self) {
        let _whatever_it_says = self.motors.apply(Velocity::ZERO, clock::now());
    }

    /// Passes one input to the arbiter and executes its actions.
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
        self.motor_check.readiness = motors.readiness;
        self.runtime_settings.battery_v = motors.battery_v;
        for action in actions.iter() {
            match action {
                Action::PublishToken(token) => self.drive_state.publish_token(token),
                Action::Answer { request, answer } => self.replies.answer(request, answer),
                Action::AcknowledgeEStop(id) => {
                    for (_, reply) in self.replies.pending.drain(..) {
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
        if let Some(planner) = &self.planner {
            match event {
                ArbiterEvent::GoalStarted(goal) => planner.start_goal(goal),
                ArbiterEvent::GoalEnded(why) => planner.end_goal(why),
                _ => {}
            }
        }
        if let ArbiterEvent::LeaseGranted { .. } = event {
            self.motors.lease_taken();
        }
        self.drive_event(DriveEvent::Arbiter(event), now);
        if let Some(why) = monitor_reenabled(&event) {
            self.reenable_monitor(why, now);
        }
    }

    /// Switching off holds for one driver and one drive. A stop by command age alone ends neither: the holder keeps the
    /// lease and the setting.
    fn reenable_monitor(&mut self, why: MonitorReenabled, now: Monotonic) {
        if self.monitor_runner.is_some() && !self.runtime_settings.collision_monitor {
            self.runtime_settings.collision_monitor = true;
            self.drive_state.publish_settings(self.runtime_settings);
            self.drive_event(DriveEvent::MonitorReenabled(why), now);
        }
    }

    pub(super) fn drive_event(&mut self, drive_event: DriveEvent, now: Monotonic) {
        self.audit_recorder
            .record(&drive_event, &self.operators, now);
        self.drive_events.push_back(drive_event);
    }

    fn sender(&mut self, incoming: &Incoming, now: Monotonic) -> Result<Sender, Refusal> {
        if incoming.bytes.len() > protocol::signed::MAX_SIGNED_BYTES {
            return Err(Refusal::Malformed);
        }
        let known = self.operators.names().count();
        let found = self.operators.find(&incoming.operator);
        // An unknown operator cannot have a valid signature.
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
        let header = envelope.unverified_header();
        let claimed: Drive = envelope
            .unverified_command()
            .map_err(|error| status_message::refusal_for(&error))?;
        let press = claimed.estop.map(|estop| estop.press);
        let mut command = DriveCommand {
            operator: sender.id,
            epoch: header.epoch,
            seq: header.seq,
            token: status_message::token(&header),
            requested: status_message::velocity(&claimed),
            estop: press.is_some(),
            docking: claimed.docking,
            goal: claimed.goal,
        };
        if !command.estop {
            self.state
                .precheck(&self.rules, now, sender.role, &command)?;
        }
        envelope
            .open::<Drive>(self.route(sender), &sender.key)
            .map_err(|error| status_message::refusal_for(&error))?;
        if press.is_some_and(|press| self.is_repeated_press(sender, press)) {
            // The stop is in force or was reset. The rest of the command is handled as usual.
            command.estop = false;
        }
        let role = sender.role;
        self.step(now, ArbiterInput::Command { role, command });
        Ok(())
    }

    /// Whether this press of an emergency stop is a repetition. A press of an operator who may not stop the vehicle is
    /// never recorded: it is refused each time.
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

/// Why an event switches the collision monitor on again, if it does.
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
        | ArbiterEvent::GoalStarted(_)
        | ArbiterEvent::GoalEnded(_)
        | ArbiterEvent::Refused { .. } => None,
    }
}

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
            // It is answered with the state of the first stop, and causes no other one.
            if let Some(reply) = reply {
                match report.estop {
                    Some(estop) if estop.is_stored => reply(Answer::EStopped(estop.id.0)),
                    Some(_) => {} // not stored yet: the console repeats it
                    None => reply(Answer::Refused(Refusal::NoEStop)),
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
        let (header, Reset { estop }, reply) = self.open(sender, bytes, reply)?;
        let caller = self.caller(sender, reply);
        self.step(
            now,
            ArbiterInput::Reset {
                caller,
                token: status_message::token(&header),
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
        let (header, request, reply) = self.open::<LeaseRequest>(sender, bytes, reply)?;
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
                token: status_message::token(&header),
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
        let (header, setting, reply) = self.open::<Setting>(sender, bytes, reply)?;
        let answer = match self.change(sender, &header, setting, now) {
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
        header: &CommandHeader,
        setting: Setting,
        now: Monotonic,
    ) -> Result<(), Refusal> {
        if !sender.role.may_drive() {
            return Err(Refusal::Role);
        }
        let age = self
            .state
            .tokens()
            .age(status_message::token(header), now)?;
        if age > self.rules.max_age() {
            return Err(Refusal::TooOld);
        }
        match setting {
            Setting::BudgetKbps(kbps) if (1..=1_000_000).contains(&kbps) => {
                self.runtime_settings.budget_kbps = kbps;
            }
            Setting::BudgetKbps(_) => return Err(Refusal::OutOfRange),
            Setting::CollisionMonitor(_) if self.monitor_runner.is_none() => {
                return Err(Refusal::Unavailable);
            }
            Setting::CollisionMonitor(is_on) => {
                let lease = self.state.report(&self.rules, now).lease;
                // Only the driver or a supervisor may switch it off.
                let may = is_on || lease.is_held_by(sender.id) || sender.role == Role::Supervisor;
                if !may {
                    return Err(Refusal::NotHolder);
                }
                if self.runtime_settings.collision_monitor != is_on {
                    let by = sender.id;
                    self.drive_event(DriveEvent::MonitorSwitched { is_on, by }, now);
                }
                self.runtime_settings.collision_monitor = is_on;
            }
            Setting::Recording(_) if !self.runtime_settings.can_record => {
                return Err(Refusal::Unavailable);
            }
            Setting::Recording(is_on) => {
                if !self.drive_state.request_recording(is_on) {
                    return Err(Refusal::Busy);
                }
                let by = sender.id;
                self.drive_event(DriveEvent::Recording { is_on, by }, now);
            }
            Setting::SaveMap(_) if !self.can_save_maps => {
                return Err(Refusal::Unavailable);
            }
            Setting::SaveMap(name) if !is_name(&name) => return Err(Refusal::OutOfRange),
            Setting::SaveMap(name) => {
                if !self.drive_state.request_map(MapRequest::Save(name)) {
                    return Err(Refusal::Busy);
                }
            }
            Setting::Locate(pose) => {
                if !self.drive_state.request_map(MapRequest::Locate(pose)) {
                    return Err(Refusal::Busy);
                }
            }
        }
        self.drive_state.publish_settings(self.runtime_settings);
        Ok(())
    }

    /// Verifies a message; returns header, command and the answer callback (also on refusal).
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
            Ok((header, command)) => Ok((header, command, reply)),
            Err(error) => Err((status_message::refusal_for(&error), reply)),
        }
    }

    fn caller(&mut self, sender: &Sender, reply: Option<Reply>) -> Caller {
        Caller {
            operator: sender.id,
            role: sender.role,
            request: self.replies.register(reply),
        }
    }
}

impl DriveLoop {
    /// Applies a newer operator list, if there is one: operators that were removed lose the lease.
    pub(super) fn apply_pending_operators(&mut self, now: Monotonic) {
        let Some(revoked) = self.operators.take_pending() else {
            return;
        };
        self.drive_state.publish_names(self.operators.names());
        for operator in revoked {
            self.step(now, ArbiterInput::Revoked(operator));
        }
    }
}

#[cfg(test)]
mod tests;
