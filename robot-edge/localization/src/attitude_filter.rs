//! Attitudes of the vehicle from the messages of an attitude sensor.

use nalgebra::{UnitQuaternion, Vector3};

use super::attitude_smoothing::{AttitudeSmoothing, StampedAttitude};
use super::pose_buffer::Segment;
use super::sample_synchronizer::Bracket;
use measurement::ImuSample;
use measurement::drops::DropReason;
use measurement::pose::{self, Pose};
use measurement::time::{RobotDuration, RobotTime};

/// The attitude sensor, and how its messages are read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeSettings {
    /// Added to the sensor's stamps.
    pub time_offset: RobotDuration,
    /// How the sensor is turned on the vehicle.
    pub base_from_imu: UnitQuaternion<f64>,
    /// Window of the average over attitudes; zero is none.
    pub smoothing: RobotDuration,
}

impl AttitudeSettings {
    /// How long after its time an attitude is known, beside the sensor's own period; negative where stamps are
    /// shifted ahead by more.
    pub const fn lag(&self) -> RobotDuration {
        let half_window = self.smoothing.as_nanos() / 2;
        RobotDuration::from_nanos(half_window.saturating_sub(self.time_offset.as_nanos()))
    }
}

/// Messages in, smoothed attitudes of the vehicle out.
#[derive(Clone, Debug)]
pub struct AttitudeFilter {
    settings: AttitudeSettings,
    smoothing: AttitudeSmoothing,
}

impl AttitudeFilter {
    /// Without having seen anything.
    pub fn new(settings: AttitudeSettings) -> Self {
        Self {
            smoothing: AttitudeSmoothing::new(settings.smoothing),
            settings,
        }
    }

    /// Takes a message; appends the attitudes that are known now to `out`, in order.
    ///
    /// # Errors
    /// [`DropReason::BadPose`] where it gives no rotation, [`DropReason::Late`] where it is not behind the newest.
    pub fn push(
        &mut self,
        stamp: RobotTime,
        sample: &ImuSample,
        out: &mut Vec<StampedAttitude>,
    ) -> Result<(), DropReason> {
        let fixed_from_imu = sample
            .orientation_xyzw
            .and_then(|xyzw| pose::from_parts([0.0; 3], xyzw))
            .ok_or(DropReason::BadPose)?;
        let attitude = fixed_from_imu.rotation * self.settings.base_from_imu.inverse();
        self.smoothing
            .push((stamp + self.settings.time_offset, attitude), out)
    }

    /// The data ended: appends the last attitudes to `out`.
    pub fn finish(&mut self, out: &mut Vec<StampedAttitude>) {
        self.smoothing.finish(out);
    }
}

/// The attitude at `stamp`, by slerp.
pub fn attitude_at(around: &Bracket<UnitQuaternion<f64>>, stamp: RobotTime) -> UnitQuaternion<f64> {
    let Bracket { before, after } = around;
    let pose = |attitude| Pose::from_parts(Vector3::zeros().into(), attitude);
    Segment::between(
        (before.0, pose(before.1)),
        (after.0, pose(after.1)),
        after.0,
    )
    .pose_at(stamp)
    .rotation
}
