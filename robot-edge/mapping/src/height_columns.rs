//! Height columns: ground and top of each column of the octree (docs/methods.md, section 4; \[HYB\]
//! §5.1), and the window of column tiles that moves with the vehicle.

use crate::cost_map::{CostCell, Surface};
use crate::grid::{CellIndex, VoxelIndex};
use crate::octree::{BrickColumn, Octree, SurfaceVoxel};
use crate::slope::{PATCH_EDGE, Patch, REACH, REACH_COLUMNS};

/// Columns along the edge of a tile, which is a column of bricks.
pub(super) const TILE_EDGE: usize = 4;
/// [`TILE_EDGE`] for signed indices.
pub(super) const TILE_EDGE_COLUMNS: i32 = 4;
pub(super) const TILE_COLUMNS: usize = 16;

/// Kind of a column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColumnKind {
    /// No known voxel in the relevant interval.
    #[default]
    Unknown,
    /// The ground was hit.
    Sampled,
    /// The lowest known voxel is free: the ground is at most just below it.
    Inferred,
    /// Water without an obstacle: observed through down to the surface.
    Water,
    /// On water: only observed above the surface, unknown below.
    Occluded,
    /// On water: hit, and nothing observed through below the hit; possibly land.
    Bank,
}

/// One column of voxels with its ground and top.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Column {
    /// Kind of the column.
    pub kind: ColumnKind,
    /// z of the ground's voxel.
    pub ground_z: i32,
    /// z of the highest occupied voxel within the vehicle's height; the ground's if there is none.
    pub top_z: i32,
    /// Position of the ground: x and y from the column's least corner, z of `odom`, metres.
    /// [`ColumnKind::Bank`]: the lowest hit. [`ColumnKind::Water`] and [`ColumnKind::Occluded`]:
    /// the upper side of the lowest voxel observed through, because a beam may have passed just
    /// below that side.
    pub ground_m: [f32; 3],
    /// Position of the top, as `ground_m`.
    pub top_m: [f32; 3],
    /// Radius of the smallest laser spot that hit the top, metres; 0 without a hit.
    pub top_spot_m: f32,
}

/// Levels for reading columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ColumnRules {
    /// Surface that the vehicle moves on.
    pub surface: Surface,
    /// Lowest voxel to read; on water that of the vehicle's lowest point.
    pub from_z: i32,
    /// Highest voxel that may be the ground.
    pub to_z: i32,
    /// Highest voxel of a deck, which is ground above ground; the vehicle passes below what is higher. Used on land only.
    pub deck_z: i32,
    /// Highest voxel of the water's surface; used on water only.
    pub water_z: i32,
    /// Height of the vehicle, voxels.
    pub height: i32,
}

impl ColumnRules {
    /// Highest voxel to read.
    pub const fn highest_z(&self) -> i32 {
        self.to_z + self.height
    }
}

/// Reads the sixteen columns of a column of bricks, rows of growing y (docs/methods.md, section 4,
/// ground level and obstacle level).
pub fn read_columns(
    octree: &Octree,
    at: BrickColumn,
    rules: &ColumnRules,
) -> [Column; TILE_COLUMNS] {
    let mut levels = match rules.surface {
        Surface::Land => Levels::new(u16::MAX, rules.from_z),
        Surface::Water => Levels::on_water(rules.from_z),
    };
    let highest = rules.highest_z();
    for layers in octree.columns(at, rules.from_z, highest) {
        if levels.are_found(layers.z, rules) {
            break;
        }
        for (n, (&known, &occupied)) in (0..).zip(layers.known.iter().zip(&layers.occupied)) {
            let z = layers.z + n;
            if (rules.from_z..=highest).contains(&z) {
                levels.add(z, known, occupied, rules);
            }
        }
    }
    std::array::from_fn(|column| {
        let (x, y) = offset(column);
        let at = |z| VoxelIndex {
            x: at.x * 4 + x,
            y: at.y * 4 + y,
            z,
        };
        match levels.kind(column, rules) {
            ColumnKind::Unknown => Column::default(),
            kind @ (ColumnKind::Sampled
            | ColumnKind::Inferred
            | ColumnKind::Water
            | ColumnKind::Occluded
            | ColumnKind::Bank) => {
                let (ground_z, top_z) = levels.levels(column);
                let lowest = levels.lowest_z[column];
                Column {
                    kind,
                    ground_z,
                    top_z,
                    ground_m: match kind {
                        ColumnKind::Bank => surface_m(octree, at(lowest)),
                        ColumnKind::Water | ColumnKind::Occluded => {
                            [0.5, 0.5, f64::from(lowest) + 1.0]
                                .map(|n| (n * octree.cell_m()) as f32)
                        }
                        ColumnKind::Unknown | ColumnKind::Sampled | ColumnKind::Inferred => {
                            surface_m(octree, at(ground_z))
                        }
                    },
                    top_m: surface_m(octree, at(top_z)),
                    top_spot_m: spot_m(octree, at(top_z)),
                }
            }
        }
    })
}

