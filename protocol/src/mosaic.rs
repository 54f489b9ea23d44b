//! Tiles of one layer → one raster, the bounding box of its known cells.
//!
//! A raster holds the tiles of its store and no cells of its own: it is read row by row, and takes next to no memory beside
//! the store, however large it is.

mod raster;

use crate::layer::LayerId;
use crate::tile::{TileCells, TileKey};
use crate::tile_store::TileStore;

pub use raster::Raster;

/// Cells of the largest raster that exports make: 16,384×16,384, at 0.1 m it is 1.6 km square. This bounds files and the
/// time to write them, since a tile far from all others is enough to span any box: a `GeoTIFF` of so many cells deflates
/// 1 GiB, and has to stay below the format's 4 GiB.
pub const MAX_RASTER_CELLS: u64 = 1 << 28;
/// Cells of the longest side of a raster: writers hold a whole row of it, at most 4 bytes a cell. At 0.1 m it is 105 km.
pub const MAX_RASTER_SIDE: u64 = 1 << 20;

/// Why tiles make no raster.
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
        /// The limit on their product.
        max_cells: u64,
    },
}

/// The tiles of one layer of which something is known, as they are at one moment. Taking them copies no cells.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownTiles {
    layer: LayerId,
    cell_m: f64,
    tiles: Vec<(TileKey, TileCells)>,
}

impl KnownTiles {
    /// Those of `layer` in `store`.
    ///
    /// # Errors
    /// Where the store has no grid for the layer.
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

    /// The raster of their known cells; `None` where there are none.
    ///
    /// # Errors
    /// Where it had more than `max_cells` cells, or more than [`MAX_RASTER_SIDE`] in a row or column.
    pub fn into_raster(self, max_cells: u64) -> Result<Option<Raster>, MosaicError> {
        Raster::new(self, max_cells)
    }
}

#[cfg(test)]
mod tests;
