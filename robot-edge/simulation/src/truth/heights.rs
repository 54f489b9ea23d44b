//! How high the ground and what stands on it are, as seen from above.

mod columns;

use nalgebra::{Point2, Point3};

use crate::World;
use crate::scene::Scene;
use crate::solid::{Reflectivity, Solid};
use crate::truth::cells::{Bounds, CellGrid, TruthError};
use crate::truth::heights::columns::{Columns, part_centres};
use crate::truth::plan::Plan;
use crate::truth::verdict::{GroundPlane, Thresholds, Verdict};

/// What counts as surface.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct HeightOptions {
    /// Whether glass does. By default what is under and behind it does.
    pub glass: bool,
    /// Whether moving solids do, where they are at this time in seconds since the beginning. By default
    /// they are left out.
    pub moving_at_s: Option<f64>,
}

/// The heights over a rectangle of cells whose edges lie at multiples of the cell size.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightTruth {
    grid: CellGrid,
    cells: Vec<Option<CellHeights>>,
}

/// The surface in one cell, as seen from above: what stands under something else does not count.
#[derive(Clone, Debug, PartialEq)]
pub struct CellHeights {
    /// Least height, metres above z = 0 of the world.
    pub min_m: f64,
    /// Greatest height, metres above z = 0 of the world.
    pub max_m: f64,
    /// Points of the surface among which its extremes lie, measured from any plane: either side of every
    /// line where it may bend or jump, and the cell's corners.
    pub corners_m: Vec<Point3<f64>>,
    /// Heights at the centres of equal parts of the cell's area, in rows of growing y, in a row growing x;
    /// not-a-number where there is no surface.
    pub samples_m: Vec<f32>,
    min_corner_m: Point2<f64>,
    cell_m: f64,
}

/// 300 MB, were all crossed by edges; 70 MB, were none.
const MAX_CELLS: usize = 1 << 18;

/// The heights of `world` over all cells that `bounds` touches.
///
/// Least and greatest heights are exact, to some micrometres, where surfaces are planes that meet at the
/// edges of their solids. Two exceptions: where two faces cut through each other (a ramp sunk into the
/// floor) the crease between is seen by the samples only, and so are surfaces narrower than a sample in
/// meshes of more than some 30 lines a cell. Circles count as polygons of 32 corners.
pub fn heights(
    world: &World,
    cell_m: f64,
    bounds: Bounds,
    options: HeightOptions,
) -> Result<HeightTruth, TruthError> {
    let grid = CellGrid::new(cell_m, bounds, MAX_CELLS)?;
    let counts = |solid: &&Solid| match solid.reflectivity {
        Reflectivity::Glass { .. } => options.glass,
        Reflectivity::Diffuse | Reflectivity::Specular { .. } => true,
    };
    let solids: Vec<Solid> = world
        .solids()
        .iter()
        .filter(counts)
        .filter_map(|solid| match solid.motion {
            Some(_) => solid.at(options.moving_at_s?),
            None => Some(solid.clone()),
        })
        .collect();
    let columns = Columns::new(Scene::new(&solids), Plan::of(&solids), grid);
    let cells = columns.collect();
    Ok(HeightTruth { grid, cells })
}

impl HeightTruth {
    /// The cells.
    pub fn grid(&self) -> &CellGrid {
        &self.grid
    }

    /// The surface in the cell of index (i, j); `None` outside the grid and where there is nothing.
    pub fn get(&self, index: [i64; 2]) -> Option<&CellHeights> {
        self.cells.get(self.grid.place(index)?)?.as_ref()
    }

    /// Every cell that has a surface, with its index, rows of growing y, in a row growing x.
    pub fn iter(&self) -> impl Iterator<Item = ([i64; 2], &CellHeights)> + '_ {
        self.cells
            .iter()
            .enumerate()
            .filter_map(|(place, cell)| Some((self.grid.index(place), cell.as_ref()?)))
    }

    /// The verdict on a cell grown by `reach_m` (at most a cell) to all sides; `None` where there is
    /// nothing. Where it differs from that on the cell alone, what decides it is so near that noise may
    /// carry its points into the cell.
    pub fn verdict_within(
        &self,
        index: [i64; 2],
        reach_m: f64,
        ground: &GroundPlane,
        thresholds: Thresholds,
    ) -> Option<Verdict> {
        self.get(index)?;
        let cell_m = self.grid.cell_m();
        let min = Point2::from(index.map(|n| n as f64 * cell_m - reach_m));
        let max = Point2::from(index.map(|n| (n + 1) as f64 * cell_m + reach_m));
        let is_near =
            |p: &Point3<f64>| (0..2).all(|axis| min[axis] <= p[axis] && p[axis] <= max[axis]);
        let around = (-1..=1).flat_map(|dj| (-1..=1).map(move |di| [di, dj]));
        let cells: Vec<&CellHeights> = around
            .filter_map(|[di, dj]| self.get([index[0].checked_add(di)?, index[1].checked_add(dj)?]))
            .collect();
        let heights = |points: &mut dyn Iterator<Item = Point3<f64>>| -> Vec<f64> {
            points
                .filter(is_near)
                .map(|point| ground.height_m(point))
                .collect()
        };
        let corners = heights(&mut cells.iter().flat_map(|cell| cell.corners_m.iter().copied()));
        let samples = heights(&mut cells.iter().flat_map(|cell| cell.samples()));
        Verdict::of(&corners, &samples, samples.len(), thresholds)
    }
}

impl CellHeights {
    /// Whether the cell is an obstacle to a vehicle on `ground`.
    pub fn verdict(&self, ground: &GroundPlane, thresholds: Thresholds) -> Option<Verdict> {
        let corners: Vec<f64> = self.corners_m.iter().map(|&p| ground.height_m(p)).collect();
        let samples: Vec<f64> = self.samples().map(|p| ground.height_m(p)).collect();
        Verdict::of(&corners, &samples, self.samples_m.len(), thresholds)
    }

    fn samples(&self) -> impl Iterator<Item = Point3<f64>> + '_ {
        let parts = self.samples_m.len().isqrt();
        part_centres(self.min_corner_m, self.cell_m, parts)
            .zip(&self.samples_m)
            .filter(|(_, height_m)| !height_m.is_nan())
            .map(|(at, &height_m)| Point3::new(at.x, at.y, f64::from(height_m)))
    }
}

#[cfg(test)]
mod tests;