pub(super) fn offset(column: usize) -> (i32, i32) {
    let column = (column % TILE_COLUMNS) as u8;
    let edge = TILE_EDGE as u8;
    (i32::from(column % edge), i32::from(column / edge))
}

/// Mean position of the hits in a voxel, or its centre; x and y from its least corner.
pub(super) fn surface_m(octree: &Octree, voxel: VoxelIndex) -> [f32; 3] {
    let cell_m = octree.cell_m();
    let mean = octree
        .surface(voxel)
        .map_or([0.5; 3], |surface| surface.mean().into());
    let [x, y, z]: [f64; 3] = mean;
    [x, y, f64::from(voxel.z) + z].map(|voxels| (voxels * cell_m) as f32)
}

/// Radius of the smallest laser spot that hit a voxel, metres.
fn spot_m(octree: &Octree, voxel: VoxelIndex) -> f32 {
    let spot = octree.surface(voxel).map_or(0.0, SurfaceVoxel::spot);
    (spot * octree.cell_m()) as f32
}

/// Levels of sixteen columns while their layers are read upwards; bit sets have a bit per column.
struct Levels {
    /// Ground not yet found.
    pending: u16,
    /// Ground was hit.
    hit: u16,
    /// Known in the relevant interval.
    known: u16,
    /// On water: the lowest known voxel, or the one above it, was hit.
    bank: u16,
    /// On water: a voxel is known.
    begun: u16,
    /// On land: air was observed above the ground.
    air: u16,
    /// Air was observed in the last layer.
    air_below: u16,
    /// On land: a deck or the top of something solid was hit above the ground.
    deck: u16,
    /// No air was observed on the deck.
    closed: u16,
    /// There is air below the deck.
    hanging: u16,
    deck_z: [i32; TILE_COLUMNS],
    /// Highest ground of any column so far.
    highest_ground_z: i32,
    ground_z: [i32; TILE_COLUMNS],
    top_z: [i32; TILE_COLUMNS],
    /// On water: the lowest known voxel, or the next one if that was hit.
    lowest_z: [i32; TILE_COLUMNS],
}

impl Levels {
    const fn new(pending: u16, z: i32) -> Self {
        Self {
            pending,
            hit: 0,
            known: 0,
            bank: 0,
            begun: 0,
            air: 0,
            air_below: 0,
            deck: 0,
            closed: 0,
            hanging: 0,
            deck_z: [z; TILE_COLUMNS],
            highest_ground_z: z,
            ground_z: [z; TILE_COLUMNS],
            top_z: [z; TILE_COLUMNS],
            lowest_z: [z; TILE_COLUMNS],
        }
    }

    const fn on_water(z: i32) -> Self {
        Self::new(0, z)
    }

    /// Whether no layer from `z` upwards can change the levels; most layers are air above the
    /// vehicle.
    const fn are_found(&self, z: i32, rules: &ColumnRules) -> bool {
        let is_land = matches!(rules.surface, Surface::Land);
        let is_above = z > self.highest_ground_z + rules.height && z > rules.deck_z + AIR_GAP;
        is_land && self.pending == 0 && is_above
    }

    fn add(&mut self, z: i32, known: u16, occupied: u16, rules: &ColumnRules) {
        let found = if z <= rules.to_z {
            known & self.pending
        } else {
            0
        };
        for column in columns(found) {
            let is_hit = occupied >> column & 1 == 1;
            self.ground_z[column] = if is_hit { z } else { z - 1 };
            self.top_z[column] = self.ground_z[column];
            self.highest_ground_z = self.highest_ground_z.max(self.ground_z[column]);
        }
        self.pending &= !found;
        match rules.surface {
            Surface::Land => self.find_deck(z, known & !self.pending, occupied, rules),
            Surface::Water => self.find_lowest(z, known, occupied),
        }
        let reached = |ground_z: i32| z <= ground_z + rules.height;
        for column in columns(known & !self.pending) {
            if reached(self.ground_z[column]) {
                self.known |= 1 << column;
                if occupied >> column & 1 == 1 {
                    self.top_z[column] = z;
                    if z == self.ground_z[column] {
                        self.hit |= 1 << column;
                    }
                }
            }
        }
    }

