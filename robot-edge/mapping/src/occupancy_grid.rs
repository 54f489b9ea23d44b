//! Unbounded 2D Bayesian occupancy grid of a horizontal laser (docs/methods.md, section 2;
//! \[LRF\]).

use std::collections::HashSet;

use nalgebra::Point3;
use rustc_hash::FxBuildHasher;
use serde::Deserialize;

use crate::grid::{CellIndex, TILE_EDGE, TileIndex, TiledGrid};
use crate::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, ScanKind};
use crate::scan_marks::{FixedPoint, MAX_BEAM_CELLS, ScanMarks};

/// Occupancy grid. Cells are fixed in `odom`; memory grows with the observed area, up to a limit.
#[derive(Clone, Debug)]
pub struct OccupancyGrid {
    cell_m: f64,
    miss: Miss,
    /// Heights above the vehicle's frame at which clouds are observed, metres.
    heights_m: [f64; 2],
    /// On land: rise over run of the steepest ground.
    max_slope: Option<f64>,
    update: LogOddsUpdate,
    tile_limit: usize,
    grid: TiledGrid<i16>,
    marks: ScanMarks,
    // Kept for their allocations.
    beams: Vec<(FixedPoint, FixedPoint, BeamOutcome)>,
    above_m: Vec<f32>,
    ends: HashSet<((i32, i32), bool), FxBuildHasher>,
}

/// Result of one scan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OccupancyReport {
    /// Beams that marked a hit.
    pub hits: u32,
    /// Beams without a return.
    pub misses: u32,
    /// Beams too long or too far away for the grid.
    pub out_of_bounds: u32,
}

impl OccupancyGrid {
    /// An empty grid; the settings must be valid.
    pub fn new(config: &OccupancyConfig) -> Self {
        let grid = TiledGrid::new(LogOdds::UNKNOWN.steps());
        let tile_bytes = TILE_EDGE * TILE_EDGE * size_of::<i16>();
        Self {
            cell_m: config.cell_m,
            miss: config.miss,
            heights_m: [config.cloud_min_height_m, config.cloud_max_height_m],
            max_slope: None,
            update: LogOddsUpdate::new(config),
            tile_limit: config.memory_limit_mb as usize * 1_000_000 / tile_bytes,
            grid,
            marks: ScanMarks::default(),
            beams: Vec::new(),
            above_m: Vec::new(),
            ends: HashSet::default(),
        }
    }

    /// From now on, ground of clouds that rises no steeper, rise over run, is no obstacle.
    pub(crate) const fn ignore_slopes(&mut self, max_slope: f64) {
        self.max_slope = Some(max_slope);
    }

    /// Updates each observed cell once. A hit wins over beams that only cross the cell; otherwise
    /// grazing beams would erase walls.
    pub fn integrate(&mut self, scan: &RegisteredScan) -> OccupancyReport {
        let mut report = OccupancyReport::default();
        let Some(extent) = self.take_beams(scan, &mut report) else {
            return report;
        };
        self.marks.cover(extent.lowest, extent.highest);
        for &(start, end, outcome) in &self.beams {
            self.marks.cross(start, end, outcome == BeamOutcome::Miss);
        }
        for &(_, end, outcome) in &self.beams {
            if outcome == BeamOutcome::Hit {
                self.marks.hit(end);
            }
        }
        let (grid, update) = (&mut self.grid, &self.update);
        self.marks.drain(|tile, rows| {
            let cells = grid.touch(tile);
            rows.for_each(|row, marks| {
                update.apply(&mut cells[row * TILE_EDGE..][..TILE_EDGE], marks);
            });
        });
        report
    }

