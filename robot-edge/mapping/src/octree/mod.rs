//! The occupancy octree: probabilities of voxels, from all range sensors (\[HYB\] §4.3.1).
//!
//! What it means is what it means in `OctoMap`: log-odds, clamping, one update per voxel and scan, a hit wins,
//! equal siblings are pruned, any coarser level can be asked for, no bounds. How it is stored is not: a hash of
//! blocks of 16³ voxels, each of bricks of 4³, one byte a voxel or less. Of the sixteen levels of an octree a
//! query needs two steps; a brick is at most one cache line, and is updated by a few vector instructions.

mod block;
mod brick;
mod log_odds_table;
mod packed_brick;
mod queries;
mod ray_marks;
mod ray_walk;
mod scratch_pages;
mod shard;
mod surface;
mod voxel_address;

use nalgebra::Point3;

pub use self::brick::BrickStates;
pub use self::queries::{ColumnStates, KnownBlock, VoxelCounts, VoxelState};
pub(super) use self::surface::FINER;
pub use self::surface::{SurfaceHit, SurfaceVoxel};

use self::block::Block;
use self::log_odds_table::{LogOddsTable, Update, Values};
use self::ray_marks::RayMarks;
use self::shard::{SHARDS, Shard};
use self::voxel_address::split;
use super::octree_config::{OctreeConfig, RangeSensorModel};
use super::registered_scan::SensorId;
use super::voxel::VoxelIndex;

/// One beam: from where to where, metres in `odom`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// The sensor.
    pub origin: Point3<f64>,
    /// The hit, or how far there is none.
    pub end: Point3<f64>,
    /// Whether `end` was hit.
    pub is_hit: bool,
}

/// A beam, in voxels.
#[derive(Clone, Copy, Debug)]
struct VoxelRay {
    from: [f64; 3],
    to: [f64; 3],
    is_hit: bool,
}

/// Probabilities of voxels.
#[derive(Clone, Debug)]
pub struct Octree {
    cell_m: f64,
    limit_bytes: usize,
    steps: LogOddsTable,
    updates: Vec<Update>,
    shards: [Shard; SHARDS],
    /// Of the scan that is added.
    rays: Vec<VoxelRay>,
    /// One for each thread that marks.
    marks: Vec<RayMarks>,
}

/// A column of bricks: columns (x, y) of voxels from `4·x … 4·x + 3` by `4·y … 4·y + 3`.
///
/// Ordered by y, then x.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BrickColumn {
    /// Towards x of `odom`.
    pub x: i32,
    /// Towards y of `odom`.
    pub y: i32,
}

/// Longest beam, voxels: 300 m at 1 cm.
const MAX_BEAM: f64 = 30_000.0;
/// Greatest coordinate of the ends of a beam, voxels: blocks and voxels are numbered in 32 bits.
const MAX_COORDINATE: f64 = (1 << 29) as f64;

impl Octree {
    /// An empty map. The settings are taken as valid; sensors are numbered in the order given. It is the same
    /// map, bit for bit, whatever the number of `threads`.
    pub fn new(config: &OctreeConfig, sensors: &[RangeSensorModel], threads: usize) -> Self {
        let steps = LogOddsTable::new(config, sensors);
        Self {
            cell_m: config.cell_m,
            limit_bytes: config.memory_limit_mb as usize * 1_000_000,
            steps,
            updates: sensors.iter().map(|sensor| steps.update(sensor)).collect(),
            shards: Default::default(),
            rays: Vec::new(),
            marks: vec![RayMarks::new(); threads.clamp(1, 2)],
        }
    }

    /// Side of a voxel, metres.
    pub const fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// Adds the beams of one scan of a sensor; says how many had no place in the map.
    pub fn integrate(&mut self, sensor: SensorId, rays: impl IntoIterator<Item = Ray>) -> u32 {
        let unplaced = self.take_rays(rays);
        let update = self.updates.get(usize::from(sensor.0));
        let (Some(&update), Some((least, greatest))) = (update, self.bounds()) else {
            return unplaced;
        };
        if !self
            .marks
            .iter_mut()
            .all(|marks| marks.begin(least, greatest))
        {
            return unplaced + self.rays.len() as u32;
        }
        self.mark();
        self.apply(update);
        unplaced
    }

    /// Adds what a hit says of the surface in its voxel; `weight` is that of the newest value of a metric.
    ///
    /// Nothing where the scan of the hit has not been integrated.
    pub fn add_surface(&mut self, hit: &SurfaceHit, weight: f32) {
        let voxel = VoxelIndex::containing(hit.point, self.cell_m);
        let (index, address) = split(voxel);
        self.shards[index.shard()].with_surface(index, address, |surface| {
            surface.add(hit, voxel, self.cell_m, weight);
        });
    }

    /// The columns of bricks in which the state or the surface of a voxel has changed since the last call, in order.
    pub fn take_changed(&mut self) -> Vec<BrickColumn> {
        let mut columns = Vec::new();
        for shard in &mut self.shards {
            shard.take_changed(&mut columns);
        }
        columns.sort_unstable();
        columns.dedup();
        columns
    }

