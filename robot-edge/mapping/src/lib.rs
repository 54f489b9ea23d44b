//! The mapping core: registered scans in, map cells out. docs/methods.md has the equations and
//! their sources.
//!
//! Everything here is a pure function of its inputs: no clock, file, socket, thread or channel. The
//! same scans give bit-identical cells, at any speed and on any platform.

#![warn(missing_docs)]

pub mod clustering;
pub mod cost_map;
pub mod depth;
pub mod docking;
mod docking_site_tracker;
pub mod elevation;
pub mod grid;
pub mod ground_plane;
pub mod height_columns;
pub mod obstacle;
pub mod occupancy_grid;
pub mod octree;
mod radial_filter;
mod ray_clearing;
pub mod registered_scan;
pub mod rigidity;
pub mod rolling_grid;
pub mod scan_marks;
pub mod scan_metrics;
pub mod shore;
pub mod shore_layer;
mod slope;
mod stem_density;
pub mod terrain;
pub mod tilt_search;
pub mod vehicle;
pub mod voxel_layers;

use measurement::drops::{DropCounts, DropReason};
use nalgebra::Point3;
use serde::Deserialize;

use crate::cost_map::{CostConfig, Surface};
use crate::elevation::ElevationConfig;
use crate::ground_plane::{GroundConfig, GroundPlaneReset};
use crate::obstacle::ObstacleConfig;
use crate::occupancy_grid::{OccupancyConfig, OccupancyGrid};
use crate::octree::{LimitedBricks, OctreeConfig, RangeSensorModel};
use crate::registered_scan::{RegisteredScan, ScanKind};
use crate::rigidity::RigidityConfig;
use crate::scan_metrics::MetricsConfig;
use crate::shore::ShoreConfig;
use crate::terrain::Terrain;
use crate::vehicle::VehicleShape;
use crate::voxel_layers::VoxelLayers;

/// All map layers of one vehicle.
#[derive(Clone, Debug)]
pub struct Mapper {
    occupancy: Option<OccupancyGrid>,
    terrain: Option<Terrain>,
    voxels: Option<VoxelLayers>,
    threads: usize,
    vehicle_in_odom: Point3<f64>,
    resets: u32,
}

/// Result of one scan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapReport {
    /// Beams that hit something.
    pub hits: u64,
    /// Beams without a return.
    pub misses: u64,
    /// Beams that did not reach a layer, by reason.
    pub dropped_beams: DropCounts,
    /// Set if the ground plane was reset and the maps above it erased.
    pub ground_plane_reset: Option<GroundPlaneReset>,
    /// What the octree's memory limit did.
    pub limited: LimitedBricks,
}

impl Mapper {
    /// Empty maps. `sensors` are in the order of [`registered_scan::SensorId`].
    pub fn new(
        config: &MappingConfig,
        vehicle: VehicleShape,
        sensors: &[RangeSensorModel],
    ) -> Self {
        let occupancy = &config.occupancy;
        let max_slope = libm::tan(config.ground.max_slope_deg.to_radians());
        let is_on_land = config.cost.surface == Surface::Land;
        Self {
            occupancy: occupancy.enabled.then(|| {
                let mut grid = OccupancyGrid::new(occupancy);
                if is_on_land {
                    grid.ignore_slopes(max_slope);
                }
                grid
            }),
            terrain: config
                .elevation
                .enabled
                .then(|| Terrain::new(config, vehicle, sensors)),
            voxels: config
                .octree
                .enabled
                .then(|| VoxelLayers::new(config, vehicle, sensors)),
            threads: config.threads,
            vehicle_in_odom: Point3::origin(),
            resets: 0,
        }
    }

    /// Adds one scan to every layer; an arc only to the obstacle map.
    pub fn integrate(&mut self, scan: &RegisteredScan) -> MapReport {
        match scan.kind {
            ScanKind::Beams | ScanKind::Cloud => self.integrate_beams(scan),
            ScanKind::Arc => {
                if let Some(terrain) = &mut self.terrain {
                    terrain.mark_arc(scan);
                }
                MapReport::default()
            }
            // Points that touch are no beams to count.
            ScanKind::Contact { .. } if !scan.beams.is_empty() => MapReport {
                hits: 0,
                misses: 0,
                dropped_beams: DropCounts::default(),
                ..self.integrate_beams(scan)
            },
            ScanKind::Contact { .. } => MapReport::default(),
        }
    }

