//! Poses in space from the clouds of a three-dimensional lidar, or of a planar laser that is tilted: each is registered to what the last ones
//! showed
//! (docs/methods.md, section 0, pose source (d)).

mod matcher;
mod point_to_plane;
pub(crate) mod scan_collector;
mod surface_map;

pub use matcher::{CloudMatcher, CloudPose, Revolution};

#[cfg(test)]
mod tests;
