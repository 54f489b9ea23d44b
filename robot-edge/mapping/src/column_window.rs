//! A window of tiles of columns that moves with the vehicle; tiles stay where they are in `odom`.

use super::cost_map::CostCell;
use super::grid::CellIndex;
use super::height_columns::{Column, TILE_COLUMNS, TILE_EDGE_COLUMNS, offset};
use super::octree::BrickColumn;
use super::slope::{PATCH_COLUMNS, PATCH_EDGE, Patch, REACH_COLUMNS};

/// Sixteen columns, and what follows from them.
#[derive(Clone, Debug)]
pub(super) struct ColumnTile {
    at: Option<BrickColumn>,
    pub(super) columns: [Column; TILE_COLUMNS],
    /// By slope alone, not-a-number where unknown.
    pub(super) costs: [f32; TILE_COLUMNS],
    published: [CostCell; TILE_COLUMNS],
    is_read: bool,
    is_sloped: bool,
    is_classified: bool,
}

/// The windows that lie in each other, from the outermost one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum WindowPart {
    /// Columns are read.
    Read,
    /// Slopes are known.
    Sloped,
    /// What is rigid is known; what is told.
    Classified,
}

/// A square of tiles, each at the place that its coordinates give it.
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

    /// The cell of a column of a tile.
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
    /// Tiles between its edge and that of the outermost one.
    const fn margin(self) -> i32 {
        match self {
            Self::Read => 0,
            Self::Sloped => 1,
            Self::Classified => 2,
        }
    }
}

impl ColumnWindow {
    /// So large that what is told covers `box_m`.
    pub(super) fn new(box_m: f64, cell_m: f64) -> Self {
        let published = libm::ceil(box_m / (f64::from(TILE_EDGE_COLUMNS) * cell_m) - 1e-9) as i32;
        let side = published.max(1) + 2 * WindowPart::Classified.margin();
        Self {
            side,
            first: None,
            tiles: vec![ColumnTile::BLANK; (side * side) as usize],
        }
    }

    /// Moves the window; tiles that leave a part of it are no longer up to date there.
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

    /// What is known of no tile is up to date.
    pub(super) fn invalidate(&mut self) {
        for tile in &mut self.tiles {
            tile.is_read = false;
            tile.is_sloped = false;
            tile.is_classified = false;
        }
    }

    /// Nothing is known, or was ever told.
    pub(super) fn clear(&mut self) {
        self.tiles.fill(ColumnTile::BLANK);
        self.first = None;
    }

    /// The columns of a tile are no longer up to date.
    pub(super) fn mark_stale(&mut self, at: BrickColumn) {
        if self.is_inside(at, WindowPart::Read) {
            let slot = self.slot(at);
            self.tiles[slot].is_read = false;
        }
    }

    /// Tiles whose columns must be read.
    pub(super) fn tiles_to_read(&self) -> Vec<BrickColumn> {
        self.tiles(WindowPart::Read)
            .filter(|&at| !self.tiles[self.slot(at)].is_read)
            .collect()
    }

    /// Tiles whose slopes must be computed after columns have changed.
    pub(super) fn tiles_without_slopes(&mut self, changed: &[BrickColumn]) -> Vec<BrickColumn> {
        for at in self.around(changed) {
            let slot = self.slot(at);
            self.tiles[slot].is_sloped = false;
        }
        self.tiles(WindowPart::Sloped)
            .filter(|&at| !self.tiles[self.slot(at)].is_sloped)
            .collect()
    }

    /// Tiles to be told anew after voxels or slopes of others have changed.
    pub(super) fn tiles_to_classify(&mut self, sloped: &[BrickColumn]) -> Vec<BrickColumn> {
        for at in self.around(sloped) {
            let slot = self.slot(at);
            self.tiles[slot].is_classified = false;
        }
        self.tiles(WindowPart::Classified)
            .filter(|&at| !self.tiles[self.slot(at)].is_classified)
            .collect()
    }

    /// Tiles of the window and those beside them, each once.
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

    /// The tiles of a part of the window, in order.
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

    /// Says whether they differ from those it had.
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

    /// Says whether they differ from those it had.
    pub(super) fn set_costs(&mut self, at: BrickColumn, costs: [f32; TILE_COLUMNS]) -> bool {
        let slot = self.slot(at);
        let tile = &mut self.tiles[slot];
        tile.is_sloped = true;
        let before = std::mem::replace(&mut tile.costs, costs);
        before.map(f32::to_bits) != costs.map(f32::to_bits) // unknown is not-a-number
    }

    /// Appends what is new of the cells of a tile.
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

    /// The columns of a tile of the middle windows and those around it.
    pub(super) fn patch(&self, at: BrickColumn) -> Patch {
        let mut patch = [UNKNOWN; PATCH_COLUMNS];
        let least = ColumnTile::cell_of(at, 0);
        for (y, row) in (least.y - REACH_COLUMNS..).zip(patch.chunks_exact_mut(PATCH_EDGE)) {
            for (x, column) in (least.x - REACH_COLUMNS..).zip(row) {
                let slot = self.slot(BrickColumn {
                    x: x >> 2,
                    y: y >> 2,
                });
                *column = self.tiles[slot].columns[((y & 3) * 4 + (x & 3)) as usize];
            }
        }
        patch
    }

    /// What was told of a cell.
    pub(super) fn cell(&self, cell: CellIndex) -> Option<CostCell> {
        let at = BrickColumn {
            x: cell.x >> 2,
            y: cell.y >> 2,
        };
        let column = ((cell.y & 3) * 4 + (cell.x & 3)) as usize;
        self.is_inside(at, WindowPart::Classified)
            .then(|| self.tiles[self.slot(at)].published[column])
    }

    /// What was told of all cells, row by row; the least cell, and how many are in a row.
    pub(super) fn cells(&self) -> (CellIndex, usize, Vec<CostCell>) {
        let first = self.first.unwrap_or(BrickColumn { x: 0, y: 0 });
        let margin = WindowPart::Classified.margin();
        let least = ColumnTile::cell_of(
            BrickColumn {
                x: first.x + margin,
                y: first.y + margin,
            },
            0,
        );
        let width = (self.side - 2 * margin) * TILE_EDGE_COLUMNS;
        let cells = (0..width).flat_map(|y| {
            (0..width).map(move |x| CellIndex {
                x: least.x + x,
                y: least.y + y,
            })
        });
        let published = cells
            .map(|cell| self.cell(cell).unwrap_or(CostCell::UNKNOWN))
            .collect();
        (least, width as usize, published)
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
