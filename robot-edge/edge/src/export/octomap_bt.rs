//! `OctoMap`'s binary trees, `.bt`: which cubes of space are occupied and which are free.
//!
//! A text header is followed by the tree, depth first. Each inner node is 16 bits, little-endian, two for each
//! of its eight children from the lowest up: 0 unknown, 1 a free leaf, 2 an occupied leaf, 3 an inner node.
//! Bit 0 of a child's number is x, bit 1 y, bit 2 z. The root is an inner node of 2¹⁶ voxels along an edge,
//! the origin in its middle. (octomap 1.9.7, `OccupancyOcTreeBase::writeBinaryNode`.)

mod curve;
#[cfg(test)]
mod reader;
mod writer;

pub use curve::place;
#[cfg(test)]
pub use reader::{BtError, BtReader};
pub use writer::{BtSizes, BtWriteError, BtWriter};

use mapping::grid::VoxelIndex;

/// Levels below the root.
const LEVELS: u8 = 16;
/// Voxels lie from `-ORIGIN` to `ORIGIN - 1` along each axis.
const ORIGIN: i32 = 32_768;
/// What a file begins with.
const FIRST_LINE: &str = "# Octomap OcTree binary file";

/// A cube of space that is all occupied or all free: a leaf of the tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cube {
    /// Its voxel of least x, y and z, each a multiple of its edge.
    pub least: VoxelIndex,
    /// Its edge is two to the power of this, voxels: 0 to 15.
    pub edge_log2: u8,
    /// Occupied, or else free.
    pub is_occupied: bool,
}

/// What an inner node says of a child.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Child {
    Unknown,
    Free,
    Occupied,
    Inner,
}

impl Child {
    const fn leaf(is_occupied: bool) -> Self {
        if is_occupied {
            Self::Occupied
        } else {
            Self::Free
        }
    }

    const fn bits(self) -> u16 {
        match self {
            Self::Unknown => 0,
            Self::Free => 1,
            Self::Occupied => 2,
            Self::Inner => 3,
        }
    }

    /// Child `number` of the node `node`.
    const fn of(node: u16, number: u8) -> Self {
        match (node >> (2 * number)) & 3 {
            0 => Self::Unknown,
            1 => Self::Free,
            2 => Self::Occupied,
            _ => Self::Inner,
        }
    }
}

#[cfg(test)]
mod tests;
