//! Poses from wheels, fixes or an attitude sensor, where the source provides none.

use measurement::drops::DropCounts;
use measurement::pose::Pose;
use measurement::time::RobotDuration;
use measurement::{Measurement, MeasurementData, StreamId};
use nalgebra::Vector3;
use protocol::geodesy::GeodeticPoint;

use crate::attitude::{AttitudeFilter, StampedAttitude};
use crate::dead_reckoning::{DeadReckoning, StampedPose};
use crate::gnss_positioning::GnssPositioning;
use crate::registration::{PoseOrigin, PoseStreams};

/// Estimator of poses and its input streams.
#[derive(Clone, Debug)]
pub(super) struct PoseEstimator {
    estimator: Estimator,
    streams: PoseStreams,
}

#[derive(Clone, Debug)]
enum Estimator {
    Wheels(Box<DeadReckoning>),
    Fixes(Box<GnssPositioning>),
    Attitude(Box<AttitudeFilter>, DropCounts),
}

impl PoseEstimator {
    /// `None` if the source provides poses.
    pub(super) fn of(origin: &PoseOrigin, streams: PoseStreams) -> Option<Self> {
        let estimator = match origin {
            PoseOrigin::Wheels(settings) => {
                Estimator::Wheels(Box::new(DeadReckoning::new(settings.clone())))
            }
            PoseOrigin::Gps(settings) => {
                Estimator::Fixes(Box::new(GnssPositioning::new(settings.clone())))
            }
            PoseOrigin::Attitude(settings) => Estimator::Attitude(
                Box::new(AttitudeFilter::new(*settings)),
                DropCounts::default(),
            ),
            PoseOrigin::Log
            | PoseOrigin::Tf { .. }
            | PoseOrigin::Odometry
            | PoseOrigin::Static
            | PoseOrigin::Scans { .. } => return None,
        };
        Some(Self { estimator, streams })
    }

    /// Takes a measurement of its streams; appends the poses that are complete now to `out`, in
    /// order.
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
            (Estimator::Attitude(attitudes, drops), MeasurementData::Imu(sample))
                if is_from(self.streams.attitude) =>
            {
                let mut smoothed = Vec::new();
                if let Err(reason) = attitudes.push(stamp, sample, &mut smoothed) {
                    drops.add(reason);
                }
                out.extend(smoothed.into_iter().map(turned));
            }
            (Estimator::Wheels(_) | Estimator::Fixes(_) | Estimator::Attitude(..), _) => {}
        }
    }

    /// End of the data: appends the last poses to `out`.
    pub(super) fn finish(&mut self, out: &mut Vec<StampedPose>) {
        match &mut self.estimator {
            Estimator::Wheels(wheels) => wheels.finish(out),
            Estimator::Fixes(fixes) => fixes.finish(out),
            Estimator::Attitude(attitudes, _) => {
                let mut smoothed = Vec::new();
                attitudes.finish(&mut smoothed);
                out.extend(smoothed.into_iter().map(turned));
            }
        }
    }

    /// Clock reset.
    pub(super) fn reset(&mut self) {
        match &mut self.estimator {
            Estimator::Wheels(wheels) => wheels.reset(),
            Estimator::Fixes(fixes) => fixes.reset(),
            Estimator::Attitude(attitudes, _) => attitudes.reset(),
        }
    }

    /// Dropped messages, by reason.
    pub(super) fn drops(&self) -> &DropCounts {
        match &self.estimator {
            Estimator::Wheels(wheels) => wheels.drops(),
            Estimator::Fixes(fixes) => fixes.drops(),
            Estimator::Attitude(_, drops) => drops,
        }
    }

    pub(super) fn datum(&self) -> Option<GeodeticPoint> {
        match &self.estimator {
            Estimator::Wheels(_) | Estimator::Attitude(..) => None,
            Estimator::Fixes(fixes) => fixes.datum(),
        }
    }
}

/// Latency of a pose in time of the data, without the sensors' periods.
pub(super) fn lag(origin: &PoseOrigin) -> RobotDuration {
    match origin {
        PoseOrigin::Wheels(settings) => settings.lag(),
        PoseOrigin::Gps(settings) => settings.lag(),
        PoseOrigin::Attitude(settings) => settings.lag(),
        PoseOrigin::Scans { prior, .. } => lag(prior),
        PoseOrigin::Log | PoseOrigin::Tf { .. } | PoseOrigin::Odometry | PoseOrigin::Static => {
            RobotDuration::ZERO
        }
    }
}

/// An attitude at the origin.
fn turned((stamp, attitude): StampedAttitude) -> StampedPose {
    (stamp, Pose::from_parts(Vector3::zeros().into(), attitude))
}
