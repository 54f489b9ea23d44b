//! The state machine: from one event to the next state, and to what is to be done.
//!
//! "States": which there are, what the motors are told in each, and how each is left. Every transition is an exhaustive
//! `match` on [`Mode`] in one of the files below, ordered by what happens: time passes (`output`), commands come
//! (`commands`), the lease changes (`lease_requests`), somebody stops or resets the vehicle (`stops`).

use std::time::Duration;

use super::action::{Action, Actions, ArbiterEvent};
use super::age_window::AgeWindow;
use super::arming::Arming;
use super::config::Rules;
use super::emergency_stop::{EStop, EStopId};
use super::input::ArbiterInput;
use super::lease::{Lease, LeaseEnd};
use super::motion::Motion;
use super::operator::RequestId;
use super::refusal::Counters;
use super::report::Clamp;
use super::speed_limits::CollisionMonitorOutput;
use super::token::TokenRing;
use super::velocity::Velocity;
use measurement::time::Monotonic;

mod commands;
mod lease_requests;
mod output;
mod stops;

/// How long the guard's word holds. It speaks in every round, so that this only ends where it has died.
const MONITOR_TIMEOUT: Duration = Duration::from_millis(300);

/// How soon after the start of a stop commands that are young again may take it back.
const RESUME_WINDOW: Duration = Duration::from_millis(200);

/// What the vehicle is doing ("States").
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mode {
    /// The self-test runs. Output: zero.
    SafeBoot,
    /// Nobody drives. Output: zero, sent all the same.
    Idle,
    /// Somebody holds the lease. Output: zero, sent all the same.
    Held,
    /// Somebody drives. Output: as asked, within every limit.
    Driving,
    /// The output follows the stopping ramp.
    Stopping {
        /// Why.
        reason: StopReason,
        /// Since when.
        since: Monotonic,
    },
    /// Somebody stopped the vehicle. Output: zero, until a reset.
    EStop,
    /// The vehicle cannot be trusted. Output: zero, until somebody at the vehicle resets it.
    Fault(FaultReason),
}

/// Why a vehicle that was driven stops.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StopReason {
    /// Nothing is pressed any more.
    Released,
    /// The last command is too old (P1).
    Age,
    /// A command asked for what is no number.
    NotFinite,
    /// The collision monitor knows too little, or says nothing.
    CollisionMonitorStale,
    /// Who drove no longer holds the lease.
    LeaseEnded(LeaseEnd),
}

impl StopReason {
    /// Whether the operator asked for it.
    pub const fn is_voluntary(self) -> bool {
        match self {
            Self::Released => true,
            Self::Age | Self::NotFinite | Self::CollisionMonitorStale => false,
            Self::LeaseEnded(why) => match why {
                LeaseEnd::Released | LeaseEnd::Renewed | LeaseEnd::HandedOver | LeaseEnd::Reset => {
                    true
                }
                LeaseEnd::Expired | LeaseEnd::TakenOver | LeaseEnd::Revoked | LeaseEnd::Fault => {
                    false
                }
            },
        }
    }

    /// Whether commands that come in time take it back: where the vehicle waited for them, or a key was let go
    /// for a moment.
    const fn is_recoverable(self) -> bool {
        match self {
            Self::Released | Self::Age => true,
            Self::NotFinite | Self::CollisionMonitorStale | Self::LeaseEnded(_) => false,
        }
    }
}

/// Why the vehicle cannot be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FaultReason {
    /// The self-test failed.
    SelfTest,
    /// The motors do not do what they are told, or cannot be told.
    Actuator,
}

/// Everything the arbiter remembers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArbiterState {
    pub(super) mode: Mode,
    /// The latest moment that an event brought. Time does not go back, whatever the caller says.
    pub(super) now: Monotonic,
    pub(super) last_tick: Option<Monotonic>,
    pub(super) tokens: TokenRing,
    pub(super) lease: Lease,
    pub(super) stream: CommandStream,
    pub(super) motion: Motion,
    pub(super) clamp: Option<Clamp>,
    pub(super) collision_monitor: Option<(CollisionMonitorOutput, Monotonic)>,
    pub(super) measured: Option<Velocity>,
    pub(super) estop: Option<EStop>,
    pub(super) last_estop: EStopId,
    pub(super) counters: Counters,
}

/// The holder's commands under one grant of the lease.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub(super) struct CommandStream {
    /// The greatest sequence number taken.
    pub(super) last_seq: Option<u64>,
    /// When the token of the last command taken was issued.
    pub(super) issued: Option<Monotonic>,
    pub(super) requested: Velocity,
    pub(super) arming: Arming,
    pub(super) ages: AgeWindow,
}

impl CommandStream {
    /// An upper bound on the age of the command in force.
    pub(super) fn age(&self, now: Monotonic) -> Option<Duration> {
        self.issued.map(|issued| now.since(issued))
    }
}

