//! Two wheels, or two tracks, with a speed each: how a velocity of the vehicle becomes theirs, and back.

use serde::{Deserialize, Serialize};

use teleop::Velocity;

/// Geometry of a vehicle that steers by the speeds of its two sides.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DifferentialDrive {
    /// Between the contact lines of left and right wheels, metres. Of a vehicle that skids while it turns, the
    /// effective one, which is greater: turn on the spot and divide the difference of the wheels' paths by the angle.
    pub track_width_m: f64,
    /// Speed of a side at full command, metres per second.
    pub full_speed_mps: f64,
}

/// Speeds of the two sides, metres per second; negative backwards.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct SideSpeeds {
    pub left_mps: f64,
    pub right_mps: f64,
}

impl DifferentialDrive {
    /// The sides' speeds for `velocity`. Where one would exceed full speed, both are scaled alike, so that the vehicle
    /// keeps to its curve and is only slower on it. What is not finite becomes standing still.
    pub fn sides(&self, velocity: Velocity) -> SideSpeeds {
        if !velocity.is_finite() {
            return SideSpeeds::default();
        }
        let turn_mps = velocity.angular_radps * self.track_width_m / 2.0;
        let (left, right) = (
            velocity.linear_mps - turn_mps,
            velocity.linear_mps + turn_mps,
        );
        let greatest = left.abs().max(right.abs());
        if !greatest.is_finite() {
            return SideSpeeds::default();
        }
        let scale = if greatest > self.full_speed_mps {
            self.full_speed_mps / greatest
        } else {
            1.0
        };
        SideSpeeds {
            left_mps: left * scale,
            right_mps: right * scale,
        }
    }

    /// The vehicle's velocity where its sides move like this, without slip.
    pub fn velocity(&self, sides: SideSpeeds) -> Velocity {
        Velocity::new(
            f64::midpoint(sides.left_mps, sides.right_mps),
            (sides.right_mps - sides.left_mps) / self.track_width_m,
        )
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const DRIVE: DifferentialDrive = DifferentialDrive {
        track_width_m: 0.5,
        full_speed_mps: 2.0,
    };

    fn velocity(linear_mps: f64, angular_radps: f64) -> Velocity {
        Velocity {
            linear_mps,
            lateral_mps: 0.0,
            angular_radps,
        }
    }

    #[test]
    fn a_turn_to_the_left_speeds_up_the_right_side() {
        let sides = DRIVE.sides(velocity(1.0, 1.0));
        assert_eq!((sides.left_mps, sides.right_mps), (0.75, 1.25));
        let on_the_spot = DRIVE.sides(velocity(0.0, -2.0));
        assert_eq!((on_the_spot.left_mps, on_the_spot.right_mps), (0.5, -0.5));
    }

    #[test]
    fn full_speed_ahead_into_a_curve_keeps_the_curve() {
        // A radius of 1 m: inner side 0.75, outer 1.25 of the middle.
        let sides = DRIVE.sides(velocity(4.0, 4.0));
        assert!((sides.right_mps - 2.0).abs() < 1e-12);
        assert!((sides.left_mps - 1.2).abs() < 1e-12);
    }

    #[test]
    fn what_is_not_a_number_stands_still() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(DRIVE.sides(velocity(bad, 0.0)), SideSpeeds::default());
            assert_eq!(DRIVE.sides(velocity(0.0, bad)), SideSpeeds::default());
        }
        let overflow = DRIVE.sides(velocity(f64::MAX, f64::MAX));
        assert!(overflow.left_mps.abs() <= 2.0 && overflow.right_mps.abs() <= 2.0);
    }

    proptest! {
        #[test]
        fn sides_never_exceed_full_speed_and_keep_the_curvature(
            linear_mps in -10.0..10.0f64, angular_radps in -20.0..20.0f64,
        ) {
            let asked = velocity(linear_mps, angular_radps);
            let sides = DRIVE.sides(asked);
            prop_assert!(sides.left_mps.abs() <= 2.0 + 1e-12 && sides.right_mps.abs() <= 2.0 + 1e-12);
            let done = DRIVE.velocity(sides);
            // The same curve: angular/linear is what it was, without dividing by either.
            prop_assert!((done.linear_mps * angular_radps - done.angular_radps * linear_mps).abs() < 1e-9);
            // Never faster than asked, and never the other way.
            prop_assert!(done.linear_mps.abs() <= linear_mps.abs() + 1e-12);
            prop_assert!(done.linear_mps * linear_mps >= -1e-12 && done.angular_radps * angular_radps >= -1e-12);
        }

        #[test]
        fn any_bits_give_finite_sides(linear in any::<u64>(), angular in any::<u64>()) {
            let sides = DRIVE.sides(velocity(f64::from_bits(linear), f64::from_bits(angular)));
            prop_assert!(sides.left_mps.abs() <= 2.0 + 1e-9 && sides.right_mps.abs() <= 2.0 + 1e-9);
        }
    }
}
