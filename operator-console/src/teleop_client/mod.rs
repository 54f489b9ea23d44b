//! From hands to commands: one iteration of an input loop at a time.
//!
//! Pure: whoever owns a loop (the window, a script) calls [`TeleopClient::begin`] with the newest token *before* it drains its
//! queue of events, then hands over what was in the queue, then sends what [`TeleopClient::end`] returns, once. So the age that
//! the robot sees in a token is never less than that of the input that the command was made of, and a loop that hangs,
//! wherever it hangs, sends nothing or what the robot refuses. Design: "Teleop: never obey an old command"; bytes:
//! `SPEC.md`, sections 12 and 13.

mod estop;
mod incoming;
mod lease;
mod messages;
mod neutral_gate;
mod observer;
mod requests;
mod send_rate;
mod signing;
mod state;

use std::collections::VecDeque;
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::{OperatorId, RobotId};
use protocol::message::{AgeToken, Info, LeaseRequest, TeleopStatus, Velocity};
use protocol::tile::BootId;

use crate::identity::Identity;
use crate::teleop_input::{DriveInput, InputEvent, InputLockReason, TeleopInput};

pub use lease::Lease;
pub use messages::{
    Intent, LatestPose, NotSentReason, RequestKind, RequestNumber, SignedMessage, TeleopMessage,
    TeleopNotification,
};
pub use state::{EStopState, TeleopClientState};

use estop::PendingEStop;
use requests::Requests;
use send_rate::SendRateLimiter;

/// Without a token for so long the link is lost: longer than a jittery link pauses, shorter than an operator would take
/// for a pause. The robot has stopped long before.
const LINK_LOST: Duration = Duration::from_millis(600);
/// An iteration that takes longer was not one of a loop that runs 50 times a second.
const FROZEN: Duration = Duration::from_millis(300);
/// A stick that moves by less is not a change that is sent three times.
const CHANGE: f32 = 0.1;
/// Turning faster than this nobody steers by a picture that is as old as the link is slow, rad/s.
const MAX_TURN_RADPS: f32 = 1.5;
const MAX_NOTES: usize = 64;

/// One operator at the helm of one robot.
pub struct TeleopClient {
    robot: RobotId,
    identity: Identity,
    input: TeleopInput,
    /// What is asked for at most: speed, m/s, and turn rate, rad/s; zero until the robot has told.
    limits: [f32; 2],
    /// How hard it brakes in stops; zero until it has told.
    stop_decel: Velocity,
    /// As it was before the events of this iteration.
    newest: Option<LatestPose>,
    /// When the last pose came that was looked at.
    looked_at: Option<Monotonic>,
    boot: Option<BootId>,
    /// The newest grant of the lease that is known of, whoever's.
    epoch: u64,
    lease: Lease,
    /// The newest grant that was this console's, held or not.
    last_grant: Option<u64>,
    status: Option<TeleopStatus>,
    seq: u64,
    requests: Requests,
    numbers: u64,
    estop: Option<PendingEStop>,
    /// That the robot has refused to stop for this operator, until something shows that it would.
    estop_refused: Option<protocol::message::Refusal>,
    next_press: u64,
    send_rate: SendRateLimiter,
    sent: DriveInput,
    /// Since when nothing but neutral was sent under this grant.
    neutral_since: Option<Monotonic>,
    /// Until when what is sent finds the motors going, as the robot told last under this grant.
    moving_until: Option<Monotonic>,
    last_end: Option<Monotonic>,
    is_link_lost: bool,
    /// Whether somebody who only watches has tried to drive since the last iteration.
    has_attempted_to_drive: bool,
    notifications: VecDeque<(Monotonic, TeleopNotification)>,
    /// The last of them that the operator did not expect.
    notice: Option<(Monotonic, TeleopNotification)>,
}

impl TeleopClient {
    /// Nobody has the lease, and nothing is known of the robot. `random` makes presses of the emergency stop different
    /// from those of all other consoles.
    pub fn new(robot: RobotId, identity: Identity, random: u64) -> Self {
        Self {
            robot,
            identity,
            input: TeleopInput::default(),
            limits: [0.0; 2],
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
            send_rate: SendRateLimiter::new(Monotonic::default()),
            sent: DriveInput::NEUTRAL,
            neutral_since: None,
            moving_until: None,
            last_end: None,
            is_link_lost: false,
            has_attempted_to_drive: false,
            notifications: VecDeque::new(),
            notice: None,
        }
    }

    /// The robot tells what it can do: keys and sticks are shares of its greatest speed and turn rate.
    pub fn set_robot_info(&mut self, info: &Info) {
        let [speed_mps, turn_rate_radps] = info.limits.map(|limit| {
            if limit.is_finite() {
                limit.max(0.0)
            } else {
                0.0
            }
        });
        self.limits = [speed_mps, turn_rate_radps.min(MAX_TURN_RADPS)];
        self.stop_decel = Velocity {
            linear_mps: info.stop_decel_mps2,
            angular_radps: info.stop_decel_radps2,
        };
    }

