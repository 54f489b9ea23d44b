//! What the experiments of \[LOD\] share: a world, its truth, what the laser swept, and how maps are judged.

pub(super) mod agreement;
pub(super) mod sweep;

use std::collections::BTreeMap;

use anyhow::Context as _;
use nalgebra::{Point3, Vector3};
use protocol::layer::{LayerId, Scheme};
use protocol::tile_store::TileStore;

use super::pictures::{Picture, elevation, elevation_in, obstacle, store_of};
use super::run::{SimulatedRun, config_by, known_cells};
use super::session::Rules;
use super::truth::{self, Bounds, GroundPlane, HeightTruth, Thresholds, Verdict};
use edge::config::Config;
use edge::runtime::Pipeline;
use mapping::elevation::CellClass;
use measurement::time::RobotTime;
use simulation::solid::{Reflectivity, Shape, Solid};
use simulation::source::START;
use simulation::{Motion, SimulationOptions, World};

/// A cell by its index: cell (i, j) begins at (i, j) · `cell_m`.
pub(super) type Cell = [i64; 2];

/// A world, its vehicle's configuration, and the truth in cells of the elevation map.
pub(super) struct TerrainWorld {
    pub(super) world: World,
    pub(super) config: Config,
    rules: Rules,
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
    /// The built-in world `name` for at most `duration_s` of its path.
    pub(super) fn load(name: &str, duration_s: Option<f64>, rules: Rules) -> anyhow::Result<Self> {
        Self::new(World::load(name)?, duration_s, rules, &[])
    }

    /// The same of a world, its vehicle with `settings` (`key=value`).
    pub(super) fn new(
        world: World,
        duration_s: Option<f64>,
        rules: Rules,
        settings: &[&str],
    ) -> anyhow::Result<Self> {
        let config = config_by(&world, rules, settings)?;
        let whole_s = world.path().duration_s();
        let duration_s = duration_s.map_or(whole_s, |duration_s| duration_s.min(whole_s));
        let elevation = &config.mapping.elevation;
        let reach_m = (0.5 * f64::from(elevation.cells) + 2.0) * elevation.cell_m;
        let bounds = driven(&world, duration_s, reach_m);
        let heights = |glass| truth::heights(&world, elevation.cell_m, bounds, glass);
        let is_glass = |solid: &Solid| matches!(solid.reflectivity, Reflectivity::Glass { .. });
        let has_glass = world.solids().iter().any(is_glass);
        let heights_with_glass = has_glass.then(|| heights(true)).transpose()?;
        Ok(Self {
            heights: heights(false)?,
            heights_with_glass,
            duration_s,
            config,
            rules,
            settings: settings.iter().map(|&setting| setting.to_owned()).collect(),
            world,
        })
    }

