//! Rigid transforms, named `target_from_source`.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

/// A rigid transform in metres. `odom_from_base * point_in_base` is a point in `odom`.
pub type Pose = Isometry3<f64>;

/// A pose in the plane: metres and radians, z = 0, yaw about z.
pub fn planar(x_m: f64, y_m: f64, yaw_rad: f64) -> Pose {
    let half = 0.5 * yaw_rad;
    let rotation = Quaternion::new(libm::cos(half), 0.0, 0.0, libm::sin(half));
    Pose::from_parts(
        Translation3::new(x_m, y_m, 0.0),
        UnitQuaternion::new_normalize(rotation),
    )
}

/// A pose from a translation and a quaternion (x, y, z, w) of a message.
///
/// `None` if a number is not finite or the quaternion's length is not within 1 % of 1: repairing it
/// would distort the map.
pub fn from_parts(translation_m: [f64; 3], quaternion_xyzw: [f64; 4]) -> Option<Pose> {
    let [x, y, z, w] = quaternion_xyzw;
    let norm = libm::sqrt(x * x + y * y + z * z + w * w);
    let finite = translation_m.iter().all(|value| value.is_finite());
    (finite && (norm - 1.0).abs() < 0.01).then(|| {
        Pose::from_parts(
            Translation3::from(Vector3::from(translation_m)),
            UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)),
        )
    })
}

/// Yaw about z of `pose`, radians in (−π, π] (REP-103).
pub fn yaw_rad(pose: &Pose) -> f64 {
    let q = pose.rotation.quaternion();
    libm::atan2(
        2.0 * (q.w * q.k + q.i * q.j),
        1.0 - 2.0 * (q.j * q.j + q.k * q.k),
    )
}

/// Pitch about y of `pose`, radians in [−π/2, π/2], positive nose down (REP-103).
pub fn pitch_rad(pose: &Pose) -> f64 {
    let q = pose.rotation.quaternion();
    libm::asin((2.0 * (q.w * q.j - q.k * q.i)).clamp(-1.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planar_pose_turns_left() {
        let point =
            planar(1.0, 2.0, std::f64::consts::FRAC_PI_2) * nalgebra::Point3::new(3.0, 0.0, 0.0);
        assert!(
            (point - nalgebra::Point3::new(1.0, 5.0, 0.0)).norm() < 1e-12,
            "{point}"
        );
        assert!((yaw_rad(&planar(0.0, 0.0, -2.5)) + 2.5).abs() < 1e-12);
    }

    #[test]
    fn senseless_poses_are_refused() {
        assert!(from_parts([0.0; 3], [0.0; 4]).is_none());
        assert!(from_parts([f64::NAN, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]).is_none());
        assert!(from_parts([0.0; 3], [0.0, 0.0, 0.0, f64::INFINITY]).is_none());
        assert!(from_parts([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.001]).is_some());
    }
}
