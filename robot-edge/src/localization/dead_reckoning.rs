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

use std::collections::VecDeque;

use nalgebra::{UnitQuaternion, Vector3};

use super::attitude_smoothing::{AttitudeSmoothing, StampedAttitude};
use super::pose_track::Segment;
use super::wheel_odometer::{WheelOdometer, WheelSettings};
use crate::drops::{DropCounts, DropReason};
use crate::measurement::ImuSample;
use crate::pose::{self, Pose};
use crate::robot_time::{RobotDuration, RobotTime};

/// The sensors that poses are reckoned from.
#[derive(Clone, Debug, PartialEq)]
pub struct DeadReckoningSettings {
    /// The encoders.
    pub wheels: WheelSettings,
    /// Added to the encoders' stamps.
    pub wheels_time_offset: RobotDuration,
    /// Added to the attitude sensor's stamps.
    pub attitude_time_offset: RobotDuration,
    /// How the attitude sensor is turned on the vehicle.
    pub base_from_imu: UnitQuaternion<f64>,
    /// Window of the average over attitudes; zero is none.
    pub smoothing: RobotDuration,
    /// Where either sensor is silent for longer, there are no poses, though the way goes on.
    pub max_gap: RobotDuration,
}

impl DeadReckoningSettings {
    /// How long after its time a pose is known, beside the sensors' own periods.
    pub fn lag(&self) -> RobotDuration {
        let half_window = self.smoothing.as_nanos() / 2;
        let of_attitude = half_window.saturating_sub(self.attitude_time_offset.as_nanos());
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
    smoothing: AttitudeSmoothing,
    /// How far the vehicle has come, metres.
    ways: Samples<f64>,
    attitudes: Samples<UnitQuaternion<f64>>,
    smoothed: Vec<StampedAttitude>,
    at: Option<Reckoned>,
    drops: DropCounts,
}

/// A pose and when it was.
pub type StampedPose = (RobotTime, Pose);

#[derive(Clone, Copy, Debug)]
struct Reckoned {
    stamp: RobotTime,
    position_m: Vector3<f64>,
    attitude: UnitQuaternion<f64>,
    way_m: f64,
}

impl DeadReckoning {
    /// Without having seen anything.
    pub fn new(settings: DeadReckoningSettings) -> Self {
        Self {
            odometer: WheelOdometer::new(settings.wheels.clone()),
            smoothing: AttitudeSmoothing::new(settings.smoothing),
            ways: Samples::default(),
            attitudes: Samples::default(),
            smoothed: Vec::new(),
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
            Ok(Some(way_m)) => self.ways.push((stamp, way_m), self.at.is_some()),
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
        let stamp = stamp + self.settings.attitude_time_offset;
        let attitude = sample
            .orientation_xyzw
            .and_then(|xyzw| pose::from_parts([0.0; 3], xyzw))
            .map(|odom_from_imu| odom_from_imu.rotation * self.settings.base_from_imu.inverse());
        let pushed = match attitude {
            Some(attitude) => self.smoothing.push((stamp, attitude), &mut self.smoothed),
            None => Err(DropReason::BadPose),
        };
        self.count(pushed);
        self.take_smoothed();
        self.reckon(out);
    }

    /// The data ended: appends the last poses to `out`.
    pub fn finish(&mut self, out: &mut Vec<StampedPose>) {
        self.smoothing.finish(&mut self.smoothed);
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
            let pushed = self.attitudes.push(sample, self.at.is_some());
            self.count(pushed);
        }
    }

    fn reckon(&mut self, out: &mut Vec<StampedPose>) {
        while let Some(next) = self.next_stamp() {
            let (Some(way), Some(attitude)) = (self.ways.around(next), self.attitudes.around(next))
            else {
                return;
            };
            let reckoned = self.step(next, way_at(way, next), attitude_at(attitude, next));
            self.at = Some(reckoned);
            let max_gap = self.settings.max_gap;
            if is_known(way, next, max_gap) && is_known(attitude, next, max_gap) {
                let pose = Pose::from_parts(reckoned.position_m.into(), reckoned.attitude);
                out.push((next, pose));
            }
            self.ways.forget_before(next);
            self.attitudes.forget_before(next);
        }
    }

