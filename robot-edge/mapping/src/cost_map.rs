//! The slope cost map: a window of columns around the vehicle, read anew only where voxels have changed.
//!
//! What a tile of columns is depends on its voxels alone, its slopes on the columns up to three around it, what is
//! rigid there on the voxels up to two around it. So three windows lie in each other, each a tile smaller on every
//! side: what is told of a cell does not depend on where the edge was when it was computed, and the map is always
//! the one that would be computed from nothing.

use nalgebra::Point3;
use rayon::prelude::*;

use super::column_window::{ColumnTile, ColumnWindow, WindowPart};
use super::cost_config::{CostConfig, RigidityConfig, Surface};
use super::grid::CellIndex;
use super::height_columns::{ColumnKind, ColumnRules, TILE_COLUMNS, read_columns};
use super::obstacle_voxel::{ObstacleVoxel, Rigidity};
use super::octree::{BrickColumn, Octree, SurfaceVoxel};
use super::rigidity::RigidityMap;
use super::slope::{Beach, slopes};
use super::vehicle::VehicleShape;
use super::voxel::VoxelIndex;

/// Fewest tiles that are worth a thread of their own.
const MIN_SHARE: usize = 64;

/// A cell of the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostCell {
    /// 0 is flat or clear, 1 lethal; not a number where unknown.
    pub cost: f32,
    /// Of what makes the column lethal; unlabelled where nothing does, or nobody can say.
    pub rigidity: Rigidity,
    /// Water without an obstacle.
    pub is_clear_water: bool,
    /// On water: what was hit there is higher than the water.
    pub rises_from_water: bool,
}

impl CostCell {
    /// Nothing is known.
    pub const UNKNOWN: Self = Self {
        cost: f32::NAN,
        rigidity: Rigidity::Unlabelled,
        is_clear_water: false,
        rises_from_water: false,
    };

    /// Whether another one would look different.
    pub(super) fn differs(self, other: Self) -> bool {
        self.cost.to_bits() != other.cost.to_bits() || self.rigidity != other.rigidity
    }
}

/// The slope cost map of one vehicle.
#[derive(Clone, Debug)]
pub struct CostMap {
    config: CostConfig,
    rigidity: RigidityConfig,
    vehicle: VehicleShape,
    cell_m: f64,
    threads: usize,
    steepest: f32,
    window: ColumnWindow,
    rules: Option<ColumnRules>,
    changed: Vec<(CellIndex, CostCell)>,
}

impl CostMap {
    /// An empty map. The settings are taken as valid. It is the same map, bit for bit, whatever the number of
    /// `threads`.
    pub fn new(
        config: &CostConfig,
        rigidity: &RigidityConfig,
        vehicle: VehicleShape,
        cell_m: f64,
        threads: usize,
    ) -> Self {
        Self {
            config: config.clone(),
            rigidity: rigidity.clone(),
            vehicle,
            cell_m,
            threads,
            steepest: libm::tan(config.critical_slope_deg.to_radians()) as f32,
            window: ColumnWindow::new(config.box_m, cell_m),
            rules: None,
            changed: Vec::new(),
        }
    }

    /// Brings the map up to what the octree holds now, around a vehicle at a place in `odom`.
    pub fn update(&mut self, octree: &mut Octree, vehicle_in_odom: Point3<f64>) {
        let changed = octree.take_changed();
        let octree = &*octree;
        self.window
            .center_on(VoxelIndex::containing(vehicle_in_odom, self.cell_m).column());
        let rules = self.rules_at(vehicle_in_odom.z);
        if self.rules.replace(rules) != Some(rules) {
            self.window.invalidate();
        }
        for at in changed {
            self.window.mark_stale(at);
        }
        let read = self.window.tiles_to_read();
        let columns = self.for_each(&read, |at| read_columns(octree, at, &rules));
        // Most of what a scan changes is air that is none of a column's levels.
        let mut changed = Vec::new();
        for (&at, columns) in read.iter().zip(columns) {
            if self.window.set_columns(at, &columns) {
                changed.push(at);
            }
        }
        let sloped = self.window.tiles_without_slopes(&changed);
        let beach = self.beach(&rules);
        let costs = self.for_each(&sloped, |at| self.costs(at, beach.as_ref()));
        // What stands in the way may have become rigid where no level has changed.
        changed.extend(read);
        for (&at, costs) in sloped.iter().zip(costs) {
            if self.window.set_costs(at, costs) {
                changed.push(at);
            }
        }
        let to_classify = self.window.tiles_to_classify(&changed);
        self.classify(octree, &to_classify, &rules);
    }

