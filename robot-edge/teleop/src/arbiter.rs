//! The state machine of driving: one input gives the next state and the actions.
//!
//! Every transition is an exhaustive `match` on [`Mode`]. This file has the state, ticks and drive commands; `requests`
//! has the lease, emergency stops, faults and resets.

use std::time::Duration;

use crate::command_stream::{ArmingState, CommandStream, DriveCommand};
use crate::config::Rules;
use crate::interface::{Action, Actions, ArbiterEvent, ArbiterInput, CollisionMonitorOutput};
use crate::lease::{EStop, EStopId, EStopSource, Lease, RequestId, Role};
use crate::locomotion::LocomotionMode;
use crate::motion::{Caps, Motion, MotionCaps, MotionTarget, Velocity};
use crate::report::Counters;
use crate::token::TokenRing;
use measurement::time::Monotonic;
use protocol::message::{
    Answer, Clamp, DockingChoice, FaultReason, GoalEnd, LeaseEnd, Refusal, StopReason, TeleopState,
};

mod goal;
mod requests;

pub(crate) use goal::{PLANNING_TIME, RunningGoal};

/// Validity of an output of the collision monitor. It gives one in each round, so it expires only after a failure.
const MONITOR_TIMEOUT: Duration = Duration::from_millis(300);

/// How long after the start of a stop commands with an allowed age may end it, so that driving resumes.
const RESUME_WINDOW: Duration = Duration::from_millis(200);

/// What the vehicle is doing (docs/safety.md).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mode {
    /// The self-test runs. Output: zero.
    SafeBoot,
    /// No operator drives. Output: zero, sent in each round.
    Idle,
    /// An operator holds the lease. Output: zero, sent in each round.
    Held,
    /// An operator drives. Output: the requested velocity within all limits.
    Driving,
    /// The output follows the stopping ramp.
    Stopping {
        /// Why.
        reason: StopReason,
        /// Since when.
        since: Monotonic,
    },
    /// Emergency stop. Output: zero until a reset.
    EStop,
    /// The vehicle is not safe to drive. Output: zero until a reset at the vehicle.
    Fault(FaultReason),
}

impl Mode {
    /// The state as consoles get it.
    pub const fn teleop_state(self) -> TeleopState {
        match self {
            Self::SafeBoot => TeleopState::SafeBoot,
            Self::Idle => TeleopState::Idle,
            Self::Held => TeleopState::Held,
            Self::Driving => TeleopState::Driving,
            Self::Stopping { reason, .. } => TeleopState::Stopping(reason),
            Self::EStop => TeleopState::EStop,
            Self::Fault(reason) => TeleopState::Fault(reason),
        }
    }
}

/// Whether driving may resume after a stop for this reason: commands were late, or a key was released briefly.
const fn is_recoverable(reason: StopReason) -> bool {
    match reason {
        StopReason::Released | StopReason::Age => true,
        StopReason::NotFinite
        | StopReason::CollisionMonitorStale
        | StopReason::LeaseEnded(_)
        | StopReason::MotorsHeld
        | StopReason::PlannerSilent
        | StopReason::PlannerFloods => false,
    }
}

