//! What the arbiter wants done.

use super::arbiter::Mode;
use super::emergency_stop::{EStopId, EStopSource};
use super::lease::{GrantReason, LeaseEnd};
use super::operator::{Caller, OperatorId, RequestId};
use super::refusal::{Refusal, RequestKind};
use super::token::AgeToken;
use super::velocity::Velocity;

/// Most actions that one event can cause. A test holds the arbiter to it; beyond it, the last are lost.
const CAPACITY: usize = 8;

/// What is to be done after one event.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Actions {
    /// What the motors are to be told now. It changes with [`super::ArbiterInput::Tick`]; with other events only to zero.
    pub output: Velocity,
    actions: [Option<Action>; CAPACITY],
}

/// One thing to be done.
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
    /// Answer every request for an emergency stop that waits for an answer: it is stored.
    AcknowledgeEStop(EStopId),
    /// Write it to disk on another thread, then say [`super::ArbiterInput::EStopStored`].
    StoreEStop(EStopId),
    /// Remove it from disk on that thread.
    ClearEStop(EStopId),
    /// Tell consoles and the audit log.
    Notify(ArbiterEvent),
}

/// What a request is answered with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Answer {
    /// The lease is theirs; commands must name this epoch.
    Granted {
        /// The epoch.
        epoch: u64,
    },
    /// The lease will be granted when the vehicle stands, or when its holder consents.
    Waiting,
    /// It was done.
    Done,
    /// The vehicle is stopped, and this is stored.
    EStopped(EStopId),
    /// It was not done.
    Refused(Refusal),
}

/// What people want to know, now or later.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ArbiterEvent {
    /// The state is another.
    ModeChanged {
        /// It was this.
        from: Mode,
        /// It is this.
        to: Mode,
    },
    /// Somebody asks the holder for the lease.
    LeaseRequested {
        /// Who.
        by: OperatorId,
    },
    /// Somebody has the lease.
    LeaseGranted {
        /// Who.
        to: OperatorId,
        /// By this grant.
        epoch: u64,
        /// In this way.
        how: GrantReason,
    },
    /// Somebody no longer has the lease.
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
        /// Who asked; absent where it was found at the start.
        by: Option<EStopSource>,
    },
    /// An emergency stop has ended.
    Reset {
        /// This one.
        id: EStopId,
        /// Who ended it; absent for somebody at the vehicle.
        by: Option<Caller>,
    },
    /// A request was refused (commands are only counted).
    Refused {
        /// What was asked for: an emergency stop, a reset or the lease.
        request_kind: RequestKind,
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

    /// What is to be done, in this order.
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
