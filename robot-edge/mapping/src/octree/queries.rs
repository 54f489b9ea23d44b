//! Queries of the octree.

use nalgebra::Vector3;

use crate::grid::VoxelIndex;
use crate::octree::block::{Block, BrickStates};
use crate::octree::log_odds_table::{EVEN, UNKNOWN};
use crate::octree::surface::SurfaceVoxel;
use crate::octree::voxel_address::{
    BLOCK_BRICKS, BLOCK_EDGE, BRICK_EDGE, BRICK_VOXELS, BlockIndex, split,
};
use crate::octree::{BrickColumn, Octree};

/// The voxel of a brick above its middle along all axes.
const BRICK_MIDDLE: u32 = 2 | 2 << 2 | 2 << 4;

/// State of a voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum VoxelState {
    /// Not observed.
    Unknown,
    /// L ≤ 0.
    Free,
    /// L > 0.
    Occupied,
}

/// States of a block of 16³ voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KnownBlock {
    /// Its voxel of least x, y and z.
    pub least: VoxelIndex,
    /// Its bricks of 4³ voxels, x first, then y, then z.
    pub bricks: [BrickStates; BLOCK_BRICKS],
}

/// Numbers of known voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VoxelCounts {
    /// L > 0.
    pub occupied: u64,
    /// L ≤ 0.
    pub free: u64,
}

/// States of sixteen columns in a layer of bricks: a bit for each column in each of four layers, x
/// first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ColumnStates {
    /// z of the lowest layer, voxels.
    pub z: i32,
    /// Lowest layer first.
    pub known: [u16; 4],
    /// Lowest layer first.
    pub occupied: [u16; 4],
}

impl Octree {
    /// State of a voxel.
    pub fn state(&self, voxel: VoxelIndex) -> VoxelState {
        state(self.value(voxel))
    }

    /// Probability that a voxel is occupied; `None` if unknown.
    pub fn probability(&self, voxel: VoxelIndex) -> Option<f64> {
        let value = self.value(voxel);
        let log_odds = self.steps.log_odds(value);
        (value != UNKNOWN).then(|| 1.0 / (1.0 + libm::exp(-log_odds)))
    }

    /// State of the cube of 2ˡᵉᵛᵉˡ voxels per edge that contains a voxel: occupied if any voxel is,
    /// as in `OctoMap`, else free if any is known. At most level 16, the size of a whole `OctoMap`.
    pub fn state_at_level(&self, voxel: VoxelIndex, level: u32) -> VoxelState {
        let level = level.min(16);
        let edge = 1_i32 << level;
        let first = |coordinate: i32| coordinate & !(edge - 1);
        let first = VoxelIndex {
            x: first(voxel.x),
            y: first(voxel.y),
            z: first(voxel.z),
        };
        if edge < BLOCK_EDGE {
            return self.greatest(self.block(split(first).0), first, edge);
        }
        let blocks = edge / BLOCK_EDGE;
        let corner = split(first).0;
        let is_inside = |at: BlockIndex| {
            let within = |at: i32, corner: i32| (0..blocks).contains(&(at - corner));
            within(at.x, corner.x) && within(at.y, corner.y) && within(at.z, corner.z)
        };
        let inside = self.blocks().filter(|block| is_inside(block.index));
        inside
            .map(|block| self.greatest(Some(block), block.index.first_voxel(), BLOCK_EDGE))
            .max()
            .unwrap_or(VoxelState::Unknown)
    }

    /// Surface of a voxel, if it was ever hit.
    pub fn surface(&self, voxel: VoxelIndex) -> Option<&SurfaceVoxel> {
        let (index, address) = split(voxel);
        self.block(index)?.surface(address)
    }