/// Everything the arbiter remembers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArbiterState {
    pub(super) mode: Mode,
    /// The latest time of an input. Time never goes back, whatever the caller passes.
    pub(super) now: Monotonic,
    pub(super) last_tick: Option<Monotonic>,
    pub(super) tokens: TokenRing,
    pub(super) lease: Lease,
    pub(super) stream: CommandStream,
    pub(super) goal: Option<RunningGoal>,
    pub(super) last_goal_end: Option<GoalEnd>,
    pub(super) motion: Motion,
    /// How the wheels are set; `None` before the first motion.
    pub(super) locomotion: Option<LocomotionMode>,
    /// Since when the output is zero; `None` while it is not.
    pub(super) standing_since: Option<Monotonic>,
    pub(super) clamp: Option<Clamp>,
    pub(super) collision_monitor: Option<(CollisionMonitorOutput, Monotonic)>,
    pub(super) measured: Option<Velocity>,
    pub(super) estop: Option<EStop>,
    pub(super) last_estop: EStopId,
    pub(super) counters: Counters,
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
            goal: None,
            last_goal_end: None,
            motion: Motion::default(),
            locomotion: None,
            standing_since: None,
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

    /// What is requested, as far as the wheels are set for it: what the collision monitor is to judge.
    pub fn possible_request(&self) -> Velocity {
        let requested = self.stream.requested;
        self.locomotion
            .map_or(requested, |mode| mode.part_of(requested))
    }

    /// The docking site into whose vegetation the vehicle may push now: while it is driven, and as long as the last
    /// command names it.
    pub fn docking(&self) -> Option<DockingChoice> {
        self.stream.docking.filter(|_| self.mode == Mode::Driving)
    }

    pub(super) fn clamp_time(&self, now: Monotonic) -> Monotonic {
        self.now.max(now)
    }

    /// The last output of the collision monitor, unless it has expired.
    pub(super) fn monitor_output(&self, now: Monotonic) -> Option<CollisionMonitorOutput> {
        let (output, received_at) = self.collision_monitor?;
        (now.since(received_at) <= MONITOR_TIMEOUT).then_some(output)
    }
}

/// Applies `input` at time `now`: returns the next state and the actions.
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
        ArbiterInput::MotorsHeld => step.stop_and_lock(StopReason::MotorsHeld),
        ArbiterInput::Planned { velocity, arrived } => step.planned(velocity, arrived),
        ArbiterInput::PlannerFloods => step.planner_floods(),
    }
    step.notify_mode_change();
    step.actions.output = step.state.motion.velocity();
    (step.state, step.actions)
}

struct Step<'a> {
    rules: &'a Rules,
    now: Monotonic,
    state: ArbiterState,
    actions: Actions,
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

    fn answer(&mut self, request: RequestId, answer: Answer) {
        self.actions.push(Action::Answer { request, answer });
    }

    fn begin_stop(&mut self, reason: StopReason) {
        self.end_goal_for(reason);
        // A planner that has arrived sends zero and falls silent.
        let is_at_goal =
            reason == StopReason::PlannerSilent && self.state.stream.requested.is_neutral();
        if !reason.is_voluntary() && !is_at_goal {
            let stops = &mut self.state.counters.involuntary_stops;
            *stops = stops.saturating_add(1);
        }
        self.state.mode = Mode::Stopping {
            reason,
            since: self.now,
        };
        // After a suspension of the process a stop may begin and end within this step; its reason is reported in any
        // case.
        self.notify_mode_change();
        self.state.stream.arming = match reason {
            StopReason::Released => ArmingState::Neutral { since: self.now },
            StopReason::Age
            | StopReason::NotFinite
            | StopReason::CollisionMonitorStale
            | StopReason::LeaseEnded(_)
            | StopReason::MotorsHeld
            | StopReason::PlannerSilent
            | StopReason::PlannerFloods => ArmingState::Locked,
        };
    }

    /// Zero at once; keys that are pressed now have no effect.
    fn halt(&mut self, goal_end: GoalEnd) {
        self.end_goal(goal_end);
        self.state.motion = Motion::default();
        self.state.clamp = None;
        self.state.stream.requested = Velocity::ZERO;
        self.state.stream.arming = ArmingState::Locked;
    }

    /// Whether the collision monitor is off or has limits.
    fn monitor_is_available(&self) -> bool {
        match self.state.monitor_output(self.now) {
            None | Some(CollisionMonitorOutput::Stale) => false,
            Some(CollisionMonitorOutput::Off | CollisionMonitorOutput::Limits(_)) => true,
        }
    }
}

/// Smallest age used as a divisor.
const MIN_AGE: Duration = Duration::from_millis(1);

const STORE_RETRY: Duration = Duration::from_secs(1);

/// Differences between requested and applied velocity below this have no clamp, metres or radians per second.
const SPEED_TOLERANCE: f64 = 1e-3;

