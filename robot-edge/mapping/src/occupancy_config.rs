//! Settings of `[mapping.occupancy]`.
//!
//! \[LRF\] is *Mapping using a laser range finder*.

use serde::Deserialize;

/// The 2D Bayesian occupancy grid: inverse sensor model, clamping and size.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OccupancyConfig {
    /// Whether it is mapped.
    pub enabled: bool,
    /// Side of a cell, metres.
    pub cell_m: f64,
    /// Probability that a cell which one scan saw through is occupied (\[LRF\]: 0.3).
    pub p_free: f64,
    /// Probability that a cell which one scan hit is occupied (\[LRF\]: 0.6).
    pub p_occupied: f64,
    /// Least probability a cell can reach, so that the map can forget.
    pub p_min: f64,
    /// Greatest probability a cell can reach.
    pub p_max: f64,
    /// What a beam without a return says about the cells along it.
    pub miss: Miss,
    /// Most memory for cells, megabytes (10⁶ bytes); beyond it the farthest tiles are evicted and counted.
    pub memory_limit_mb: u32,
}

/// What a beam without a return says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Miss {
    /// Nothing (\[LRF\]: 0.5 beyond range).
    Unknown,
    /// All is free up to the sensor's range: for lasers whose misses can be trusted.
    Free,
}

impl Default for OccupancyConfig {
    fn default() -> Self {
        Self {
            enabled: true,
            cell_m: 0.1,
            p_free: 0.3,
            p_occupied: 0.6,
            p_min: 0.02,
            p_max: 0.98,
            miss: Miss::Unknown,
            memory_limit_mb: 256,
        }
    }
}
