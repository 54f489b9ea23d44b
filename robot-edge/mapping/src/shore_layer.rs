//! Shores and docking sites as a layer (docs/methods.md, sections 4 and 6; \[HYB\] §7.2, §8.2.2,
//! §8.4.2): what is around the vehicle, and what it has left behind.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Point2;

use crate::cost_map::CostMap;
use crate::docking::{
    BoatFootprint, DockingColumn, DockingSite, GROUNDS, Vegetation, entered_site, find_sites_in,
    rank,
};
use crate::docking_site_tracker::DockingSiteTracker;
use crate::grid::CellIndex;
use crate::octree::Octree;
use crate::registered_scan::RegisteredScan;
use crate::rigidity::{ObstacleVoxel, REACH};
use crate::shore::{ShoreClass, ShoreCluster, ShoreConfig, ShoreMap, ShoreRule, Shores};
use crate::stem_density::{Densest, StemDensity};
use crate::vehicle::VehicleShape;

/// Content of a cell of the layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShoreCell {
    /// A cluster of this class.
    Cluster(ShoreClass),
    /// A docking site.
    DockingSite,
}

/// The columns around one that have a vote in it, itself included.
fn around(cell: CellIndex) -> impl Iterator<Item = CellIndex> {
    let reach = -REACH..=REACH;
    reach.clone().flat_map(move |dy| {
        reach.clone().map(move |dx| CellIndex {
            x: cell.x.saturating_add(dx),
            y: cell.y.saturating_add(dy),
        })
    })
}

/// Limit of stored clusters; beyond it those with the least numbers are removed.
const MAX_CLUSTERS: usize = 4096;
/// Limit of stored voxels of shores that extend out of the window: 300 m of the densest of \[HYB\]
/// table 8.1. Beyond it, only the voxels in the window count.
const MAX_VOXELS_OUTSIDE: usize = 65_536;

/// Shores around the vehicle, and those it has left behind.
#[derive(Clone, Debug)]
pub struct ShoreLayer {
    config: ShoreConfig,
    shores: Shores,
    stems: StemDensity,
    boat: BoatFootprint,
    cell_m: f64,
    clusters: BTreeMap<u32, ShoreCluster>,
    /// Voxels of the clusters that extended into the window at the last update, ascending.
    voxels: Vec<ObstacleVoxel>,
    sites: Vec<DockingSite>,
    site_tracker: DockingSiteTracker,
    cells: BTreeMap<CellIndex, ShoreCell>,
    changed: Vec<(CellIndex, Option<ShoreCell>)>,
    updates: u32,
    update: Option<ShoreUpdate>,
    /// Memory for those of the next update.
    columns: Vec<DockingColumn>,
}

/// An update that is under way.
#[derive(Clone, Debug)]
struct ShoreUpdate {
    /// Least cell of the window, and cells in a row.
    first: CellIndex,
    width: usize,
    columns: Vec<DockingColumn>,
    /// The boat's middle in `odom`, metres.
    boat_m: Point2<f64>,
    /// Until shores are found.
    obstacles: Option<Vec<ObstacleVoxel>>,
    clusters: Vec<ShoreCluster>,
    /// Parts of Solid clusters that give way.
    parts: Vec<ShoreCluster>,
    /// In how many of [`GROUNDS`] sites were searched for, and those found.
    searched: usize,
    sites: Vec<DockingSite>,
}

impl ShoreLayer {
    /// The settings must be valid.
    pub fn new(config: &ShoreConfig, boat: VehicleShape, cell_m: f64) -> Self {
        let boat = BoatFootprint {
            length_m: boat.length_m,
            width_m: boat.width_m,
        };
        Self {
            config: config.clone(),
            shores: Shores::new(config, cell_m),
            stems: StemDensity::new(&boat, cell_m),
            boat,
            cell_m,
            clusters: BTreeMap::new(),
            voxels: Vec::new(),
            sites: Vec::new(),
            site_tracker: DockingSiteTracker::default(),
            cells: BTreeMap::new(),
            changed: Vec::new(),
            updates: 0,
            update: None,
            columns: Vec::new(),
        }
    }

    /// Adds a scan of a laser whose beams diverge by that full angle, over water of that height, z of
    /// `odom`.
    pub fn add_scan(&mut self, scan: &RegisteredScan, divergence_rad: f64, water_m: f64) {
        if self.config.rule == ShoreRule::Density {
            self.stems.add(scan, divergence_rad, water_m);
        }
    }

    /// Vegetation of a cluster.
    fn vegetation(&self, cluster: &ShoreCluster) -> Vegetation {
        let stems = |densest: Densest| densest.stems_per_m2 / self.config.solid_from_per_m2;
        let density = cluster.densest.map_or(cluster.ratio, stems);
        Vegetation {
            class: cluster.class,
            density: density.min(1.0) as f32,
            shore: cluster.number,
        }
    }

