//! What the experiments of \[LOD\] share: a world, its truth, what the laser swept, and how maps are judged.

pub(super) mod agreement;
pub(super) mod extent;
pub(super) mod sweep;
pub(super) mod views;

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};
use protocol::layer::LayerId;
use protocol::tile_store::TileStore;

use super::ExperimentError;
use super::published::known_cells;
use super::run::{SimulatedRun, vehicle_config};
use edge::config::Config;
use mapping::elevation::CellClass;
use measurement::time::RobotTime;
use simulation::solid::{Reflectivity, Solid};
use simulation::source::START;
use simulation::truth::{
    self, Bounds, GroundPlane, HeightOptions, HeightTruth, Thresholds, Verdict,
};
use simulation::{Motion, SimulationOptions, World};

/// A cell by its index: cell (i, j) begins at (i, j) · `cell_m`.
pub(super) type Cell = [i64; 2];

/// A world, its vehicle's configuration, and the truth in cells of the elevation map.
pub(super) struct TerrainWorld {
    pub(super) world: World,
    pub(super) config: Config,
    settings: Vec<String>,
    duration_s: f64,
    /// Glass does not count: what is under and behind it does.
    heights: HeightTruth,
    /// Glass counts; `None` in a world without.
    heights_with_glass: Option<HeightTruth>,
}

/// Share of time between two looks at where the vehicle drives, seconds.
const PATH_STEP_S: f64 = 0.5;

impl TerrainWorld {
    /// The built-in world `name` for at most `duration_s` of its path, with `settings` (`key=value`) over its
    /// vehicle's configuration.
    pub(super) fn load(
        name: &str,
        settings: &[&str],
        duration_s: Option<f64>,
    ) -> Result<Self, ExperimentError> {
        let world = World::load(name)?;
        let config = vehicle_config(&world, settings)?;
        let whole_s = world.path().duration_s();
        let duration_s = duration_s.map_or(whole_s, |duration_s| duration_s.min(whole_s));
        let elevation = &config.mapping.elevation;
        let reach_m = (0.5 * f64::from(elevation.cells) + 2.0) * elevation.cell_m;
        let bounds = driven(&world, duration_s, reach_m);
        let heights = |glass| {
            let options = HeightOptions {
                glass,
                moving_at_s: None,
            };
            truth::heights(&world, elevation.cell_m, bounds, options)
        };
        let is_glass = |solid: &Solid| matches!(solid.reflectivity, Reflectivity::Glass { .. });
        let has_glass = world.solids().iter().any(is_glass);
        let heights_with_glass = if has_glass {
            Some(heights(true)?)
        } else {
            None
        };
        Ok(Self {
            heights: heights(false)?,
            heights_with_glass,
            settings: settings.iter().map(|&setting| setting.to_owned()).collect(),
            duration_s,
            config,
            world,
        })
    }

    /// Side of a cell, metres.
    pub(super) fn cell_m(&self) -> f64 {
        self.config.mapping.elevation.cell_m
    }

    /// How long the vehicle drives, seconds.
    pub(super) fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// The truth where glass does not count.
    pub(super) fn heights(&self) -> &HeightTruth {
        &self.heights
    }

    /// A run with poses from wheels and attitude sensor; `encoder_error` is the share by which encoders read
    /// too far.
    pub(super) fn run(
        &self,
        seed: u64,
        encoder_error: f64,
    ) -> Result<SimulatedRun, ExperimentError> {
        let options = SimulationOptions {
            seed,
            duration_s: Some(self.duration_s),
            encoder_error: Some(encoder_error),
            ..SimulationOptions::default()
        };
        SimulatedRun::new(&self.world, options, &self.config)
    }

    /// The same drive without any error: what the laser truly meets.
    pub(super) fn errorless_run(&self) -> Result<SimulatedRun, ExperimentError> {
        let options = SimulationOptions {
            seed: super::session::SEED,
            duration_s: Some(self.duration_s),
            range_noise_m: Some(0.0),
            dropout: Some(0.0),
            attitude_noise_rad: Some(0.0),
            encoder_error: Some(0.0),
            wheel_slip: None,
            joint_lag_s: Some(0.0),
            fix_noise_m: Some(0.0),
        };
        let settings = self.settings.iter().map(String::as_str);
        let settings: Vec<&str> = settings.chain(["localization.source=tf"]).collect();
        SimulatedRun::with_settings(&self.world, options, &settings)
    }

