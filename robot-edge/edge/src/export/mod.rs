//! Maps as files that other programs open.

pub mod octomap_bt;
pub mod ply;
pub mod voxels;
