//! Attitudes of the vehicle from an attitude sensor, smoothed by a moving average without lag
//! (docs/methods.md, section 0).
//!
//! An AHRS has 0.1° (1σ) of noise at 100 Hz. At a beam length of 8 m that is 1.4 cm per scan, more
//! than the laser's own noise. The window is centred, so an even turn is not delayed; the average
//! is only known half a window later. At the ends of the data the window shrinks on both sides.

use std::collections::VecDeque;

use measurement::drops::DropReason;
use measurement::pose::Pose;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{ImuSample, pose};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::pose_buffer::Segment;
use crate::sample_synchronizer::Bracket;

/// Settings of the attitude sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeSettings {
    /// Added to the sensor's stamps.
    pub time_offset: RobotDuration,
    /// Rotation of the sensor on the vehicle.
    pub base_from_imu: UnitQuaternion<f64>,
    /// Window of the moving average; zero disables it.
    pub smoothing: RobotDuration,
}

impl AttitudeSettings {
    /// Latency of an attitude in time of the data, without the sensor's period; negative if stamps
    /// are shifted ahead by more.
    pub const fn lag(&self) -> RobotDuration {
        let half_window = self.smoothing.as_nanos() / 2;
        RobotDuration::from_nanos(half_window.saturating_sub(self.time_offset.as_nanos()))
    }
}

/// Converts messages to smoothed attitudes of the vehicle.
#[derive(Clone, Debug)]
pub struct AttitudeFilter {
    settings: AttitudeSettings,
    smoothing: AttitudeSmoothing,
}

impl AttitudeFilter {
    /// With these settings.
    pub fn new(settings: AttitudeSettings) -> Self {
        Self {
            smoothing: AttitudeSmoothing::new(settings.smoothing),
            settings,
        }
    }

    /// Takes a message; appends the attitudes that are complete now to `out`, in order.
    ///
    /// # Errors
    /// [`DropReason::BadPose`] if it has no rotation, [`DropReason::Late`] if it is not
    /// newer than the last one.
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

    /// End of the data: appends the last attitudes to `out`.
    pub fn finish(&mut self, out: &mut Vec<StampedAttitude>) {
        self.smoothing.finish(out);
    }

    /// Clock reset.
    pub fn reset(&mut self) {
        *self = Self::new(self.settings);
    }
}

