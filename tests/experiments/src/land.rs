//! What the experiments of \[HYB\] on land share: a world, its runs, its true ground, and what truly is in a column of voxels.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context as _, anyhow};
use nalgebra::{Point2, Point3};
use protocol::layer::LayerId;
use protocol::tile_store::TileStore;

use super::run::{SimulatedRun, config_by, known_cells};
use super::session::Rules;
use super::terrain::extent_m;
use super::truth::TerrainTruth;
use edge::config::Config;
use edge::runtime::Pipeline;
use mapping::cost_map::CostMap;
use mapping::octree::Octree;
use mapping::registered_scan::{BeamOutcome, RegisteredScan};
use simulation::scene::Scene;
use simulation::solid::Solid;
use simulation::vegetation::Rigidity;
use simulation::{SimulationOptions, World};

/// A cost map's value of everything that cannot be driven on.
pub(super) const LETHAL: f32 = 1.0;
/// Hits in a column by which the laser has met what stands there.
pub(super) const MIN_HITS: u32 = 3;
/// Codes of the rigidity layer.
pub(super) const TRAVERSABLE: u16 = 1;
pub(super) const RIGID: u16 = 2;

/// A column of voxels by its index: column (i, j) begins at (i, j) · `cell_m`.
pub(super) type Cell = [i64; 2];

/// A world that introbot drives through, and how introbot is set up.
pub(super) struct LandWorld {
    pub(super) world: World,
    pub(super) config: Config,
    rules: Rules,
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
    pub(super) fn load(name: &str, rules: Rules) -> anyhow::Result<Self> {
        Self::of(World::load(name)?, rules)
    }

