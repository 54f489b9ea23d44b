//! Outputs of the arbiter.

use super::arbiter::Mode;
use super::lease::GrantReason;
use super::token::AgeToken;
use crate::lease::{Caller, OperatorId, RequestId};
use crate::lease::{EStopId, EStopSource};
use crate::motion::Velocity;
use protocol::keys::OperatorTopic;
use protocol::message::{Answer, LeaseEnd, Refusal};

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
