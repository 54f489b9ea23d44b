//! The store of all published tiles, from which exports, digests, announcements and consoles read.
//!
//! The edge [publishes](TileStore::publish) into one store, a console [applies](TileStore::apply)
//! what it receives to another. If both hold the same cells, their [root
//! digests](TileStore::root_digest) are equal.
//!
//! A store is bounded. Beyond the limit it replaces the tiles farthest from the
//! [focus](TileStore::set_focus) by *tombstones*, entries without cells, whose revisions tell the
//! other side that the cells are gone. When tombstones exceed an eighth of the limit, the older
//! half is removed. Both are counted.

mod eviction;
mod overview;

use std::collections::{BTreeMap, VecDeque};
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::layer::LayerId;
use crate::tile::{BootId, InvalidCode, TILE_CELLS, Tile, TileCells, TileDigest, TileKey};
pub use overview::OVERVIEW_STEP;

/// A layer and the size of its square cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerGrid {
    /// The layer.
    pub layer: LayerId,
    /// Side of a cell, metres.
    pub cell_m: f64,
}

/// Evictions since the store was created.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StoreCounters {
    /// Tiles replaced by tombstones.
    pub tiles_evicted: u64,
    /// Tombstones forgotten.
    pub tombstones_forgotten: u64,
}

/// Tiles of all layers of one robot. See the [module](self).
#[derive(Clone, Debug)]
pub struct TileStore {
    boot: BootId,
    last_revision: u64,
    layers: BTreeMap<LayerId, LayerTiles>,
    focus_m: [f64; 2],
    stamp_ns: i64,
    limit_bytes: usize,
    tiles_held: usize,
    tombstones: usize,
    counters: StoreCounters,
    /// Earlier boots, so that their late tiles are not taken for a new boot.
    retired_boots: VecDeque<BootId>,
    unknown_digest: TileDigest,
}

#[derive(Clone, Debug)]
struct LayerTiles {
    cell_m: f64,
    epoch: u32,
    head_revision: u64,
    tiles: BTreeMap<(i32, i32), StoredTile>,
    /// Cells to show where there is no tile.
    overviews: BTreeMap<(i32, i32), TileCells>,
}

impl TileStore {
    /// An empty store of run `boot`, limited to `tile_store_mb` megabytes (10⁶ bytes, at least 1).
    /// Add layers with [`set_grid`](Self::set_grid).
    pub fn new(boot: BootId, tile_store_mb: u32) -> Self {
        Self::within_bytes(
            boot,
            (tile_store_mb.max(1) as usize).saturating_mul(1_000_000),
        )
    }

    /// As [`new`](Self::new), with the limit in bytes; below 8320 it keeps no tile.
    pub fn within_bytes(boot: BootId, limit_bytes: usize) -> Self {
        Self {
            boot,
            last_revision: 0,
            layers: BTreeMap::new(),
            focus_m: [0.0; 2],
            stamp_ns: 0,
            limit_bytes,
            tiles_held: 0,
            tombstones: 0,
            counters: StoreCounters::default(),
            retired_boots: VecDeque::new(),
            unknown_digest: TileCells::unknown().digest(),
        }
    }

    /// Adds a layer, or changes the cell size of an empty one.
    pub fn set_grid(&mut self, grid: LayerGrid) -> Result<(), StoreError> {
        let LayerGrid { layer, cell_m } = grid;
        if !(cell_m.is_finite() && cell_m > 0.0) {
            return Err(StoreError::CellSize { layer, cell_m });
        }
        let entry = self.layers.entry(layer).or_insert(LayerTiles {
            cell_m,
            epoch: 0,
            head_revision: 0,
            tiles: BTreeMap::new(),
            overviews: BTreeMap::new(),
        });
        if entry.cell_m.to_bits() != cell_m.to_bits() {
            if !entry.tiles.is_empty() {
                return Err(StoreError::GridInUse {
                    layer,
                    held_m: entry.cell_m,
                    cell_m,
                });
            }
            entry.cell_m = cell_m;
        }
        Ok(())
    }

