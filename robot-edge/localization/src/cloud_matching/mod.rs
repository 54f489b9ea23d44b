//! Poses in space from the clouds of a three-dimensional lidar: each revolution is registered to what the last ones showed
//! (docs/methods.md, section 0, pose source (d)).

mod matcher;
mod point_to_plane;
mod surface_map;

pub use matcher::{CloudMatcher, CloudPose, Revolution};

#[cfg(test)]
mod tests;
