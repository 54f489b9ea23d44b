//! Vegetation on land: traversable or rigid (docs/methods.md, section 6; \[HYB\] §7.1).
//!
//! A voxel is rigid if what its hits lie on is smooth and wider than the laser spot, or, by the rule
//! of the source, if both metrics, each smoothed on its own, say so. A column with a rigid voxel is
//! rigid; by the rule of widths also one among rigid ones.
//!
//! The majority vote works on sorted voxels, which are runs along z, one per column. The votes of a
//! neighbouring column are differences of running sums, found with pointers that only advance.

use serde::Deserialize;

use crate::grid::{CellIndex, VoxelIndex};
use crate::scan_metrics::{IntraScan, MetricsConfig};

/// Settings of `[mapping.rigidity]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RigidityConfig {
    /// Requires the cost map.
    pub enabled: bool,
    /// What makes a voxel rigid.
    pub rule: RigidityRule,
    /// Of [`RigidityRule::Width`]: least width of what is rigid, metres.
    pub least_width_m: f64,
    /// Of [`RigidityRule::Metrics`], as the next: rigid above this `IntraScan` (\[HYB\] §7.1: 0.04).
    pub intra_threshold: f64,
    /// Rigid below this `InterScan` (\[HYB\] §7.1: 0.39).
    pub inter_threshold: f64,
    /// Cost of a traversable column.
    pub traversable_vegetation_cost: f64,
}

impl RigidityConfig {
    /// Averaged `IntraScan` above which a voxel is rigid.
    pub const fn rigid_above(&self) -> f64 {
        match self.rule {
            RigidityRule::Width => IntraScan::LEAST_WIDTH,
            RigidityRule::Metrics => self.intra_threshold,
        }
    }

    /// `IntraScan` as the rule needs it.
    pub(super) fn intra_scan(&self, metrics: &MetricsConfig) -> IntraScan {
        match self.rule {
            RigidityRule::Width if self.enabled => {
                IntraScan::less_spot(metrics, self.least_width_m)
            }
            RigidityRule::Width | RigidityRule::Metrics => IntraScan::new(metrics),
        }
    }
}

impl Default for RigidityConfig {
    fn default() -> Self {
        Self {
            enabled: false,
            rule: RigidityRule::Width,
            least_width_m: 0.02,
            intra_threshold: 0.04,
            inter_threshold: 0.39,
            traversable_vegetation_cost: 0.7,
        }
    }
}

/// What makes a voxel rigid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RigidityRule {
    /// `IntraScan` less the laser spot: most hits lie on a smooth body of the least width or wider.
    Width,
    /// `IntraScan` and `InterScan`, each above or below its threshold (\[HYB\] §7.1).
    Metrics,
}

/// Rigidity of voxels and columns.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RigidityMap {
    /// Ascending.
    pub voxels: Vec<(VoxelIndex, Rigidity)>,
    /// Columns with a voxel, ascending: rigid with a rigid voxel, else traversable with a labelled
    /// one, else unlabelled (it keeps its cost).
    pub columns: Vec<(CellIndex, Rigidity)>,
}

impl RigidityMap {
    /// Classifies all voxels of the columns in question, each once, in any order.
    pub fn of(obstacles: &[ObstacleVoxel], config: &RigidityConfig) -> Self {
        let mut obstacles = obstacles.to_vec();
        obstacles.sort_unstable_by_key(|obstacle| obstacle.voxel);
        let voxels: Vec<_> = obstacles.iter().map(|obstacle| obstacle.voxel).collect();
        let smoothed = |label: &dyn Fn(&ObstacleVoxel) -> Rigidity| {
            let labels: Vec<_> = obstacles.iter().map(label).collect();
            majority_vote(&voxels, &labels)
        };
        let mut labels = smoothed(&|obstacle| obstacle.by_intra(config.rigid_above()));
        if config.rule == RigidityRule::Metrics {
            let by_inter = smoothed(&|obstacle| obstacle.by_inter(config.inter_threshold));
            for (label, by_inter) in labels.iter_mut().zip(by_inter) {
                *label = label.both(by_inter);
            }
        }
        let voxels: Vec<_> = voxels.iter().copied().zip(labels).collect();
        let columns = voxels
            .chunk_by(|(a, _), (b, _)| a.column() == b.column())
            .filter_map(verdict)
            .collect();
        let mut map = Self { voxels, columns };
        if config.rule == RigidityRule::Width {
            map.fill_rims();
        }
        map
    }

