//! Occupancy octree of all range sensors (docs/methods.md, section 3; \[HYB\] §4.3.1).
//!
//! It has the semantics of `OctoMap`: log-odds, clamping, one update per voxel and scan, a hit
//! wins, uniform parts are pruned, queries at any coarser level, no bounds; hence its name. The storage differs: a
//! hash map of *blocks* of 16³ voxels, each of *bricks* of 4³, one byte or less per voxel. A query
//! takes two steps instead of sixteen; a brick is at most one cache line and is updated by a few
//! vector instructions. Two *shards* are updated in parallel.

mod block;
mod disk_blocks;
mod log_odds_table;
mod queries;
mod ray_marks;
mod scratch_pages;
mod surface;
mod voxel_address;

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::ops::RangeInclusive;
use std::sync::Arc;

use nalgebra::Point3;
use rustc_hash::FxBuildHasher;
use serde::Deserialize;

use crate::grid::VoxelIndex;
use crate::octree::block::Block;
use crate::octree::disk_blocks::DiskBlocks;
use crate::octree::log_odds_table::{LogOddsTable, Update, Values};
use crate::octree::ray_marks::RayMarks;
use crate::octree::scratch_pages::ShardMarks;
use crate::octree::voxel_address::{BLOCK_EDGE, BlockIndex, split};
use crate::registered_scan::SensorId;
pub use block::BrickStates;
pub use disk_blocks::BlockFile;
pub use queries::{ColumnStates, KnownBlock, VoxelCounts, VoxelState};
pub(super) use surface::FINER;
pub use surface::{SurfaceHit, SurfaceVoxel};

/// One beam, metres in `odom`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Position of the sensor.
    pub origin: Point3<f64>,
    /// The hit, or the end of a miss.
    pub end: Point3<f64>,
    /// Whether `end` was hit.
    pub is_hit: bool,
}

#[derive(Clone, Copy, Debug)]
struct VoxelRay {
    from: [f64; 3],
    to: [f64; 3],
    is_hit: bool,
}

/// Occupancy octree.
#[derive(Clone, Debug)]
pub struct Octree {
    cell_m: f64,
    limit_bytes: usize,
    /// Blocks no farther from the vehicle stay fine.
    fine_blocks: f64,
    /// Block that the vehicle was in when blocks came from disk the last time.
    fine_around: Option<BlockIndex>,
    disk_bytes: u64,
    steps: LogOddsTable,
    updates: Vec<Update>,
    shards: [Shard; SHARDS],
    /// Rays of the current scan.
    rays: Vec<VoxelRay>,
    /// Where the beams of the current cloud end.
    ends: HashSet<(u64, u64), FxBuildHasher>,
    /// One for each thread.
    marks: Vec<RayMarks>,
}

/// What the memory limit did, bricks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LimitedBricks {
    /// Went to disk: they come back when a beam or the vehicle comes near.
    pub on_disk: usize,
    /// Became one voxel each.
    pub coarse: usize,
    /// Became unknown.
    pub removed: usize,
    /// Blocks that the disk did not take or give.
    pub disk_failures: usize,
}

/// A column of bricks: columns (x, y) of voxels from `4·x … 4·x + 3` by `4·y … 4·y + 3`.
///
/// Ordered by y, then x.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BrickColumn {
    /// Along x of `odom`.
    pub x: i32,
    /// Along y of `odom`.
    pub y: i32,
}

/// Longest beam, voxels: 300 m at 1 cm.
const MAX_BEAM: f64 = 30_000.0;
/// Greatest coordinate of a beam's ends, voxels: block and voxel indices have 32 bits.
const MAX_COORDINATE: f64 = (1 << 29) as f64;

impl Octree {
    /// An empty map; the settings must be valid. `sensors` are in the order of [`SensorId`]. The
    /// map does not depend on `threads`.
    pub fn new(config: &OctreeConfig, sensors: &[RangeSensorModel], threads: usize) -> Self {
        let steps = LogOddsTable::new(config, sensors);
        Self {
            cell_m: config.cell_m,
            limit_bytes: config.memory_limit_mb as usize * 1_000_000,
            fine_blocks: config.fine_m / (config.cell_m * f64::from(BLOCK_EDGE)),
            fine_around: None,
            steps,
            updates: sensors.iter().map(|sensor| steps.update(sensor)).collect(),
            disk_bytes: u64::from(config.disk_limit_mb) * 1_000_000,
            shards: Default::default(),
            rays: Vec::new(),
            ends: HashSet::default(),
            marks: vec![RayMarks::new(); threads.clamp(1, 2)],
        }
    }