    /// Fills `self.beams`; returns their extent, or `None` without beams.
    ///
    /// Of the beams of a cloud that end in the same cell, as all on a pole do, the first is enough.
    fn take_beams(
        &mut self,
        scan: &RegisteredScan,
        report: &mut OccupancyReport,
    ) -> Option<Extent> {
        self.beams.clear();
        self.ends.clear();
        let fixed = |point: &Point3<f64>| FixedPoint::from_metres(point.x, point.y, self.cell_m);
        let mut extent = None;
        let base_from_odom = scan.odom_from_base.inverse();
        let height_m = |point: &Point3<f64>| (base_from_odom * point).z;
        let cut = |beam: &RegisteredBeam| {
            let ends_m = [&beam.origin_in_odom, &beam.end_in_odom].map(height_m);
            within_heights(beam, ends_m, self.heights_m)
        };
        let is_cloud = scan.kind == ScanKind::Cloud;
        self.above_m.clear();
        if let Some(max_slope) = self.max_slope {
            scan.above_ground(max_slope, &mut self.above_m);
        }
        for (at, beam) in scan.beams.iter().enumerate() {
            let is_hit = beam.outcome == BeamOutcome::Hit;
            if !is_hit {
                report.misses += 1;
                if self.miss == Miss::Unknown {
                    continue;
                }
            }
            let mut within = is_cloud.then(|| cut(beam));
            let beam = match &mut within {
                None => beam,
                Some(Some(within)) => {
                    // A ramp ahead is as high as an obstacle above the vehicle's own plane.
                    if self.above_m.get(at).is_some_and(|above_m| *above_m <= 0.0) {
                        within.outcome = BeamOutcome::Miss;
                    }
                    within
                }
                Some(None) => {
                    report.hits += u32::from(is_hit);
                    continue;
                }
            };
            let ends = fixed(&beam.origin_in_odom).zip(fixed(&beam.end_in_odom));
            let grown = ends.and_then(|(start, end)| {
                let beam =
                    Extent::around(start.cell(), end.cell()).no_larger_than(MAX_BEAM_CELLS)?;
                // No vehicle moves that far within one scan: the poses are wrong.
                let scan = extent.map_or(beam, |extent: Extent| extent.joined(beam));
                Some((start, end, scan.no_larger_than(2 * MAX_BEAM_CELLS)?))
            });
            let Some((start, end, grown)) = grown else {
                report.out_of_bounds += 1;
                continue;
            };
            extent = Some(grown);
            report.hits += u32::from(is_hit);
            let end_cell = (end.cell(), beam.outcome == BeamOutcome::Hit);
            if !is_cloud || self.ends.insert(end_cell) {
                self.beams.push((start, end, beam.outcome));
            }
        }
        extent
    }

    /// Edge of a cell, metres.
    pub const fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// One cell.
    pub fn cell(&self, cell: CellIndex) -> LogOdds {
        let (tile, place) = cell.split();
        self.grid.get(tile).map_or(LogOdds::UNKNOWN, |tile| {
            LogOdds::from_steps(tile.cells[place])
        })
    }

    /// The cells.
    pub const fn grid(&self) -> &TiledGrid<i16> {
        &self.grid
    }

    /// The tiles touched since the last call, in tile order.
    pub fn take_changed(&mut self) -> Vec<TileIndex> {
        self.grid.take_changed()
    }

    /// Erases every cell.
    pub fn erase(&mut self) {
        self.grid.erase();
    }

    /// Evicts the tiles farthest from `point_in_odom` beyond the memory limit; returns their
    /// number.
    ///
    /// Call it after [`OccupancyGrid::take_changed`]: changes of evicted tiles are lost.
    pub fn enforce_memory_limit(&mut self, point_in_odom: &Point3<f64>) -> usize {
        let centre = CellIndex::containing(point_in_odom.xy(), self.cell_m)
            .split()
            .0;
        self.grid.evict_farthest(centre, self.tile_limit)
    }

    /// Memory of the cells, bytes.
    pub fn bytes(&self) -> usize {
        self.grid.bytes()
    }

    /// Scratch memory for adding a scan, bytes.
    pub fn scratch_bytes(&self) -> usize {
        let beam_bytes = size_of::<(FixedPoint, FixedPoint, BeamOutcome)>();
        self.marks.bytes() + self.beams.capacity() * beam_bytes
    }
}

