//! Converts operator input to signed commands, one iteration of an input loop at a time.
//!
//! The owner of the loop (window or script) calls [`TeleopClient::begin`] with the newest token *before* it drains its
//! event queue, applies the events, and sends the result of [`TeleopClient::end`] once. So the token's age is never
//! less than the age of the input, and a loop that hangs sends nothing, or commands that the robot rejects. Message
//! formats: `SPEC.md`, sections 12 and 13.

mod drive_commands;
mod estop;
mod goal;
mod incoming;
mod lease;
mod messages;

use std::collections::VecDeque;
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::{OperatorId, RobotId, operator_key};
use protocol::message::{
    AgeToken, DockingChoice, Drive, Info, LeaseRequest, MapPose, Refusal, TeleopStatus, Velocity,
};
use protocol::signed::{Command, CommandHeader, Route, sign};
use protocol::tile::BootId;
use teleop::Role;

use crate::identity::{self, Identity};
use crate::teleop_input::{
    DriveInput, DriveKey, InputEvent, InputLockReason, SpeedStep, TeleopInput,
};

pub use lease::Lease;
pub use messages::{
    Intent, LatestPose, NotSentReason, RequestKind, RequestNumber, SignedMessage, TeleopMessage,
    TeleopNotification,
};

use drive_commands::DriveCommands;
use estop::PendingEStop;
use goal::NamedGoal;
use messages::Requests;

/// The link counts as lost after this time without a token: longer than the gaps of a jittery link, shorter than a
/// pause that an operator would accept. The robot has stopped long before.
const LINK_LOST: Duration = Duration::from_millis(600);
/// A longer iteration means that the program was suspended.
const FROZEN: Duration = Duration::from_millis(300);
/// Faster turns cannot be steered by delayed images, rad/s.
const MAX_TURN_RADPS: f32 = 1.5;
const MAX_NOTES: usize = 64;

pub struct TeleopClient {
    robot: RobotId,
    identity: Identity,
    input: TeleopInput,
    /// Greatest requested speeds: linear and lateral, m/s, and angular, rad/s; zero until the robot has sent its limits.
    limits: [f32; 3],
    /// Deceleration of stops; zero until known.
    stop_decel: Velocity,
    /// The newest pose before the events of this iteration.
    newest: Option<LatestPose>,
    /// Arrival of the last pose that was used.
    looked_at: Option<Monotonic>,
    boot: Option<BootId>,
    /// The newest known grant of the lease, of any holder.
    epoch: u64,
    lease: Lease,
    /// The newest grant to this console, active or not.
    last_grant: Option<u64>,
    status: Option<TeleopStatus>,
    seq: u64,
    requests: Requests,
    numbers: u64,
    estop: Option<PendingEStop>,
    estop_refused: Option<protocol::message::Refusal>,
    next_press: u64,
    drive_commands: DriveCommands,
    docking: Option<DockingChoice>,
    goal: Option<NamedGoal>,
    last_end: Option<Monotonic>,
    is_link_lost: bool,
    /// Whether an observer has tried to drive since the last iteration.
    has_attempted_to_drive: bool,
    notifications: VecDeque<TeleopNotification>,
    /// The last notification that needs the operator's attention.
    notice: Option<(Monotonic, TeleopNotification)>,
}

/// No robot accepts an older token: the greatest configurable age is 1 s.
const TOKEN_USELESS: Duration = Duration::from_secs(1);
/// A request waits for the next token if the newest came longer ago: while nobody drives tokens come 5 times a second, and the robot
/// refuses what is too old.
const TOKEN_FOR_REQUEST: Duration = Duration::from_millis(50);
/// Interval of looking for it.
const TOKEN_POLL: Duration = Duration::from_millis(10);

const NOTICE: Duration = Duration::from_secs(10);

