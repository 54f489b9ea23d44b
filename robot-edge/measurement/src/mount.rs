//! Mounting of a sensor on its vehicle.

use nalgebra::{Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;

use crate::pose::Pose;

/// Pose of a sensor in the base frame (x forward, y left, z up; REP-103).
#[derive(Clone, Copy, Debug, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Mount {
    /// Forward, metres.
    pub x_m: f64,
    /// Left, metres.
    pub y_m: f64,
    /// Up, metres.
    pub z_m: f64,
    /// About x, degrees: positive is right side down.
    pub roll_deg: f64,
    /// About y, degrees: positive is nose down.
    pub pitch_deg: f64,
    /// About z, degrees: positive is to the left.
    pub yaw_deg: f64,
}

impl Mount {
    /// Moves points from the sensor's frame into the base frame: roll, then pitch, then yaw, about
    /// the base's axes, as in URDF.
    pub fn base_from_sensor(&self) -> Pose {
        let about = |axis: usize, angle_deg: f64| {
            let half_rad = 0.5 * angle_deg.to_radians();
            let mut imaginary = [0.0; 3];
            imaginary[axis] = libm::sin(half_rad);
            let [i, j, k] = imaginary;
            UnitQuaternion::new_normalize(nalgebra::Quaternion::new(libm::cos(half_rad), i, j, k))
        };
        Pose::from_parts(
            Translation3::from(Vector3::new(self.x_m, self.y_m, self.z_m)),
            about(2, self.yaw_deg) * about(1, self.pitch_deg) * about(0, self.roll_deg),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn a_mount_turns_roll_then_pitch_then_yaw() {
        let mount = Mount {
            x_m: 1.0,
            roll_deg: 90.0,
            yaw_deg: 90.0,
            ..Mount::default()
        };
        // The sensor's y axis rises by the roll; its x axis turns left by the yaw.
        let base_from_sensor = mount.base_from_sensor();
        let up = base_from_sensor * Point3::new(0.0, 1.0, 0.0);
        let left = base_from_sensor * Point3::new(1.0, 0.0, 0.0);
        assert!((up - Point3::new(1.0, 0.0, 1.0)).norm() < 1e-12, "{up}");
        assert!((left - Point3::new(1.0, 1.0, 0.0)).norm() < 1e-12, "{left}");
    }

    #[test]
    fn positive_pitch_is_nose_down() {
        let mount = Mount {
            pitch_deg: 7.5,
            ..Mount::default()
        };
        let ahead = mount.base_from_sensor() * Point3::new(8.274, 0.0, 0.0);
        assert!((ahead.z + 1.08).abs() < 1e-3, "{ahead}");
    }
}
