//! Which columns the laser swept, and which columns a thing truly is in.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Point3;

use super::ground::Ground;
use super::{Cell, LandWorld};
use crate::terrain::extent::extent_m;
use mapping::registered_scan::{BeamOutcome, RegisteredScan};
use simulation::scene::Scene;
use simulation::solid::Solid;

/// A hit that is no farther than this from the ground is on it, metres: ranges and attitudes are noisy.
pub(crate) const ON_GROUND_M: f64 = 0.1;
/// What rises no higher than this above the ground may be taken for it, metres: one voxel and a half.
pub(crate) const RAISED_M: f64 = 0.15;

/// How often a column was hit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ColumnHits {
    /// On the ground.
    pub(crate) ground: u32,
    /// Above it, no higher than the vehicle.
    pub(crate) raised: u32,
}

/// Hits of all columns that have any.
#[derive(Default)]
pub(crate) struct Hits {
    columns: BTreeMap<Cell, ColumnHits>,
}

impl Hits {
    /// Adds those of a scan as they were placed.
    pub(crate) fn add(&mut self, world: &LandWorld, ground: &Ground<'_>, scan: &RegisteredScan) {
        let hits = scan
            .beams
            .iter()
            .filter(|beam| beam.outcome == BeamOutcome::Hit);
        for point in hits.map(|beam| beam.end_in_odom) {
            let Some(ground_m) = ground.height_m(point.xy()) else {
                continue;
            };
            let above_m = point.z - ground_m;
            let column = self
                .columns
                .entry(world.cell_at([point.x, point.y]))
                .or_default();
            if above_m.abs() <= ON_GROUND_M {
                column.ground += 1;
            } else if above_m > RAISED_M && above_m <= world.vehicle_height_m() {
                column.raised += 1;
            }
        }
    }

    /// Those of a column.
    pub(crate) fn get(&self, cell: Cell) -> ColumnHits {
        self.columns.get(&cell).copied().unwrap_or_default()
    }
}

/// The columns in which a solid stands out from the ground, no higher than the vehicle.
pub(crate) fn columns_of(world: &LandWorld, ground: &Ground<'_>, solid: &Solid) -> BTreeSet<Cell> {
    let (x, y) = (extent_m(solid, 0), extent_m(solid, 1));
    let (first, last) = (world.cell_at([x[0], y[0]]), world.cell_at([x[1], y[1]]));
    let [least, greatest] = ground.corners();
    let reach = |axis: usize| first[axis].max(least[axis])..=last[axis].min(greatest[axis]);
    let scene = Scene::new(std::slice::from_ref(solid));
    let cell_m = world.cell_m();
    let is_in = |cell: &Cell| {
        ground.heights_m(*cell).is_some_and(|[low, high]| {
            let corner = |offset: i64, z: f64| {
                let [x, y] = cell.map(|n| (n + offset) as f64 * cell_m);
                Point3::new(x, y, z)
            };
            let (min, max) = (
                corner(0, low + RAISED_M),
                corner(1, high + world.vehicle_height_m()),
            );
            scene.touches_box(min, max, 0.0)
        })
    };
    reach(1)
        .flat_map(|y| reach(0).map(move |x| [x, y]))
        .filter(is_in)
        .collect()
}
