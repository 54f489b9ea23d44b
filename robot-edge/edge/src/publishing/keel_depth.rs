//! The depth of the water under the keel, from the sonar's hits of the last minutes. Pure.
//!
//! A sonar that looks ahead measures the bed before the boat is over it, so the hits around the boat are kept.

use std::collections::BTreeMap;

use nalgebra::Point3;

use mapping::registered_scan::{BeamOutcome, RegisteredScan};
use mapping::vehicle::VehicleConfig;
use measurement::pose::Pose;
use measurement::time::{RobotDuration, RobotTime};

/// Side of a cell of the bed, metres.
const CELL_M: f64 = 0.5;
/// Hits farther from the boat are not kept, metres along x and along y.
const REACH_M: f64 = 40.0;
/// Older hits do not count: the water level and the pose drift.
const KEPT_FOR: RobotDuration = RobotDuration::from_millis(120_000);

#[derive(Clone, Debug)]
pub struct KeelDepth {
    vehicle: VehicleConfig,
    /// The highest hit of the newest scan in each cell, in `odom`.
    bed: BTreeMap<[i32; 2], (RobotTime, Point3<f64>)>,
    /// Of the newest scan.
    newest: Option<(RobotTime, Pose)>,
}

impl KeelDepth {
    pub const fn new(vehicle: VehicleConfig) -> Self {
        Self {
            vehicle,
            bed: BTreeMap::new(),
            newest: None,
        }
    }

    pub fn clear(&mut self) {
        self.bed.clear();
        self.newest = None;
    }

    /// Adds a scan of a sonar, later than the ones before.
    pub fn add_scan(&mut self, scan: &RegisteredScan) {
        let at_m = scan.odom_from_base.translation.vector;
        let is_near = |point: &Point3<f64>| {
            (point.x - at_m.x).abs() <= REACH_M && (point.y - at_m.y).abs() <= REACH_M
        };
        self.bed
            .retain(|_, (stamp, point)| is_near(point) && scan.stamp.since(*stamp) <= KEPT_FOR);
        for beam in &scan.beams {
            let hit = beam.end_in_odom;
            if beam.outcome != BeamOutcome::Hit || !is_near(&hit) {
                continue;
            }
            let cell = [hit.x, hit.y].map(|along_m| libm::floor(along_m / CELL_M) as i32);
            let kept = self.bed.entry(cell).or_insert((scan.stamp, hit));
            if kept.0 != scan.stamp || kept.1.z < hit.z {
                *kept = (scan.stamp, hit);
            }
        }
        self.newest = Some((scan.stamp, scan.odom_from_base));
    }

    /// From the lowest point of the boat down to the highest hit under it, metres; negative where the bed is higher.
    pub fn depth_m(&self) -> Option<f64> {
        let (_, odom_from_base) = self.newest?;
        let base_from_odom = odom_from_base.inverse();
        let [half_length_m, half_width_m] =
            [self.vehicle.length_m, self.vehicle.width_m].map(|side_m| 0.5 * side_m);
        let hits = self.bed.values().map(|(_, hit)| base_from_odom * hit);
        hits.filter(|hit| {
            (hit.x - self.vehicle.footprint_offset_m).abs() <= half_length_m
                && hit.y.abs() <= half_width_m
        })
        .map(|hit| self.vehicle.bottom_z_m - hit.z)
        .min_by(f64::total_cmp)
    }
}

#[cfg(test)]
mod tests {
    use mapping::registered_scan::{RegisteredBeam, ScanKind, SensorId};

    use super::*;

    /// A scan of a boat at `x_m` on the way along x, whose sonar hits points of the bed.
    fn scan(secs: i64, x_m: f64, hits: &[[f64; 3]]) -> RegisteredScan {
        let beam = |(index, &hit): (usize, &[f64; 3])| RegisteredBeam {
            origin_in_odom: Point3::new(x_m + 1.8, 0.0, -0.5),
            end_in_odom: Point3::from(hit),
            outcome: if hit[2] < -10.0 {
                BeamOutcome::Miss
            } else {
                BeamOutcome::Hit
            },
            index: index as u32,
            range_m: 1.0,
        };
        RegisteredScan {
            stamp: RobotTime::from_nanos(secs * 1_000_000_000),
            sensor: SensorId(1),
            beam_step_rad: 0.01,
            odom_from_base: Pose::translation(x_m, 0.0, 0.0),
            kind: ScanKind::Beams,
            own_body_hits: 0,
            beams: hits.iter().enumerate().map(beam).collect(),
        }
    }

    #[test]
    fn depth_is_that_of_the_bed_seen_before() {
        let vehicle = VehicleConfig {
            length_m: 4.0,
            width_m: 2.0,
            bottom_z_m: -0.6,
            ..VehicleConfig::default()
        };
        let mut depth = KeelDepth::new(vehicle);
        assert_eq!(depth.depth_m(), None);
        // A slope ahead, one hit beside the way, one miss under the boat.
        let ahead = [
            [10.0, 0.2, -3.0],
            [11.0, 0.2, -2.5],
            [10.0, 3.0, -0.5],
            [0.0, 0.0, -20.0],
        ];
        depth.add_scan(&scan(0, 0.0, &ahead));
        assert_eq!(depth.depth_m(), None, "it is not over them yet");
        depth.add_scan(&scan(10, 8.5, &[]));
        assert_eq!(depth.depth_m(), Some(2.4), "the bow is over the first");
        depth.add_scan(&scan(12, 10.5, &[]));
        assert_eq!(depth.depth_m(), Some(1.9), "the shallower of both");
        // A new scan replaces what was measured in a cell; of one scan the highest hit counts.
        depth.add_scan(&scan(14, 10.5, &[[11.1, 0.1, -4.0], [11.2, 0.1, -3.6]]));
        assert_eq!(depth.depth_m(), Some(2.4));
        depth.add_scan(&scan(121, 10.5, &[]));
        assert_eq!(depth.depth_m(), Some(3.0), "the first scan is too old");
        depth.add_scan(&scan(122, 100.0, &[]));
        depth.add_scan(&scan(123, 10.5, &[]));
        assert_eq!(depth.depth_m(), None, "what is far behind is forgotten");
        depth.add_scan(&scan(124, 10.5, &[[10.0, 0.0, -0.5]]));
        assert!((depth.depth_m().unwrap() + 0.1).abs() < 1e-9, "aground");
        depth.clear();
        assert_eq!(depth.depth_m(), None);
    }
}
