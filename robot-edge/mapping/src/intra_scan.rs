//! `IntraScan`: how wide and smooth what a beam hit is within its scan.
//!
//! \[HYB\] §6.1 (*Hybrid 3D perception on land and water*), equations 6.1 and 6.2, algorithm 1. The moving
//! average over voxels is not made here.

use super::cost_config::MetricsConfig;
use super::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan};

/// Measures scans; each for itself, nothing is kept between them.
#[derive(Clone, Debug)]
pub struct IntraScan {
    config: MetricsConfig,
}

/// A run of neighbouring beams whose ranges change alike.
#[derive(Clone, Copy, Debug)]
struct Segment {
    /// Where its first beam stands in the scan's list.
    first: usize,
    /// Γ, the differences within it: one less than its beams.
    differences: u32,
    /// δ, their mean, metres.
    mean_m: f64,
}

impl IntraScan {
    /// A metric with these settings.
    pub fn new(config: &MetricsConfig) -> Self {
        Self {
            config: config.clone(),
        }
    }

    /// Fills `values` with one value, 0 to 1, for each entry of `scan.beams`: 0.04 is a body 2.2 cm wide where
    /// 1 is one of 55 cm. It is NaN of a miss, of a hit beside none, and of a hit beyond the greatest range.
    ///
    /// Hits beyond the greatest range count for the segments all the same: how wide a wall is does not depend
    /// on which of its beams are given a value.
    pub fn measure(&self, scan: &RegisteredScan, values: &mut Vec<f32>) {
        values.clear();
        values.resize(scan.beams.len(), f32::NAN);
        // γ in beam·m; a value is Γ·r/γ.
        let value_of_beam_m = scan.beam_step_rad / self.config.intra_width_m;
        let mut segment = Segment::opening_at(0);
        for at in 1..scan.beams.len() {
            let difference_m = difference_m(&scan.beams[at - 1], &scan.beams[at]);
            if !difference_m
                .is_some_and(|difference| segment.takes(difference, self.config.intra_sigma_m))
            {
                self.close(segment, value_of_beam_m, &scan.beams, values);
                // Algorithm 1: the beam that did not fit opens the next segment. The difference that did not
                // fit belongs to neither, and no beam belongs to two.
                segment = Segment::opening_at(at);
            }
        }
        self.close(segment, value_of_beam_m, &scan.beams, values);
    }

    fn close(
        &self,
        segment: Segment,
        value_of_beam_m: f64,
        beams: &[RegisteredBeam],
        values: &mut [f32],
    ) {
        if segment.differences == 0 {
            return;
        }
        let all = segment.first..=segment.first + segment.differences as usize;
        for (beam, value) in beams[all.clone()].iter().zip(&mut values[all]) {
            let range_m = f64::from(beam.range_m);
            if range_m <= self.config.max_range_m {
                let width = f64::from(segment.differences) * range_m;
                *value = (width * value_of_beam_m).min(1.0) as f32;
            }
        }
    }
}

impl Segment {
    const fn opening_at(first: usize) -> Self {
        Self {
            first,
            differences: 0,
            mean_m: 0.0,
        }
    }

    /// Takes in the next beam if its range differs like those before (equation 6.1); says whether.
    fn takes(&mut self, difference_m: f64, sigma_m: f64) -> bool {
        let fits = self.differences == 0 || (difference_m - self.mean_m).abs() < sigma_m;
        if fits {
            self.differences += 1;
            self.mean_m += (difference_m - self.mean_m) / f64::from(self.differences);
        }
        fits
    }
}

/// How much farther `next` reached; `None` where they are not neighbours that both hit something.
fn difference_m(beam: &RegisteredBeam, next: &RegisteredBeam) -> Option<f64> {
    let both_hit = beam.outcome == BeamOutcome::Hit && next.outcome == BeamOutcome::Hit;
    let are_neighbours = next.index.checked_sub(beam.index) == Some(1);
    (both_hit && are_neighbours).then(|| f64::from(next.range_m) - f64::from(beam.range_m))
}

