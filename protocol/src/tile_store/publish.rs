//! The publishing side: the edge's store.

use super::{LayerTiles, StoreError, TileStore};
use crate::layer::LayerId;
use crate::tile::{TileCells, TileKey};

/// What came of [`TileStore::publish`].
#[derive(Clone, Debug, PartialEq, Eq)]
#[must_use = "a changed tile is to be sent"]
pub enum Publication {
    /// The tile changed.
    Published {
        /// Its new revision.
        revision: u64,
        /// Tiles that became tombstones to make room, with newer revisions; possibly the tile itself,
        /// where it is the farthest from the focus.
        evicted: Vec<TileKey>,
    },
    /// The store held exactly these cells.
    Unchanged,
}

impl TileStore {
    /// Takes `cells` as the state of tile `key`, with the next revision if that changes anything.
    pub fn publish(&mut self, key: TileKey, cells: TileCells) -> Result<Publication, StoreError> {
        let held = self
            .layers
            .get(&key.layer)
            .ok_or(StoreError::NoGrid(key.layer))?;
        cells
            .check(key.layer)
            .map_err(|source| StoreError::Code { key, source })?;
        if is_unchanged(held, key, &cells) {
            return Ok(Publication::Unchanged);
        }
        let revision = self.last_revision + 1;
        let stored = self.entry(revision, self.stamp_ns, cells);
        self.insert(key, stored);
        let evicted = self.evict_beyond_limit(true);
        Ok(Publication::Published { revision, evicted })
    }

    /// Forgets all of `layer` and returns its new epoch: older tiles of it are void everywhere.
    pub fn erase_layer(&mut self, layer: LayerId) -> Result<u32, StoreError> {
        let held = self.layers.get(&layer).ok_or(StoreError::NoGrid(layer))?;
        let epoch = held.epoch.saturating_add(1);
        self.clear_layer(layer, epoch);
        Ok(epoch)
    }
}

fn is_unchanged(held: &LayerTiles, key: TileKey, cells: &TileCells) -> bool {
    match held
        .tiles
        .get(&(key.tx, key.ty))
        .and_then(|stored| stored.cells())
    {
        Some(before) => before == cells,
        None => cells.known() == 0,
    }
}
