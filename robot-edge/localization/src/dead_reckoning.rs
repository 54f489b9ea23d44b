//! Poses from wheel encoders and an attitude sensor [LOD §5.4].
//!
//! The document takes the mean of both wheels as the way that the vehicle has come and projects it by yaw.
//! Here the way follows the whole attitude, pitch too: with the document's projection a vehicle that drives
//! up a ramp of 10° stays at z = 0 and runs 1.5 % too far, so that the ramp bends where it is mapped twice.
//! Sideways slip shows in neither sensor and stays an error of the poses, as in the document.
//!
//! Both sensors keep their own time: stamps are shifted by each sensor's offset, then the way is interpolated
//! at the attitudes' stamps (linearly) and the attitude at the encoders' (by slerp), and there is a pose at
//! every stamp of either.

use nalgebra::{UnitQuaternion, Vector3};

use super::attitude_filter::{AttitudeFilter, AttitudeSettings, attitude_at};
use super::attitude_smoothing::StampedAttitude;
use super::sample_synchronizer::{Bracket, SampleSynchronizer};
use super::wheel_odometer::{WheelOdometer, WheelSettings};
use measurement::ImuSample;
use measurement::drops::{DropCounts, DropReason};
use measurement::pose::Pose;
use measurement::time::{RobotDuration, RobotTime};

/// The sensors that poses are reckoned from.
#[derive(Clone, Debug, PartialEq)]
pub struct DeadReckoningSettings {
    /// The encoders.
    pub wheels: WheelSettings,
    /// Added to the encoders' stamps.
    pub wheels_time_offset: RobotDuration,
    /// The attitude sensor.
    pub attitude: AttitudeSettings,
    /// Where either sensor is silent for longer, there are no poses, though the way goes on.
    pub max_gap: RobotDuration,
}

impl DeadReckoningSettings {
    /// How long after its time a pose is known, beside the sensors' own periods.
    pub fn lag(&self) -> RobotDuration {
        let of_attitude = self.attitude.lag().as_nanos();
        let of_wheels = 0i64.saturating_sub(self.wheels_time_offset.as_nanos());
        RobotDuration::from_nanos(of_attitude.max(of_wheels).max(0))
    }
}

/// Wheel angles and attitudes in, poses of the vehicle out: `odom_from_base`, from the origin on, in the
/// orientation that the attitude sensor reports.
#[derive(Clone, Debug)]
pub struct DeadReckoning {
    settings: DeadReckoningSettings,
    odometer: WheelOdometer,
    attitudes: AttitudeFilter,
    smoothed: Vec<StampedAttitude>,
    /// How far the vehicle has come, metres, and how it stood.
    joined: SampleSynchronizer<f64, UnitQuaternion<f64>>,
    at: Option<ReckonedState>,
    drops: DropCounts,
}

/// A pose and when it was.
pub type StampedPose = (RobotTime, Pose);

#[derive(Clone, Copy, Debug)]
struct ReckonedState {
    position_m: Vector3<f64>,
    attitude: UnitQuaternion<f64>,
    distance_m: f64,
}

impl DeadReckoning {
    /// Without having seen anything.
    pub fn new(settings: DeadReckoningSettings) -> Self {
        Self {
            odometer: WheelOdometer::new(settings.wheels.clone()),
            attitudes: AttitudeFilter::new(settings.attitude),
            smoothed: Vec::new(),
            joined: SampleSynchronizer::default(),
            at: None,
            drops: DropCounts::default(),
            settings,
        }
    }

    /// Takes the angles of joints, radians; appends the poses that are known now to `out`, in order.
    pub fn push_joints(
        &mut self,
        stamp: RobotTime,
        joints: &[(String, f64)],
        out: &mut Vec<StampedPose>,
    ) {
        let stamp = stamp + self.settings.wheels_time_offset;
        let pushed = match self.odometer.push(stamp, joints) {
            Ok(Some(distance_m)) => self.joined.push_a((stamp, distance_m)),
            Ok(None) => Ok(()),
            Err(reason) => Err(reason),
        };
        self.count(pushed);
        self.reckon(out);
    }

    /// Takes an attitude; appends the poses that are known now to `out`, in order.
    pub fn push_attitude(
        &mut self,
        stamp: RobotTime,
        sample: &ImuSample,
        out: &mut Vec<StampedPose>,
    ) {
        let pushed = self.attitudes.push(stamp, sample, &mut self.smoothed);
        self.count(pushed);
        self.take_smoothed();
        self.reckon(out);
    }

    /// The data ended: appends the last poses to `out`.
    pub fn finish(&mut self, out: &mut Vec<StampedPose>) {
        self.attitudes.finish(&mut self.smoothed);
        self.take_smoothed();
        self.reckon(out);
    }

    /// The data's clock started anew: begins again at the origin.
    pub fn reset(&mut self) {
        let drops = std::mem::take(&mut self.drops);
        *self = Self {
            drops,
            ..Self::new(self.settings.clone())
        };
    }

    /// Messages that were left out, by reason.
    pub const fn drops(&self) -> &DropCounts {
        &self.drops
    }

    fn count(&mut self, pushed: Result<(), DropReason>) {
        if let Err(reason) = pushed {
            self.drops.add(reason);
        }
    }

    fn take_smoothed(&mut self) {
        for sample in std::mem::take(&mut self.smoothed) {
            let pushed = self.joined.push_b(sample);
            self.count(pushed);
        }
    }

    fn reckon(&mut self, out: &mut Vec<StampedPose>) {
        while let Some(joint) = self.joined.take_next() {
            let (stamp, distance, attitude) = (joint.stamp, &joint.a, &joint.b);
            let reckoned = self.step(distance_at(distance, stamp), attitude_at(attitude, stamp));
            self.at = Some(reckoned);
            let max_gap = self.settings.max_gap;
            if distance.is_known_at(stamp, max_gap) && attitude.is_known_at(stamp, max_gap) {
                let pose = Pose::from_parts(reckoned.position_m.into(), reckoned.attitude);
                out.push((stamp, pose));
            }
        }
    }

    /// Along the vehicle's x axis as it stood in the middle of the step.
    fn step(&self, distance_m: f64, attitude: UnitQuaternion<f64>) -> ReckonedState {
        let position_m = self.at.map_or(Vector3::zeros(), |at| {
            let (a, b) = (at.attitude.quaternion(), attitude.quaternion());
            let same_sign = if a.coords.dot(&b.coords) < 0.0 {
                -b
            } else {
                *b
            };
            let middle = UnitQuaternion::new_normalize(a + same_sign);
            at.position_m + middle * (Vector3::x() * (distance_m - at.distance_m))
        });
        ReckonedState {
            position_m,
            attitude,
            distance_m,
        }
    }
}

fn distance_at(around: &Bracket<f64>, stamp: RobotTime) -> f64 {
    let (before_m, after_m) = (around.before.1, around.after.1);
    if around.before.0 == around.after.0 {
        return after_m;
    }
    before_m + around.fraction(stamp) * (after_m - before_m)
}

#[cfg(test)]
mod tests;
