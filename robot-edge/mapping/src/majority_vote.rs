//! A majority vote among neighbouring voxels, which smooths labels (\[HYB\] §7.1: 5×5×5).
//!
//! The voxels are few and scattered, so nothing is laid out as a box: sorted, they are runs along z, one per
//! column, and the votes of a neighbouring column are differences of running sums. Pointers that only move on
//! find columns and ends of windows, without a hash or a search.

use super::obstacle_voxel::Rigidity;
use super::voxel::VoxelIndex;

/// How far a vote reaches to each side, voxels.
const REACH: i32 = 2;

/// The labels after every labelled voxel has taken that of the majority of the labelled voxels around it, up
/// to two away along each axis, itself included. Ties keep the label; unlabelled voxels neither vote nor get
/// a label. All vote at once, by the labels as they were.
///
/// `voxels` are strictly ascending and `labels` theirs, as are those returned.
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

/// All votes, ready to be summed along columns.
struct VoteField {
    columns: Vec<Column>,
    /// Height of every voxel.
    heights: Vec<i32>,
    /// Votes for rigid less votes against, of all voxels before this one; one more than there are voxels.
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

    /// Votes for rigid less votes against around every voxel.
    fn balances(&self) -> Vec<i32> {
        let mut balances = vec![0; self.heights.len()];
        // For each x beside, the first column that is not before the neighbourhood.
        let mut firsts = [0; 2 * REACH as usize + 1];
        for column in &self.columns {
            for (x_beside, first) in (-REACH..).zip(&mut firsts) {
                // In i64, lest a neighbourhood at the edge of what an index holds wraps.
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

    /// Adds the votes of the column `beside` to the balances of the voxels of `column`.
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
mod tests {
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
