//! The mapping core: posed scans in, map cells out.
//!
//! Everything here is a pure function of its inputs: no clock, file, socket, thread or channel, and
//! nothing of the wire. The same scans give the same cells, bit for bit, at any speed and on any platform.

#![warn(missing_docs)]

pub mod config;
pub mod cost_config;
pub mod elevation_config;
pub mod occupancy_config;
pub mod octree_config;
pub mod registered_scan;
pub mod vehicle;

pub mod grid;
pub mod log_odds;
pub mod occupancy_grid;
pub mod ray;
pub mod scan_marks;

pub mod elevation;
pub mod elevation_cell;
pub mod ground_plane;
mod local_ground;
pub mod obstacle;
mod ray_clearing;
pub mod rolling_grid;
mod scan_hits;
pub mod terrain;

pub mod octree;
pub mod radial_filter;
pub mod voxel;

mod column_window;
pub mod cost_map;
pub mod height_columns;
mod slope;

pub mod inter_scan;
pub mod intra_scan;

pub mod cluster_tracker;
pub mod majority_vote;
pub mod obstacle_voxel;
pub mod rigidity;
pub mod shore;
pub mod shore_clusters;
pub mod shore_layer;

pub mod docking;
pub mod docking_grid;
mod docking_pose;

pub mod voxel_layers;
mod waterline;

use nalgebra::Point3;

use config::MappingConfig;
use ground_plane::GroundPlaneReset;
use measurement::drops::{DropCounts, DropReason};
use occupancy_grid::OccupancyGrid;
use octree_config::RangeSensorModel;
use registered_scan::RegisteredScan;
use terrain::Terrain;
use vehicle::VehicleShape;
use voxel_layers::VoxelLayers;

/// All map layers of one vehicle.
#[derive(Clone, Debug)]
pub struct Mapper {
    occupancy: Option<OccupancyGrid>,
    terrain: Option<Terrain>,
    voxels: Option<VoxelLayers>,
    vehicle_in_odom: Point3<f64>,
    resets: u32,
}

/// What became of one scan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapReport {
    /// Beams that hit something.
    pub hits: u64,
    /// Beams without a return.
    pub misses: u64,
    /// Beams that did not reach a layer, by reason.
    pub dropped_beams: DropCounts,
    /// The ground plane was reset, and the maps above it erased.
    pub ground_plane_reset: Option<GroundPlaneReset>,
    /// Bricks of the octree that were evicted to keep its memory limit.
    pub evicted_bricks: u32,
}

impl Mapper {
    /// Empty maps of a vehicle with these range sensors, in the order of their numbers.
    pub fn new(
        config: &MappingConfig,
        vehicle: VehicleShape,
        sensors: &[RangeSensorModel],
    ) -> Self {
        let occupancy = &config.occupancy;
        Self {
            occupancy: occupancy.enabled.then(|| OccupancyGrid::new(occupancy)),
            terrain: config
                .elevation
                .enabled
                .then(|| Terrain::new(config, vehicle.wheelbase_m)),
            voxels: config
                .octree
                .enabled
                .then(|| VoxelLayers::new(config, vehicle, sensors)),
            vehicle_in_odom: Point3::origin(),
            resets: 0,
        }
    }

    /// Adds one scan to every layer.
    pub fn integrate(&mut self, scan: &RegisteredScan) -> MapReport {
        self.vehicle_in_odom = Point3::from(scan.odom_from_base.translation.vector);
        let mut report = MapReport::default();
        if let Some(occupancy) = &mut self.occupancy {
            let beams = occupancy.integrate(scan);
            let lost = (DropReason::OutOfBounds, beams.out_of_bounds);
            report.count_beams(beams.hits, beams.misses, lost);
        }
        if let Some(terrain) = &mut self.terrain {
            let mapped = terrain.integrate(scan);
            report.ground_plane_reset = mapped.ground_plane_reset;
            // Each beam has one fate: where there is an occupancy grid, which knows no window, it is that one.
            if self.occupancy.is_none() {
                let points = mapped.elevation;
                let misses = scan.beams.len() as u32 - points.points - points.outside;
                let lost = (DropReason::OutsideWindow, points.outside);
                report.count_beams(points.points, misses, lost);
            }
        }
        if let Some(voxels) = &mut self.voxels {
            let mapped = voxels.integrate(scan);
            report.evicted_bricks = mapped.evicted_bricks;
            if self.occupancy.is_none() && self.terrain.is_none() {
                let lost = (DropReason::OutOfBounds, mapped.out_of_bounds);
                report.count_beams(mapped.hits, mapped.misses, lost);
                let isolated = mapped.isolated.into();
                report
                    .dropped_beams
                    .add_many(DropReason::Isolated, isolated);
            }
        }
        report
    }

    /// Brings every map up to date that is computed only now and then.
    pub fn refresh(&mut self) {
        if let Some(voxels) = &mut self.voxels {
            voxels.refresh();
        }
    }

    /// Where the vehicle was at the last scan, metres.
    pub const fn vehicle_in_odom(&self) -> Point3<f64> {
        self.vehicle_in_odom
    }

    /// The occupancy grid, where it is mapped.
    pub const fn occupancy(&self) -> Option<&OccupancyGrid> {
        self.occupancy.as_ref()
    }

    /// The occupancy grid, to take its changes.
    pub const fn occupancy_mut(&mut self) -> Option<&mut OccupancyGrid> {
        self.occupancy.as_mut()
    }

    /// Elevation and obstacles, where they are mapped.
    pub const fn terrain(&self) -> Option<&Terrain> {
        self.terrain.as_ref()
    }

    /// Elevation and obstacles, to take their changes.
    pub const fn terrain_mut(&mut self) -> Option<&mut Terrain> {
        self.terrain.as_mut()
    }

    /// Octree, slope cost and shores, where they are mapped.
    pub const fn voxels(&self) -> Option<&VoxelLayers> {
        self.voxels.as_ref()
    }

    /// Octree, slope cost and shores, to take their changes.
    pub const fn voxels_mut(&mut self) -> Option<&mut VoxelLayers> {
        self.voxels.as_mut()
    }

    /// Forgets everything in every layer: what was mapped does not fit what comes.
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

    /// How often everything was forgotten.
    pub const fn resets(&self) -> u32 {
        self.resets
    }

    /// Keeps every layer within its memory limit; says how many tiles were evicted.
    ///
    /// Call it after the changes were taken and published.
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