    /// Where the blocks take more than the memory limit, removes those farthest from `center` until 31/32 of it
    /// are left, so that not every call has to; says how many bricks were stored there.
    pub fn enforce_memory_limit(&mut self, center: Point3<f64>) -> usize {
        if self.block_bytes() <= self.limit_bytes {
            return 0;
        }
        let limit = self.limit_bytes - self.limit_bytes / 32;
        let center = split(VoxelIndex::containing(center, self.cell_m)).0;
        let order = |block: &Block| (block.index.distance_squared(center), block.index);
        let mut blocks: Vec<_> = self
            .blocks()
            .map(|block| (order(block), block.bytes()))
            .collect();
        blocks.sort_unstable();
        let mut bytes = 0;
        let first_evicted = blocks.into_iter().find_map(|(order, of_block)| {
            bytes += of_block;
            (bytes > limit).then_some(order)
        });
        let is_kept = |block: &Block| first_evicted.is_none_or(|first| order(block) < first);
        let shards = self.shards.iter_mut();
        shards.map(|shard| shard.retain(is_kept)).sum()
    }

    /// Forgets everything.
    pub fn erase(&mut self) {
        for shard in &mut self.shards {
            shard.retain(|_| false);
        }
    }

    /// Memory of the voxels, bytes; without [`Octree::scratch_bytes`].
    pub fn bytes(&self) -> usize {
        let index_bytes = self.shards.iter().map(Shard::index_bytes);
        self.block_bytes() + index_bytes.sum::<usize>()
    }

    /// Memory that a scan needs while it is added, bytes.
    pub fn scratch_bytes(&self) -> usize {
        self.marks.iter().map(RayMarks::bytes).sum()
    }

    /// Turns beams into voxels; says how many have no place in the map.
    fn take_rays(&mut self, rays: impl IntoIterator<Item = Ray>) -> u32 {
        let per_m = 1.0 / self.cell_m;
        let voxels = |point: &Point3<f64>| [point.x * per_m, point.y * per_m, point.z * per_m];
        let fits = |&[from, to]: &[f64; 2]| {
            from.abs() < MAX_COORDINATE && (from - to).abs() <= MAX_BEAM // false for NaN
        };
        let mut unplaced = 0;
        self.rays.clear();
        for ray in rays {
            let (from, to) = (voxels(&ray.origin), voxels(&ray.end));
            if (0..3).all(|axis| fits(&[from[axis], to[axis]])) {
                self.rays.push(VoxelRay {
                    from,
                    to,
                    is_hit: ray.is_hit,
                });
            } else {
                unplaced += 1;
            }
        }
        unplaced
    }

    /// Least and greatest corner of the beams, voxels; `None` without beams.
    fn bounds(&self) -> Option<([f64; 3], [f64; 3])> {
        let first = self.rays.first()?.from;
        let (mut least, mut greatest) = (first, first);
        for ray in &self.rays {
            for axis in 0..3 {
                let (from, to) = (ray.from[axis], ray.to[axis]);
                least[axis] = least[axis].min(from).min(to);
                greatest[axis] = greatest[axis].max(from).max(to);
            }
        }
        Some((least, greatest))
    }

    /// Marks what the beams say, in one part or in two at once.
    fn mark(&mut self) {
        let rays = &self.rays[..];
        match &mut self.marks[..] {
            [marks] => mark_rays(marks, rays),
            [marks, other, ..] => {
                let (own, others) = rays.split_at(rays.len() / 2);
                rayon::join(|| mark_rays(marks, own), || mark_rays(other, others));
            }
            [] => {}
        }
    }

    /// Applies what was marked, one shard after the other or both at once.
    fn apply(&mut self, update: Update) {
        let values = self.steps.values;
        let [first, second] = &mut self.shards;
        match &mut self.marks[..] {
            [marks] => {
                let [of_first, of_second] = marks.shards();
                first.apply(&mut [of_first], update, values);
                second.apply(&mut [of_second], update, values);
            }
            [marks, others, ..] => {
                let ([of_first, of_second], [others_of_first, others_of_second]) =
                    (marks.shards(), others.shards());
                rayon::join(
                    || first.apply(&mut [of_first, others_of_first], update, values),
                    || second.apply(&mut [of_second, others_of_second], update, values),
                );
            }
            [] => {}
        }
        for marks in &mut self.marks {
            marks.close();
        }
    }

    fn blocks(&self) -> impl Iterator<Item = &Block> {
        self.shards.iter().flat_map(Shard::blocks)
    }

    fn block_bytes(&self) -> usize {
        self.shards.iter().map(Shard::block_bytes).sum()
    }

    const fn values(&self) -> Values {
        self.steps.values
    }
}

fn mark_rays(marks: &mut RayMarks, rays: &[VoxelRay]) {
    for ray in rays {
        // All of them are inside of the window, which was made for them.
        if let (Some(from), Some(to)) = (marks.fixed(ray.from), marks.fixed(ray.to)) {
            marks.mark_free(from, to);
            if ray.is_hit {
                marks.mark_hit(to);
            }
        }
    }
}

impl PartialOrd for BrickColumn {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for BrickColumn {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.y, self.x).cmp(&(other.y, other.x))
    }
}

#[cfg(test)]
mod tests;
