//! Tiles of one layer as one raster, the bounding box of the known cells.
//!
//! A raster shares the tiles of its store and copies no cells. It is read row by row, so its memory
//! does not depend on its size.

use std::ops::Range;

use crate::layer::{LayerId, UNKNOWN};
use crate::tile::{SIDE, TILE_SIDE, TileCells, TileKey};
use crate::tile_store::TileStore;

/// Limit of exported rasters: 16,384 × 16,384 cells, at 0.1 m 1.6 km square. One distant tile can
/// span any box, so it bounds file size and export time: a `GeoTIFF` of this size deflates 1 GiB,
/// and must stay below the format's 4 GiB.
pub const MAX_RASTER_CELLS: u64 = 1 << 28;
/// Limit of a raster's longest side, because writers hold a whole row, at most 4 bytes per cell. At
/// 0.1 m it is 105 km.
pub const MAX_RASTER_SIDE: u64 = 1 << 20;

/// Reason for no raster.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MosaicError {
    /// The store has no grid for the layer.
    #[error("layer {0} has no grid in this store")]
    NoGrid(LayerId),
    /// The bounding box of known cells is too large.
    #[error(
        "layer {layer} spans {width}×{height} cells, more than the {max_cells} a raster may hold, or the {MAX_RASTER_SIDE} \
         of its longest side: map a smaller area or use larger cells"
    )]
    TooLarge {
        /// The layer.
        layer: LayerId,
        /// Columns of the bounding box.
        width: u64,
        /// Rows of the bounding box.
        height: u64,
        /// Limit of their product.
        max_cells: u64,
    },
}

/// Known tiles of one layer at one moment, sharing their cells with the store.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownTiles {
    layer: LayerId,
    cell_m: f64,
    tiles: Vec<(TileKey, TileCells)>,
}

impl KnownTiles {
    /// Known tiles of `layer` in `store`.
    pub fn of_layer(store: &TileStore, layer: LayerId) -> Result<Self, MosaicError> {
        let cell_m = store.cell_m(layer).ok_or(MosaicError::NoGrid(layer))?;
        let tiles = store
            .tiles(layer)
            .filter_map(|(key, stored)| Some((key, stored.cells()?.clone())));
        Ok(Self {
            layer,
            cell_m,
            tiles: tiles.collect(),
        })
    }

    /// Raster of the known cells; `None` without known cells.
    pub fn into_raster(self, max_cells: u64) -> Result<Option<Raster>, MosaicError> {
        let Self {
            layer,
            cell_m,
            mut tiles,
        } = self;
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
        Ok(Some(Raster {
            layer,
            cell_m,
            extent,
            width: width as usize,
            height: height as usize,
            tiles,
        }))
    }
}

