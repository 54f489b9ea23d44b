//! Attitude as roll, pitch and yaw (REP-103): positive roll is right side down, positive pitch is nose down,
//! positive yaw is to the left.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Turns about the fixed axes x, y, z, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Attitude {
    /// About x, radians.
    pub roll_rad: f64,
    /// About y, radians.
    pub pitch_rad: f64,
    /// About z, radians.
    pub yaw_rad: f64,
}

impl Attitude {
    /// The attitude of `rotation`: pitch within ±π/2, the others within ±π.
    pub fn of(rotation: &UnitQuaternion<f64>) -> Self {
        let forward = rotation * Vector3::x();
        let (left, up) = (rotation * Vector3::y(), rotation * Vector3::z());
        Self {
            roll_rad: libm::atan2(left.z, up.z),
            pitch_rad: libm::atan2(-forward.z, libm::hypot(forward.x, forward.y)),
            yaw_rad: libm::atan2(forward.y, forward.x),
        }
    }

    /// The same turns as a rotation.
    pub fn rotation(&self) -> UnitQuaternion<f64> {
        let about = |axis: Vector3<f64>, angle_rad: f64| {
            let half = 0.5 * angle_rad;
            Quaternion::from_parts(libm::cos(half), axis * libm::sin(half))
        };
        UnitQuaternion::new_normalize(
            about(Vector3::z(), self.yaw_rad)
                * about(Vector3::y(), self.pitch_rad)
                * about(Vector3::x(), self.roll_rad),
        )
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn signs_are_those_of_rep_103() {
        let turned = |roll_rad, pitch_rad, yaw_rad| {
            Attitude {
                roll_rad,
                pitch_rad,
                yaw_rad,
            }
            .rotation()
        };
        assert!((turned(0.0, 0.1, 0.0) * Vector3::x()).z < -0.09);
        assert!((turned(-0.1, 0.0, 0.0) * -Vector3::y()).z > 0.09);
        assert!((turned(0.0, 0.0, 0.1) * Vector3::x()).y > 0.09);
        // Pitch is about the axis to the left before the turn, so the nose stays 0.1 below the horizon.
        assert!(((turned(0.0, 0.1, 1.0) * Vector3::x()).z + libm::sin(0.1)).abs() < 1e-15);
    }

    proptest! {
        #[test]
        fn attitude_of_a_rotation_is_the_attitude_that_made_it(
            roll_rad in -3.1..3.1_f64, pitch_rad in -1.5..1.5_f64, yaw_rad in -3.1..3.1_f64
        ) {
            let made = Attitude { roll_rad, pitch_rad, yaw_rad };
            let found = Attitude::of(&made.rotation());
            prop_assert!((found.roll_rad - roll_rad).abs() < 1e-12, "{found:?}");
            prop_assert!((found.pitch_rad - pitch_rad).abs() < 1e-12, "{found:?}");
            prop_assert!((found.yaw_rad - yaw_rad).abs() < 1e-12, "{found:?}");
        }
    }
}
