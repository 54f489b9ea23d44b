//! A tile: 64×64 cells of one layer, the unit of publication.
//!
//! Tiles are fixed in `odom`. Cell edges lie at multiples of the layer's cell size; cell `(cx, cy)` covers
//! `cx·cell_m ≤ x < (cx + 1)·cell_m` and likewise in y; tile `(tx, ty)` covers the cells
//! `64·tx ≤ cx < 64·(tx + 1)` and likewise in y.

mod cells;
pub mod codec;

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::layer::LayerId;

pub use cells::{InvalidCode, TileCells};

/// Cells along one side of a tile.
pub const TILE_SIDE: usize = SIDE as usize;
/// Cells in a tile.
pub const TILE_CELLS: usize = TILE_SIDE * TILE_SIDE;
/// [`TILE_SIDE`] for cell indices.
pub(crate) const SIDE: i64 = 64;

/// Which tile of which layer. Ordered by layer, then `tx`, then `ty`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct TileKey {
    /// The layer.
    pub layer: LayerId,
    /// Tile column: cells `64·tx` … `64·tx + 63`.
    pub tx: i32,
    /// Tile row: cells `64·ty` … `64·ty + 63`.
    pub ty: i32,
}

impl TileKey {
    /// The tile that holds cell `(cx, cy)`; `None` where it is more than 2³¹ tiles from the origin.
    pub fn of_cell(layer: LayerId, cx: i64, cy: i64) -> Option<Self> {
        Some(Self {
            layer,
            tx: i32::try_from(cx.div_euclid(SIDE)).ok()?,
            ty: i32::try_from(cy.div_euclid(SIDE)).ok()?,
        })
    }

    /// The indices of the tile's cell with the lowest x and y.
    pub fn first_cell(self) -> (i64, i64) {
        (i64::from(self.tx) * SIDE, i64::from(self.ty) * SIDE)
    }

    /// The tile's centre in `odom`, metres.
    pub fn center_m(self, cell_m: f64) -> [f64; 2] {
        let side_m = TILE_SIDE as f64 * cell_m;
        [
            (f64::from(self.tx) + 0.5) * side_m,
            (f64::from(self.ty) + 0.5) * side_m,
        ]
    }
}

impl fmt::Display for TileKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}/{}", self.layer, self.tx, self.ty)
    }
}

/// BLAKE3 of a tile's decoded cells in row order, each a little-endian `u16`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct TileDigest(pub [u8; 32]);

/// One run of the edge program: random, so that revisions of different runs are never compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct BootId(pub [u8; 16]);

/// A published tile.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Which tile.
    pub key: TileKey,
    /// The run of the edge that published it.
    pub boot: BootId,
    /// How often the layer had been erased in that run; tiles of an older epoch are void.
    pub epoch: u32,
    /// Its place in that run's publications, over all layers; the greatest of a tile is its present state.
    pub revision: u64,
    /// Stamp of the newest measurement when it changed last, nanoseconds on the clock of the robot's data.
    pub stamp_ns: i64,
    /// The digest of `cells`.
    pub digest: TileDigest,
    /// The cells; all unknown where the publisher holds the tile no longer.
    pub cells: TileCells,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_left_of_the_origin_belong_to_negative_tiles() {
        let tile =
            |cx, cy| TileKey::of_cell(LayerId::Occupancy, cx, cy).map(|key| (key.tx, key.ty));
        assert_eq!(tile(0, 63), Some((0, 0)));
        assert_eq!(tile(-1, 64), Some((-1, 1)));
        assert_eq!(tile(-64, -65), Some((-1, -2)));
        assert_eq!(tile(i64::MAX, 0), None);
        let far = TileKey::of_cell(LayerId::Shore, i64::from(i32::MIN) * 64, 0).unwrap();
        assert_eq!(far.first_cell(), (i64::from(i32::MIN) * 64, 0));
    }

    #[test]
    fn keys_sort_by_layer_then_column_then_row() {
        let key = |layer, tx, ty| TileKey { layer, tx, ty };
        let sorted = [
            key(LayerId::Occupancy, 5, -1),
            key(LayerId::Elevation, -3, 9),
            key(LayerId::Elevation, 2, -7),
            key(LayerId::Elevation, 2, 0),
        ];
        assert!(sorted.is_sorted());
        assert_eq!(sorted[1].to_string(), "elevation/-3/9");
        assert_eq!(sorted[1].center_m(0.5).map(|m| m as i32), [-80, 304]);
    }
}
