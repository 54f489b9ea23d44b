//! What an operator tells a robot, and what it answers.
//!
//! These are the bodies of signed messages ([`crate::signed`]), which carry the token, the lease's epoch and the
//! sequence number beside them; the answers are messages like others.

use serde::{Deserialize, Serialize};

use super::refusal::Refusal;
use crate::name::OperatorId;

/// `op/<operator>/drive`: what is pressed, out of one iteration of a console's input loop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Drive {
    /// Along x of `base_link`, m/s: negative backwards.
    pub linear_mps: f32,
    /// About z of `base_link`, rad/s: positive to the left.
    pub angular_radps: f32,
    /// The emergency stop was pressed, and is not acknowledged yet: so it arrives also where `estop` does not.
    pub estop: Option<EStop>,
}

/// `op/<operator>/estop`: to stop at once and stay stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EStop {
    /// Names this press: drawn at random, and the same in all repetitions. One that comes late, after a reset,
    /// is thereby told from a new one.
    pub press: u64,
}

/// `op/<operator>/reset`: the end of an emergency stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reset {
    /// The number of the emergency stop that its sender knows of, from the status.
    pub estop: u64,
}

/// `op/<operator>/lease`: who drives. Append-only.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LeaseRequest {
    /// To hold the lease. Waits for the holder's consent where somebody else does.
    Request,
    /// To give it back, or to wait for it no longer.
    Release,
    /// To hand it to this operator, who waits for it.
    HandOver(OperatorId),
    /// Not to hand it to this operator, who waits for it.
    Refuse(OperatorId),
    /// To hold it whoever does; for supervisors.
    TakeOver,
}

/// `op/<operator>/set`: one setting. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Setting {
    /// Bytes for tiles, kbit/s.
    BudgetKbps(u32),
    /// The collision monitor, on or off.
    CollisionMonitor(bool),
    /// The recording, on or off.
    Recording(bool),
}

/// The answer to `estop`, `reset`, `lease` and `set`. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Answer {
    /// It was done.
    Done,
    /// The lease is the sender's: commands must name this epoch.
    Granted(u64),
    /// The lease will be the sender's when the vehicle stands, or when its holder consents.
    Waiting,
    /// The vehicle is stopped, and this emergency stop is stored, so that it outlives a restart.
    EStopped(u64),
    /// It was not done.
    Refused(Refusal),
}

impl Drive {
    /// Below this, m/s and rad/s alike, a velocity asks for nothing.
    pub const NEUTRAL_BELOW: f32 = 1e-3;

    /// Nothing is pressed. What is not a number is not nothing.
    pub fn is_neutral(&self) -> bool {
        [self.linear_mps, self.angular_radps]
            .iter()
            .all(|speed| speed.abs() < Self::NEUTRAL_BELOW)
    }
}
