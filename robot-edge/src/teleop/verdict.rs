//! What the collision guard has to say, as plain data.

use super::motion::Caps;

/// The guard's word of one round ("Collision guard").
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GuardVerdict {
    /// Somebody switched it off.
    Off,
    /// Go no faster than this.
    Limits(GuardLimits),
    /// What it knows is too old, and the configuration says to stop then.
    Stale,
}

/// The greatest speed in each direction; what is negative or not a number counts as zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuardLimits {
    /// Metres per second.
    pub forward_mps: f64,
    /// Metres per second, positive.
    pub reverse_mps: f64,
    /// Radians per second.
    pub left_radps: f64,
    /// Radians per second, positive.
    pub right_radps: f64,
    /// The limits are those for creeping where nothing is known.
    pub is_blind: bool,
}

impl GuardVerdict {
    /// The greatest linear and angular speeds, metres and radians per second; infinite where the guard is off.
    pub const fn caps(self) -> (Caps, Caps) {
        match self {
            Self::Off => (Caps::NONE, Caps::NONE),
            Self::Stale => (Caps::STOP, Caps::STOP),
            Self::Limits(limits) => (
                Caps::new(limits.forward_mps, limits.reverse_mps),
                Caps::new(limits.left_radps, limits.right_radps),
            ),
        }
    }
}
