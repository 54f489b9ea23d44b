//! Settings of the occupancy grid.

use serde::Deserialize;

/// What a beam without a return says about the cells it crossed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MissMeaning {
    /// Nothing: p = 0.5 beyond range ([LRF] §2).
    Unknown,
    /// They are free up to the sensor's greatest range.
    Free,
}

/// Settings of the occupancy grid ([LRF] §2 and §3; `algorithms.md` §2).
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OccupancyConfig {
    /// Edge of a cell, metres.
    pub cell_m: f64,
    /// Inverse sensor model: probability of being occupied for a crossed cell.
    pub p_free: f64,
    /// Inverse sensor model: probability of being occupied for a hit cell.
    pub p_occupied: f64,
    /// Lowest probability a cell can reach, so that the map can forget.
    pub p_min: f64,
    /// Highest probability a cell can reach.
    pub p_max: f64,
    /// What a miss says.
    pub miss: MissMeaning,
    /// Greatest memory of the grid; beyond it the farthest tiles are evicted.
    pub memory_limit_mb: u32,
}

impl Default for OccupancyConfig {
    fn default() -> Self {
        Self {
            cell_m: 0.1,
            p_free: 0.3,
            p_occupied: 0.6,
            p_min: 0.02,
            p_max: 0.98,
            miss: MissMeaning::Unknown,
            memory_limit_mb: 512,
        }
    }
}