    /// Keeps in `file` what memory has no room for.
    pub fn keep_on_disk(&mut self, file: &Arc<dyn BlockFile>) {
        let of_shard = self.disk_bytes / SHARDS as u64;
        for (shard, number) in self.shards.iter_mut().zip(0..) {
            let first_bytes = number * of_shard;
            shard.disk = DiskBlocks::new(Arc::clone(file), first_bytes, first_bytes + of_shard);
        }
    }

    /// Leaves what memory holds, coarse where the rest is on disk: for a copy that is read whole, as its size is bounded then.
    pub fn forget_disk(&mut self) {
        for shard in &mut self.shards {
            shard.disk = DiskBlocks::default();
        }
    }

    /// Side of a voxel, metres.
    pub const fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// Adds the beams of one scan; returns the number of beams outside of the range of the map.
    pub fn integrate(&mut self, sensor: SensorId, rays: impl IntoIterator<Item = Ray>) -> u32 {
        let unplaced = self.take_rays(rays, |_| true);
        self.add_rays(sensor, unplaced)
    }

    /// Adds a cloud, as [`Octree::integrate`]. Of the beams that end in the same voxel the first alone shows what is free: those
    /// of a dense cloud cross nearly the same voxels.
    pub fn integrate_cloud(
        &mut self,
        sensor: SensorId,
        rays: impl IntoIterator<Item = Ray>,
    ) -> u32 {
        let mut ends = std::mem::take(&mut self.ends);
        ends.clear();
        let mut last = None;
        let unplaced = self.take_rays(rays, |ray| {
            // Of positive numbers, so that they are rounded down.
            let [x, y, z] = ray.to.map(|voxels| (voxels + 4.0 * MAX_COORDINATE) as u64);
            // Two words are hashed faster than their parts.
            let end = (x << 32 | y, z << 1 | u64::from(ray.is_hit));
            // Most follow one that ends there, too.
            last.replace(end) != Some(end) && ends.insert(end)
        });
        self.ends = ends;
        self.add_rays(sensor, unplaced)
    }