#[derive(Clone, Debug, PartialEq)]
pub struct TeleopClientState {
    pub operator: OperatorId,
    pub role: Option<Role>,
    pub lease: Lease,
    /// In this run of the robot. A status with this grant may be older than its end here.
    pub last_grant: Option<u64>,
    pub step: SpeedStep,
    pub limits: [f32; 3],
    pub drive_input: DriveInput,
    pub keys: Vec<DriveKey>,
    /// Why pressed keys and sticks do not count.
    pub ignored: Option<InputLockReason>,
    pub is_ready: bool,
    pub token_age: Option<Duration>,
    pub is_asking: bool,
    pub notice: Option<TeleopNotification>,
    pub estop: EStopState,
    /// The docking site that its commands name.
    pub docking: Option<DockingChoice>,
    /// The goal that its commands name.
    pub goal: Option<MapPose>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EStopState {
    Quiet,
    /// Time since the press; it is sent ten times a second until acknowledged.
    Sending(Duration),
    /// Time since the press; no message from the robot has arrived, so it cannot be sent.
    Unsendable(Duration),
    Refused(Refusal),
}

impl TeleopClientState {
    pub const fn is_observer(&self) -> bool {
        identity::is_observer(self.role)
    }

    pub const fn cannot_take_over(&self) -> bool {
        identity::cannot_take_over(self.role)
    }
}

impl TeleopClient {
    pub fn new(robot: RobotId, identity: Identity, random: u64) -> Self {
        Self {
            robot,
            identity,
            input: TeleopInput::default(),
            limits: [0.0; 3],
            stop_decel: Velocity::default(),
            newest: None,
            looked_at: None,
            boot: None,
            epoch: 0,
            lease: Lease::None,
            last_grant: None,
            status: None,
            seq: 0,
            requests: Requests::default(),
            numbers: 0,
            estop: None,
            estop_refused: None,
            next_press: random,
            drive_commands: DriveCommands::new(Monotonic::default()),
            docking: None,
            goal: None,
            last_end: None,
            is_link_lost: false,
            has_attempted_to_drive: false,
            notifications: VecDeque::new(),
            notice: None,
        }
    }

    pub fn set_robot_info(&mut self, info: &Info) {
        let [speed_mps, lateral_mps, turn_rate_radps] = info.limits.map(|limit| {
            if limit.is_finite() {
                limit.max(0.0)
            } else {
                0.0
            }
        });
        self.limits = [speed_mps, lateral_mps, turn_rate_radps.min(MAX_TURN_RADPS)];
        self.input.set_goes_sideways(lateral_mps > 0.0);
        self.stop_decel = Velocity {
            linear_mps: info.stop_decel_mps2,
            lateral_mps: info.stop_decel_mps2,
            angular_radps: info.stop_decel_radps2,
        };
    }

    /// Begins an iteration with the newest token, before the event queue is drained.
    pub fn begin(&mut self, newest: Option<LatestPose>, now: Monotonic) {
        if let Some(newest) = newest
            && self.looked_at != Some(newest.at)
        {
            self.looked_at = Some(newest.at);
            self.on_boot(newest.boot, now);
            self.newest = Some(newest);
        }
    }

    pub fn apply(&mut self, event: InputEvent) {
        self.input.apply(event);
        self.detect_drive_attempt(event);
    }

    /// Ends an iteration: returns the messages to send, in order.
    pub fn end(&mut self, now: Monotonic) -> Vec<SignedMessage> {
        self.update_input_lock(now);
        let mut messages = Vec::new();
        let has_pressed = self.input.take_estop();
        let has_attempted_to_drive = std::mem::take(&mut self.has_attempted_to_drive);
        if self.is_observer() {
            if has_pressed || has_attempted_to_drive {
                self.warn(now, TeleopNotification::ObserverOnly);
            }
        } else if has_pressed {
            self.press_estop(now);
        }
        self.repeat_estop(now, &mut messages);
        self.ask(now, &mut messages);
        self.drive(now, &mut messages);
        self.last_end = Some(now);
        messages
    }

