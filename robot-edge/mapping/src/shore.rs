//! Shores on water: clusters of the obstacles in lethal columns, their vegetation classes, and
//! docking sites (docs/methods.md, sections 4 and 6; \[HYB\] §7.2).
//!
//! At a distance single plants cannot be separated, so a shore is classified as a whole: by the
//! density of its stems where it is greatest, or by its share of rigid voxels.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Point2, Point3};
use serde::Deserialize;

use crate::clustering::{ClusterTracker, euclidean_clusters};
use crate::cost_map::CostMap;
use crate::docking::{
    BoatFootprint, DockingColumn, DockingSite, Vegetation, entered_site, find_docking_sites,
};
use crate::docking_site_tracker::DockingSiteTracker;
use crate::grid::{CellIndex, VoxelIndex};
use crate::octree::Octree;
use crate::registered_scan::RegisteredScan;
use crate::rigidity::{ObstacleVoxel, REACH, Rigidity, majority_vote};
pub use crate::stem_density::Densest;
use crate::stem_density::StemDensity;
use crate::vehicle::VehicleShape;

/// Settings of `[mapping.shore]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ShoreConfig {
    /// Requires the cost map.
    pub enabled: bool,
    /// What the class of a cluster is made of.
    pub rule: ShoreRule,
    /// Stems per square metre from which on a cluster is Dense.
    pub dense_from_per_m2: f64,
    /// Stems per square metre from which on a cluster is Solid.
    pub solid_from_per_m2: f64,
    /// Rigid above this `IntraScan` (\[HYB\] §7.2: 0.20).
    pub intra_threshold: f64,
    /// Rigid below this `InterScan` (\[HYB\] §7.2: 0.39).
    pub inter_threshold: f64,
    /// Voxels whose centres are no farther apart belong to one cluster, metres (\[HYB\] §7.2: 3).
    pub cluster_m: f64,
    /// Share of rigid voxels below which a cluster is Sparse (\[HYB\] §7.2: 0.25).
    pub sparse_below: f64,
    /// Share of rigid voxels above which a cluster is Solid (\[HYB\] §7.2: 0.68).
    pub solid_above: f64,
    /// Parts of a Solid shore that are no farther from the boat's middle have a class of their own,
    /// metres; 0: never (\[HYB\] §7.2; §9.1 asks for it).
    pub near_m: f64,
    /// Period of clustering in time of the data, seconds.
    pub period_s: f64,
}

/// What the class of a cluster is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ShoreRule {
    /// The density of stems where it is greatest; surfaces are Solid. Without beams that tell it, as
    /// `Ratio`.
    Density,
    /// The share of rigid voxels (\[HYB\] §7.2).
    Ratio,
}

impl Default for ShoreConfig {
    fn default() -> Self {
        Self {
            enabled: false,
            rule: ShoreRule::Density,
            dense_from_per_m2: 20.0,
            solid_from_per_m2: 50.0,
            intra_threshold: 0.20,
            inter_threshold: 0.39,
            cluster_m: 3.0,
            sparse_below: 0.25,
            solid_above: 0.68,
            near_m: 10.0,
            period_s: 1.0,
        }
    }
}

impl ShoreConfig {
    /// Class by the share of rigid voxels.
    pub fn class_of_ratio(&self, ratio: f64) -> ShoreClass {
        if ratio < self.sparse_below {
            ShoreClass::Sparse
        } else if ratio > self.solid_above {
            ShoreClass::Solid
        } else {
            ShoreClass::Dense
        }
    }

    /// Class by what a hull meets where it is densest.
    fn class_of_densest(&self, densest: Densest) -> ShoreClass {
        let is_rigid = densest.smooth >= SURFACE_SHARE || densest.tall >= TREE_HITS;
        // What cannot be seen through may hide a wall.
        if is_rigid || densest.open < OPEN_MIN || densest.stems_per_m2 >= self.solid_from_per_m2 {
            ShoreClass::Solid
        } else if densest.stems_per_m2 >= self.dense_from_per_m2 {
            ShoreClass::Dense
        } else {
            ShoreClass::Sparse
        }
    }
}

