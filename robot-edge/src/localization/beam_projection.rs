//! One scan and the sensor's poses in, placed beams out.

use nalgebra::Point3;

use super::beam_fan::BeamFan;
use super::beam_range::{RangeRule, ZeroRange};
use crate::drops::{DropCounts, DropReason};
use crate::mapping::posed_scan::{BeamOutcome, PosedBeam, PosedScan};
use crate::pose::Pose;
use crate::robot_time::{RobotDuration, RobotTime};
use crate::scan::Scan;

/// The sensor whose scans are placed.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorSettings {
    /// Replaces the scans' own smallest range, metres.
    pub range_min_m: Option<f32>,
    /// Replaces the scans' own greatest range, metres.
    pub range_max_m: Option<f32>,
    /// What a range below the smallest one means.
    pub zero: ZeroRange,
    /// Added to the sensor's stamps, to take out its latency.
    pub time_offset: RobotDuration,
    /// Where it is mounted, for pose sources that do not say.
    pub base_from_sensor: Pose,
}

/// The vehicle's outline, centred on its frame: hits inside it are the vehicle itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Along x, metres.
    pub length_m: f64,
    /// Along y, metres.
    pub width_m: f64,
}

impl Footprint {
    fn contains(&self, point_in_base: &Point3<f64>) -> bool {
        point_in_base.x.abs() < 0.5 * self.length_m && point_in_base.y.abs() < 0.5 * self.width_m
    }
}

/// Places the beams of one sensor's scans.
#[derive(Clone, Debug)]
pub struct BeamProjector {
    sensor: SensorSettings,
    footprint: Footprint,
    fan: BeamFan,
    beams_in: u64,
    dropped_beams: DropCounts,
}

impl BeamProjector {
    /// For one sensor on one vehicle.
    pub fn new(sensor: SensorSettings, footprint: Footprint) -> Self {
        let fan = BeamFan::default();
        Self {
            sensor,
            footprint,
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
    ) -> Result<PosedScan, DropReason> {
        let rule = RangeRule {
            range_min_m: self.sensor.range_min_m.unwrap_or(scan.range_min_m),
            range_max_m: self.sensor.range_max_m.unwrap_or(scan.range_max_m),
            zero: self.sensor.zero,
        };
        let directions = self.fan.directions(scan);
        let sweeps = scan.time_increment_s > 0.0;
        let mut odom_from_sensor = odom_from_sensor_at(first_beam)?;
        let base_from_odom = odom_from_base.inverse();
        // No hit farther than this can be on the vehicle.
        let sensor_offset_m = (base_from_odom * odom_from_sensor)
            .translation
            .vector
            .xy()
            .norm();
        let diagonal_m = libm::hypot(self.footprint.length_m, self.footprint.width_m);
        let body_reach_m = sensor_offset_m + 0.5 * diagonal_m;

        let mut beams = Vec::with_capacity(scan.ranges_m.len());
        let (mut invalid, mut own_body) = (0, 0);
        for (beam, (&range_m, &(cos, sin))) in scan.ranges_m.iter().zip(directions).enumerate() {
            if sweeps && beam > 0 {
                let after =
                    RobotDuration::from_secs_f64(beam as f64 * f64::from(scan.time_increment_s));
                odom_from_sensor = odom_from_sensor_at(first_beam + after)?;
            }
            let Some(outcome) = rule.judge(range_m) else {
                invalid += 1;
                continue;
            };
            let length_m = f64::from(match outcome {
                BeamOutcome::Hit => range_m,
                BeamOutcome::Miss => rule.range_max_m,
            });
            let end_in_odom = odom_from_sensor * Point3::new(length_m * cos, length_m * sin, 0.0);
            if outcome == BeamOutcome::Hit
                && length_m < body_reach_m
                && self.footprint.contains(&(base_from_odom * end_in_odom))
            {
                own_body += 1;
                continue;
            }
            let origin_in_odom = Point3::from(odom_from_sensor.translation.vector);
            beams.push(PosedBeam {
                origin_in_odom,
                end_in_odom,
                outcome,
            });
        }
        self.beams_in += scan.ranges_m.len() as u64;
        self.dropped_beams
            .add_many(DropReason::InvalidRange, invalid);
        self.dropped_beams.add_many(DropReason::OwnBody, own_body);
        Ok(PosedScan {
            stamp: first_beam,
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
