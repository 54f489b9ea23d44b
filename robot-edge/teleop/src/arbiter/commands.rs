//! Commands come: which are obeyed, and what they change.

use std::time::Duration;

use super::{ArbiterState, Mode, RESUME_WINDOW, Step, StopReason};
use crate::arming::Arming;
use crate::command::DriveCommand;
use crate::config::Rules;
use crate::emergency_stop::EStopSource;
use crate::operator::Role;
use crate::refusal::Refusal;
use measurement::time::Monotonic;

impl ArbiterState {
    /// Whether a command would be obeyed, and an upper bound on its age: all that is cheaper to find out than whether
    /// its signature is right, in the order of "Security".
    ///
    /// A command with [`DriveCommand::estop`] is for [`super::step`] whatever this says, once its signature is right.
    pub fn precheck(
        &self,
        rules: &Rules,
        now: Monotonic,
        role: Role,
        command: &DriveCommand,
    ) -> Result<Duration, Refusal> {
        let now = self.clamp_time(now);
        if !role.may_drive() {
            return Err(Refusal::Role);
        }
        let age = self.tokens.age(command.token, now)?;
        if age > rules.max_age {
            return Err(Refusal::TooOld);
        }
        if !self.lease.is_held_by(command.operator) {
            return Err(Refusal::NotHolder);
        }
        if command.epoch != self.lease.epoch {
            return Err(Refusal::OtherEpoch);
        }
        if self.stream.last_seq.is_some_and(|last| command.seq <= last) {
            return Err(Refusal::OldSequence);
        }
        Ok(age)
    }
}

impl Step<'_> {
    pub(super) fn command(&mut self, role: Role, command: &DriveCommand) {
        if command.estop && role.may_drive() {
            self.emergency_stop(Some(EStopSource::Operator(command.operator)));
            return;
        }
        match self.state.precheck(self.rules, self.now, role, command) {
            Err(refusal) => self.state.counters.refuse(refusal),
            Ok(age) => self.accept(command, age),
        }
    }

    /// Takes a command of the holder that is young, in sequence and of the newest grant.
    fn accept(&mut self, command: &DriveCommand, age: Duration) {
        let stream = &mut self.state.stream;
        stream.last_seq = Some(command.seq);
        if !command.requested.is_finite() {
            self.state.counters.refuse(Refusal::NotFinite);
            self.handle_invalid_command();
            return;
        }
        self.state.counters.accepted = self.state.counters.accepted.saturating_add(1);
        self.state.lease.renew(self.now);
        // The one that ends counts up to now, the new one from now on.
        if let Some(last) = stream.age(self.now) {
            stream.ages.record(self.now, last.min(self.rules.max_age));
        }
        stream.ages.record(self.now, age);
        stream.requested = command.requested;
        // `issued` is never `now - age` of a saturated clock: the ring holds the moment itself.
        stream.issued = self.state.tokens.issued(command.token, self.now).ok();

        let is_neutral = command.requested.is_neutral();
        stream.arming = if is_neutral {
            stream.arming.after_neutral(self.now)
        } else {
            stream.arming.after_press(self.now, self.rules.neutral)
        };
        match self.state.mode {
            Mode::Held if self.state.stream.arming == Arming::Pressed => {
                if self.monitor_is_available() {
                    self.state.mode = Mode::Driving;
                } else {
                    // It must not start by itself once the guard sees again.
                    self.state.stream.arming = Arming::Locked;
                }
            }
            Mode::Driving if is_neutral => self.begin_stop(StopReason::Released),
            Mode::Stopping { reason, since }
                if !is_neutral && reason.is_recoverable() && self.can_resume(since) =>
            {
                self.state.mode = Mode::Driving;
                self.state.stream.arming = Arming::Pressed;
            }
            Mode::SafeBoot
            | Mode::Idle
            | Mode::Held
            | Mode::Driving
            | Mode::Stopping { .. }
            | Mode::EStop
            | Mode::Fault(_) => {}
        }
    }

    /// The holder's console talks nonsense: the vehicle stops, and nothing pressed counts any more.
    fn handle_invalid_command(&mut self) {
        self.state.stream.arming = Arming::Locked;
        let reason = StopReason::NotFinite;
        match self.state.mode {
            Mode::Driving => self.begin_stop(reason),
            Mode::Stopping { since, .. } => self.state.mode = Mode::Stopping { reason, since },
            Mode::SafeBoot | Mode::Idle | Mode::Held | Mode::EStop | Mode::Fault(_) => {}
        }
    }

    /// Whether a stop that began at `since` may be taken back: early, while the vehicle still moves.
    fn can_resume(&self, since: Monotonic) -> bool {
        self.now.since(since) <= RESUME_WINDOW
            && !self.state.motion.is_zero()
            && self.monitor_is_available()
    }
}
