//! Dead reckoning by wheel encoders and an attitude sensor (docs/methods.md, section 0, pose source (b);
//! \[LOD\] §5.4).
//!
//! The document projects the mean displacement of both wheels by yaw. Here it follows the whole attitude: with yaw
//! alone a vehicle that drives up a ramp of 10° stays at z = 0 and runs 1.5 % too far. Neither sensor measures
//! sideways slip, which remains an error of the poses.
//!
//! The sensors are not synchronous. Stamps are shifted by each sensor's offset; displacement is interpolated
//! linearly at the attitudes' stamps, attitude by slerp at the encoders'. There is a pose at every stamp of either.

use measurement::ImuSample;
use measurement::drops::{DropCounts, DropReason};
use measurement::pose::Pose;
use measurement::time::{RobotDuration, RobotTime};
use nalgebra::{UnitQuaternion, Vector3};

use crate::attitude::{AttitudeFilter, AttitudeSettings, StampedAttitude, attitude_at};
use crate::sample_synchronizer::{Bracket, SampleSynchronizer};

/// Settings of the wheel encoders and the attitude sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct DeadReckoningSettings {
    /// Wheel encoders.
    pub wheels: WheelSettings,
    /// Added to the encoders' stamps.
    pub wheels_time_offset: RobotDuration,
    /// The attitude sensor.
    pub attitude: AttitudeSettings,
    /// Without data of either sensor for longer, no poses are made, but displacement is still
    /// integrated.
    pub max_gap: RobotDuration,
}

impl DeadReckoningSettings {
    /// Latency of a pose in time of the data, without the sensors' periods.
    pub fn lag(&self) -> RobotDuration {
        let of_attitude = self.attitude.lag().as_nanos();
        let of_wheels = 0i64.saturating_sub(self.wheels_time_offset.as_nanos());
        RobotDuration::from_nanos(of_attitude.max(of_wheels).max(0))
    }
}

/// Converts wheel angles and attitudes to poses of the vehicle: `odom_from_base` from the origin,
/// oriented as the attitude sensor reports.
#[derive(Clone, Debug)]
pub struct DeadReckoning {
    settings: DeadReckoningSettings,
    odometer: WheelOdometer,
    attitudes: AttitudeFilter,
    smoothed: Vec<StampedAttitude>,
    /// Displacement, metres, and attitude.
    joined: SampleSynchronizer<f64, UnitQuaternion<f64>>,
    at: Option<ReckonedState>,
    drops: DropCounts,
}

/// Pose with its stamp.
pub type StampedPose = (RobotTime, Pose);

#[derive(Clone, Copy, Debug)]
struct ReckonedState {
    position_m: Vector3<f64>,
    attitude: UnitQuaternion<f64>,
    distance_m: f64,
}

impl DeadReckoning {
    /// With these settings.
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

    /// Takes joint angles, radians; appends the poses that are complete now to `out`, in order.
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

    /// Takes an attitude; appends the poses that are complete now to `out`, in order.
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

    /// End of the data: appends the last poses to `out`.
    pub fn finish(&mut self, out: &mut Vec<StampedPose>) {
        self.attitudes.finish(&mut self.smoothed);
        self.take_smoothed();
        self.reckon(out);
    }

    /// Clock reset: starts again at the origin.
    pub fn reset(&mut self) {
        let drops = std::mem::take(&mut self.drops);
        *self = Self {
            drops,
            ..Self::new(self.settings.clone())
        };
    }

    /// Dropped messages, by reason.
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

    /// Along the vehicle's x axis in the middle of the step.
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

/// Wheel joints and their limits.
#[derive(Clone, Debug, PartialEq)]
pub struct WheelSettings {
    /// Name of the left wheel's joint.
    pub left_joint: String,
    /// Name of the right wheel's joint.
    pub right_joint: String,
    /// Wheel radius, metres.
    pub radius_m: f64,
    /// Greatest speed of a wheel, metres per second.
    pub max_speed_mps: f64,
}

/// Integrates the mean of both wheels (\[LOD\] §5.4), for a vehicle whose wheels do not measure
/// turns.
#[derive(Clone, Debug)]
pub struct WheelOdometer {
    settings: WheelSettings,
    last: Option<(RobotTime, [f64; 2])>,
    travelled_m: f64,
}

/// Tolerance of a step beyond the greatest speed: a pulse of a coarse encoder, or jitter of a
/// stamp.
const SLACK_M: f64 = 0.02;

impl WheelOdometer {
    /// With these settings.
    pub const fn new(settings: WheelSettings) -> Self {
        Self {
            settings,
            last: None,
            travelled_m: 0.0,
        }
    }

