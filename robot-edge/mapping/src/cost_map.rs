//! Slope cost map (docs/methods.md, section 4): a window of columns around the vehicle, updated
//! where voxels have changed.
//!
//! A tile of columns depends on its own voxels, its slopes on the columns up to three around it,
//! its rigidity on the voxels up to two around it. Therefore three windows are nested, each one
//! tile smaller on every side. A published cell does not depend on the position of the window when
//! it was computed.

use nalgebra::Point3;
use rayon::prelude::*;
use serde::Deserialize;

use crate::grid::{CellIndex, VoxelIndex};
use crate::height_columns::{
    Column, ColumnKind, ColumnRules, ColumnTile, ColumnWindow, TILE_COLUMNS, WindowPart,
    read_columns, surface_m,
};
use crate::octree::{BrickColumn, Octree, SurfaceVoxel, VoxelState};
use crate::rigidity::{ObstacleVoxel, Rigidity, RigidityConfig, RigidityMap, RigidityRule};
use crate::slope::{Beach, greatest_differences, slopes};
use crate::vehicle::VehicleShape;

/// Settings of `[mapping.cost]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CostConfig {
    /// Requires the octree.
    pub enabled: bool,
    /// Side of the box, metres (\[HYB\] §5.1: 40 on land, 160 on water).
    pub box_m: f64,
    /// Extent of the box below and above the vehicle, metres.
    pub box_half_height_m: f64,
    /// Slope of cost 1, degrees (\[HYB\] §5.1: 45 on land, 30 for docking).
    pub critical_slope_deg: f64,
    /// How the slope of a column is measured.
    pub slope: SlopeRule,
    /// Surface that the vehicle moves on.
    pub surface: Surface,
    /// Period of updates in time of the data, seconds.
    pub period_s: f64,
}

/// Surface that a vehicle moves on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Surface {
    /// Ground that beams hit.
    Land,
    /// Water, which returns no laser beam.
    Water,
}

/// How the slope of a column is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SlopeRule {
    /// That of a plane through the hits around it, where one fits; else as `Difference`.
    Plane,
    /// The greatest difference of levels in the 7×7 columns around it (\[HYB\] §5.1, equations 5.1
    /// and 5.2).
    Difference,
}

impl Default for CostConfig {
    fn default() -> Self {
        Self {
            enabled: false,
            box_m: 40.0,
            box_half_height_m: 4.0,
            critical_slope_deg: 45.0,
            slope: SlopeRule::Plane,
            surface: Surface::Land,
            period_s: 0.2,
        }
    }
}

/// Fewest tiles per thread.
const MIN_SHARE: usize = 64;
/// Tiles that are read before their columns are compared: 360 kB, which stay in the cache and need no new memory for each scan.
const READ_AT_ONCE: usize = 512;

/// Cell of the cost map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostCell {
    /// 0 is flat ground or clear water, 1 lethal, NaN unknown.
    pub cost: f32,
    /// Rigidity of the obstacle in the column; unlabelled without obstacle or without metrics.
    pub rigidity: Rigidity,
    /// Water without an obstacle.
    pub is_clear_water: bool,
    /// On water: the hits are above the water level.
    pub rises_from_water: bool,
    /// Greatest `IntraScan` of the occupied voxels above the ground, no higher than the vehicle: one
    /// wide voxel makes a column rigid. Without such voxels that of the ground, as the figures of
    /// \[HYB\] §8.3 have every hit. NaN without a value.
    pub intra: f32,
    /// The least `InterScan`, likewise.
    pub inter: f32,
}

impl CostCell {
    /// Without information.
    pub const UNKNOWN: Self = Self {
        cost: f32::NAN,
        rigidity: Rigidity::Unlabelled,
        is_clear_water: false,
        rises_from_water: false,
        intra: f32::NAN,
        inter: f32::NAN,
    };

    /// Whether the published values differ.
    pub(super) fn differs(self, other: Self) -> bool {
        let bits = |cell: Self| [cell.cost, cell.intra, cell.inter].map(f32::to_bits);
        bits(self) != bits(other) || self.rigidity != other.rigidity
    }
}

/// The slope cost map of one vehicle.
#[derive(Clone, Debug)]
pub struct CostMap {
    config: CostConfig,
    rigidity: RigidityConfig,
    vehicle: VehicleShape,
    cell_m: f64,
    /// Cells have the metrics of their deciding voxels.
    maps_metrics: bool,
    threads: usize,
    steepest: f32,
    window: ColumnWindow,
    rules: Option<ColumnRules>,
    changed: Vec<(CellIndex, CostCell)>,
}