    /// The plane that the vehicle truly stands on at a time, seconds.
    pub(super) fn plane_at(&self, time_s: f64) -> GroundPlane {
        let world_from_base = Motion::new(&self.world).world_from_base(time_s);
        GroundPlane {
            point_m: Point3::from(world_from_base.translation.vector),
            normal: world_from_base.rotation * Vector3::z(),
        }
    }

    /// Heights beyond which a surface is an obstacle.
    pub(super) fn thresholds(&self) -> Thresholds {
        let obstacle = &self.config.mapping.obstacle;
        Thresholds {
            above_m: obstacle.h_pos_m,
            below_m: -obstacle.h_neg_m,
        }
    }

    /// What a cell truly is to a vehicle on `plane`; `None` where there is nothing.
    pub(super) fn verdict(&self, cell: Cell, plane: &GroundPlane) -> Option<Verdict> {
        self.heights.get(cell)?.verdict(plane, self.thresholds())
    }

    /// Whether glass decides what the cell is.
    pub(super) fn is_glass(&self, cell: Cell, plane: &GroundPlane) -> bool {
        let glass = self.heights_with_glass.as_ref();
        let with = glass.and_then(|heights| heights.get(cell));
        let with = with.and_then(|cell| cell.verdict(plane, self.thresholds()));
        with.is_some_and(|with| {
            let without = self.verdict(cell, plane);
            without.is_none_or(|without| without.is_obstacle != with.is_obstacle)
        })
    }

    /// The cell that a point, metres, lies in.
    pub(super) fn cell_at(&self, point_m: [f64; 2]) -> Cell {
        point_m.map(|m| libm::floor(m / self.cell_m()) as i64)
    }

    /// Centre of a cell, metres.
    pub(super) fn centre_m(&self, cell: Cell) -> [f64; 2] {
        cell.map(|n| (n as f64 + 0.5) * self.cell_m())
    }

    /// The solid called `name`.
    pub(super) fn solid(&self, name: &str) -> Result<&Solid, ExperimentError> {
        let found = self.world.solids().iter().find(|solid| solid.name == name);
        found.ok_or_else(|| {
            ExperimentError::Unsuitable(format!(
                "the world `{}` has no solid named `{name}`",
                self.world.name()
            ))
        })
    }
}

/// The rectangle around all places that the vehicle passes, `reach_m` to every side.
fn driven(world: &World, duration_s: f64, reach_m: f64) -> Bounds {
    let steps = (duration_s / PATH_STEP_S) as u32 + 1;
    let mut bounds = Bounds {
        min_m: [f64::INFINITY; 2],
        max_m: [f64::NEG_INFINITY; 2],
    };
    for time_s in (0..=steps).map(|step| f64::from(step) * PATH_STEP_S) {
        let at_m = world.path().planar_pose(time_s.min(duration_s)).position_m;
        for axis in 0..2 {
            bounds.min_m[axis] = bounds.min_m[axis].min(at_m[axis] - reach_m);
            bounds.max_m[axis] = bounds.max_m[axis].max(at_m[axis] + reach_m);
        }
    }
    bounds
}

/// Seconds of the run at a stamp.
pub(super) fn seconds(stamp: RobotTime) -> f64 {
    stamp.since(START).as_secs_f64()
}

/// The published obstacle map.
pub(super) fn obstacle_map(store: &TileStore) -> BTreeMap<Cell, CellClass> {
    let cells = known_cells(store, LayerId::Obstacle);
    cells.map(|(cell, code)| (cell, class_of(code))).collect()
}

/// What the code of a known cell of the obstacle layer says.
fn class_of(code: u16) -> CellClass {
    match code {
        0 => CellClass::Unknown,
        1 => CellClass::Free,
        _ => CellClass::Obstacle,
    }
}

/// A cell and the eight around it.
pub(super) fn around(cell: Cell) -> impl Iterator<Item = Cell> {
    (-1..=1).flat_map(move |dy| (-1..=1).map(move |dx| [cell[0] + dx, cell[1] + dy]))
}
