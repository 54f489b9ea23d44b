//! Euclidean clusters of voxels, and stable cluster numbers (docs/methods.md, section 6).
//!
//! The source (\[HYB\] §7.2) uses PCL with a k-d tree. Here voxels are sorted into buckets whose
//! diagonal is within the tolerance, so that all voxels of a bucket are one cluster, and two
//! buckets are linked by the first pair within the tolerance. The clusters are the same, without
//! rounding: all distances are integers.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use crate::grid::{CellIndex, VoxelIndex};

/// Limit of the tolerance, so that squares of distances fit.
const MAX_TOLERANCE_VOXELS: f64 = 1_048_576.0;

/// Cluster of every voxel, numbered from 0 in the order of each cluster's least voxel.
///
/// `voxels` are strictly ascending with centres `cell_m` apart. Two voxels at most `tolerance_m`
/// apart, or linked through others, belong together.
pub fn euclidean_clusters(voxels: &[VoxelIndex], cell_m: f64, tolerance_m: f64) -> Vec<u32> {
    debug_assert!(voxels.is_sorted_by(|a, b| a < b));
    let grid = BucketGrid::new(voxels, Reach::new(cell_m, tolerance_m));
    let mut sets = DisjointSets::new(grid.buckets.len());
    grid.link_neighbours(&mut sets);

    let mut bucket_of_voxel = vec![0; voxels.len()];
    for (number, bucket) in (0..).zip(&grid.buckets) {
        for entry in grid.entries_of(bucket) {
            bucket_of_voxel[entry.at as usize] = number;
        }
    }
    let mut cluster_of_root = vec![u32::MAX; grid.buckets.len()];
    let mut clusters = 0;
    let cluster_of = bucket_of_voxel.into_iter().map(|bucket| {
        let cluster = &mut cluster_of_root[sets.root(bucket) as usize];
        if *cluster == u32::MAX {
            *cluster = clusters;
            clusters += 1;
        }
        *cluster
    });
    cluster_of.collect()
}

/// Tolerance in voxels.
#[derive(Clone, Copy, Debug)]
struct Reach {
    squared: i64,
    /// Edge of a bucket: the greatest whose diagonal is within the tolerance.
    bucket: i32,
    /// Buckets farther apart along an axis hold no voxels within the tolerance.
    buckets: i64,
}

impl Reach {
    fn new(cell_m: f64, tolerance_m: f64) -> Self {
        let voxels = (tolerance_m / cell_m).clamp(0.0, MAX_TOLERANCE_VOXELS);
        // Rounding must not exclude voxels exactly at a tolerance of a whole number of voxels.
        let squared = (voxels * voxels * (1.0 + 1e-9)) as i64;
        let edge_less_one = (squared / 3).isqrt();
        // Voxels of buckets n apart are at least n·edge − (edge − 1) apart.
        let buckets = (squared.isqrt() + edge_less_one) / (edge_less_one + 1);
        Self {
            squared,
            bucket: edge_less_one as i32 + 1,
            buckets,
        }
    }
}

#[derive(Debug)]
struct BucketGrid {
    reach: Reach,
    entries: Vec<Entry>,
    buckets: Vec<Bucket>,
}

type BucketIndex = (i32, i32, i32);

#[derive(Clone, Copy, Debug)]
struct Entry {
    bucket: BucketIndex,
    voxel: VoxelIndex,
    /// Index in the caller's list.
    at: u32,
}

/// The entries `first .. end`, all of one bucket.
#[derive(Clone, Copy, Debug)]
struct Bucket {
    index: BucketIndex,
    first: usize,
    end: usize,
    /// Bounding box of its voxels.
    least: VoxelIndex,
    greatest: VoxelIndex,
}

impl BucketGrid {
    fn new(voxels: &[VoxelIndex], reach: Reach) -> Self {
        let edge = reach.bucket;
        let entries = (0..).zip(voxels).map(|(at, &voxel)| {
            let VoxelIndex { x, y, z } = voxel;
            let bucket = (x.div_euclid(edge), y.div_euclid(edge), z.div_euclid(edge));
            Entry { bucket, voxel, at }
        });
        let mut entries: Vec<_> = entries.collect();
        // Stable, and fast because the voxels are ascending.
        entries.sort_by_key(|entry| entry.bucket);
        let mut first = 0;
        let buckets = entries.chunk_by(|a, b| a.bucket == b.bucket).map(|chunk| {
            let bucket = Bucket::around(chunk, first);
            first = bucket.end;
            bucket
        });
        let buckets = buckets.collect();
        Self {
            reach,
            entries,
            buckets,
        }
    }

    fn entries_of(&self, bucket: &Bucket) -> &[Entry] {
        &self.entries[bucket.first..bucket.end]
    }

    /// Unites the sets of all buckets with voxels within the tolerance of each other.
    fn link_neighbours(&self, sets: &mut DisjointSets) {
        for beside in self.columns_beside() {
            // First bucket not before the neighbours in that column; it only advances.
            let mut first = 0;
            for (number, bucket) in (0..).zip(&self.buckets) {
                let (x, y, z) = bucket.index;
                let column = (i64::from(x) + beside.x, i64::from(y) + beside.y);
                let least = (column, i64::from(z) + beside.least_z);
                let greatest = (column, i64::from(z) + self.reach.buckets);
                while self
                    .buckets
                    .get(first)
                    .is_some_and(|other| other.key() < least)
                {
                    first += 1;
                }
                for (other_number, other) in (first..).zip(&self.buckets[first..]) {
                    if other.key() > greatest {
                        break;
                    }
                    let other_number = other_number as u32;
                    let are_apart = sets.root(number) != sets.root(other_number);
                    if are_apart && self.are_linked(bucket, other) {
                        sets.unite(number, other_number);
                    }
                }
            }
        }
    }

