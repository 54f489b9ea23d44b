//! What can happen to the arbiter.

use super::command::DriveCommand;
use super::emergency_stop::{EStopId, StoredEStop};
use super::operator::{Caller, OperatorId, Role};
use super::refusal::Refusal;
use super::speed_limits::CollisionMonitorOutput;
use super::token::AgeToken;
use super::velocity::Velocity;

/// One thing that happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ArbiterInput {
    /// A round of the loop ends: time has passed, and the motors are to be told.
    Tick,
    /// A new token is wanted; `nonce` is random.
    Token {
        /// 64 random bits.
        nonce: u64,
    },
    /// A command whose signature was verified.
    Command {
        /// The sender's role.
        role: Role,
        /// What it says.
        command: DriveCommand,
    },
    /// A command or request that was refused before it came here.
    Rejected(Refusal),
    /// Somebody wants the lease changed.
    Lease {
        /// Who.
        caller: Caller,
        /// The newest token that they had.
        token: AgeToken,
        /// What they want.
        verb: LeaseVerb,
    },
    /// The list of operators no longer has them, or no longer as one who may drive.
    Revoked(OperatorId),
    /// An operator wants the vehicle to stop and stay stopped.
    EStop(Caller),
    /// Somebody at the vehicle wants that.
    LocalEStop,
    /// This emergency stop is on disk.
    EStopStored(EStopId),
    /// Somebody wants the emergency stop to end.
    Reset {
        /// Who.
        caller: Caller,
        /// The newest token that they had.
        token: AgeToken,
        /// The emergency stop that they know of.
        id: EStopId,
    },
    /// Somebody at the vehicle wants the emergency stop or the fault to end.
    LocalReset,
    /// The test of motors, guard and disk has ended.
    SelfTest {
        /// Everything works.
        has_passed: bool,
        /// What the run before left on disk.
        stored: StoredEStop,
    },
    /// The collision monitor's word of this round.
    CollisionMonitor(CollisionMonitorOutput),
    /// How fast the vehicle is, as its sensors tell.
    Measured(Velocity),
    /// The motors do not do what they are told, or cannot be told.
    ActuatorFault,
}

/// What can be wanted of the lease ("Lease").
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LeaseVerb {
    /// To hold it. Waits for the holder's consent where somebody else does.
    Request,
    /// To hand it to an operator who waits.
    HandOver {
        /// Who waits.
        to: OperatorId,
    },
    /// Not to hand it to an operator who waits.
    Refuse {
        /// Who waits.
        whom: OperatorId,
    },
    /// To give it back, or to wait for it no longer.
    Release,
    /// To hold it whoever does; for supervisors.
    TakeOver,
}
