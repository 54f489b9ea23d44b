//! Maps as files that other programs open.

pub mod octomap_bt;
pub mod voxels;