    /// Makes traversable columns rigid that have [`RIGID_AROUND`] rigid ones around them.
    fn fill_rims(&mut self) {
        let rigidity = |CellIndex { x, y }, [dx, dy]: [i32; 2]| {
            let cell = CellIndex {
                x: x.saturating_add(dx),
                y: y.saturating_add(dy),
            };
            let found = self.columns.binary_search_by_key(&cell, |(cell, _)| *cell);
            found.map_or(Rigidity::Unlabelled, |place| self.columns[place].1)
        };
        let is_rim = |cell| {
            let around = AROUND
                .into_iter()
                .filter(|&beside| rigidity(cell, beside) == Rigidity::Rigid);
            around.count() >= RIGID_AROUND
        };
        let columns = self.columns.iter().map(|&(cell, rigidity)| match rigidity {
            Rigidity::Traversable if is_rim(cell) => (cell, Rigidity::Rigid),
            _ => (cell, rigidity),
        });
        self.columns = columns.collect();
    }
}

/// Beams graze the rim of a body, and then look as narrow as on a stem: so many rigid columns of the
/// eight around decide.
const RIGID_AROUND: usize = 4;
const AROUND: [[i32; 2]; 8] = [
    [-1, -1],
    [-1, 0],
    [-1, 1],
    [0, -1],
    [0, 1],
    [1, -1],
    [1, 0],
    [1, 1],
];

/// The greatest label of a column, in the order of [`Rigidity`].
fn verdict(column: &[(VoxelIndex, Rigidity)]) -> Option<(CellIndex, Rigidity)> {
    let (voxel, _) = column.first()?;
    let rigidity = column.iter().map(|(_, rigidity)| *rigidity).max()?;
    Some((voxel.column(), rigidity))
}

/// An occupied voxel in a lethal column, above the ground and no higher than the vehicle: the
/// ground below grass is rigid, and what is higher is no obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObstacleVoxel {
    /// The voxel.
    pub voxel: VoxelIndex,
    /// Moving average of `IntraScan`.
    pub intra: Option<f32>,
    /// Moving average of `InterScan`.
    pub inter: Option<f32>,
}

/// Label of a voxel or column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Rigidity {
    /// No metric.
    #[default]
    Unlabelled,
    /// Vegetation that gives way.
    Traversable,
    /// Does not give way.
    Rigid,
}

impl ObstacleVoxel {
    /// Label by `IntraScan`: rigid above `threshold`.
    pub fn by_intra(&self, threshold: f64) -> Rigidity {
        Rigidity::of(self.intra, |width| width > threshold)
    }

    /// Label by `InterScan`: rigid below `threshold`.
    pub fn by_inter(&self, threshold: f64) -> Rigidity {
        Rigidity::of(self.inter, |change| change < threshold)
    }
}

impl Rigidity {
    fn of(metric: Option<f32>, is_rigid: impl Fn(f64) -> bool) -> Self {
        match metric {
            Some(value) if value.is_nan() => Self::Unlabelled,
            Some(value) if is_rigid(value.into()) => Self::Rigid,
            Some(_) => Self::Traversable,
            None => Self::Unlabelled,
        }
    }

    /// Rigid if both are; a missing label leaves the decision to the other (\[HYB\] §7.1).
    #[must_use]
    pub const fn both(self, other: Self) -> Self {
        match (self, other) {
            (Self::Unlabelled, label) | (label, Self::Unlabelled) => label,
            (Self::Rigid, Self::Rigid) => Self::Rigid,
            (Self::Traversable, _) | (_, Self::Traversable) => Self::Traversable,
        }
    }

    /// Rigid if either is; a missing label leaves the decision to the other (\[HYB\] §7.2).
    #[must_use]
    pub const fn either(self, other: Self) -> Self {
        match (self, other) {
            (Self::Unlabelled, label) | (label, Self::Unlabelled) => label,
            (Self::Traversable, Self::Traversable) => Self::Traversable,
            (Self::Rigid, _) | (_, Self::Rigid) => Self::Rigid,
        }
    }
}

