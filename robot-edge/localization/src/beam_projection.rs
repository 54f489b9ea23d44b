//! One scan and the sensor's poses in, placed beams out.

use nalgebra::{Point3, Vector3};

use super::beam_fan::BeamFan;
use super::beam_range::{RangeLimits, ZeroRange};
use mapping::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, SensorId};
use measurement::drops::{DropCounts, DropReason};
use measurement::pose::Pose;
use measurement::scan::Scan;
use measurement::time::{RobotDuration, RobotTime};

/// The sensor whose scans are placed.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorSettings {
    /// Which of the vehicle's range sensors it is.
    pub id: SensorId,
    /// Replaces the scans' own smallest range, metres.
    pub range_min_m: Option<f32>,
    /// Replaces the scans' own greatest range, metres.
    pub range_max_m: Option<f32>,
    /// What a range below the smallest one means.
    pub zero_range: ZeroRange,
    /// Added to the sensor's stamps, to take out its latency.
    pub time_offset: RobotDuration,
    /// Where it is mounted, for pose sources that do not say.
    pub base_from_sensor: Pose,
}

/// The box that the vehicle fills, centred on its frame in y: hits inside it are the vehicle itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyBox {
    /// Along x, metres.
    pub length_m: f64,
    /// Along y, metres.
    pub width_m: f64,
    /// Its middle ahead of the vehicle's frame, metres.
    pub offset_m: f64,
    /// Its lowest part above the vehicle's frame, metres: negative for a hull.
    pub lowest_m: f64,
    /// Its highest part above the vehicle's frame, metres.
    pub highest_m: f64,
}

/// What noise may carry a hit on the body's top or bottom out of it, metres.
const HEIGHT_MARGIN_M: f64 = 0.05;

impl BodyBox {
    /// Made so high that it holds a sensor at this height: a body whose height is assumed too low would
    /// let a sensor on its top see the mast that carries it.
    fn up_to_sensor(self, sensor_z_m: f64) -> Self {
        Self {
            lowest_m: self.lowest_m.min(sensor_z_m) - HEIGHT_MARGIN_M,
            highest_m: self.highest_m.max(sensor_z_m) + HEIGHT_MARGIN_M,
            ..self
        }
    }

    fn contains(&self, point_in_base: &Point3<f64>) -> bool {
        (point_in_base.x - self.offset_m).abs() < 0.5 * self.length_m
            && point_in_base.y.abs() < 0.5 * self.width_m
            && (self.lowest_m..=self.highest_m).contains(&point_in_base.z)
    }

    /// The distance from a point that no part of it exceeds, metres.
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

/// Places the beams of one sensor's scans.
#[derive(Clone, Debug)]
pub struct BeamProjector {
    sensor: SensorSettings,
    body: BodyBox,
    fan: BeamFan,
    beams_in: u64,
    dropped_beams: DropCounts,
}

impl BeamProjector {
    /// For one sensor on one vehicle.
    pub fn new(sensor: SensorSettings, body: BodyBox) -> Self {
        let fan = BeamFan::default();
        Self {
            sensor,
            body,
            fan,
            beams_in: 0,
            dropped_beams: DropCounts::default(),
        }
    }

    /// Places every valid beam with the sensor's pose at the beam's own time, `odom_from_sensor_at`.
    ///
    /// # Errors
    /// Why a pose is missing: then the whole scan is left out.
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
        Ok(RegisteredScan {
            stamp: first_beam,
            sensor: self.sensor.id,
            beam_step_rad: f64::from(scan.angle_increment_rad.abs()),
            own_body_hits: own_body as u32,
            odom_from_base,
            beams,
        })
    }

    /// Beams of the scans that were placed.
    pub const fn beams_in(&self) -> u64 {
        self.beams_in
    }

    /// Beams left out of placed scans, by reason.
    pub const fn dropped_beams(&self) -> &DropCounts {
        &self.dropped_beams
    }
}
