//! Inputs of the arbiter and the actions that follow from them, as plain data.

use crate::arbiter::Mode;
use crate::command_stream::DriveCommand;
use crate::lease::{
    Caller, EStopId, EStopSource, GrantReason, OperatorId, RequestId, Role, StoredEStop,
};
use crate::motion::{Caps, MotionCaps, Velocity};
use crate::token::AgeToken;
use measurement::time::Monotonic;
use protocol::keys::OperatorTopic;
use protocol::message::{Answer, GoalEnd, LeaseEnd, MapPose, Refusal};

/// One input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ArbiterInput {
    /// The end of a round: time has passed, and the motors need a velocity.
    Tick,
    /// Issue a token; `nonce` must be random.
    Token {
        /// 64 random bits.
        nonce: u64,
    },
    /// A command whose signature was verified.
    Command {
        /// The sender's role.
        role: Role,
        /// The command.
        command: DriveCommand,
    },
    /// A command or request that the caller refused itself.
    Rejected(Refusal),
    /// A request about the lease.
    Lease {
        /// Who.
        caller: Caller,
        /// The newest token of the sender.
        token: AgeToken,
        /// The requested change.
        verb: LeaseVerb,
    },
    /// This operator was removed from the operator list, or may no longer drive.
    Revoked(OperatorId),
    /// An emergency stop requested by an operator.
    EStop(Caller),
    /// An emergency stop requested at the vehicle.
    LocalEStop,
    /// This emergency stop is stored on disk.
    EStopStored(EStopId),
    /// A reset of the emergency stop requested by an operator.
    Reset {
        /// Who.
        caller: Caller,
        /// The newest token of the sender.
        token: AgeToken,
        /// The emergency stop to be reset.
        id: EStopId,
    },
    /// A reset of the emergency stop or of a fault, requested at the vehicle.
    LocalReset,
    /// The result of the self-test of motors, collision monitor and disk.
    SelfTest {
        /// Everything works.
        has_passed: bool,
        /// What the previous run left on disk.
        stored: StoredEStop,
    },
    /// The collision monitor's output of this round.
    CollisionMonitor(CollisionMonitorOutput),
    /// The velocity measured by the sensors.
    Measured(Velocity),
    /// The motors do not obey, or cannot be reached.
    ActuatorFault,
    /// The motors obey no velocity in this round, as somebody else has them: not a fault.
    MotorsHeld,
    /// The newest velocity of the planner. It has neither token nor signature: it counts only while a goal runs.
    Planned {
        /// The velocity.
        velocity: Velocity,
        /// When it arrived.
        arrived: Monotonic,
    },
    /// The planner sends more velocities than any needs.
    PlannerFloods,
}

/// A change of the lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LeaseVerb {
    /// Request it. If another operator holds it, the request waits for the holder's consent.
    Request,
    /// Hand it over to a waiting operator.
    HandOver {
        /// Who waits.
        to: OperatorId,
    },
    /// Refuse the request of a waiting operator.
    Refuse {
        /// Who waits.
        whom: OperatorId,
    },
    /// Give it back, or withdraw a waiting request.
    Release,
    /// Take it from the current holder (supervisors only).
    TakeOver,
}

/// The output of the collision monitor for one round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CollisionMonitorOutput {
    /// It is switched off.
    Off,
    /// Go no faster than this.
    Limits(SpeedLimits),
    /// Its data is too old, and the configuration requires a stop in this case.
    Stale,
}

/// The speed limit of each direction; negative values and NaN count as zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedLimits {
    /// Metres per second.
    pub forward_mps: f64,
    /// Metres per second, positive.
    pub reverse_mps: f64,
    /// Metres per second to the left, along y; zero unless the vehicle goes or is to go sideways.
    pub left_mps: f64,
    /// Metres per second to the right, positive; zero as `left_mps`.
    pub right_mps: f64,
    /// Radians per second.
    pub left_radps: f64,
    /// Radians per second, positive.
    pub right_radps: f64,
    /// The limits are those for creeping in unknown space.
    pub in_unknown_space: bool,
    /// By how much a boat exceeds these limits, with sign; zero on land. A boat cannot brake, so it gets no thrust in
    /// this direction: thrust for a lower speed would only delay the slowing down.
    pub overspeed: Velocity,
}