/// Clusters obstacles and numbers the clusters.
#[derive(Clone, Debug)]
pub struct Shores {
    config: ShoreConfig,
    cell_m: f64,
    tracker: ClusterTracker,
}

/// The shores of one update.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShoreMap {
    /// Ordered by number.
    pub clusters: Vec<ShoreCluster>,
    /// Every counted voxel, ascending.
    pub voxels: Vec<ShoreVoxel>,
}

/// A cluster of bank voxels.
#[derive(Clone, Debug, PartialEq)]
pub struct ShoreCluster {
    /// From 1; constant between updates.
    pub number: u32,
    /// Number of voxels.
    pub voxels: u32,
    /// Number of rigid voxels.
    pub rigid_voxels: u32,
    /// ρ: share of rigid voxels.
    pub ratio: f64,
    /// What was measured where its stems are densest; `None` by the rule `Ratio`, and where no
    /// beam hit it below the tops of canes.
    pub densest: Option<Densest>,
    /// Class by the configured rule.
    pub class: ShoreClass,
    /// Mean of the voxels' centres, metres in `odom`.
    pub centre_in_odom: Point3<f64>,
    /// Its columns, ascending. A column may belong to two clusters, one above the other.
    pub columns: Vec<CellIndex>,
}

/// Vegetation of a shore.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ShoreClass {
    /// Scattered canes.
    Sparse,
    /// Dense canes that still give way.
    Dense,
    /// Bushes, trunks, rock, walls.
    Solid,
}

/// One voxel of a cluster.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShoreVoxel {
    /// The voxel.
    pub voxel: VoxelIndex,
    /// Rigid or traversable, after the vote.
    pub rigidity: Rigidity,
    /// Number of its cluster.
    pub cluster: u32,
}

impl Shores {
    /// `cell_m` is the side of a voxel.
    pub fn new(config: &ShoreConfig, cell_m: f64) -> Self {
        Self {
            config: config.clone(),
            cell_m,
            tracker: ClusterTracker::default(),
        }
    }

    /// Clusters these voxels: each voxel once, in any order.
    ///
    /// A voxel is vegetation only if both metrics say so. A voxel without metrics is ignored, so
    /// that it cannot link two shores.
    pub fn update(&mut self, obstacles: &[ObstacleVoxel]) -> ShoreMap {
        let (voxels, labels) = self.labelled(obstacles);
        let labels = majority_vote(&voxels, &labels);
        let cluster_of = euclidean_clusters(&voxels, self.cell_m, self.config.cluster_m);
        let mut parts: Vec<Part> = Vec::new();
        for ((&voxel, &label), &cluster) in voxels.iter().zip(&labels).zip(&cluster_of) {
            let cluster = cluster as usize;
            if cluster == parts.len() {
                parts.push(Part::default());
            }
            parts[cluster].add(voxel, label);
        }
        let columns: Vec<_> = parts
            .iter_mut()
            .map(|part| std::mem::take(&mut part.columns))
            .collect();
        let numbers = self.tracker.assign(&columns);

        let labelled = voxels.iter().zip(labels).zip(cluster_of);
        let voxels = labelled.map(|((&voxel, rigidity), cluster)| ShoreVoxel {
            voxel,
            rigidity,
            cluster: numbers[cluster as usize],
        });
        let voxels = voxels.collect();
        let clusters = parts.iter().zip(columns).zip(&numbers);
        let clusters =
            clusters.map(|((part, columns), &number)| self.cluster(number, part, columns));
        let mut clusters: Vec<_> = clusters.collect();
        clusters.sort_unstable_by_key(|cluster| cluster.number);
        ShoreMap { clusters, voxels }
    }

    /// Voxels with a label, ascending, and their labels by both metrics.
    fn labelled(&self, obstacles: &[ObstacleVoxel]) -> (Vec<VoxelIndex>, Vec<Rigidity>) {
        let labelled = obstacles.iter().map(|obstacle| {
            let by_intra = obstacle.by_intra(self.config.intra_threshold);
            let by_inter = obstacle.by_inter(self.config.inter_threshold);
            (obstacle.voxel, by_intra.either(by_inter))
        });
        let counted = labelled.filter(|(_, label)| *label != Rigidity::Unlabelled);
        let mut counted: Vec<_> = counted.collect();
        counted.sort_unstable_by_key(|(voxel, _)| *voxel);
        counted.into_iter().unzip()
    }

