//! The receiving side: a console's store.

use super::stored_tile::Content;
use super::{StoreError, TileStore};
use crate::layer::LayerId;
use crate::tile::{BootId, Tile, TileKey};

/// Earlier boots remembered.
const RETIRED_BOOTS_MAX: usize = 16;

/// What came of [`TileStore::apply`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Applied {
    /// The tile is now the store's.
    Stored,
    /// It is of a boot that another has followed.
    OldBoot,
    /// Its layer has been erased since.
    OldEpoch,
    /// The store holds it, or a newer one.
    OldRevision,
}

impl TileStore {
    /// Takes a tile from another store, unless it is older than what is held.
    ///
    /// A boot never seen before empties the store; a newer epoch empties the layer. A tile that is refused
    /// changes nothing. Tiles that had to be evicted here keep their revisions, so that the root digest
    /// shows the gap and the publisher's tile may come again.
    pub fn apply(&mut self, tile: Tile) -> Result<Applied, StoreError> {
        let Tile {
            key,
            boot,
            epoch,
            revision,
            stamp_ns,
            digest,
            cells,
        } = tile;
        if !self.layers.contains_key(&key.layer) {
            return Err(StoreError::NoGrid(key.layer));
        }
        cells
            .check(key.layer)
            .map_err(|source| StoreError::Code { key, source })?;
        let stored = self.entry(revision, stamp_ns, cells);
        if stored.digest != digest {
            return Err(StoreError::Digest { key, revision });
        }
        if !self.adopt_boot(boot) {
            return Ok(Applied::OldBoot);
        }
        if !self.adopt_epoch(key.layer, epoch) {
            return Ok(Applied::OldEpoch);
        }
        if let Some(held) = self.get(key)
            && (revision < held.revision || (revision == held.revision && !held.is_evicted()))
        {
            return Ok(Applied::OldRevision);
        }
        self.insert(key, stored);
        let _evicted = self.evict_beyond_limit(false);
        Ok(Applied::Stored)
    }

    /// Drops the entry of a tile that the publisher does not hold any more.
    pub fn forget(&mut self, key: TileKey) {
        let Some(held) = self.layers.get_mut(&key.layer) else {
            return;
        };
        match held
            .tiles
            .remove(&(key.tx, key.ty))
            .map(|gone| gone.content)
        {
            Some(Content::Cells(_)) => self.tiles_held -= 1,
            Some(Content::Blank | Content::Evicted) => self.tombstones -= 1,
            None => {}
        }
    }

    /// Follows the publisher to run `boot`, emptying the store if that is a new one; false where `boot` is
    /// over.
    pub fn adopt_boot(&mut self, boot: BootId) -> bool {
        if boot == self.boot {
            return true;
        }
        if self.retired_boots.contains(&boot) {
            return false;
        }
        if self.retired_boots.len() == RETIRED_BOOTS_MAX {
            self.retired_boots.pop_front();
        }
        self.retired_boots.push_back(self.boot);
        self.boot = boot;
        self.last_revision = 0;
        for layer in LayerId::ALL {
            self.clear_layer(layer, 0);
            if let Some(held) = self.layers.get_mut(&layer) {
                held.head_revision = 0;
            }
        }
        true
    }

    /// Follows the publisher to `epoch` of `layer`, emptying the layer if that is a newer one; false where
    /// `epoch` is over or the layer has no grid.
    pub fn adopt_epoch(&mut self, layer: LayerId, epoch: u32) -> bool {
        let Some(held) = self.layers.get(&layer) else {
            return false;
        };
        if epoch > held.epoch {
            self.clear_layer(layer, epoch);
        }
        epoch >= self.epoch(layer)
    }
}
