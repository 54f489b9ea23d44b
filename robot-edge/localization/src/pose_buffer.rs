//! Pose buffer: the poses of one frame over time, interpolated (docs/methods.md, section 0), and
//! pose jumps.

use std::collections::VecDeque;

use measurement::drops::DropReason;
use measurement::pose::Pose;
use measurement::time::{RobotDuration, RobotTime};
use nalgebra::{Quaternion, UnitQuaternion};

/// Limits of interpolation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InterpolationLimits {
    /// Longest time between samples that is interpolated.
    pub max_gap: RobotDuration,
    /// Longest extrapolation past the newest sample.
    pub max_extrapolation: RobotDuration,
    /// A step beyond this is not interpolated.
    pub jump: JumpLimit,
}

/// In stamp order, stamps are unique.
#[derive(Clone, Debug, Default)]
pub struct PoseBuffer {
    samples: VecDeque<(RobotTime, Pose)>,
}

/// Limit of the samples, 10 s at 1 kHz.
const MAX_SAMPLES: usize = 10_000;

impl PoseBuffer {
    /// Adds a sample. Of equal stamps the later in file order wins.
    pub fn insert(&mut self, stamp: RobotTime, pose: Pose) {
        let at = self.samples.partition_point(|(other, _)| *other < stamp);
        match self.samples.get_mut(at) {
            Some(sample) if sample.0 == stamp => sample.1 = pose,
            Some(_) | None => self.samples.insert(at, (stamp, pose)),
        }
        if self.samples.len() > MAX_SAMPLES {
            self.samples.pop_front();
        }
    }

    /// The jump from the newest sample to this one, if it is one.
    pub fn jump_to(
        &self,
        stamp: RobotTime,
        pose: Pose,
        limits: &InterpolationLimits,
    ) -> Option<PoseJump> {
        let newest = self.samples.back().filter(|(newest, _)| *newest < stamp)?;
        limits.jump.between(newest, &(stamp, pose))
    }

    /// Removes samples before `stamp`, but never the newest, which decides the reason for a missing
    /// pose.
    pub fn forget_before(&mut self, stamp: RobotTime) {
        while self.samples.len() > 1 && self.samples.front().is_some_and(|(old, _)| *old < stamp) {
            self.samples.pop_front();
        }
    }

    /// Stamp of the newest sample.
    pub fn newest(&self) -> Option<RobotTime> {
        self.samples.back().map(|(stamp, _)| *stamp)
    }

    /// The segment that gives poses at `stamp`.
    ///
    /// # Errors
    /// The reason for a missing pose.
    pub fn segment(
        &self,
        stamp: RobotTime,
        limits: &InterpolationLimits,
    ) -> Result<Segment, DropReason> {
        let (Some(&first), Some(&last)) = (self.samples.front(), self.samples.back()) else {
            return Err(DropReason::NoPose);
        };
        let at = self.samples.partition_point(|(other, _)| *other < stamp);
        match self.samples.get(at) {
            // A sample at exactly this stamp needs no neighbour.
            Some(&sample) if sample.0 == stamp => Ok(Segment::still(sample)),
            Some(_) if at == 0 => {
                debug_assert!(stamp < first.0);
                Err(DropReason::BeforeFirstPose)
            }
            Some(&after) => {
                let before = self.samples[at - 1];
                if after.0.since(before.0) > limits.max_gap {
                    return Err(DropReason::PoseGap);
                }
                if limits.jump.between(&before, &after).is_some() {
                    return Err(DropReason::PoseJump);
                }
                Ok(Segment::between(before, after, after.0))
            }
            None if stamp.since(last.0) > limits.max_extrapolation => {
                Err(DropReason::AfterLastPose)
            }
            None => {
                let before = self.samples.len().checked_sub(2).map(|at| self.samples[at]);
                let until = last.0 + limits.max_extrapolation;
                let is_motion = |before: &(RobotTime, Pose)| {
                    last.0.since(before.0) <= limits.max_gap
                        && limits.jump.between(before, &last).is_none()
                };
                Ok(match before.filter(is_motion) {
                    Some(before) => Segment::between(before, last, until),
                    // A single pose has no velocity.
                    None => Segment {
                        until,
                        ..Segment::still(last)
                    },
                })
            }
        }
    }
}

/// Interpolation between two samples, and extrapolation after them: translation linear, rotation by
/// slerp.
#[derive(Clone, Debug)]
pub struct Segment {
    from: (RobotTime, Pose),
    to: (RobotTime, Pose),
    until: RobotTime,
    /// Angle between the two quaternions as 4D vectors, radians.
    angle_rad: f64,
    sin_angle: f64,
}

impl Segment {
    fn still(sample: (RobotTime, Pose)) -> Self {
        Self {
            from: sample,
            to: sample,
            until: sample.0,
            angle_rad: 0.0,
            sin_angle: 0.0,
        }
    }

