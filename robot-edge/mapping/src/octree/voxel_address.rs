//! Addresses of voxels: blocks of 16³ voxels, each of 64 bricks of 4³.

use crate::grid::VoxelIndex;
use crate::octree::SHARDS;

pub(super) const BRICK_EDGE: i32 = 4;
/// Voxels of a brick: one cache line of bytes.
pub(super) const BRICK_VOXELS: usize = 64;
pub(super) const BLOCK_EDGE: i32 = 16;
pub(super) const BLOCK_BRICKS: usize = 64;
/// Bits of a voxel's address in its block.
pub(super) const LOCAL_BITS: u32 = 12;

/// A block: block (x, y, z) holds voxels `16·x … 16·x + 15` and so on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) struct BlockIndex {
    pub(super) x: i32,
    pub(super) y: i32,
    pub(super) z: i32,
}

/// Contribution of a coordinate to a voxel's address: brick by brick, x first in both.
pub(super) const fn local(coordinate: u32, axis: u32) -> u32 {
    ((coordinate >> 2 & 3) << (6 + 2 * axis)) | ((coordinate & 3) << (2 * axis))
}

pub(super) fn split(voxel: VoxelIndex) -> (BlockIndex, usize) {
    let part = |coordinate: i32| (coordinate & (BLOCK_EDGE - 1)) as u32;
    let address = local(part(voxel.x), 0) | local(part(voxel.y), 1) | local(part(voxel.z), 2);
    let block = BlockIndex {
        x: voxel.x >> 4,
        y: voxel.y >> 4,
        z: voxel.z >> 4,
    };
    (block, address as usize)
}

impl BlockIndex {
    /// Its voxel with the least coordinates.
    pub(super) const fn first_voxel(self) -> VoxelIndex {
        VoxelIndex {
            x: self.x * BLOCK_EDGE,
            y: self.y * BLOCK_EDGE,
            z: self.z * BLOCK_EDGE,
        }
    }

    /// Adjacent blocks are in different shards, so that each shard has half of any scan.
    pub(super) const fn shard(self) -> usize {
        (self.x ^ self.y ^ self.z) as usize % SHARDS
    }

    /// In blocks.
    pub(super) fn distance_squared(self, other: Self) -> i64 {
        let part = |a: i32, b: i32| {
            let difference = i64::from(a) - i64::from(b);
            difference * difference
        };
        part(self.x, other.x) + part(self.y, other.y) + part(self.z, other.z)
    }

    pub(super) fn voxel(self, address: usize) -> VoxelIndex {
        let first = self.first_voxel();
        let address = address as u32;
        let part = |axis: u32| {
            let coordinate = (address >> (6 + 2 * axis) & 3) << 2 | (address >> (2 * axis) & 3);
            coordinate.cast_signed()
        };
        VoxelIndex {
            x: first.x + part(0),
            y: first.y + part(1),
            z: first.z + part(2),
        }
    }
}

/// A cube of voxels around a scan. A voxel's *code* is its address in its block, and above that the
/// number of the block in the window. The bits of the three coordinates are separate, so that one
/// can be stepped alone.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    first: BlockIndex,
    /// Bits of a block's coordinate.
    block_bits: u32,
}

impl Window {
    /// From block `first`, with at least `side` voxels along an edge.
    pub(super) const fn new(first: BlockIndex, side: u32) -> Self {
        let blocks = side.div_ceil(BLOCK_EDGE as u32).next_power_of_two();
        Self {
            first,
            block_bits: blocks.trailing_zeros(),
        }
    }

    pub(super) const fn side(&self) -> u32 {
        (BLOCK_EDGE as u32) << self.block_bits
    }

    pub(super) const fn block_bits(&self) -> u32 {
        self.block_bits
    }

    /// Contribution of a voxel's coordinate to its code.
    pub(super) const fn code(&self, axis: usize, coordinate: u32) -> u64 {
        let block = (coordinate >> 4) as u64;
        block << self.block_shift(axis) | local(coordinate & 15, axis as u32) as u64
    }

    pub(super) const fn mask(&self, axis: usize) -> u64 {
        self.code(axis, self.side() - 1)
    }

    /// Lowest bit of an axis in a code.
    pub(super) const fn unit(axis: usize) -> u64 {
        1 << (2 * axis)
    }

    pub(super) fn block(&self, number: u64) -> BlockIndex {
        let coordinate = |axis: usize| {
            let shifted = number >> (self.block_shift(axis) - LOCAL_BITS);
            (shifted & ((1 << self.block_bits) - 1)) as i32
        };
        BlockIndex {
            x: self.first.x + coordinate(0),
            y: self.first.y + coordinate(1),
            z: self.first.z + coordinate(2),
        }
    }

    /// Its least corner, voxels of `odom`.
    pub(super) fn corner(&self) -> [f64; 3] {
        let BlockIndex { x, y, z } = self.first;
        [x, y, z].map(|block| f64::from(block) * f64::from(BLOCK_EDGE))
    }

    const fn block_shift(&self, axis: usize) -> u32 {
        LOCAL_BITS + axis as u32 * self.block_bits
    }
}
