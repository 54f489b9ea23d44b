//! A scan with its beams in `odom`.

use std::ops::Range;

use measurement::pose::Pose;
use measurement::time::RobotTime;
use nalgebra::Point3;

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
}

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
}
