//! Writes cubes as a pruned tree.

use std::io::{self, Write};

use super::{Child, Cube, FIRST_LINE, LEVELS, ORIGIN};
use crate::mapping::voxel::VoxelIndex;

/// Why cubes were not written.
#[derive(Debug, thiserror::Error)]
pub enum BtWriteError {
    /// The format has no place for it.
    #[error("the cube of edge 2^{} at voxel ({}, {}, {}) is not within ±32768 voxels of the origin, on a \
        multiple of its edge and of an edge up to 2^15", .0.edge_log2, .0.least.x, .0.least.y, .0.least.z)]
    Misplaced(Cube),
    /// Something is said twice.
    #[error("two cubes overlap at voxel ({}, {}, {})", .0.x, .0.y, .0.z)]
    Overlap(VoxelIndex),
    /// The file could not be written.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// What was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BtSizes {
    /// Nodes of the tree, inner ones and leaves.
    pub nodes: u64,
    /// Leaves, after pruning.
    pub leaves: u64,
}

/// Writes `cubes`, in any order, of voxels `cell_m` wide, as a tree in which eight equal leaves are one.
///
/// It needs 16 bytes of memory per cube, and 2 per inner node.
pub fn write(
    cubes: impl IntoIterator<Item = Cube>,
    cell_m: f64,
    out: &mut impl Write,
) -> Result<BtSizes, BtWriteError> {
    let leaves: Result<Vec<_>, _> = cubes.into_iter().map(Leaf::new).collect();
    let mut leaves = leaves?;
    leaves.sort_unstable_by_key(|leaf| leaf.first);
    if let Some(pair) = leaves.windows(2).find(|pair| pair[0].end() > pair[1].first) {
        return Err(BtWriteError::Overlap(voxel_at(pair[1].first)));
    }
    let leaves = pruned(leaves);
    let mut tree = Tree::default();
    if !leaves.is_empty() {
        tree.nodes = 1;
        tree.add_node(&leaves, 0, LEVELS);
    }
    write!(
        out,
        "{FIRST_LINE}\n# (feel free to add / change comments, but leave the first line as it is!)\n#\n\
        id OcTree\nsize {}\nres {cell_m}\ndata\n",
        tree.nodes
    )?;
    out.write_all(&tree.bytes)?;
    Ok(BtSizes {
        nodes: tree.nodes,
        leaves: leaves.len() as u64,
    })
}

/// A cube as a stretch of the Morton curve, which passes the voxels of any cube of the tree in one go.
#[derive(Clone, Copy, Debug)]
struct Leaf {
    /// Its first voxel along the curve.
    first: u64,
    edge_log2: u8,
    is_occupied: bool,
}

impl Leaf {
    fn new(cube: Cube) -> Result<Self, BtWriteError> {
        let VoxelIndex { x, y, z } = cube.least;
        let is_placed = |index: i32| {
            (-ORIGIN..ORIGIN).contains(&index) && index.trailing_zeros() >= cube.edge_log2.into()
        };
        if cube.edge_log2 >= LEVELS || ![x, y, z].into_iter().all(is_placed) {
            return Err(BtWriteError::Misplaced(cube));
        }
        let spread = |index: i32| spread((index + ORIGIN).cast_unsigned());
        Ok(Self {
            first: spread(x) | spread(y) << 1 | spread(z) << 2,
            edge_log2: cube.edge_log2,
            is_occupied: cube.is_occupied,
        })
    }

    const fn end(self) -> u64 {
        self.first + voxels(self.edge_log2)
    }
}

/// Voxels of a cube.
const fn voxels(edge_log2: u8) -> u64 {
    1 << (3 * edge_log2)
}

/// Every bit of the lower 16 at three times its place.
const fn spread(index: u32) -> u64 {
    let mut bits = index as u64;
    bits = (bits | bits << 16) & 0x0000_ff00_00ff;
    bits = (bits | bits << 8) & 0x00f0_0f00_f00f;
    bits = (bits | bits << 4) & 0x0c30_c30c_30c3;
    (bits | bits << 2) & 0x2492_4924_9249
}

/// The voxel at a place of the curve.
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

/// Leaves in order, eight equal ones that fill a cube made one, again and again.
fn pruned(leaves: Vec<Leaf>) -> Vec<Leaf> {
    let mut pruned: Vec<Leaf> = Vec::with_capacity(leaves.len());
    for leaf in leaves {
        pruned.push(leaf);
        while let Some(whole) = last_eight(&pruned) {
            pruned.truncate(pruned.len() - 8);
            pruned.push(whole);
        }
    }
    pruned
}

/// The cube that the last eight leaves fill, if they are equal. The root is never a leaf.
fn last_eight(leaves: &[Leaf]) -> Option<Leaf> {
    let eight = leaves.last_chunk::<8>()?;
    let edge_log2 = eight[0].edge_log2 + 1;
    let are_equal = eight[1..].iter().all(|leaf| {
        (leaf.edge_log2, leaf.is_occupied) == (eight[0].edge_log2, eight[0].is_occupied)
    });
    let whole = Leaf {
        edge_log2,
        ..eight[0]
    };
    let fill_it = whole.first.is_multiple_of(voxels(edge_log2)) && eight[7].end() == whole.end();
    (are_equal && fill_it && edge_log2 < LEVELS).then_some(whole)
}

/// The tree as it is written.
#[derive(Debug, Default)]
struct Tree {
    bytes: Vec<u8>,
    nodes: u64,
}

impl Tree {
    /// Adds the inner node that begins at `first` of the curve, and all below it: `leaves`, in order.
    ///
    /// It calls itself, 16 deep at most.
    fn add_node(&mut self, leaves: &[Leaf], first: u64, edge_log2: u8) {
        let child_edge_log2 = edge_log2 - 1;
        let mut inner: [(u64, &[Leaf]); 8] = [(0, &[]); 8];
        let mut node = 0_u16;
        let mut rest = leaves;
        for (number, inner) in (0_u8..).zip(&mut inner) {
            let start = first + u64::from(number) * voxels(child_edge_log2);
            let end = start + voxels(child_edge_log2);
            let (own, others) = rest.split_at(rest.partition_point(|leaf| leaf.first < end));
            rest = others;
            let child = match own {
                [] => Child::Unknown,
                [leaf] if leaf.edge_log2 == child_edge_log2 => Child::leaf(leaf.is_occupied),
                _ => {
                    *inner = (start, own);
                    Child::Inner
                }
            };
            self.nodes += u64::from(child != Child::Unknown);
            node |= child.bits() << (2 * number);
        }
        self.bytes.extend(node.to_le_bytes());
        for (start, leaves) in inner {
            if !leaves.is_empty() {
                self.add_node(leaves, start, child_edge_log2);
            }
        }
    }
}
