//! Settings of `[mapping.octree]`, and what the octree must know of each sensor.
//!
//! \[HYB\] is *Hybrid 3D perception on land and water*.

use serde::Deserialize;

/// The probabilistic voxel map.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OctreeConfig {
    /// Whether it is mapped.
    pub enabled: bool,
    /// Side of a voxel, metres.
    pub cell_m: f64,
    /// Least probability a voxel can reach (\[HYB\] §4.3.1: 0.1).
    pub p_min: f64,
    /// Greatest probability a voxel can reach (\[HYB\] §4.3.1: 0.6).
    pub p_max: f64,
    /// Most memory for voxels, megabytes (10⁶ bytes); beyond it the farthest bricks are evicted and counted.
    pub memory_limit_mb: u32,
}

/// What the octree must know of a range sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeSensorModel {
    /// Probability that a voxel which one scan hit is occupied.
    pub p_hit: f64,
    /// Probability that a voxel which one scan saw through is occupied.
    pub p_miss: f64,
    /// Of the beams beside a hit as many must have hit something close to it, or the hit is taken for noise;
    /// 0 takes every hit.
    pub min_neighbours: u8,
    /// Full angle of a beam's cone, radians; 0 takes beams for lines.
    pub divergence_rad: f64,
    /// Whether its beams tell vegetation from what is rigid: of lasers, not of sonars.
    pub has_metrics: bool,
}

impl Default for OctreeConfig {
    fn default() -> Self {
        Self {
            enabled: false,
            cell_m: 0.1,
            p_min: 0.1,
            p_max: 0.6,
            memory_limit_mb: 256,
        }
    }
}

impl Default for RangeSensorModel {
    /// The laser of \[HYB\]'s introbot.
    fn default() -> Self {
        Self {
            p_hit: 0.95,
            p_miss: 0.49,
            min_neighbours: 2,
            divergence_rad: 0.0,
            has_metrics: true,
        }
    }
}
