//! `OctoMap`'s binary trees, `.bt`: which cubes of space are occupied and which are free.
//!
//! A text header is followed by the tree, depth first. Each inner node is 16 bits, little-endian, two for each
//! of its eight children from the lowest up: 0 unknown, 1 a free leaf, 2 an occupied leaf, 3 an inner node.
//! Bit 0 of a child's number is x, bit 1 y, bit 2 z. The root is an inner node of 2¹⁶ voxels along an edge,
//! the origin in its middle. (octomap 1.9.7, `OccupancyOcTreeBase::writeBinaryNode`.)

use std::io::{self, Write};

use mapping::grid::VoxelIndex;
use mapping::octree::BrickStates;

/// Levels below the root.
const LEVELS: u8 = 16;
/// Voxels lie from `-ORIGIN` to `ORIGIN - 1` along each axis.
const ORIGIN: i32 = 32_768;
const FIRST_LINE: &str = "# Octomap OcTree binary file";

/// A cube of space that is all occupied or all free: a leaf of the tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cube {
    /// Its voxel of least x, y and z, each a multiple of its edge.
    pub least: VoxelIndex,
    /// Its edge is two to the power of this, voxels: 0 to 15.
    pub edge_log2: u8,
    pub is_occupied: bool,
}

/// What an inner node says of a child.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Child {
    Unknown = 0,
    Free = 1,
    Occupied = 2,
    Inner = 3,
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
        self as u16
    }

    const fn of(node: u16, number: u8) -> Self {
        match (node >> (2 * number)) & 3 {
            0 => Self::Unknown,
            1 => Self::Free,
            2 => Self::Occupied,
            _ => Self::Inner,
        }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum BtWriteError {
    #[error("the cube of edge 2^{} at voxel ({}, {}, {}) is not within ±32768 voxels of the origin, on a \
        multiple of its edge and of an edge up to 2^15", .0.edge_log2, .0.least.x, .0.least.y, .0.least.z)]
    OutOfRange(Cube),
    #[error("the cube at voxel ({}, {}, {}) begins before the end of the one before it", .0.x, .0.y, .0.z)]
    OutOfOrder(VoxelIndex),
    #[error(transparent)]
    Io(#[from] io::Error),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BtSizes {
    /// Nodes of the tree, inner ones and leaves.
    pub nodes: u64,
    /// Leaves, after pruning.
    pub leaves: u64,
}

/// A tree that grows along the curve, in which eight equal leaves are one. It needs 2 bytes per inner node.
#[derive(Clone, Debug, Default)]
pub struct BtWriter {
    /// The nodes as the file has them; of open ones the place is kept.
    bytes: Vec<u8>,
    /// From the root down to the smallest node around what came last: node n has an edge of 2¹⁶⁻ⁿ voxels.
    open: Vec<OpenNode>,
    /// Of closed nodes.
    leaves: u64,
    /// Where along the curve the next cube may begin.
    next: u64,
}

#[derive(Clone, Copy, Debug)]
struct OpenNode {
    /// Its first voxel along the curve.
    first: u64,
    /// Where in the tree's bytes it is.
    at: usize,
    /// Two bits for each of its children.
    children: u16,
}

/// Edge of a brick: four voxels.
const BRICK_LOG2: u8 = 2;
/// The node whose eight children are free leaves.
const ALL_FREE: u16 = 0x5555;
/// The same of occupied ones.
const ALL_OCCUPIED: u16 = 0xaaaa;

impl BtWriter {
    /// Adds a leaf, which must lie behind all others along the curve (see [`place`]).
    pub fn push(&mut self, cube: Cube) -> Result<(), BtWriteError> {
        let VoxelIndex { x, y, z } = cube.least;
        let is_placed = |index: i32| index.trailing_zeros() >= cube.edge_log2.into();
        let first = place(cube.least)
            .filter(|_| cube.edge_log2 < LEVELS && [x, y, z].into_iter().all(is_placed))
            .ok_or(BtWriteError::OutOfRange(cube))?;
        self.add(first, cube.edge_log2, Child::leaf(cube.is_occupied))
    }

    /// Adds 16³ voxels from `least` on, behind all others along the curve: 4³ bricks of 4³ voxels, x first, then y,
    /// then z.
    pub fn push_block(
        &mut self,
        least: VoxelIndex,
        bricks: &[BrickStates; 64],
    ) -> Result<(), BtWriteError> {
        let misplaced = BtWriteError::OutOfRange(Cube {
            least,
            edge_log2: 2 * BRICK_LOG2,
            is_occupied: false,
        });
        let first = place(least)
            .filter(|first| first.is_multiple_of(voxels(2 * BRICK_LOG2)))
            .ok_or(misplaced)?;
        for number in 0..bricks.len() {
            let first = first + number as u64 * voxels(BRICK_LOG2);
            self.add_brick(first, bricks[x_first(number)])?;
        }
        Ok(())
    }

    /// The nodes of the tree, without a header.
    pub fn finish(mut self) -> (Vec<u8>, BtSizes) {
        while !self.open.is_empty() {
            self.close();
        }
        let inner = self.bytes.len() as u64 / 2;
        let sizes = BtSizes {
            nodes: inner + self.leaves,
            leaves: self.leaves,
        };
        (self.bytes, sizes)
    }

    pub fn write(self, cell_m: f64, out: &mut impl Write) -> Result<BtSizes, BtWriteError> {
        let (bytes, sizes) = self.finish();
        write!(
            out,
            "{FIRST_LINE}\n# (feel free to add / change comments, but leave the first line as it is!)\n#\n\
            id OcTree\nsize {}\nres {cell_m}\ndata\n",
            sizes.nodes
        )?;
        out.write_all(&bytes)?;
        Ok(sizes)
    }

    fn add_brick(&mut self, first: u64, brick: BrickStates) -> Result<(), BtWriteError> {
        let BrickStates { known, occupied } = brick;
        match (known, occupied) {
            (0, _) => return Ok(()),
            (u64::MAX, 0) => return self.add(first, BRICK_LOG2, Child::Free),
            (u64::MAX, u64::MAX) => return self.add(first, BRICK_LOG2, Child::Occupied),
            (_, _) => self.add(first, BRICK_LOG2, Child::Inner)?,
        }
        let at = self.bytes.len();
        self.bytes.extend([0; 2]);
        let mut node = 0;
        for number in 0..8_u8 {
            let octet = children(octet(known, number), octet(occupied, number));
            let child = match octet {
                0 => Child::Unknown,
                ALL_FREE => Child::Free,
                ALL_OCCUPIED => Child::Occupied,
                _ => {
                    self.leaves += leaves(octet);
                    self.bytes.extend(octet.to_le_bytes());
                    Child::Inner
                }
            };
            node |= child.bits() << (2 * number);
        }
        self.leaves += leaves(node);
        self.bytes[at..at + 2].copy_from_slice(&node.to_le_bytes());
        Ok(())
    }

    /// Marks a child in its parent, which is created if it does not exist.
    fn add(&mut self, first: u64, edge_log2: u8, child: Child) -> Result<(), BtWriteError> {
        if first < self.next {
            return Err(BtWriteError::OutOfOrder(voxel_at(first)));
        }
        self.next = first + voxels(edge_log2);
        while let Some(node) = self.open.last()
            && first - node.first >= voxels(self.open_edge_log2())
        {
            self.close();
        }
        while self.open.is_empty() || self.open_edge_log2() > edge_log2 + 1 {
            let edge_log2 = LEVELS - self.open.len() as u8;
            self.open.push(OpenNode {
                first: first & !(voxels(edge_log2) - 1),
                at: self.bytes.len(),
                children: 0,
            });
            self.bytes.extend([0; 2]);
        }
        self.set_in_parent(first, edge_log2, child);
        Ok(())
    }

    /// Edge of the smallest open node, of which there must be one.
    fn open_edge_log2(&self) -> u8 {
        LEVELS + 1 - self.open.len() as u8
    }

    fn set_in_parent(&mut self, first: u64, edge_log2: u8, child: Child) {
        let number = first >> (3 * edge_log2) & 7;
        if let Some(parent) = self.open.last_mut() {
            parent.children |= child.bits() << (2 * number);
        }
    }

    /// Closes the smallest open node: eight equal leaves are one, but the root is never a leaf.
    fn close(&mut self) {
        let edge_log2 = self.open_edge_log2();
        let Some(node) = self.open.pop() else {
            return;
        };
        let is_root = self.open.is_empty();
        let child = if matches!(node.children, ALL_FREE | ALL_OCCUPIED) && !is_root {
            self.bytes.truncate(node.at);
            Child::of(node.children, 0)
        } else {
            self.leaves += leaves(node.children);
            self.bytes[node.at..node.at + 2].copy_from_slice(&node.children.to_le_bytes());
            Child::Inner
        };
        if !is_root {
            self.set_in_parent(node.first, edge_log2, child);
        }
    }
}

/// Leaves among the children of a node: those of which one bit is set.
fn leaves(children: u16) -> u64 {
    ((children ^ children >> 1) & 0x5555).count_ones().into()
}

/// The bits of 2³ voxels of 4³, both x first: of cube `number` along the curve.
const fn octet(brick: u64, number: u8) -> u8 {
    let first = (number & 1) << 1 | (number & 2) << 2 | (number & 4) << 3;
    let bits = brick >> first;
    (bits & 0x03 | bits >> 2 & 0x0c | bits >> 12 & 0x30 | bits >> 14 & 0xc0) as u8
}

/// A node whose children are voxels.
const fn children(known: u8, occupied: u8) -> u16 {
    spread_bits(known & !occupied) | spread_bits(known & occupied) << 1
}

/// Every bit at twice its place.
const fn spread_bits(bits: u8) -> u16 {
    let mut spread_bits = bits as u16;
    spread_bits = (spread_bits | spread_bits << 4) & 0x0f0f;
    spread_bits = (spread_bits | spread_bits << 2) & 0x3333;
    (spread_bits | spread_bits << 1) & 0x5555
}

// The order of the file: the curve that passes the voxels of any cube in one go (G. M. Morton, 1966).

/// Where along the curve a voxel is, from 0; `None` where the format has no room for it: farther than 32,768 voxels
/// from the origin along an axis.
pub fn place(voxel: VoxelIndex) -> Option<u64> {
    let along = |index: i32| {
        let is_inside = (-ORIGIN..ORIGIN).contains(&index);
        is_inside.then(|| spread((index + ORIGIN).cast_unsigned()))
    };
    Some(along(voxel.x)? | along(voxel.y)? << 1 | along(voxel.z)? << 2)
}

fn voxel_at(place: u64) -> VoxelIndex {
    let along = |axis: u32| {
        let bits = (0..u32::from(LEVELS)).map(|bit| ((place >> (3 * bit + axis)) & 1) << bit);
        bits.sum::<u64>() as i32 - ORIGIN
    };
    VoxelIndex {
        x: along(0),
        y: along(1),
        z: along(2),
    }
}

const fn voxels(edge_log2: u8) -> u64 {
    1 << (3 * edge_log2)
}

/// Of 4³ parts of a cube that are numbered x first, then y, then z: the number of the part at `place` of the curve.
const fn x_first(place: usize) -> usize {
    let x = place & 1 | place >> 2 & 2;
    let y = place >> 1 & 1 | place >> 3 & 2;
    let z = place >> 2 & 1 | place >> 4 & 2;
    z << 4 | y << 2 | x
}

/// Every bit of the lower 16 at three times its place.
const fn spread(index: u32) -> u64 {
    let mut bits = index as u64;
    bits = (bits | bits << 16) & 0x0000_ff00_00ff;
    bits = (bits | bits << 8) & 0x00f0_0f00_f00f;
    bits = (bits | bits << 4) & 0x0c30_c30c_30c3;
    (bits | bits << 2) & 0x2492_4924_9249
}

#[cfg(test)]
pub(super) mod tests;