    /// Position of the vehicle, metres in `odom`: the tiles farthest from here are evicted first.
    pub fn set_focus(&mut self, focus_m: [f64; 2]) {
        self.focus_m = focus_m;
    }

    /// Stamp of the newest measurement for later [`publish`](Self::publish) calls, nanoseconds on
    /// the clock of the data.
    pub fn set_stamp(&mut self, stamp_ns: i64) {
        self.stamp_ns = stamp_ns;
    }

    /// Run to which the revisions belong.
    pub fn boot(&self) -> BootId {
        self.boot
    }

    /// Layers with a grid, in wire order.
    pub fn grids(&self) -> impl Iterator<Item = LayerGrid> {
        self.layers.iter().map(|(&layer, held)| LayerGrid {
            layer,
            cell_m: held.cell_m,
        })
    }

    /// Side of a cell of `layer`, metres; `None` without a grid.
    pub fn cell_m(&self, layer: LayerId) -> Option<f64> {
        self.layers.get(&layer).map(|held| held.cell_m)
    }

    /// Number of erasures of `layer` in this boot.
    pub fn epoch(&self, layer: LayerId) -> u32 {
        self.layers.get(&layer).map_or(0, |held| held.epoch)
    }

    /// Greatest revision in `layer`, 0 before the first.
    pub fn head_revision(&self, layer: LayerId) -> u64 {
        self.layers.get(&layer).map_or(0, |held| held.head_revision)
    }

    /// Entry of a tile, possibly a tombstone.
    pub fn get(&self, key: TileKey) -> Option<&StoredTile> {
        self.layers.get(&key.layer)?.tiles.get(&(key.tx, key.ty))
    }

    /// A tile as published; a tombstone has unknown cells.
    pub fn tile(&self, key: TileKey) -> Option<Tile> {
        let stored = self.get(key)?;
        Some(Tile {
            key,
            boot: self.boot,
            epoch: self.epoch(key.layer),
            revision: stored.revision,
            stamp_ns: stored.stamp_ns,
            check: stored.digest.check(),
            cells: stored.cells().cloned().unwrap_or_else(TileCells::unknown),
        })
    }

    /// Entries of `layer` in key order, including tombstones.
    pub fn tiles(&self, layer: LayerId) -> impl Iterator<Item = (TileKey, &StoredTile)> {
        self.layers
            .get(&layer)
            .into_iter()
            .flat_map(|held| &held.tiles)
            .map(move |(&(tx, ty), stored)| (TileKey { layer, tx, ty }, stored))
    }

    /// Entries of `layer` newer than `revision`, in key order, including tombstones.
    pub fn newer_than(
        &self,
        layer: LayerId,
        revision: u64,
    ) -> impl Iterator<Item = (TileKey, &StoredTile)> {
        self.tiles(layer)
            .filter(move |(_, stored)| stored.revision > revision)
    }

    /// Number of tiles of `layer` with known cells.
    pub fn tile_count(&self, layer: LayerId) -> usize {
        self.tiles(layer)
            .filter(|(_, stored)| stored.known > 0)
            .count()
    }

    /// Number of known cells of `layer`.
    pub fn cells_known(&self, layer: LayerId) -> u64 {
        self.tiles(layer)
            .map(|(_, stored)| u64::from(stored.known))
            .sum()
    }

    /// Number of cells of each class, in the order of [`LayerId::classes`]; empty for a continuous
    /// layer.
    pub fn class_counts(&self, layer: LayerId) -> Vec<(&'static str, u64)> {
        let classes = layer.classes();
        let mut counts = vec![0_u64; classes.len() + 1];
        if !classes.is_empty() {
            let cells = self.tiles(layer).filter_map(|(_, stored)| stored.cells());
            for &code in cells.flat_map(TileCells::codes) {
                counts[usize::from(code)] += 1;
            }
        }
        classes
            .iter()
            .zip(&counts[1..])
            .map(|(class, &count)| (class.name, count))
            .collect()
    }