    fn cluster(&self, number: u32, part: &Part, columns: Vec<CellIndex>) -> ShoreCluster {
        let ratio = f64::from(part.rigid_voxels) / f64::from(part.voxels);
        let class = self.config.class_of_ratio(ratio);
        let centre = |sum: i64| (sum as f64 / f64::from(part.voxels) + 0.5) * self.cell_m;
        ShoreCluster {
            number,
            voxels: part.voxels,
            rigid_voxels: part.rigid_voxels,
            ratio,
            densest: None,
            class,
            centre_in_odom: Point3::from(part.sum.map(centre)),
            columns,
        }
    }
}

/// Sums over a cluster.
#[derive(Debug, Default)]
struct Part {
    voxels: u32,
    rigid_voxels: u32,
    /// Sums of the voxel indices.
    sum: [i64; 3],
    columns: Vec<CellIndex>,
}

impl Part {
    /// Adds a voxel; voxels come ascending.
    fn add(&mut self, voxel: VoxelIndex, label: Rigidity) {
        self.voxels += 1;
        self.rigid_voxels += u32::from(label == Rigidity::Rigid);
        let VoxelIndex { x, y, z } = voxel;
        for (sum, index) in self.sum.iter_mut().zip([x, y, z]) {
            *sum += i64::from(index);
        }
        let column = voxel.column();
        if self.columns.last() != Some(&column) {
            self.columns.push(column);
        }
    }
}

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

/// Share of the hits on a tile from which on there is a surface among the canes.
const SURFACE_SHARE: f64 = 0.35;

/// Share of the parts of a cluster below which it is not seen through. Beams pass the ends of a wall.
const OPEN_MIN: f64 = 0.4;