    /// The part of a Solid cluster near the boat that gives way: no tile that is Solid by itself is in
    /// it, nor beside it.
    fn passable_part(&self, cluster: &ShoreCluster, boat_m: Point2<f64>) -> Option<ShoreCluster> {
        if cluster.class != ShoreClass::Solid || cluster.densest.is_none() {
            return None;
        }
        let mut known = BTreeMap::new();
        let mut is_solid = |tile: CellIndex| {
            *known.entry(tile).or_insert_with(|| {
                let densest = self.stems.densest(&[self.stems.first_column(tile)]);
                let class = densest.map(|densest| self.config.class_of_densest(densest));
                class == Some(ShoreClass::Solid)
            })
        };
        let mut part = cluster.clone();
        part.columns.retain(|&cell| {
            let is_near = (cell.centre(self.cell_m) - boat_m).norm() < self.config.near_m;
            let CellIndex { x, y } = self.stems.tile_of(cell);
            let mut beside = (-1..=1).flat_map(|dx| {
                (-1..=1).map(move |dy| CellIndex {
                    x: x.saturating_add(dx),
                    y: y.saturating_add(dy),
                })
            });
            is_near && !beside.any(&mut is_solid)
        });
        part.densest = self.stems.densest(&part.columns);
        part.class = self.config.class_of_densest(part.densest?);
        (part.class != ShoreClass::Solid).then_some(part)
    }

    /// Updates the layer from the cost map and the octree, with the boat's middle at that place of
    /// `odom`, metres.
    pub fn update(&mut self, costs: &CostMap, octree: &Octree, boat_m: Point2<f64>) {
        self.begin_update(costs, octree, boat_m);
        self.finish_update();
    }

    /// Begins such an update: reads the maps. One that is under way is finished before.
    pub fn begin_update(&mut self, costs: &CostMap, octree: &Octree, boat_m: Point2<f64>) {
        self.finish_update();
        let mut columns = std::mem::take(&mut self.columns);
        let (first, width) = costs.cells(&mut columns, |cell| DockingColumn {
            cost: cell.cost,
            is_clear_water: cell.is_clear_water,
            rises_from_water: cell.rises_from_water,
            vegetation: None,
        });
        self.update = Some(ShoreUpdate {
            first,
            width,
            columns,
            boat_m,
            obstacles: Some(costs.obstacle_voxels(octree)),
            clusters: Vec::new(),
            parts: Vec::new(),
            searched: 0,
            sites: Vec::new(),
        });
    }

    /// Finds shores of an update, and what grows in its columns.
    fn classify(&mut self, update: &mut ShoreUpdate, obstacles: Vec<ObstacleVoxel>) {
        let ShoreUpdate {
            first,
            width,
            boat_m,
            ..
        } = *update;
        let columns = &mut update.columns;
        let count = columns.len();
        let place_of = |cell: CellIndex| {
            let place = cell.place_in(first, width);
            place.filter(|at| *at < count)
        };
        let is_inside = |cell: CellIndex| place_of(cell).is_some();
        let mut unlabelled: Vec<_> = obstacles.iter().map(|found| found.voxel.column()).collect();
        unlabelled.dedup();
        let mut found = self.find_shores(obstacles, is_inside);
        for cluster in &mut found.clusters {
            cluster.densest = self.stems.densest(&cluster.columns);
            cluster.class = self.config.class(cluster.ratio, cluster.densest);
        }
        // Tiles that the window has left are kept as long as voxels of their clusters are.
        let kept = self.voxels.iter().map(|obstacle| obstacle.voxel.column());
        let kept: BTreeSet<_> = kept.map(|column| self.stems.tile_of(column)).collect();
        self.stems
            .retain(|tile, first| is_inside(first) || kept.contains(&tile));
        // Of two shores in a column the denser one counts.
        let mut by_class: Vec<_> = found.clusters.iter().collect();
        by_class.sort_by_key(|cluster| cluster.class);
        for cluster in by_class {
            let vegetation = Some(self.vegetation(cluster));
            for place in cluster.columns.iter().filter_map(|&cell| place_of(cell)) {
                columns[place].vegetation = vegetation;
            }
        }
        let clusters = found.clusters.iter();
        let parts = clusters.filter_map(|cluster| self.passable_part(cluster, boat_m));
        let parts: Vec<_> = parts.collect();
        for part in &parts {
            let vegetation = Some(self.vegetation(part));
            for place in part.columns.iter().filter_map(|&cell| place_of(cell)) {
                // Another Solid shore may be in the column, too.
                let column = &mut columns[place].vegetation;
                if column.is_some_and(|found| found.shore == part.number) {
                    *column = vegetation;
                }
            }
        }
        // Obstacles without metrics are what is around them, as far as the vote reaches; the densest counts.
        let adopted = unlabelled.into_iter().filter_map(|cell| {
            let place = place_of(cell).filter(|&place| columns[place].vegetation.is_none())?;
            let around = around(cell).filter_map(|cell| columns[place_of(cell)?].vegetation);
            Some((place, around.max_by_key(|found| found.class)?))
        });
        for (place, vegetation) in adopted.collect::<Vec<_>>() {
            columns[place].vegetation = Some(vegetation);
        }
        for column in columns {
            column.vegetation = column
                .vegetation
                .filter(|found| found.class != ShoreClass::Solid);
        }
        update.clusters = found.clusters;
        update.parts = parts;
    }