    /// On land: the vehicle may be on what is higher above the lowest ground than it passes below, or on something solid on ground
    /// that is lower than the vehicle.
    fn find_deck(&mut self, z: i32, known: u16, occupied: u16, rules: &ColumnRules) {
        let air = known & !occupied;
        for column in columns(known & occupied) {
            let bit = 1 << column;
            let above = z - self.ground_z[column];
            let is_lower = self.ground_z[column] + rules.height < rules.deck_z;
            let is_solid = above > 1 && is_lower && self.air & bit == 0;
            if z <= rules.deck_z && (above > rules.height || is_solid || self.deck & bit != 0) {
                self.hanging |= bit & self.air_below & !self.deck;
                self.deck |= bit;
                self.closed |= bit;
                self.deck_z[column] = z;
            }
        }
        for column in columns(air & self.closed) {
            if z <= self.deck_z[column] + AIR_GAP {
                self.closed &= !(1 << column);
            }
        }
        self.air |= air;
        self.air_below = air;
    }

    /// Ground and top.
    const fn levels(&self, column: usize) -> (i32, i32) {
        if (self.deck & !self.closed) >> column & 1 == 1 {
            (self.deck_z[column], self.deck_z[column])
        } else {
            (self.ground_z[column], self.top_z[column])
        }
    }

    /// On a slope that beams graze, one beam may pass through the lower part of a column and
    /// another hit its upper part.
    fn find_lowest(&mut self, z: i32, known: u16, occupied: u16) {
        for column in columns(known) {
            let bit = 1 << column;
            let is_first = self.begun & bit == 0;
            if is_first {
                self.begun |= bit;
                self.lowest_z[column] = z;
            }
            let is_next = z == self.lowest_z[column] + 1 && self.bank & bit == 0;
            if occupied & bit != 0 && (is_first || is_next) {
                self.bank |= bit;
                self.lowest_z[column] = z;
            }
        }
    }

    const fn kind(&self, column: usize, rules: &ColumnRules) -> ColumnKind {
        let (is_known, is_hit) = (self.known >> column & 1 == 1, self.hit >> column & 1 == 1);
        let is_bank = self.bank >> column & 1 == 1;
        let deck = self.deck >> column & 1 == 1;
        match (
            deck,
            self.closed >> column & 1 == 1,
            self.hanging >> column & 1 == 1,
        ) {
            (true, false, _) => return ColumnKind::Sampled,
            // Of a deck that was observed from below nothing is known.
            (true, true, true) => return ColumnKind::Unknown,
            _ => {}
        }
        match (is_known, is_hit, rules.surface) {
            (false, _, _) => ColumnKind::Unknown,
            (true, true, _) => ColumnKind::Sampled,
            (true, false, Surface::Land) => ColumnKind::Inferred,
            (true, false, Surface::Water) if is_bank => ColumnKind::Bank,
            (true, false, Surface::Water) if self.lowest_z[column] <= rules.water_z => {
                ColumnKind::Water
            }
            (true, false, Surface::Water) => ColumnKind::Occluded,
        }
    }
}

/// Least depth of a pit, voxels.
const PIT_DEPTH: i32 = 3;

/// Air is observed within this many voxels above a deck: beams that graze it may leave out the voxel just above.
const AIR_GAP: i32 = 2;

/// Indices of the set bits.
fn columns(mut set: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let column = set.trailing_zeros() as usize;
        set &= set.wrapping_sub(1);
        (column < TILE_COLUMNS).then_some(column)
    })
}

/// Sixteen columns and their derived values.
#[derive(Clone, Debug)]
pub(super) struct ColumnTile {
    at: Option<BrickColumn>,
    pub(super) columns: [Column; TILE_COLUMNS],
    /// By slope alone; NaN if unknown.
    pub(super) costs: [f32; TILE_COLUMNS],
    published: [CostCell; TILE_COLUMNS],
    is_read: bool,
    is_sloped: bool,
    is_classified: bool,
}

