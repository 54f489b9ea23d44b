//! Which stems a beam may meet where: a grid over the plan.
//!
//! A grid gives stems from near to far, so that a walk ends where grass has swallowed the beam.

use std::ops::{Range, RangeInclusive};

use nalgebra::Point2;

use super::{Cone, Stem, Wind, clipped};

/// Stems by square bins of the plan.
#[derive(Debug)]
pub(super) struct Bins {
    min_m: Point2<f64>,
    bin_m: f64,
    /// Columns and rows.
    size: [usize; 2],
    /// Where the stems of a bin begin in `stems`, and one more for the end.
    starts: Vec<u32>,
    stems: Vec<u32>,
    /// Least and greatest height of a bin's stems.
    heights_m: Vec<[f64; 2]>,
}

/// Small beside a patch, large beside a spot.
const BIN_M: f64 = 0.4;

/// Bins grow where plants are spread so far that there would be more.
const MAX_BINS: f64 = 1e6;

/// Bins also grow where stems sweep so far that each were in more on the mean.
const MAX_ENTRIES_PER_STEM: usize = 30;

/// Radius of the widest spot whose light is not lost at the edge of bins: an LMS111's at 20 m.
const SPOT_M: f64 = 0.15;

impl Bins {
    pub(super) fn new(stems: &[Stem], wind: &Wind) -> Self {
        let grown = nalgebra::Vector2::repeat(SPOT_M);
        let reaches: Vec<[Point2<f64>; 2]> = stems
            .iter()
            .map(|stem| stem.swept_m(wind))
            .map(|[min, max]| [min - grown, max + grown])
            .collect();
        let none = [f64::INFINITY, f64::NEG_INFINITY].map(|m| Point2::new(m, m));
        let [min_m, max_m] = reaches
            .iter()
            .fold(none, |all, one| [all[0].inf(&one[0]), all[1].sup(&one[1])]);
        let extent = if stems.is_empty() {
            nalgebra::Vector2::zeros()
        } else {
            max_m - min_m
        };
        let mut bin_m = BIN_M
            .max(libm::sqrt(extent.x * extent.y / MAX_BINS))
            .max(extent.amax() / MAX_BINS);
        loop {
            let mut bins = Self {
                min_m,
                bin_m,
                size: [0, 1].map(|axis| (extent[axis] / bin_m) as usize + 1),
                starts: Vec::new(),
                stems: Vec::new(),
                heights_m: Vec::new(),
            };
            let entries: usize = reaches.iter().map(|&reach| bins.count(reach)).sum();
            if entries <= MAX_ENTRIES_PER_STEM * stems.len() {
                bins.fill(stems, &reaches);
                return bins;
            }
            bin_m *= 2.0;
        }
    }

    fn fill(&mut self, stems: &[Stem], reaches: &[[Point2<f64>; 2]]) {
        let bins = self.size[0] * self.size[1];
        self.starts = vec![0; bins + 1];
        self.heights_m = vec![[f64::INFINITY, f64::NEG_INFINITY]; bins];
        for (stem, &reach) in stems.iter().zip(reaches) {
            let ends = [stem.foot_m.z, stem.top_m.z];
            for bin in self.touched(reach) {
                self.starts[bin + 1] += 1;
                let [least, most] = &mut self.heights_m[bin];
                *least = least.min(ends[0].min(ends[1]) - stem.radius_m);
                *most = most.max(ends[0].max(ends[1]) + stem.radius_m);
            }
        }
        for bin in 1..self.starts.len() {
            self.starts[bin] += self.starts[bin - 1];
        }
        let mut next = self.starts.clone();
        self.stems = vec![0; self.starts[bins] as usize];
        for (stem, &reach) in reaches.iter().enumerate() {
            for bin in self.touched(reach) {
                self.stems[next[bin] as usize] = stem as u32;
                next[bin] += 1;
            }
        }
    }

