//! One digest for all of a layer's cells.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::TileStore;
use crate::layer::LayerId;

/// BLAKE3 over a layer's cells: equal exactly where two stores hold the same cells of the same size.
///
/// Hashed are, integers little-endian: the length of the layer's name (`u8`) and the name; the bits of the
/// cell size in metres (`f64`); then for each tile with at least one known cell, sorted by `tx` and then
/// `ty`: `tx` and `ty` (`i32`) and the tile's digest. Nothing in it depends on history.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RootDigest(pub [u8; 32]);

impl fmt::Display for RootDigest {
    /// In hexadecimal.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl TileStore {
    /// The digest of all cells of `layer`; `None` where it has no grid.
    pub fn root_digest(&self, layer: LayerId) -> Option<RootDigest> {
        let cell_m = self.cell_m(layer)?;
        let name = layer.name();
        let mut hasher = blake3::Hasher::new();
        hasher.update(&[name.len() as u8]);
        hasher.update(name.as_bytes());
        hasher.update(&cell_m.to_bits().to_le_bytes());
        for (key, stored) in self.tiles(layer) {
            if stored.known() > 0 {
                hasher.update(&key.tx.to_le_bytes());
                hasher.update(&key.ty.to_le_bytes());
                hasher.update(&stored.digest().0);
            }
        }
        Some(RootDigest(*hasher.finalize().as_bytes()))
    }
}
