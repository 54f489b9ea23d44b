//! A tile: 64×64 cells of one layer, the unit of publication.
//!
//! Tiles are fixed in `odom`. Cell edges lie at multiples of the layer's cell size; cell `(cx, cy)` covers
//! `cx·cell_m ≤ x < (cx + 1)·cell_m` and likewise in y; tile `(tx, ty)` covers the cells
//! `64·tx ≤ cx < 64·(tx + 1)` and likewise in y.

pub mod codec;

use std::fmt;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::layer::{LayerId, UNKNOWN};

/// Cells along one side of a tile.
pub const TILE_SIDE: usize = SIDE as usize;
/// Cells in a tile.
pub const TILE_CELLS: usize = TILE_SIDE * TILE_SIDE;
/// [`TILE_SIDE`] for cell indices.
pub(crate) const SIDE: i64 = 64;

/// Key of a tile. Ordered by layer, then `tx`, then `ty`.
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
    /// The tile of cell `(cx, cy)`; `None` if it is more than 2³¹ tiles from the origin.
    pub fn of_cell(layer: LayerId, cx: i64, cy: i64) -> Option<Self> {
        Some(Self {
            layer,
            tx: i32::try_from(cx.div_euclid(SIDE)).ok()?,
            ty: i32::try_from(cy.div_euclid(SIDE)).ok()?,
        })
    }

    /// Indices of the tile's cell with the lowest x and y.
    pub fn first_cell(self) -> (i64, i64) {
        (i64::from(self.tx) * SIDE, i64::from(self.ty) * SIDE)
    }

    /// Centre of the tile in `odom`, metres.
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

/// The first bytes of a [`TileDigest`]: what comes with cells, to find whether they are the right ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TileCheck(pub [u8; 8]);

impl TileDigest {
    /// Its first bytes.
    pub fn check(self) -> TileCheck {
        TileCheck(std::array::from_fn(|byte| self.0[byte]))
    }
}

/// Random identifier of one run of the edge program, so that revisions of different runs are never
/// compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct BootId(pub [u8; 16]);

/// A published tile.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Its key.
    pub key: TileKey,
    /// Run of the edge that published it.
    pub boot: BootId,
    /// Number of erasures of the layer in that run; tiles of an older epoch are void.
    pub epoch: u32,
    /// Number of the publication in that run, over all layers; the greatest of a tile is its
    /// present state.
    pub revision: u64,
    /// Stamp of the newest measurement at its last change, nanoseconds on the clock of the robot's
    /// data.
    pub stamp_ns: i64,
    /// That of the digest of `cells`.
    pub check: TileCheck,
    /// All unknown for a tombstone.
    pub cells: TileCells,
}

/// Codes of a tile's cells, row by row from the lowest y, each row from the lowest x.
///
/// Clones share memory until one of them is changed, so a snapshot of a map copies no cells.
#[derive(Clone, PartialEq, Eq)]
pub struct TileCells(Arc<[u16; TILE_CELLS]>);

/// A code that the layer does not use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cell ({x}, {y}) of the tile holds code {code}, which layer {layer} does not use")]
pub struct InvalidCode {
    /// The layer.
    pub layer: LayerId,
    /// Column within the tile.
    pub x: usize,
    /// Row within the tile, upwards.
    pub y: usize,
    /// The code.
    pub code: u16,
}

impl TileCells {
    /// A tile without known cells.
    pub fn unknown() -> Self {
        Self(Arc::new([UNKNOWN; TILE_CELLS]))
    }

    /// A tile of `code(x, y)` for column `x` and row `y`.
    pub fn from_fn(mut code: impl FnMut(usize, usize) -> u16) -> Self {
        Self(Arc::new(std::array::from_fn(|index| {
            code(index % TILE_SIDE, index / TILE_SIDE)
        })))
    }

    /// Code in column `x` and row `y`; `None` outside the tile.
    pub fn get(&self, x: usize, y: usize) -> Option<u16> {
        (x < TILE_SIDE && y < TILE_SIDE).then(|| self.0[y * TILE_SIDE + x])
    }

    /// Codes in row order.
    pub fn codes(&self) -> &[u16; TILE_CELLS] {
        &self.0
    }

    /// Mutable codes in row order, copied first if a clone shares them.
    pub fn codes_mut(&mut self) -> &mut [u16; TILE_CELLS] {
        Arc::make_mut(&mut self.0)
    }

    /// Row `y`, `y < 64`.
    pub fn row(&self, y: usize) -> &[u16] {
        &self.0[y * TILE_SIDE..][..TILE_SIDE]
    }

    /// Number of known cells.
    pub fn known(&self) -> usize {
        // Counted in 16 bits, eight cells at a time.
        let known = self.0.iter().map(|&code| u16::from(code != UNKNOWN));
        usize::from(known.sum::<u16>())
    }

    /// Digest of these cells.
    pub fn digest(&self) -> TileDigest {
        let mut bytes = [0; 2 * TILE_CELLS];
        for (pair, code) in bytes.chunks_exact_mut(2).zip(self.0.iter()) {
            pair.copy_from_slice(&code.to_le_bytes());
        }
        TileDigest(*blake3::hash(&bytes).as_bytes())
    }

    /// Checks that `layer` uses every code here.
    pub fn check(&self, layer: LayerId) -> Result<(), InvalidCode> {
        let quantisation = layer.quantisation();
        // Used codes are contiguous from 0, so the greatest decides, without a branch per cell.
        let greatest = self.0.iter().copied().fold(UNKNOWN, u16::max);
        if quantisation.is_code(greatest) {
            return Ok(());
        }
        match self.0.iter().position(|&code| !quantisation.is_code(code)) {
            None => Ok(()),
            Some(index) => Err(InvalidCode {
                layer,
                x: index % TILE_SIDE,
                y: index / TILE_SIDE,
                code: self.0[index],
            }),
        }
    }
}

impl fmt::Debug for TileCells {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "TileCells({} known)", self.known())
    }
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

    #[test]
    fn rows_run_upwards_and_columns_right() {
        let cells = TileCells::from_fn(|x, y| (y * 100 + x) as u16);
        assert_eq!(cells.get(3, 2), Some(203));
        assert_eq!(cells.row(63)[0], 6300);
        assert_eq!(cells.codes()[64], 100);
        assert_eq!(cells.get(64, 0), None);
        assert_eq!(cells.known(), TILE_CELLS - 1);
    }

    #[test]
    fn clones_are_shared_until_one_is_changed() {
        let cells = TileCells::from_fn(|x, _| x as u16);
        let mut other = cells.clone();
        assert!(Arc::ptr_eq(&cells.0, &other.0));
        other.codes_mut()[3] = 500;
        assert_eq!((cells.codes()[3], other.codes()[3]), (3, 500));
        assert_eq!(cells.codes()[4..], other.codes()[4..]);
    }

    #[test]
    fn a_code_the_layer_lacks_is_pointed_out() {
        let mut cells = TileCells::unknown();
        cells.codes_mut()[64 * 5 + 7] = 3;
        assert_eq!(cells.check(LayerId::Shore), Ok(()));
        let error = cells.check(LayerId::Obstacle).unwrap_err();
        assert_eq!((error.x, error.y, error.code), (7, 5, 3));
    }
}