/// Reach of a vote to each side, voxels (\[HYB\] §7.1: 5×5×5).
pub(crate) const REACH: i32 = 2;

/// Labels after a simultaneous majority vote of the labelled voxels up to two away along each axis,
/// itself included. A tie keeps the label. Unlabelled voxels neither vote nor get a label.
///
/// `voxels` are strictly ascending; `labels` and the result are in their order.
pub fn majority_vote(voxels: &[VoxelIndex], labels: &[Rigidity]) -> Vec<Rigidity> {
    debug_assert!(voxels.is_sorted_by(|a, b| a < b));
    debug_assert_eq!(voxels.len(), labels.len());
    let field = VoteField::new(voxels, labels);
    let balances = field.balances();
    let smoothed = labels.iter().zip(balances);
    smoothed
        .map(|(&label, balance)| match label {
            Rigidity::Unlabelled => Rigidity::Unlabelled,
            Rigidity::Rigid if balance < 0 => Rigidity::Traversable,
            Rigidity::Traversable if balance > 0 => Rigidity::Rigid,
            Rigidity::Rigid | Rigidity::Traversable => label,
        })
        .collect()
}

/// Votes as running sums.
struct VoteField {
    columns: Vec<Column>,
    /// z of every voxel.
    heights: Vec<i32>,
    /// Rigid minus other votes of all voxels before each one, and of all.
    balance_before: Vec<i32>,
}

/// The voxels `first .. end` of one column.
#[derive(Clone, Copy)]
struct Column {
    x: i32,
    y: i32,
    first: usize,
    end: usize,
}

impl VoteField {
    fn new(voxels: &[VoxelIndex], labels: &[Rigidity]) -> Self {
        let mut columns: Vec<Column> = Vec::new();
        for (at, voxel) in voxels.iter().enumerate() {
            match columns.last_mut() {
                Some(column) if (column.x, column.y) == (voxel.x, voxel.y) => column.end = at + 1,
                Some(_) | None => columns.push(Column {
                    x: voxel.x,
                    y: voxel.y,
                    first: at,
                    end: at + 1,
                }),
            }
        }
        let votes = labels.iter().map(|label| match label {
            Rigidity::Unlabelled => 0,
            Rigidity::Traversable => -1,
            Rigidity::Rigid => 1,
        });
        let running = votes.scan(0, |balance, vote| {
            *balance += vote;
            Some(*balance)
        });
        Self {
            columns,
            heights: voxels.iter().map(|voxel| voxel.z).collect(),
            balance_before: std::iter::once(0).chain(running).collect(),
        }
    }

    /// Rigid minus other votes around every voxel.
    fn balances(&self) -> Vec<i32> {
        let mut balances = vec![0; self.heights.len()];
        // For each x offset, the first column not before the neighbourhood.
        let mut firsts = [0; 2 * REACH as usize + 1];
        for column in &self.columns {
            for (x_beside, first) in (-REACH..).zip(&mut firsts) {
                // In i64, so that it cannot overflow.
                let x = i64::from(column.x) + i64::from(x_beside);
                let least_y = i64::from(column.y) - i64::from(REACH);
                let greatest_y = i64::from(column.y) + i64::from(REACH);
                let is_before = |other: &Column| (other.x.into(), other.y.into()) < (x, least_y);
                while self.columns.get(*first).is_some_and(is_before) {
                    *first += 1;
                }
                for beside in &self.columns[*first..] {
                    if (beside.x.into(), beside.y.into()) > (x, greatest_y) {
                        break;
                    }
                    self.add_votes(*column, *beside, &mut balances);
                }
            }
        }
        balances
    }

    /// Adds the votes of column `beside` to the voxels of `column`.
    fn add_votes(&self, column: Column, beside: Column, balances: &mut [i32]) {
        let heights = &self.heights[beside.first..beside.end];
        let before = &self.balance_before[beside.first..=beside.end];
        let (mut from, mut to) = (0, 0);
        let voxels = column.first..column.end;
        for (&z, balance) in self.heights[voxels.clone()]
            .iter()
            .zip(&mut balances[voxels])
        {
            let (least_z, greatest_z) = (z.saturating_sub(REACH), z.saturating_add(REACH));
            while from < heights.len() && heights[from] < least_z {
                from += 1;
            }
            while to < heights.len() && heights[to] <= greatest_z {
                to += 1;
            }
            *balance += before[to] - before[from];
        }
    }
}

