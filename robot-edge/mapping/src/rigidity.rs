//! On land: which obstacles could be pushed through.
//!
//! \[HYB\] §7.1 (*Hybrid 3D perception on land and water*): a voxel is an obstruction only where both metrics,
//! each smoothed on its own, say that it is rigid; a column that holds one is.

use super::cost_config::RigidityConfig;
use super::grid::CellIndex;
use super::majority_vote::majority_vote;
use super::obstacle_voxel::{ObstacleVoxel, Rigidity};
use super::voxel::VoxelIndex;

/// Obstacles told apart.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RigidityMap {
    /// Every voxel, ascending.
    pub voxels: Vec<(VoxelIndex, Rigidity)>,
    /// Every column that holds a voxel, ascending: rigid with one rigid voxel, traversable with only others
    /// that are labelled, unlabelled (it keeps its cost) where none is.
    pub columns: Vec<(CellIndex, Rigidity)>,
}

impl RigidityMap {
    /// Tells obstacles apart: all voxels of the columns in question, each once, in any order.
    pub fn of(obstacles: &[ObstacleVoxel], config: &RigidityConfig) -> Self {
        let mut obstacles = obstacles.to_vec();
        obstacles.sort_unstable_by_key(|obstacle| obstacle.voxel);
        let voxels: Vec<_> = obstacles.iter().map(|obstacle| obstacle.voxel).collect();
        let smoothed = |label: &dyn Fn(&ObstacleVoxel) -> Rigidity| {
            let labels: Vec<_> = obstacles.iter().map(label).collect();
            majority_vote(&voxels, &labels)
        };
        let by_intra = smoothed(&|obstacle| obstacle.by_intra(config.intra_threshold));
        let by_inter = smoothed(&|obstacle| obstacle.by_inter(config.inter_threshold));
        let labels = by_intra.iter().zip(by_inter);
        let labels = labels.map(|(&intra, inter)| intra.both(inter));
        let voxels: Vec<_> = voxels.iter().copied().zip(labels).collect();
        let columns = voxels
            .chunk_by(|(a, _), (b, _)| a.column() == b.column())
            .filter_map(verdict)
            .collect();
        Self { voxels, columns }
    }
}

/// One rigid voxel outweighs all others, and any label none: as [`Rigidity`] is ordered.
fn verdict(column: &[(VoxelIndex, Rigidity)]) -> Option<(CellIndex, Rigidity)> {
    let (voxel, _) = column.first()?;
    let rigidity = column.iter().map(|(_, rigidity)| *rigidity).max()?;
    Some((voxel.column(), rigidity))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use Rigidity::{Rigid, Traversable, Unlabelled};

    fn obstacle(x: i32, z: i32, intra: Option<f32>, inter: Option<f32>) -> ObstacleVoxel {
        let voxel = VoxelIndex { x, y: 0, z };
        ObstacleVoxel {
            voxel,
            intra,
            inter,
        }
    }

    fn columns(obstacles: &[ObstacleVoxel]) -> Vec<(i32, Rigidity)> {
        let map = RigidityMap::of(obstacles, &RigidityConfig::default());
        let columns = map
            .columns
            .iter()
            .map(|(cell, rigidity)| (cell.x, *rigidity));
        columns.collect()
    }

    const WIDE: Option<f32> = Some(0.3);
    const NARROW: Option<f32> = Some(0.01);
    const STILL: Option<f32> = Some(0.1);
    const MOVING: Option<f32> = Some(0.9);

    #[test]
    fn only_what_is_wide_and_still_is_rigid() {
        // Far enough apart not to vote on one another.
        let verdicts = columns(&[
            obstacle(40, 0, WIDE, MOVING),
            obstacle(0, 0, WIDE, STILL),
            obstacle(20, 0, NARROW, STILL),
            obstacle(30, 0, NARROW, MOVING),
            obstacle(10, 0, None, None),
            obstacle(50, 0, WIDE, None),
            obstacle(60, 0, None, MOVING),
        ]);
        assert_eq!(
            verdicts,
            [
                (0, Rigid),
                (10, Unlabelled),
                (20, Traversable),
                (30, Traversable),
                (40, Traversable),
                (50, Rigid),
                (60, Traversable),
            ]
        );
    }

    #[test]
    fn one_rigid_voxel_makes_a_column_rigid_and_uncounted_ones_do_not_matter() {
        let column = [
            obstacle(0, 0, NARROW, STILL),
            obstacle(0, 5, WIDE, STILL),
            obstacle(0, 10, None, None),
            obstacle(9, 0, NARROW, STILL),
            obstacle(9, 5, None, None),
        ];
        assert_eq!(columns(&column), [(0, Rigid), (9, Traversable)]);
    }

    #[test]
    fn each_metric_is_smoothed_on_its_own_before_both_are_asked() {
        // Of both together, one of three voxels is rigid and would lose a vote; of each metric, two are.
        let voxels = [
            obstacle(0, 0, WIDE, STILL),
            obstacle(0, 1, WIDE, MOVING),
            obstacle(0, 2, NARROW, STILL),
        ];
        assert_eq!(columns(&voxels), [(0, Rigid)]);
        let map = RigidityMap::of(&voxels, &RigidityConfig::default());
        assert!(map.voxels.iter().all(|(_, rigidity)| *rigidity == Rigid));
    }

    proptest! {
        #[test]
        fn the_order_of_the_voxels_does_not_matter(
            metrics in prop::collection::btree_map(
                (-4..4i32, 0..6i32),
                (prop::option::of(0.0..0.1_f32), prop::option::of(0.0..1.0_f32)),
                0..40,
            ),
        ) {
            let mut obstacles: Vec<_> = metrics
                .iter()
                .map(|(&(x, z), &(intra, inter))| obstacle(x, z, intra, inter))
                .collect();
            let config = RigidityConfig::default();
            let expected = RigidityMap::of(&obstacles, &config);
            obstacles.reverse();
            prop_assert_eq!(RigidityMap::of(&obstacles, &config), expected);
        }
    }
}
