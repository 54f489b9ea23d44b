//! The 4096 cell codes of a tile.

use std::fmt;
use std::sync::Arc;

use super::{TILE_CELLS, TILE_SIDE, TileDigest};
use crate::layer::{LayerId, UNKNOWN};

/// The codes of a tile's cells, row by row from the lowest y, each row from the lowest x.
///
/// Clones share one piece of memory until one of them is changed: who wants a whole map as it is now copies no cells.
#[derive(Clone, PartialEq, Eq)]
pub struct TileCells(Arc<[u16; TILE_CELLS]>);

/// A code that its layer does not use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cell ({x}, {y}) of the tile holds code {code}, which layer {layer} does not use")]
pub struct InvalidCode {
    /// The layer.
    pub layer: LayerId,
    /// Column within the tile.
    pub x: usize,
    /// Row within the tile, upwards.
    pub y: usize,
    /// What is there.
    pub code: u16,
}

impl TileCells {
    /// A tile of which nothing is known.
    pub fn unknown() -> Self {
        Self(Arc::new([UNKNOWN; TILE_CELLS]))
    }

    /// A tile whose cell in column `x` and row `y` holds `code(x, y)`.
    pub fn from_fn(mut code: impl FnMut(usize, usize) -> u16) -> Self {
        Self(Arc::new(std::array::from_fn(|index| {
            code(index % TILE_SIDE, index / TILE_SIDE)
        })))
    }

    /// The code in column `x` and row `y`; `None` outside the tile.
    pub fn get(&self, x: usize, y: usize) -> Option<u16> {
        (x < TILE_SIDE && y < TILE_SIDE).then(|| self.0[y * TILE_SIDE + x])
    }

    /// All codes in row order.
    pub fn codes(&self) -> &[u16; TILE_CELLS] {
        &self.0
    }

    /// All codes in row order. Where a clone shares them they are copied first.
    pub fn codes_mut(&mut self) -> &mut [u16; TILE_CELLS] {
        Arc::make_mut(&mut self.0)
    }

    /// Row `y` from the lowest x; `y < 64`.
    pub fn row(&self, y: usize) -> &[u16] {
        &self.0[y * TILE_SIDE..][..TILE_SIDE]
    }

    /// How many cells are known.
    pub fn known(&self) -> usize {
        // Counted in 16 bits, which a tile's cells fit, eight at a time.
        let known = self.0.iter().map(|&code| u16::from(code != UNKNOWN));
        usize::from(known.sum::<u16>())
    }

    /// The digest of these cells.
    pub fn digest(&self) -> TileDigest {
        let mut bytes = [0; 2 * TILE_CELLS];
        for (pair, code) in bytes.chunks_exact_mut(2).zip(self.0.iter()) {
            pair.copy_from_slice(&code.to_le_bytes());
        }
        TileDigest(*blake3::hash(&bytes).as_bytes())
    }

    /// Whether `layer` uses every code here.
    pub fn check(&self, layer: LayerId) -> Result<(), InvalidCode> {
        let quantisation = layer.quantisation();
        // Codes are used from 0 up: without a branch per cell, the greatest tells of all.
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
    fn digest_is_blake3_of_little_endian_rows() {
        let cells = TileCells::from_fn(|x, y| (y * 64 + x) as u16);
        let bytes: Vec<u8> = (0..4096_u16).flat_map(u16::to_le_bytes).collect();
        assert_eq!(cells.digest().0, *blake3::hash(&bytes).as_bytes());
        assert_eq!(
            blake3::Hash::from(TileCells::unknown().digest().0).to_string(),
            blake3::hash(&[0; 8192]).to_string()
        );
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
