//! Projects the beams of a scan and the points of a cloud to `odom`, each with the sensor's pose at its own time
//! (docs/methods.md, section 0).

use std::collections::HashSet;

use mapping::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, ScanKind, SensorId};
use measurement::cloud::Cloud;
use measurement::drops::{DropCounts, DropReason};
use measurement::pose::Pose;
use measurement::scan::Scan;
use measurement::time::{RobotDuration, RobotTime};
use nalgebra::{Point3, Vector3};
use rustc_hash::FxBuildHasher;

use crate::cloud_projection::{BeamNumbers, PoseCache, registered_beam};

/// Settings of one range sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorSettings {
    /// Index of the sensor.
    pub id: SensorId,
    /// What its scans show.
    pub kind: ScanKind,
    /// Replaces the scans' smallest range, metres.
    pub range_min_m: Option<f32>,
    /// Replaces the scans' greatest range, metres.
    pub range_max_m: Option<f32>,
    /// Meaning of a range below the smallest one.
    pub zero_range: ZeroRange,
    /// Added to the sensor's stamps, to compensate its latency.
    pub time_offset: RobotDuration,
    /// Of the points of a cloud in a cube of this side, metres, one is kept; 0 keeps all.
    pub thin_m: f64,
    /// Mounting, for pose sources without one.
    pub base_from_sensor: Pose,
}

/// Box of the vehicle's body, centred on its frame in y. Hits inside it are dropped as
/// [`DropReason::OwnBody`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyBox {
    /// Extent along x, metres.
    pub length_m: f64,
    /// Extent along y, metres.
    pub width_m: f64,
    /// Offset of its middle ahead of the vehicle's frame, metres.
    pub offset_m: f64,
    /// Lowest part above the vehicle's frame, metres; negative for a hull.
    pub lowest_m: f64,
    /// Highest part above the vehicle's frame, metres.
    pub highest_m: f64,
}

/// Noise of a hit on the body's top or bottom, metres.
const HEIGHT_MARGIN_M: f64 = 0.05;

impl BodyBox {
    /// Raises the box to contain a sensor at this height, so that a sensor on top does not map its
    /// own mast.
    fn up_to_sensor(self, sensor_z_m: f64) -> Self {
        Self {
            lowest_m: self.lowest_m.min(sensor_z_m) - HEIGHT_MARGIN_M,
            highest_m: self.highest_m.max(sensor_z_m) + HEIGHT_MARGIN_M,
            ..self
        }
    }

    pub(crate) fn contains(&self, point_in_base: &Point3<f64>) -> bool {
        (point_in_base.x - self.offset_m).abs() < 0.5 * self.length_m
            && point_in_base.y.abs() < 0.5 * self.width_m
            && (self.lowest_m..=self.highest_m).contains(&point_in_base.z)
    }

    /// Greatest distance of the box from a point, metres.
    fn max_distance_m(&self, point_in_base: &Point3<f64>) -> f64 {
        let middle_m = 0.5 * (self.lowest_m + self.highest_m);
        let half = Vector3::new(
            0.5 * self.length_m,
            0.5 * self.width_m,
            0.5 * (self.highest_m - self.lowest_m),
        );
        (point_in_base - Point3::new(self.offset_m, 0.0, middle_m)).norm() + half.norm()
    }
}

/// Projects the beams of one sensor's scans.
#[derive(Clone, Debug)]
pub struct BeamProjector {
    sensor: SensorSettings,
    body: BodyBox,
    fan: BeamFan,
    numbers: BeamNumbers,
    beams_in: u64,
    dropped_beams: DropCounts,
}

impl BeamProjector {
    /// With these settings.
    pub fn new(sensor: SensorSettings, body: BodyBox) -> Self {
        let fan = BeamFan::default();
        Self {
            sensor,
            body,
            fan,
            numbers: BeamNumbers::default(),
            beams_in: 0,
            dropped_beams: DropCounts::default(),
        }
    }

