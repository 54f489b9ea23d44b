//! Euclidean clustering of voxels: those whose centres are no farther apart than a tolerance belong together,
//! and so does whatever is linked through them.
//!
//! \[HYB\] §7.2 takes PCL's, which asks a k-d tree for the neighbours of each point. Here voxels are sorted
//! into buckets so small that all voxels of one are within the tolerance: they are one cluster without a
//! question, and two buckets are linked by the first pair within the tolerance that is found. The clusters are
//! the same, in whole numbers and so without rounding.

use super::voxel::VoxelIndex;

/// Tolerances beyond this many voxels are cut to it, so that squares of distances fit.
const MAX_TOLERANCE_VOXELS: f64 = 1_048_576.0;

/// The cluster of every voxel, numbered from 0 in the order of each cluster's least voxel.
///
/// `voxels` are strictly ascending; their centres are `cell_m` apart, and those at most `tolerance_m` apart
/// belong together.
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

/// The tolerance in voxels.
#[derive(Clone, Copy, Debug)]
struct Reach {
    /// Its square.
    squared: i64,
    /// Edge of a bucket: the greatest whose corners are within the tolerance.
    bucket: i32,
    /// Buckets farther apart than this along an axis hold no voxels within the tolerance.
    buckets: i64,
}

impl Reach {
    fn new(cell_m: f64, tolerance_m: f64) -> Self {
        let voxels = (tolerance_m / cell_m).clamp(0.0, MAX_TOLERANCE_VOXELS);
        // A tolerance of a whole number of voxels must not lose by rounding those just that far apart.
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

/// Voxels in order of their buckets.
#[derive(Debug)]
struct BucketGrid {
    reach: Reach,
    entries: Vec<Entry>,
    buckets: Vec<Bucket>,
}

/// Where a bucket lies, in buckets.
type BucketIndex = (i32, i32, i32);

#[derive(Clone, Copy, Debug)]
struct Entry {
    bucket: BucketIndex,
    voxel: VoxelIndex,
    /// Its place in the caller's list.
    at: u32,
}

/// The entries `first .. end`, all of one bucket.
#[derive(Clone, Copy, Debug)]
struct Bucket {
    index: BucketIndex,
    first: usize,
    end: usize,
    /// The least box around its voxels.
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
        // Stable: the voxels come in order, so whole runs of them already are.
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

    /// Unites the sets of all buckets that hold voxels within the tolerance of one another.
    fn link_neighbours(&self, sets: &mut DisjointSets) {
        for beside in self.columns_beside() {
            // The first bucket that is not before the neighbours in that column: it only moves on.
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

    /// The columns of buckets within reach, each pair of buckets seen from one of them alone.
    fn columns_beside(&self) -> impl Iterator<Item = ColumnBeside> + use<> {
        let reach = self.reach.buckets;
        let all = (0..=reach).flat_map(move |x| (-reach..=reach).map(move |y| (x, y)));
        all.filter(|beside| *beside >= (0, 0)).map(move |(x, y)| {
            let least_z = if (x, y) == (0, 0) { 1 } else { -reach };
            ColumnBeside { x, y, least_z }
        })
    }

    /// Whether any voxel of one is within the tolerance of any of the other.
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

/// A column of buckets beside another, in buckets; within it only those from `least_z` up are looked at.
#[derive(Clone, Copy, Debug)]
struct ColumnBeside {
    x: i64,
    y: i64,
    least_z: i64,
}

impl Bucket {
    /// The bucket of `entries`, the first of which is the `first` of all.
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

/// The square of the distance between two boxes of voxels, between centres, voxels.
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

/// Which things have been united, as a forest.
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

    /// The same for all of a set.
    fn root(&mut self, mut thing: u32) -> u32 {
        loop {
            let parent = self.parents[thing as usize];
            if parent == thing {
                return thing;
            }
            // Path halving, so that the next way up is shorter.
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

#[cfg(test)]
mod tests;