/// Nested windows, the outermost first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum WindowPart {
    /// Columns are known.
    Read,
    /// Slopes are known.
    Sloped,
    /// Rigidity is known; cells are published.
    Classified,
}

/// A square of tiles in a buffer that is circular in both axes.
#[derive(Clone, Debug)]
pub(super) struct ColumnWindow {
    side: i32,
    first: Option<BrickColumn>,
    tiles: Vec<ColumnTile>,
}

impl ColumnTile {
    const BLANK: Self = Self {
        at: None,
        columns: [UNKNOWN; TILE_COLUMNS],
        costs: [f32::NAN; TILE_COLUMNS],
        published: [CostCell::UNKNOWN; TILE_COLUMNS],
        is_read: false,
        is_sloped: false,
        is_classified: false,
    };

    pub(super) fn cell_of(at: BrickColumn, column: usize) -> CellIndex {
        let (x, y) = offset(column);
        CellIndex {
            x: at.x * TILE_EDGE_COLUMNS + x,
            y: at.y * TILE_EDGE_COLUMNS + y,
        }
    }
}

const UNKNOWN: Column = Column {
    kind: super::height_columns::ColumnKind::Unknown,
    ground_z: 0,
    top_z: 0,
    ground_m: [0.0; 3],
    top_m: [0.0; 3],
    top_spot_m: 0.0,
};

impl WindowPart {
    /// Tiles between its edge and that of the outermost window.
    const fn margin(self) -> i32 {
        match self {
            Self::Read => 0,
            Self::Sloped => 1,
            Self::Classified => 2,
        }
    }
}

impl ColumnWindow {
    /// A window that publishes at least `box_m`.
    pub(super) fn new(box_m: f64, cell_m: f64) -> Self {
        let published = libm::ceil(box_m / (f64::from(TILE_EDGE_COLUMNS) * cell_m) - 1e-9) as i32;
        let side = published.max(1) + 2 * WindowPart::Classified.margin();
        Self {
            side,
            first: None,
            tiles: vec![ColumnTile::BLANK; (side * side) as usize],
        }
    }

    /// Moves the window; tiles that leave a nested window become stale there.
    pub(super) fn center_on(&mut self, cell: CellIndex) {
        let tile = |cell: i32| (cell >> 2) - self.side / 2;
        let first = BrickColumn {
            x: tile(cell.x),
            y: tile(cell.y),
        };
        if self.first.replace(first) == Some(first) {
            return;
        }
        for at in self.tiles(WindowPart::Read) {
            let slot = self.slot(at);
            let (slopes, classifies) = (
                self.is_inside(at, WindowPart::Sloped),
                self.is_inside(at, WindowPart::Classified),
            );
            let tile = &mut self.tiles[slot];
            if tile.at != Some(at) {
                *tile = ColumnTile {
                    at: Some(at),
                    ..ColumnTile::BLANK
                };
            }
            tile.is_sloped &= slopes;
            tile.is_classified &= classifies;
        }
    }

    /// Marks all tiles as stale.
    pub(super) fn invalidate(&mut self) {
        for tile in &mut self.tiles {
            tile.is_read = false;
            tile.is_sloped = false;
            tile.is_classified = false;
        }
    }

    /// Erases all tiles, published cells included.
    pub(super) fn clear(&mut self) {
        self.tiles.fill(ColumnTile::BLANK);
        self.first = None;
    }

    pub(super) fn mark_stale(&mut self, at: BrickColumn) {
        if self.is_inside(at, WindowPart::Read) {
            let slot = self.slot(at);
            self.tiles[slot].is_read = false;
        }
    }

    pub(super) fn tiles_to_read(&self) -> Vec<BrickColumn> {
        self.tiles(WindowPart::Read)
            .filter(|&at| !self.tiles[self.slot(at)].is_read)
            .collect()
    }

    /// Tiles with stale slopes after the columns of `changed` were set.
    pub(super) fn tiles_without_slopes(&mut self, changed: &[BrickColumn]) -> Vec<BrickColumn> {
        for at in self.around(changed) {
            let slot = self.slot(at);
            self.tiles[slot].is_sloped = false;
        }
        self.tiles(WindowPart::Sloped)
            .filter(|&at| !self.tiles[self.slot(at)].is_sloped)
            .collect()
    }

