//! Elevation map and obstacle map above one ground plane (docs/methods.md, section 1).

use crate::MappingConfig;
use crate::elevation::{ElevationMap, ElevationReport, Grass};
use crate::ground_plane::{GroundPlane, GroundPlaneReset, GroundTracker};
use crate::obstacle::ObstacleMap;
use crate::octree::RangeSensorModel;
use crate::registered_scan::{RegisteredScan, ScanKind};
use crate::vehicle::VehicleShape;

/// Distance of the vehicle's top from what it passes below, metres.
const OVERHANG_MARGIN_M: f64 = 0.1;

/// Ground plane, elevation map and obstacle map of one vehicle.
#[derive(Clone, Debug)]
pub struct Terrain {
    ground: GroundTracker,
    elevation: ElevationMap,
    obstacle: ObstacleMap,
    vehicle_width_m: f64,
    /// Number of erasures.
    epoch: u32,
}

/// Result of one scan.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TerrainReport {
    /// Result of the elevation map.
    pub elevation: ElevationReport,
    /// Set if the ground plane was reset before the scan was added.
    pub ground_plane_reset: Option<GroundPlaneReset>,
}

impl Terrain {
    /// Empty maps; the settings must be valid. `sensors` are in the order of
    /// [`SensorId`](crate::registered_scan::SensorId).
    pub fn new(
        config: &MappingConfig,
        vehicle: VehicleShape,
        sensors: &[RangeSensorModel],
    ) -> Self {
        let mut elevation = ElevationMap::new(&config.elevation, &config.obstacle, &config.ground);
        let least_width_m = config.obstacle.least_width_m;
        if least_width_m > 0.0 {
            elevation.ignore_grass(Grass::new(least_width_m, &config.metrics, sensors));
        }
        elevation.ignore_overhangs(vehicle.height_m + OVERHANG_MARGIN_M);
        Self {
            ground: GroundTracker::new(&config.ground, vehicle.wheelbase_m),
            elevation,
            obstacle: ObstacleMap::new(&config.obstacle, &config.elevation),
            vehicle_width_m: vehicle.width_m,
            epoch: 0,
        }
    }

    /// Adds one scan.
    pub fn integrate(&mut self, scan: &RegisteredScan) -> TerrainReport {
        let pose = &scan.odom_from_base;
        let before = self.ground.plane();
        let (plane, ground_plane_reset) = self.ground.update(scan.stamp, pose);
        let vehicle = pose.translation.vector.xy().into();
        if let (Some(_), Some(before)) = (ground_plane_reset, before) {
            self.erase_obstacles();
            if scan.kind == ScanKind::Cloud && self.elevation.is_local() {
                self.elevation
                    .erase_beyond_blind_zone([&before, &plane], vehicle);
                self.obstacle.update(&self.elevation, vehicle);
            } else {
                self.elevation.erase();
            }
        }
        let elevation = self.elevation.integrate(scan, &plane);
        self.obstacle.update(&self.elevation, vehicle);
        self.obstacle.expire(scan.stamp, &self.elevation);
        TerrainReport {
            elevation,
            ground_plane_reset,
        }
    }

    /// Marks the arc of a cone in the obstacle map. An arc wider than the vehicle is left out: it could close a
    /// passage.
    pub fn mark_arc(&mut self, scan: &RegisteredScan) {
        let ends = scan.beams.first().zip(scan.beams.last());
        let is_narrow = ends.is_some_and(|(first, last)| {
            (last.end_in_odom - first.end_in_odom).norm() <= self.vehicle_width_m
        });
        let beams = scan.beams.iter().filter(|_| is_narrow);
        let points = beams.map(|beam| beam.end_in_odom.xy());
        self.obstacle.mark(points, scan.stamp, &self.elevation);
    }

    /// Erases the maps and the ground plane; the next scan sets a new one.
    pub fn reset(&mut self) {
        self.ground.clear();
        self.erase_maps();
    }

    fn erase_maps(&mut self) {
        self.elevation.erase();
        self.erase_obstacles();
    }

    fn erase_obstacles(&mut self) {
        self.obstacle.erase();
        self.epoch += 1;
    }

    /// `None` before the first scan.
    pub fn ground_plane(&self) -> Option<GroundPlane> {
        self.ground.plane()
    }

    /// The elevation map.
    pub const fn elevation(&self) -> &ElevationMap {
        &self.elevation
    }

    /// For taking its changes.
    pub const fn elevation_mut(&mut self) -> &mut ElevationMap {
        &mut self.elevation
    }

    /// The obstacle map.
    pub const fn obstacle(&self) -> &ObstacleMap {
        &self.obstacle
    }

    /// For taking its changes.
    pub const fn obstacle_mut(&mut self) -> &mut ObstacleMap {
        &mut self.obstacle
    }

    /// Number of erasures of both maps.
    pub const fn epoch(&self) -> u32 {
        self.epoch
    }

    /// Memory of both maps, bytes.
    pub fn bytes(&self) -> usize {
        self.elevation.bytes() + self.obstacle.bytes()
    }
}