/// The attitude at `stamp`, by slerp.
pub(crate) fn attitude_at(
    around: &Bracket<UnitQuaternion<f64>>,
    stamp: RobotTime,
) -> UnitQuaternion<f64> {
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

/// Limit of the samples in a window, 1 s at 1 kHz; beyond it the window is cut short.
const MAX_WINDOW: usize = 1024;

/// A centred moving average: the normalised sum of the quaternions.
#[derive(Clone, Debug)]
pub struct AttitudeSmoothing {
    half_window: RobotDuration,
    /// From the start of the next output's window; signs aligned.
    samples: VecDeque<(RobotTime, Quaternion<f64>)>,
    /// Index of the next output.
    next: usize,
    first: Option<RobotTime>,
    newest_out: Option<RobotTime>,
}

/// Attitude with its stamp.
pub type StampedAttitude = (RobotTime, UnitQuaternion<f64>);

impl AttitudeSmoothing {
    /// A window of zero or less disables smoothing.
    pub fn new(window: RobotDuration) -> Self {
        let half_window = RobotDuration::from_nanos(window.as_nanos().max(0) / 2);
        Self {
            half_window,
            samples: VecDeque::new(),
            next: 0,
            first: None,
            newest_out: None,
        }
    }

    /// Takes an attitude; appends those that are complete now to `out`, in order.
    ///
    /// # Errors
    /// If it is not newer than the last one; then it is ignored.
    pub fn push(
        &mut self,
        (stamp, attitude): StampedAttitude,
        out: &mut Vec<StampedAttitude>,
    ) -> Result<(), DropReason> {
        let mut quaternion = *attitude.quaternion();
        if let Some((newest, before)) = self.samples.back() {
            if stamp <= *newest {
                return Err(DropReason::Late);
            }
            // q and −q are one rotation, but cancel in a sum.
            if before.coords.dot(&quaternion.coords) < 0.0 {
                quaternion = -quaternion;
            }
        }
        self.first.get_or_insert(stamp);
        self.samples.push_back((stamp, quaternion));
        while self.samples.get(self.next).is_some_and(|(centre, _)| {
            stamp >= *centre + self.half_window || self.samples.len() > MAX_WINDOW
        }) {
            self.emit(out);
        }
        Ok(())
    }

    /// End of the data: emits the rest, over windows that shrink towards the end.
    pub fn finish(&mut self, out: &mut Vec<StampedAttitude>) {
        while self.next < self.samples.len() {
            self.emit(out);
        }
    }

    /// Averages around the next sample. In an unevenly filled window the average is stamped with
    /// the mean of its stamps.
    fn emit(&mut self, out: &mut Vec<StampedAttitude>) {
        let (Some(&(centre, own)), Some(first), Some(&(last, _))) =
            (self.samples.get(self.next), self.first, self.samples.back())
        else {
            return;
        };
        let half = self
            .half_window
            .min(centre.since(first))
            .min(last.since(centre));
        let begins = self
            .samples
            .partition_point(|(stamp, _)| *stamp < centre - half);
        let ends = self
            .samples
            .partition_point(|(stamp, _)| *stamp <= centre + half);
        let mut sum = Quaternion::new(0.0, 0.0, 0.0, 0.0);
        let (mut count, mut after_centre_ns) = (0, 0);
        for (stamp, quaternion) in self.samples.range(begins..ends) {
            sum += quaternion;
            after_centre_ns += stamp.since(centre).as_nanos();
            count += 1;
        }
        let mean = centre + RobotDuration::from_nanos(after_centre_ns / i64::from(count.max(1)));
        // The rotation within the window is too large for a mean.
        let has_mean = sum.norm() > 0.5 * f64::from(count);
        let (stamp, attitude) = if has_mean { (mean, sum) } else { (centre, own) };
        self.next += 1;
        if self.newest_out.is_none_or(|newest| stamp > newest) {
            self.newest_out = Some(stamp);
            out.push((stamp, UnitQuaternion::new_normalize(attitude)));
        }
        self.forget();
    }

    /// Drops samples before all later windows, but never the newest.
    fn forget(&mut self) {
        let Some(&(next, _)) = self.samples.get(self.next).or(self.samples.back()) else {
            return;
        };
        while self.next > 0
            && self.samples.len() > 1
            && self.samples.front().is_some_and(|(stamp, _)| {
                *stamp < next - self.half_window || self.samples.len() > MAX_WINDOW
            })
        {
            self.samples.pop_front();
            self.next -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;
    use crate::test_data::{about, at};

    fn smoothed(window_s: f64, samples: &[StampedAttitude]) -> Vec<StampedAttitude> {
        let mut smoothing = AttitudeSmoothing::new(RobotDuration::from_secs_f64(window_s));
        let mut out = Vec::new();
        for sample in samples {
            smoothing.push(*sample, &mut out).unwrap();
            assert!(smoothing.samples.len() <= MAX_WINDOW + 1);
        }
        smoothing.finish(&mut out);
        out
    }

    proptest! {
        #[test]
        fn a_constant_turn_rate_is_not_delayed(
            axis in prop::array::uniform3(0.1..1.0f64), rate_radps in -2.0..2.0f64,
            start_rad in -3.0..3.0f64, period_ms in 2..50i32,
        ) {
            let attitude = |secs: f64| about(Vector3::from(axis).normalize(), start_rad + rate_radps * secs);
            let secs = (0..100).map(|n| f64::from(n * period_ms) * 1e-3);
            let samples: Vec<_> = secs.map(|secs| (at(secs), attitude(secs))).collect();
            let out = smoothed(0.1, &samples);
            prop_assert_eq!(out.len(), samples.len());
            for (got, expected) in out.iter().zip(&samples) {
                prop_assert_eq!(got.0, expected.0);
                prop_assert!(got.1.angle_to(&expected.1) < 1e-7);
            }
        }

        #[test]
        fn samples_that_are_missing_delay_nothing(
            missing in prop::collection::vec(any::<bool>(), 200), rate_radps in -1.0..1.0f64,
        ) {
            let axis = Vector3::new(0.2, -0.3, 0.9).normalize();
            let samples: Vec<_> = (0..200)
                .zip(&missing)
                .filter(|(_, missing)| !**missing)
                .map(|(n, _)| f64::from(n) * 0.01)
                .map(|secs| (at(secs), about(axis, rate_radps * secs)))
                .collect();
            let out = smoothed(0.1, &samples);
            for (stamp, got) in &out {
                let expected = about(axis, rate_radps * stamp.as_secs_f64());
                prop_assert!(got.angle_to(&expected) < 1e-5, "{}", got.angle_to(&expected));
            }
            prop_assert!(out.is_sorted_by(|a, b| a.0 < b.0));
            prop_assert_eq!(out.first().map(|a| a.0), samples.first().map(|a| a.0));
            prop_assert_eq!(out.last().map(|a| a.0), samples.last().map(|a| a.0));
        }
    }

    #[test]
    fn noise_shrinks_by_the_root_of_the_samples() {
        // ±0.1° alternating: a window of eleven leaves an eleventh of it.
        let noisy = |n: i32| about(Vector3::y(), f64::from(n % 2 * 2 - 1) * 0.1f64.to_radians());
        let samples: Vec<_> = (0..100)
            .map(|n| (at(f64::from(n) * 0.01), noisy(n)))
            .collect();
        let out = smoothed(0.1, &samples);
        for (_, attitude) in &out[5..95] {
            assert!((attitude.angle().to_degrees() - 0.1 / 11.0).abs() < 1e-6);
        }
        assert_eq!(smoothed(0.0, &samples), samples);
    }

    #[test]
    fn either_sign_of_a_quaternion_is_the_same_rotation() {
        let turning = |n: i32| about(Vector3::z(), 3.0 + 0.02 * f64::from(n) * f64::from(n % 3));
        let samples: Vec<_> = (0..40)
            .map(|n| (at(f64::from(n) * 0.01), turning(n)))
            .collect();
        let mut of_either_sign = samples.clone();
        for (_, attitude) in of_either_sign.iter_mut().step_by(2) {
            *attitude = UnitQuaternion::new_unchecked(-*attitude.quaternion());
        }
        let expected = smoothed(0.1, &samples);
        for (got, expected) in smoothed(0.1, &of_either_sign).iter().zip(expected) {
            assert!(got.1.angle_to(&expected.1) < 1e-7);
        }
    }

    #[test]
    fn an_attitude_leaves_half_a_window_later() {
        let mut smoothing = AttitudeSmoothing::new(RobotDuration::from_millis(100));
        let mut out = Vec::new();
        for n in 0..=20 {
            let sample = (at(f64::from(n) * 0.01), UnitQuaternion::identity());
            smoothing.push(sample, &mut out).unwrap();
        }
        assert_eq!(out.last().map(|(stamp, _)| *stamp), Some(at(0.15)));
        assert_eq!(
            smoothing.push((at(0.2), UnitQuaternion::identity()), &mut out),
            Err(DropReason::Late)
        );
    }

    #[test]
    fn a_window_of_too_many_samples_is_cut_short() {
        let samples: Vec<_> = (0..5000)
            .map(|n| {
                let secs = f64::from(n) * 1e-5;
                (at(secs), about(Vector3::z(), secs))
            })
            .collect();
        let out = smoothed(1.0, &samples);
        assert!(out.is_sorted_by(|a, b| a.0 < b.0));
        for (stamp, attitude) in &out {
            assert!((attitude.angle() - stamp.as_secs_f64()).abs() < 1e-6);
        }
        assert_eq!(out.last().map(|a| a.0), samples.last().map(|a| a.0));
    }
}