    /// Calls `visit` with the stems of every bin that the axis of `cone` passes within `max_m`, nearest
    /// first, and with the part of the axis in it, until `visit` returns false.
    pub(super) fn walk(
        &self,
        cone: &Cone,
        max_m: f64,
        mut visit: impl FnMut(&[u32], Range<f64>) -> bool,
    ) {
        let Some([mut from_m, end_m]) = self.within(cone, max_m) else {
            return;
        };
        let entry = cone.origin + cone.axis * from_m;
        let mut cell = [0, 1].map(|axis| self.cell(axis, entry[axis]));
        loop {
            // To the next line between columns and between rows.
            let lines_m = [0, 1].map(|axis| {
                let along = cone.axis[axis];
                if along == 0.0 {
                    return f64::INFINITY;
                }
                let line = cell[axis] + usize::from(along > 0.0);
                let at_m = self.min_m[axis] + line as f64 * self.bin_m;
                (at_m - cone.origin[axis]) / along
            });
            let axis = usize::from(lines_m[1] < lines_m[0]);
            let to_m = lines_m[axis].clamp(from_m, end_m);
            let bin = cell[1] * self.size[0] + cell[0];
            let goes_on = !self.is_at_height(bin, cone, from_m..to_m)
                || visit(self.in_bin(bin), from_m..to_m);
            let next = if cone.axis[axis] > 0.0 {
                cell[axis] + 1
            } else {
                cell[axis].wrapping_sub(1)
            };
            if !goes_on || to_m >= end_m || next >= self.size[axis] {
                return;
            }
            cell[axis] = next;
            from_m = to_m;
        }
    }

    /// All stems near a rectangle; one may come twice.
    pub(super) fn around(&self, rectangle_m: [Point2<f64>; 2]) -> impl Iterator<Item = u32> + '_ {
        self.touched(rectangle_m)
            .flat_map(|bin| self.in_bin(bin).iter().copied())
    }

    fn in_bin(&self, bin: usize) -> &[u32] {
        let range = |bin: usize| self.starts.get(bin).map_or(0, |&start| start as usize);
        self.stems
            .get(range(bin)..range(bin + 1))
            .unwrap_or_default()
    }

    fn is_at_height(&self, bin: usize, cone: &Cone, along_m: Range<f64>) -> bool {
        let height_m = |s: f64| cone.origin.z + s * cone.axis.z;
        let ends = [height_m(along_m.start), height_m(along_m.end)];
        let spot_m = cone.spread * along_m.end;
        self.heights_m.get(bin).is_some_and(|[least, most]| {
            ends[0].min(ends[1]) - spot_m <= *most && ends[0].max(ends[1]) + spot_m >= *least
        })
    }

    /// The part of the axis over the grid.
    fn within(&self, cone: &Cone, max_m: f64) -> Option<[f64; 2]> {
        let least: [f64; 2] = (self.min_m - cone.origin.xy()).into();
        let most = [0, 1].map(|axis: usize| least[axis] + self.size[axis] as f64 * self.bin_m);
        let along = cone.axis.xy().into();
        let part = clipped(along, least, most, [0.0, max_m])?;
        (part[0] < part[1] && !self.stems.is_empty()).then_some(part)
    }

    fn touched(&self, rectangle_m: [Point2<f64>; 2]) -> impl Iterator<Item = usize> + use<> {
        let width = self.size[0];
        let [columns, rows] = [0, 1].map(|axis| self.span(axis, rectangle_m));
        rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
    }

    fn count(&self, rectangle_m: [Point2<f64>; 2]) -> usize {
        self.span(0, rectangle_m).count() * self.span(1, rectangle_m).count()
    }

    fn span(&self, axis: usize, [min, max]: [Point2<f64>; 2]) -> RangeInclusive<usize> {
        self.cell(axis, min[axis])..=self.cell(axis, max[axis])
    }

    fn cell(&self, axis: usize, at_m: f64) -> usize {
        (((at_m - self.min_m[axis]) / self.bin_m) as usize).min(self.size[axis] - 1)
    }
}
