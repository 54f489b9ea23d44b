//! The emergency stop: latched, stored before it is acknowledged, and reset by name.

use super::operator::OperatorId;
use measurement::time::Monotonic;

/// Names one emergency stop; a reset must know it. Grows with each, also over restarts that find one stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct EStopId(pub u64);

/// Who stopped the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum EStopSource {
    /// An operator, over the link.
    Operator(OperatorId),
    /// Somebody at the vehicle.
    Local,
}

/// What a run finds of the run before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StoredEStop {
    /// None was in force.
    None,
    /// This one was.
    Latched(EStopId),
    /// It cannot be told, so that one is assumed.
    Unreadable,
}

/// An emergency stop in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct EStop {
    /// Its name.
    pub id: EStopId,
    /// It would be found after a restart; only then it is acknowledged and can be reset from afar.
    pub is_stored: bool,
    /// When somebody last asked for it. Who resets it must know of that: their token must be younger.
    pub last_requested: Monotonic,
    /// When it was last given to be stored.
    pub store_requested: Monotonic,
}
