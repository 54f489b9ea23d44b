//! What the laser truly sweeps: the cells that the beams of a drive without any error meet.

use std::collections::BTreeMap;

use nalgebra::Point3;

use super::{Cell, TerrainWorld, around, seconds};
use crate::truth::GroundPlane;
use mapping::registered_scan::{BeamOutcome, RegisteredScan};

/// A cell is swept where the laser met it in so many scans in a row: a fifth of a second.
const SCANS_IN_A_ROW: u32 = 5;
/// Obstacles at least so high, and ditches at least so deep, may not be missed, metres.
pub(crate) const PROTRUDING_M: f64 = 0.15;
/// A surface so far above all that stands still there moves, metres.
const MOVING_M: f64 = 0.05;

/// What the laser met, by cell.
pub(crate) struct Sweep {
    cells: BTreeMap<Cell, SweepHits>,
}

#[derive(Clone, Copy, Debug, Default)]
struct SweepHits {
    /// Scans in a row that met anything, and the longest such row.
    any: Row,
    /// The same for surfaces that stand out.
    protruding: Row,
    /// Points beyond a threshold of the obstacle map.
    beyond: u32,
}

#[derive(Clone, Copy, Debug, Default)]
struct Row {
    last_scan: u32,
    length: u32,
    longest: u32,
}

impl Row {
    fn add(&mut self, scan: u32) {
        if self.length > 0 && self.last_scan == scan {
            return;
        }
        let follows = self.length > 0 && self.last_scan + 1 == scan;
        self.length = if follows { self.length + 1 } else { 1 };
        self.last_scan = scan;
        self.longest = self.longest.max(self.length);
    }
}

impl Sweep {
    /// Of the scans at the times, in seconds, that `when` chooses of the drive, above `plane`.
    pub(crate) fn of(
        world: &TerrainWorld,
        plane: &GroundPlane,
        when: impl Fn(f64) -> bool,
    ) -> anyhow::Result<Self> {
        let mut sweep = Self {
            cells: BTreeMap::new(),
        };
        let mut run = world.errorless_run()?;
        let mut scans = 0;
        run.advance_with(world.duration_s(), |_, scan| {
            scans += 1;
            if when(seconds(scan.stamp)) {
                sweep.add(world, plane, scan, scans);
            }
        })?;
        Ok(sweep)
    }

    fn add(
        &mut self,
        world: &TerrainWorld,
        plane: &GroundPlane,
        scan: &RegisteredScan,
        number: u32,
    ) {
        let thresholds = world.thresholds();
        let side = i64::from(world.config.mapping.elevation.cells);
        let vehicle = scan.odom_from_base.translation.vector;
        let first = world
            .cell_at([vehicle.x, vehicle.y])
            .map(|center| center - side / 2);
        let hits = scan
            .beams
            .iter()
            .filter(|beam| beam.outcome == BeamOutcome::Hit);
        for beam in hits {
            let point = beam.end_in_odom;
            let cell = world.cell_at([point.x, point.y]);
            // A cell less on every side: whether the outermost are in the window depends on millimetres.
            let is_inside = (0..2).all(|axis| (1..side - 1).contains(&(cell[axis] - first[axis])));
            if !is_inside || moves(world, cell, &point) {
                continue;
            }
            let met = self.cells.entry(cell).or_default();
            met.any.add(number);
            let height_m = plane.height_m(point);
            if height_m > thresholds.above_m || height_m < thresholds.below_m {
                met.beyond += 1;
            }
            // Rounding must not decide on a kerb of exactly this height.
            if height_m.abs() >= PROTRUDING_M - 1e-6 {
                met.protruding.add(number);
            }
        }
    }

    /// Whether the laser met enough beyond a threshold in a cell for the map to know of it: 2 points, as the
    /// obstacle map's own rule demands.
    pub(crate) fn hit_an_obstacle(&self, cell: Cell) -> bool {
        self.cells.get(&cell).is_some_and(|met| met.beyond >= 2)
    }

    /// The cells that the laser swept.
    pub(crate) fn cells(&self) -> impl Iterator<Item = Cell> {
        let swept = |met: &SweepHits| met.any.longest >= SCANS_IN_A_ROW;
        self.cells
            .iter()
            .filter(move |(_, met)| swept(met))
            .map(|(&cell, _)| cell)
    }

    /// Those where it swept an obstacle or a ditch.
    pub(crate) fn protruding(&self) -> impl Iterator<Item = Cell> {
        let swept = |met: &SweepHits| met.protruding.longest >= SCANS_IN_A_ROW;
        self.cells
            .iter()
            .filter(move |(_, met)| swept(met))
            .map(|(&cell, _)| cell)
    }
}

fn moves(world: &TerrainWorld, cell: Cell, point: &Point3<f64>) -> bool {
    let tops = around(cell).filter_map(|at| world.heights().get(at).map(|cell| cell.max_m));
    tops.fold(f64::NEG_INFINITY, f64::max) + MOVING_M < point.z
}