#[cfg(test)]
pub(super) mod tests {
    use nalgebra::Point3;
    use proptest::prelude::*;

    use super::*;
    use crate::registered_scan::SensorId;
    use measurement::pose::Pose;
    use measurement::time::RobotTime;

    /// A scan of 0.25° with these ranges: infinity is a miss, NaN is left out.
    pub(in super::super) fn scan_of(stamp_s: f64, ranges_m: &[f32]) -> RegisteredScan {
        let beams = (0..).zip(ranges_m).filter(|(_, range)| !range.is_nan());
        let beams = beams.map(|(index, &range_m)| RegisteredBeam {
            origin_in_odom: Point3::origin(),
            end_in_odom: Point3::new(f64::from(range_m.min(300.0)), 0.0, 0.0),
            outcome: if range_m.is_finite() {
                BeamOutcome::Hit
            } else {
                BeamOutcome::Miss
            },
            index,
            range_m: range_m.min(300.0),
        });
        RegisteredScan {
            stamp: RobotTime::from_secs_f64(stamp_s).unwrap(),
            sensor: SensorId(0),
            beam_step_rad: 0.25_f64.to_radians(),
            own_body_hits: 0,
            odom_from_base: Pose::identity(),
            beams: beams.collect(),
        }
    }

    /// Γ of each beam's segment, 0 where it has none: all ranges are near 1 m.
    fn segments(ranges_m: &[f32]) -> Vec<i32> {
        let scan = scan_of(0.0, ranges_m);
        let mut values = vec![7.0; 3];
        IntraScan::new(&MetricsConfig::default()).measure(&scan, &mut values);
        let beam_m = 0.55 / scan.beam_step_rad;
        let differences = scan.beams.iter().zip(&values).map(|(beam, value)| {
            if value.is_nan() {
                0
            } else {
                (f64::from(*value) * beam_m / f64::from(beam.range_m)).round() as i32
            }
        });
        differences.collect()
    }

    #[test]
    fn a_step_ends_a_segment_and_its_far_side_opens_the_next() {
        let near_then_far = [1.0, 1.0, 1.0, 1.5, 1.5, 1.5, 1.5];
        assert_eq!(segments(&near_then_far), [2, 2, 2, 3, 3, 3, 3]);
        // A single beam between two steps opens a segment with whatever follows it.
        let pole = [1.0, 1.0, 0.5, 1.0, 1.0, 1.0];
        assert_eq!(segments(&pole), [1, 1, 1, 1, 1, 1]);
    }

    #[test]
    fn a_slanting_wall_is_one_segment() {
        let wall: Vec<f32> = (0..9u8).map(|i| 1.0 + 0.2 * f32::from(i)).collect();
        assert_eq!(segments(&wall), [8; 9]);
        // Around the mean difference, not around zero: the wall goes on where its end stands still.
        assert_eq!(segments(&[1.0, 1.2, 1.4, 1.4, 1.4]), [2, 2, 2, 1, 1]);
    }

    #[test]
    fn misses_and_gaps_end_a_segment() {
        let (miss, left_out) = (f32::INFINITY, f32::NAN);
        assert_eq!(segments(&[1.0, 1.0, miss, 1.0]), [1, 1, 0, 0]);
        assert_eq!(segments(&[1.0, 1.0, left_out, 1.0, 1.0]), [1, 1, 1, 1]);
        assert_eq!(segments(&[1.0, left_out, 1.0, left_out]), [0, 0]);
        assert_eq!(segments(&[miss, miss]), [0, 0]);
        assert_eq!(segments(&[]), [0; 0]);
    }