    /// Whether an update is under way.
    pub(super) const fn is_updating(&self) -> bool {
        self.update.is_some()
    }

    /// Continues an update that is under way: finds shores, or searches one kind of ground, of slopes and the two classes of vegetation,
    /// for docking sites. After the last the layer is updated. To be called before the next scan is added: stems are those of the maps.
    pub fn continue_update(&mut self) {
        let Some(mut update) = self.update.take() else {
            return;
        };
        if let Some(obstacles) = update.obstacles.take() {
            self.classify(&mut update, obstacles);
            self.update = Some(update);
            return;
        }
        let ShoreUpdate {
            first,
            width,
            columns,
            ..
        } = &update;
        if let Some(&ground) = GROUNDS.get(update.searched) {
            let found = find_sites_in(ground, *first, *width, self.cell_m, columns, &self.boat);
            update.sites.extend(found);
            update.searched += 1;
        }
        if update.searched < GROUNDS.len() {
            self.update = Some(update);
        } else {
            self.take_update(update);
        }
    }

    fn finish_update(&mut self) {
        while self.update.is_some() {
            self.continue_update();
        }
    }

    fn take_update(&mut self, update: ShoreUpdate) {
        self.updates += 1;
        let ShoreUpdate {
            first,
            width,
            columns,
            boat_m,
            clusters,
            parts,
            mut sites,
            ..
        } = update;
        let is_inside = |cell: CellIndex| {
            let place = cell.place_in(first, width);
            place.is_some_and(|at| at < columns.len())
        };
        rank(&mut sites);
        self.site_tracker.assign(&mut sites);
        let before = std::mem::take(&mut self.sites).into_iter();
        let entered = before.filter(|site| {
            let is_found = sites.iter().any(|found| found.number == site.number);
            let away_m = |cell: &CellIndex| (cell.centre(self.cell_m) - boat_m).norm();
            let mut cells = site.cells.iter();
            site.vegetation.is_some()
                && !is_found
                && cells.any(|cell| away_m(cell) < self.boat.length_m)
        });
        let entered = entered.map(|site| entered_site(first, width, self.cell_m, &columns, site));
        let entered: Vec<_> = entered.collect();
        sites.extend(entered);
        rank(&mut sites);
        self.sites = sites;
        let mut cells = BTreeMap::new();
        for site in &self.sites {
            cells.extend(
                site.cells
                    .iter()
                    .map(|&cell| (cell, ShoreCell::DockingSite)),
            );
        }
        for cluster in clusters.iter().chain(&parts) {
            let class = ShoreCell::Cluster(cluster.class);
            cells.extend(cluster.columns.iter().map(|&cell| (cell, class)));
        }
        self.publish(cells, is_inside);
        // Clusters that were left behind are kept unchanged.
        self.clusters
            .retain(|_, cluster| !cluster.columns.iter().any(|&cell| is_inside(cell)));
        // Without content, which clones would copy.
        self.columns = columns;
        self.columns.clear();
        let clusters = clusters.into_iter();
        self.clusters
            .extend(clusters.map(|cluster| (cluster.number, cluster)));
        while self.clusters.len() > MAX_CLUSTERS {
            self.clusters.pop_first();
        }
    }

    /// The clusters, by number.
    pub fn clusters(&self) -> impl Iterator<Item = &ShoreCluster> {
        self.clusters.values()
    }

    /// Docking sites, the best first.
    pub fn docking_sites(&self) -> &[DockingSite] {
        &self.sites
    }

    /// How often the layer was updated.
    pub const fn updates(&self) -> u32 {
        self.updates
    }

    /// Cells changed since the last call, `None` for emptied ones; a later entry of the same cell
    /// replaces an earlier one.
    pub fn take_changed(&mut self) -> Vec<(CellIndex, Option<ShoreCell>)> {
        std::mem::take(&mut self.changed)
    }

    /// Erases the layer.
    pub fn erase(&mut self) {
        self.clusters.clear();
        self.voxels.clear();
        self.stems.clear();
        self.sites.clear();
        self.cells.clear();
        self.changed.clear();
        self.update = None;
        self.updates += 1;
    }

    /// Shores of the window, extended by their voxels that the window has left behind: otherwise a
    /// shore that the boat passes would shrink to its last voxels, possibly of another class.
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

    /// Records the cells that changed. Cells outside of the window stay as published.
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
