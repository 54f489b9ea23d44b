//! Who asks.

/// An operator by its number in the vehicle's list of operator keys; the number lives as long as the process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct OperatorId(pub u32);

/// What somebody may do ("Security", roles); told with every event by who verified the caller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Role {
    /// Looks on.
    Observer,
    /// Drives, and stops.
    Operator,
    /// Drives, stops, takes over and resets.
    Supervisor,
}

impl Role {
    /// Whether it may hold the lease, and stop the vehicle.
    pub const fn may_drive(self) -> bool {
        match self {
            Self::Observer => false,
            Self::Operator | Self::Supervisor => true,
        }
    }
}

/// The caller's handle for the answer to a request; carried through unread.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct RequestId(pub u64);

/// Who sent a request that is answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Caller {
    /// Who.
    pub operator: OperatorId,
    /// What they may do.
    pub role: Role,
    /// Where the answer goes.
    pub request: RequestId,
}