    /// Unacknowledged emergency stop, zero velocity, and release of the lease or of its request.
    pub fn shutdown_messages(&mut self) -> Vec<SignedMessage> {
        self.input.lock_input(InputLockReason::Focus);
        let token = self.newest.and_then(|newest| newest.token);
        let token = token.unwrap_or(AgeToken { n: 0, nonce: 0 });
        let mut messages = Vec::new();
        if let Some(body) = self.estop.as_ref().map(PendingEStop::body) {
            let number = self.number();
            messages.extend(self.signed(token, &body, Some(number)));
        }
        if self.lease.held().is_some() {
            messages.extend(self.signed(token, &self.command(DriveInput::NEUTRAL), None));
        }
        // A queued request would be granted to a closed console.
        if self.lease != Lease::None || self.requests.asks_for_lease() {
            let number = self.number();
            messages.extend(self.signed(token, &LeaseRequest::Release, Some(number)));
            self.lease = Lease::None;
        }
        messages
    }

    /// When the next iteration is due without an event.
    pub fn due(&self, now: Monotonic) -> Option<Monotonic> {
        let drive = self.lease.held().map(|_| self.drive_commands.due());
        let estop = self.estop.as_ref().map(|pending| pending.due(now));
        let estop = estop.filter(|_| self.boot.is_some());
        let request = self.requests.due(now);
        let looked = self.last_end.filter(|_| self.awaits_token(now));
        let request = request.map(|due| looked.map_or(due, |looked| due.max(looked + TOKEN_POLL)));
        [drive, estop, request].into_iter().flatten().min()
    }

    pub fn submit(&mut self, intent: Intent, now: Monotonic) {
        if self.rejects(&intent, now) {
            return;
        }
        let asked = match intent {
            Intent::EStop => return self.input.apply(InputEvent::EStop),
            Intent::Step(step) => return self.input.apply(InputEvent::Step(step)),
            Intent::Dock(choice) => {
                self.docking = choice;
                return;
            }
            Intent::Goal(pose) => {
                self.goal = pose.map(|pose| NamedGoal::new(pose, now));
                return;
            }
            Intent::Reset(estop) => RequestKind::Reset(estop),
            Intent::Set(setting) => RequestKind::Set(setting),
            Intent::Lease(request) => {
                if request == LeaseRequest::Release {
                    self.end_lease(TeleopNotification::LeaseReleased);
                }
                RequestKind::Lease(request)
            }
        };
        if let Err(asked) = self.requests.push(asked) {
            self.warn(
                now,
                TeleopNotification::NotSent(asked, NotSentReason::TooMany),
            );
        }
    }

    pub const fn is_driving(&self) -> bool {
        self.lease.held().is_some()
    }

    pub fn take_notifications(&mut self) -> VecDeque<TeleopNotification> {
        std::mem::take(&mut self.notifications)
    }

    fn update_input_lock(&mut self, now: Monotonic) {
        let is_held = self.lease.held().is_some();
        // After a suspension the queued input is too old.
        let is_frozen = self
            .last_end
            .is_some_and(|last| now.since(last) > FROZEN.max(drive_commands::PERIOD));
        if is_held && is_frozen {
            self.lock_input(InputLockReason::LoopStalled);
        }
        let was_lost = self.is_link_lost;
        self.is_link_lost = self
            .newest
            .is_none_or(|newest| now.since(newest.at) > LINK_LOST);
        if is_held && self.is_link_lost {
            if was_lost {
                self.drive_commands.interrupt();
                self.input.lock_input(InputLockReason::Link);
            } else {
                self.lock_input(InputLockReason::Link);
            }
        }
        if !is_held {
            self.input.lock_input(InputLockReason::Lease);
            self.docking = None;
        }
        // A goal needs an operator who could drive at once.
        if !is_held || !self.input.is_ready() || !self.input.drive_input().is_neutral() {
            self.goal = None;
        }
        if let Some(asked) = self.requests.take_overdue(now) {
            self.warn(now, TeleopNotification::RequestTimedOut(asked));
        }
    }