    /// States of the columns in a brick column, from the brick layer that contains `from` to the
    /// one that contains `to`, both z of voxels. Unknown layers may be omitted.
    pub fn columns(
        &self,
        column: BrickColumn,
        from: i32,
        to: i32,
    ) -> impl Iterator<Item = ColumnStates> + '_ {
        let number = (column.y.rem_euclid(4) * 4 + column.x.rem_euclid(4)) as usize;
        let index = move |z| BlockIndex {
            x: column.x >> 2,
            y: column.y >> 2,
            z,
        };
        let blocks = (from >> 4..=to >> 4).filter_map(move |z| self.block(index(z)));
        blocks.flat_map(move |block| {
            (0..4).filter_map(move |layer| {
                let z = block.index.z * BLOCK_EDGE + layer * BRICK_EDGE;
                if z + 3 < from || z > to {
                    return None;
                }
                let states = block.states(number + 16 * layer as usize, self.values());
                let layers = |bits: u64| std::array::from_fn(|layer| (bits >> (16 * layer)) as u16);
                (states.known != 0).then(|| ColumnStates {
                    z,
                    known: layers(states.known),
                    occupied: layers(states.occupied),
                })
            })
        })
    }

    /// Counts all known voxels.
    pub fn counts(&self) -> VoxelCounts {
        let mut counts = VoxelCounts::default();
        for block in self.whole_blocks() {
            for number in 0..BLOCK_BRICKS {
                let states = block.states(number, self.values());
                let occupied = u64::from(states.occupied.count_ones());
                counts.occupied += occupied;
                counts.free += u64::from(states.known.count_ones()) - occupied;
            }
        }
        counts
    }

    /// Blocks with a known voxel, in the `order` of their least voxels.
    pub fn known_blocks<K: Ord>(
        &self,
        order: impl Fn(VoxelIndex) -> K,
    ) -> impl Iterator<Item = KnownBlock> {
        let mut indices: Vec<_> = self.indices().collect();
        indices.sort_by_cached_key(|index| order(index.first_voxel()));
        let known = indices.into_iter().filter_map(|index| {
            let block = self.shards[index.shard()].whole_block(index)?;
            Some(KnownBlock {
                least: index.first_voxel(),
                bricks: std::array::from_fn(|number| block.states(number, self.values())),
            })
        });
        known.filter(|block| block.bricks.iter().any(|brick| brick.known != 0))
    }

    /// Every occupied voxel with its surface, in a deterministic but arbitrary order. Of a coarse brick it is the one in the
    /// middle.
    pub fn occupied(&self) -> impl Iterator<Item = (VoxelIndex, Option<SurfaceVoxel>)> + '_ {
        self.whole_blocks().flat_map(move |block| {
            let mut voxels = Vec::new();
            for number in 0..BLOCK_BRICKS {
                let occupied = block.states(number, self.values()).occupied;
                let is_coarse = occupied == u64::MAX && !block.has_surfaces(number);
                let occupied = if is_coarse {
                    1 << BRICK_MIDDLE
                } else {
                    occupied
                };
                for voxel in (0..BRICK_VOXELS).filter(|voxel| occupied >> voxel & 1 == 1) {
                    let address = number * BRICK_VOXELS + voxel;
                    voxels.push((block.index.voxel(address), block.surface(address).copied()));
                }
            }
            voxels
        })
    }

    fn greatest(&self, block: Option<&Block>, first: VoxelIndex, edge: i32) -> VoxelState {
        let Some(block) = block else {
            return VoxelState::Unknown;
        };
        let part = |n: i32| Vector3::new(n % edge, n / edge % edge, n / (edge * edge));
        let values = (0..edge * edge * edge).map(|n| {
            let at = part(n);
            let voxel = VoxelIndex {
                x: first.x + at.x,
                y: first.y + at.y,
                z: first.z + at.z,
            };
            block.value(split(voxel).1, self.values())
        });
        state(values.max().unwrap_or(UNKNOWN))
    }

    fn block(&self, index: BlockIndex) -> Option<&Block> {
        self.shards[index.shard()].block(index)
    }

    fn value(&self, voxel: VoxelIndex) -> u8 {
        let (index, address) = split(voxel);
        self.block(index)
            .map_or(UNKNOWN, |block| block.value(address, self.values()))
    }
}

const fn state(value: u8) -> VoxelState {
    match value {
        UNKNOWN => VoxelState::Unknown,
        1..=EVEN => VoxelState::Free,
        _ => VoxelState::Occupied,
    }
}
