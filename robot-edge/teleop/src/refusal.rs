//! What was refused, why, and how often.

use super::token::TokenFault;

/// What an operator may ask for, and be refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RequestKind {
    /// To drive.
    Drive,
    /// To stop and stay stopped.
    EStop,
    /// The end of an emergency stop.
    Reset,
    /// Another holder of the lease.
    Lease,
    /// Another setting.
    Setting,
}

impl RequestKind {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Drive,
        Self::EStop,
        Self::Reset,
        Self::Lease,
        Self::Setting,
    ];
}

/// Why a command or a request had no effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum Refusal {
    /// It could not be read; told by who reads the wire.
    #[error("it could not be read")]
    Malformed,
    /// More came than one operator may send; told by who reads the wire.
    #[error("there were too many a second")]
    TooMany,
    /// It was not signed by who it says; told by who reads the wire.
    #[error("nobody of that name on the list of operators has signed it")]
    Signature,
    /// The sender's role does not allow it.
    #[error("the role does not allow it")]
    Role,
    /// See [`TokenFault::OtherBoot`].
    #[error("its token is from another run of the vehicle")]
    OtherBoot,
    /// See [`TokenFault::Unknown`].
    #[error("its token is not known")]
    UnknownToken,
    /// See [`TokenFault::WrongNonce`].
    #[error("its token's nonce is wrong")]
    WrongNonce,
    /// Older than commands may be (P1).
    #[error("it is too old")]
    TooOld,
    /// Nobody holds the lease, or somebody else does (P3).
    #[error("its sender does not hold the lease")]
    NotHolder,
    /// It relies on another grant of the lease (P3).
    #[error("it relies on another grant of the lease")]
    OtherEpoch,
    /// Its sequence number does not grow (P4).
    #[error("its sequence number does not grow")]
    OldSequence,
    /// It asks for an infinite speed, or for none that is a number (P8).
    #[error("its speed is not a finite number")]
    NotFinite,
    /// The vehicle is in a state that cannot grant it.
    #[error("the vehicle is not ready for it")]
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
}

impl Refusal {
    /// All of them, in the order of [`Counters`].
    pub const ALL: [Self; COUNT] = [
        Self::Malformed,
        Self::TooMany,
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
    ];
}

const COUNT: usize = Refusal::EStopSince as usize + 1;

impl From<TokenFault> for Refusal {
    fn from(fault: TokenFault) -> Self {
        match fault {
            TokenFault::OtherBoot => Self::OtherBoot,
            TokenFault::Unknown => Self::UnknownToken,
            TokenFault::WrongNonce => Self::WrongNonce,
            TokenFault::Expired => Self::TooOld,
        }
    }
}

/// What was obeyed and what was not, since the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Counters {
    /// Commands of the holder that were taken, neutral ones too.
    pub accepted: u64,
    /// Times that a moving vehicle stopped without its operator having asked for it.
    pub involuntary_stops: u64,
    refused: [u64; COUNT],
}

impl Counters {
    /// How often something was refused for this reason.
    pub const fn refused(&self, refusal: Refusal) -> u64 {
        self.refused[refusal as usize]
    }

    pub(super) const fn refuse(&mut self, refusal: Refusal) {
        let count = &mut self.refused[refusal as usize];
        *count = count.saturating_add(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reason_has_its_own_counter() {
        let mut counters = Counters::default();
        for (times, refusal) in Refusal::ALL.into_iter().enumerate() {
            for _ in 0..times {
                counters.refuse(refusal);
            }
        }
        for (times, refusal) in Refusal::ALL.into_iter().enumerate() {
            assert_eq!(counters.refused(refusal), times as u64, "{refusal}");
        }
    }
}
