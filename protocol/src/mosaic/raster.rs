//! The raster: where its cells are, and what they hold.

use super::{KnownTiles, MAX_RASTER_SIDE, MosaicError};
use crate::layer::{LayerId, UNKNOWN};
use crate::tile::{SIDE, TILE_SIDE, TileCells, TileKey};
use crate::tile_store::TileStore;

/// Cell codes of a rectangle of one layer. A clone copies no cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster {
    layer: LayerId,
    cell_m: f64,
    extent: Extent,
    width: usize,
    height: usize,
    /// Row by row of tiles from the lowest y, each from the lowest x.
    tiles: Vec<(TileKey, TileCells)>,
}

/// A rectangle of cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Extent {
    /// The cell with the lowest x and y.
    first: (i64, i64),
    /// One past the cell with the highest x and y.
    end: (i64, i64),
}

impl Raster {
    /// The known cells of `layer` and what lies between them; `None` where no cell is known.
    ///
    /// # Errors
    /// Where the store has no grid for the layer, or the raster had more than `max_cells` cells, or more than
    /// [`MAX_RASTER_SIDE`] in a row or column.
    pub fn of_layer(
        store: &TileStore,
        layer: LayerId,
        max_cells: u64,
    ) -> Result<Option<Self>, MosaicError> {
        KnownTiles::of_layer(store, layer)?.into_raster(max_cells)
    }

    pub(super) fn new(known: KnownTiles, max_cells: u64) -> Result<Option<Self>, MosaicError> {
        let KnownTiles {
            layer,
            cell_m,
            mut tiles,
        } = known;
        let Some(extent) = tiles
            .iter()
            .filter_map(|(key, cells)| known_extent(*key, cells))
            .reduce(Extent::join)
        else {
            return Ok(None);
        };
        let width = extent.end.0.abs_diff(extent.first.0);
        let height = extent.end.1.abs_diff(extent.first.1);
        let is_within = width.max(height) <= MAX_RASTER_SIDE
            && width
                .checked_mul(height)
                .is_some_and(|all| all <= max_cells);
        if !is_within {
            return Err(MosaicError::TooLarge {
                layer,
                width,
                height,
                max_cells,
            });
        }
        tiles.sort_unstable_by_key(|(key, _)| place_of_tile(*key));
        Ok(Some(Self {
            layer,
            cell_m,
            extent,
            width: width as usize,
            height: height as usize,
            tiles,
        }))
    }

    /// The layer.
    pub fn layer(&self) -> LayerId {
        self.layer
    }

    /// Side of a cell, metres.
    pub fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// Indices of the cell with the lowest x and y.
    pub fn first_cell(&self) -> (i64, i64) {
        self.extent.first
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Puts the codes of row `y`, counted upwards from the lowest y, into `codes`, in place of what is there; `y < height`.
    pub fn read_row(&self, y: usize, codes: &mut Vec<u16>) {
        codes.clear();
        codes.resize(self.width, UNKNOWN);
        let cell_y = self.extent.first.1.saturating_add_unsigned(y as u64);
        let (ty, row) = (cell_y.div_euclid(SIDE), cell_y.rem_euclid(SIDE) as usize);
        let begin = self
            .tiles
            .partition_point(|(key, _)| i64::from(key.ty) < ty);
        let tiles = &self.tiles[begin..];
        for (key, cells) in tiles.iter().take_while(|(key, _)| i64::from(key.ty) == ty) {
            let tile_x = key.first_cell().0;
            let from = (self.extent.first.0 - tile_x).clamp(0, SIDE);
            let until = (self.extent.end.0 - tile_x).clamp(0, SIDE);
            if from < until {
                let column = (tile_x + from - self.extent.first.0) as usize;
                let part = &cells.row(row)[from as usize..until as usize];
                codes[column..][..part.len()].copy_from_slice(part);
            }
        }
    }

    /// The codes of all known cells, tile by tile.
    pub fn known_codes(&self) -> impl Iterator<Item = u16> {
        let codes = self.tiles.iter().flat_map(|(_, cells)| cells.codes());
        codes.copied().filter(|&code| code != UNKNOWN)
    }

    /// The outer edges in `odom`, metres: the corner with the lowest and the one with the highest x and y.
    pub fn corners_m(&self) -> ([f64; 2], [f64; 2]) {
        let corner_m = |(x, y): (i64, i64)| [x as f64 * self.cell_m, y as f64 * self.cell_m];
        (corner_m(self.extent.first), corner_m(self.extent.end))
    }

    /// The value at a point of `odom`; `None` where it is unknown or outside the raster.
    pub fn value_at(&self, x_m: f64, y_m: f64) -> Option<f32> {
        self.cell_of(x_m, y_m)?;
        let [x, y] = [x_m, y_m].map(|position_m| (position_m / self.cell_m).floor() as i64);
        let place = (y.div_euclid(SIDE), x.div_euclid(SIDE));
        let found = self
            .tiles
            .binary_search_by_key(&place, |(key, _)| place_of_tile(*key));
        let (_, cells) = self.tiles.get(found.ok()?)?;
        let code = cells.get(x.rem_euclid(SIDE) as usize, y.rem_euclid(SIDE) as usize)?;
        self.layer.quantisation().decode(code)
    }

    /// Column and row (from the lowest y) of the cell at a point in `odom`, metres; `None` outside.
    pub fn cell_of(&self, x_m: f64, y_m: f64) -> Option<(usize, usize)> {
        let column = self.offset(x_m, self.extent.first.0, self.width)?;
        let row = self.offset(y_m, self.extent.first.1, self.height)?;
        Some((column, row))
    }

    fn offset(&self, position_m: f64, first: i64, count: usize) -> Option<usize> {
        let offset = (position_m / self.cell_m).floor() - first as f64;
        (offset >= 0.0 && offset < count as f64).then_some(offset as usize)
    }
}

/// Row and column of a tile, by which tiles are in order.
fn place_of_tile(key: TileKey) -> (i64, i64) {
    (i64::from(key.ty), i64::from(key.tx))
}

impl Extent {
    fn join(self, other: Self) -> Self {
        let (a, b) = (self.first, other.first);
        let first = (a.0.min(b.0), a.1.min(b.1));
        let (a, b) = (self.end, other.end);
        let end = (a.0.max(b.0), a.1.max(b.1));
        Self { first, end }
    }
}

fn known_extent(key: TileKey, cells: &TileCells) -> Option<Extent> {
    let (tile_x, tile_y) = key.first_cell();
    (tile_y..)
        .zip(0..TILE_SIDE)
        .filter_map(|(cell_y, y)| {
            let mut known = (tile_x..)
                .zip(cells.row(y))
                .filter(|&(_, &code)| code != UNKNOWN)
                .map(|(cell_x, _)| cell_x);
            let first_x = known.next()?;
            let last_x = known.last().unwrap_or(first_x);
            Some(Extent {
                first: (first_x, cell_y),
                end: (last_x + 1, cell_y + 1),
            })
        })
        .reduce(Extent::join)
}