    /// Memory of `layer`, bytes.
    pub fn bytes(&self, layer: LayerId) -> u64 {
        self.tiles(layer)
            .map(|(_, stored)| match stored.cells() {
                Some(_) => eviction::TILE_BYTES as u64,
                None => eviction::TOMBSTONE_BYTES as u64,
            })
            .sum()
    }

    /// Memory of all layers, bytes; at most the limit.
    pub fn bytes_held(&self) -> usize {
        self.tiles_held * eviction::TILE_BYTES + self.tombstones * eviction::TOMBSTONE_BYTES
    }

    /// Evictions.
    pub fn counters(&self) -> StoreCounters {
        self.counters
    }

    /// Inserts an entry and updates the totals; the layer must have a grid.
    fn insert(&mut self, key: TileKey, stored: StoredTile) {
        let Some(held) = self.layers.get_mut(&key.layer) else {
            return;
        };
        held.head_revision = held.head_revision.max(stored.revision);
        self.last_revision = self.last_revision.max(stored.revision);
        held.overviews.remove(&(key.tx, key.ty));
        let has_cells = stored.cells().is_some();
        let replaced = held.tiles.insert((key.tx, key.ty), stored);
        *self.total(has_cells) += 1;
        if let Some(replaced) = replaced {
            *self.total(replaced.cells().is_some()) -= 1;
        }
    }

    /// Number of entries with cells, or of tombstones.
    fn total(&mut self, has_cells: bool) -> &mut usize {
        if has_cells {
            &mut self.tiles_held
        } else {
            &mut self.tombstones
        }
    }

    /// Removes every entry of `layer` and sets its epoch.
    fn clear_layer(&mut self, layer: LayerId, epoch: u32) {
        let Some(held) = self.layers.get_mut(&layer) else {
            return;
        };
        held.epoch = epoch;
        held.overviews.clear();
        for stored in std::mem::take(&mut held.tiles).into_values() {
            *self.total(stored.cells().is_some()) -= 1;
        }
    }

    /// Entry for `cells`; all-unknown cells take no memory.
    fn entry(&self, revision: u64, stamp_ns: i64, cells: TileCells) -> StoredTile {
        match cells.known() {
            0 => self.tombstone(revision, stamp_ns, Content::Blank),
            known => StoredTile {
                revision,
                stamp_ns,
                digest: cells.digest(),
                known: known as u16,
                content: Content::Cells(cells),
            },
        }
    }

    fn tombstone(&self, revision: u64, stamp_ns: i64, content: Content) -> StoredTile {
        StoredTile {
            revision,
            stamp_ns,
            digest: self.unknown_digest,
            known: 0,
            content,
        }
    }
}

/// Reason why a store refused a tile or grid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StoreError {
    /// The store has no grid for the tile's layer.
    #[error("layer {0} has no grid in this store: call set_grid first")]
    NoGrid(LayerId),
    /// Invalid cell size.
    #[error("cell size {cell_m} m of layer {layer} is not a positive number")]
    CellSize {
        /// The layer.
        layer: LayerId,
        /// Refused size.
        cell_m: f64,
    },
    /// Another cell size while tiles are held.
    #[error("layer {layer} holds tiles of {held_m} m cells, not {cell_m} m: erase it first")]
    GridInUse {
        /// The layer.
        layer: LayerId,
        /// Size of the held cells.
        held_m: f64,
        /// Refused size.
        cell_m: f64,
    },
    /// A code that the layer does not use.
    #[error("tile {key}: {source}")]
    Code {
        /// Refused tile.
        key: TileKey,
        /// Position and code.
        source: InvalidCode,
    },
    /// Cells that differ from the publisher's digest.
    #[error("tile {key}, revision {revision}: its cells do not match its digest, ask for it again")]
    Digest {
        /// Refused tile.
        key: TileKey,
        /// Its revision.
        revision: u64,
    },
}

/// Entry of a store.
#[derive(Clone, Debug)]
pub struct StoredTile {
    revision: u64,
    stamp_ns: i64,
    digest: TileDigest,
    known: u16,
    content: Content,
}

#[derive(Clone, Debug)]
enum Content {
    Cells(TileCells),
    /// Published as all unknown.
    Blank,
    /// Dropped because of the memory limit.
    Evicted,
}