/// The part of a beam between a lowest and a highest height, if there is one; its ends are at `[from_m, to_m]`. What ends outside
/// shows free space.
fn within_heights(
    beam: &RegisteredBeam,
    [from_m, to_m]: [f64; 2],
    [lowest_m, highest_m]: [f64; 2],
) -> Option<RegisteredBeam> {
    let is_within = |height_m: f64| (lowest_m..=highest_m).contains(&height_m);
    if is_within(from_m) && is_within(to_m) {
        return Some(*beam);
    }
    let rise_m = to_m - from_m;
    let at = |height_m: f64| (height_m - from_m) / rise_m;
    let (into, out) = if rise_m > 0.0 {
        (at(lowest_m), at(highest_m))
    } else {
        (at(highest_m), at(lowest_m))
    };
    let (into, out) = (into.max(0.0), out.min(1.0));
    let along = beam.end_in_odom - beam.origin_in_odom;
    // False for a beam that stays above or below them.
    (into < out).then(|| RegisteredBeam {
        origin_in_odom: beam.origin_in_odom + along * into,
        end_in_odom: beam.origin_in_odom + along * out,
        outcome: if is_within(to_m) {
            beam.outcome
        } else {
            BeamOutcome::Miss
        },
        ..*beam
    })
}

/// A rectangle of cells, both corners included.
#[derive(Clone, Copy, Debug)]
struct Extent {
    lowest: (i32, i32),
    highest: (i32, i32),
}

impl Extent {
    fn around(a: (i32, i32), b: (i32, i32)) -> Self {
        Self {
            lowest: (a.0.min(b.0), a.1.min(b.1)),
            highest: (a.0.max(b.0), a.1.max(b.1)),
        }
    }

    fn joined(self, other: Self) -> Self {
        Self {
            lowest: Self::around(self.lowest, other.lowest).lowest,
            highest: Self::around(self.highest, other.highest).highest,
        }
    }

    fn no_larger_than(self, cells: u32) -> Option<Self> {
        let wide = self.highest.0.abs_diff(self.lowest.0);
        let high = self.highest.1.abs_diff(self.lowest.1);
        (wide.max(high) < cells).then_some(self)
    }
}

/// Settings of `[mapping.occupancy]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OccupancyConfig {
    /// Enables the layer.
    pub enabled: bool,
    /// Side of a cell, metres.
    pub cell_m: f64,
    /// Probability that a cell crossed by a beam is occupied (\[LRF\]: 0.3).
    pub p_free: f64,
    /// Probability that a cell with a hit is occupied (\[LRF\]: 0.6).
    pub p_occupied: f64,
    /// p₀, the prior: probability that a cell is occupied before it is observed.
    pub p_prior: f64,
    /// Least probability of a cell, so that the map can change again.
    pub p_min: f64,
    /// Greatest probability of a cell.
    pub p_max: f64,
    /// Effect of a beam without a return on the cells along it.
    pub miss: Miss,
    /// Lowest height above the vehicle's frame at which a three-dimensional lidar is observed, metres: above the ground.
    pub cloud_min_height_m: f64,
    /// The highest: that of the vehicle.
    pub cloud_max_height_m: f64,
    /// Memory limit of the cells, megabytes (10⁶ bytes); beyond it the farthest tiles are evicted.
    pub memory_limit_mb: u32,
}

/// Effect of a beam without a return.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Miss {
    /// None (\[LRF\]: 0.5 beyond range).
    Unknown,
    /// Free up to the sensor's range, for lasers with reliable misses.
    Free,
}

impl Default for OccupancyConfig {
    fn default() -> Self {
        Self {
            enabled: true,
            cell_m: 0.1,
            p_free: 0.3,
            p_occupied: 0.6,
            p_prior: 0.5,
            p_min: 0.02,
            p_max: 0.98,
            miss: Miss::Unknown,
            cloud_min_height_m: 0.2,
            cloud_max_height_m: 1.5,
            memory_limit_mb: 256,
        }
    }
}

/// L = ln(p / (1 − p)) in steps of 1/4096, so that p = 0.02 … 0.98 (|L| ≤ 3.9) fits an i16.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LogOdds(i16);

/// Steps per unit of L: a step of 1/16,384 in probability at p = 0.5.
const STEPS: f64 = 4096.0;

impl LogOdds {
    /// A cell that no scan has touched. No probability encodes to it.
    pub const UNKNOWN: Self = Self(i16::MIN);

