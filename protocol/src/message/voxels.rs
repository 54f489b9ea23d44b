//! The octree's files, part by part: what a vehicle exports, a console can have too.

use serde::{Deserialize, Serialize};

/// Bytes of a file in one [`VoxelsPart`] at most.
pub const MAX_PART_BYTES: usize = 16 * 1024;

/// One of the files that are made of the octree. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum VoxelFile {
    /// `voxels.bt`: `OctoMap`'s binary tree.
    Tree,
    /// `points.ply`: occupied voxels with their class.
    Points,
}

impl VoxelFile {
    /// All of them, in wire order.
    pub const ALL: [Self; 2] = [Self::Tree, Self::Points];

    /// What an export calls it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tree => "voxels.bt",
            Self::Points => "points.ply",
        }
    }
}

/// Asks `voxels` for a part of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct VoxelsRequest {
    /// Of this moment; `None` for one as new as can be.
    pub snapshot: Option<u64>,
    /// Which file.
    pub file: VoxelFile,
    /// How many bytes of it, packed, are known already.
    pub offset: u64,
}

/// The one reply to [`VoxelsRequest`]. Append-only.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum VoxelsReply {
    /// The robot has no octree.
    None,
    /// The files are being made: to be asked again in half a second.
    Preparing,
    /// That moment is no longer kept: to be begun anew.
    Gone,
    /// Here it is.
    Part(VoxelsPart),
}

/// A part of a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct VoxelsPart {
    /// Which moment; the stamp of its newest data is in the header.
    pub snapshot: u64,
    /// Which file.
    pub file: VoxelFile,
    /// Length of the whole file.
    pub bytes: u64,
    /// BLAKE3 of the whole file.
    pub digest: [u8; 32],
    /// Length of the whole file as one zstd frame.
    pub packed_bytes: u64,
    /// Where in that frame this part begins.
    pub offset: u64,
    /// The part: as much as there is, [`MAX_PART_BYTES`] at most.
    pub packed: Vec<u8>,
}
