//! Poses from GNSS fixes and an attitude sensor (docs/methods.md, section 0, pose source (c); \[HYB\] §2.2).
//!
//! Positions are those of the antenna, metres east, north and up of the first fix (the datum). The attitude is in
//! the same axes (REP-103, REP-105: yaw 0 is east), and the lever arm to the antenna is subtracted with it. Fixes
//! come at 1 to 20 Hz and a boat rolls in between, so there is a pose at every stamp of either sensor: the antenna's
//! position is interpolated linearly, the attitude by slerp.
//!
//! A single outlier is a multipath error and is dropped. Fixes that stay at an outlier for
//! [`OUTLIER_CONFIRMATION`] are accepted; that is a pose jump.

use measurement::drops::{DropCounts, DropReason};
use measurement::pose::Pose;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{GeodeticFix, ImuSample};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use protocol::geodesy::{GeodeticPoint, LocalTangentPlane};

use crate::attitude::{AttitudeFilter, AttitudeSettings, StampedAttitude, attitude_at};
use crate::dead_reckoning::StampedPose;
use crate::pose_buffer::JumpLimit;
use crate::sample_synchronizer::{Bracket, SampleSynchronizer, Stamped};

/// Time of the data after which fixes that stay at an outlier are accepted.
pub const OUTLIER_CONFIRMATION: RobotDuration = RobotDuration::from_millis(1000);

/// Settings of the receiver and the attitude sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct GnssSettings {
    /// Added to the stamps of fixes.
    pub fix_time_offset: RobotDuration,
    /// Position of the antenna on the vehicle, metres.
    pub antenna_in_base: Vector3<f64>,
    /// The attitude sensor.
    pub attitude: AttitudeSettings,
    /// Fixes farther apart than this are outliers.
    pub outlier_limit: JumpLimit,
    /// Without data of either sensor for longer, no poses are made.
    pub max_gap: RobotDuration,
}

impl GnssSettings {
    /// Greatest latency of a pose in time of the data: the next fix may be up to `max_gap` away.
    pub fn lag(&self) -> RobotDuration {
        let of_fixes = self
            .max_gap
            .as_nanos()
            .saturating_sub(self.fix_time_offset.as_nanos());
        RobotDuration::from_nanos(of_fixes.max(self.attitude.lag().as_nanos()).max(0))
    }
}

/// Converts fixes and attitudes to poses of the vehicle: `odom_from_base`, where `odom` is east,
/// north and up of the datum.
#[derive(Clone, Debug)]
pub struct GnssPositioning {
    settings: GnssSettings,
    plane: Option<LocalTangentPlane>,
    fixes: FixFilter,
    attitudes: AttitudeFilter,
    smoothed: Vec<StampedAttitude>,
    joined: SampleSynchronizer<Point3<f64>, UnitQuaternion<f64>>,
    drops: DropCounts,
}

impl GnssPositioning {
    /// With these settings.
    pub fn new(settings: GnssSettings) -> Self {
        Self {
            plane: None,
            fixes: FixFilter::new(settings.outlier_limit),
            attitudes: AttitudeFilter::new(settings.attitude),
            smoothed: Vec::new(),
            joined: SampleSynchronizer::default(),
            drops: DropCounts::default(),
            settings,
        }
    }

    /// Takes a fix; appends the poses that are complete now to `out`, in order.
    pub fn push_fix(&mut self, stamp: RobotTime, fix: &GeodeticFix, out: &mut Vec<StampedPose>) {
        let stamp = stamp + self.settings.fix_time_offset;
        let taken = geodetic_point(fix).and_then(|place| {
            let plane = self
                .plane
                .get_or_insert_with(|| LocalTangentPlane::new(place));
            let antenna = (stamp, plane.enu_from_geodetic(&place).into());
            self.fixes.check(&antenna)?;
            self.joined.push_a(antenna)
        });
        self.count(taken);
        self.join(out);
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
        self.join(out);
    }

    /// End of the data: appends the last poses to `out`.
    pub fn finish(&mut self, out: &mut Vec<StampedPose>) {
        self.attitudes.finish(&mut self.smoothed);
        self.take_smoothed();
        self.join(out);
    }

    /// Clock reset. The datum is kept.
    pub fn reset(&mut self) {
        let (plane, drops) = (self.plane.take(), std::mem::take(&mut self.drops));
        *self = Self {
            plane,
            drops,
            ..Self::new(self.settings.clone())
        };
    }