    fn press_estop(&mut self, now: Monotonic) {
        if self.estop.is_some() {
            return;
        }
        let before = self.status.as_ref().and_then(|status| status.estop);
        let before = before.map(|estop| estop.number);
        self.estop = Some(PendingEStop::new(self.next_press, before, now));
        self.clear_not_in_force_notice();
        // An odd step visits every number before it repeats.
        self.next_press = self.next_press.wrapping_add(0x9E37_79B9_7F4A_7C15);
        self.notify(TeleopNotification::EStopPressed);
    }

    /// Sends by query and with drive commands, in case one fails; the token may have any age.
    fn repeat_estop(&mut self, now: Monotonic, messages: &mut Vec<SignedMessage>) {
        let is_due = |pending: &PendingEStop| pending.due(now) <= now;
        let Some(estop) = self.estop.as_ref().filter(|pending| is_due(pending)) else {
            return;
        };
        if self.boot.is_none() {
            return;
        }
        let body = estop.body();
        let token = self.newest.and_then(|newest| newest.token);
        let token = token.unwrap_or(AgeToken { n: 0, nonce: 0 });
        let number = self.number();
        messages.extend(self.signed(token, &body, Some(number)));
        if let Some(estop) = &mut self.estop {
            estop.sent(number, now);
        }
        if self.lease.held().is_none() {
            let drive = self.command(DriveInput::NEUTRAL);
            messages.extend(self.signed(token, &drive, None));
        }
    }

    fn ask(&mut self, now: Monotonic, messages: &mut Vec<SignedMessage>) {
        if self.awaits_token(now) {
            return;
        }
        while let Some(asked) = self.requests.next() {
            let Some(token) = self.fresh_token(now) else {
                self.warn(
                    now,
                    TeleopNotification::NotSent(asked, NotSentReason::NoToken),
                );
                continue;
            };
            let number = self.number();
            messages.extend(match &asked {
                RequestKind::Lease(request) => self.signed(token, request, Some(number)),
                RequestKind::Reset(estop) => {
                    let reset = protocol::message::Reset { estop: *estop };
                    self.signed(token, &reset, Some(number))
                }
                RequestKind::Set(setting) => self.signed(token, setting, Some(number)),
            });
            self.requests.sent(number, asked, now);
        }
    }

    fn drive(&mut self, now: Monotonic, messages: &mut Vec<SignedMessage>) {
        if self.lease.held().is_none() {
            return;
        }
        let Some(token) = self.fresh_token(now) else {
            return;
        };
        let wanted = (self.input.drive_input(), self.goal.map(|goal| goal.pose));
        if let Some((input, goal)) = self.drive_commands.next(wanted, self.newest, now) {
            let drive = Drive {
                goal,
                ..self.command(input)
            };
            messages.extend(self.signed(token, &drive, None));
        }
    }

    fn lock_input(&mut self, loss: InputLockReason) {
        let was_asking = !self.input.drive_input().is_neutral();
        self.input.lock_input(loss);
        self.drive_commands.interrupt();
        if was_asking {
            self.notify(TeleopNotification::InputLocked(loss));
        }
    }

    fn warn(&mut self, now: Monotonic, note: TeleopNotification) {
        self.notice = Some((now, note.clone()));
        self.notify(note);
    }

    fn notify(&mut self, note: TeleopNotification) {
        tracing::debug!(?note, "teleop");
        if self.notifications.len() == MAX_NOTES {
            self.notifications.pop_front();
        }
        self.notifications.push_back(note);
    }

    const fn is_observer(&self) -> bool {
        identity::is_observer(self.identity.role)
    }

