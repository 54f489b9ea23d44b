//! A scan with its beams in `odom`.

use std::ops::Range;

use measurement::pose::Pose;
use measurement::time::RobotTime;
use nalgebra::{Point3, Vector3};

/// Hit or miss.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BeamOutcome {
    /// The beam hit something at its end.
    Hit,
    /// No hit up to the beam's end, the sensor's greatest range.
    Miss,
}

/// One beam, placed with the sensor's pose at its own time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegisteredBeam {
    /// Position of the sensor, metres in `odom`.
    pub origin_in_odom: Point3<f64>,
    /// The hit, or the point at the greatest range, metres in `odom`.
    pub end_in_odom: Point3<f64>,
    /// Hit or miss.
    pub outcome: BeamOutcome,
    /// Index in the sweep, from 0; omitted beams leave gaps.
    pub index: u32,
    /// Measured range, metres; of a miss the greatest range.
    pub range_m: f32,
}

/// What a scan shows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum ScanKind {
    /// Each beam ends at a hit, and what it crosses is free.
    #[default]
    Beams,
    /// The same of a three-dimensional lidar: rings of beams, one after the other, with unused indices between them.
    Cloud,
    /// The nearest echo of a cone lies anywhere on the arc of the hits; nothing is known to be free.
    Arc,
    /// A pressed bumper touches something anywhere along its width; without hits it is released.
    Contact {
        /// Width of the bumper, metres.
        width_m: f32,
    },
}

/// Index of a range sensor, in the order of their names in the configuration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SensorId(pub u8);

/// The valid beams of one scan, in beam order.
#[derive(Clone, Debug, PartialEq)]
pub struct RegisteredScan {
    /// Time of beam 0, with the sensor's time offset.
    pub stamp: RobotTime,
    /// The sensor.
    pub sensor: SensorId,
    /// What its beams show.
    pub kind: ScanKind,
    /// Angle between neighbouring beams, radians, positive.
    pub beam_step_rad: f64,
    /// Pose of the vehicle at that time.
    pub odom_from_base: Pose,
    /// Omitted beams that hit the vehicle itself.
    pub own_body_hits: u32,
    /// Hits and misses.
    pub beams: Vec<RegisteredBeam>,
}

/// Unused indices between two rings of a cloud, so that no filter takes the end of one and the beginning of the next for
/// neighbours.
pub const BETWEEN_RINGS: u32 = 2;

impl RegisteredScan {
    /// Columns of a revolution; 0 if they are not known.
    pub fn columns(&self) -> u32 {
        if self.beam_step_rad > 0.0 {
            libm::round(std::f64::consts::TAU / self.beam_step_rad) as u32
        } else {
            0
        }
    }

    /// Places of the rings in the list of beams, the lowest first; of a planar scan, and of a cloud without rings, all.
    pub fn rings_upwards(&self) -> Vec<Range<usize>> {
        let stride = self.columns() + BETWEEN_RINGS;
        if self.kind != ScanKind::Cloud || stride == BETWEEN_RINGS {
            return std::iter::once(0..self.beams.len()).collect();
        }
        let mut rings: Vec<Range<usize>> = Vec::new();
        let of_same_ring =
            |a: &RegisteredBeam, b: &RegisteredBeam| a.index / stride == b.index / stride;
        for ring in self.beams.chunk_by(of_same_ring) {
            let first = rings.last().map_or(0, |last| last.end);
            rings.push(first..first + ring.len());
        }
        let rise = |ring: &Range<usize>| {
            let beam = &self.beams[ring.start];
            (beam.end_in_odom.z - beam.origin_in_odom.z) / f64::from(beam.range_m)
        };
        if let [lowest, .., highest] = &rings[..]
            && rise(lowest) > rise(highest)
        {
            rings.reverse();
        }
        rings
    }