    /// The vehicle's configuration with `settings` (`key=value`) over it.
    pub(super) fn config_with(&self, settings: &[&str]) -> anyhow::Result<Config> {
        let own = self.settings.iter().map(String::as_str);
        let settings: Vec<&str> = own.chain(settings.iter().copied()).collect();
        config_by(&self.world, self.rules, &settings)
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
    pub(super) fn run(&self, seed: u64, encoder_error: f64) -> anyhow::Result<SimulatedRun> {
        let options = SimulationOptions {
            seed,
            duration_s: Some(self.duration_s),
            encoder_error: Some(encoder_error),
            ..SimulationOptions::default()
        };
        SimulatedRun::new(&self.world, options, &self.config)
    }

    /// The same drive without any error: what the laser truly meets.
    pub(super) fn errorless_run(&self) -> anyhow::Result<SimulatedRun> {
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
        let config = self.config_with(&["localization.source=tf"])?;
        SimulatedRun::new(&self.world, options, &config)
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

    /// Whether a cell is ground to a vehicle on `surface`.
    pub(super) fn is_drivable(&self, cell: Cell, surface: &GroundPlane) -> bool {
        let verdict = self.verdict(cell, surface);
        verdict.is_some_and(|verdict| !verdict.is_obstacle && verdict.margin_m > agreement::ASIDE_M)
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
    pub(super) fn solid(&self, name: &str) -> anyhow::Result<&Solid> {
        let found = self.world.solids().iter().find(|solid| solid.name == name);
        found.with_context(|| {
            let world = self.world.name();
            format!("the world `{world}` has no solid named `{name}`")
        })
    }
}

/// The text of a world with each first text, which is in it once, replaced by the second.
pub(super) fn changed(text: &str, changes: &[(&str, &str)]) -> anyhow::Result<String> {
    let mut text = text.to_owned();
    for (from, to) in changes {
        let found = text.matches(from).count();
        anyhow::ensure!(found == 1, "the world has {found} times: {from}");
        text = text.replace(from, to);
    }
    Ok(text)
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

/// How far in front of a surface a map may show it, metres: noise, and half a cell.
const BEFORE_M: f64 = 0.15;

/// Least and greatest coordinate of a solid along an axis of the world, metres.
pub(super) fn extent_m(solid: &Solid, axis: usize) -> [f64; 2] {
    let centre_m = solid.world_from_solid.translation.vector[axis];
    let half_m = match solid.shape {
        Shape::Box { size_m } => {
            let rotation = solid.world_from_solid.rotation.to_rotation_matrix();
            (0..3)
                .map(|along| 0.5 * (rotation[(axis, along)] * size_m[along]).abs())
                .sum()
        }
        Shape::Cylinder { radius_m, .. } | Shape::Sphere { radius_m } => radius_m,
        Shape::Plane | Shape::Mesh(_) => f64::INFINITY,
    };
    [centre_m - half_m, centre_m + half_m]
}

/// Middle of the first obstacle cell along x that shows the front of a solid at most `late_m` behind where it
/// is, metres.
pub(super) fn front_m(
    world: &TerrainWorld,
    map: &BTreeMap<Cell, CellClass>,
    solid: &Solid,
    late_m: f64,
) -> Option<f64> {
    let front_m = extent_m(solid, 0)[0];
    let [right_m, left_m] = extent_m(solid, 1);
    let first = world.cell_at([front_m - BEFORE_M, right_m]);
    let last = world.cell_at([front_m + late_m, left_m]);
    let mut columns = first[0]..=last[0];
    let column = columns
        .find(|&x| (first[1]..=last[1]).any(|y| map.get(&[x, y]) == Some(&CellClass::Obstacle)));
    column.map(|x| world.centre_m([x, 0])[0])
}

/// For every column of cells, the row of the first obstacle cell along y (`sign` 1) or against it (−1) that
/// shows a wall along x whose face is at `face_m`; columns where something else stands before the wall are
/// left out.
pub(super) fn faces(
    world: &TerrainWorld,
    map: &BTreeMap<Cell, CellClass>,
    plane: &GroundPlane,
    face_m: f64,
    sign: i64,
) -> BTreeMap<i64, i64> {
    let face = world.cell_at([0.0, face_m])[1];
    let is_bare = |x: i64| {
        let before = (1..=FACE_CELLS).map(|n| [x, face - sign * n]);
        before
            .filter_map(|cell| world.verdict(cell, plane))
            .all(|verdict| !verdict.is_obstacle)
    };
    let mut faces: BTreeMap<i64, i64> = BTreeMap::new();
    for (&[x, y], class) in map {
        let is_near = (y - face).abs() <= FACE_CELLS;
        if is_near && *class == CellClass::Obstacle && is_bare(x) {
            let nearest = faces.entry(x).or_insert(y);
            if (y - *nearest) * sign < 0 {
                *nearest = y;
            }
        }
    }
    faces
}

/// How far from its true place a wall is looked for, cells.
const FACE_CELLS: i64 = 2;

/// The world as it truly is, seen from above: the greatest height in every cell above `plane`.
pub(super) fn world_from_above(
    world: &TerrainWorld,
    plane: &GroundPlane,
    name: &str,
) -> anyhow::Result<Vec<Picture>> {
    let quantisation = LayerId::Elevation.quantisation();
    let cells = world.heights().iter().map(|(cell, heights)| {
        let top = heights.corners_m.iter().map(|&point| plane.height_m(point));
        let top_m = top.fold(f64::NEG_INFINITY, f64::max);
        (cell, quantisation.encode(top_m as f32))
    });
    let store = store_of(LayerId::Elevation, world.cell_m(), cells)?;
    let caption = format!("{}, the truth from above", world.world.name());
    let picture = Picture::of_layer(&store, elevation(), None, name, &caption)?;
    Ok(picture.into_iter().collect())
}

/// Elevation and obstacles as published, the former in the document's colours.
pub(super) fn maps(pipeline: &Pipeline, name: &str, caption: &str) -> anyhow::Result<Vec<Picture>> {
    maps_in(Scheme::GroundPlane, pipeline, name, caption)
}

/// The same in other colours of heights.
pub(super) fn maps_in(
    heights: Scheme,
    pipeline: &Pipeline,
    name: &str,
    caption: &str,
) -> anyhow::Result<Vec<Picture>> {
    let vehicle = pipeline.mapper().vehicle_in_odom();
    let store = pipeline.publisher().store();
    let mut pictures = Vec::new();
    for palette in [elevation_in(heights), obstacle()] {
        let layer = palette.layer();
        if store.cell_m(layer).is_some() {
            let name = format!("{name}-{layer}");
            let vehicle_m = Some([vehicle.x, vehicle.y]);
            let picture = Picture::of_layer(&store, palette, vehicle_m, &name, caption)?;
            pictures.extend(picture);
        }
    }
    Ok(pictures)
}

/// Elevation alone, in the colours that everybody can tell apart.
pub(super) fn elevation_of(
    pipeline: &Pipeline,
    name: &str,
    caption: &str,
) -> anyhow::Result<Vec<Picture>> {
    let vehicle = pipeline.mapper().vehicle_in_odom();
    let store = pipeline.publisher().store();
    let vehicle_m = Some([vehicle.x, vehicle.y]);
    let name = format!("{name}-heights");
    let picture = Picture::of_layer(&store, elevation(), vehicle_m, &name, caption)?;
    Ok(picture.into_iter().collect())
}