    /// Dropped messages, by reason.
    pub const fn drops(&self) -> &DropCounts {
        &self.drops
    }

    /// Origin of `odom`; `None` before the first fix.
    pub fn datum(&self) -> Option<GeodeticPoint> {
        self.plane.as_ref().map(LocalTangentPlane::datum)
    }

    fn count(&mut self, taken: Result<(), DropReason>) {
        if let Err(reason) = taken {
            self.drops.add(reason);
        }
    }

    fn take_smoothed(&mut self) {
        for sample in std::mem::take(&mut self.smoothed) {
            let pushed = self.joined.push_b(sample);
            self.count(pushed);
        }
    }

    fn join(&mut self, out: &mut Vec<StampedPose>) {
        while let Some(joined) = self.joined.take_next() {
            let (stamp, antenna, attitude) = (joined.stamp, &joined.a, &joined.b);
            let max_gap = self.settings.max_gap;
            if antenna.is_known_at(stamp, max_gap) && attitude.is_known_at(stamp, max_gap) {
                let attitude = attitude_at(attitude, stamp);
                let base = antenna_at(antenna, stamp) - attitude * self.settings.antenna_in_base;
                out.push((stamp, Pose::from_parts(base.coords.into(), attitude)));
            }
        }
    }
}

fn antenna_at(around: &Bracket<Point3<f64>>, stamp: RobotTime) -> Point3<f64> {
    let (before, after) = (around.before.1, around.after.1);
    if around.before.0 == around.after.0 {
        return after;
    }
    before + (after - before) * around.fraction(stamp)
}

/// Where a fix is, or why it is none.
pub(crate) fn geodetic_point(fix: &GeodeticFix) -> Result<GeodeticPoint, DropReason> {
    if fix.status < 0 {
        return Err(DropReason::NoFix);
    }
    let is_on_earth = fix.latitude_deg.abs() <= 90.0
        && fix.longitude_deg.abs() <= 360.0
        && fix.altitude_m.abs() <= MAX_ALTITUDE_M;
    is_on_earth
        .then_some(GeodeticPoint {
            latitude_deg: fix.latitude_deg,
            longitude_deg: fix.longitude_deg,
            altitude_m: fix.altitude_m,
        })
        .ok_or(DropReason::BadFix)
}

/// Greatest distance from the ellipsoid, metres.
const MAX_ALTITUDE_M: f64 = 100_000.0;

/// Detects outliers.
#[derive(Clone, Debug)]
struct FixFilter {
    outlier_limit: JumpLimit,
    newest: Option<RobotTime>,
    accepted: Option<Stamped<Point3<f64>>>,
    /// Time of the first fix at an outlier, and the newest one there.
    outlier: Option<(RobotTime, Stamped<Point3<f64>>)>,
}

impl FixFilter {
    const fn new(outlier_limit: JumpLimit) -> Self {
        Self {
            outlier_limit,
            newest: None,
            accepted: None,
            outlier: None,
        }
    }

    fn check(&mut self, fix: &Stamped<Point3<f64>>) -> Result<(), DropReason> {
        if self.newest.is_some_and(|newest| fix.0 <= newest) {
            return Err(DropReason::Late);
        }
        self.newest = Some(fix.0);
        let is_outlier_from = |before: &Stamped<Point3<f64>>| {
            let pose = |at: &Stamped<Point3<f64>>| {
                let place = Pose::from_parts(at.1.coords.into(), UnitQuaternion::identity());
                (at.0, place)
            };
            self.outlier_limit
                .between(&pose(before), &pose(fix))
                .is_some()
        };
        if self
            .accepted
            .as_ref()
            .is_none_or(|accepted| !is_outlier_from(accepted))
        {
            self.accepted = Some(*fix);
            self.outlier = None;
            return Ok(());
        }
        let since = match &self.outlier {
            Some((since, newest)) if !is_outlier_from(newest) => *since,
            Some(_) | None => fix.0,
        };
        if fix.0.since(since) >= OUTLIER_CONFIRMATION {
            self.accepted = Some(*fix);
            self.outlier = None;
            return Ok(());
        }
        self.outlier = Some((since, *fix));
        Err(DropReason::GnssOutlier)
    }
}

#[cfg(test)]
mod tests;
