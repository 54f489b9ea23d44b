//! What the collision monitor has to say, as plain data.

use super::motion::Caps;
use super::velocity::Velocity;

/// The guard's word of one round ("Collision monitor").
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CollisionMonitorOutput {
    /// Somebody switched it off.
    Off,
    /// Go no faster than this.
    Limits(SpeedLimits),
    /// What it knows is too old, and the configuration says to stop then.
    Stale,
}

/// The greatest speed in each direction; what is negative or not a number counts as zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedLimits {
    /// Metres per second.
    pub forward_mps: f64,
    /// Metres per second, positive.
    pub reverse_mps: f64,
    /// Radians per second.
    pub left_radps: f64,
    /// Radians per second, positive.
    pub right_radps: f64,
    /// The limits are those for creeping where nothing is known.
    pub in_unknown_space: bool,
    /// How much faster than these limits a boat is, and which way; zero on land. What floats does not brake, so it gets
    /// no thrust that way: thrust for a lower speed would only keep it fast for longer.
    pub overspeed: Velocity,
}

impl CollisionMonitorOutput {
    /// The greatest linear and angular speeds that the motors may be told, metres and radians per second; infinite
    /// where the guard is off.
    pub const fn caps(self) -> (Caps, Caps) {
        match self {
            Self::Off => (Caps::NONE, Caps::NONE),
            Self::Stale => (Caps::STOP, Caps::STOP),
            Self::Limits(limits) => {
                let Velocity {
                    linear_mps,
                    angular_radps,
                } = limits.overspeed;
                (
                    thrust(limits.forward_mps, limits.reverse_mps, linear_mps),
                    thrust(limits.left_radps, limits.right_radps, angular_radps),
                )
            }
        }
    }
}

/// What is left of the limits of one axis where it is faster than them by `overspeed`.
const fn thrust(positive: f64, negative: f64, overspeed: f64) -> Caps {
    Caps::new(
        if overspeed > 0.0 { 0.0 } else { positive },
        if overspeed < 0.0 { 0.0 } else { negative },
    )
}
