//! Effects of the robot's messages on lease, emergency stop and input.

use measurement::time::Monotonic;
use protocol::message::{Answer, GoalStatus, LeaseRequest, StopReason, TeleopState, TeleopStatus};
use protocol::tile::BootId;

use super::TeleopClient;
use super::drive_commands::{DriveCommands, moving_until};
use super::estop::{EStopOutcome, PendingEStop};
use super::goal::GoalNews;
use super::lease::{Lease, LeaseChange};
use super::messages::{RequestKind, RequestNumber, TeleopMessage, TeleopNotification};
use crate::teleop_input::InputLockReason;

impl TeleopClient {
    pub fn receive(&mut self, message: TeleopMessage, now: Monotonic) {
        match message {
            TeleopMessage::Status { boot, teleop } => {
                self.on_boot(boot, now);
                match teleop {
                    Some(status) => self.on_status(*status, now),
                    None => self.on_not_drivable(now),
                }
            }
            TeleopMessage::Answer {
                request,
                boot,
                answer,
            } => {
                if self.boot == Some(boot) {
                    self.on_answer(request, answer, now);
                }
            }
            TeleopMessage::NoAnswer { request } => {
                if let Some(asked) = self.requests.take(request) {
                    self.warn(now, TeleopNotification::RequestTimedOut(asked));
                }
            }
        }
    }

    /// All state of the last run is void, except an unacknowledged emergency stop.
    pub(super) fn on_boot(&mut self, boot: BootId, now: Monotonic) {
        if self.boot == Some(boot) {
            return;
        }
        let was_known = self.boot.replace(boot).is_some();
        self.epoch = 0;
        self.last_grant = None;
        self.newest = None;
        self.status = None;
        self.drive_commands.moving_until = None;
        self.estop_refused = None;
        if let Some(estop) = &self.estop {
            self.estop = Some(PendingEStop::new(estop.body().press, None, estop.since));
        }
        if was_known {
            let unanswered: Vec<RequestKind> = self.requests.clear().collect();
            for asked in unanswered {
                self.warn(now, TeleopNotification::RequestTimedOut(asked));
            }
            self.lock_input(InputLockReason::Robot);
        }
        if self.lease.held().is_some() {
            self.lease = Lease::None;
            self.warn(now, TeleopNotification::LeaseLost);
        }
        self.lose_lease();
    }

    /// The robot cannot be driven, so it cannot be stopped either.
    fn on_not_drivable(&mut self, now: Monotonic) {
        self.status = None;
        self.drive_commands.moving_until = None;
        if self.estop.take().is_some() {
            self.warn(now, TeleopNotification::NotDrivable);
        }
    }

    fn on_status(&mut self, status: TeleopStatus, now: Monotonic) {
        self.epoch = self.epoch.max(status.lease.epoch);
        match self
            .lease
            .receive(&status.lease, &self.identity.operator, now)
        {
            Some(LeaseChange::Gained(epoch)) => self.gain_lease(epoch, InputLockReason::Lease, now),
            Some(LeaseChange::Lost) => {
                self.lease = Lease::None;
                self.lock_input_with_lease();
                let note = self.lease_loss(&status);
                self.warn(now, note);
            }
            None => {}
        }
        if let Some(number) = self
            .estop
            .as_ref()
            .and_then(|pending| pending.is_acknowledged_by(status.estop))
        {
            self.acknowledge_estop(number);
        }
        if status.estop.is_some() {
            self.clear_not_in_force_notice();
        }
        self.take_goal_status(&status.goal, now);
        let before = self.status.as_ref().map(|status| status.state);
        match status.state {
            TeleopState::SafeBoot | TeleopState::EStop | TeleopState::Fault(_) => {
                self.lock_input(InputLockReason::Stopped);
            }
            TeleopState::Idle | TeleopState::Held => {
                let moved = matches!(
                    before,
                    Some(TeleopState::Driving | TeleopState::Stopping(_))
                );
                // An operator who released and pressed again meanwhile was not stopped involuntarily.
                if moved && status.last_stop != Some(StopReason::Released) {
                    self.lock_input(InputLockReason::Stopped);
                }
            }
            TeleopState::Driving | TeleopState::Stopping(_) => {}
        }
        let is_mine = self.lease.held() == Some(status.lease.epoch);
        self.drive_commands.moving_until =
            moving_until(&status, self.stop_decel, now).filter(|_| is_mine);
        self.status = Some(status);
    }