    /// Another world.
    pub(super) fn of(world: World, rules: Rules) -> anyhow::Result<Self> {
        let config = config_by(&world, rules, &[])?;
        Ok(Self {
            world,
            config,
            rules,
        })
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
    pub(super) fn run(&self, seed: u64) -> anyhow::Result<SimulatedRun> {
        self.run_with(seed, SimulationOptions::default(), &[])
    }

    /// The same with options of the simulation and settings (`key=value`) over introbot's configuration.
    pub(super) fn run_with(
        &self,
        seed: u64,
        options: SimulationOptions,
        settings: &[&str],
    ) -> anyhow::Result<SimulatedRun> {
        self.run_with_poses(seed, options, settings, Poses::Averaged)
    }

    /// The same with other errors of the poses.
    pub(super) fn run_with_poses(
        &self,
        seed: u64,
        options: SimulationOptions,
        settings: &[&str],
        poses: Poses,
    ) -> anyhow::Result<SimulatedRun> {
        let options = SimulationOptions { seed, ..options };
        let config = config_by(&self.world, self.rules, settings)?;
        let run = SimulatedRun::new(&self.world, options, &config)?;
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
    pub(super) fn unsuitable(&self, why: &str) -> anyhow::Error {
        anyhow!("the world `{}` {why}", self.world.name())
    }
}

/// The octree of a run and the cost map made of it.
pub(super) fn octree_and_cost(pipeline: &Pipeline) -> anyhow::Result<(&Octree, &CostMap)> {
    let voxels = pipeline.mapper().voxels();
    let voxels = voxels.context("no octree is mapped")?;
    let cost = voxels.cost().context("no slope cost is mapped")?;
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

/// Columns around one whose slope it shares, each way [HYB 5.1].
pub(super) const REACH: i64 = 3;
/// Farthest that the ground of a plane is from it, metres: what rounded heights of a world file make of one.
const PLANE_M: f64 = 0.002;

/// The ground over a rectangle of columns.
pub(super) struct Ground<'a> {
    standing: TerrainTruth<'a>,
    cell_m: f64,
    vehicle_height_m: f64,
    first: Cell,
    /// Columns along x and y.
    size: [usize; 2],
    /// Heights of the columns' corners, rows of growing y, one more than there are columns; not-a-number where
    /// there is no ground.
    corners_m: Vec<f64>,
}

impl<'a> Ground<'a> {
    /// Of the columns that a rectangle touches, metres.
    pub(super) fn of(world: &'a LandWorld, [min_m, max_m]: [[f64; 2]; 2]) -> anyhow::Result<Self> {
        let standing = TerrainTruth::of(&world.world);
        let (first, last) = (world.cell_at(min_m), world.cell_at(max_m));
        let size = [0, 1].map(|axis| usize::try_from(last[axis] - first[axis] + 1).unwrap_or(0));
        if size[0].saturating_mul(size[1]) > MAX_COLUMNS {
            return Err(world.unsuitable("is too large"));
        }
        let cell_m = world.cell_m();
        let corner = |place: usize| {
            let at = [place % (size[0] + 1), place / (size[0] + 1)];
            let [x, y] = [0, 1].map(|axis| (first[axis] + signed(at[axis])) as f64 * cell_m);
            standing.ground_m(Point2::new(x, y)).unwrap_or(f64::NAN)
        };
        let corners_m = (0..(size[0] + 1) * (size[1] + 1)).map(corner).collect();
        Ok(Self {
            vehicle_height_m: world.vehicle_height_m(),
            standing,
            cell_m,
            first,
            size,
            corners_m,
        })
    }

    /// The first of the columns and the last.
    pub(super) fn corners(&self) -> [Cell; 2] {
        let last = [0, 1].map(|axis| self.first[axis] + signed(self.size[axis]) - 1);
        [self.first, last]
    }

    /// The columns.
    pub(super) fn cells(&self) -> impl Iterator<Item = Cell> + use<> {
        let ([x, y], [width, height]) = (self.first, self.size);
        (0..signed(height)).flat_map(move |row| (0..signed(width)).map(move |n| [x + n, y + row]))
    }

    /// Height of the ground at a point, metres.
    pub(super) fn height_m(&self, at: Point2<f64>) -> Option<f64> {
        self.standing.ground_m(at)
    }

    /// Lowest and highest ground of a column, metres.
    pub(super) fn heights_m(&self, cell: Cell) -> Option<[f64; 2]> {
        let corners = [[0, 0], [1, 0], [0, 1], [1, 1]];
        let heights = corners.map(|[x, y]| self.corner_m([cell[0] + x, cell[1] + y]));
        let [mut low, mut high] = [f64::INFINITY, f64::NEG_INFINITY];
        for height_m in heights {
            low = low.min(height_m?);
            high = high.max(height_m?);
        }
        Some([low, high])
    }

    /// Rise over run of the ground where the columns that a slope is made of lie on one plane, and those beside
    /// them: noise carries hits over their edges.
    pub(super) fn slope(&self, cell: Cell) -> Option<f64> {
        let corner = |x: i64, y: i64| self.corner_m([cell[0] + x, cell[1] + y]);
        let (from, to) = (-REACH - 1, REACH + 2);
        let origin_m = corner(from, from)?;
        let per_cell = |end_m: f64| (end_m - origin_m) / (to - from) as f64;
        let (along_x, along_y) = (per_cell(corner(to, from)?), per_cell(corner(from, to)?));
        for y in from..=to {
            for x in from..=to {
                let plane_m = origin_m + along_x * (x - from) as f64 + along_y * (y - from) as f64;
                if (corner(x, y)? - plane_m).abs() > PLANE_M {
                    return None;
                }
            }
        }
        Some(libm::hypot(along_x, along_y) / self.cell_m)
    }

    /// What stands within `aside_m` of a column between two heights above its ground, metres; the ground's own
    /// unevenness is left out.
    pub(super) fn standing(&self, cell: Cell, aside_m: f64, above_m: [f64; 2]) -> Option<Rigidity> {
        let [low, high] = self.heights_m(cell)?;
        let [from_m, to_m] = above_m;
        let half_m = 0.5 * self.cell_m + aside_m;
        self.standing
            .class(self.centre_m(cell), half_m, low + from_m..high + to_m)
    }

    /// Whether the vehicle meets nothing within `aside_m` of a column.
    pub(super) fn is_bare(&self, cell: Cell, aside_m: f64) -> bool {
        let above_m = [BELOW_M, self.vehicle_height_m + MARGIN_M];
        self.heights_m(cell).is_some() && self.standing(cell, aside_m, above_m).is_none()
    }

    /// Δ of \[HYB\] §5.1 by exact geometry: from the lowest ground around up to the highest rigid thing of the
    /// column that is no higher than the vehicle.
    fn steepest(&self, cell: Cell) -> Option<f64> {
        let [_, high] = self.heights_m(cell)?;
        let above_m = [MARGIN_M, self.vehicle_height_m];
        let top_m = if self.standing(cell, 0.0, above_m) == Some(Rigidity::Rigid) {
            let centre = self.centre_m(cell);
            let parts = around([0, 0], 1).map(|part| {
                let [x, y] = part.map(|n| n as f64 * 0.3 * self.cell_m);
                let at = Point2::new(centre.x + x, centre.y + y);
                self.standing.rigid_top_m(at, self.vehicle_height_m)
            });
            parts.flatten().fold(high, f64::max)
        } else {
            high
        };
        let rise = |other: Cell| {
            let [low, _] = self.heights_m(other)?;
            let [x, y] = [0, 1].map(|axis| (other[axis] - cell[axis]) as f64 * self.cell_m);
            Some((top_m - low) / libm::hypot(x, y).max(self.cell_m))
        };
        around(cell, REACH).filter_map(rise).max_by(f64::total_cmp)
    }

    /// Whether the document's formula makes a column lethal.
    pub(super) fn is_steep(&self, cell: Cell) -> bool {
        self.steepest(cell).is_some_and(|steepest| steepest >= 1.0)
    }

    fn centre_m(&self, cell: Cell) -> Point2<f64> {
        let [x, y] = cell.map(|n| (n as f64 + 0.5) * self.cell_m);
        Point2::new(x, y)
    }

    fn corner_m(&self, corner: Cell) -> Option<f64> {
        let [x, y] = [0, 1].map(|axis| usize::try_from(corner[axis] - self.first[axis]).ok());
        let (x, y) = (x.filter(|x| *x <= self.size[0])?, y?);
        let height_m = self.corners_m.get(y * (self.size[0] + 1) + x).copied()?;
        (!height_m.is_nan()).then_some(height_m)
    }
}

/// What begins lower than its ground counts as standing on it, metres.
const BELOW_M: f64 = -0.05;
/// A voxel, metres: what is nearer than this to a bound may be taken for either.
const MARGIN_M: f64 = 0.1;
/// 400 m × 400 m in columns of 0.1 m.
const MAX_COLUMNS: usize = 1 << 24;

/// There are no more columns than [`MAX_COLUMNS`].
fn signed(n: usize) -> i64 {
    i64::try_from(n).unwrap_or(i64::MAX)
}

/// A hit that is no farther than this from the ground is on it, metres: ranges and attitudes are noisy.
pub(super) const ON_GROUND_M: f64 = 0.1;
/// What rises no higher than this above the ground may be taken for it, metres: one voxel and a half.
pub(super) const RAISED_M: f64 = 0.15;

/// How often a column was hit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct ColumnHits {
    /// On the ground.
    pub(super) ground: u32,
    /// Above it, no higher than the vehicle.
    pub(super) raised: u32,
}

/// Hits of all columns that have any.
#[derive(Default)]
pub(super) struct Hits {
    columns: BTreeMap<Cell, ColumnHits>,
}

impl Hits {
    /// Adds those of a scan as they were placed.
    pub(super) fn add(&mut self, world: &LandWorld, ground: &Ground<'_>, scan: &RegisteredScan) {
        let hits = scan
            .beams
            .iter()
            .filter(|beam| beam.outcome == BeamOutcome::Hit);
        for point in hits.map(|beam| beam.end_in_odom) {
            let Some(ground_m) = ground.height_m(point.xy()) else {
                continue;
            };
            let above_m = point.z - ground_m;
            let column = self
                .columns
                .entry(world.cell_at([point.x, point.y]))
                .or_default();
            if above_m.abs() <= ON_GROUND_M {
                column.ground += 1;
            } else if above_m > RAISED_M && above_m <= world.vehicle_height_m() {
                column.raised += 1;
            }
        }
    }