    /// Projects every valid beam with `odom_from_sensor_at` its own time.
    ///
    /// # Errors
    /// If a pose is missing; then the whole scan is dropped.
    pub fn project(
        &mut self,
        scan: &Scan,
        first_beam: RobotTime,
        odom_from_base: Pose,
        mut odom_from_sensor_at: impl FnMut(RobotTime) -> Result<Pose, DropReason>,
    ) -> Result<RegisteredScan, DropReason> {
        let rule = RangeLimits {
            range_min_m: self.sensor.range_min_m.unwrap_or(scan.range_min_m),
            range_max_m: self.sensor.range_max_m.unwrap_or(scan.range_max_m),
            zero_range: self.sensor.zero_range,
        };
        let directions = self.fan.directions(scan);
        let sweeps = scan.time_increment_s > 0.0;
        let mut odom_from_sensor = odom_from_sensor_at(first_beam)?;
        if self.sensor.kind != ScanKind::Beams {
            let beams = hits(self.sensor.kind, scan, &rule, directions, &odom_from_sensor)
                .ok_or(DropReason::InvalidRange)?;
            let step_rad = scan.angle_increment_rad.abs().into();
            return Ok(self.registered(step_rad, first_beam, odom_from_base, (beams, 0)));
        }
        let base_from_odom = odom_from_base.inverse();
        let sensor_in_base = base_from_odom * Point3::from(odom_from_sensor.translation.vector);
        let body = self.body.up_to_sensor(sensor_in_base.z);
        let body_max_distance_m = body.max_distance_m(&sensor_in_base);

        let mut beams = Vec::with_capacity(scan.ranges_m.len());
        let (mut invalid, mut own_body) = (0, 0);
        for (beam, (&range_m, &(cos, sin))) in scan.ranges_m.iter().zip(directions).enumerate() {
            if sweeps && beam > 0 {
                let after =
                    RobotDuration::from_secs_f64(beam as f64 * f64::from(scan.time_increment_s));
                odom_from_sensor = odom_from_sensor_at(first_beam + after)?;
            }
            let Some(outcome) = rule.classify(range_m) else {
                invalid += 1;
                continue;
            };
            let length_m = f64::from(match outcome {
                BeamOutcome::Hit => range_m,
                BeamOutcome::Miss => rule.range_max_m,
            });
            let end_in_odom = odom_from_sensor * Point3::new(length_m * cos, length_m * sin, 0.0);
            if outcome == BeamOutcome::Hit
                && length_m < body_max_distance_m
                && body.contains(&(base_from_odom * end_in_odom))
            {
                own_body += 1;
                continue;
            }
            let origin_in_odom = Point3::from(odom_from_sensor.translation.vector);
            beams.push(RegisteredBeam {
                origin_in_odom,
                end_in_odom,
                outcome,
                index: beam as u32,
                range_m: length_m as f32,
            });
        }
        self.beams_in += scan.ranges_m.len() as u64;
        self.dropped_beams
            .add_many(DropReason::InvalidRange, invalid);
        self.dropped_beams.add_many(DropReason::OwnBody, own_body);
        let own_body = own_body as u32;
        let step_rad = scan.angle_increment_rad.abs().into();
        Ok(self.registered(step_rad, first_beam, odom_from_base, (beams, own_body)))
    }

    /// Projects every point of a cloud with this stamp, time offset applied. Points beyond the greatest range are misses.
    ///
    /// # Errors
    /// If a pose is missing; then the whole cloud is dropped.
    pub fn project_cloud(
        &mut self,
        cloud: &Cloud,
        (stamp, first_point): (RobotTime, RobotTime),
        odom_from_base: Pose,
        mut odom_from_sensor_at: impl FnMut(RobotTime) -> Result<Pose, DropReason>,
    ) -> Result<RegisteredScan, DropReason> {
        let rule = RangeLimits {
            range_min_m: self.sensor.range_min_m.unwrap_or(0.0),
            range_max_m: self.sensor.range_max_m.unwrap_or(f32::INFINITY),
            zero_range: self.sensor.zero_range,
        };
        self.numbers.measure(cloud);
        let base_from_odom = odom_from_base.inverse();
        let origin_in_odom = odom_from_sensor_at(first_point)?.translation.vector;
        let sensor_in_base = base_from_odom * Point3::from(origin_in_odom);
        let body = self.body.up_to_sensor(sensor_in_base.z);
        let body_max_distance_m = body.max_distance_m(&sensor_in_base);
        let mut poses = PoseCache::new(stamp, odom_from_sensor_at);
        let mut cubes: HashSet<[i64; 3], FxBuildHasher> = HashSet::default();
        let mut beams = Vec::with_capacity(cloud.points.len());
        let (mut invalid, mut own_body, mut thinned) = (cloud.without_return.into(), 0, 0);
        for (at, point) in cloud.points.iter().enumerate() {
            let [x, y, z] = point.position_m;
            let range_m = libm::sqrtf(x * x + y * y + z * z);
            let Some(outcome) = rule.classify(range_m) else {
                invalid += 1;
                continue;
            };
            let reach_m = range_m.min(rule.range_max_m);
            let odom_from_sensor = poses.pose_after(point.after_s)?;
            let index = self.numbers.index(at, point);
            let beam = registered_beam(point, &odom_from_sensor, (outcome, reach_m), index);
            if outcome == BeamOutcome::Hit
                && f64::from(range_m) < body_max_distance_m
                && body.contains(&(base_from_odom * beam.end_in_odom))
            {
                own_body += 1;
                continue;
            }
            if self.sensor.thin_m > 0.0 {
                let cube = |metres: f64| libm::floor(metres / self.sensor.thin_m) as i64;
                let Point3 { coords } = beam.end_in_odom;
                if !cubes.insert([cube(coords.x), cube(coords.y), cube(coords.z)]) {
                    thinned += 1;
                    continue;
                }
            }
            beams.push(beam);
        }
        let beams = in_order(&beams);
        self.beams_in += cloud.points.len() as u64 + u64::from(cloud.without_return);
        self.dropped_beams
            .add_many(DropReason::InvalidRange, invalid);
        self.dropped_beams.add_many(DropReason::OwnBody, own_body);
        self.dropped_beams.add_many(DropReason::Thinned, thinned);
        let beams = (beams, own_body as u32);
        Ok(self.registered(self.numbers.step_rad(), first_point, odom_from_base, beams))
    }

