//! Poses that are made from what sensors on the vehicle say.

use super::settings::{PoseOrigin, PoseStreams};
use crate::dead_reckoning::{DeadReckoning, StampedPose};
use crate::geodesy::GeodeticPoint;
use crate::gnss_positioning::GnssPositioning;
use measurement::drops::DropCounts;
use measurement::time::RobotDuration;
use measurement::{Measurement, MeasurementData, StreamId};

/// What makes poses, and the streams that it listens to.
#[derive(Clone, Debug)]
pub(super) struct PoseEstimator {
    estimator: Estimator,
    streams: PoseStreams,
}

#[derive(Clone, Debug)]
enum Estimator {
    Wheels(Box<DeadReckoning>),
    Fixes(Box<GnssPositioning>),
}

impl PoseEstimator {
    /// `None` where poses come ready-made.
    pub(super) fn of(origin: &PoseOrigin, streams: PoseStreams) -> Option<Self> {
        let estimator = match origin {
            PoseOrigin::Wheels(settings) => {
                Estimator::Wheels(Box::new(DeadReckoning::new(settings.clone())))
            }
            PoseOrigin::Gps(settings) => {
                Estimator::Fixes(Box::new(GnssPositioning::new(settings.clone())))
            }
            PoseOrigin::Log | PoseOrigin::Tf { .. } | PoseOrigin::Odometry | PoseOrigin::Static => {
                return None;
            }
        };
        Some(Self { estimator, streams })
    }

    /// Takes what it listens to; appends the poses that are known now to `out`, in order.
    pub(super) fn push(&mut self, measurement: &Measurement, out: &mut Vec<StampedPose>) {
        let is_from = |stream: Option<StreamId>| stream.is_none_or(|own| own == measurement.stream);
        let stamp = measurement.stamp;
        match (&mut self.estimator, &measurement.data) {
            (Estimator::Wheels(wheels), MeasurementData::Joints(joints))
                if is_from(self.streams.wheels) =>
            {
                wheels.push_joints(stamp, joints, out);
            }
            (Estimator::Wheels(wheels), MeasurementData::Imu(sample))
                if is_from(self.streams.attitude) =>
            {
                wheels.push_attitude(stamp, sample, out);
            }
            (Estimator::Fixes(fixes), MeasurementData::Fix(fix)) if is_from(self.streams.fixes) => {
                fixes.push_fix(stamp, fix, out);
            }
            (Estimator::Fixes(fixes), MeasurementData::Imu(sample))
                if is_from(self.streams.attitude) =>
            {
                fixes.push_attitude(stamp, sample, out);
            }
            (Estimator::Wheels(_) | Estimator::Fixes(_), _) => {}
        }
    }

    /// The data ended: appends the last poses to `out`.
    pub(super) fn finish(&mut self, out: &mut Vec<StampedPose>) {
        match &mut self.estimator {
            Estimator::Wheels(wheels) => wheels.finish(out),
            Estimator::Fixes(fixes) => fixes.finish(out),
        }
    }

    /// The data's clock started anew.
    pub(super) fn reset(&mut self) {
        match &mut self.estimator {
            Estimator::Wheels(wheels) => wheels.reset(),
            Estimator::Fixes(fixes) => fixes.reset(),
        }
    }

    /// Messages that were left out, by reason.
    pub(super) fn drops(&self) -> &DropCounts {
        match &self.estimator {
            Estimator::Wheels(wheels) => wheels.drops(),
            Estimator::Fixes(fixes) => fixes.drops(),
        }
    }

    /// Where the poses' frame lies on Earth, as far as they are made of fixes.
    pub(super) fn datum(&self) -> Option<GeodeticPoint> {
        match &self.estimator {
            Estimator::Wheels(_) => None,
            Estimator::Fixes(fixes) => fixes.datum(),
        }
    }
}

/// How long after its time a pose is known, beside the periods of those who say it.
pub(super) fn lag(origin: &PoseOrigin) -> RobotDuration {
    match origin {
        PoseOrigin::Wheels(settings) => settings.lag(),
        PoseOrigin::Gps(settings) => settings.lag(),
        PoseOrigin::Log | PoseOrigin::Tf { .. } | PoseOrigin::Odometry | PoseOrigin::Static => {
            RobotDuration::ZERO
        }
    }
}
