use super::*;
use measurement::pose::Pose;
use measurement::time::RobotTime;
use nalgebra::Point3;
use proptest::prelude::*;

use crate::registered_scan::{ScanKind, SensorId};

/// A scan of 0.25° with these ranges: infinity is a miss, NaN is omitted.
fn scan_of(stamp_s: f64, ranges_m: &[f32]) -> RegisteredScan {
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
        kind: ScanKind::Beams,
        own_body_hits: 0,
        odom_from_base: Pose::identity(),
        beams: beams.collect(),
    }
}

/// Γ of each beam's segment, 0 without: all ranges are near 1 m.
fn segments(ranges_m: &[f32]) -> Vec<i32> {
    let scan = scan_of(0.0, ranges_m);
    let mut values = vec![7.0; 3];
    IntraScan::new(&MetricsConfig::default()).measure(&scan, 0.0, &mut values);
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
    // A single beam between two steps opens a segment with the next beam.
    let pole = [1.0, 1.0, 0.5, 1.0, 1.0, 1.0];
    assert_eq!(segments(&pole), [1, 1, 1, 1, 1, 1]);
}

#[test]
fn a_slanting_wall_is_one_segment() {
    let wall: Vec<f32> = (0..9u8).map(|i| 1.0 + 0.2 * f32::from(i)).collect();
    assert_eq!(segments(&wall), [8; 9]);
    // Deviation from the mean difference, not from zero.
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
fn thresholds_match_the_printed_widths() {
    // \[HYB\] §7.1: 0.04 is 2.2 cm, §7.2: 0.20 is 11 cm, at 1 m and 0.25°, which are 5.04 and
    // 25.2 beam widths of 4.36 mm: thresholds that 5 and 25 do not exceed, 6 and 26 do.
    let value = |differences: usize| {
        let mut values = Vec::new();
        let scan = scan_of(0.0, &vec![1.0; differences + 1]);
        IntraScan::new(&MetricsConfig::default()).measure(&scan, 0.0, &mut values);
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
    metric.measure(&coarse, 0.0, &mut of_coarse);
    metric.measure(&fine, 0.0, &mut of_fine);
    assert_eq!(of_coarse[0].to_bits(), of_fine[0].to_bits());
}

#[test]
fn a_rod_is_no_wider_than_the_spot_that_lights_it() {
    // At 4 m a spot of 15 mrad is 6 cm wide and a beam's step 1.75 cm; 8 cm have the value 1.
    let values_of = |hits: usize, behind_m: f32| {
        let mut ranges = vec![behind_m; 40];
        ranges[10..10 + hits].fill(4.0);
        let metric = IntraScan::less_spot(&MetricsConfig::default(), 0.04);
        let mut values = Vec::new();
        metric.measure(&scan_of(0.0, &ranges), 0.015, &mut values);
        values[if behind_m.is_nan() { 0 } else { 10 }]
    };
    // Between misses a lone hit has a value, beside invalid beams it has none.
    assert_eq!(values_of(1, f32::INFINITY).to_bits(), 0.0_f32.to_bits());
    assert!(values_of(1, f32::NAN).is_nan());
    for (hits, width_m) in [(2, 0.0), (4, 0.0), (6, 0.02727), (8, 0.06217), (20, 0.08)] {
        let value = f64::from(values_of(hits, 9.0));
        assert!((value - width_m / 0.08).abs() < 1e-3, "{hits}: {value}");
    }
}

#[test]
fn a_few_hits_of_beams_farther_apart_than_their_spots_may_be_several_stems() {
    // A spot of 2 mrad and steps of 4.36 mrad; 8 cm have the value 1.
    let metric = IntraScan::less_spot(&MetricsConfig::default(), 0.04);
    let value_of = |hits: usize, range_m: f32, beside_m: f32| {
        let mut ranges = vec![19.0; 40];
        ranges[10..10 + hits].fill(range_m);
        ranges[10 + hits] = beside_m;
        let mut values = Vec::new();
        metric.measure(&scan_of(0.0, &ranges), 0.002, &mut values);
        f64::from(values[10])
    };
    for (hits, range_m, width_m) in [
        // With the first beam behind it, by algorithm 1.
        (1, 4.0, 0.00945),
        (1, 9.0, 0.02127),
        (2, 4.0, 0.00945),
        (3, 4.0, 0.02691),
        (5, 12.0, 0.08),
    ] {
        let value = value_of(hits, range_m, 19.0);
        assert!((value - width_m / 0.08).abs() < 1e-3, "{hits}: {value}");
        assert_eq!(value_of(hits, range_m, f32::NAN).is_nan(), hits < 5);
    }
    // They may be wider than 10 cm.
    for (hits, range_m) in [(1, 15.0), (3, 7.0)] {
        assert!(value_of(hits, range_m, 19.0).is_nan(), "{hits}");
    }
}

#[test]
fn far_hits_have_no_value_but_widen_what_near_ones_hit() {
    let slanting = [19.96, 20.0, 20.04, 20.08];
    let mut values = Vec::new();
    let scan = scan_of(0.0, &slanting);
    IntraScan::new(&MetricsConfig::default()).measure(&scan, 0.0, &mut values);
    assert!((f64::from(values[0]) - 3.0 * 19.96 / 126.05).abs() < 1e-4);
    assert!(!values[1].is_nan() && values[2].is_nan() && values[3].is_nan());
}

/// Algorithm 1 of \[HYB\] line by line.
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

const MISS: f32 = f32::INFINITY;
const LEFT_OUT: f32 = f32::NAN;

/// Percent, −1 without a value.
fn measured(metric: &mut InterScan, scan: &RegisteredScan) -> Vec<i32> {
    let mut values = vec![7.0; 2];
    metric.measure(scan, &mut values);
    assert_eq!(values.len(), scan.beams.len());
    let percent = |value: &f32| {
        if value.is_nan() {
            -1
        } else {
            (100.0 * value).round() as i32
        }
    };
    values.iter().map(percent).collect()
}

fn metric() -> InterScan {
    InterScan::new(&MetricsConfig::default())
}

#[test]
fn changes_need_hits_in_both_scans() {
    let mut metric = metric();
    let first = scan_of(0.0, &[5.0, 5.0, MISS, 5.0, LEFT_OUT, 5.0, 21.0]);
    assert_eq!(
        measured(&mut metric, &first),
        [-1; 6],
        "nothing to compare with"
    );
    let next = scan_of(0.04, &[5.1, LEFT_OUT, 5.0, 4.0, 5.0, MISS, 19.9]);
    // 10 cm is the 0.39 of \[HYB\].
    assert_eq!(measured(&mut metric, &next), [39, -1, 100, -1, -1, 100]);
    let third = scan_of(0.08, &[5.1, 3.0, 5.0, 4.0, 5.0, 1.0, 20.1]);
    assert_eq!(measured(&mut metric, &third), [0, -1, 0, 0, 0, -1, -1]);
}

#[test]
fn long_pauses_reset_the_metric_but_slow_sensors_do_not() {
    let mut metric = metric();
    let ranges = [5.0, 5.0];
    let mut at = |stamp_s: f64| measured(&mut metric, &scan_of(stamp_s, &ranges))[0];
    assert_eq!(at(0.0), -1);
    assert_eq!(at(0.04), 0);
    assert_eq!(at(0.16), 0, "three periods");
    assert_eq!(at(0.20), 0);
    assert_eq!(at(0.40), -1, "five periods");
    assert_eq!(at(0.60), 0, "from now on at 5 Hz");
    assert_eq!(at(0.60), -1, "no time has passed");
    assert_eq!(at(0.80), 0);
    assert_eq!(at(0.10), -1, "back in time");
    assert_eq!(at(0.30), 0);
    assert_eq!(at(1.40), -1, "more than a second");
}

#[test]
fn beams_of_other_directions_are_not_compared() {
    let mut metric = metric();
    measured(&mut metric, &scan_of(0.0, &[5.0; 100]));
    let mut coarse = scan_of(0.04, &[5.0; 100]);
    coarse.beam_step_rad *= 1.01;
    assert_eq!(measured(&mut metric, &coarse), [-1; 100]);
    // As an f32 message rounds it.
    let mut rounded = scan_of(0.08, &[5.0; 100]);
    rounded.beam_step_rad = coarse.beam_step_rad * (1.0 + 1e-7);
    assert_eq!(measured(&mut metric, &rounded), [0; 100]);
}

#[test]
fn sensors_are_kept_apart() {
    let mut metric = metric();
    let scan = |stamp_s: f64, sensor: u8, range_m: f32| RegisteredScan {
        sensor: SensorId(sensor),
        ..scan_of(stamp_s, &[range_m])
    };
    measured(&mut metric, &scan(0.0, 2, 5.0));
    assert_eq!(measured(&mut metric, &scan(0.01, 1, 7.0)), [-1]);
    assert_eq!(measured(&mut metric, &scan(0.04, 2, 5.051)), [20]);
    assert_eq!(measured(&mut metric, &scan(0.05, 1, 7.0)), [0]);
    metric.reset();
    assert_eq!(measured(&mut metric, &scan(0.08, 2, 5.0)), [-1]);
}