    fn integrate_beams(&mut self, scan: &RegisteredScan) -> MapReport {
        self.vehicle_in_odom = Point3::from(scan.odom_from_base.translation.vector);
        let Self {
            occupancy,
            terrain,
            voxels,
            ..
        } = self;
        let mut of_cells = || {
            let observed = occupancy.as_mut().map(|grid| grid.integrate(scan));
            (
                observed,
                terrain.as_mut().map(|terrain| terrain.integrate(scan)),
            )
        };
        let mut of_voxels = || voxels.as_mut().map(|voxels| voxels.integrate(scan));
        let ((observed, ground), voxels) = if self.threads > 1 {
            rayon::join(of_cells, of_voxels)
        } else {
            (of_cells(), of_voxels())
        };
        let mut report = MapReport {
            ground_plane_reset: ground.and_then(|ground| ground.ground_plane_reset),
            limited: voxels.map_or_else(LimitedBricks::default, |voxels| voxels.limited),
            ..MapReport::default()
        };
        // A beam is counted once: by the occupancy grid if it is enabled, which has no window.
        if let Some(beams) = observed {
            let lost = (DropReason::OutOfBounds, beams.out_of_bounds);
            report.count_beams(beams.hits, beams.misses, lost);
        } else if let Some(ground) = ground {
            let points = ground.elevation;
            let misses = scan.beams.len() as u32 - points.points - points.outside;
            let lost = (DropReason::OutsideWindow, points.outside);
            report.count_beams(points.points, misses, lost);
        } else if let Some(beams) = voxels {
            let lost = (DropReason::OutOfBounds, beams.out_of_bounds);
            report.count_beams(beams.hits, beams.misses, lost);
            let isolated = beams.isolated.into();
            report
                .dropped_beams
                .add_many(DropReason::Isolated, isolated);
        }
        report
    }

    /// Updates the maps that are computed periodically, whether or not they are due.
    pub fn refresh(&mut self) {
        if let Some(voxels) = &mut self.voxels {
            voxels.refresh();
        }
    }

    /// Position of the vehicle at the last scan, metres.
    pub const fn vehicle_in_odom(&self) -> Point3<f64> {
        self.vehicle_in_odom
    }

    /// `None` if disabled.
    pub const fn occupancy(&self) -> Option<&OccupancyGrid> {
        self.occupancy.as_ref()
    }

    /// For taking its changes.
    pub const fn occupancy_mut(&mut self) -> Option<&mut OccupancyGrid> {
        self.occupancy.as_mut()
    }

    /// Elevation and obstacle map; `None` if disabled.
    pub const fn terrain(&self) -> Option<&Terrain> {
        self.terrain.as_ref()
    }

    /// For taking its changes.
    pub const fn terrain_mut(&mut self) -> Option<&mut Terrain> {
        self.terrain.as_mut()
    }

    /// Octree, cost map and shores; `None` if disabled.
    pub const fn voxels(&self) -> Option<&VoxelLayers> {
        self.voxels.as_ref()
    }

    /// For taking its changes.
    pub const fn voxels_mut(&mut self) -> Option<&mut VoxelLayers> {
        self.voxels.as_mut()
    }

    /// Erases every layer.
    pub fn reset(&mut self) {
        self.resets += 1;
        if let Some(occupancy) = &mut self.occupancy {
            occupancy.erase();
        }
        if let Some(terrain) = &mut self.terrain {
            terrain.reset();
        }
        if let Some(voxels) = &mut self.voxels {
            voxels.reset();
        }
    }

    /// Number of calls of [`Mapper::reset`].
    pub const fn resets(&self) -> u32 {
        self.resets
    }

    /// Applies the memory limits; returns the number of evicted tiles.
    ///
    /// Call it after the changes were taken: the changes of evicted tiles are lost.
    pub fn enforce_memory_limits(&mut self) -> usize {
        let vehicle = self.vehicle_in_odom;
        self.occupancy
            .as_mut()
            .map_or(0, |occupancy| occupancy.enforce_memory_limit(&vehicle))
    }
}

impl MapReport {
    fn count_beams(&mut self, hits: u32, misses: u32, lost: (DropReason, u32)) {
        self.hits = hits.into();
        self.misses = misses.into();
        self.dropped_beams.add_many(lost.0, lost.1.into());
    }
}

/// Settings of `[mapping]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MappingConfig {
    /// Threads for mapping, 1 or 2. The maps do not depend on it.
    pub threads: usize,
    /// 2D occupancy grid.
    pub occupancy: OccupancyConfig,
    /// Rolling elevation map.
    pub elevation: ElevationConfig,
    /// Obstacle map, derived from the elevation map.
    pub obstacle: ObstacleConfig,
    /// Ground plane that heights refer to.
    pub ground: GroundConfig,
    /// Probabilistic 3D occupancy.
    pub octree: OctreeConfig,
    /// Slope cost map, derived from the octree.
    pub cost: CostConfig,
    /// `IntraScan` and `InterScan` metrics.
    pub metrics: MetricsConfig,
    /// Traversable vegetation on land.
    pub rigidity: RigidityConfig,
    /// Shores and their vegetation.
    pub shore: ShoreConfig,
}

impl MappingConfig {
    /// Whether depths of water are a layer: on a boat with a sonar.
    pub fn maps_depth(&self, sensors: &[RangeSensorModel]) -> bool {
        let is_on_water = self.cost.enabled && self.cost.surface == Surface::Water;
        is_on_water && sensors.iter().any(|sensor| !sensor.has_metrics)
    }
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