impl CostMap {
    /// An empty map; the settings must be valid. Where `maps_metrics`, its cells have `intra` and `inter`. The map does
    /// not depend on `threads`.
    pub fn new(
        config: &CostConfig,
        rigidity: &RigidityConfig,
        vehicle: VehicleShape,
        (cell_m, maps_metrics): (f64, bool),
        threads: usize,
    ) -> Self {
        Self {
            config: config.clone(),
            rigidity: rigidity.clone(),
            vehicle,
            cell_m,
            maps_metrics,
            threads,
            steepest: libm::tan(config.critical_slope_deg.to_radians()) as f32,
            window: ColumnWindow::new(config.box_m, cell_m),
            rules: None,
            changed: Vec::new(),
        }
    }

    /// Updates the map from the octree, around the vehicle's position.
    pub fn update(&mut self, octree: &mut Octree, vehicle_in_odom: Point3<f64>) {
        let rules = self.rules_at(vehicle_in_odom.z);
        let changed = octree.take_changed_in(rules.from_z..=rules.highest_z());
        let octree = &*octree;
        self.window
            .center_on(VoxelIndex::containing(vehicle_in_odom, self.cell_m).column());
        if self.rules.replace(rules) != Some(rules) {
            self.window.invalidate();
        }
        for at in changed {
            self.window.mark_stale(at);
        }
        let read = self.window.tiles_to_read();
        // Most changes of a scan are free voxels that change no column.
        let mut changed = Vec::new();
        for part in read.chunks(READ_AT_ONCE) {
            let columns = self.for_each(part, |at| read_columns(octree, at, &rules));
            for (&at, columns) in part.iter().zip(columns) {
                if self.window.set_columns(at, &columns) {
                    changed.push(at);
                }
            }
        }
        let sloped = self.window.tiles_without_slopes(&changed);
        let beach = self.beach(&rules);
        let costs = self.for_each(&sloped, |at| self.costs(at, beach.as_ref()));
        // Rigidity may have changed without a change of levels.
        changed.extend(read);
        for (&at, costs) in sloped.iter().zip(costs) {
            if self.window.set_costs(at, costs) {
                changed.push(at);
            }
        }
        if self.rigidity.enabled {
            changed = self.window.around(&changed);
        }
        let to_classify = self.window.tiles_to_classify(&changed);
        self.classify(octree, &to_classify, &rules);
    }

    /// Cells changed since the last call; a later entry of the same cell replaces an earlier one.
    pub fn take_changed(&mut self) -> Vec<(CellIndex, CostCell)> {
        std::mem::take(&mut self.changed)
    }

    /// Erases the map and its untaken changes.
    pub fn erase(&mut self) {
        self.window.clear();
        self.rules = None;
        self.changed.clear();
    }

    /// A cell; `None` outside of the window.
    pub fn cell(&self, cell: CellIndex) -> Option<CostCell> {
        self.window.cell(cell)
    }

    /// Replaces `into` by what `of` makes of the cells of the window, row by row, none before the first update: least cell,
    /// cells per row.
    pub fn cells<T>(&self, into: &mut Vec<T>, of: impl Fn(&CostCell) -> T) -> (CellIndex, usize) {
        self.window.cells(into, of)
    }

    /// Voxels of obstacles in lethal columns of the whole window.
    pub fn obstacle_voxels(&self, octree: &Octree) -> Vec<ObstacleVoxel> {
        let tiles: Vec<_> = self.window.tiles(WindowPart::Classified).collect();
        let found = |rules| self.obstacles_in(octree, &tiles, rules);
        self.rules.as_ref().map(found).unwrap_or_default()
    }

    /// Whether its cells have metrics.
    pub const fn maps_metrics(&self) -> bool {
        self.maps_metrics
    }

    /// Whether rigidity is enabled.
    pub const fn classifies_rigidity(&self) -> bool {
        self.rigidity.enabled
    }

    /// Memory, bytes.
    pub fn bytes(&self) -> usize {
        self.window.bytes()
    }