    /// Clamped to the range of 16 bits (p = 0.0003 … 0.9997).
    pub fn from_probability(p: f64) -> Self {
        let steps = libm::round(libm::log(p / (1.0 - p)) * STEPS);
        Self(steps.clamp(f64::from(-i16::MAX), f64::from(i16::MAX)) as i16)
    }

    /// `None` if unknown.
    pub fn probability(self) -> Option<f64> {
        (self != Self::UNKNOWN).then(|| 1.0 / (1.0 + libm::exp(f64::from(-self.0) / STEPS)))
    }

    /// Steps of 1/4096.
    pub const fn from_steps(steps: i16) -> Self {
        Self(steps)
    }

    /// Steps of 1/4096.
    pub const fn steps(self) -> i16 {
        self.0
    }
}

/// Equation (3) of docs/methods.md as a sum of log-odds, with clamps: `L ← L + l_z − l₀`.
#[derive(Clone, Copy, Debug)]
pub struct LogOddsUpdate {
    prior: i16,
    /// Less the prior, as is the next.
    free: i16,
    occupied: i16,
    min: i16,
    max: i16,
}

/// Marks of a cell within one scan.
pub mod mark {
    /// Not touched.
    pub const NONE: u8 = 0;
    /// Crossed by a beam.
    pub const FREE: u8 = 1;
    /// The end of a beam.
    pub const OCCUPIED: u8 = 2;
}

impl LogOddsUpdate {
    /// With the probabilities of `config`.
    pub fn new(config: &OccupancyConfig) -> Self {
        let steps = |p| LogOdds::from_probability(p).steps();
        let prior = steps(config.p_prior);
        Self {
            prior,
            free: steps(config.p_free).saturating_sub(prior),
            occupied: steps(config.p_occupied).saturating_sub(prior),
            min: steps(config.p_min),
            max: steps(config.p_max),
        }
    }

    /// Updates each cell by its mark; branch-free, so that it is vectorised.
    #[inline]
    pub fn apply(&self, cells: &mut [i16], marks: &[u8]) {
        const UNKNOWN: i16 = i16::MIN;
        // Local copies; otherwise it is not vectorised.
        let Self {
            prior,
            free,
            occupied,
            min,
            max,
        } = *self;
        for (cell, &mark) in cells.iter_mut().zip(marks) {
            let before = if *cell == UNKNOWN { prior } else { *cell };
            let evidence = if mark == mark::OCCUPIED {
                occupied
            } else {
                free
            };
            let after = before.saturating_add(evidence).clamp(min, max);
            *cell = if mark == mark::NONE { *cell } else { after };
        }
    }
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod log_odds_tests {
    use super::*;

    /// Equation (3) of docs/methods.md.
    fn bayes(p_z: f64, p: f64, p0: f64) -> f64 {
        1.0 / (1.0 + (1.0 - p_z) / p_z * (1.0 - p) / p * p0 / (1.0 - p0))
    }

    #[test]
    fn log_odds_sum_equals_equation_3() {
        for p_prior in [0.5, 0.4, 0.55] {
            let update = LogOddsUpdate::new(&OccupancyConfig {
                p_prior,
                ..OccupancyConfig::default()
            });
            let mut cells = [i16::MIN];
            let mut p = p_prior;
            for mark in [2, 2, 1, 2, 1, 1, 1, 2, 2, 2, 2] {
                update.apply(&mut cells, &[mark]);
                p = bayes(if mark == 2 { 0.6 } else { 0.3 }, p, p_prior);
                let got = LogOdds::from_steps(cells[0]).probability().unwrap();
                assert!((got - p).abs() < 5e-4, "{got} instead of {p}");
            }
        }
    }

    #[test]
    fn cells_are_clamped_and_unmarked_cells_stay() {
        let update = LogOddsUpdate::new(&OccupancyConfig::default());
        let mut cells = [i16::MIN, 17, i16::MIN, i16::MIN];
        for _ in 0..100 {
            update.apply(&mut cells, &[0, 0, 1, 2]);
        }
        let p = |i: usize| LogOdds::from_steps(cells[i]).probability();
        assert_eq!((p(0), cells[1]), (None, 17));
        assert!((p(2).unwrap() - 0.02).abs() < 1e-4);
        assert!((p(3).unwrap() - 0.98).abs() < 1e-4);
    }
}