    /// Tiles to publish after voxels or slopes have changed that those of `changed` depend on.
    pub(super) fn tiles_to_classify(&mut self, changed: &[BrickColumn]) -> Vec<BrickColumn> {
        for &at in changed {
            let slot = self.slot(at);
            self.tiles[slot].is_classified = false;
        }
        self.tiles(WindowPart::Classified)
            .filter(|&at| !self.tiles[self.slot(at)].is_classified)
            .collect()
    }

    /// Tiles and their neighbours in the window, each once.
    pub(super) fn around(&self, tiles: &[BrickColumn]) -> Vec<BrickColumn> {
        let beside = |at: &BrickColumn| {
            let at = *at;
            (-1..=1).flat_map(move |dy| {
                (-1..=1).map(move |dx| BrickColumn {
                    x: at.x + dx,
                    y: at.y + dy,
                })
            })
        };
        let mut is_listed = vec![false; self.tiles.len()];
        let around = tiles
            .iter()
            .flat_map(beside)
            .filter(|&at| self.is_inside(at, WindowPart::Read));
        around
            .filter(|&at| !std::mem::replace(&mut is_listed[self.slot(at)], true))
            .collect()
    }

    pub(super) fn tiles(&self, part: WindowPart) -> impl Iterator<Item = BrickColumn> + use<> {
        let (margin, side) = (part.margin(), self.side);
        self.first.into_iter().flat_map(move |first| {
            (margin..side - margin).flat_map(move |y| {
                (margin..side - margin).map(move |x| BrickColumn {
                    x: first.x + x,
                    y: first.y + y,
                })
            })
        })
    }

    pub(super) fn tile(&self, at: BrickColumn) -> Option<&ColumnTile> {
        self.is_inside(at, WindowPart::Read)
            .then(|| &self.tiles[self.slot(at)])
    }

    /// Returns whether they changed.
    pub(super) fn set_columns(
        &mut self,
        at: BrickColumn,
        columns: &[Column; TILE_COLUMNS],
    ) -> bool {
        let slot = self.slot(at);
        let tile = &mut self.tiles[slot];
        tile.is_read = true;
        let before = std::mem::replace(&mut tile.columns, *columns);
        before != *columns
    }

    /// Returns whether they changed.
    pub(super) fn set_costs(&mut self, at: BrickColumn, costs: [f32; TILE_COLUMNS]) -> bool {
        let slot = self.slot(at);
        let tile = &mut self.tiles[slot];
        tile.is_sloped = true;
        let before = std::mem::replace(&mut tile.costs, costs);
        before.map(f32::to_bits) != costs.map(f32::to_bits) // unknown is not-a-number
    }

    /// Appends the changed cells of a tile to `changed`.
    pub(super) fn publish(
        &mut self,
        at: BrickColumn,
        cells: &[CostCell; TILE_COLUMNS],
        changed: &mut Vec<(CellIndex, CostCell)>,
    ) {
        let slot = self.slot(at);
        let tile = &mut self.tiles[slot];
        for (column, (cell, published)) in cells.iter().zip(&mut tile.published).enumerate() {
            if cell.differs(*published) {
                changed.push((ColumnTile::cell_of(at, column), *cell));
            }
            *published = *cell;
        }
        tile.is_classified = true;
    }

    /// Columns of a tile and of its neighbourhood.
    pub(super) fn patch(&self, at: BrickColumn) -> Patch {
        let tiles = [-1, 0, 1].map(|dy| {
            [-1, 0, 1].map(|dx| {
                let (x, y) = (at.x + dx, at.y + dy);
                &self.tiles[self.slot(BrickColumn { x, y })]
            })
        });
        std::array::from_fn(|n| {
            // From the first column of the first of these tiles.
            let [x, y] = [n % PATCH_EDGE, n / PATCH_EDGE].map(|n| n + TILE_EDGE - REACH);
            let column = y % TILE_EDGE * TILE_EDGE + x % TILE_EDGE;
            tiles[y / TILE_EDGE][x / TILE_EDGE].columns[column]
        })
    }