#[cfg(test)]
mod rigidity_tests {
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

    fn by(rule: RigidityRule) -> RigidityConfig {
        RigidityConfig {
            rule,
            ..RigidityConfig::default()
        }
    }

    fn columns(obstacles: &[ObstacleVoxel]) -> Vec<(i32, Rigidity)> {
        let map = RigidityMap::of(obstacles, &by(RigidityRule::Metrics));
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
        // Too far apart for votes.
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
    fn width_alone_decides_by_its_rule() {
        let voxels = [
            obstacle(0, 0, Some(0.51), MOVING),
            obstacle(10, 0, Some(0.5), STILL),
            obstacle(20, 0, None, STILL),
        ];
        let map = RigidityMap::of(&voxels, &by(RigidityRule::Width));
        let labels = map.columns.iter().map(|(_, rigidity)| *rigidity);
        let labels: Vec<_> = labels.collect();
        assert_eq!(labels, [Rigid, Traversable, Unlabelled]);
    }

    #[test]
    fn a_narrow_column_among_wide_ones_is_their_rim() {
        // So high above each other that none votes for another.
        let voxel = |x, y, intra| ObstacleVoxel {
            voxel: VoxelIndex {
                x,
                y,
                z: 20 * (3 * x + y),
            },
            intra: Some(intra),
            inter: None,
        };
        let rigidity = |rigid: usize, rule| {
            let around = AROUND.into_iter().take(rigid);
            let around = around.map(|[x, y]| voxel(x, y, 0.9));
            let voxels: Vec<_> = around.chain([voxel(0, 0, 0.0)]).collect();
            let map = RigidityMap::of(&voxels, &by(rule));
            let middle = map
                .columns
                .iter()
                .find(|(cell, _)| *cell == CellIndex { x: 0, y: 0 });
            middle.unwrap().1
        };
        assert_eq!(rigidity(3, RigidityRule::Width), Traversable);
        assert_eq!(rigidity(4, RigidityRule::Width), Rigid);
        assert_eq!(rigidity(8, RigidityRule::Metrics), Traversable);
    }

    #[test]
    fn one_rigid_voxel_makes_a_column_rigid() {
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
        // Combined, one of three voxels is rigid and would lose a vote; of each metric, two are.
        let voxels = [
            obstacle(0, 0, WIDE, STILL),
            obstacle(0, 1, WIDE, MOVING),
            obstacle(0, 2, NARROW, STILL),
        ];
        assert_eq!(columns(&voxels), [(0, Rigid)]);
        let map = RigidityMap::of(&voxels, &by(RigidityRule::Metrics));
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
            let config = by(RigidityRule::Metrics);
            let expected = RigidityMap::of(&obstacles, &config);
            obstacles.reverse();
            prop_assert_eq!(RigidityMap::of(&obstacles, &config), expected);
        }
    }
}

#[cfg(test)]
mod obstacle_voxel_tests {
    use super::*;
    use Rigidity::{Rigid, Traversable, Unlabelled};

    #[test]
    fn labels_follow_the_thresholds() {
        let voxel = |intra, inter| ObstacleVoxel {
            voxel: VoxelIndex { x: 0, y: 0, z: 0 },
            intra,
            inter,
        };
        let labels = |voxel: ObstacleVoxel| (voxel.by_intra(0.04), voxel.by_inter(0.39));
        assert_eq!(labels(voxel(Some(0.05), Some(0.3))), (Rigid, Rigid));
        assert_eq!(
            labels(voxel(Some(0.03), Some(0.4))),
            (Traversable, Traversable)
        );
        assert_eq!(
            labels(voxel(None, Some(f32::NAN))),
            (Unlabelled, Unlabelled)
        );
    }

