//! Commanded and actual velocities.

use nalgebra::Vector2;

use crate::path::PlanarPose;

/// The commanded velocity, in the base frame (x forward, y left, z up).
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct CommandedVelocity {
    /// Along x, m/s; negative backwards.
    pub linear_mps: f64,
    /// Along y, m/s; positive to the left.
    pub lateral_mps: f64,
    /// About z, rad/s; positive to the left.
    pub angular_radps: f64,
}

/// How the vehicle moves in the plane, in the base frame.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct PlanarVelocity {
    /// Along x, m/s. On wheels it is along the ground, in slopes as well.
    pub forward_mps: f64,
    /// Along y, m/s: the leeway of a boat in a bend.
    pub left_mps: f64,
    /// About z, rad/s; positive to the left.
    pub turn_rate_radps: f64,
}

impl CommandedVelocity {
    /// Stop; for a boat, no thrust.
    pub const ZERO: Self = Self {
        linear_mps: 0.0,
        lateral_mps: 0.0,
        angular_radps: 0.0,
    };

    pub(crate) fn is_zero(self) -> bool {
        self.parts().iter().all(|speed| speed.abs() <= 0.0)
    }

    /// The same where all parts are finite; otherwise standing still, which is what a drive makes of nonsense.
    #[must_use]
    pub(crate) fn or_zero(self) -> Self {
        if self.parts().iter().all(|speed| speed.is_finite()) {
            self
        } else {
            Self::ZERO
        }
    }

    const fn parts(self) -> [f64; 3] {
        [self.linear_mps, self.lateral_mps, self.angular_radps]
    }

    /// No faster than these, m/s and rad/s, in either direction.
    #[must_use]
    pub(crate) fn at_most(self, linear_mps: f64, angular_radps: f64) -> Self {
        Self {
            linear_mps: self.linear_mps.clamp(-linear_mps, linear_mps),
            lateral_mps: self.lateral_mps.clamp(-linear_mps, linear_mps),
            angular_radps: self.angular_radps.clamp(-angular_radps, angular_radps),
        }
    }
}

impl PlanarVelocity {
    #[must_use]
    pub(crate) fn towards(self, next: Self, share: f64) -> Self {
        let between = |from: f64, to: f64| from + share * (to - from);
        Self {
            forward_mps: between(self.forward_mps, next.forward_mps),
            left_mps: between(self.left_mps, next.left_mps),
            turn_rate_radps: between(self.turn_rate_radps, next.turn_rate_radps),
        }
    }

    /// Where a vehicle is that has gone so from `at` for `duration_s`: along an arc.
    pub(crate) fn moved(self, at: PlanarPose, duration_s: f64) -> PlanarPose {
        let turn_rad = self.turn_rate_radps * duration_s;
        let chord_heading_rad = at.yaw_rad + 0.5 * turn_rad;
        let (sin, cos) = (libm::sin(chord_heading_rad), libm::cos(chord_heading_rad));
        let [ahead_m, left_m] =
            [self.forward_mps, self.left_mps].map(|speed| speed * duration_s * chord(turn_rad));
        PlanarPose {
            position_m: at.position_m
                + Vector2::new(cos * ahead_m - sin * left_m, sin * ahead_m + cos * left_m),
            yaw_rad: at.yaw_rad + turn_rad,
        }
    }
}

/// Length of the chord of an arc as a share of the arc's.
fn chord(turn_rad: f64) -> f64 {
    let half_rad = 0.5 * turn_rad;
    if half_rad.abs() < 1e-4 {
        1.0
    } else {
        libm::sin(half_rad) / half_rad
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::float_cmp, reason = "these values are exact")]

    use std::f64::consts::FRAC_PI_2;

    use nalgebra::Point2;

    use super::*;

    const EAST: PlanarPose = PlanarPose {
        position_m: Point2::new(1.0, 2.0),
        yaw_rad: 0.0,
    };

    #[track_caller]
    fn check(velocity: [f64; 3], duration_s: f64, expected: [f64; 3]) {
        let [forward_mps, left_mps, turn_rate_radps] = velocity;
        let velocity = PlanarVelocity {
            forward_mps,
            left_mps,
            turn_rate_radps,
        };
        let at = velocity.moved(EAST, duration_s);
        let off = [at.position_m.x, at.position_m.y, at.yaw_rad];
        let off = [0, 1, 2].map(|n| (off[n] - expected[n]).abs());
        assert!(off.iter().all(|off| *off < 1e-12), "{at:?}");
    }

    #[test]
    fn a_velocity_leads_along_lines_and_arcs() {
        check([2.0, 0.0, 0.0], 0.5, [2.0, 2.0, 0.0]);
        check([0.0, 3.0, 0.0], 1.0, [1.0, 5.0, 0.0]);
        check([0.0, 0.0, -1.0], 3.0, [1.0, 2.0, -3.0]);
        // A quarter of a circle of 1 m to the left, and sideways along one of 2 m behind it.
        check([1.0, 0.0, 1.0], FRAC_PI_2, [2.0, 3.0, FRAC_PI_2]);
        check([0.0, 2.0, 1.0], FRAC_PI_2, [-1.0, 4.0, FRAC_PI_2]);
    }

    #[test]
    fn nonsense_asks_for_nothing() {
        for linear_mps in [f64::NAN, f64::INFINITY] {
            let command = CommandedVelocity {
                linear_mps,
                lateral_mps: 0.0,
                angular_radps: 1.0,
            };
            assert_eq!(command.or_zero(), CommandedVelocity::ZERO);
        }
        let back = CommandedVelocity {
            linear_mps: -2.0,
            lateral_mps: 0.0,
            angular_radps: 0.1,
        };
        assert!(!back.is_zero() && CommandedVelocity::ZERO.is_zero());
        assert_eq!(back.or_zero(), back);
        assert_eq!(back.at_most(1.5, 0.2).linear_mps, -1.5);
    }
}