    /// Applies `of` to each tile, in order.
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
        let (window, cell_m) = (&self.window, self.cell_m as f32);
        let slopes = match (self.config.slope, beach) {
            (SlopeRule::Plane, None) => slopes(&window.patch_without_pits(at), cell_m, None),
            (SlopeRule::Plane, Some(_)) => slopes(&window.patch(at), cell_m, beach),
            (SlopeRule::Difference, _) => greatest_differences(&window.patch(at)),
        };
        slopes.map(cost)
    }

    /// Levels for a vehicle at height `z_m`; the previous ones unless the vehicle has moved away
    /// from them.
    fn rules_at(&self, z_m: f64) -> ColumnRules {
        let voxels = |metres: f64| libm::ceil(metres / self.cell_m - 1e-9) as i32;
        let height = voxels(self.vehicle.height_m).max(1);
        match self.config.surface {
            Surface::Land => {
                let reach = voxels(self.config.box_half_height_m);
                let z = libm::floor(z_m / self.cell_m) as i32;
                // The box moves in steps of an eighth of its height, because each step rereads all
                // columns.
                let step = (reach / 4).max(1);
                let middle = self.rules.map(|rules| rules.from_z + reach);
                let middle = middle.filter(|middle| (z - middle).abs() <= step);
                let from_z = middle.unwrap_or(z) - reach;
                // A deck that the vehicle passes below is higher above it than it is high.
                let decks = z + height - 1..=z + height;
                let deck_z = self.rules.map(|rules| rules.deck_z);
                let deck_z = deck_z.filter(|deck_z| decks.contains(deck_z));
                ColumnRules {
                    surface: Surface::Land,
                    from_z,
                    to_z: from_z + 2 * reach,
                    deck_z: deck_z.unwrap_or(z + height - 1),
                    water_z: from_z,
                    height,
                }
            }
            Surface::Water => {
                // A boat heaves: the level is kept until it is three quarters of a voxel off.
                let level = (z_m + self.vehicle.bottom_z_m) / self.cell_m;
                let is_held =
                    |rules: &ColumnRules| (level - f64::from(rules.from_z) - 0.5).abs() <= 1.25;
                self.rules.filter(is_held).unwrap_or_else(|| {
                    let from_z = libm::floor(level) as i32;
                    ColumnRules {
                        surface: Surface::Water,
                        from_z,
                        to_z: from_z,
                        deck_z: from_z,
                        // The upper one of the two voxels between which the boat heaves.
                        water_z: libm::floor(z_m / self.cell_m + 0.5) as i32,
                        height,
                    }
                })
            }
        }
    }

    /// Slopes beside water that a hull can lie on: they rise out of the water within twice the
    /// boat's length.
    fn beach(&self, rules: &ColumnRules) -> Option<Beach> {
        match rules.surface {
            Surface::Land => None,
            Surface::Water => Some(Beach {
                water_m: self.water_m(rules),
                reach_m: (2.0 * self.vehicle.length_m) as f32,
            }),
        }
    }

    /// Water level, z of `odom`, metres; valid on water only.
    fn water_m(&self, rules: &ColumnRules) -> f32 {
        ((f64::from(rules.water_z) + 0.5) * self.cell_m) as f32
    }

    /// Computes and publishes the cells of tiles.
    fn classify(&mut self, octree: &Octree, to_classify: &[BrickColumn], rules: &ColumnRules) {
        let mut verdicts = Vec::new();
        if self.rigidity.enabled {
            let voxels = self.obstacles_in(octree, &self.window.around(to_classify), rules);
            verdicts = RigidityMap::of(&voxels, &self.rigidity).columns;
        }
        for part in to_classify.chunks(READ_AT_ONCE) {
            let cells = self.for_each(part, |at| self.cells_of(octree, at, rules, &verdicts));
            for (&at, cells) in part.iter().zip(cells) {
                if let Some(cells) = cells {
                    self.window.publish(at, &cells, &mut self.changed);
                }
            }
        }
    }

    /// The cells of a tile; `verdicts` are ascending.
    fn cells_of(
        &self,
        octree: &Octree,
        at: BrickColumn,
        rules: &ColumnRules,
        verdicts: &[(CellIndex, Rigidity)],
    ) -> Option<[CostCell; TILE_COLUMNS]> {
        let tile = self.window.tile(at)?;
        let water_m = self.water_m(rules);
        Some(std::array::from_fn(|column| {
            let cell = ColumnTile::cell_of(at, column);
            let found = verdicts.binary_search_by_key(&cell, |&(cell, _)| cell);
            let rigidity = found.map_or(Rigidity::Unlabelled, |place| verdicts[place].1);
            let read = &tile.columns[column];
            let [intra, inter] = if self.maps_metrics {
                metrics(octree, cell, read)
            } else {
                [f32::NAN; 2]
            };
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
                intra,
                inter,
            }
        }))
    }

    /// The occupied voxels above ground of the lethal columns of tiles.
    fn obstacles_in(
        &self,
        octree: &Octree,
        tiles: &[BrickColumn],
        rules: &ColumnRules,
    ) -> Vec<ObstacleVoxel> {
        self.for_each(tiles, |at| self.obstacles(octree, at, rules))
            .concat()
    }

    fn obstacles(
        &self,
        octree: &Octree,
        at: BrickColumn,
        rules: &ColumnRules,
    ) -> Vec<ObstacleVoxel> {
        let mut voxels = Vec::new();
        let Some(tile) = self.window.tile(at) else {
            return voxels;
        };
        let is_lethal = |column: usize| tile.costs[column] >= 1.0;
        let lethal = (0..TILE_COLUMNS).filter(|&column| is_lethal(column));
        let lethal = lethal.fold(0_u16, |bits, column| bits | 1 << column);
        if lethal == 0 {
            return voxels;
        }
        let around = self.window.patch(at);
        let around = around
            .iter()
            .filter(|column| column.kind != ColumnKind::Unknown);
        let lowest_m = around
            .map(|column| column.ground_m[2])
            .fold(f32::INFINITY, f32::min);
        let cell_m = self.cell_m as f32;
        // Noise carries hits on the ground into the voxel above it.
        let is_ground =
            |height_m: f32, column: &Column| height_m - column.ground_m[2] < 0.5 * cell_m;
        // Where the lowest voxel of a column is the top of an obstacle, nothing is above it: its highest voxel, as noise spreads the
        // top over two.
        let is_top = |z: i32, column: &Column| {
            rules.surface == Surface::Land
                && z == column.top_z
                && is_ground(column.top_m[2], column)
                && column.ground_m[2] - lowest_m > cell_m
        };
        for layers in octree.columns(at, rules.from_z, rules.highest_z()) {
            for (z, occupied) in (layers.z..).zip(layers.occupied) {
                for column in
                    (0..TILE_COLUMNS).filter(|column| (occupied & lethal) >> column & 1 == 1)
                {
                    let read = &tile.columns[column];
                    if (read.ground_z..=read.ground_z + rules.height).contains(&z) {
                        let CellIndex { x, y } = ColumnTile::cell_of(at, column);
                        let voxel = VoxelIndex { x, y, z };
                        let is_on_ground = match rules.surface {
                            Surface::Land => is_ground(surface_m(octree, voxel)[2], read),
                            Surface::Water => z == read.ground_z,
                        };
                        if is_on_ground && !is_top(z, read) {
                            continue;
                        }
                        let surface = octree.surface(voxel);
                        // Beams graze a top, and what they meet of it is narrow: only a wide one says what it is.
                        let says = |width: &f32| {
                            !is_on_ground
                                || self.rigidity.rule == RigidityRule::Metrics
                                || f64::from(*width) > self.rigidity.rigid_above()
                        };
                        voxels.push(ObstacleVoxel {
                            voxel,
                            intra: surface.and_then(SurfaceVoxel::intra).filter(says),
                            inter: surface.and_then(SurfaceVoxel::inter),
                        });
                    }
                }
            }
        }
        voxels
    }
}

/// [`CostCell::intra`] and [`CostCell::inter`] of a column.
fn metrics(octree: &Octree, CellIndex { x, y }: CellIndex, column: &Column) -> [f32; 2] {
    let deciding = match column.kind {
        ColumnKind::Unknown => return [f32::NAN; 2],
        _ if column.top_z > column.ground_z => column.ground_z + 1..=column.top_z,
        // Its ground was not hit.
        ColumnKind::Inferred | ColumnKind::Water | ColumnKind::Occluded => return [f32::NAN; 2],
        ColumnKind::Sampled | ColumnKind::Bank => column.ground_z..=column.ground_z,
    };
    let occupied = deciding.map(|z| VoxelIndex { x, y, z });
    let occupied = occupied.filter(|voxel| octree.state(*voxel) == VoxelState::Occupied);
    let surfaces = occupied.filter_map(|voxel| octree.surface(voxel));
    surfaces.fold([f32::NAN; 2], |[intra, inter], surface| {
        // A number is greater and less than not-a-number.
        [
            intra.max(surface.intra().unwrap_or(f32::NAN)),
            inter.min(surface.inter().unwrap_or(f32::NAN)),
        ]
    })
}

#[cfg(test)]
mod tests;
