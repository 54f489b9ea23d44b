//! Radial outlier filter (docs/methods.md, section 0; \[HYB\] §4.3.1, which uses PCL's).

use nalgebra::Point3;

use crate::registered_scan::{BeamOutcome, RegisteredScan, SensorId};

/// Least radius within which a neighbour confirms a hit, metres.
const LEAST_RADIUS_M: f64 = 0.1;
/// Radius in distances of neighbouring beams at the hit.
const RADIUS_BEAMS: f64 = 3.0;
/// Neighbouring beams on either side, in this scan and in the previous one.
const BESIDE: usize = 2;
/// Limit of the beam index: 128 rings of 2048 columns.
const MAX_BEAMS: usize = 128 * (2048 + 2);

/// Decides which hits are confirmed by neighbouring beams of the same and the previous scan.
#[derive(Clone, Debug, Default)]
pub(crate) struct RadialFilter {
    /// Hits of the previous scan by beam index, for each sensor.
    before: Vec<(SensorId, Hits)>,
    now: Hits,
}

/// Hits by beam index.
type Hits = Vec<Option<Point3<f64>>>;

impl RadialFilter {
    /// Sets for each beam whether it is a hit with fewer than `min_neighbours` neighbours.
    pub(crate) fn isolated(
        &mut self,
        scan: &RegisteredScan,
        min_neighbours: u8,
        isolated: &mut Vec<bool>,
    ) {
        isolated.clear();
        isolated.resize(scan.beams.len(), false);
        // Without a step between beams nobody knows their neighbours.
        if min_neighbours == 0 || scan.beam_step_rad <= 0.0 {
            return;
        }
        let place = self
            .before
            .iter()
            .position(|(sensor, _)| *sensor == scan.sensor);
        let place = place.unwrap_or_else(|| {
            self.before.push((scan.sensor, Vec::new()));
            self.before.len() - 1
        });
        self.collect(scan);
        let before = &self.before[place].1;
        for (beam, isolated) in scan.beams.iter().zip(isolated) {
            if beam.outcome == BeamOutcome::Miss {
                continue;
            }
            let spacing_m = f64::from(beam.range_m) * scan.beam_step_rad;
            let radius_m = (RADIUS_BEAMS * spacing_m).max(LEAST_RADIUS_M);
            let number = beam.index as usize;
            let beside = [&self.now, before].into_iter().flat_map(|hits| {
                let last = (number + BESIDE + 1).min(hits.len());
                hits.get(number.saturating_sub(BESIDE)..last)
                    .unwrap_or_default()
            });
            let is_near = |hit: &&Point3<f64>| {
                (**hit - beam.end_in_odom).norm_squared() <= radius_m * radius_m
            };
            // The hit itself is within the radius.
            let wanted = usize::from(min_neighbours) + 1;
            *isolated = beside.flatten().filter(is_near).take(wanted).count() < wanted;
        }
        std::mem::swap(&mut self.before[place].1, &mut self.now);
    }

    pub(crate) fn reset(&mut self) {
        self.before.clear();
    }

    fn collect(&mut self, scan: &RegisteredScan) {
        self.now.clear();
        for beam in &scan.beams {
            let number = beam.index as usize;
            if beam.outcome == BeamOutcome::Hit && number < MAX_BEAMS {
                if number >= self.now.len() {
                    self.now.resize(number + 1, None);
                }
                self.now[number] = Some(beam.end_in_odom);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registered_scan::{RegisteredBeam, ScanKind};
    use measurement::pose::Pose;
    use measurement::time::RobotTime;

    /// Parallel beams straight ahead at these ranges; 0 is a miss.
    fn scan(ranges_m: &[f64]) -> RegisteredScan {
        let beams = (0..).zip(ranges_m).map(|(index, &range_m)| RegisteredBeam {
            origin_in_odom: Point3::origin(),
            end_in_odom: Point3::new(range_m, 0.02 * f64::from(index), 0.0),
            outcome: if range_m > 0.0 {
                BeamOutcome::Hit
            } else {
                BeamOutcome::Miss
            },
            index,
            range_m: range_m as f32,
        });
        RegisteredScan {
            stamp: RobotTime::from_nanos(0),
            sensor: SensorId(0),
            beam_step_rad: 0.004,
            kind: ScanKind::Beams,
            own_body_hits: 0,
            odom_from_base: Pose::identity(),
            beams: beams.collect(),
        }
    }

    fn isolated(filter: &mut RadialFilter, ranges_m: &[f64], min_neighbours: u8) -> Vec<usize> {
        let mut found = Vec::new();
        filter.isolated(&scan(ranges_m), min_neighbours, &mut found);
        (0..found.len()).filter(|&beam| found[beam]).collect()
    }

    #[test]
    fn a_lonely_hit_is_noise_until_the_next_scan_confirms_it() {
        let mut filter = RadialFilter::default();
        let ranges = [5.0, 5.0, 5.0, 2.0, 0.0, 0.0, 7.0, 7.05];
        assert_eq!(isolated(&mut filter, &ranges, 2), [3, 6, 7]);
        assert_eq!(
            isolated(&mut filter, &ranges, 2),
            [3],
            "two of itself are not two others"
        );
        assert_eq!(isolated(&mut filter, &ranges, 1), [] as [usize; 0]);
        assert_eq!(isolated(&mut filter, &ranges, 0), [] as [usize; 0]);
    }

    #[test]
    fn far_neighbours_may_be_farther_apart() {
        let mut filter = RadialFilter::default();
        assert_eq!(isolated(&mut filter, &[3.0, 3.2, 3.4], 1), [0, 1, 2]);
        filter.reset();
        assert_eq!(
            isolated(&mut filter, &[30.0, 30.2, 30.4], 1),
            [] as [usize; 0]
        );
    }
}