impl StoredTile {
    /// Revision of its present state.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Stamp of the newest measurement at its last change, nanoseconds on the clock of the data.
    pub fn stamp_ns(&self) -> i64 {
        self.stamp_ns
    }

    /// Digest of its cells, or of unknown cells.
    pub fn digest(&self) -> TileDigest {
        self.digest
    }

    /// Number of known cells.
    pub fn known(&self) -> usize {
        usize::from(self.known)
    }

    /// `None` if no cell is known.
    pub fn cells(&self) -> Option<&TileCells> {
        match &self.content {
            Content::Cells(cells) => Some(cells),
            Content::Blank | Content::Evicted => None,
        }
    }

    /// Whether it was dropped because of the memory limit.
    pub fn is_evicted(&self) -> bool {
        matches!(self.content, Content::Evicted)
    }
}

// A tile's known cells fit the u16 that counts them.
const _: () = assert!(TILE_CELLS <= u16::MAX as usize);

/// BLAKE3 over a layer's cells: equal if and only if two stores hold the same cells of the same
/// size.
///
/// Input, integers little-endian: length of the layer's name (`u8`), name, bits of the cell size in
/// metres (`f64`); then for each tile with a known cell, sorted by `tx` and then `ty`: `tx` and
/// `ty` (`i32`) and the tile's digest. It does not depend on history.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RootDigest(pub [u8; 32]);

impl fmt::Display for RootDigest {
    /// In hexadecimal.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl TileStore {
    /// Digest of all cells of `layer`; `None` without a grid.
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

/// Result of [`TileStore::publish`].
#[derive(Clone, Debug, PartialEq, Eq)]
#[must_use = "a changed tile is to be sent"]
pub enum Publication {
    /// The tile changed.
    Published {
        /// New revision.
        revision: u64,
        /// Tiles that became tombstones with newer revisions; possibly the tile itself.
        evicted: Vec<TileKey>,
    },
    /// The store already held these cells.
    Unchanged,
}

impl TileStore {
    /// Sets the cells of tile `key`, with the next revision if they change.
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

    /// Erases `layer` and returns its new epoch, which invalidates its older tiles everywhere.
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

/// Number of stored earlier boots.
const RETIRED_BOOTS_MAX: usize = 16;

/// Result of [`TileStore::apply`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Applied {
    /// The tile was stored.
    Stored,
    /// Its boot was replaced by another.
    OldBoot,
    /// Its layer has been erased since.
    OldEpoch,
    /// The store holds this revision or a newer one.
    OldRevision,
}

impl TileStore {
    /// Applies a tile from another store, unless it is outdated.
    ///
    /// A new boot empties the store; a newer epoch empties the layer. A refused tile changes
    /// nothing. Tiles that are evicted here keep their revisions, so the root digest shows the gap
    /// and the publisher's tile may be applied again.
    pub fn apply(&mut self, tile: Tile) -> Result<Applied, StoreError> {
        let Tile {
            key,
            boot,
            epoch,
            revision,
            stamp_ns,
            check,
            cells,
        } = tile;
        if !self.layers.contains_key(&key.layer) {
            return Err(StoreError::NoGrid(key.layer));
        }
        cells
            .check(key.layer)
            .map_err(|source| StoreError::Code { key, source })?;
        let stored = self.entry(revision, stamp_ns, cells);
        if stored.digest.check() != check {
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

    /// Removes a tile that the publisher no longer holds.
    pub fn forget(&mut self, key: TileKey) {
        let held = self.layers.get_mut(&key.layer);
        if let Some(gone) = held.and_then(|held| held.tiles.remove(&(key.tx, key.ty))) {
            *self.total(gone.cells().is_some()) -= 1;
        }
    }

    /// Switches to the publisher's run `boot`, emptying the store if it is new; false if `boot` is
    /// outdated.
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

    /// Switches to the publisher's `epoch` of `layer`, emptying the layer if it is newer; false if
    /// `epoch` is outdated or the layer has no grid.
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

#[cfg(test)]
mod tests;
