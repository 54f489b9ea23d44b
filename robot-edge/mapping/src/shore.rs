//! On water: shores, and how dense what grows there is.
//!
//! \[HYB\] §7.2 (*Hybrid 3D perception on land and water*). From afar single plants are not to be told apart,
//! so a shore is judged as a whole: by the share of its voxels that are rigid. (The document's text calls ρ
//! the share of vegetation; its table 8.1 and its labels fit only the share of what is rigid.)

use nalgebra::Point3;

use super::cluster_tracker::ClusterTracker;
use super::cost_config::ShoreConfig;
use super::grid::CellIndex;
use super::majority_vote::majority_vote;
use super::obstacle_voxel::{ObstacleVoxel, Rigidity};
use super::shore_clusters::euclidean_clusters;
use super::voxel::VoxelIndex;

/// Clusters obstacles, and knows clusters again.
#[derive(Clone, Debug)]
pub struct Shores {
    config: ShoreConfig,
    cell_m: f64,
    tracker: ClusterTracker,
}

/// The shores of one update.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShoreMap {
    /// All clusters, by number.
    pub clusters: Vec<ShoreCluster>,
    /// Every voxel that is counted, ascending.
    pub voxels: Vec<ShoreVoxel>,
}

/// Voxels that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct ShoreCluster {
    /// The same from update to update, from 1.
    pub number: u32,
    /// How many it has.
    pub voxels: u32,
    /// How many of these are rigid.
    pub rigid_voxels: u32,
    /// ρ: the share of these.
    pub ratio: f64,
    /// What that means.
    pub class: ShoreClass,
    /// Mean of the voxels' centres, metres in `odom`.
    pub centre_in_odom: Point3<f64>,
    /// The columns it stands in, ascending. A column in which voxels hang farther above others than the
    /// tolerance belongs to two clusters.
    pub columns: Vec<CellIndex>,
}

/// What grows on a shore.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ShoreClass {
    /// Scattered canes.
    Sparse,
    /// Canes close together, that still give way.
    Dense,
    /// Bushes, trunks, rock, walls: not to be touched.
    Solid,
}

/// One voxel of a cluster.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShoreVoxel {
    /// Where it lies.
    pub voxel: VoxelIndex,
    /// Rigid or traversable, after the vote.
    pub rigidity: Rigidity,
    /// The number of its cluster.
    pub cluster: u32,
}

impl Shores {
    /// No shores yet; voxels are `cell_m` apart.
    pub fn new(config: &ShoreConfig, cell_m: f64) -> Self {
        Self {
            config: config.clone(),
            cell_m,
            tracker: ClusterTracker::default(),
        }
    }

    /// The shores that these voxels make: each voxel once, in any order.
    ///
    /// A voxel is vegetation only if both metrics say so. One without any metric is not counted and joins no
    /// cluster: it must not tie shores together of which nothing else is known to link them.
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

    /// The voxels that are counted, ascending, and what both metrics together say of each.
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
        let class = if ratio < self.config.sparse_below {
            ShoreClass::Sparse
        } else if ratio > self.config.solid_above {
            ShoreClass::Solid
        } else {
            ShoreClass::Dense
        };
        let centre = |sum: i64| (sum as f64 / f64::from(part.voxels) + 0.5) * self.cell_m;
        ShoreCluster {
            number,
            voxels: part.voxels,
            rigid_voxels: part.rigid_voxels,
            ratio,
            class,
            centre_in_odom: Point3::from(part.sum.map(centre)),
            columns,
        }
    }
}

/// What has been counted of a cluster.
#[derive(Debug, Default)]
struct Part {
    voxels: u32,
    rigid_voxels: u32,
    /// Of the voxels' indices, in whole numbers.
    sum: [i64; 3],
    columns: Vec<CellIndex>,
}

impl Part {
    /// Counts a voxel; they come ascending.
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

    /// A row of voxels too far apart to vote on one another and near enough to be one cluster, the first
    /// `rigid` of them rigid.
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
    fn vegetation_must_be_seen_by_both_metrics() {
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
        // The one that is counted now stands where one was not.
        obstacles.swap_remove(10);
        assert_eq!(update(&obstacles).clusters.len(), 1);
    }

    #[test]
    fn the_vote_comes_after_both_metrics_are_combined() {
        // By either, two of three are rigid and win; of each metric alone one is, and would lose.
        let map = update(&[
            obstacle((0, 0, 0), Some(0.3), Some(0.9)),
            obstacle((0, 0, 1), Some(0.1), Some(0.1)),
            obstacle((0, 0, 2), Some(0.1), Some(0.9)),
        ]);
        assert_eq!(map.clusters[0].rigid_voxels, 3);
    }

    #[test]
    fn a_cluster_knows_where_it_is_and_stays_the_same() {
        let mut shores = Shores::new(&ShoreConfig::default(), CELL_M);
        let mut obstacles = row(0, 3, 0);
        let map = shores.update(&obstacles);
        let centre = Point3::new(3.5 * CELL_M, 0.5 * CELL_M, 1.5 * CELL_M);
        assert!((map.clusters[0].centre_in_odom - centre).norm() < 1e-12);
        assert_eq!(
            map.clusters[0].columns,
            [0, 3, 6].map(|x| CellIndex { x, y: 0 })
        );
        // One that comes before it in order does not take its number.
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
