//! Shores on water: clusters of the obstacles in lethal columns and their vegetation classes
//! (docs/methods.md, section 6; \[HYB\] §7.2).
//!
//! At a distance single plants cannot be separated, so a shore is classified as a whole: by the
//! density of its stems where it is greatest, or by its share of rigid voxels.

use nalgebra::Point3;
use serde::Deserialize;

use crate::clustering::{ClusterTracker, euclidean_clusters};
use crate::grid::{CellIndex, VoxelIndex};
use crate::rigidity::{ObstacleVoxel, Rigidity, majority_vote};
pub use crate::stem_density::Densest;

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
    /// The density of stems where it is greatest; surfaces are Solid. As `Ratio` where no beam
    /// measures it.
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
            solid_from_per_m2: 46.0,
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

/// Share of the hits on a tile from which on there is a surface among the canes.
const SURFACE_SHARE: f64 = 0.3;

/// Share of the parts of a cluster below which it is not seen through. Beams pass the ends of a wall.
const OPEN_MIN: f64 = 0.4;

/// So dense, the same share must be greater: patches that are denser still are not all met.
const CROWDED_FROM_PER_M2: f64 = 40.0;
const CROWDED_OPEN_MIN: f64 = 0.65;

/// Hits higher than any cane on a tile from which on there is a tree among them.
const TREE_HITS: u32 = 10;

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

    /// Class of a whole cluster. What is Solid by its share of rigid voxels has patches in which stems are not distinguished.
    pub(crate) fn class(&self, ratio: f64, densest: Option<Densest>) -> ShoreClass {
        let by_ratio = self.class_of_ratio(ratio);
        match densest {
            Some(densest) if by_ratio != ShoreClass::Solid => self.class_of_densest(densest),
            _ => by_ratio,
        }
    }

    /// Class by what a hull meets where it is densest.
    pub(crate) fn class_of_densest(&self, densest: Densest) -> ShoreClass {
        let is_rigid = densest.smooth >= SURFACE_SHARE || densest.tall >= TREE_HITS;
        // What cannot be seen through may hide a wall.
        let is_closed = if densest.stems_per_m2 >= CROWDED_FROM_PER_M2 {
            densest.open < CROWDED_OPEN_MIN
        } else {
            densest.open < OPEN_MIN
        };
        if is_rigid || is_closed || densest.stems_per_m2 >= self.solid_from_per_m2 {
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

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
        for (stems_per_m2, smooth, tall, open, ratio, class) in [
            (19.9, 0.29, 9, 0.4, 0.68, Sparse),
            (20.0, 0.0, 0, 1.0, 0.0, Dense),
            (39.9, 0.0, 0, 0.4, 0.0, Dense),
            (40.0, 0.0, 0, 0.64, 0.0, Solid),
            (45.9, 0.0, 0, 0.65, 0.68, Dense),
            (46.0, 0.0, 0, 1.0, 0.0, Solid),
            (5.0, 0.3, 0, 1.0, 0.0, Solid),
            (5.0, 0.0, 10, 1.0, 0.0, Solid),
            (5.0, 0.0, 0, 0.39, 0.0, Solid),
            (5.0, 0.0, 0, 1.0, 0.69, Solid),
        ] {
            let densest = Densest {
                stems_per_m2,
                smooth,
                tall,
                open,
            };
            assert_eq!(
                config.class(ratio, Some(densest)),
                class,
                "{densest:?} {ratio}"
            );
        }
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