    fn registered(
        &self,
        beam_step_rad: f64,
        stamp: RobotTime,
        odom_from_base: Pose,
        (beams, own_body_hits): (Vec<RegisteredBeam>, u32),
    ) -> RegisteredScan {
        RegisteredScan {
            stamp,
            sensor: self.sensor.id,
            kind: self.sensor.kind,
            beam_step_rad,
            own_body_hits,
            odom_from_base,
            beams,
        }
    }

    /// Beams of the registered scans.
    pub const fn beams_in(&self) -> u64 {
        self.beams_in
    }

    /// Beams dropped from registered scans, by reason.
    pub const fn dropped_beams(&self) -> &DropCounts {
        &self.dropped_beams
    }
}

/// Beams by index. Keys are sorted, which are cheaper to move than beams.
fn in_order(beams: &[RegisteredBeam]) -> Vec<RegisteredBeam> {
    let keys = (0..).zip(beams);
    let mut keys: Vec<u64> = keys
        .map(|(place, beam): (u64, _)| u64::from(beam.index) << 32 | place)
        .collect();
    keys.sort_unstable();
    let beams = keys.into_iter().map(|key| beams[key as u32 as usize]);
    beams.collect()
}

/// The hits of an arc, or along the y axis of a pressed bumper; `None` where a range is invalid.
fn hits(
    kind: ScanKind,
    scan: &Scan,
    rule: &RangeLimits,
    directions: &[(f64, f64)],
    odom_from_sensor: &Pose,
) -> Option<Vec<RegisteredBeam>> {
    let last = scan.ranges_m.len().saturating_sub(1).max(1) as f64;
    let mut hits = Vec::new();
    for (beam, (&range_m, &(cos, sin))) in scan.ranges_m.iter().zip(directions).enumerate() {
        // REP 117: nearer than the sensor measures, or within a fixed-distance ranger's reach. It may touch the sensor.
        let range_m = if range_m == f32::NEG_INFINITY {
            0.0
        } else if rule.classify(range_m)? == BeamOutcome::Miss {
            continue;
        } else {
            range_m
        };
        let length_m = f64::from(range_m);
        let end_in_sensor = match kind {
            ScanKind::Beams | ScanKind::Cloud | ScanKind::Arc => {
                Point3::new(length_m * cos, length_m * sin, 0.0)
            }
            ScanKind::Contact { width_m } => {
                Point3::new(0.0, f64::from(width_m) * (beam as f64 / last - 0.5), 0.0)
            }
        };
        hits.push(RegisteredBeam {
            origin_in_odom: Point3::from(odom_from_sensor.translation.vector),
            end_in_odom: odom_from_sensor * end_in_sensor,
            outcome: BeamOutcome::Hit,
            index: beam as u32,
            range_m,
        });
    }
    Some(hits)
}

