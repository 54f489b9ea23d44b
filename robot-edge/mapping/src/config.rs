//! Settings of `[mapping]`.

use serde::Deserialize;

use super::cost_config::{CostConfig, MetricsConfig, RigidityConfig, ShoreConfig};
use super::elevation_config::{ElevationConfig, GroundConfig, ObstacleConfig};
use super::occupancy_config::OccupancyConfig;
use super::octree_config::OctreeConfig;

/// The map layers and what they share.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MappingConfig {
    /// Processors that mapping may use, 1 or 2. The maps are the same bit for bit.
    pub threads: usize,
    /// The 2D occupancy grid.
    pub occupancy: OccupancyConfig,
    /// The rolling elevation map.
    pub elevation: ElevationConfig,
    /// The obstacle map, which is made of the elevation map.
    pub obstacle: ObstacleConfig,
    /// The ground plane that heights refer to.
    pub ground: GroundConfig,
    /// The probabilistic voxel map.
    pub octree: OctreeConfig,
    /// The slope cost map, which is made of the octree.
    pub cost: CostConfig,
    /// What beams say about the rigidity of what they hit.
    pub metrics: MetricsConfig,
    /// What could be pushed through on land.
    pub rigidity: RigidityConfig,
    /// Shores and what grows there.
    pub shore: ShoreConfig,
}

impl Default for MappingConfig {
    fn default() -> Self {
        Self {
            threads: 1,
            occupancy: OccupancyConfig::default(),
            elevation: ElevationConfig::default(),
            obstacle: ObstacleConfig::default(),
            ground: GroundConfig::default(),
            octree: OctreeConfig::default(),
            cost: CostConfig::default(),
            metrics: MetricsConfig::default(),
            rigidity: RigidityConfig::default(),
            shore: ShoreConfig::default(),
        }
    }
}