    fn add_rays(&mut self, sensor: SensorId, unplaced: u32) -> u32 {
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

    /// Adds the positions and metrics of hits to their voxels; `weights` are those of the newest
    /// `intra` and `inter` in the moving averages.
    ///
    /// It has no effect before the scan of the hits was integrated.
    pub fn add_surfaces(&mut self, hits: impl IntoIterator<Item = SurfaceHit>, weights: [f32; 2]) {
        let mut hits = hits.into_iter().peekable();
        while let Some(hit) = hits.next() {
            let voxel = VoxelIndex::containing(hit.point, self.cell_m);
            let (index, address) = split(voxel);
            self.shards[index.shard()].with_surface(index, address, |surface| {
                surface.add(&hit, voxel, self.cell_m, weights);
                // Most hits follow one in the same voxel.
                let is_here =
                    |hit: &SurfaceHit| VoxelIndex::containing(hit.point, self.cell_m) == voxel;
                while let Some(hit) = hits.next_if(is_here) {
                    surface.add(&hit, voxel, self.cell_m, weights);
                }
            });
        }
    }

    /// Brick columns in which the state or surface of a voxel has changed since the last call, in
    /// order.
    pub fn take_changed(&mut self) -> Vec<BrickColumn> {
        self.take_changed_in(i32::MIN..=i32::MAX)
    }

    /// As [`Octree::take_changed`], without changes in blocks of which no voxel has such a z.
    pub fn take_changed_in(&mut self, z: RangeInclusive<i32>) -> Vec<BrickColumn> {
        let blocks = z.start() >> 4..=z.end() >> 4;
        let mut columns = Vec::new();
        for shard in &mut self.shards {
            shard.take_changed(&blocks, &mut columns);
        }
        columns.sort_unstable();
        columns.dedup();
        columns
    }

    /// If the blocks exceed the memory limit, makes those farthest from `center` coarse, and where they all are, removes the
    /// farthest, until 31/32 of the limit remain (so that not every call does it). They go to disk ([`Octree::keep_on_disk`]), as far as that has
    /// room, and come back when a beam meets them or `center` comes near. Returns how many bricks.
    pub fn enforce_memory_limit(&mut self, center: Point3<f64>) -> LimitedBricks {
        let center = split(VoxelIndex::containing(center, self.cell_m)).0;
        self.fetch_near(center);
        let mut bytes = self.block_bytes();
        if bytes <= self.limit_bytes {
            return self.with_failures(LimitedBricks::default());
        }
        let limit = self.limit_bytes - self.limit_bytes / 32;
        let order = |block: &Block| (block.index.distance_squared(center), block.index);
        let mut farthest: Vec<_> = self
            .blocks()
            .map(|block| (order(block), block.bytes()))
            .collect();
        farthest.sort_unstable_by(|a, b| b.cmp(a));
        let fine_squared = self.fine_blocks * self.fine_blocks;
        let (mut coarse_from, mut removed_from) = (None, None);
        for (order, of_block) in &mut farthest {
            if bytes <= limit || order.0 as f64 <= fine_squared {
                break;
            }
            bytes -= *of_block - size_of::<Block>();
            *of_block = size_of::<Block>();
            coarse_from = Some(*order);
        }
        for (order, of_block) in farthest {
            if bytes <= limit {
                break;
            }
            bytes -= of_block;
            removed_from = Some(order);
        }
        let is_beyond =
            |from: Option<_>, block: &Block| from.is_some_and(|from| order(block) >= from);
        let values = self.values();
        let mut limited = LimitedBricks::default();
        for shard in &mut self.shards {
            shard.evict(|block| is_beyond(removed_from, block), &mut limited);
            let is_far = |block: &Block| is_beyond(coarse_from, block);
            shard.coarsen(is_far, values, &mut limited);
        }
        self.with_failures(limited)
    }

    fn with_failures(&mut self, limited: LimitedBricks) -> LimitedBricks {
        let shards = self.shards.iter_mut();
        LimitedBricks {
            disk_failures: shards.map(|shard| shard.disk.take_failures()).sum(),
            ..limited
        }
    }

    /// Brings blocks near the vehicle back from disk, at most half of what memory holds.
    fn fetch_near(&mut self, center: BlockIndex) {
        if self.fine_around.replace(center) == Some(center) {
            return;
        }
        let fine_squared = self.fine_blocks * self.fine_blocks;
        let is_near = |index: &BlockIndex| index.distance_squared(center) as f64 <= fine_squared;
        for shard in &mut self.shards {
            let mut near: Vec<_> = shard.disk.indices().filter(is_near).collect();
            near.sort_unstable_by_key(|index| (index.distance_squared(center), *index));
            let limit = shard.block_bytes + self.limit_bytes / 2 / SHARDS;
            for index in near {
                if shard.block_bytes > limit {
                    break;
                }
                shard.place(index);
            }
        }
    }

    /// Makes the blocks farther than this from `center` coarse, for good.
    pub fn coarsen_beyond(&mut self, center: Point3<f64>, distance_m: f64) {
        let center = split(VoxelIndex::containing(center, self.cell_m)).0;
        let blocks = distance_m / (self.cell_m * f64::from(BLOCK_EDGE));
        let values = self.values();
        let is_far = |index: BlockIndex| index.distance_squared(center) as f64 > blocks * blocks;
        for shard in &mut self.shards {
            shard.disk.retain(|index| !is_far(index));
            for block in shard.blocks.iter_mut().filter(|block| is_far(block.index)) {
                shard.block_bytes -= block.bytes() - size_of::<Block>();
                if block.coarsen(values) {
                    shard.changed.push(block.index);
                }
            }
        }
    }

    /// Erases everything.
    pub fn erase(&mut self) {
        for shard in &mut self.shards {
            shard
                .gone
                .extend(shard.places.drain().map(|(index, _)| index));
            shard.blocks = Vec::new();
            shard.block_bytes = 0;
            shard.disk.retain(|_| false);
        }
    }

    /// Memory of the map, bytes, without [`Octree::scratch_bytes`].
    pub fn bytes(&self) -> usize {
        let index_bytes = self.shards.iter().map(Shard::index_bytes);
        self.block_bytes() + index_bytes.sum::<usize>()
    }

    /// Memory for adding a scan, bytes.
    pub fn scratch_bytes(&self) -> usize {
        self.marks.iter().map(RayMarks::bytes).sum()
    }

    /// Converts the beams that `is_needed` to voxels; returns the number of beams outside of the range of the map.
    fn take_rays(
        &mut self,
        rays: impl IntoIterator<Item = Ray>,
        mut is_needed: impl FnMut(&VoxelRay) -> bool,
    ) -> u32 {
        let per_m = 1.0 / self.cell_m;
        let voxels = |point: &Point3<f64>| [point.x * per_m, point.y * per_m, point.z * per_m];
        let fits = |&[from, to]: &[f64; 2]| {
            from.abs() < MAX_COORDINATE && (from - to).abs() <= MAX_BEAM // false for NaN
        };
        let mut unplaced = 0;
        self.rays.clear();
        for ray in rays {
            let (from, to) = (voxels(&ray.origin), voxels(&ray.end));
            if !(0..3).all(|axis| fits(&[from[axis], to[axis]])) {
                unplaced += 1;
                continue;
            }
            let is_hit = ray.is_hit;
            let ray = VoxelRay { from, to, is_hit };
            if is_needed(&ray) {
                self.rays.push(ray);
            }
        }
        unplaced
    }

    /// Least and greatest corner of the beams, voxels.
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

    /// Marks the beams, in one thread or two.
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

    /// Applies the marks, the shards in sequence or in parallel.
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

    /// Of every block, also of those that are on disk only, in no particular order.
    fn indices(&self) -> impl Iterator<Item = BlockIndex> + '_ {
        self.shards.iter().flat_map(|shard| {
            let is_gone = |index: &BlockIndex| !shard.places.contains_key(index);
            let gone = shard.disk.indices().filter(is_gone);
            shard.places.keys().copied().chain(gone)
        })
    }

