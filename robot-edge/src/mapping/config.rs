//! Settings of `[mapping]`.

use serde::Deserialize;

use super::occupancy_config::OccupancyConfig;

/// The map layers and what they share.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MappingConfig {
    /// Processors that mapping may use, 1 or 2. The maps are the same bit for bit.
    pub threads: usize,
    /// The 2D occupancy grid.
    pub occupancy: OccupancyConfig,
}

impl Default for MappingConfig {
    fn default() -> Self {
        Self {
            threads: 1,
            occupancy: OccupancyConfig::default(),
        }
    }
}