/// Hits higher than any cane on a tile from which on there is a tree among them.
const TREE_HITS: u32 = 10;

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
        }
    }

    /// Adds a scan of a laser whose beams diverge by that full angle, over water of that height, z of
    /// `odom`.
    pub fn add_scan(&mut self, scan: &RegisteredScan, divergence_rad: f64, water_m: f64) {
        if self.config.rule == ShoreRule::Density {
            self.stems.add(scan, divergence_rad, water_m);
        }
    }

    /// Of a passable cluster, 0 … 1.
    fn density(&self, cluster: &ShoreCluster) -> f32 {
        cluster
            .densest
            .map_or(cluster.ratio as f32, |densest| self.stems_share(densest))
    }

    /// Stems over those of a Solid shore, at most 1.
    fn stems_share(&self, densest: Densest) -> f32 {
        (densest.stems_per_m2 / self.config.solid_from_per_m2).min(1.0) as f32
    }

    /// Of a Solid cluster the columns near the boat that give way, and their class: no tile that is
    /// Solid by itself is among them, nor beside them.
    fn passable_part(
        &self,
        cluster: &ShoreCluster,
        boat_m: Point2<f64>,
    ) -> Option<(Vec<CellIndex>, Densest)> {
        let class = |columns: &[CellIndex]| {
            let densest = self.stems.densest(columns)?;
            Some((densest, self.config.class_of_densest(densest)))
        };
        if cluster.class != ShoreClass::Solid || cluster.densest.is_none() {
            return None;
        }
        let mut known = BTreeMap::new();
        let mut is_solid = |tile: CellIndex| {
            *known.entry(tile).or_insert_with(|| {
                let found = class(&[self.stems.first_column(tile)]);
                found.is_some_and(|(_, class)| class == ShoreClass::Solid)
            })
        };
        let mut part = cluster.columns.clone();
        part.retain(|&cell| {
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
        let (densest, class) = class(&part)?;
        (class != ShoreClass::Solid).then_some((part, densest))
    }

    /// Updates the layer from the cost map and the octree.
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
        let obstacles = costs.obstacle_voxels(octree);
        let mut unlabelled: Vec<_> = obstacles.iter().map(|found| found.voxel.column()).collect();
        unlabelled.dedup();
        let mut found = self.find_shores(obstacles, is_inside);
        for cluster in &mut found.clusters {
            cluster.densest = self.stems.densest(&cluster.columns);
            if let Some(densest) = cluster.densest {
                cluster.class = self.config.class_of_densest(densest);
            }
        }
        // Tiles that the window has left are kept as long as voxels of their clusters are.
        let columns = self.voxels.iter().map(|obstacle| obstacle.voxel.column());
        let kept: BTreeSet<_> = columns.map(|column| self.stems.tile_of(column)).collect();
        self.stems
            .retain(|tile, first| is_inside(first) || kept.contains(&tile));
        let mut columns: Vec<_> = window
            .iter()
            .map(|cell| DockingColumn {
                cost: cell.cost,
                is_clear_water: cell.is_clear_water,
                rises_from_water: cell.rises_from_water,
                vegetation: None,
            })
            .collect();
        let place_of = |cell: CellIndex| {
            let [x, y] = [cell.x - first.x, cell.y - first.y].map(|at| at as usize);
            is_inside(cell).then(|| y * width + x)
        };
        // Of two shores in a column the denser one counts.
        let mut by_class: Vec<_> = found.clusters.iter().collect();
        by_class.sort_by_key(|cluster| cluster.class);
        for cluster in by_class {
            let vegetation = Vegetation {
                class: cluster.class,
                density: self.density(cluster),
                shore: cluster.number,
            };
            for place in cluster.columns.iter().filter_map(|&cell| place_of(cell)) {
                columns[place].vegetation = Some(vegetation);
            }
        }
        let [x, y] =
            [first.x, first.y].map(|first| first.saturating_add_unsigned((width / 2) as u32));
        let boat_m = CellIndex { x, y }.centre(self.cell_m);
        let parts = found.clusters.iter().filter_map(|cluster| {
            let (part, densest) = self.passable_part(cluster, boat_m)?;
            let vegetation = Vegetation {
                class: self.config.class_of_densest(densest),
                density: self.stems_share(densest),
                shore: cluster.number,
            };
            Some((part, vegetation))
        });
        let parts: Vec<_> = parts.collect();
        for (part, vegetation) in &parts {
            for place in part.iter().filter_map(|&cell| place_of(cell)) {
                columns[place].vegetation = Some(*vegetation);
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
        for column in &mut columns {
            column.vegetation = column
                .vegetation
                .filter(|found| found.class != ShoreClass::Solid);
        }
        let mut sites = find_docking_sites(first, width, self.cell_m, &columns, &self.boat);
        self.site_tracker.assign(&mut sites);
        let before = std::mem::take(&mut self.sites).into_iter();
        let entered = before.filter(|site| {
            let is_near = (site.centre_in_odom - boat_m).norm() < self.boat.length_m;
            let is_found = sites.iter().any(|found| found.number == site.number);
            site.vegetation.is_some() && is_near && !is_found
        });
        let entered: Vec<_> = entered
            .map(|site| entered_site(first, width, self.cell_m, &columns, site))
            .collect();
        sites.extend(entered);
        self.sites = sites;
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
        for (part, vegetation) in &parts {
            let class = ShoreCell::Cluster(vegetation.class);
            cells.extend(part.iter().map(|&cell| (cell, class)));
        }
        self.publish(cells, is_inside);
        // Clusters that were left behind are kept unchanged.
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

#[cfg(test)]
mod shore_tests {
    use proptest::prelude::*;

    use super::*;
    use crate::stem_density::tests::{DIVERGENCE_RAD, canes_and_a_trunk};

    const CELL_M: f64 = 0.3;

    fn obstacle(
        (x, y, z): (i32, i32, i32),
        intra: Option<f32>,
        inter: Option<f32>,
    ) -> ObstacleVoxel {
        ObstacleVoxel {
            voxel: VoxelIndex { x, y, z },
            intra,
            inter,
        }
    }

    /// A row of voxels too far apart for votes and near enough for one cluster, the first `rigid`
    /// of them rigid.
    fn row(y: i32, voxels: i32, rigid: i32) -> Vec<ObstacleVoxel> {
        let voxels = (0..voxels).map(|n| {
            let intra = if n < rigid { 0.3 } else { 0.1 };
            obstacle((3 * n, y, 1), Some(intra), Some(0.9))
        });
        voxels.collect()
    }

    fn update(obstacles: &[ObstacleVoxel]) -> ShoreMap {
        Shores::new(&ShoreConfig::default(), CELL_M).update(obstacles)
    }

    #[test]
    fn classes_follow_the_share_of_rigid_voxels() {
        use ShoreClass::{Dense, Solid, Sparse};
        for (rigid, class) in [
            (0, Sparse),
            (24, Sparse),
            (25, Dense),
            (68, Dense),
            (69, Solid),
            (100, Solid),
        ] {
            let map = update(&row(0, 100, rigid));
            let [cluster] = map.clusters.as_slice() else {
                panic!("{} clusters", map.clusters.len());
            };
            assert_eq!(cluster.class, class, "{rigid} of 100");
            assert_eq!(cluster.rigid_voxels, rigid as u32);
            assert_eq!(cluster.voxels, 100);
            assert!((cluster.ratio - 0.01 * f64::from(rigid)).abs() < 1e-12);
        }
    }

    #[test]
    fn density_makes_the_class_of_what_is_seen_through_and_neither_surface_nor_tree() {
        use ShoreClass::{Dense, Solid, Sparse};
        let config = ShoreConfig::default();
        for (stems_per_m2, smooth, tall, open, class) in [
            (19.9, 0.3, 9, 0.4, Sparse),
            (20.0, 0.0, 0, 1.0, Dense),
            (49.9, 0.0, 0, 1.0, Dense),
            (50.0, 0.0, 0, 1.0, Solid),
            (5.0, 0.35, 0, 1.0, Solid),
            (5.0, 0.0, 10, 1.0, Solid),
            (5.0, 0.0, 0, 0.39, Solid),
        ] {
            let densest = Densest {
                stems_per_m2,
                smooth,
                tall,
                open,
            };
            assert_eq!(config.class_of_densest(densest), class, "{densest:?}");
        }
    }

    #[test]
    fn near_the_boat_canes_beside_a_trunk_give_way() {
        let config = ShoreConfig {
            near_m: 20.0,
            ..ShoreConfig::default()
        };
        let mut layer = ShoreLayer::new(&config, super::tests::BOAT, CELL_M);
        for scan in canes_and_a_trunk() {
            layer.add_scan(&scan, DIVERGENCE_RAD, 0.0);
        }
        let columns = (-40..40).flat_map(|x| (33..45).map(move |y| CellIndex { x, y }));
        let columns: Vec<_> = columns.collect();
        let densest = layer.stems.densest(&columns);
        let cluster = ShoreCluster {
            number: 1,
            voxels: 1,
            rigid_voxels: 0,
            ratio: 0.0,
            densest,
            class: layer.config.class_of_densest(densest.unwrap()),
            centre_in_odom: Point3::origin(),
            columns,
        };
        assert_eq!(cluster.class, ShoreClass::Solid);
        let (part, densest) = layer
            .passable_part(&cluster, Point2::origin())
            .expect("a part that gives way");
        assert!(densest.smooth < SURFACE_SHARE, "{densest:?}");
        let has = |x_m: f64, y_m: f64| {
            part.binary_search(&CellIndex::containing(Point2::new(x_m, y_m), CELL_M))
                .is_ok()
        };
        assert!(has(-5.0, 10.5) && has(5.0, 10.5), "canes");
        assert!(
            !has(0.0, 10.0) && !has(1.0, 10.5),
            "the trunk and beside it"
        );
        let far = Point2::new(0.0, -20.0);
        assert_eq!(layer.passable_part(&cluster, far), None, "too far");
        layer.config.near_m = 0.0;
        assert_eq!(layer.passable_part(&cluster, Point2::origin()), None);
    }

    #[test]
    fn vegetation_needs_both_metrics() {
        let alone = |intra, inter| update(&[obstacle((0, 0, 0), intra, inter)]);
        let class = |intra, inter| alone(intra, inter).clusters[0].class;
        assert_eq!(class(Some(0.1), Some(0.9)), ShoreClass::Sparse);
        assert_eq!(class(Some(0.3), Some(0.9)), ShoreClass::Solid);
        assert_eq!(class(Some(0.1), Some(0.1)), ShoreClass::Solid);
        assert_eq!(class(Some(0.1), None), ShoreClass::Sparse);
        assert_eq!(class(None, Some(0.1)), ShoreClass::Solid);
        assert_eq!(alone(None, None), ShoreMap::default());
    }

    #[test]
    fn uncounted_voxels_do_not_link_shores() {
        let mut obstacles = row(0, 5, 0);
        obstacles.extend(row(14, 5, 5));
        assert_eq!(update(&obstacles).clusters.len(), 2);
        obstacles.extend(row(7, 5, 0).iter().map(|unseen| ObstacleVoxel {
            intra: None,
            inter: None,
            ..*unseen
        }));
        assert_eq!(update(&obstacles).clusters.len(), 2);
        obstacles.extend(row(7, 1, 0));
        // A counted voxel replaces an uncounted one.
        obstacles.swap_remove(10);
        assert_eq!(update(&obstacles).clusters.len(), 1);
    }

    #[test]
    fn vote_follows_the_combination_of_metrics() {
        // Combined, two of three are rigid and win; of each metric alone one is, and would lose.
        let map = update(&[
            obstacle((0, 0, 0), Some(0.3), Some(0.9)),
            obstacle((0, 0, 1), Some(0.1), Some(0.1)),
            obstacle((0, 0, 2), Some(0.1), Some(0.9)),
        ]);
        assert_eq!(map.clusters[0].rigid_voxels, 3);
    }

    #[test]
    fn clusters_have_a_centre_and_keep_their_number() {
        let mut shores = Shores::new(&ShoreConfig::default(), CELL_M);
        let mut obstacles = row(0, 3, 0);
        let map = shores.update(&obstacles);
        let centre = Point3::new(3.5 * CELL_M, 0.5 * CELL_M, 1.5 * CELL_M);
        assert!((map.clusters[0].centre_in_odom - centre).norm() < 1e-12);
        assert_eq!(
            map.clusters[0].columns,
            [0, 3, 6].map(|x| CellIndex { x, y: 0 })
        );
        // A new cluster that is earlier in order does not take the number.
        obstacles.extend(row(-30, 9, 0));
        let numbers: Vec<_> = shores.update(&obstacles).clusters;
        let numbers = numbers
            .iter()
            .map(|cluster| (cluster.number, cluster.voxels));
        assert_eq!(numbers.collect::<Vec<_>>(), [(1, 3), (2, 9)]);
    }

    proptest! {
        #[test]
        fn the_order_of_the_voxels_does_not_matter(
            metrics in prop::collection::btree_map(
                (-30..30i32, -30..30i32, 0..6i32),
                (prop::option::of(0.0..0.4_f32), prop::option::of(0.0..1.0_f32)),
                0..80,
            ),
            by in 0..80usize,
        ) {
            let mut obstacles: Vec<_> = metrics
                .iter()
                .map(|(&at, &(intra, inter))| obstacle(at, intra, inter))
                .collect();
            let expected = update(&obstacles);
            let counted = obstacles.iter().filter(|o| o.intra.is_some() || o.inter.is_some());
            prop_assert_eq!(expected.voxels.len(), counted.count());
            let in_clusters: u32 = expected.clusters.iter().map(|cluster| cluster.voxels).sum();
            prop_assert_eq!(in_clusters as usize, expected.voxels.len());
            let by = by % obstacles.len().max(1);
            obstacles.rotate_left(by);
            obstacles.reverse();
            prop_assert_eq!(update(&obstacles), expected);
        }
    }
}
