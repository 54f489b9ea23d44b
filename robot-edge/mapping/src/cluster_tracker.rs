//! Numbers by which an operator knows clusters again from update to update.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use super::grid::CellIndex;

/// Gives each cluster the number of the one before that it overlaps most, or a new one. No number is given
/// twice, also after its cluster has gone.
#[derive(Clone, Debug)]
pub struct ClusterTracker {
    next: u32,
    /// Columns of the last update's clusters and their numbers, ascending.
    previous: Vec<(CellIndex, u32)>,
}

impl Default for ClusterTracker {
    fn default() -> Self {
        Self {
            next: 1,
            previous: Vec::new(),
        }
    }
}

impl ClusterTracker {
    /// The number, from 1, of each of these clusters, given by its columns.
    ///
    /// Pairs of an old and a new cluster are matched by falling number of shared columns, each at most once:
    /// so what has merged keeps the number of the part that was larger, and of what has split the larger part
    /// keeps it. Of pairs that share as many, the lower old number goes first, then the cluster that comes
    /// first in `clusters`, where they are to be in an order that does not depend on chance.
    pub fn assign(&mut self, clusters: &[Vec<CellIndex>]) -> Vec<u32> {
        let current = sorted_columns((0..).zip(clusters));
        let mut numbers = vec![None; clusters.len()];
        let mut taken = BTreeSet::new();
        for (_, old, new) in self.overlaps(&current) {
            let number = &mut numbers[new as usize];
            if number.is_none() && taken.insert(old) {
                *number = Some(old);
            }
        }
        let numbers = numbers.into_iter().map(|number| {
            number.unwrap_or_else(|| {
                let new = self.next;
                self.next = self.next.saturating_add(1);
                new
            })
        });
        let numbers: Vec<_> = numbers.collect();
        self.previous = sorted_columns(numbers.iter().copied().zip(clusters));
        numbers
    }

    /// Shared columns, old number and new cluster of all pairs that share any, in the order of matching.
    fn overlaps(&self, current: &[(CellIndex, u32)]) -> Vec<(Reverse<u32>, u32, u32)> {
        let mut shared: BTreeMap<(u32, u32), u32> = BTreeMap::new();
        let mut previous = self.previous.as_slice();
        for &(column, new) in current {
            // A column may belong to several clusters, one above the other, before and now.
            let before = previous.partition_point(|(other, _)| *other < column);
            previous = &previous[before..];
            for &(_, old) in previous.iter().take_while(|(other, _)| *other == column) {
                *shared.entry((old, new)).or_default() += 1;
            }
        }
        let overlaps = shared.into_iter();
        let overlaps = overlaps.map(|((old, new), columns)| (Reverse(columns), old, new));
        let mut overlaps: Vec<_> = overlaps.collect();
        overlaps.sort_unstable();
        overlaps
    }
}

fn sorted_columns<'a>(
    clusters: impl Iterator<Item = (u32, &'a Vec<CellIndex>)>,
) -> Vec<(CellIndex, u32)> {
    let columns = clusters.flat_map(|(number, columns)| columns.iter().map(move |c| (*c, number)));
    let mut columns: Vec<_> = columns.collect();
    columns.sort_unstable();
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The columns `from .. to` of row `y`.
    fn row(y: i32, from: i32, to: i32) -> Vec<CellIndex> {
        (from..to).map(|x| CellIndex { x, y }).collect()
    }

    #[test]
    fn a_cluster_keeps_its_number_while_it_grows_and_drifts() {
        let mut numbers = ClusterTracker::default();
        assert_eq!(numbers.assign(&[row(0, 0, 10), row(9, 0, 4)]), [1, 2]);
        assert_eq!(numbers.assign(&[row(9, 1, 6), row(0, 9, 20)]), [2, 1]);
        assert_eq!(numbers.assign(&[row(0, 19, 21), row(5, 0, 4)]), [1, 3]);
    }

    #[test]
    fn merged_clusters_keep_the_number_of_the_larger() {
        let mut numbers = ClusterTracker::default();
        assert_eq!(numbers.assign(&[row(0, 0, 4), row(0, 6, 20)]), [1, 2]);
        assert_eq!(numbers.assign(&[row(0, 0, 20)]), [2]);
        // And a part that comes off again is a new one.
        assert_eq!(numbers.assign(&[row(0, 0, 4), row(0, 6, 20)]), [3, 2]);
    }

    #[test]
    fn the_larger_part_of_a_split_keeps_the_number() {
        let mut numbers = ClusterTracker::default();
        assert_eq!(numbers.assign(&[row(0, 0, 20)]), [1]);
        assert_eq!(numbers.assign(&[row(0, 0, 8), row(0, 10, 20)]), [2, 1]);
        let mut equal = ClusterTracker::default();
        assert_eq!(equal.assign(&[row(0, 0, 20)]), [1]);
        assert_eq!(equal.assign(&[row(0, 0, 8), row(0, 12, 20)]), [1, 2]);
    }

    #[test]
    fn a_number_is_never_given_again() {
        let mut numbers = ClusterTracker::default();
        assert_eq!(numbers.assign(&[row(0, 0, 4)]), [1]);
        assert_eq!(numbers.assign(&[]), [0; 0]);
        assert_eq!(numbers.assign(&[row(0, 0, 4)]), [2]);
    }

    #[test]
    fn clusters_above_one_another_are_told_apart() {
        let mut numbers = ClusterTracker::default();
        assert_eq!(numbers.assign(&[row(0, 0, 10), row(0, 5, 9)]), [1, 2]);
        assert_eq!(numbers.assign(&[row(0, 5, 9), row(0, 0, 10)]), [2, 1]);
    }
}