    /// Detects an attempt of an observer to drive. Arrow keys move the map then and do not count.
    fn detect_drive_attempt(&mut self, event: InputEvent) {
        use DriveKey::{A, D, S, W};
        let drives = matches!(event, InputEvent::Press(W | A | S | D) | InputEvent::Pad(_));
        self.has_attempted_to_drive |=
            drives && self.is_observer() && !self.input.drive_input().is_neutral();
    }

    /// Whether an observer may not submit this; then a notice is shown.
    fn rejects(&mut self, intent: &Intent, now: Monotonic) -> bool {
        // A stop is handled in the iteration that takes the press.
        let is_denied = self.is_observer() && !matches!(intent, Intent::EStop | Intent::Step(_));
        if is_denied {
            self.warn(now, TeleopNotification::ObserverOnly);
        }
        is_denied
    }

    fn command(&self, drive_input: DriveInput) -> Drive {
        let [speed_mps, lateral_mps, turn_rate_radps] = self.limits;
        Drive {
            linear_mps: drive_input.forward * speed_mps,
            lateral_mps: drive_input.sideways * lateral_mps,
            angular_radps: drive_input.left * turn_rate_radps,
            estop: self.estop.as_ref().map(PendingEStop::body),
            docking: self.docking,
            goal: None,
        }
    }

    /// Whether a request waits for a newer token.
    fn awaits_token(&self, now: Monotonic) -> bool {
        let age = self.newest.map(|newest| now.since(newest.at));
        age.is_some_and(|age| (TOKEN_FOR_REQUEST..=TOKEN_USELESS).contains(&age))
    }

    fn fresh_token(&self, now: Monotonic) -> Option<AgeToken> {
        self.newest
            .filter(|newest| now.since(newest.at) <= TOKEN_USELESS)?
            .token
    }

    fn signed<T: Command>(
        &mut self,
        token: AgeToken,
        body: &T,
        request: Option<RequestNumber>,
    ) -> Option<SignedMessage> {
        self.seq += 1;
        let operator = &self.identity.operator;
        let route = Route {
            robot: &self.robot,
            operator,
        };
        let stamp = CommandHeader {
            boot: self.boot?,
            token,
            epoch: self.epoch,
            seq: self.seq,
        };
        let payload = sign(&self.identity.key, route, &stamp, body)
            .inspect_err(|why| tracing::error!(%why, "a command was not signed"))
            .ok()?;
        Some(SignedMessage {
            topic: T::TOPIC,
            key: operator_key(&self.robot, operator, T::TOPIC),
            payload,
            request,
        })
    }

    const fn number(&mut self) -> RequestNumber {
        self.numbers += 1;
        RequestNumber(self.numbers)
    }

    pub fn state(&self, now: Monotonic) -> TeleopClientState {
        let estop = match (&self.estop, self.estop_refused) {
            (Some(pending), _) if pending.is_sent() => {
                EStopState::Sending(now.since(pending.since))
            }
            (Some(pending), _) => EStopState::Unsendable(now.since(pending.since)),
            (None, Some(refusal)) => EStopState::Refused(refusal),
            (None, None) => EStopState::Quiet,
        };
        let token = self.newest.filter(|newest| newest.token.is_some());
        TeleopClientState {
            operator: self.identity.operator.clone(),
            role: self.identity.role,
            lease: self.lease,
            last_grant: self.last_grant,
            step: self.input.step(),
            limits: self.limits,
            drive_input: self.input.drive_input(),
            keys: self.input.keys().collect(),
            ignored: self.input.lock_reason(),
            is_ready: self.input.is_ready(),
            docking: self.docking,
            goal: self.goal.map(|goal| goal.pose),
            token_age: token.map(|newest| now.since(newest.at)),
            is_asking: self.requests.is_busy(),
            notice: self
                .notice
                .as_ref()
                .filter(|(at, _)| now.since(*at) < NOTICE)
                .map(|(_, note)| note.clone()),
            estop,
        }
    }
}

#[cfg(test)]
mod tests;