    /// Takes the joint angles of one message, radians; returns the displacement since the first,
    /// metres, negative backwards; `None` unless the message holds both wheels.
    ///
    /// # Errors
    /// [`DropReason::Late`] if it is not newer than the last one.
    /// [`DropReason::WheelJump`] if an angle is not finite or turned farther than the wheel can, as
    /// after a counter wrap or reset; later displacements count from there.
    pub fn push(
        &mut self,
        stamp: RobotTime,
        joints: &[(String, f64)],
    ) -> Result<Option<f64>, DropReason> {
        let angle = |wanted: &str| {
            let joint = joints.iter().find(|(name, _)| name == wanted);
            joint.map(|(_, angle_rad)| *angle_rad)
        };
        let wheels = (
            angle(&self.settings.left_joint),
            angle(&self.settings.right_joint),
        );
        let (Some(left_rad), Some(right_rad)) = wheels else {
            return Ok(None);
        };
        let angles_rad = [left_rad, right_rad];
        if self.last.is_some_and(|(newest, _)| stamp <= newest) {
            return Err(DropReason::Late);
        }
        if !angles_rad.iter().all(|angle_rad| angle_rad.is_finite()) {
            return Err(DropReason::WheelJump);
        }
        if let Some((before, [left_before_rad, right_before_rad])) =
            self.last.replace((stamp, angles_rad))
        {
            let left_m = (left_rad - left_before_rad) * self.settings.radius_m;
            let right_m = (right_rad - right_before_rad) * self.settings.radius_m;
            let time_s = stamp.since(before).as_secs_f64();
            let most_m = SLACK_M + self.settings.max_speed_mps * time_s;
            if left_m.abs().max(right_m.abs()) > most_m {
                return Err(DropReason::WheelJump);
            }
            self.travelled_m += 0.5 * (left_m + right_m);
        }
        Ok(Some(self.travelled_m))
    }
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod wheel_odometer_tests {
    use super::*;
    use crate::test_data::at;

    fn odometer() -> WheelOdometer {
        WheelOdometer::new(WheelSettings {
            left_joint: "left".to_owned(),
            right_joint: "right".to_owned(),
            radius_m: 0.5,
            max_speed_mps: 3.0,
        })
    }

    fn push(
        odometer: &mut WheelOdometer,
        secs: f64,
        left_rad: f64,
        right_rad: f64,
    ) -> Result<Option<f64>, DropReason> {
        let joints = [("arm", 7.0), ("right", right_rad), ("left", left_rad)];
        odometer
            .push(
                at(secs),
                &joints.map(|(name, angle_rad)| (name.to_owned(), angle_rad)),
            )
            .map(|distance_m| distance_m.map(|distance_m| (distance_m * 1e9).round() / 1e9))
    }

    #[test]
    fn the_way_is_the_mean_of_both_wheels() {
        let mut odometer = odometer();
        assert_eq!(push(&mut odometer, 1.0, 100.0, -50.0), Ok(Some(0.0)));
        assert_eq!(push(&mut odometer, 1.1, 100.5, -49.75), Ok(Some(0.1875)));
        assert_eq!(push(&mut odometer, 1.2, 100.25, -50.25), Ok(Some(0.0)));
        let stamp = at(1.3);
        let one_wheel = [("left".to_owned(), 3.0), ("arm".to_owned(), f64::NAN)];
        assert_eq!(odometer.push(stamp, &one_wheel), Ok(None));
        assert_eq!(odometer.push(stamp, &[]), Ok(None));
    }

    #[test]
    fn wheels_that_cannot_turn_so_far_do_not_move_the_vehicle() {
        let mut odometer = odometer();
        let jump = Err(DropReason::WheelJump);
        assert_eq!(push(&mut odometer, 1.0, 6.2, 6.2), Ok(Some(0.0)));
        // The right counter wraps after one turn.
        assert_eq!(push(&mut odometer, 1.1, 6.4, 0.1), jump);
        assert_eq!(push(&mut odometer, 1.2, 6.6, 0.3), Ok(Some(0.1)));
        assert_eq!(push(&mut odometer, 1.3, f64::NAN, 0.4), jump);
        assert_eq!(push(&mut odometer, 1.35, 6.7, f64::NEG_INFINITY), jump);
        // The displacement in between is in the next angles.
        assert_eq!(push(&mut odometer, 1.4, 6.8, 0.5), Ok(Some(0.2)));
        assert_eq!(push(&mut odometer, 1.5, 1e308, 0.5), jump);
        assert_eq!(push(&mut odometer, 1.6, -1e308, 0.5), jump);
    }

    #[test]
    fn a_step_at_the_limit_counts() {
        let mut odometer = odometer();
        let ten_at_once = |speed_mps: f64| (SLACK_M + speed_mps * 0.1) / 0.5;
        push(&mut odometer, 1.0, 0.0, 0.0).unwrap();
        let most_rad = ten_at_once(2.999);
        assert!(push(&mut odometer, 1.1, most_rad, most_rad).is_ok());
        let more_rad = most_rad + ten_at_once(3.001);
        assert!(push(&mut odometer, 1.2, more_rad, most_rad).is_err());
    }

    #[test]
    fn stamps_that_go_back_are_late() {
        let mut odometer = odometer();
        push(&mut odometer, 1.0, 0.0, 0.0).unwrap();
        push(&mut odometer, 1.1, 0.2, 0.2).unwrap();
        assert_eq!(push(&mut odometer, 1.05, 0.1, 0.1), Err(DropReason::Late));
        assert_eq!(push(&mut odometer, 1.1, 0.1, 0.1), Err(DropReason::Late));
        assert_eq!(push(&mut odometer, 1.2, 0.4, 0.4), Ok(Some(0.2)));
    }
}
