//! The shore layer: clusters of what makes columns lethal on water, their classes, and where a boat can dock.

use std::collections::{BTreeMap, BTreeSet};

use super::cost_config::ShoreConfig;
use super::cost_map::CostMap;
use super::docking::{BoatFootprint, DockingSite, find_docking_sites};
use super::docking_grid::{DockingColumn, DockingGrid};
use super::grid::CellIndex;
use super::obstacle_voxel::ObstacleVoxel;
use super::octree::Octree;
use super::shore::{ShoreClass, ShoreCluster, ShoreMap, Shores};
use super::vehicle::VehicleShape;

/// What stands in a cell of the layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShoreCell {
    /// A cluster of this class.
    Cluster(ShoreClass),
    /// A place to dock.
    DockingSite,
}

/// Most clusters that are remembered; beyond it those with the least numbers go first.
const MAX_CLUSTERS: usize = 4096;
/// Most voxels that are remembered of shores that reach out of the window: 300 m of the densest of \[HYB\] table 8.1.
/// Of a longer one only what is in the window counts.
const MAX_VOXELS_OUTSIDE: usize = 65_536;

/// Shores around the vehicle, and those it has left behind.
#[derive(Clone, Debug)]
pub struct ShoreLayer {
    shores: Shores,
    boat: BoatFootprint,
    cell_m: f64,
    clusters: BTreeMap<u32, ShoreCluster>,
    /// The voxels of the clusters that reached into the window the last time, ascending.
    voxels: Vec<ObstacleVoxel>,
    sites: Vec<DockingSite>,
    cells: BTreeMap<CellIndex, ShoreCell>,
    changed: Vec<(CellIndex, Option<ShoreCell>)>,
    updates: u32,
}

impl ShoreLayer {
    /// Nothing known. The settings are taken as valid.
    pub fn new(config: &ShoreConfig, boat: VehicleShape, cell_m: f64) -> Self {
        Self {
            shores: Shores::new(config, cell_m),
            boat: BoatFootprint {
                length_m: boat.length_m,
                width_m: boat.width_m,
            },
            cell_m,
            clusters: BTreeMap::new(),
            voxels: Vec::new(),
            sites: Vec::new(),
            cells: BTreeMap::new(),
            changed: Vec::new(),
            updates: 0,
        }
    }

    /// Brings the layer up to what the cost map and the octree hold now.
    pub fn update(&mut self, costs: &CostMap, octree: &Octree) {
        self.updates += 1;
        let (first, width, window) = costs.cells();
        let is_inside = |cell: CellIndex| {
            let within = |at: i32, first: i32| {
                at.checked_sub(first)
                    .and_then(|n| usize::try_from(n).ok())
                    .is_some_and(|n| n < width)
            };
            within(cell.x, first.x) && within(cell.y, first.y)
        };
        let found = self.find_shores(costs.obstacle_voxels(octree), is_inside);
        let columns: Vec<_> = window
            .iter()
            .map(|cell| DockingColumn {
                cost: cell.cost,
                is_clear_water: cell.is_clear_water,
                rises_from_water: cell.rises_from_water,
            })
            .collect();
        let docking = DockingGrid::new(first, width, self.cell_m, &columns);
        self.sites = find_docking_sites(&docking, &self.boat);
        let mut cells = BTreeMap::new();
        for site in &self.sites {
            cells.extend(
                site.cells
                    .iter()
                    .map(|&cell| (cell, ShoreCell::DockingSite)),
            );
        }
        for cluster in &found.clusters {
            let class = ShoreCell::Cluster(cluster.class);
            cells.extend(cluster.columns.iter().map(|&cell| (cell, class)));
        }
        self.publish(cells, is_inside);
        // What was left behind is remembered as it was.
        self.clusters
            .retain(|_, cluster| !cluster.columns.iter().any(|&cell| is_inside(cell)));
        self.clusters.extend(
            found
                .clusters
                .into_iter()
                .map(|cluster| (cluster.number, cluster)),
        );
        while self.clusters.len() > MAX_CLUSTERS {
            self.clusters.pop_first();
        }
    }

    /// The clusters, by number.
    pub fn clusters(&self) -> impl Iterator<Item = &ShoreCluster> {
        self.clusters.values()
    }

    /// Where the boat can dock, the best first.
    pub fn docking_sites(&self) -> &[DockingSite] {
        &self.sites
    }

    /// How often the layer was updated.
    pub const fn updates(&self) -> u32 {
        self.updates
    }

    /// The cells that have changed since the last call, `None` where nothing stands any more; of the same cell the
    /// last one counts.
    pub fn take_changed(&mut self) -> Vec<(CellIndex, Option<ShoreCell>)> {
        std::mem::take(&mut self.changed)
    }

    /// Forgets everything.
    pub fn erase(&mut self) {
        self.clusters.clear();
        self.voxels.clear();
        self.sites.clear();
        self.cells.clear();
        self.changed.clear();
        self.updates += 1;
    }

    /// The shores of the window, with what the window has left behind of them: one that the boat passes must not shrink
    /// to the last of its voxels, which may be of another class.
    fn find_shores(
        &mut self,
        inside: Vec<ObstacleVoxel>,
        is_inside: impl Fn(CellIndex) -> bool,
    ) -> ShoreMap {
        let mut voxels = std::mem::take(&mut self.voxels);
        voxels.retain(|obstacle| !is_inside(obstacle.voxel.column()));
        if voxels.len() > MAX_VOXELS_OUTSIDE {
            voxels.clear();
        }
        voxels.extend(
            inside
                .into_iter()
                .filter(|obstacle| is_inside(obstacle.voxel.column())),
        );
        voxels.sort_unstable_by_key(|obstacle| obstacle.voxel);
        let found = self.shores.update(&voxels);
        let reaches_in =
            |cluster: &&ShoreCluster| cluster.columns.iter().any(|&cell| is_inside(cell));
        let reaching: BTreeSet<u32> = found
            .clusters
            .iter()
            .filter(reaches_in)
            .map(|cluster| cluster.number)
            .collect();
        let mut counted = found
            .voxels
            .iter()
            .filter(|shore| reaching.contains(&shore.cluster))
            .peekable();
        voxels.retain(|obstacle| {
            while counted
                .next_if(|shore| shore.voxel < obstacle.voxel)
                .is_some()
            {}
            counted
                .peek()
                .is_some_and(|shore| shore.voxel == obstacle.voxel)
        });
        self.voxels = voxels;
        found
    }

    /// Lists what differs from the last time. What lies outside of the window stays as it was told.
    fn publish(
        &mut self,
        cells: BTreeMap<CellIndex, ShoreCell>,
        is_inside: impl Fn(CellIndex) -> bool,
    ) {
        let gone = self
            .cells
            .keys()
            .filter(|&cell| is_inside(*cell) && !cells.contains_key(cell));
        self.changed.extend(gone.map(|&cell| (cell, None)));
        let new = cells
            .iter()
            .filter(|(cell, class)| self.cells.get(cell) != Some(class));
        self.changed
            .extend(new.map(|(&cell, &class)| (cell, Some(class))));
        self.cells = cells;
    }
}

#[cfg(test)]
mod tests;