    /// The cells that have changed since the last call; of the same cell the last one counts.
    pub fn take_changed(&mut self) -> Vec<(CellIndex, CostCell)> {
        std::mem::take(&mut self.changed)
    }

    /// Forgets everything; changes that nobody took are forgotten.
    pub fn erase(&mut self) {
        self.window.clear();
        self.rules = None;
        self.changed.clear();
    }

    /// A cell of the window.
    pub fn cell(&self, cell: CellIndex) -> Option<CostCell> {
        self.window.cell(cell)
    }

    /// The cells of the window, row by row, with the least cell and how many are in a row.
    pub fn cells(&self) -> (CellIndex, usize, Vec<CostCell>) {
        self.window.cells()
    }

    /// Every voxel of what makes columns lethal, in the whole window.
    pub fn obstacle_voxels(&self, octree: &Octree) -> Vec<ObstacleVoxel> {
        let mut voxels = Vec::new();
        if let Some(rules) = &self.rules {
            for at in self.window.tiles(WindowPart::Classified) {
                self.collect_obstacles(octree, at, rules, &mut voxels);
            }
        }
        voxels
    }

    /// Whether it tells what makes columns lethal apart.
    pub const fn classifies_rigidity(&self) -> bool {
        self.rigidity.enabled
    }

    /// Memory of the window, bytes.
    pub fn bytes(&self) -> usize {
        self.window.bytes()
    }

    /// What `of` gives for each tile, in order.
    fn for_each<T: Send>(
        &self,
        tiles: &[BrickColumn],
        of: impl Fn(BrickColumn) -> T + Sync,
    ) -> Vec<T> {
        if self.threads > 1 {
            tiles
                .par_iter()
                .with_min_len(MIN_SHARE)
                .map(|&at| of(at))
                .collect()
        } else {
            tiles.iter().map(|&at| of(at)).collect()
        }
    }

    fn costs(&self, at: BrickColumn, beach: Option<&Beach>) -> [f32; TILE_COLUMNS] {
        let cost = |slope: f32| (slope / self.steepest).clamp(0.0, 1.0); // NaN stays
        slopes(&self.window.patch(at), self.cell_m as f32, beach).map(cost)
    }

    /// Which levels count for a vehicle at a height: those of the last time, unless it has moved away from them.
    fn rules_at(&self, z_m: f64) -> ColumnRules {
        let voxels = |metres: f64| libm::ceil(metres / self.cell_m - 1e-9) as i32;
        let height = voxels(self.vehicle.height_m).max(1);
        match self.config.surface {
            Surface::Land => {
                let reach = voxels(self.config.box_half_height_m);
                let z = libm::floor(z_m / self.cell_m) as i32;
                // The box moves in steps of an eighth of itself: each one makes all columns be read anew.
                let step = (reach / 4).max(1);
                let middle = self.rules.map(|rules| rules.from_z + reach);
                let middle = middle.filter(|middle| (z - middle).abs() <= step);
                let from_z = middle.unwrap_or(z) - reach;
                ColumnRules {
                    surface: Surface::Land,
                    from_z,
                    to_z: from_z + 2 * reach,
                    water_z: from_z,
                    height,
                }
            }
            Surface::Water => {
                // A boat heaves: its waterline is where it was, unless it is three quarters of a voxel off.
                let level = (z_m + self.vehicle.bottom_z_m) / self.cell_m;
                let is_held =
                    |rules: &ColumnRules| (level - f64::from(rules.from_z) - 0.5).abs() <= 1.25;
                self.rules.filter(is_held).unwrap_or_else(|| {
                    let from_z = libm::floor(level) as i32;
                    ColumnRules {
                        surface: Surface::Water,
                        from_z,
                        to_z: from_z,
                        // The upper one of two that it may be in while the boat heaves.
                        water_z: libm::floor(z_m / self.cell_m + 0.5) as i32,
                        height,
                    }
                })
            }
        }
    }

