//! Teleoperation: the rules by which a vehicle obeys an operator over an unreliable link, and stops.
//!
//! All of it is a pure function of plain data. [`step`] takes the state, the present time and one input, and returns
//! the next state and the actions to take. It reads no clock, allocates nothing, cannot fail and needs no randomness
//! (nonces are inputs). A recorded sequence of inputs therefore gives the same decisions again, and a model checker can
//! try all of them. Threads, sockets, disks and motors belong to the caller.
//!
//! States, limits and the properties P1 to P13, which the tests are named after, are described in `docs/safety.md`.
//!
//! A caller does this in each round, at the latest every 20 ms:
//! 1. [`ArbiterInput::CollisionMonitor`] with the output of the collision monitor, or that it is off;
//! 2. for each command that arrived: [`ArbiterState::precheck`], then its signature, then [`ArbiterInput::Command`], or
//!    [`ArbiterInput::Rejected`] if one of the two failed;
//! 3. [`ArbiterInput::Tick`], and [`Actions::output`] to the motors in any case.

#![warn(missing_docs)]
#![warn(clippy::wildcard_enum_match_arm)]

mod arbiter;
pub mod collision_monitor;
mod command_stream;
mod config;
mod interface;
mod lease;
mod locomotion;
mod motion;
mod report;
mod token;

#[cfg(test)]
mod proofs;

pub use arbiter::{ArbiterState, Mode, step};
pub use command_stream::DriveCommand;
pub use config::{Rules, SettingError, TeleopConfig};
pub use interface::{
    Action, Actions, ArbiterEvent, ArbiterInput, CollisionMonitorOutput, LeaseVerb, SpeedLimits,
};
pub use lease::{
    Caller, EStop, EStopId, EStopSource, GrantReason, Lease, LeaseHolder, OperatorId, RequestId,
    Role, StoredEStop, Waiting,
};
pub use locomotion::{LocomotionConfig, LocomotionMode, LocomotionModes};
pub use motion::Velocity;
pub use report::{Counters, TeleopReport};
pub use token::{AgeToken, TokenRing};