    /// From one sample to the next, extrapolated until `until`.
    pub(super) fn between(
        from: (RobotTime, Pose),
        mut to: (RobotTime, Pose),
        until: RobotTime,
    ) -> Self {
        let (a, b) = (from.1.rotation.quaternion(), to.1.rotation.quaternion());
        let mut cos_angle = a.coords.dot(&b.coords);
        if cos_angle < 0.0 {
            // q and −q are one rotation: use the nearer one.
            to.1.rotation = UnitQuaternion::new_unchecked(-*b);
            cos_angle = -cos_angle;
        }
        let angle_rad = libm::acos(cos_angle.min(1.0));
        Self {
            from,
            to,
            until,
            angle_rad,
            sin_angle: libm::sin(angle_rad),
        }
    }

    /// Whether the segment gives a pose at `stamp`.
    pub fn covers(&self, stamp: RobotTime) -> bool {
        self.from.0 <= stamp && stamp <= self.until
    }

    /// The pose at `stamp`.
    pub fn pose_at(&self, stamp: RobotTime) -> Pose {
        let span = self.to.0.since(self.from.0).as_nanos();
        if span == 0 {
            return self.from.1;
        }
        let t = stamp.since(self.from.0).as_nanos() as f64 / span as f64;
        let translation = self
            .from
            .1
            .translation
            .vector
            .lerp(&self.to.1.translation.vector, t);
        Pose::from_parts(translation.into(), self.rotation_at(t))
    }

    fn rotation_at(&self, t: f64) -> UnitQuaternion<f64> {
        // Below this angle the series is exact in f64.
        const SMALL_RAD: f64 = 0.02;
        let (a, b) = (self.from.1.rotation.coords, self.to.1.rotation.coords);
        if self.angle_rad < SMALL_RAD {
            let square = self.angle_rad * self.angle_rad;
            let (wa, wb) = (small_weight(1.0 - t, square), small_weight(t, square));
            // Already of unit length.
            return UnitQuaternion::new_unchecked(Quaternion::from(a * wa + b * wb));
        }
        let weight = |t: f64| libm::sin(t * self.angle_rad) / self.sin_angle;
        UnitQuaternion::new_normalize(Quaternion::from(a * weight(1.0 - t) + b * weight(t)))
    }
}

/// `sin(t·θ) / sin θ` for small θ from θ², by a series: two sines per beam would dominate the cost.
fn small_weight(t: f64, square: f64) -> f64 {
    let tt = t * t;
    let sixth = (31.0 - 18.0 * tt + 3.0 * tt * tt) * (1.0 / 15120.0);
    let fourth = (7.0 - 3.0 * tt) * (1.0 / 360.0);
    t + t * (1.0 - tt) * square * (1.0 / 6.0 + square * (fourth + square * sixth))
}

/// Greatest step between two consecutive poses: `slack_m` plus `speed_mps` times the time between
/// them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JumpLimit {
    /// Independent of time, metres.
    pub slack_m: f64,
    /// Greatest speed with the error of stamps, metres per second.
    pub speed_mps: f64,
}

/// Pose jump: the map before it and the data after it do not fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseJump {
    /// Stamp of the first pose after it.
    pub stamp: RobotTime,
    /// Metres.
    pub distance_m: f64,
}

