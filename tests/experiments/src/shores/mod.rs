//! What the experiments on water share: a world, where `odom` lies in it, and how clusters are judged.

pub(super) mod cluster_match;
pub(super) mod views;

use nalgebra::{Point2, Point3, Vector3};

use super::ExperimentError;
use super::run::SimulatedRun;
use edge::runtime::Pipeline;
use mapping::cost_map::CostMap;
use mapping::grid::CellIndex;
use mapping::shore::ShoreLayer;
use mapping::voxel_layers::VoxelLayers;
use simulation::{Motion, SimulationOptions, World};

/// A world with water.
pub(super) struct WaterWorld {
    pub(super) world: World,
    /// Where `odom` has its origin: at the antenna's first fix. Both frames point east and north.
    origin_in_world: Vector3<f64>,
}

/// What is farther from all shores and docks is not shown, metres.
const SHOWN_M: f64 = 20.0;

/// The layers of a boat.
pub(super) struct BoatMaps<'a> {
    pub(super) voxels: &'a VoxelLayers,
    pub(super) cost: &'a CostMap,
    pub(super) shore: &'a ShoreLayer,
}

impl WaterWorld {
    /// The built-in world `name`.
    pub(super) fn load(name: &str) -> Result<Self, ExperimentError> {
        let world = World::load(name)?;
        let receiver = world.simulated_vehicle().gps.ok_or_else(|| {
            ExperimentError::Unsuitable(format!(
                "the vehicle of the world `{}` has no satellite receiver",
                world.name()
            ))
        })?;
        let world_from_base = Motion::new(&world).world_from_base(0.0);
        let origin_in_world = (world_from_base * receiver.antenna_m).coords;
        Ok(Self {
            world,
            origin_in_world,
        })
    }

    /// A run with the vehicle's own configuration: poses from satellites and IMU.
    pub(super) fn run(&self, seed: u64) -> Result<SimulatedRun, ExperimentError> {
        let options = SimulationOptions {
            seed,
            ..SimulationOptions::default()
        };
        SimulatedRun::with_settings(&self.world, options, &[])
    }

    /// Where a point of `odom` is in the world.
    pub(super) fn in_world(&self, in_odom: Point2<f64>) -> Point2<f64> {
        in_odom + self.origin_in_world.xy()
    }

    /// Whether a point of the world is near a shore or a dock.
    pub(super) fn is_near(&self, in_world: Point2<f64>) -> bool {
        let shores = self.world.shores().iter().map(|shore| &shore.polygon_m);
        let docks = self.world.docks().iter().map(|dock| &dock.polygon_m);
        let mut corners = shores.chain(docks).flatten();
        corners.any(|corner| (corner - in_world).norm() <= SHOWN_M)
    }

    /// Where a point of the world is in `odom`.
    pub(super) fn in_odom(&self, in_world: Point3<f64>) -> Point3<f64> {
        in_world - self.origin_in_world
    }

    /// The centre of a cell in the world.
    pub(super) fn cell_in_world(&self, cell: CellIndex, cell_m: f64) -> Point2<f64> {
        self.in_world(cell.centre(cell_m))
    }

    /// The layers that a boat maps.
    pub(super) fn maps<'a>(&self, pipeline: &'a Pipeline) -> Result<BoatMaps<'a>, ExperimentError> {
        let maps = pipeline.mapper().voxels().and_then(|voxels| {
            Some(BoatMaps {
                voxels,
                cost: voxels.cost()?,
                shore: voxels.shore()?,
            })
        });
        maps.ok_or_else(|| {
            ExperimentError::Unsuitable(format!(
                "the vehicle of the world `{}` maps no shores",
                self.world.name()
            ))
        })
    }
}