    /// As [`Octree::blocks`], those that are on disk as they were.
    fn whole_blocks(&self) -> impl Iterator<Item = Cow<'_, Block>> {
        self.indices()
            .filter_map(|index| self.shards[index.shard()].whole_block(index))
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
        // Always inside of the window, which covers all beams.
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

/// Settings of `[mapping.octree]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OctreeConfig {
    /// Enables the layer.
    pub enabled: bool,
    /// Side of a voxel, metres.
    pub cell_m: f64,
    /// Least probability of a voxel (\[HYB\] §4.3.1: 0.1).
    pub p_min: f64,
    /// Greatest probability of a voxel (\[HYB\] §4.3.1: 0.6).
    pub p_max: f64,
    /// Memory limit of the voxels, megabytes (10⁶ bytes); beyond it the farthest blocks are made coarse, then evicted.
    pub memory_limit_mb: u32,
    /// Within this distance of the vehicle they stay fine, metres.
    pub fine_m: f64,
    /// Of the file that keeps the others as they were, megabytes; 0: they lose what is finer.
    pub disk_limit_mb: u32,
}

/// Parameters of a range sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeSensorModel {
    /// Probability that a voxel with a hit is occupied.
    pub p_hit: f64,
    /// Probability that a voxel crossed by a beam is occupied.
    pub p_miss: f64,
    /// Neighbours that the radial filter requires; 0 accepts every hit.
    pub min_neighbours: u8,
    /// Full angle of a beam's cone, radians; 0 for an ideal line.
    pub divergence_rad: f64,
    /// Whether its beams have `IntraScan` and `InterScan` metrics: lasers, not sonars.
    pub has_metrics: bool,
}

impl Default for OctreeConfig {
    fn default() -> Self {
        Self {
            enabled: false,
            cell_m: 0.1,
            p_min: 0.1,
            p_max: 0.6,
            memory_limit_mb: 256,
            fine_m: 40.0,
            disk_limit_mb: 2000,
        }
    }
}

impl Default for RangeSensorModel {
    /// The laser of \[HYB\]'s introbot.
    fn default() -> Self {
        Self {
            p_hit: 0.95,
            p_miss: 0.49,
            min_neighbours: 2,
            divergence_rad: 0.0,
            has_metrics: true,
        }
    }
}

const SHARDS: usize = 2;

/// Half of the blocks of the map.
#[derive(Clone, Debug, Default)]
struct Shard {
    blocks: Vec<Block>,
    places: HashMap<BlockIndex, u32, FxBuildHasher>,
    block_bytes: usize,
    disk: DiskBlocks,
    /// Indices of the blocks that the current scan marks.
    marked: Vec<u32>,
    /// Blocks with untaken changes, or that were removed.
    changed: Vec<BlockIndex>,
    gone: Vec<BlockIndex>,
}

impl Shard {
    fn block(&self, index: BlockIndex) -> Option<&Block> {
        let place = self.places.get(&index);
        place.map(|&place| &self.blocks[place as usize])
    }

