//! Elevation and obstacles above one ground plane: the layers of \[LOD\], in their order.

use super::config::MappingConfig;
use super::elevation::{ElevationMap, ElevationReport};
use super::ground_plane::{GroundPlane, GroundPlaneReset, GroundTracker};
use super::obstacle::ObstacleMap;
use super::registered_scan::RegisteredScan;

/// Ground plane, elevation map and obstacle map of one vehicle.
#[derive(Clone, Debug)]
pub struct Terrain {
    ground: GroundTracker,
    elevation: ElevationMap,
    obstacle: ObstacleMap,
    /// How often both maps were erased.
    epoch: u32,
}

/// What became of one scan.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TerrainReport {
    /// Of its points.
    pub elevation: ElevationReport,
    /// The ground plane was reset before it was added.
    pub ground_plane_reset: Option<GroundPlaneReset>,
}

impl Terrain {
    /// Empty maps. The settings are taken as valid.
    pub fn new(config: &MappingConfig, wheelbase_m: f64) -> Self {
        Self {
            ground: GroundTracker::new(&config.ground, wheelbase_m),
            elevation: ElevationMap::new(&config.elevation, &config.obstacle, &config.ground),
            obstacle: ObstacleMap::new(&config.obstacle),
            epoch: 0,
        }
    }

    /// Adds one scan.
    pub fn integrate(&mut self, scan: &RegisteredScan) -> TerrainReport {
        let pose = &scan.odom_from_base;
        let (plane, ground_plane_reset) = self.ground.update(scan.stamp, pose);
        if ground_plane_reset.is_some() {
            self.erase_maps();
        }
        let elevation = self.elevation.integrate(scan, &plane);
        self.obstacle
            .update(&self.elevation, pose.translation.vector.xy().into());
        TerrainReport {
            elevation,
            ground_plane_reset,
        }
    }

    /// Forgets the maps and the ground plane: the next scan gives a new one.
    pub fn reset(&mut self) {
        self.ground.reset();
        self.erase_maps();
    }

    fn erase_maps(&mut self) {
        self.elevation.erase();
        self.obstacle.erase();
        self.epoch += 1;
    }

    /// The plane that heights refer to; `None` before the first scan.
    pub fn ground_plane(&self) -> Option<GroundPlane> {
        self.ground.plane()
    }

    /// The elevation map.
    pub const fn elevation(&self) -> &ElevationMap {
        &self.elevation
    }

    /// The elevation map, to take its changes.
    pub const fn elevation_mut(&mut self) -> &mut ElevationMap {
        &mut self.elevation
    }

    /// The obstacle map.
    pub const fn obstacle(&self) -> &ObstacleMap {
        &self.obstacle
    }

    /// The obstacle map, to take its changes.
    pub const fn obstacle_mut(&mut self) -> &mut ObstacleMap {
        &mut self.obstacle
    }

    /// How often both maps were erased.
    pub const fn epoch(&self) -> u32 {
        self.epoch
    }

    /// Memory of both maps, bytes.
    pub fn bytes(&self) -> usize {
        self.elevation.bytes() + self.obstacle.bytes()
    }
}