    #[test]
    fn land_asks_both_and_water_either() {
        let all = [Unlabelled, Traversable, Rigid];
        let both = all.map(|a| all.map(|b| a.both(b)));
        assert_eq!(both[0], all);
        assert_eq!(both[1], [Traversable, Traversable, Traversable]);
        assert_eq!(both[2], [Rigid, Traversable, Rigid]);
        let either = all.map(|a| all.map(|b| a.either(b)));
        assert_eq!(either[0], all);
        assert_eq!(either[1], [Traversable, Traversable, Rigid]);
        assert_eq!(either[2], [Rigid, Rigid, Rigid]);
    }
}

#[cfg(test)]
mod majority_vote_tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;
    use Rigidity::{Rigid, Traversable, Unlabelled};

    const fn at(x: i32, y: i32, z: i32) -> VoxelIndex {
        VoxelIndex { x, y, z }
    }

    fn voted<const N: usize>(labelled: [(VoxelIndex, Rigidity); N]) -> [Rigidity; N] {
        let voxels = labelled.map(|(voxel, _)| voxel);
        let labels = labelled.map(|(_, label)| label);
        majority_vote(&voxels, &labels).try_into().unwrap()
    }

    #[test]
    fn the_majority_of_those_in_reach_wins_and_ties_keep() {
        assert_eq!(voted([(at(0, 0, 0), Rigid)]), [Rigid]);
        let tie = [(at(0, 0, 0), Rigid), (at(0, 0, 1), Traversable)];
        assert_eq!(voted(tie), [Rigid, Traversable]);
        let outvoted = [
            (at(0, 0, 0), Traversable),
            (at(1, 1, 1), Rigid),
            (at(2, 2, 2), Traversable),
        ];
        assert_eq!(voted(outvoted), [Traversable; 3]);
        let out_of_reach = [
            (at(-3, 0, 0), Traversable),
            (at(0, 0, 0), Rigid),
            (at(0, 0, 3), Traversable),
            (at(0, 3, 0), Traversable),
        ];
        assert_eq!(voted(out_of_reach)[1], Rigid);
    }

    #[test]
    fn the_unlabelled_neither_vote_nor_are_labelled() {
        let labelled = [
            (at(0, 0, 0), Rigid),
            (at(0, 0, 1), Unlabelled),
            (at(0, 0, 2), Unlabelled),
        ];
        assert_eq!(voted(labelled), [Rigid, Unlabelled, Unlabelled]);
    }

    #[test]
    fn the_edges_of_the_index_do_not_wrap() {
        let (least, greatest) = (i32::MIN, i32::MAX);
        let corners = [
            (at(least, least, least), Rigid),
            (at(least, greatest, least), Traversable),
            (at(greatest, greatest, greatest - 1), Traversable),
            (at(greatest, greatest, greatest), Rigid),
        ];
        assert_eq!(voted(corners), corners.map(|(_, label)| label));
    }

    proptest! {
        #[test]
        fn it_is_the_vote_counted_one_by_one(
            labelled in prop::collection::btree_map(
                (-6..6i32, -6..6i32, -6..6i32),
                prop_oneof![Just(Rigid), Just(Traversable), Just(Unlabelled)],
                0..300,
            ),
        ) {
            let voxels: Vec<_> = labelled.keys().map(|&(x, y, z)| at(x, y, z)).collect();
            let labels: Vec<_> = labelled.values().copied().collect();
            let expected = labelled.iter().map(|(at, label)| counted(&labelled, *at, *label));
            prop_assert_eq!(majority_vote(&voxels, &labels), expected.collect::<Vec<_>>());
        }
    }

    type Labelled = BTreeMap<(i32, i32, i32), Rigidity>;

    fn counted(labelled: &Labelled, (x, y, z): (i32, i32, i32), label: Rigidity) -> Rigidity {
        let count = |wanted: Rigidity| {
            let beside = |a: i32, b: i32| (a - b).abs() <= 2;
            let others = labelled.iter().filter(|(other, label)| {
                beside(other.0, x) && beside(other.1, y) && beside(other.2, z) && **label == wanted
            });
            others.count()
        };
        match count(Rigid).cmp(&count(Traversable)) {
            _ if label == Unlabelled => Unlabelled,
            std::cmp::Ordering::Less => Traversable,
            std::cmp::Ordering::Equal => label,
            std::cmp::Ordering::Greater => Rigid,
        }
    }
}