/// Limits for classifying ranges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeLimits {
    /// Smallest range that is a measurement, metres.
    pub range_min_m: f32,
    /// Ranges at or above this are misses, metres.
    pub range_max_m: f32,
    /// Meaning of a range below `range_min_m`, 0 included.
    pub zero_range: ZeroRange,
}

/// Meaning of a range below the sensor's smallest one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ZeroRange {
    /// Dirt on the window, a fault, an object too near.
    #[default]
    Invalid,
    /// No return, for sensors that report it this way.
    Miss,
}

impl RangeLimits {
    /// Classifies a range, in this order (docs/methods.md, section 0): NaN, −∞ or negative is
    /// invalid (`None`); +∞ or ≥ `range_max_m` is a miss; < `range_min_m` is as `zero_range` says;
    /// the rest are hits.
    pub fn classify(&self, range_m: f32) -> Option<BeamOutcome> {
        if range_m.is_nan() || range_m < 0.0 {
            None
        } else if range_m >= self.range_max_m {
            Some(BeamOutcome::Miss)
        } else if range_m < self.range_min_m {
            match self.zero_range {
                ZeroRange::Invalid => None,
                ZeroRange::Miss => Some(BeamOutcome::Miss),
            }
        } else {
            Some(BeamOutcome::Hit)
        }
    }
}

/// Cosine and sine of every beam's angle, cached for scans of the same shape.
#[derive(Clone, Debug, Default)]
pub struct BeamFan {
    angle_min_rad: f32,
    angle_increment_rad: f32,
    directions: Vec<(f64, f64)>,
}

impl BeamFan {
    /// `(cos, sin)` of each beam's angle in the sensor's plane.
    pub fn directions(&mut self, scan: &Scan) -> &[(f64, f64)] {
        let same_shape = self.angle_min_rad.to_bits() == scan.angle_min_rad.to_bits()
            && self.angle_increment_rad.to_bits() == scan.angle_increment_rad.to_bits();
        if !same_shape {
            self.angle_min_rad = scan.angle_min_rad;
            self.angle_increment_rad = scan.angle_increment_rad;
            self.directions.clear();
        }
        for beam in self.directions.len()..scan.ranges_m.len() {
            let angle_rad =
                f64::from(scan.angle_min_rad) + beam as f64 * f64::from(scan.angle_increment_rad);
            self.directions
                .push((libm::cos(angle_rad), libm::sin(angle_rad)));
        }
        &self.directions[..scan.ranges_m.len()]
    }
}

#[cfg(test)]
mod beam_range_tests {
    use super::*;

    #[test]
    fn ranges_are_judged_in_order() {
        let rule = RangeLimits {
            range_min_m: 0.1,
            range_max_m: 20.0,
            zero_range: ZeroRange::Invalid,
        };
        for (range, expected) in [
            (f32::NAN, None),
            (f32::NEG_INFINITY, None),
            (-0.5, None),
            (f32::INFINITY, Some(BeamOutcome::Miss)),
            (20.0, Some(BeamOutcome::Miss)),
            (81.91, Some(BeamOutcome::Miss)),
            (0.0, None),
            (0.099, None),
            (0.1, Some(BeamOutcome::Hit)),
            (19.999, Some(BeamOutcome::Hit)),
        ] {
            assert_eq!(rule.classify(range), expected, "{range}");
        }
        let trusting = RangeLimits {
            zero_range: ZeroRange::Miss,
            ..rule
        };
        assert_eq!(trusting.classify(0.0), Some(BeamOutcome::Miss));
        assert_eq!(trusting.classify(-0.5), None);
    }
}

#[cfg(test)]
mod beam_fan_tests {
    use super::*;

    #[test]
    fn directions_follow_the_shape_of_each_scan() {
        let scan = |angle_min_rad, beams| Scan {
            angle_min_rad,
            angle_increment_rad: 0.5,
            ranges_m: vec![1.0; beams],
            ..Scan::default()
        };
        let mut fan = BeamFan::default();
        assert_eq!(
            fan.directions(&scan(0.0, 2)),
            [(1.0, 0.0), (libm::cos(0.5), libm::sin(0.5))]
        );
        assert_eq!(
            fan.directions(&scan(0.0, 3))[2],
            (libm::cos(1.0), libm::sin(1.0))
        );
        assert_eq!(
            fan.directions(&scan(-1.0, 1)),
            [(libm::cos(-1.0), libm::sin(-1.0))]
        );
    }
}