impl JumpLimit {
    /// The jump between two poses, if it is one.
    pub fn between(
        &self,
        before: &(RobotTime, Pose),
        after: &(RobotTime, Pose),
    ) -> Option<PoseJump> {
        let way = after.1.translation.vector - before.1.translation.vector;
        let distance_m = way.norm();
        let time_s = after.0.since(before.0).as_secs_f64().abs();
        (distance_m > self.slack_m + self.speed_mps * time_s).then_some(PoseJump {
            stamp: after.0,
            distance_m,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use proptest::prelude::*;

    use super::*;
    use crate::test_data::{LIMITS, at};
    use measurement::pose::{planar, yaw_rad};

    fn track(samples: &[(f64, Pose)]) -> PoseBuffer {
        let mut track = PoseBuffer::default();
        for (secs, pose) in samples {
            track.insert(at(*secs), *pose);
        }
        track
    }

    fn x_at(track: &PoseBuffer, secs: f64) -> Result<f64, DropReason> {
        let x = track
            .segment(at(secs), &LIMITS)?
            .pose_at(at(secs))
            .translation
            .x;
        Ok((x * 1e6).round() / 1e6)
    }

    #[test]
    fn poses_are_interpolated_and_extrapolated() {
        let track = track(&[
            (1.0, planar(0.0, 0.0, 0.0)),
            (1.4, planar(4.0, 0.0, FRAC_PI_2)),
        ]);
        assert_eq!(x_at(&track, 1.1), Ok(1.0));
        assert_eq!(x_at(&track, 1.5), Ok(5.0));
        assert_eq!(x_at(&track, 1.500_000_001), Err(DropReason::AfterLastPose));
        assert_eq!(x_at(&track, 0.999), Err(DropReason::BeforeFirstPose));
        let yaw = yaw_rad(&track.segment(at(1.1), &LIMITS).unwrap().pose_at(at(1.1)));
        assert!((yaw - FRAC_PI_2 / 4.0).abs() < 1e-9, "{yaw}");
    }

    #[test]
    fn a_gap_is_not_bridged_but_a_sample_at_the_stamp_counts() {
        let track = track(&[(1.0, planar(1.0, 0.0, 0.0)), (1.501, planar(2.0, 0.0, 0.0))]);
        assert_eq!(x_at(&track, 1.2), Err(DropReason::PoseGap));
        assert_eq!(x_at(&track, 1.0), Ok(1.0));
        assert_eq!(x_at(&track, 1.501), Ok(2.0));
        // The motion before a gap is not extrapolated.
        assert_eq!(x_at(&track, 1.55), Ok(2.0));
        assert_eq!(x_at(&PoseBuffer::default(), 1.0), Err(DropReason::NoPose));
    }

    #[test]
    fn a_jump_is_neither_bridged_nor_extrapolated() {
        let track = track(&[
            (1.0, planar(1.0, 0.0, 0.0)),
            (1.1, planar(2.0, 0.0, 0.0)),
            (1.2, planar(7.0, 0.0, 0.0)),
        ]);
        assert_eq!(x_at(&track, 1.05), Ok(1.5));
        assert_eq!(x_at(&track, 1.1), Ok(2.0));
        assert_eq!(x_at(&track, 1.15), Err(DropReason::PoseJump));
        assert_eq!(x_at(&track, 1.2), Ok(7.0));
        assert_eq!(x_at(&track, 1.25), Ok(7.0));
    }

    #[test]
    fn of_equal_stamps_the_later_wins_and_old_samples_go() {
        let mut track = track(&[(1.0, planar(1.0, 0.0, 0.0)), (1.0, planar(7.0, 0.0, 0.0))]);
        assert_eq!(x_at(&track, 1.0), Ok(7.0));
        track.insert(at(1.5), planar(0.0, 0.0, 0.0));
        track.forget_before(at(1.2));
        assert_eq!(x_at(&track, 1.0), Err(DropReason::BeforeFirstPose));
        track.forget_before(at(99.0));
        assert_eq!(x_at(&track, 1.5), Ok(0.0));
    }

    #[test]
    fn slerp_takes_the_short_way_across_half_a_turn() {
        let track = track(&[(0.0, planar(0.0, 0.0, 3.0)), (0.2, planar(0.0, 0.0, -3.0))]);
        let yaw = yaw_rad(&track.segment(at(0.1), &LIMITS).unwrap().pose_at(at(0.1)));
        assert!((yaw.abs() - std::f64::consts::PI).abs() < 1e-9, "{yaw}");
    }

    proptest! {
        #[test]
        fn slerp_agrees_with_nalgebra(
            a in prop::array::uniform3(-3.0..3.0f64), b in prop::array::uniform3(-3.0..3.0f64),
            t in 0.0..1.0f64,
        ) {
            let rotation = |v: [f64; 3]| UnitQuaternion::from_scaled_axis(v.into());
            let pose = |v| Pose::from_parts(nalgebra::Translation3::identity(), rotation(v));
            prop_assume!(rotation(a).angle_to(&rotation(b)) < 3.0);
            let track = track(&[(0.0, pose(a)), (0.4, pose(b))]);
            let stamp = at(0.4 * t);
            let got = track.segment(stamp, &LIMITS).unwrap().pose_at(stamp).rotation;
            let t = stamp.as_secs_f64() / 0.4;
            let expected = rotation(a).slerp(&rotation(b), t);
            prop_assert!(got.angle_to(&expected) < 1e-7, "{}", got.angle_to(&expected));
        }
    }

    #[test]
    fn a_jump_is_farther_than_slack_and_driving_explain() {
        let limit = JumpLimit {
            slack_m: 1.0,
            speed_mps: 3.0,
        };
        let pose = |secs, x_m, y_m| (at(secs), planar(x_m, y_m, 0.0));
        let before = pose(10.0, 1.0, 1.0);
        for (secs, x_m, y_m, is_jump) in [
            (10.0, 2.0, 1.0, false),
            (10.5, 1.0, 3.5, false),
            (10.5, 4.0, 5.0, true),
            // A long gap allows a long step.
            (12.0, 4.0, 5.0, false),
            // Stamps that go back are no jump.
            (8.0, 4.0, 5.0, false),
        ] {
            let jump = limit.between(&before, &pose(secs, x_m, y_m));
            let expected = PoseJump {
                stamp: at(secs),
                distance_m: 5.0,
            };
            assert_eq!(jump, is_jump.then_some(expected), "{secs} s");
        }
    }
}