impl ArbiterState {
    /// The state at the start: [`Mode::SafeBoot`]. `boot_id` must be random.
    pub fn new(boot_id: u128) -> Self {
        Self {
            mode: Mode::SafeBoot,
            now: Monotonic::default(),
            last_tick: None,
            tokens: TokenRing::new(boot_id),
            lease: Lease::default(),
            stream: CommandStream::default(),
            motion: Motion::default(),
            clamp: None,
            collision_monitor: None,
            measured: None,
            estop: None,
            last_estop: EStopId(0),
            counters: Counters::default(),
        }
    }

    /// What the vehicle is doing.
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// The tokens issued so far.
    pub const fn tokens(&self) -> &TokenRing {
        &self.tokens
    }

    pub(super) fn clamp_time(&self, now: Monotonic) -> Monotonic {
        self.now.max(now)
    }

    /// The guard's last word, unless it has been silent since.
    pub(super) fn monitor_output(&self, now: Monotonic) -> Option<CollisionMonitorOutput> {
        let (output, received_at) = self.collision_monitor?;
        (now.since(received_at) <= MONITOR_TIMEOUT).then_some(output)
    }
}

/// What follows from `input` at the moment `now`: the state after it, and what is to be done.
pub fn step(
    rules: &Rules,
    state: ArbiterState,
    now: Monotonic,
    input: ArbiterInput,
) -> (ArbiterState, Actions) {
    let now = state.clamp_time(now);
    let mut step = Step {
        rules,
        now,
        state: ArbiterState { now, ..state },
        actions: Actions::new(Velocity::ZERO),
        notified: state.mode,
    };
    match input {
        ArbiterInput::Tick => step.tick(),
        ArbiterInput::Token { nonce } => {
            let token = step.state.tokens.issue(now, nonce);
            step.actions.push(Action::PublishToken(token));
        }
        ArbiterInput::Command { role, command } => step.command(role, &command),
        ArbiterInput::Rejected(refusal) => step.state.counters.refuse(refusal),
        ArbiterInput::Lease {
            caller,
            token,
            verb,
        } => step.lease_request(caller, token, verb),
        ArbiterInput::Revoked(operator) => step.revoke(operator),
        ArbiterInput::EStop(caller) => step.estop_request(caller),
        ArbiterInput::LocalEStop => step.local_estop(),
        ArbiterInput::EStopStored(id) => step.estop_stored(id),
        ArbiterInput::Reset { caller, token, id } => step.reset_request(caller, token, id),
        ArbiterInput::LocalReset => step.local_reset(),
        ArbiterInput::SelfTest { has_passed, stored } => step.finish_self_test(has_passed, stored),
        ArbiterInput::CollisionMonitor(output) => {
            step.state.collision_monitor = Some((output, now));
        }
        ArbiterInput::Measured(velocity) => {
            step.state.measured = velocity.is_finite().then_some(velocity);
        }
        ArbiterInput::ActuatorFault => step.fail(FaultReason::Actuator),
    }
    step.notify_mode_change();
    step.actions.output = step.state.motion.velocity();
    (step.state, step.actions)
}

/// One step under way.
struct Step<'a> {
    rules: &'a Rules,
    now: Monotonic,
    state: ArbiterState,
    actions: Actions,
    /// What people know of the mode.
    notified: Mode,
}

impl Step<'_> {
    fn notify_mode_change(&mut self) {
        let (from, to) = (self.notified, self.state.mode);
        if from != to {
            self.notified = to;
            self.notify(ArbiterEvent::ModeChanged { from, to });
        }
    }

    fn notify(&mut self, event: ArbiterEvent) {
        self.actions.push(Action::Notify(event));
    }

    fn answer(&mut self, request: RequestId, answer: super::Answer) {
        self.actions.push(Action::Answer { request, answer });
    }

    /// Begins to follow the stopping ramp.
    fn begin_stop(&mut self, reason: StopReason) {
        if !reason.is_voluntary() {
            let stops = &mut self.state.counters.involuntary_stops;
            *stops = stops.saturating_add(1);
        }
        self.state.mode = Mode::Stopping {
            reason,
            since: self.now,
        };
        // A stop may be over within this step, where the process stood still meanwhile: its reason is told all the same.
        self.notify_mode_change();
        self.state.stream.arming = match reason {
            StopReason::Released => Arming::Neutral { since: self.now },
            StopReason::Age
            | StopReason::NotFinite
            | StopReason::CollisionMonitorStale
            | StopReason::LeaseEnded(_) => Arming::Locked,
        };
    }

    /// Zero at once, and nothing pressed counts any more.
    fn halt(&mut self) {
        self.state.motion = Motion::default();
        self.state.clamp = None;
        self.state.stream.requested = Velocity::ZERO;
        self.state.stream.arming = Arming::Locked;
    }

    /// Whether the guard knows enough to drive by.
    fn monitor_is_available(&self) -> bool {
        match self.state.monitor_output(self.now) {
            None | Some(CollisionMonitorOutput::Stale) => false,
            Some(CollisionMonitorOutput::Off | CollisionMonitorOutput::Limits(_)) => true,
        }
    }
}

#[cfg(test)]
mod tests;
