//! Why a robot does not do what an operator wants.

use serde::{Deserialize, Serialize};

/// Why a command or a request had no effect. Append-only.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    thiserror::Error,
)]
pub enum Refusal {
    /// It could not be read.
    #[error("it could not be read")]
    Malformed,
    /// More came than one operator may send.
    #[error("there were too many a second")]
    TooMany,
    /// Nobody of that name is in the robot's list of operators.
    #[error("its sender is not in the operator list")]
    UnknownOperator,
    /// It was not signed by who it says, for this key, this robot and this moment.
    #[error("its signature is wrong")]
    Signature,
    /// The sender's role does not allow it.
    #[error("the sender's role does not allow it")]
    Role,
    /// Its token was issued in another run of the robot's program, or by another robot.
    #[error("its token is from another run of the robot")]
    OtherBoot,
    /// Its token was never issued, or long ago.
    #[error("its token is not known")]
    UnknownToken,
    /// Its token is not what was issued under that number.
    #[error("its token's nonce is wrong")]
    WrongNonce,
    /// It is older than commands may be.
    #[error("it is too old")]
    TooOld,
    /// Nobody holds the lease, or somebody else does.
    #[error("its sender does not hold the lease")]
    NotHolder,
    /// It relies on another grant of the lease.
    #[error("it relies on another grant of the lease")]
    OtherEpoch,
    /// Its sequence number does not grow: it came twice, or late.
    #[error("its sequence number does not grow")]
    OldSequence,
    /// It asks for an infinite speed, or for what is no number.
    #[error("its speed is not a finite number")]
    NotFinite,
    /// The robot is in a state that cannot grant it.
    #[error("the robot is not ready for it")]
    NotReady,
    /// Another request for the lease waits already.
    #[error("another operator already waits for the lease")]
    Busy,
    /// Nobody waits for the lease, or somebody else.
    #[error("that operator does not wait for the lease")]
    NotWaiting,
    /// There is no emergency stop to be reset.
    #[error("there is no emergency stop")]
    NoEStop,
    /// Another emergency stop than the one named is in force.
    #[error("another emergency stop is active")]
    OtherEStop,
    /// The emergency stop is not on disk yet.
    #[error("the emergency stop is not stored yet")]
    EStopNotStored,
    /// The reset was asked for before the latest request for an emergency stop was known.
    #[error("an emergency stop was requested since")]
    EStopSince,
    /// The setting's value is beyond what the robot can do.
    #[error("the value is out of range")]
    OutOfRange,
    /// The robot has nothing that could do it.
    #[error("it is not available on this robot")]
    Unavailable,
}

impl Refusal {
    /// Every reason, by number.
    pub const ALL: [Self; 22] = [
        Self::Malformed,
        Self::TooMany,
        Self::UnknownOperator,
        Self::Signature,
        Self::Role,
        Self::OtherBoot,
        Self::UnknownToken,
        Self::WrongNonce,
        Self::TooOld,
        Self::NotHolder,
        Self::OtherEpoch,
        Self::OldSequence,
        Self::NotFinite,
        Self::NotReady,
        Self::Busy,
        Self::NotWaiting,
        Self::NoEStop,
        Self::OtherEStop,
        Self::EStopNotStored,
        Self::EStopSince,
        Self::OutOfRange,
        Self::Unavailable,
    ];
}