    /// Fills `above_m` with how far the end of each hit of a cloud is above the highest ground there, metres; not-a-number for a miss,
    /// and where the columns are not known. The ground rises from the vehicle on, and from each nearer hit of the same column, no
    /// steeper than `max_slope`, rise over run (Vosselman 2000, "Slope based filtering of laser altimetry data").
    pub fn above_ground(&self, max_slope: f64, above_m: &mut Vec<f32>) {
        above_m.clear();
        above_m.resize(self.beams.len(), f32::NAN);
        let stride = self.columns() + BETWEEN_RINGS;
        if self.kind != ScanKind::Cloud || stride == BETWEEN_RINGS {
            return;
        }
        let up = self.odom_from_base.rotation * Vector3::z();
        let base = Point3::from(self.odom_from_base.translation.vector);
        // Distance of the last hit of each column, and the highest ground there.
        let mut columns = vec![[0.0_f64; 2]; stride as usize];
        for at in self.rings_upwards().into_iter().flatten() {
            let beam = &self.beams[at];
            if beam.outcome == BeamOutcome::Hit {
                let from_base = beam.end_in_odom - base;
                let height_m = up.dot(&from_base);
                let distance_m = libm::sqrt(from_base.norm_squared() - height_m * height_m);
                let [last_m, highest_m] = &mut columns[(beam.index % stride) as usize];
                let run_m = (distance_m - *last_m).clamp(0.0, LONGEST_RUN_M);
                let ground_m = *highest_m + max_slope * run_m;
                above_m[at] = (height_m - ground_m) as f32;
                *last_m = distance_m;
                *highest_m = ground_m.min(height_m);
            }
        }
    }
}

/// Ground that no beam met rises no farther than this, metres.
const LONGEST_RUN_M: f64 = 3.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rings_come_from_the_lowest_up_whatever_their_order() {
        let beam = |index: u32, z: f64| RegisteredBeam {
            origin_in_odom: Point3::origin(),
            end_in_odom: Point3::new(10.0, 0.0, z),
            outcome: BeamOutcome::Hit,
            index,
            range_m: 10.0,
        };
        let scan = |kind, step_rad, heights_m: [f64; 3]| RegisteredScan {
            stamp: RobotTime::default(),
            sensor: SensorId(0),
            kind,
            beam_step_rad: step_rad,
            odom_from_base: Pose::identity(),
            own_body_hits: 0,
            // 100 columns, and two indices between rings.
            beams: vec![
                beam(5, heights_m[0]),
                beam(99, heights_m[0]),
                beam(102, heights_m[1]),
                beam(204, heights_m[2]),
            ],
        };
        let step_rad = std::f64::consts::TAU / 100.0;
        let rings = |kind, step_rad, heights_m| scan(kind, step_rad, heights_m).rings_upwards();
        let upwards = [-1.0, 0.0, 1.0];
        assert_eq!(
            rings(ScanKind::Cloud, step_rad, upwards),
            [0..2, 2..3, 3..4]
        );
        let downwards = [1.0, 0.0, -1.0];
        assert_eq!(
            rings(ScanKind::Cloud, step_rad, downwards),
            [3..4, 2..3, 0..2]
        );
        for (kind, step_rad) in [(ScanKind::Cloud, 0.0), (ScanKind::Beams, step_rad)] {
            let all = rings(kind, step_rad, upwards);
            assert_eq!((all.len(), all[0].clone()), (1, 0..4));
        }
    }

    /// A ramp of 10 %, a step of 0.5 m on it, and flat ground behind it, where 20 % are ground.
    #[test]
    fn what_is_steeper_than_ground_is_above_it() {
        let ends_m = [
            (2.0, 0.2),
            (3.0, 0.3),
            (3.1, 0.8),
            (3.1, 0.9),
            (6.0, 0.8),
            (16.0, 1.8),
        ];
        let place = Pose::translation(5.0, 7.0, 1.0);
        let beams = (0..).zip(ends_m).map(|(ring, (x_m, z_m))| RegisteredBeam {
            origin_in_odom: place * Point3::new(0.0, 0.0, 1.0),
            end_in_odom: place * Point3::new(x_m, 0.0, z_m),
            outcome: BeamOutcome::Hit,
            index: ring * 102 + 7,
            range_m: libm::hypot(x_m, z_m - 1.0) as f32,
        });
        let mut scan = RegisteredScan {
            stamp: RobotTime::default(),
            sensor: SensorId(0),
            kind: ScanKind::Cloud,
            beam_step_rad: std::f64::consts::TAU / 100.0,
            odom_from_base: place,
            own_body_hits: 0,
            beams: beams.collect(),
        };
        let mut above_m = Vec::new();
        scan.above_ground(0.2, &mut above_m);
        let expected = [-0.2, -0.1, 0.48, 0.58, -0.1, 0.4];
        for (above_m, expected) in above_m.iter().zip(expected) {
            assert!((above_m - expected).abs() < 1e-6, "{above_m} {expected}");
        }
        scan.beam_step_rad = 0.0;
        scan.above_ground(0.2, &mut above_m);
        assert!(above_m.iter().all(|above_m| above_m.is_nan()));
    }
}
