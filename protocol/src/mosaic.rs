//! Tiles of one layer → one raster, the bounding box of its known cells.

use crate::layer::{LayerId, UNKNOWN};
use crate::tile::{SIDE, TILE_SIDE, TileCells, TileKey};
use crate::tile_store::TileStore;

/// Cells of the largest raster that exports make: 8192×8192, 128 MiB of codes. At 0.1 m it is 819 m square.
pub const MAX_RASTER_CELLS: u64 = 1 << 26;

/// Cell codes of a rectangle of one layer.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster {
    layer: LayerId,
    cell_m: f64,
    extent: Extent,
    width: usize,
    height: usize,
    codes: Vec<u16>,
}

/// Why tiles make no raster.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MosaicError {
    /// The store has no grid for the layer.
    #[error("layer {0} has no grid in this store")]
    NoGrid(LayerId),
    /// The bounding box of known cells is too large.
    #[error(
        "layer {layer} spans {width}×{height} cells, more than the {max_cells} a raster may hold: \
         map a smaller area or use larger cells"
    )]
    TooLarge {
        /// The layer.
        layer: LayerId,
        /// Columns of the bounding box.
        width: u64,
        /// Rows of the bounding box.
        height: u64,
        /// The limit on their product.
        max_cells: u64,
    },
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
    /// Refuses to make a raster of more than `max_cells` cells before it allocates anything.
    pub fn of_layer(
        store: &TileStore,
        layer: LayerId,
        max_cells: u64,
    ) -> Result<Option<Self>, MosaicError> {
        let cell_m = store.cell_m(layer).ok_or(MosaicError::NoGrid(layer))?;
        let tiles = || {
            store
                .tiles(layer)
                .filter_map(|(key, stored)| Some((key, stored.cells()?)))
        };
        let Some(extent) = tiles()
            .filter_map(|(key, cells)| known_extent(key, cells))
            .reduce(Extent::join)
        else {
            return Ok(None);
        };
        let width = extent.end.0.abs_diff(extent.first.0);
        let height = extent.end.1.abs_diff(extent.first.1);
        let cells = width
            .checked_mul(height)
            .filter(|&cells| cells <= max_cells)
            .ok_or(MosaicError::TooLarge {
                layer,
                width,
                height,
                max_cells,
            })?;
        let mut raster = Self {
            layer,
            cell_m,
            extent,
            width: width as usize,
            height: height as usize,
            codes: vec![UNKNOWN; cells as usize],
        };
        for (key, cells) in tiles() {
            raster.paste(key, cells);
        }
        Ok(Some(raster))
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

    /// The codes of row `y`, counted upwards from the lowest y; `y < height`.
    pub fn row(&self, y: usize) -> &[u16] {
        &self.codes[y * self.width..][..self.width]
    }

    /// All codes, row by row from the lowest y.
    pub fn codes(&self) -> &[u16] {
        &self.codes
    }

    /// The outer edges in `odom`, metres: the corner with the lowest and the one with the highest x and y.
    pub fn corners_m(&self) -> ([f64; 2], [f64; 2]) {
        let corner_m = |(x, y): (i64, i64)| [x as f64 * self.cell_m, y as f64 * self.cell_m];
        (corner_m(self.extent.first), corner_m(self.extent.end))
    }

    /// The value at a point of `odom`; `None` where it is unknown or outside the raster.
    pub fn value_at(&self, x_m: f64, y_m: f64) -> Option<f32> {
        let (column, row) = self.place_of(x_m, y_m)?;
        self.layer.quantisation().decode(self.row(row)[column])
    }

    /// Column and row (from the lowest y) of the cell at a point in `odom`, metres; `None` outside.
    pub fn place_of(&self, x_m: f64, y_m: f64) -> Option<(usize, usize)> {
        let column = self.offset(x_m, self.extent.first.0, self.width)?;
        let row = self.offset(y_m, self.extent.first.1, self.height)?;
        Some((column, row))
    }

    fn offset(&self, position_m: f64, first: i64, count: usize) -> Option<usize> {
        let offset = (position_m / self.cell_m).floor() - first as f64;
        (offset >= 0.0 && offset < count as f64).then_some(offset as usize)
    }

    /// Copies the part of a tile that lies inside.
    fn paste(&mut self, key: TileKey, cells: &TileCells) {
        let Extent { first, end } = self.extent;
        let (tile_x, tile_y) = key.first_cell();
        let from = (first.0 - tile_x).clamp(0, SIDE);
        let until = (end.0 - tile_x).clamp(0, SIDE);
        if from >= until {
            return;
        }
        let column = (tile_x + from - first.0) as usize;
        for (cell_y, y) in (tile_y..).zip(0..TILE_SIDE) {
            if (first.1..end.1).contains(&cell_y) {
                let start = (cell_y - first.1) as usize * self.width + column;
                let part = &cells.row(y)[from as usize..until as usize];
                self.codes[start..][..part.len()].copy_from_slice(part);
            }
        }
    }
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
    fn the_raster_is_the_bounding_box_of_known_cells() {
        let store = store(&[(-3, 70, 1.0), (5, -1, -2.0), (66, 2, 0.5)]);
        let raster = Raster::of_layer(&store, LayerId::Elevation, MAX_RASTER_CELLS)
            .unwrap()
            .unwrap();
        assert_eq!(raster.first_cell(), (-3, -1));
        assert_eq!((raster.width(), raster.height()), (70, 72));
        assert_eq!(raster.corners_m(), ([-1.5, -0.5], [33.5, 35.5]));
        assert_eq!(raster.codes().iter().filter(|&&code| code != 0).count(), 3);
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
        assert_eq!(one.codes(), [32768]);
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
}