    /// Columns of buckets within reach; each pair of buckets is visited once.
    fn columns_beside(&self) -> impl Iterator<Item = ColumnBeside> + use<> {
        let reach = self.reach.buckets;
        let all = (0..=reach).flat_map(move |x| (-reach..=reach).map(move |y| (x, y)));
        all.filter(|beside| *beside >= (0, 0)).map(move |(x, y)| {
            let least_z = if (x, y) == (0, 0) { 1 } else { -reach };
            ColumnBeside { x, y, least_z }
        })
    }

    /// Whether any two voxels of them are within the tolerance.
    fn are_linked(&self, one: &Bucket, other: &Bucket) -> bool {
        let within = |squared: i64| squared <= self.reach.squared;
        within(squared_gap(
            one.least,
            one.greatest,
            other.least,
            other.greatest,
        )) && self.entries_of(one).iter().any(|a| {
            within(squared_gap(a.voxel, a.voxel, other.least, other.greatest))
                && self
                    .entries_of(other)
                    .iter()
                    .any(|b| within(squared_gap(a.voxel, a.voxel, b.voxel, b.voxel)))
        })
    }
}

/// A neighbouring column of buckets, as an offset; buckets below `least_z` are skipped.
#[derive(Clone, Copy, Debug)]
struct ColumnBeside {
    x: i64,
    y: i64,
    least_z: i64,
}

impl Bucket {
    /// The bucket of `entries`, whose first entry has index `first`.
    fn around(entries: &[Entry], first: usize) -> Self {
        let corner = |least: fn(i32, i32) -> i32| {
            let voxels = entries.iter().map(|entry| entry.voxel);
            voxels.reduce(|a, b| VoxelIndex {
                x: least(a.x, b.x),
                y: least(a.y, b.y),
                z: least(a.z, b.z),
            })
        };
        // A chunk is never empty.
        let nowhere = VoxelIndex { x: 0, y: 0, z: 0 };
        Self {
            index: entries.first().map_or((0, 0, 0), |entry| entry.bucket),
            first,
            end: first + entries.len(),
            least: corner(i32::min).unwrap_or(nowhere),
            greatest: corner(i32::max).unwrap_or(nowhere),
        }
    }

    fn key(&self) -> ((i64, i64), i64) {
        let (x, y, z) = self.index;
        ((x.into(), y.into()), z.into())
    }
}

/// Squared distance between two boxes, between voxel centres.
fn squared_gap(least: VoxelIndex, greatest: VoxelIndex, l: VoxelIndex, g: VoxelIndex) -> i64 {
    let along = |least: i32, greatest: i32, other_least: i32, other_greatest: i32| {
        let before = i64::from(other_least) - i64::from(greatest);
        let after = i64::from(least) - i64::from(other_greatest);
        before.max(after).max(0)
    };
    let x = along(least.x, greatest.x, l.x, g.x);
    let y = along(least.y, greatest.y, l.y, g.y);
    let z = along(least.z, greatest.z, l.z, g.z);
    x * x + y * y + z * z
}

/// Disjoint sets (union-find).
#[derive(Debug)]
struct DisjointSets {
    parents: Vec<u32>,
}

impl DisjointSets {
    fn new(things: usize) -> Self {
        Self {
            parents: (0..things as u32).collect(),
        }
    }

    fn root(&mut self, mut thing: u32) -> u32 {
        loop {
            let parent = self.parents[thing as usize];
            if parent == thing {
                return thing;
            }
            // Path halving.
            let grandparent = self.parents[parent as usize];
            self.parents[thing as usize] = grandparent;
            thing = grandparent;
        }
    }

    fn unite(&mut self, one: u32, other: u32) {
        let (one, other) = (self.root(one), self.root(other));
        self.parents[one.max(other) as usize] = one.min(other);
    }
}

/// Gives each cluster the number of the previous cluster that it overlaps most, or a new one. A
/// number is never reused.
#[derive(Clone, Debug)]
pub struct ClusterTracker {
    next: u32,
    /// Columns and cluster numbers of the last update, ascending.
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
    /// Number, from 1, of each cluster, given by its columns.
    ///
    /// Pairs of a previous and a new cluster are matched by descending number of shared columns,
    /// each cluster at most once. So a merged cluster keeps the number of its larger part, and the
    /// larger part of a split cluster keeps the number. Ties: the lower previous number first, then
    /// the order of `clusters`, which must be deterministic.
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

    /// Shared columns, previous number and new cluster of all overlapping pairs, in the order of
    /// matching.
    fn overlaps(&self, current: &[(CellIndex, u32)]) -> Vec<(Reverse<u32>, u32, u32)> {
        let mut shared: BTreeMap<(u32, u32), u32> = BTreeMap::new();
        let mut previous = self.previous.as_slice();
        for &(column, new) in current {
            // Clusters may lie above each other, so a column may occur several times.
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
mod tests;

#[cfg(test)]
mod cluster_tracker_tests {
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
        // A part that separates again is a new cluster.
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
    fn clusters_above_each_other_keep_their_numbers() {
        let mut numbers = ClusterTracker::default();
        assert_eq!(numbers.assign(&[row(0, 0, 10), row(0, 5, 9)]), [1, 2]);
        assert_eq!(numbers.assign(&[row(0, 5, 9), row(0, 0, 10)]), [2, 1]);
    }
}