/// Cell codes of a rectangle of one layer. Clones share the cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster {
    layer: LayerId,
    cell_m: f64,
    extent: Extent,
    width: usize,
    height: usize,
    /// In rows of tiles from the lowest y, each from the lowest x.
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
    /// Raster of the known cells of `layer`; `None` without known cells.
    pub fn of_layer(
        store: &TileStore,
        layer: LayerId,
        max_cells: u64,
    ) -> Result<Option<Self>, MosaicError> {
        KnownTiles::of_layer(store, layer)?.into_raster(max_cells)
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

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Replaces `codes` by row `y`, counted upwards from the lowest y; `y < height`.
    pub fn read_row(&self, y: usize, codes: &mut Vec<u16>) {
        self.read_part_of_row(y, 0..self.width, codes);
    }

    /// Replaces `codes` by the cells in `columns` of row `y`, counted from the lowest x and y.
    fn read_part_of_row(&self, y: usize, columns: Range<usize>, codes: &mut Vec<u16>) {
        codes.clear();
        codes.resize(columns.len(), UNKNOWN);
        let cell_y = self.extent.first.1.saturating_add_unsigned(y as u64);
        let (ty, row) = (cell_y.div_euclid(SIDE), cell_y.rem_euclid(SIDE) as usize);
        let cell_x = |column| self.extent.first.0.saturating_add_unsigned(column as u64);
        let (first_x, end_x) = (cell_x(columns.start), cell_x(columns.end));
        let first_place = (ty, first_x.div_euclid(SIDE));
        let begin = self
            .tiles
            .partition_point(|(key, _)| place_of_tile(*key) < first_place);
        for (key, cells) in &self.tiles[begin..] {
            let tile_x = key.first_cell().0;
            if i64::from(key.ty) != ty || tile_x >= end_x {
                break;
            }
            let from = (first_x - tile_x).max(0);
            let until = (end_x - tile_x).min(SIDE);
            let column = (tile_x + from - first_x) as usize;
            let part = &cells.row(row)[from as usize..until as usize];
            codes[column..][..part.len()].copy_from_slice(part);
        }
    }

    /// Replaces `codes` by the deciding code ([`LayerId::deciding`]) of each square of `step` by `step`
    /// cells in `columns`, a range of squares from the lowest x. `row` counts squares downwards from
    /// the greatest y. Squares at the right and lower edge may be cut.
    pub fn read_deciding(
        &self,
        step: usize,
        row: usize,
        columns: Range<usize>,
        codes: &mut Vec<u16>,
    ) {
        codes.clear();
        codes.resize(columns.len(), UNKNOWN);
        let mut cells = Vec::new();
        let cell_columns = columns.start * step..(columns.end * step).min(self.width);
        for file_row in row * step..((row + 1) * step).min(self.height) {
            let y = self.height - 1 - file_row;
            self.read_part_of_row(y, cell_columns.clone(), &mut cells);
            for (code, square) in codes.iter_mut().zip(cells.chunks(step)) {
                let decides = |a, b| self.layer.deciding(a, b);
                *code = square.iter().copied().fold(*code, decides);
            }
        }
    }

    /// Codes of all known cells, tile by tile.
    pub fn known_codes(&self) -> impl Iterator<Item = u16> {
        let codes = self.tiles.iter().flat_map(|(_, cells)| cells.codes());
        codes.copied().filter(|&code| code != UNKNOWN)
    }

    /// Outer corners in `odom`, metres: lowest and greatest x and y.
    pub fn corners_m(&self) -> ([f64; 2], [f64; 2]) {
        let corner_m = |(x, y): (i64, i64)| [x as f64 * self.cell_m, y as f64 * self.cell_m];
        (corner_m(self.extent.first), corner_m(self.extent.end))
    }

    /// Columns and rows of the tiles, in rows from the lowest y.
    pub fn tile_places(&self) -> impl Iterator<Item = (i32, i32)> {
        self.tiles.iter().map(|(key, _)| (key.tx, key.ty))
    }

    /// A known tile.
    pub fn tile(&self, (tx, ty): (i32, i32)) -> Option<&TileCells> {
        let place = (i64::from(ty), i64::from(tx));
        let found = self
            .tiles
            .binary_search_by_key(&place, |(key, _)| place_of_tile(*key));
        self.tiles.get(found.ok()?).map(|(_, cells)| cells)
    }

    /// Value at a point of `odom`; `None` if unknown or outside.
    pub fn value_at(&self, x_m: f64, y_m: f64) -> Option<f32> {
        self.cell_of(x_m, y_m)?;
        let [x, y] = [x_m, y_m].map(|position_m| (position_m / self.cell_m).floor() as i64);
        let tile = [x, y].map(|cell| i32::try_from(cell.div_euclid(SIDE)));
        let [Ok(tx), Ok(ty)] = tile else { return None };
        let cells = self.tile((tx, ty))?;
        let code = cells.get(x.rem_euclid(SIDE) as usize, y.rem_euclid(SIDE) as usize)?;
        self.layer.quantisation().decode(code)
    }

    /// Column and row (from the lowest y) of the cell at a point of `odom`, metres; `None` outside.
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

/// Sort key of a tile: row, then column.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layer::UNKNOWN;
    use crate::tile::BootId;
    use crate::tile_store::{LayerGrid, Publication};

    /// A store with single elevation cells of 0.5 m at the given places.
    fn store(cells: &[(i64, i64, f32)]) -> TileStore {
        let layer = LayerId::Elevation;
        let mut store = TileStore::new(BootId([1; 16]), 100);
        store.set_grid(LayerGrid { layer, cell_m: 0.5 }).unwrap();
        for &(x, y, height_m) in cells {
            let key = TileKey::of_cell(layer, x, y).unwrap();
            let mut tile = store
                .tile(key)
                .map_or_else(TileCells::unknown, |tile| tile.cells);
            let index = (y.rem_euclid(64) * 64 + x.rem_euclid(64)) as usize;
            tile.codes_mut()[index] = layer.quantisation().encode(height_m);
            let published = store.publish(key, tile).unwrap();
            assert_ne!(published, Publication::Unchanged);
        }
        store
    }

    #[test]
    fn raster_is_bounding_box_of_known_cells() {
        let store = store(&[(-3, 70, 1.0), (5, -1, -2.0), (66, 2, 0.5)]);
        let raster = Raster::of_layer(&store, LayerId::Elevation, MAX_RASTER_CELLS)
            .unwrap()
            .unwrap();
        assert_eq!(raster.first_cell(), (-3, -1));
        assert_eq!((raster.width(), raster.height()), (70, 72));
        assert_eq!(raster.corners_m(), ([-1.5, -0.5], [33.5, 35.5]));
        assert_eq!(raster.known_codes().count(), 3);
        let mut row = vec![7; 500];
        raster.read_row(0, &mut row);
        let known = |row: &[u16]| {
            let known = row.iter().enumerate().filter(|(_, code)| **code != UNKNOWN);
            known.map(|(column, _)| column).collect::<Vec<_>>()
        };
        assert_eq!((row.len(), known(&row)), (70, vec![8]));
        raster.read_row(3, &mut row);
        assert_eq!((row.len(), known(&row)), (70, vec![69]));
        raster.read_row(4, &mut row);
        assert_eq!(known(&row), [0; 0]);
        raster.read_row(71, &mut row);
        assert_eq!(known(&row), [0]);
        assert_eq!(raster.value_at(-1.3, 35.2), Some(1.0));
        assert_eq!(
            raster.value_at(2.5, -0.5),
            Some(-2.0),
            "lower edge belongs to the cell"
        );
        assert_eq!(raster.value_at(2.5, 0.0), None, "upper edge to the next");
        assert_eq!(raster.value_at(33.49, 1.49), Some(0.5));
        assert_eq!(raster.value_at(33.5, 1.4), None);
        assert_eq!(raster.value_at(f64::NAN, 0.0), None);
    }

    #[test]
    fn one_cell_is_a_raster_and_none_is_not() {
        let layer = LayerId::Elevation;
        let one = Raster::of_layer(&store(&[(-65, 63, 0.0)]), layer, 1)
            .unwrap()
            .unwrap();
        assert_eq!(
            (one.width(), one.height(), one.first_cell()),
            (1, 1, (-65, 63))
        );
        assert_eq!(one.known_codes().collect::<Vec<_>>(), [32768]);
        assert_eq!(Raster::of_layer(&store(&[]), layer, 1), Ok(None));
        assert_eq!(
            Raster::of_layer(&store(&[]), LayerId::Shore, 1),
            Err(MosaicError::NoGrid(LayerId::Shore))
        );
    }

    #[test]
    fn a_raster_too_large_is_refused_with_its_size() {
        let far = i64::from(i32::MAX) * 64;
        let store = store(&[(-far, -far, 0.0), (far, far, 0.0)]);
        let error = Raster::of_layer(&store, LayerId::Elevation, MAX_RASTER_CELLS).unwrap_err();
        let message = error.to_string();
        assert!(
            message.contains("274877906817×274877906817 cells"),
            "{message}"
        );
    }

    #[test]
    fn too_long_narrow_rasters_are_refused() {
        let side = MAX_RASTER_SIDE.cast_signed();
        let spanned = |first: i64, last: i64| {
            let store = store(&[(0, first, 0.0), (0, last, 0.0)]);
            let raster = Raster::of_layer(&store, LayerId::Elevation, MAX_RASTER_CELLS);
            raster.map(|raster| raster.unwrap().height())
        };
        assert_eq!(spanned(-5, side - 6), Ok(1 << 20));
        let error = spanned(-5, side - 5).unwrap_err().to_string();
        assert!(error.contains("1×1048577 cells"), "{error}");
        assert!(error.contains("use larger cells"), "{error}");
    }

    #[test]
    fn a_raster_is_what_the_store_was_when_it_was_taken() {
        let layer = LayerId::Elevation;
        let mut store = store(&[(0, 0, 1.0)]);
        let known = KnownTiles::of_layer(&store, layer).unwrap();
        let key = TileKey::of_cell(layer, 0, 0).unwrap();
        let code = layer.quantisation().encode(2.0);
        let newer = TileCells::from_fn(|_, _| code);
        assert_ne!(store.publish(key, newer).unwrap(), Publication::Unchanged);
        let before = known.into_raster(MAX_RASTER_CELLS).unwrap().unwrap();
        let after = Raster::of_layer(&store, layer, MAX_RASTER_CELLS)
            .unwrap()
            .unwrap();
        assert_eq!((before.width(), before.value_at(0.1, 0.1)), (1, Some(1.0)));
        assert_eq!((after.width(), after.value_at(0.1, 0.1)), (64, Some(2.0)));
    }
}