    /// As it was before the memory limit made it coarse.
    fn whole_block(&self, index: BlockIndex) -> Option<Cow<'_, Block>> {
        let on_disk = self.disk.read(index).map(Cow::Owned);
        on_disk.or_else(|| self.block(index).map(Cow::Borrowed))
    }

    /// In no particular order.
    fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// Applies the marks of a scan, made by one thread or two, and clears them.
    fn apply(&mut self, marks: &mut [ShardMarks<'_>], update: Update, values: Values) {
        if let [own, others @ ..] = marks {
            for other in others {
                own.take_common(other);
            }
        }
        for part in marks {
            self.find_blocks(part);
            for (mut marked, &place) in part.marked().zip(&self.marked) {
                let block = &mut self.blocks[place as usize];
                let before = block.bytes();
                if block.apply(&mut marked, update, values) {
                    self.changed.push(marked.block);
                }
                self.block_bytes = self.block_bytes + block.bytes() - before;
            }
        }
    }

    /// Calls `add` with the surface voxel at an address of a block, if the block exists.
    fn with_surface(
        &mut self,
        index: BlockIndex,
        address: usize,
        add: impl FnOnce(&mut SurfaceVoxel),
    ) {
        let Some(&place) = self.places.get(&index) else {
            return;
        };
        let block = &mut self.blocks[place as usize];
        let before = block.bytes();
        let (surface, is_first) = block.surface_mut(address);
        add(surface);
        self.block_bytes = self.block_bytes + block.bytes() - before;
        if is_first {
            self.changed.push(index);
        }
    }

    /// Takes the brick columns with changes, in no particular order: of the blocks of these z.
    fn take_changed(&mut self, z: &RangeInclusive<i32>, columns: &mut Vec<BrickColumn>) {
        let mut add = |block: BlockIndex, changed: u16| {
            let changed = if z.contains(&block.z) { changed } else { 0 };
            let bricks = (0..16).filter(|brick| changed >> brick & 1 == 1);
            columns.extend(bricks.map(|brick| BrickColumn {
                x: block.x * 4 + brick % 4,
                y: block.y * 4 + brick / 4,
            }));
        };
        for index in std::mem::take(&mut self.changed) {
            if let Some(&place) = self.places.get(&index) {
                add(index, self.blocks[place as usize].take_changed());
            }
        }
        for index in std::mem::take(&mut self.gone) {
            add(index, u16::MAX);
        }
    }

    /// Removes the blocks that `is_far` accepts.
    fn evict(&mut self, is_far: impl Fn(&Block) -> bool, limited: &mut LimitedBricks) {
        let (evicted, kept): (Vec<_>, Vec<_>) = std::mem::take(&mut self.blocks)
            .into_iter()
            .partition(is_far);
        self.block_bytes = kept.iter().map(Block::bytes).sum();
        self.places = (0..)
            .zip(&kept)
            .map(|(place, block)| (block.index, place))
            .collect();
        self.blocks = kept;
        for block in evicted {
            self.gone.push(block.index);
            if !self.disk.contains(block.index) {
                let stored = self.disk.store(&block);
                *(if stored {
                    &mut limited.on_disk
                } else {
                    &mut limited.removed
                }) += block.stored();
            }
        }
    }

    /// Makes the blocks that `is_far` accepts coarse.
    fn coarsen(
        &mut self,
        is_far: impl Fn(&Block) -> bool,
        values: Values,
        limited: &mut LimitedBricks,
    ) {
        let is_far = |block: &&mut Block| block.is_fine() && is_far(block);
        for block in self.blocks.iter_mut().filter(is_far) {
            let stored = self.disk.store(block);
            *(if stored {
                &mut limited.on_disk
            } else {
                &mut limited.coarse
            }) += block.stored();
            self.block_bytes -= block.bytes() - size_of::<Block>();
            if block.coarsen(values) {
                self.changed.push(block.index);
            }
        }
    }

    const fn block_bytes(&self) -> usize {
        self.block_bytes
    }

    fn index_bytes(&self) -> usize {
        self.places.capacity() * (size_of::<(BlockIndex, u32)>() + 1) + self.disk.bytes()
    }

    /// Finds or creates the block of each page of marks.
    fn find_blocks(&mut self, marks: &ShardMarks<'_>) {
        self.marked.clear();
        let mut fetched = 0;
        for index in marks.blocks() {
            let place = self.place(index);
            fetched ^= self.blocks[place as usize].fetch_header();
            self.marked.push(place);
        }
        // Otherwise the read would be optimised away.
        std::hint::black_box(fetched);
    }

    /// Finds or creates a block, and brings it from disk.
    fn place(&mut self, index: BlockIndex) -> u32 {
        let place = *self.places.entry(index).or_insert_with(|| {
            self.blocks.push(Block::new(index));
            self.block_bytes += size_of::<Block>();
            (self.blocks.len() - 1) as u32
        });
        if !self.disk.is_empty()
            && let Some(whole) = self.disk.take(index)
        {
            let block = &mut self.blocks[place as usize];
            self.block_bytes = self.block_bytes + whole.bytes() - block.bytes();
            if block.replace(whole) {
                self.changed.push(index);
            }
        }
        place
    }
}

#[cfg(test)]
mod tests;
