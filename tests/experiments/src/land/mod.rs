//! What the experiments of \[HYB\] on land share: a world, its runs, and what truly is in a column of voxels.

pub(super) mod columns;
pub(super) mod ground;

use protocol::layer::LayerId;
use protocol::tile_store::TileStore;

use super::ExperimentError;
use super::published::known_cells;
use super::run::{SimulatedRun, vehicle_config};
use edge::config::Config;
use edge::runtime::Pipeline;
use mapping::cost_map::CostMap;
use mapping::octree::Octree;
use mapping::voxel_layers::VoxelLayers;
use simulation::{SimulationOptions, World};

/// A column of voxels by its index: column (i, j) begins at (i, j) · `cell_m`.
pub(super) type Cell = [i64; 2];

/// A world that introbot drives through, and how introbot is set up.
pub(super) struct LandWorld {
    pub(super) world: World,
    pub(super) config: Config,
}

/// What the attitude's noise does to the poses, of which there are a hundred a second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Poses {
    /// Nothing.
    True,
    /// Each has that of as many readings, averaged, as the edge averages of an attitude sensor of its own.
    Averaged,
    /// Each has that of one reading.
    Raw,
}

impl LandWorld {
    /// The built-in world `name`.
    pub(super) fn load(name: &str) -> Result<Self, ExperimentError> {
        let world = World::load(name)?;
        let config = vehicle_config(&world, &[])?;
        Ok(Self { world, config })
    }

    /// Side of a voxel, metres.
    pub(super) fn cell_m(&self) -> f64 {
        self.config.mapping.octree.cell_m
    }

    /// From the ground up, metres.
    pub(super) fn vehicle_height_m(&self) -> f64 {
        self.config.vehicle.height_m
    }

    /// A run with the world's noise; the attitude's is on the poses, which introbot's attitude sensor gives,
    /// averaged as the edge averages an attitude sensor of its own.
    pub(super) fn run(&self, seed: u64) -> Result<SimulatedRun, ExperimentError> {
        self.run_with(seed, SimulationOptions::default(), &[])
    }

    /// The same with options of the simulation and settings (`key=value`) over introbot's configuration.
    pub(super) fn run_with(
        &self,
        seed: u64,
        options: SimulationOptions,
        settings: &[&str],
    ) -> Result<SimulatedRun, ExperimentError> {
        self.run_with_poses(seed, options, settings, Poses::Averaged)
    }

    /// The same with other errors of the poses.
    pub(super) fn run_with_poses(
        &self,
        seed: u64,
        options: SimulationOptions,
        settings: &[&str],
        poses: Poses,
    ) -> Result<SimulatedRun, ExperimentError> {
        let options = SimulationOptions { seed, ..options };
        let run = SimulatedRun::with_settings(&self.world, options, settings)?;
        let rate_hz = self.world.simulated_vehicle().odometry_rate_hz;
        let window_s = self.config.localization.attitude_smoothing_s;
        Ok(match poses {
            Poses::True => run,
            Poses::Averaged => {
                let averaged = libm::round(window_s * rate_hz) as usize;
                run.with_noisy_attitudes(&self.world, seed, averaged)
            }
            Poses::Raw => run.with_noisy_attitudes(&self.world, seed, 1),
        })
    }

    /// The column that a point, metres, lies in.
    pub(super) fn cell_at(&self, point_m: [f64; 2]) -> Cell {
        point_m.map(|m| libm::floor(m / self.cell_m()) as i64)
    }

    /// An error that says what the world lacks.
    pub(super) fn unsuitable(&self, why: &str) -> ExperimentError {
        ExperimentError::Unsuitable(format!("the world `{}` {why}", self.world.name()))
    }
}

/// What is made of the octree in a run.
pub(super) fn voxels(pipeline: &Pipeline) -> Result<&VoxelLayers, ExperimentError> {
    let voxels = pipeline.mapper().voxels();
    voxels.ok_or_else(|| ExperimentError::Unsuitable("no octree is mapped".to_owned()))
}

/// The octree of a run and the cost map made of it.
pub(super) fn octree_and_cost(pipeline: &Pipeline) -> Result<(&Octree, &CostMap), ExperimentError> {
    let voxels = voxels(pipeline)?;
    let cost = voxels.cost();
    let cost =
        cost.ok_or_else(|| ExperimentError::Unsuitable("no slope cost is mapped".to_owned()))?;
    Ok((voxels.octree(), cost))
}

/// The published values of a layer.
pub(super) fn published(
    store: &TileStore,
    layer: LayerId,
) -> impl Iterator<Item = (Cell, f32)> + '_ {
    let quantisation = layer.quantisation();
    known_cells(store, layer)
        .filter_map(move |(cell, code)| Some((cell, quantisation.decode(code)?)))
}

/// The cells up to `reach` around one, itself among them.
pub(super) fn around(cell: Cell, reach: i64) -> impl Iterator<Item = Cell> {
    (-reach..=reach)
        .flat_map(move |dy| (-reach..=reach).map(move |dx| [cell[0] + dx, cell[1] + dy]))
}
