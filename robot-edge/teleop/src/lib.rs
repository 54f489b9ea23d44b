//! Driving from afar: the rules by which a vehicle obeys, and stops obeying, a person behind a bad link.
//!
//! Everything here is a pure function of plain data. [`step`] takes what was, the present and one event, and returns
//! what is and what is to be done; it reads no clock, allocates nothing, cannot fail, and needs no randomness (nonces
//! come in as data). So a recorded sequence of events replays to the same decisions, and a model checker can try all
//! of them. Threads, sockets, disks and motors are the caller's.
//!
//! The contract is `network-and-teleop.md`, section "Teleop: never obey an old command": its states, limits and the
//! properties P1 to P12, which the tests of this module are named after.
//!
//! A caller that drives a vehicle does this in each round, at the latest every 20 ms:
//! 1. [`ArbiterInput::CollisionMonitor`] with what the collision monitor has to say, or that it is off;
//! 2. for each command that arrived, [`ArbiterState::precheck`], then its signature, then [`ArbiterInput::Command`], or
//!    [`ArbiterInput::Rejected`] where one of the two failed;
//! 3. [`ArbiterInput::Tick`], and [`Actions::output`] to the motors, whatever it is.

#![warn(missing_docs)]
#![warn(clippy::wildcard_enum_match_arm)]

pub mod command;
pub mod config;
pub mod operator;
pub mod speed_limits;
pub mod velocity;

pub mod action;
pub mod input;
pub mod report;

pub mod arbiter;

pub mod collision_monitor;

pub mod age_window;
pub mod arming;
pub mod emergency_stop;
pub mod lease;
pub mod motion;
pub mod refusal;
pub mod token;

#[cfg(test)]
mod proofs;

pub use action::{Action, Actions, Answer, ArbiterEvent};
pub use arbiter::{ArbiterState, Mode, step};
pub use command::DriveCommand;
pub use config::{Rules, TeleopConfig};
pub use emergency_stop::EStopId;
pub use input::{ArbiterInput, LeaseVerb};
pub use operator::{Caller, OperatorId, RequestId, Role};
pub use refusal::{Counters, Refusal, RequestKind};
pub use report::TeleopReport;
pub use speed_limits::{CollisionMonitorOutput, SpeedLimits};
pub use token::{AgeToken, TokenFault, TokenRing};
pub use velocity::Velocity;
