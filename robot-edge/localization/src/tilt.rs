//! A range sensor that a servo tilts about the sensor's y axis.

use measurement::StreamId;
use measurement::drops::DropReason;
use measurement::pose::Pose;
use measurement::time::{RobotDuration, RobotTime};
use nalgebra::{Quaternion, UnitQuaternion};

/// Relation of a joint's angle to the tilt.
#[derive(Clone, Debug, PartialEq)]
pub struct TiltSettings {
    /// Name of the joint.
    pub joint: String,
    /// Stream of the angles; `None` accepts any stream with the joint.
    pub stream: Option<StreamId>,
    /// Tilt per joint angle.
    pub scale: f64,
    /// Tilt at joint angle zero, radians, positive nose down.
    pub offset_rad: f64,
    /// Added to the stamps of the angles.
    pub time_offset: RobotDuration,
}

impl TiltSettings {
    /// Stamp and pose of the sensor by the joint angles of one message, radians; `base_from_sensor`
    /// is its mounting before it is tilted. `None` without the joint.
    ///
    /// # Errors
    /// [`DropReason::BadPose`] if the angle is not finite.
    pub fn pose(
        &self,
        stamp: RobotTime,
        joints: &[(String, f64)],
        base_from_sensor: &Pose,
    ) -> Option<Result<(RobotTime, Pose), DropReason>> {
        let (_, joint_rad) = joints.iter().find(|(name, _)| *name == self.joint)?;
        let angle_rad = self.scale * joint_rad + self.offset_rad;
        if !angle_rad.is_finite() {
            return Some(Err(DropReason::BadPose));
        }
        let half_rad = 0.5 * angle_rad;
        let about_y = Quaternion::new(libm::cos(half_rad), 0.0, libm::sin(half_rad), 0.0);
        let mut tilted = *base_from_sensor;
        tilted.rotation *= UnitQuaternion::new_normalize(about_y);
        Some(Ok((stamp + self.time_offset, tilted)))
    }

    /// Whether angles of `stream` are used.
    pub fn uses_stream(&self, stream: StreamId) -> bool {
        self.stream.is_none_or(|own| own == stream)
    }

    /// Latency of an angle in time of the data, without the encoder's period.
    pub fn lag(&self) -> RobotDuration {
        RobotDuration::from_nanos(0i64.saturating_sub(self.time_offset.as_nanos()).max(0))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::test_data::at;
    use measurement::pose::planar;

    fn tilt(scale: f64, offset_rad: f64) -> TiltSettings {
        TiltSettings {
            joint: "tilt".to_owned(),
            stream: None,
            scale,
            offset_rad,
            time_offset: RobotDuration::from_millis(-40),
        }
    }

    #[test]
    fn a_joint_turns_the_nose_down_about_the_sensors_own_axis() {
        let joints = [("left", 7.0), ("tilt", 0.3)].map(|(name, rad)| (name.to_owned(), rad));
        // A sensor that faces left: its y axis is the vehicle's −x.
        let mount = planar(1.0, 2.0, std::f64::consts::FRAC_PI_2);
        for (scale, offset_rad, angle_rad) in [(1.0, 0.0, 0.3), (-1.0, 0.1, -0.2)] {
            let (stamp, pose) = tilt(scale, offset_rad)
                .pose(at(5.0), &joints, &mount)
                .unwrap()
                .unwrap();
            let ahead = pose * Point3::new(10.0, 0.0, 0.0);
            let expected = Point3::new(
                1.0,
                2.0 + 10.0 * libm::cos(angle_rad),
                -10.0 * libm::sin(angle_rad),
            );
            assert!((ahead - expected).norm() < 1e-12, "{ahead}");
            assert_eq!(stamp, at(4.96));
        }
    }

    #[test]
    fn other_joints_are_ignored_and_invalid_angles_refused() {
        let of = |name: &str, rad: f64| {
            let joints = [(name.to_owned(), rad)];
            tilt(1.0, 0.0).pose(at(0.0), &joints, &Pose::identity())
        };
        assert_eq!(of("wheel", 1.0), None);
        assert_eq!(of("tilt", f64::NAN), Some(Err(DropReason::BadPose)));
        assert_eq!(of("tilt", f64::INFINITY), Some(Err(DropReason::BadPose)));
    }

    #[test]
    fn an_encoder_that_is_late_by_its_offset_is_waited_for() {
        assert_eq!(tilt(1.0, 0.0).lag(), RobotDuration::from_millis(40));
        let mut early = tilt(1.0, 0.0);
        early.time_offset = RobotDuration::from_millis(40);
        assert_eq!(early.lag(), RobotDuration::ZERO);
    }
}
