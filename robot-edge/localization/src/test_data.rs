//! Data of several modules' tests.

use measurement::ImuSample;
use measurement::time::{RobotDuration, RobotTime};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::attitude::AttitudeSettings;
use crate::pose_buffer::{InterpolationLimits, JumpLimit};

pub(crate) const LIMITS: InterpolationLimits = InterpolationLimits {
    max_gap: RobotDuration::from_millis(500),
    max_extrapolation: RobotDuration::from_millis(100),
    jump: JumpLimit {
        slack_m: 1.0,
        speed_mps: 20.0,
    },
};

/// Without smoothing.
pub(crate) const ATTITUDE: AttitudeSettings = AttitudeSettings {
    time_offset: RobotDuration::ZERO,
    base_from_imu: UnitQuaternion::new_unchecked(Quaternion::new(1.0, 0.0, 0.0, 0.0)),
    smoothing: RobotDuration::ZERO,
};

pub(crate) fn at(secs: f64) -> RobotTime {
    RobotTime::from_secs_f64(secs).unwrap()
}

pub(crate) fn about(axis: Vector3<f64>, angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(axis * angle_rad)
}

pub(crate) fn imu(orientation_xyzw: Option<[f64; 4]>) -> ImuSample {
    ImuSample {
        orientation_xyzw,
        angular_velocity_radps: [0.0; 3],
        linear_acceleration_mps2: [0.0; 3],
    }
}

pub(crate) fn imu_at(attitude: UnitQuaternion<f64>) -> ImuSample {
    imu(Some(attitude.coords.into()))
}
