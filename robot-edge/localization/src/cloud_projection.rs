//! Projects the points of a cloud to `odom`, each with the sensor's pose at its own time (docs/methods.md, section 0).

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

use mapping::registered_scan::{BETWEEN_RINGS, BeamOutcome, RegisteredBeam};
use measurement::cloud::{Cloud, CloudPoint};
use measurement::drops::DropReason;
use measurement::pose::Pose;
use measurement::time::{RobotDuration, RobotTime};
use nalgebra::Point3;
use rustc_hash::FxBuildHasher;

/// Columns of a revolution; a sensor with more has neighbours that are the same beam.
const MAX_COLUMNS: f64 = 8192.0;
/// The step between columns is measured again when it differs by more.
const STEP_TOLERANCE: f64 = 0.2;
/// Indices between two points of no known ring, of which none are neighbours.
const APART: u32 = 8;
/// So many steps between points are enough to know the one in the middle.
const STEPS: usize = 4096;

/// Gives the points of a cloud the index of their beam: rings one after the other, in each the columns of a revolution, clockwise.
///
/// Column by azimuth, so that the same beam has the same index in the next revolution.
#[derive(Clone, Debug, Default)]
pub(crate) struct BeamNumbers {
    /// Angle from column to column, radians; 0 if it is not known.
    step_rad: f64,
}

impl BeamNumbers {
    pub(crate) const fn step_rad(&self) -> f64 {
        self.step_rad
    }

    /// Measures the angle between columns: the one in the middle of those between consecutive points of the same ring.
    pub(crate) fn measure(&mut self, cloud: &Cloud) {
        let mut last: HashMap<u16, f64, FxBuildHasher> = HashMap::default();
        let steps_rad = cloud.points.iter().filter_map(|point| {
            let azimuth_rad = azimuth_rad(point);
            let before_rad = last.insert(point.ring?, azimuth_rad)?;
            let turned_rad = (azimuth_rad - before_rad).abs();
            let turned_rad = turned_rad.min(TAU - turned_rad);
            // The second return of a beam has nearly the azimuth of the first.
            (turned_rad > TAU / MAX_COLUMNS).then_some(turned_rad)
        });
        let mut steps_rad: Vec<_> = steps_rad.take(STEPS).collect();
        if steps_rad.is_empty() {
            self.step_rad = 0.0;
            return;
        }
        let middle = steps_rad.len() / 2;
        let step_rad = *steps_rad.select_nth_unstable_by(middle, f64::total_cmp).1;
        if (step_rad - self.step_rad).abs() > STEP_TOLERANCE * self.step_rad {
            self.step_rad = TAU / libm::round(TAU / step_rad);
        }
    }

    /// Index of the `at`-th point of a cloud.
    pub(crate) fn index(&self, at: usize, point: &CloudPoint) -> u32 {
        let Some(ring) = point.ring.filter(|_| self.step_rad > 0.0) else {
            return (at as u32).saturating_mul(APART);
        };
        let columns = libm::round(TAU / self.step_rad) as u32;
        let column = ((PI - azimuth_rad(point)) / self.step_rad) as u32 % columns;
        u32::from(ring) * (columns + BETWEEN_RINGS) + column
    }
}

fn azimuth_rad(point: &CloudPoint) -> f64 {
    let [x, y, _] = point.position_m;
    libm::atan2f(y, x).into()
}

/// Poses of the sensor at the times of the points: many have the same.
pub(crate) struct PoseCache<F> {
    stamp: RobotTime,
    odom_from_sensor_at: F,
    poses: HashMap<u32, Pose, FxBuildHasher>,
}

impl<F: FnMut(RobotTime) -> Result<Pose, DropReason>> PoseCache<F> {
    /// For a cloud with this stamp.
    pub(crate) fn new(stamp: RobotTime, odom_from_sensor_at: F) -> Self {
        Self {
            stamp,
            odom_from_sensor_at,
            poses: HashMap::default(),
        }
    }

    pub(crate) fn pose_after(&mut self, after_s: f32) -> Result<Pose, DropReason> {
        if let Some(pose) = self.poses.get(&after_s.to_bits()) {
            return Ok(*pose);
        }
        let at = self.stamp + RobotDuration::from_secs_f64(after_s.into());
        let pose = (self.odom_from_sensor_at)(at)?;
        self.poses.insert(after_s.to_bits(), pose);
        Ok(pose)
    }
}

/// A point in `odom`: a hit, or at `range_max_m` where it is farther.
pub(crate) fn registered_beam(
    point: &CloudPoint,
    odom_from_sensor: &Pose,
    (outcome, range_m): (BeamOutcome, f32),
    index: u32,
) -> RegisteredBeam {
    let position = Point3::from(point.position_m.map(f64::from));
    let length_m = position.coords.norm();
    let end = match outcome {
        BeamOutcome::Hit => position,
        BeamOutcome::Miss => position * (f64::from(range_m) / length_m),
    };
    RegisteredBeam {
        origin_in_odom: Point3::from(odom_from_sensor.translation.vector),
        end_in_odom: odom_from_sensor * end,
        outcome,
        index,
        range_m,
    }
}
