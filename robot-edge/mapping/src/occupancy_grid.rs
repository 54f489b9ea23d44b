//! 2D Bayesian occupancy grid from a horizontal laser (\[LRF\]; `algorithms.md` §2), without bounds.

use nalgebra::Point3;

use super::grid::{CellIndex, TILE_EDGE, TileIndex, TiledGrid};
use super::log_odds::{LogOdds, LogOddsUpdate};
use super::occupancy_config::{Miss, OccupancyConfig};
use super::ray::FixedPoint;
use super::registered_scan::{BeamOutcome, RegisteredScan};
use super::scan_marks::{MAX_BEAM_CELLS, ScanMarks};

/// The grid. Cells are fixed in `odom`; memory grows with the area that was seen, up to a limit.
#[derive(Clone, Debug)]
pub struct OccupancyGrid {
    cell_m: f64,
    miss: Miss,
    update: LogOddsUpdate,
    tile_limit: usize,
    grid: TiledGrid<i16>,
    marks: ScanMarks,
    // Kept for its allocation: ends of the beams of one scan.
    beams: Vec<(FixedPoint, FixedPoint, BeamOutcome)>,
}

/// What became of one scan's beams.
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
    /// An empty grid. `config` is taken as valid (see the configuration's own checks).
    pub fn new(config: &OccupancyConfig) -> Self {
        let grid = TiledGrid::new(LogOdds::UNKNOWN.steps());
        let tile_bytes = TILE_EDGE * TILE_EDGE * size_of::<i16>();
        Self {
            cell_m: config.cell_m,
            miss: config.miss,
            update: LogOddsUpdate::new(
                config.p_free,
                config.p_occupied,
                config.p_min,
                config.p_max,
            ),
            tile_limit: config.memory_limit_mb as usize * 1_000_000 / tile_bytes,
            grid,
            marks: ScanMarks::default(),
            beams: Vec::new(),
        }
    }

    /// Updates every cell that the scan saw, once: a hit in it wins over beams that only cross it, or
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

    /// Fills `self.beams` with those that mark cells; their extent, or `None` if there are none.
    fn take_beams(
        &mut self,
        scan: &RegisteredScan,
        report: &mut OccupancyReport,
    ) -> Option<Extent> {
        self.beams.clear();
        let fixed = |point: &Point3<f64>| FixedPoint::from_metres(point.x, point.y, self.cell_m);
        let mut extent = None;
        for beam in &scan.beams {
            if beam.outcome == BeamOutcome::Miss {
                report.misses += 1;
                if self.miss == Miss::Unknown {
                    continue;
                }
            }
            let ends = fixed(&beam.origin_in_odom).zip(fixed(&beam.end_in_odom));
            let grown = ends.and_then(|(start, end)| {
                let beam =
                    Extent::around(start.cell(), end.cell()).no_larger_than(MAX_BEAM_CELLS)?;
                // A vehicle does not move that far within one sweep: such poses make no sense.
                let scan = extent.map_or(beam, |extent: Extent| extent.joined(beam));
                Some((start, end, scan.no_larger_than(2 * MAX_BEAM_CELLS)?))
            });
            let Some((start, end, grown)) = grown else {
                report.out_of_bounds += 1;
                continue;
            };
            extent = Some(grown);
            report.hits += u32::from(beam.outcome == BeamOutcome::Hit);
            self.beams.push((start, end, beam.outcome));
        }
        extent
    }

    /// Edge of a cell, metres.
    pub const fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// What is known of a cell.
    pub fn cell(&self, cell: CellIndex) -> LogOdds {
        let (tile, place) = cell.split();
        self.grid.get(tile).map_or(LogOdds::UNKNOWN, |tile| {
            LogOdds::from_steps(tile.cells[place])
        })
    }

    /// The tiles.
    pub const fn grid(&self) -> &TiledGrid<i16> {
        &self.grid
    }

    /// The tiles touched since the last call, in tile order.
    pub fn take_changed(&mut self) -> Vec<TileIndex> {
        self.grid.take_changed()
    }

    /// Forgets every cell.
    pub fn erase(&mut self) {
        self.grid.erase();
    }

    /// Keeps the memory limit: evicts the tiles farthest from `point_in_odom` and says how many.
    ///
    /// Call it after [`OccupancyGrid::take_changed`], or their last changes are lost.
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

    /// Memory of what is only needed while a scan is added, bytes; it grows to the largest scan's.
    pub fn scratch_bytes(&self) -> usize {
        let beam_bytes = size_of::<(FixedPoint, FixedPoint, BeamOutcome)>();
        self.marks.bytes() + self.beams.capacity() * beam_bytes
    }
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

#[cfg(test)]
mod tests;