    /// A goal that has ended is named no more: the robot would not start it again.
    fn take_goal_status(&mut self, status: &GoalStatus, now: Monotonic) {
        self.drive_commands.is_goal_running = status.running.is_some();
        let Some(goal) = &mut self.goal else {
            return;
        };
        match goal.receive(status, now) {
            GoalNews::Goes => {}
            GoalNews::Ended => {
                self.goal = None;
                self.notify(TeleopNotification::GoalEnded(status.last_end));
            }
            GoalNews::NotStarted => {
                self.goal = None;
                self.warn(now, TeleopNotification::GoalNotStarted);
            }
        }
    }

    pub(super) fn clear_not_in_force_notice(&mut self) {
        if matches!(self.notice, Some((_, TeleopNotification::EStopNotInForce))) {
            self.notice = None;
        }
    }

    fn lease_loss(&self, status: &TeleopStatus) -> TeleopNotification {
        let was_stopped = self.status.as_ref().is_some_and(|was| was.estop.is_some());
        let is_reset = was_stopped && status.estop.is_none() && status.lease.holder.is_none();
        if is_reset {
            TeleopNotification::LeaseEndedByReset
        } else {
            TeleopNotification::LeaseLost
        }
    }

    fn on_answer(&mut self, request: RequestNumber, answer: Answer, now: Monotonic) {
        if self
            .estop
            .as_ref()
            .is_some_and(|pending| pending.is_mine(request))
        {
            match PendingEStop::answered(answer) {
                Some(EStopOutcome::Stopped(number)) => self.acknowledge_estop(number),
                Some(EStopOutcome::NotInForce) => {
                    self.estop = None;
                    self.warn(now, TeleopNotification::EStopNotInForce);
                }
                Some(EStopOutcome::Refused(refusal)) => {
                    self.estop = None;
                    self.estop_refused = Some(refusal);
                    self.notify(TeleopNotification::EStopRefused(refusal));
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
                RequestKind::Lease(LeaseRequest::Request | LeaseRequest::TakeOver),
                Answer::Granted(epoch),
            ) => {
                self.notify(TeleopNotification::Answered(asked, answer));
                // A holder who renews the lease already drove with the pressed keys.
                let loss = if self.lease.held().is_some() {
                    InputLockReason::LeaseRenewed
                } else {
                    InputLockReason::Lease
                };
                self.gain_lease(epoch, loss, now);
                return;
            }
            (
                RequestKind::Lease(LeaseRequest::Request | LeaseRequest::TakeOver),
                Answer::Waiting,
            ) => {
                self.lose_lease();
                self.lease = Lease::Waiting {
                    after: self.epoch,
                    since: now,
                };
            }
            (RequestKind::Lease(LeaseRequest::HandOver(_)), Answer::Done | Answer::Waiting) => {
                self.lose_lease();
            }
            (RequestKind::Lease(_) | RequestKind::Reset(_) | RequestKind::Set(_), _) => {}
        }
        let note = TeleopNotification::Answered(asked, answer);
        let is_of_reset = matches!(
            self.notice,
            Some((_, TeleopNotification::LeaseEndedByReset))
        );
        if matches!(answer, Answer::Refused(_)) {
            self.warn(now, note);
        } else {
            // A status may overtake the answer to a reset: its notice stays.
            if !(is_of_reset
                && matches!(note, TeleopNotification::Answered(RequestKind::Reset(_), _)))
            {
                self.notice = None;
            }
            self.notify(note);
        }
    }

    /// Takes a new grant. Input from before it is locked.
    fn gain_lease(&mut self, epoch: u64, loss: InputLockReason, now: Monotonic) {
        self.notice = None;
        self.estop_refused = None;
        self.epoch = self.epoch.max(epoch);
        self.lease = Lease::Held(epoch);
        self.last_grant = Some(epoch);
        self.drive_commands = DriveCommands::new(now);
        // The loop was not due before.
        self.last_end = None;
        self.lock_input(loss);
        self.notify(TeleopNotification::LeaseGained(epoch));
    }

    pub(super) fn lose_lease(&mut self) {
        self.end_lease(TeleopNotification::LeaseLost);
    }

    pub(super) fn end_lease(&mut self, why: TeleopNotification) {
        let was_held = self.lease.held().is_some();
        self.lease = Lease::None;
        self.lock_input_with_lease();
        if was_held {
            self.notify(why);
        }
    }

    /// Locks the input without a notice: the end of the lease has its own.
    fn lock_input_with_lease(&mut self) {
        self.input.lock_input(InputLockReason::Lease);
        self.drive_commands.interrupt();
    }

    fn acknowledge_estop(&mut self, number: u64) {
        self.estop = None;
        self.estop_refused = None;
        self.clear_not_in_force_notice();
        self.notify(TeleopNotification::EStopAcknowledged(number));
    }
}