impl ArbiterState {
    /// The speed at which the vehicle travels `max_latency_travel_m` within the greatest age of the last second, metres
    /// per second. If no age is known, the greatest allowed one is assumed.
    pub(crate) fn speed_allowed_mps(&self, rules: &Rules, now: Monotonic) -> f64 {
        let age = self.stream.ages.peak(now).unwrap_or(rules.max_age);
        rules.max_latency_travel_m / age.max(MIN_AGE).as_secs_f64()
    }
}

/// What a limit of the speed over ground leaves for each of the axes x and y, metres per second: where both are in use,
/// they stay below it together.
pub(crate) fn axis_cap_mps(cap_mps: f64, motion: Velocity, target: Velocity) -> f64 {
    let is_used = |one: f64, other: f64| one.abs().max(other.abs()) > 0.0;
    if is_used(motion.linear_mps, target.linear_mps)
        && is_used(motion.lateral_mps, target.lateral_mps)
    {
        cap_mps * std::f64::consts::FRAC_1_SQRT_2
    } else {
        cap_mps
    }
}

impl Step<'_> {
    pub(super) fn tick(&mut self) {
        let last_tick = self.state.last_tick.replace(self.now);
        let dt = last_tick.map_or(Duration::ZERO, |last| self.now.since(last));
        self.state
            .lease
            .expire_request(self.now, self.rules.request_timeout);
        self.check_age();
        if self.state.lease.is_expired(self.now, self.rules.lease) {
            self.end_lease(LeaseEnd::Expired, None);
        }
        self.check_monitor();
        self.check_planner();
        match self.state.mode {
            Mode::SafeBoot | Mode::Idle | Mode::Held | Mode::EStop | Mode::Fault(_) => {
                self.state.motion = Motion::default();
                self.state.clamp = None;
            }
            Mode::Driving => self.drive(dt),
            Mode::Stopping { .. } => {
                self.state.motion = self.state.motion.stopping(dt, &self.rules.limits);
                self.state.clamp = None;
                if self.state.motion.is_zero() {
                    self.enter_standstill();
                }
            }
        }
        let is_standing = self.state.motion.is_zero();
        self.state.standing_since =
            is_standing.then(|| self.state.standing_since.unwrap_or(self.now));
        self.retry_estop_store();
    }

    /// Records the age of the command in force. If it is too old, the vehicle stops, and pressed keys have no effect.
    fn check_age(&mut self) {
        let Some(age) = self.state.stream.age(self.now) else {
            return;
        };
        let most = self.rules.max_age;
        self.state.stream.ages.record(self.now, age.min(most));
        if age > most {
            self.state.stream.arming = ArmingState::Locked;
            if self.state.mode == Mode::Driving {
                self.begin_stop(StopReason::Age);
            }
        }
    }

    /// If the collision monitor gives no limits, the vehicle stops, and pressed keys have no effect.
    fn check_monitor(&mut self) {
        if self.state.stream.arming != ArmingState::Pressed || self.monitor_is_available() {
            return;
        }
        self.state.stream.arming = ArmingState::Locked;
        if self.state.mode == Mode::Driving {
            self.begin_stop(StopReason::CollisionMonitorStale);
        }
    }

    /// Moves one tick towards the requested velocity, within all limits.
    fn drive(&mut self, dt: Duration) {
        let limits = &self.rules.limits;
        let output = self
            .state
            .monitor_output(self.now)
            .unwrap_or(CollisionMonitorOutput::Stale);
        let monitor_caps = output.caps();
        let age_cap = self.state.speed_allowed_mps(self.rules, self.now);
        let requested = self.state.stream.requested;
        let possible = self.choose_mode(requested);

        let (mut target, mut clamp) = (possible, None);
        if differ(requested, possible) {
            clamp = Some(Clamp::Locomotion);
        }
        let most_radps = MotionCaps {
            angular: Caps::NONE.at_most(limits.angular.speed),
            ..MotionCaps::all(Caps::NONE)
        };
        for (cause, ground_speed_mps, caps) in [
            (Clamp::Speed, limits.linear.speed, most_radps),
            (Clamp::Age, age_cap, MotionCaps::all(Caps::NONE)),
            (Clamp::CollisionMonitor, f64::INFINITY, monitor_caps),
        ] {
            let speed_mps = target.ground_speed_mps();
            let mut factor = factor_within(target, caps);
            if speed_mps > ground_speed_mps {
                factor = factor.min(ground_speed_mps / speed_mps);
            }
            if factor < 1.0 {
                let slower = target.scaled(factor);
                // Rounding on the wire can exceed a limit slightly.
                if differ(target, slower) {
                    clamp = Some(cause);
                }
                target = slower;
            }
        }

        let mode = self
            .state
            .locomotion
            .unwrap_or(LocomotionMode::Differential);
        let turn_rate_at = (self.rules.locomotion, mode);
        let max_turn_rate = turn_rate_at.0.max_turn_rate_radps(mode, target.linear_mps);
        if target.angular_radps.abs() > max_turn_rate {
            target.angular_radps = max_turn_rate.copysign(target.angular_radps);
            clamp = clamp.or(Some(Clamp::Locomotion));
        }
        let age_cap = axis_cap_mps(age_cap, self.state.motion.velocity(), possible);
        let aim = MotionTarget {
            target,
            caps: MotionCaps {
                linear: monitor_caps.linear.at_most(age_cap),
                lateral: monitor_caps.lateral.at_most(age_cap),
                angular: monitor_caps.angular,
            },
            turn_rate_at,
        };
        self.state.motion = self.state.motion.towards(&aim, dt, limits);
        self.state.clamp = active_clamp(clamp, target, self.state.motion.velocity());
    }

    /// The part of the request that is possible now. For another mode the vehicle stands first, and a while longer.
    fn choose_mode(&mut self, requested: Velocity) -> Velocity {
        let locomotion = self.rules.locomotion;
        let present = self.state.locomotion;
        let Some(mode) = locomotion.mode_for(requested, present) else {
            return Velocity::ZERO;
        };
        let has_stood = self
            .state
            .standing_since
            .is_some_and(|since| self.now.since(since) >= locomotion.change);
        if present != Some(mode) && !(present.is_none() || has_stood) {
            return Velocity::ZERO;
        }
        self.state.locomotion = Some(mode);
        mode.part_of(requested)
    }

    /// The output has become zero: the next holder gets the lease, or the present holder may press again.
    fn enter_standstill(&mut self) {
        self.state.mode = if self.state.lease.holder.is_some() {
            Mode::Held
        } else {
            Mode::Idle
        };
        self.grant_next();
    }

    fn retry_estop_store(&mut self) {
        if let Some(estop) = &mut self.state.estop
            && !estop.is_stored
            && self.now.since(estop.store_requested) >= STORE_RETRY
        {
            estop.store_requested = self.now;
            self.actions.push(Action::StoreEStop(estop.id));
        }
    }
}