    /// An iteration begins: the newest token, taken before the queue of events is drained.
    pub fn begin(&mut self, newest: Option<LatestPose>, now: Monotonic) {
        if let Some(newest) = newest
            && self.looked_at != Some(newest.at)
        {
            self.looked_at = Some(newest.at);
            self.on_boot(newest.boot, now);
            self.newest = Some(newest);
        }
    }

    /// Something of the queue.
    pub fn apply(&mut self, event: InputEvent) {
        self.input.apply(event);
        self.detect_drive_attempt(event);
    }

    /// The queue is drained: what is to be sent now, in this order.
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

    /// The last words of a console that is closed: an emergency stop that is on its way once more, zero, and the lease
    /// back, or wanted no longer.
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
        // Also where it is waited for, or asked for: it would be given to nobody.
        if self.lease != Lease::None || self.requests.asks_for_lease() {
            let number = self.number();
            messages.extend(self.signed(token, &LeaseRequest::Release, Some(number)));
            self.lease = Lease::None;
        }
        messages
    }

    /// When the next iteration is due without any event; `None` where nothing is to be done by itself.
    pub fn due(&self, now: Monotonic) -> Option<Monotonic> {
        let drive = self.lease.held().map(|_| self.send_rate.due());
        let estop = self.estop.as_ref().map(|pending| pending.due(now));
        let estop = estop.filter(|_| self.boot.is_some());
        let request = self.requests.due(now);
        [drive, estop, request].into_iter().flatten().min()
    }

    /// What the operator wants besides moving.
    pub fn submit(&mut self, intent: Intent, now: Monotonic) {
        if self.rejects(&intent, now) {
            return;
        }
        let asked = match intent {
            Intent::EStop => return self.input.apply(InputEvent::EStop),
            Intent::Step(step) => return self.input.apply(InputEvent::Step(step)),
            Intent::Reset(estop) => RequestKind::Reset(estop),
            Intent::Set(setting) => RequestKind::Set(setting),
            Intent::Lease(request) => {
                if request == LeaseRequest::Release {
                    self.end_lease(TeleopNotification::LeaseReleased, now);
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

    /// Whether this console has the lease.
    pub const fn is_driving(&self) -> bool {
        self.lease.held().is_some()
    }

    /// Who drives.
    pub const fn operator(&self) -> &OperatorId {
        &self.identity.operator
    }

    /// Notes that were taken since the last call, oldest first.
    pub fn take_notifications(&mut self) -> VecDeque<(Monotonic, TeleopNotification)> {
        std::mem::take(&mut self.notifications)
    }

    fn update_input_lock(&mut self, now: Monotonic) {
        let is_held = self.lease.held().is_some();
        // Input that came while this program was suspended is as old as that, whenever it is read.
        let is_frozen = self
            .last_end
            .is_some_and(|last| now.since(last) > FROZEN.max(send_rate::PERIOD));
        if is_held && is_frozen {
            self.lock_input(InputLockReason::LoopStalled, now);
        }
        let was_lost = self.is_link_lost;
        self.is_link_lost = self
            .newest
            .is_none_or(|newest| now.since(newest.at) > LINK_LOST);
        if is_held && self.is_link_lost {
            if was_lost {
                self.neutral_since = None;
                self.input.lock_input(InputLockReason::Link);
            } else {
                self.lock_input(InputLockReason::Link, now);
            }
        }
        if !is_held {
            self.input.lock_input(InputLockReason::Lease);
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
        // An odd step visits every number before it comes back.
        self.next_press = self.next_press.wrapping_add(0x9E37_79B9_7F4A_7C15);
        self.notify(now, TeleopNotification::EStopPressed);
    }

    /// By both ways, lest one is closed; its token may be of any age, or none.
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
        let drive_input = self.drive_input(now);
        let is_changed = drive_input.is_neutral() != self.sent.is_neutral()
            || (drive_input.forward - self.sent.forward).abs() >= CHANGE
            || (drive_input.left - self.sent.left).abs() >= CHANGE;
        if !self.send_rate.is_due(now, is_changed) {
            return;
        }
        self.sent = drive_input;
        if drive_input.is_neutral() {
            self.neutral_since.get_or_insert(now);
        } else {
            self.neutral_since = None;
        }
        let drive = self.command(drive_input);
        messages.extend(self.signed(token, &drive, None));
    }

    fn lock_input(&mut self, loss: InputLockReason, now: Monotonic) {
        let was_asking = !self.input.drive_input().is_neutral();
        self.input.lock_input(loss);
        self.neutral_since = None;
        if was_asking {
            self.notify(now, TeleopNotification::InputLocked(loss));
        }
    }

    fn warn(&mut self, now: Monotonic, note: TeleopNotification) {
        self.notice = Some((now, note.clone()));
        self.notify(now, note);
    }

    fn notify(&mut self, now: Monotonic, note: TeleopNotification) {
        tracing::debug!(?note, "teleop");
        if self.notifications.len() == MAX_NOTES {
            self.notifications.pop_front();
        }
        self.notifications.push_back((now, note));
    }
}

#[cfg(test)]
mod tests;
