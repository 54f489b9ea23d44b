//! The curve that passes the voxels of any cube of the tree in one go (G. M. Morton, 1966): the order of the file.

use super::{LEVELS, ORIGIN};
use mapping::grid::VoxelIndex;

/// Where along the curve a voxel is, from 0; `None` where the format has no room for it: farther than 32,768 voxels
/// from the origin along an axis.
pub fn place(voxel: VoxelIndex) -> Option<u64> {
    let along = |index: i32| {
        let is_inside = (-ORIGIN..ORIGIN).contains(&index);
        is_inside.then(|| spread((index + ORIGIN).cast_unsigned()))
    };
    Some(along(voxel.x)? | along(voxel.y)? << 1 | along(voxel.z)? << 2)
}

/// The voxel at a place of the curve.
pub(super) fn voxel_at(place: u64) -> VoxelIndex {
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

/// Voxels of a cube.
pub(super) const fn voxels(edge_log2: u8) -> u64 {
    1 << (3 * edge_log2)
}

/// Of 4³ parts of a cube that are numbered x first, then y, then z: the number of the part at `place` of the curve.
pub(super) const fn x_first(place: usize) -> usize {
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