    /// Those of a column.
    pub(super) fn get(&self, cell: Cell) -> ColumnHits {
        self.columns.get(&cell).copied().unwrap_or_default()
    }
}

/// Columns of things.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Found {
    pub(super) seen: usize,
    pub(super) lethal: usize,
}

impl Found {
    pub(super) fn add(&mut self, is_lethal: bool) {
        self.seen += 1;
        self.lethal += usize::from(is_lethal);
    }

    pub(super) fn found_share(self) -> f64 {
        self.lethal as f64 / self.seen.max(1) as f64
    }
}

/// The columns in which a solid stands out from the ground, no higher than the vehicle.
pub(super) fn columns_of(world: &LandWorld, ground: &Ground<'_>, solid: &Solid) -> BTreeSet<Cell> {
    let (x, y) = (extent_m(solid, 0), extent_m(solid, 1));
    let (first, last) = (world.cell_at([x[0], y[0]]), world.cell_at([x[1], y[1]]));
    let [least, greatest] = ground.corners();
    let reach = |axis: usize| first[axis].max(least[axis])..=last[axis].min(greatest[axis]);
    let scene = Scene::new(std::slice::from_ref(solid));
    let cell_m = world.cell_m();
    let is_in = |cell: &Cell| {
        ground.heights_m(*cell).is_some_and(|[low, high]| {
            let corner = |offset: i64, z: f64| {
                let [x, y] = cell.map(|n| (n + offset) as f64 * cell_m);
                Point3::new(x, y, z)
            };
            let (min, max) = (
                corner(0, low + RAISED_M),
                corner(1, high + world.vehicle_height_m()),
            );
            scene.touches_box(min, max, 0.0)
        })
    };
    reach(1)
        .flat_map(|y| reach(0).map(move |x| [x, y]))
        .filter(is_in)
        .collect()
}