    #[test]
    fn the_thresholds_of_the_document_are_the_widths_it_prints() {
        // \[HYB\] §7.1: 0.04 is 2.2 cm, §7.2: 0.20 is 11 cm, at 1 m and 0.25°. In widths of beams that is
        // 2.2 cm / 4.36 mm = 5.04 and 25.2 beams: thresholds that 5 and 25 do not pass, 6 and 26 do.
        let value = |differences: usize| {
            let mut values = Vec::new();
            let scan = scan_of(0.0, &vec![1.0; differences + 1]);
            IntraScan::new(&MetricsConfig::default()).measure(&scan, &mut values);
            values[0]
        };
        assert!(value(5) < 0.04 && 0.04 < value(6), "{}", value(5));
        assert!(value(25) < 0.20 && 0.20 < value(26), "{}", value(25));
        assert!((f64::from(value(1)) - 1.0 / 126.05).abs() < 1e-6);
        assert!(value(126) < 1.0);
        assert_eq!(value(127).to_bits(), 1.0_f32.to_bits());
        assert_eq!(value(900).to_bits(), 1.0_f32.to_bits());
    }

    #[test]
    fn twice_the_step_is_half_the_beams() {
        let mut coarse = scan_of(0.0, &[2.0; 11]);
        coarse.beam_step_rad *= 2.0;
        let fine = scan_of(0.0, &[2.0; 21]);
        let metric = IntraScan::new(&MetricsConfig::default());
        let (mut of_coarse, mut of_fine) = (Vec::new(), Vec::new());
        metric.measure(&coarse, &mut of_coarse);
        metric.measure(&fine, &mut of_fine);
        assert_eq!(of_coarse[0].to_bits(), of_fine[0].to_bits());
    }

    #[test]
    fn far_hits_have_no_value_but_widen_what_near_ones_hit() {
        let slanting = [19.96, 20.0, 20.04, 20.08];
        let mut values = Vec::new();
        let scan = scan_of(0.0, &slanting);
        IntraScan::new(&MetricsConfig::default()).measure(&scan, &mut values);
        assert!((f64::from(values[0]) - 3.0 * 19.96 / 126.05).abs() < 1e-4);
        assert!(!values[1].is_nan() && values[2].is_nan() && values[3].is_nan());
    }

    /// Algorithm 1 line by line.
    fn algorithm_1(r: &[Option<f64>], sigma_m: f64) -> Vec<i32> {
        let mut labels = vec![0; r.len()];
        let mut i = 0;
        while i < r.len() {
            if r[i].is_some() {
                let (mut size, mut mean) = (0, 0.0);
                while i + 1 < r.len() {
                    let (Some(this), Some(next)) = (r[i], r[i + 1]) else {
                        break;
                    };
                    let difference: f64 = next - this;
                    if size == 0 {
                        size = 1;
                        mean = difference;
                    } else if mean - sigma_m < difference && difference < mean + sigma_m {
                        size += 1;
                        mean = (mean * (f64::from(size) - 1.0) + difference) / f64::from(size);
                    } else {
                        break;
                    }
                    i += 1;
                }
                labels[i - size as usize..=i].fill(size);
            }
            i += 1;
        }
        labels
    }

    proptest! {
        #[test]
        fn segments_are_those_of_algorithm_1(
            steps in prop::collection::vec(prop_oneof![
                8 => (0..3u8).prop_map(|n| 1.0 + 0.06 * f32::from(n)),
                2 => Just(1.4_f32),
                1 => Just(f32::INFINITY),
                1 => Just(f32::NAN),
            ], 0..60),
        ) {
            let ranges: Vec<Option<f64>> = steps
                .iter()
                .map(|range| range.is_finite().then(|| f64::from(*range)))
                .collect();
            let expected = algorithm_1(&ranges, 0.09);
            let kept = steps.iter().zip(expected).filter(|(range, _)| !range.is_nan());
            let kept: Vec<i32> = kept.map(|(_, size)| size).collect();
            prop_assert_eq!(segments(&steps), kept);
        }
    }
}