fn differ(one: Velocity, other: Velocity) -> bool {
    let differ = |one: f64, other: f64| (one - other).abs() > SPEED_TOLERANCE;
    differ(one.linear_mps, other.linear_mps)
        || differ(one.lateral_mps, other.lateral_mps)
        || differ(one.angular_radps, other.angular_radps)
}

/// Why the output differs from the request in this tick. `limit` is the reason for `target`: it applies once the output
/// has reached the target, and while the output brakes towards it. While the output rises, acceleration is the reason.
fn active_clamp(limit: Option<Clamp>, target: Velocity, applied: Velocity) -> Option<Clamp> {
    // In the direction of the target; negative if the output is faster. A target of zero keeps the sign of the request.
    let missing = |target: f64, applied: f64| target.abs() - applied * 1.0_f64.copysign(target);
    let missing = [
        missing(target.linear_mps, applied.linear_mps),
        missing(target.lateral_mps, applied.lateral_mps),
        missing(target.angular_radps, applied.angular_radps),
    ];
    let is_braking = missing.iter().any(|missing| *missing < -SPEED_TOLERANCE);
    let is_short = missing.iter().any(|missing| *missing > SPEED_TOLERANCE);
    match (is_braking, is_short) {
        (true, _) => limit.or(Some(Clamp::Ramp)),
        (false, true) => Some(Clamp::Ramp),
        (false, false) => limit,
    }
}