    /// [`Self::patch`], where pits are unknown.
    pub(super) fn patch_without_pits(&self, at: BrickColumn) -> Patch {
        let patch = self.patch(at);
        let mut without = patch;
        let least = ColumnTile::cell_of(at, 0);
        let rows = patch.chunks_exact(PATCH_EDGE);
        let rows = rows.zip(without.chunks_exact_mut(PATCH_EDGE));
        for (y, (row, without)) in (least.y - REACH_COLUMNS..).zip(rows) {
            // Beside a pit along x one column at least is higher: this rules out nearly all at once.
            let is_lower = |x: &usize| {
                let beside = [x.wrapping_sub(1), x + 1].map(|x| row.get(x));
                let mut beside = beside.iter().flatten();
                beside.any(|beside| beside.ground_z >= row[*x].ground_z + PIT_DEPTH)
            };
            let columns = (0..PATCH_EDGE).zip(least.x - REACH_COLUMNS..);
            for (n, x) in columns.filter(|(n, _)| is_lower(n)) {
                if self.is_pit(x, y) {
                    without[n] = UNKNOWN;
                }
            }
        }
        without
    }

    /// Whether a known column, and all that stands in it, is far below all but one of the columns beside it, of which all but one are
    /// known. No wheel fits into it: it is what is below a deck whose voxel there was freed by grazing beams.
    fn is_pit(&self, x: i32, y: i32) -> bool {
        let own = self.column(x, y);
        let (mut not_higher, mut unknown) = (0, 0);
        let beside = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy)));
        for (dx, dy) in beside.filter(|beside| *beside != (0, 0)) {
            let other = self.column(x + dx, y + dy);
            let is_known = other.kind != ColumnKind::Unknown;
            unknown += u32::from(!is_known);
            not_higher += u32::from(is_known && other.ground_z < own.top_z + PIT_DEPTH);
            if unknown > 1 || not_higher > 1 {
                return false;
            }
        }
        own.kind != ColumnKind::Unknown
    }

    fn column(&self, x: i32, y: i32) -> &Column {
        let slot = self.slot(BrickColumn {
            x: x >> 2,
            y: y >> 2,
        });
        &self.tiles[slot].columns[((y & 3) * 4 + (x & 3)) as usize]
    }

    /// Published cell.
    pub(super) fn cell(&self, cell: CellIndex) -> Option<CostCell> {
        let at = BrickColumn {
            x: cell.x >> 2,
            y: cell.y >> 2,
        };
        let column = ((cell.y & 3) * 4 + (cell.x & 3)) as usize;
        self.is_inside(at, WindowPart::Classified)
            .then(|| self.tiles[self.slot(at)].published[column])
    }

    /// Replaces `into` by what `of` makes of the published cells, row by row, none before the first update: least cell, cells
    /// per row.
    pub(super) fn cells<T>(
        &self,
        into: &mut Vec<T>,
        of: impl Fn(&CostCell) -> T,
    ) -> (CellIndex, usize) {
        let first = self.first.unwrap_or(BrickColumn { x: 0, y: 0 });
        let margin = WindowPart::Classified.margin();
        let least = ColumnTile::cell_of(
            BrickColumn {
                x: first.x + margin,
                y: first.y + margin,
            },
            0,
        );
        let tiles_in_row = (self.side - 2 * margin) as usize;
        let width = tiles_in_row * TILE_EDGE;
        into.clear();
        into.reserve(width * width);
        let tiles = self.tiles(WindowPart::Classified);
        let tiles: Vec<_> = tiles.map(|at| &self.tiles[self.slot(at)]).collect();
        for tiles in tiles.chunks_exact(tiles_in_row) {
            for row in (0..TILE_COLUMNS).step_by(TILE_EDGE) {
                for tile in tiles {
                    into.extend(tile.published[row..row + TILE_EDGE].iter().map(&of));
                }
            }
        }
        (least, width)
    }

    pub(super) fn bytes(&self) -> usize {
        self.tiles.len() * size_of::<ColumnTile>()
    }

    fn is_inside(&self, at: BrickColumn, part: WindowPart) -> bool {
        let margin = part.margin();
        self.first.is_some_and(|first| {
            let within = |at: i32, first: i32| {
                (margin..self.side - margin).contains(&at.wrapping_sub(first))
            };
            within(at.x, first.x) && within(at.y, first.y)
        })
    }

    fn slot(&self, at: BrickColumn) -> usize {
        let place = |coordinate: i32| coordinate.rem_euclid(self.side) as usize;
        place(at.y) * self.side as usize + place(at.x)
    }
}
