//! How fast to go ahead and to turn.

/// Below this, metres per second and radians per second alike, a request asks for nothing.
const NEUTRAL: f64 = 1e-3;
/// Slower than this, in the same units, is standing still: no motor controller here resolves it.
const STANDING: f64 = 1e-6;

/// A velocity in the base frame (x forward, y left, z up).
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Velocity {
    /// Along x, metres per second; negative backwards.
    pub linear_mps: f64,
    /// About z, radians per second; positive to the left.
    pub angular_radps: f64,
}

impl Velocity {
    /// Standing still, as far as that can be asked for.
    pub const ZERO: Self = Self {
        linear_mps: 0.0,
        angular_radps: 0.0,
    };

    /// Neither infinite nor not-a-number.
    pub const fn is_finite(self) -> bool {
        self.linear_mps.is_finite() && self.angular_radps.is_finite()
    }

    /// Nothing is pressed.
    pub const fn is_neutral(self) -> bool {
        self.linear_mps.abs() < NEUTRAL && self.angular_radps.abs() < NEUTRAL
    }

    /// Nothing is asked of motors; never true of what is not a number.
    pub const fn is_zero(self) -> bool {
        self.linear_mps.abs() < STANDING && self.angular_radps.abs() < STANDING
    }

    /// Both parts times `factor`, so that the arc keeps its shape.
    #[must_use]
    pub const fn scaled(self, factor: f64) -> Self {
        Self {
            linear_mps: self.linear_mps * factor,
            angular_radps: self.angular_radps * factor,
        }
    }
}
