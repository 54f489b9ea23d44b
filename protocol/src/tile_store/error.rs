//! Why a store refused.

use crate::layer::LayerId;
use crate::tile::{InvalidCode, TileKey};

/// Why a store refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StoreError {
    /// The store has no grid for the tile's layer.
    #[error("layer {0} has no grid in this store: call set_grid first")]
    NoGrid(LayerId),
    /// A cell size that is none.
    #[error("cell size {cell_m} m of layer {layer} is not a positive number")]
    CellSize {
        /// The layer.
        layer: LayerId,
        /// The size refused.
        cell_m: f64,
    },
    /// Another cell size while tiles are held.
    #[error("layer {layer} holds tiles of {held_m} m cells, not {cell_m} m: erase it first")]
    GridInUse {
        /// The layer.
        layer: LayerId,
        /// The size of the cells held.
        held_m: f64,
        /// The size refused.
        cell_m: f64,
    },
    /// A code that the layer does not use.
    #[error("tile {key}: {source}")]
    Code {
        /// The tile refused.
        key: TileKey,
        /// Where and what.
        source: InvalidCode,
    },
    /// Cells that are not what the publisher hashed.
    #[error("tile {key}, revision {revision}: its cells do not match its digest, ask for it again")]
    Digest {
        /// The tile refused.
        key: TileKey,
        /// Its revision.
        revision: u64,
    },
}