    /// The next stamp of either sensor; at first, that from which on both are known.
    fn next_stamp(&self) -> Option<RobotTime> {
        match &self.at {
            None => Some(self.ways.first()?.max(self.attitudes.first()?)),
            Some(at) => Some(
                self.ways
                    .after(at.stamp)?
                    .min(self.attitudes.after(at.stamp)?),
            ),
        }
    }

    /// Along the vehicle's x axis as it stood in the middle of the step.
    fn step(&self, stamp: RobotTime, way_m: f64, attitude: UnitQuaternion<f64>) -> Reckoned {
        let position_m = self.at.map_or(Vector3::zeros(), |at| {
            let (a, b) = (at.attitude.quaternion(), attitude.quaternion());
            let same_sign = if a.coords.dot(&b.coords) < 0.0 {
                -b
            } else {
                *b
            };
            let middle = UnitQuaternion::new_normalize(a + same_sign);
            at.position_m + middle * (Vector3::x() * (way_m - at.way_m))
        });
        Reckoned {
            stamp,
            position_m,
            attitude,
            way_m,
        }
    }
}

type Stamped<T> = (RobotTime, T);

/// Samples in stamp order that wait for the other sensor; before the first pose, and between, the one ahead of
/// the next stamp is kept.
#[derive(Clone, Debug)]
struct Samples<T>(VecDeque<Stamped<T>>);

/// Samples of one sensor that wait for the other at most: 100 s at 100 Hz.
const MAX_SAMPLES: usize = 10_000;

impl<T> Default for Samples<T> {
    fn default() -> Self {
        Self(VecDeque::new())
    }
}

impl<T: Copy> Samples<T> {
    /// Before the first pose the oldest goes where there is no more room; later the newest, because the way
    /// from the last pose on must be known.
    fn push(&mut self, sample: Stamped<T>, has_begun: bool) -> Result<(), DropReason> {
        let is_full = self.0.len() >= MAX_SAMPLES;
        if is_full && has_begun {
            return Err(DropReason::QueueFull);
        }
        self.0.push_back(sample);
        if is_full {
            self.0.pop_front();
        }
        Ok(())
    }

    fn first(&self) -> Option<RobotTime> {
        self.0.front().map(|(stamp, _)| *stamp)
    }

    fn after(&self, stamp: RobotTime) -> Option<RobotTime> {
        let at = self.0.partition_point(|(other, _)| *other <= stamp);
        self.0.get(at).map(|(stamp, _)| *stamp)
    }

    /// The samples at or before and at or after `stamp`.
    fn around(&self, stamp: RobotTime) -> Option<(Stamped<T>, Stamped<T>)> {
        let at = self.0.partition_point(|(other, _)| *other < stamp);
        let after = *self.0.get(at)?;
        if after.0 == stamp {
            return Some((after, after));
        }
        Some((*self.0.get(at.checked_sub(1)?)?, after))
    }

    /// Keeps the last at or before `stamp`.
    fn forget_before(&mut self, stamp: RobotTime) {
        while self.0.get(1).is_some_and(|(second, _)| *second <= stamp) {
            self.0.pop_front();
        }
    }
}

fn is_known<T>(
    (before, after): (Stamped<T>, Stamped<T>),
    stamp: RobotTime,
    max_gap: RobotDuration,
) -> bool {
    after.0 == stamp || after.0.since(before.0) <= max_gap
}

fn way_at((before, after): (Stamped<f64>, Stamped<f64>), stamp: RobotTime) -> f64 {
    let span = after.0.since(before.0).as_nanos();
    if span == 0 {
        return after.1;
    }
    let share = stamp.since(before.0).as_nanos() as f64 / span as f64;
    before.1 + share * (after.1 - before.1)
}

fn attitude_at(
    (before, after): (StampedAttitude, StampedAttitude),
    stamp: RobotTime,
) -> UnitQuaternion<f64> {
    let pose = |attitude| Pose::from_parts(Vector3::zeros().into(), attitude);
    Segment::between(
        (before.0, pose(before.1)),
        (after.0, pose(after.1)),
        after.0,
    )
    .pose_at(stamp)
    .rotation
}

#[cfg(test)]
mod tests;