    /// Which slopes beside water are land that a hull can lie on: those that come out of it no farther away than twice
    /// the boat's length. What lies higher or level is not where a boat gets to.
    fn beach(&self, rules: &ColumnRules) -> Option<Beach> {
        match rules.surface {
            Surface::Land => None,
            Surface::Water => Some(Beach {
                water_m: self.water_m(rules),
                reach_m: (2.0 * self.vehicle.length_m) as f32,
            }),
        }
    }

    /// How high the water stands, z of `odom`, metres; only on water.
    fn water_m(&self, rules: &ColumnRules) -> f32 {
        ((f64::from(rules.water_z) + 0.5) * self.cell_m) as f32
    }

    /// Decides what is told of the columns of tiles.
    fn classify(&mut self, octree: &Octree, to_classify: &[BrickColumn], rules: &ColumnRules) {
        let mut verdicts = Vec::new();
        if self.rigidity.enabled {
            let mut voxels = Vec::new();
            for at in self.window.around(to_classify) {
                self.collect_obstacles(octree, at, rules, &mut voxels);
            }
            verdicts = RigidityMap::of(&voxels, &self.rigidity).columns;
        }
        let water_m = self.water_m(rules);
        for &at in to_classify {
            let Some(tile) = self.window.tile(at) else {
                continue;
            };
            let cells = std::array::from_fn(|column| {
                let cell = ColumnTile::cell_of(at, column);
                let found = verdicts.binary_search_by_key(&cell, |&(cell, _)| cell);
                let rigidity = found.map_or(Rigidity::Unlabelled, |place| verdicts[place].1);
                let read = &tile.columns[column];
                CostCell {
                    cost: match rigidity {
                        Rigidity::Traversable => self.rigidity.traversable_vegetation_cost as f32,
                        Rigidity::Rigid | Rigidity::Unlabelled => tile.costs[column],
                    },
                    rigidity,
                    is_clear_water: read.kind == ColumnKind::Water && read.top_z <= read.ground_z,
                    rises_from_water: rules.surface == Surface::Water
                        && read.kind != ColumnKind::Unknown
                        && read.top_m[2] > water_m,
                }
            });
            self.window.publish(at, &cells, &mut self.changed);
        }
    }

    /// The occupied voxels above the ground of the lethal columns of a tile.
    fn collect_obstacles(
        &self,
        octree: &Octree,
        at: BrickColumn,
        rules: &ColumnRules,
        voxels: &mut Vec<ObstacleVoxel>,
    ) {
        let Some(tile) = self.window.tile(at) else {
            return;
        };
        let is_lethal = |column: usize| tile.costs[column] >= 1.0;
        let lethal = (0..TILE_COLUMNS).filter(|&column| is_lethal(column));
        let lethal = lethal.fold(0_u16, |bits, column| bits | 1 << column);
        if lethal == 0 {
            return;
        }
        for layers in octree.columns(at, rules.from_z, rules.highest_z()) {
            for (z, occupied) in (layers.z..).zip(layers.occupied) {
                for column in
                    (0..TILE_COLUMNS).filter(|column| (occupied & lethal) >> column & 1 == 1)
                {
                    let ground_z = tile.columns[column].ground_z;
                    if z > ground_z && z <= ground_z + rules.height {
                        let CellIndex { x, y } = ColumnTile::cell_of(at, column);
                        let voxel = VoxelIndex { x, y, z };
                        let surface = octree.surface(voxel);
                        voxels.push(ObstacleVoxel {
                            voxel,
                            intra: surface.and_then(SurfaceVoxel::intra),
                            inter: surface.and_then(SurfaceVoxel::inter),
                        });
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
