//! Poses that are made from what sensors on the vehicle say.

use super::settings::{PoseOrigin, PoseStreams};
use crate::drops::DropCounts;
use crate::localization::dead_reckoning::{DeadReckoning, StampedPose};
use crate::localization::geodesy::GeodeticPoint;
use crate::localization::satellite_positioning::SatellitePositioning;
use crate::measurement::{Measurement, MeasurementData, StreamId};
use crate::robot_time::RobotDuration;

/// What makes poses, and the streams that it listens to.
#[derive(Clone, Debug)]
pub(super) struct Reckoning {
    made_of: MadeOf,
    streams: PoseStreams,
}

#[derive(Clone, Debug)]
enum MadeOf {
    Wheels(Box<DeadReckoning>),
    Fixes(Box<SatellitePositioning>),
}

impl Reckoning {
    /// `None` where poses come ready-made.
    pub(super) fn of(origin: &PoseOrigin, streams: PoseStreams) -> Option<Self> {
        let made_of = match origin {
            PoseOrigin::Wheels(settings) => {
                MadeOf::Wheels(Box::new(DeadReckoning::new(settings.clone())))
            }
            PoseOrigin::Gps(settings) => {
                MadeOf::Fixes(Box::new(SatellitePositioning::new(settings.clone())))
            }
            PoseOrigin::Log | PoseOrigin::Tf { .. } | PoseOrigin::Odometry | PoseOrigin::Static => {
                return None;
            }
        };
        Some(Self { made_of, streams })
    }

    /// Takes what it listens to; appends the poses that are known now to `out`, in order.
    pub(super) fn push(&mut self, measurement: &Measurement, out: &mut Vec<StampedPose>) {
        let is_from = |stream: Option<StreamId>| stream.is_none_or(|own| own == measurement.stream);
        let stamp = measurement.stamp;
        match (&mut self.made_of, &measurement.data) {
            (MadeOf::Wheels(wheels), MeasurementData::Joints(joints))
                if is_from(self.streams.wheels) =>
            {
                wheels.push_joints(stamp, joints, out);
            }
            (MadeOf::Wheels(wheels), MeasurementData::Imu(sample))
                if is_from(self.streams.attitude) =>
            {
                wheels.push_attitude(stamp, sample, out);
            }
            (MadeOf::Fixes(fixes), MeasurementData::Fix(fix)) if is_from(self.streams.fixes) => {
                fixes.push_fix(stamp, fix, out);
            }
            (MadeOf::Fixes(fixes), MeasurementData::Imu(sample))
                if is_from(self.streams.attitude) =>
            {
                fixes.push_attitude(stamp, sample, out);
            }
            (MadeOf::Wheels(_) | MadeOf::Fixes(_), _) => {}
        }
    }

    /// The data ended: appends the last poses to `out`.
    pub(super) fn finish(&mut self, out: &mut Vec<StampedPose>) {
        match &mut self.made_of {
            MadeOf::Wheels(wheels) => wheels.finish(out),
            MadeOf::Fixes(fixes) => fixes.finish(out),
        }
    }

    /// The data's clock started anew.
    pub(super) fn reset(&mut self) {
        match &mut self.made_of {
            MadeOf::Wheels(wheels) => wheels.reset(),
            MadeOf::Fixes(fixes) => fixes.reset(),
        }
    }

    /// Messages that were left out, by reason.
    pub(super) fn drops(&self) -> &DropCounts {
        match &self.made_of {
            MadeOf::Wheels(wheels) => wheels.drops(),
            MadeOf::Fixes(fixes) => fixes.drops(),
        }
    }

    /// Where the poses' frame lies on Earth, as far as they are made of fixes.
    pub(super) fn datum(&self) -> Option<GeodeticPoint> {
        match &self.made_of {
            MadeOf::Wheels(_) => None,
            MadeOf::Fixes(fixes) => fixes.datum(),
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