impl CollisionMonitorOutput {
    /// The greatest speeds allowed, metres and radians per second; infinite if the monitor is off.
    pub const fn caps(self) -> MotionCaps {
        match self {
            Self::Off => MotionCaps::all(Caps::NONE),
            Self::Stale => MotionCaps::all(Caps::STOP),
            Self::Limits(limits) => {
                let over = limits.overspeed;
                MotionCaps {
                    linear: thrust(limits.forward_mps, limits.reverse_mps, over.linear_mps),
                    lateral: thrust(limits.left_mps, limits.right_mps, over.lateral_mps),
                    angular: thrust(limits.left_radps, limits.right_radps, over.angular_radps),
                }
            }
        }
    }
}

/// The limits of one axis that exceeds them by `overspeed`.
const fn thrust(positive: f64, negative: f64, overspeed: f64) -> Caps {
    Caps::new(
        if overspeed > 0.0 { 0.0 } else { positive },
        if overspeed < 0.0 { 0.0 } else { negative },
    )
}

/// Greatest number of actions per input (checked by a test); further ones are dropped.
const CAPACITY: usize = 8;

/// The actions that follow from one input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Actions {
    /// The velocity for the motors. [`crate::ArbiterInput::Tick`] changes it; other inputs only set it to zero.
    pub output: Velocity,
    actions: [Option<Action>; CAPACITY],
}

/// One action.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Action {
    /// Publish this token.
    PublishToken(AgeToken),
    /// Answer a request.
    Answer {
        /// Which.
        request: RequestId,
        /// The answer.
        answer: Answer,
    },
    /// Answer all waiting emergency stop requests: the stop is stored.
    AcknowledgeEStop(EStopId),
    /// Store it on disk from another thread, then report [`crate::ArbiterInput::EStopStored`].
    StoreEStop(EStopId),
    /// Remove it from disk, on the same thread.
    ClearEStop(EStopId),
    /// Report an event to consoles and the audit log.
    Notify(ArbiterEvent),
}

/// An event for consoles and the audit log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ArbiterEvent {
    /// The mode has changed.
    ModeChanged {
        /// The previous mode.
        from: Mode,
        /// The new mode.
        to: Mode,
    },
    /// An operator requests the lease from its holder.
    LeaseRequested {
        /// Who.
        by: OperatorId,
    },
    /// The lease was granted.
    LeaseGranted {
        /// Who.
        to: OperatorId,
        /// The epoch of this grant.
        epoch: u64,
        /// Why it was granted.
        how: GrantReason,
    },
    /// The lease has ended.
    LeaseEnded {
        /// Who.
        operator: OperatorId,
        /// Why.
        why: LeaseEnd,
    },
    /// An emergency stop is active.
    EStopped {
        /// This one.
        id: EStopId,
        /// Its source; absent if a previous run left it.
        by: Option<EStopSource>,
    },
    /// An emergency stop has ended.
    Reset {
        /// This one.
        id: EStopId,
        /// The operator who reset it; absent for a reset at the vehicle.
        by: Option<Caller>,
    },
    /// A goal runs from now on, or another one than before.
    GoalStarted(MapPose),
    /// The goal has ended.
    GoalEnded(GoalEnd),
    /// A request was refused (commands are only counted).
    Refused {
        /// What was asked for: an emergency stop, a reset or the lease.
        request_kind: OperatorTopic,
        /// Whose.
        caller: Caller,
        /// Why.
        refusal: Refusal,
    },
}

impl Actions {
    pub(super) const fn new(output: Velocity) -> Self {
        Self {
            output,
            actions: [None; CAPACITY],
        }
    }

    /// The actions, in order of execution.
    pub fn iter(&self) -> impl Iterator<Item = Action> + '_ {
        self.actions.iter().copied().flatten()
    }

    pub(super) fn push(&mut self, action: Action) {
        if let Some(free) = self.actions.iter_mut().find(|slot| slot.is_none()) {
            *free = Some(action);
        }
    }

    #[cfg(test)]
    pub(super) fn is_full(&self) -> bool {
        self.actions[CAPACITY - 1].is_some()
    }
}
