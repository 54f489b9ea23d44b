//! Range scan metrics (docs/methods.md, section 5; \[HYB\] §6): `IntraScan`, how wide and smooth a
//! hit object is within a scan, and `InterScan`, how much the range of a beam changes between
//! scans. [`crate::octree::SurfaceVoxel`] has their moving averages per voxel.

use std::ops::RangeInclusive;

use measurement::time::{RobotDuration, RobotTime};
use serde::Deserialize;

use crate::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, SensorId};

/// Settings of `[mapping.metrics]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MetricsConfig {
    /// Longer beams have no metrics, metres: their neighbours are too far apart.
    pub max_range_m: f64,
    /// σ: greatest deviation of a range difference from its segment's mean, metres (\[HYB\] §6.1:
    /// 0.09 introbot, 0.45 riverwatch).
    pub intra_sigma_m: f64,
    /// Width of a segment of value 1, metres.
    pub intra_width_m: f64,
    /// Range difference between scans of value 1, metres.
    pub inter_full_m: f64,
    /// α, weight of the newest `IntraScan` value in a voxel's moving average (\[HYB\] equation 6.2).
    pub intra_weight: f64,
    /// θ, weight of the newest `InterScan` value in it (\[HYB\] equation 6.4).
    pub inter_weight: f64,
}

impl Default for MetricsConfig {
    fn default() -> Self {
        Self {
            max_range_m: 20.0,
            intra_sigma_m: 0.09,
            intra_width_m: 0.55,
            inter_full_m: 0.255,
            intra_weight: 0.3,
            inter_weight: 0.3,
        }
    }
}

/// `IntraScan`; keeps nothing between scans.
#[derive(Clone, Debug)]
pub struct IntraScan {
    max_range_m: f64,
    sigma_m: f64,
    /// Width of value 1.
    width_m: f64,
    /// The laser spot is subtracted.
    less_spot: bool,
}

/// A run of neighbouring beams with similar range differences.
#[derive(Clone, Copy, Debug)]
struct Segment {
    /// Index of its first beam in the scan's list.
    first: usize,
    /// Γ: number of differences, one less than its beams.
    differences: u32,
    /// δ: mean difference, metres.
    mean_m: f64,
}

impl IntraScan {
    /// Value of the least width: half, so that in an average a few wide segments do not outweigh many narrow ones.
    pub const LEAST_WIDTH: f64 = 0.5;

    /// With these settings, as the source has it.
    pub fn new(config: &MetricsConfig) -> Self {
        Self {
            max_range_m: config.max_range_m,
            sigma_m: config.intra_sigma_m,
            width_m: config.intra_width_m,
            less_spot: false,
        }
    }

    /// Widths less the laser spot; a body of the least width has the value [`Self::LEAST_WIDTH`].
    pub fn less_spot(config: &MetricsConfig, least_width_m: f64) -> Self {
        Self {
            width_m: least_width_m / Self::LEAST_WIDTH,
            less_spot: true,
            ..Self::new(config)
        }
    }

    /// Fills `values` with one value, 0 to 1, per beam of the scan: Γ · r / γ, see equations (5) and (6) of
    /// docs/methods.md. 0.04 is an object 2.2 cm wide. A beam without a value is NaN: a miss, a hit
    /// without neighbour (less the spot it has the value 0 between two misses), a hit beyond the
    /// greatest range. `divergence_rad` is the full angle of a beam.
    ///
    /// Hits beyond the greatest range still extend segments.
    pub fn measure(&self, scan: &RegisteredScan, divergence_rad: f64, values: &mut Vec<f32>) {
        values.clear();
        values.resize(scan.beams.len(), f32::NAN);
        // γ in beam·m; a value is Γ·r/γ.
        let value_of_beam_m = scan.beam_step_rad / self.width_m;
        // Eq. (6): beams by which a rod looks wider than it is.
        let spot = if self.less_spot {
            divergence_rad / scan.beam_step_rad
        } else {
            0.0
        };
        let factors = [spot, value_of_beam_m];
        let mut segment = Segment::opening_at(0);
        for at in 1..scan.beams.len() {
            let difference_m = difference_m(&scan.beams[at - 1], &scan.beams[at]);
            if !difference_m.is_some_and(|difference| segment.takes(difference, self.sigma_m)) {
                self.close(segment, factors, &scan.beams, values);
                // Algorithm 1 of \[HYB\]: the beam that did not fit opens the next segment. The
                // difference that did not fit belongs to neither, and no beam belongs to two.
                segment = Segment::opening_at(at);
            }
        }
        self.close(segment, factors, &scan.beams, values);
    }