/// The factor that brings `velocity` within `caps`. All parts get the same factor, so that the path keeps the shape that the collision monitor checked.
pub(crate) fn factor_within(velocity: Velocity, caps: MotionCaps) -> f64 {
    let within = |speed: f64, caps: Caps| {
        let cap = caps.towards(speed);
        if speed.abs() > cap {
            cap / speed.abs()
        } else {
            1.0
        }
    };
    within(velocity.linear_mps, caps.linear)
        .min(within(velocity.lateral_mps, caps.lateral))
        .min(within(velocity.angular_radps, caps.angular))
}

impl ArbiterState {
    /// Checks a command before its signature, which is more expensive; returns an upper bound of its age.
    ///
    /// A command with [`DriveCommand::estop`] and a valid signature goes to [`crate::step`] in any case.
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

    /// Accepts a young command of the holder, in sequence and of the newest grant.
    fn accept(&mut self, command: &DriveCommand, age: Duration) {
        let stream = &mut self.state.stream;
        stream.last_seq = Some(command.seq);
        if !command.requested.is_finite() {
            self.state.counters.refuse(Refusal::NotFinite);
            self.stop_and_lock(StopReason::NotFinite);
            return;
        }
        self.state.counters.accepted = self.state.counters.accepted.saturating_add(1);
        self.state.lease.renew(self.now);
        // The previous command counts until now, the new one from now on.
        if let Some(last) = stream.age(self.now) {
            stream.ages.record(self.now, last.min(self.rules.max_age));
        }
        stream.ages.record(self.now, age);
        // The issue time that the token ring stores; `now - age` could saturate.
        stream.issued = self.state.tokens.issued(command.token, self.now).ok();

        let is_neutral = command.requested.is_neutral();
        if let Some(pose) = command.goal.filter(|_| is_neutral) {
            return self.accept_goal(pose);
        }
        if !is_neutral {
            self.end_goal(GoalEnd::TakenOver);
        }
        let stream = &mut self.state.stream;
        stream.requested = command.requested;
        stream.docking = command.docking;
        stream.arming = if is_neutral {
            stream.arming.after_neutral(self.now)
        } else {
            stream.arming.after_press(self.now, self.rules.neutral)
        };
        match self.state.mode {
            Mode::Held if self.state.stream.arming == ArmingState::Pressed => {
                if self.monitor_is_available() {
                    self.state.mode = Mode::Driving;
                } else {
                    // Driving must not start by itself when the collision monitor recovers.
                    self.state.stream.arming = ArmingState::Locked;
                }
            }
            Mode::Driving if is_neutral => self.begin_stop(StopReason::Released),
            Mode::Stopping { reason, since }
                if !is_neutral && is_recoverable(reason) && self.can_resume(since) =>
            {
                self.state.mode = Mode::Driving;
                self.state.stream.arming = ArmingState::Pressed;
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

    /// The vehicle stops, and pressed keys have no effect.
    fn stop_and_lock(&mut self, reason: StopReason) {
        self.state.stream.arming = ArmingState::Locked;
        match self.state.mode {
            Mode::Driving => self.begin_stop(reason),
            Mode::Stopping { since, .. } => self.state.mode = Mode::Stopping { reason, since },
            Mode::SafeBoot | Mode::Idle | Mode::Held | Mode::EStop | Mode::Fault(_) => {}
        }
    }

    /// Whether a stop that began at `since` may be taken back: soon after its start, while the vehicle moves.
    fn can_resume(&self, since: Monotonic) -> bool {
        self.now.since(since) <= RESUME_WINDOW
            && !self.state.motion.is_zero()
            && self.monitor_is_available()
    }
}

#[cfg(test)]
mod tests;