    fn close(
        &self,
        segment: Segment,
        [spot, value_of_beam_m]: [f64; 2],
        beams: &[RegisteredBeam],
        values: &mut [f32],
    ) {
        let all = segment.first..=segment.first + segment.differences as usize;
        let beams_wide = f64::from(segment.differences) - spot;
        let mut farthest_m = self.max_range_m;
        // Nothing was observed between beams farther apart than the spot: what a few of them hit may be as many stems, or a body that
        // is wider by a step on either side.
        if self.less_spot && spot < 1.0 && segment.differences < CERTAIN {
            let widest_m = (beams_wide + 2.0) * value_of_beam_m * self.width_m;
            farthest_m = farthest_m.min(NARROW_M / widest_m);
            if !is_beside_known(beams, &all) {
                return;
            }
        } else if segment.differences == 0
            && !(self.less_spot && is_between_misses(beams, segment.first))
        {
            return;
        }
        let beams_wide = beams_wide.max(0.0);
        for (beam, value) in beams[all.clone()].iter().zip(&mut values[all]) {
            let range_m = f64::from(beam.range_m);
            if range_m <= farthest_m {
                *value = (beams_wide * range_m * value_of_beam_m).min(1.0) as f32;
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

    /// Extends the segment if the next difference fits (equation (5)); returns whether it did.
    fn takes(&mut self, difference_m: f64, sigma_m: f64) -> bool {
        let fits = self.differences == 0 || (difference_m - self.mean_m).abs() < sigma_m;
        if fits {
            self.differences += 1;
            self.mean_m += (difference_m - self.mean_m) / f64::from(self.differences);
        }
        fits
    }
}

/// Differences of so many beams in a row that they are of one body, however far apart they are.
const CERTAIN: u32 = 4;
/// Widest that something may be which is called narrow, metres.
const NARROW_M: f64 = 0.1;

/// Whether the beams beside a segment were observed.
fn is_beside_known(beams: &[RegisteredBeam], segment: &RangeInclusive<usize>) -> bool {
    let first = segment.start().checked_sub(1);
    let around = first.and_then(|first| beams.get(first..=segment.end() + 1));
    around.is_some_and(|around| {
        let ends = around.first().zip(around.last());
        ends.is_some_and(|(a, b)| (b.index - a.index) as usize == around.len() - 1)
    })
}

/// Whether a hit's neighbours both have no return: it is no wider than the spot.
fn is_between_misses(beams: &[RegisteredBeam], at: usize) -> bool {
    let around = at.checked_sub(1).and_then(|first| beams.get(first..at + 2));
    matches!(around, Some([before, hit, after])
        if hit.outcome == BeamOutcome::Hit
            && [before, after].map(|beam| beam.outcome) == [BeamOutcome::Miss; 2]
            && after.index.checked_sub(before.index) == Some(2))
}

/// Range difference; `None` unless both are hits of neighbouring beams.
fn difference_m(beam: &RegisteredBeam, next: &RegisteredBeam) -> Option<f64> {
    let both_hit = beam.outcome == BeamOutcome::Hit && next.outcome == BeamOutcome::Hit;
    let are_neighbours = next.index.checked_sub(beam.index) == Some(1);
    (both_hit && are_neighbours).then(|| f64::from(next.range_m) - f64::from(beam.range_m))
}

/// `InterScan`; compares each scan with the previous one of the same sensor.
#[derive(Clone, Debug)]
pub struct InterScan {
    max_range_m: f32,
    full_m: f64,
    /// Ordered by sensor.
    previous: Vec<PreviousScan>,
}

#[derive(Clone, Debug)]
struct PreviousScan {
    sensor: SensorId,
    stamp: RobotTime,
    /// Interval to the scan before; `None` for the first.
    period: Option<RobotDuration>,
    beam_step_rad: f64,
    /// Index and range in metres of every hit, by index.
    hits: Vec<(u32, f32)>,
}

/// Scans farther apart than this many times the last period are not consecutive,
const MAX_PERIODS: i64 = 3;
/// nor those farther apart than this.
const MAX_PAUSE: RobotDuration = RobotDuration::from_millis(1_000);

impl InterScan {
    /// With these settings.
    pub fn new(config: &MetricsConfig) -> Self {
        Self {
            max_range_m: config.max_range_m as f32,
            full_m: config.inter_full_m,
            previous: Vec::new(),
        }
    }

    /// Fills `values` with one value, 0 to 1, per beam of the scan: the range change to the same
    /// beam of the previous scan (docs/methods.md, section 5). 0.39 is 10 cm, 1 is 25.5 cm or more.
    /// It is NaN unless both are hits, and for a hit beyond the greatest range.
    ///
    /// A previous hit beyond the greatest range counts: a beam that hits a cane now and the far
    /// shore before shows a thin cane.
    pub fn measure(&mut self, scan: &RegisteredScan, values: &mut Vec<f32>) {
        values.clear();
        values.resize(scan.beams.len(), f32::NAN);
        let place = self
            .previous
            .binary_search_by_key(&scan.sensor, |previous| previous.sensor);
        match place {
            Ok(at) => {
                let previous = &mut self.previous[at];
                if previous.is_followed_by(scan) {
                    let hits = &previous.hits;
                    compare(scan, hits, self.max_range_m, self.full_m, values);
                }
                previous.take(scan);
            }
            Err(at) => self.previous.insert(at, PreviousScan::first(scan)),
        }
    }

    /// Forgets all previous scans.
    pub fn reset(&mut self) {
        self.previous.clear();
    }
}

impl PreviousScan {
    fn first(scan: &RegisteredScan) -> Self {
        Self {
            sensor: scan.sensor,
            stamp: scan.stamp,
            period: None,
            beam_step_rad: scan.beam_step_rad,
            hits: hits(scan).collect(),
        }
    }

    /// Whether the beams of `scan` can be compared by index.
    fn is_followed_by(&self, scan: &RegisteredScan) -> bool {
        let pause = scan.stamp.since(self.stamp);
        let periods = self.period.map_or(i64::MAX, |period| {
            period.as_nanos().saturating_mul(MAX_PERIODS)
        });
        let is_next =
            pause > RobotDuration::ZERO && pause <= MAX_PAUSE && pause.as_nanos() <= periods;
        // Equal indices have equal directions, the last one within half a step.
        let last = scan.beams.last().map_or(0, |beam| beam.index);
        let shift_rad = (scan.beam_step_rad - self.beam_step_rad).abs() * f64::from(last);
        is_next && shift_rad < 0.5 * self.beam_step_rad
    }

    fn take(&mut self, scan: &RegisteredScan) {
        let pause = scan.stamp.since(self.stamp);
        // After a clock reset the period is unknown; after a long pause it may have changed.
        self.period = (pause > RobotDuration::ZERO).then_some(pause);
        self.stamp = scan.stamp;
        self.beam_step_rad = scan.beam_step_rad;
        self.hits.clear();
        self.hits.extend(hits(scan));
    }
}

fn hits(scan: &RegisteredScan) -> impl Iterator<Item = (u32, f32)> {
    let hits = scan.beams.iter();
    let hits = hits.filter(|beam| beam.outcome == BeamOutcome::Hit);
    hits.map(|beam| (beam.index, beam.range_m))
}

fn compare(
    scan: &RegisteredScan,
    previous: &[(u32, f32)],
    max_range_m: f32,
    full_m: f64,
    values: &mut [f32],
) {
    let mut previous = previous.iter().copied().peekable();
    for (beam, value) in scan.beams.iter().zip(values) {
        while previous.next_if(|(index, _)| *index < beam.index).is_some() {}
        let Some(&(index, range_m)) = previous.peek() else {
            return;
        };
        let is_hit = beam.outcome == BeamOutcome::Hit && beam.range_m <= max_range_m;
        if index == beam.index && is_hit {
            let change_m = (f64::from(beam.range_m) - f64::from(range_m)).abs();
            *value = (change_m / full_m).min(1.0) as f32;
        }
    }
}

#[cfg(test)]
mod tests;
