//! Every tile ever published: the one truth that exports, digests, announcements and consoles read.
//!
//! The edge [publishes](TileStore::publish) into one store, a console [applies](TileStore::apply) what it
//! receives to another; when both hold the same cells, their [root digests](TileStore::root_digest) agree.
//!
//! A store is bounded. When its tiles outgrow the limit it drops those farthest from the
//! [focus](TileStore::set_focus) and leaves *tombstones*, entries without cells, whose revisions tell the
//! other side that the cells are gone. Tombstones are bounded too: past an eighth of the limit the oldest
//! half is forgotten. Both are counted.

mod error;
mod eviction;
mod publish;
mod receive;
mod root;
mod stored_tile;

use std::collections::{BTreeMap, VecDeque};

use crate::layer::LayerId;
use crate::tile::{BootId, Tile, TileCells, TileDigest, TileKey};

pub use error::StoreError;
pub use publish::Publication;
pub use receive::Applied;
pub use root::RootDigest;
pub use stored_tile::StoredTile;

use stored_tile::Content;

/// A layer and the size of its square cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerGrid {
    /// The layer.
    pub layer: LayerId,
    /// Side of a cell, metres.
    pub cell_m: f64,
}

/// What was dropped to stay within the limit, since the store was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StoreCounters {
    /// Tiles replaced by tombstones.
    pub tiles_evicted: u64,
    /// Tombstones forgotten.
    pub tombstones_forgotten: u64,
}

/// The tiles of all layers of one robot. See the [module](self).
#[derive(Debug)]
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
    /// Earlier boots, so that a late tile of theirs does not pass for yet another boot.
    retired_boots: VecDeque<BootId>,
    unknown_digest: TileDigest,
}

#[derive(Debug)]
struct LayerTiles {
    cell_m: f64,
    epoch: u32,
    head_revision: u64,
    tiles: BTreeMap<(i32, i32), StoredTile>,
}

impl TileStore {
    /// An empty store of run `boot` that keeps its tiles within `tile_store_mb` megabytes (10⁶ bytes, at least
    /// 1). Its layers come by [`set_grid`](Self::set_grid).
    pub fn new(boot: BootId, tile_store_mb: u32) -> Self {
        Self::within_bytes(
            boot,
            (tile_store_mb.max(1) as usize).saturating_mul(1_000_000),
        )
    }

    /// As [`new`](Self::new), with the limit in bytes; of fewer than 8320 not one tile is kept.
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

    /// Adds a layer, or changes the cell size of one that holds nothing.
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

    /// Where the vehicle is, metres in `odom`: when space runs out, the tiles farthest from here go first.
    pub fn set_focus(&mut self, focus_m: [f64; 2]) {
        self.focus_m = focus_m;
    }

    /// Stamp of the newest measurement in what is [published](Self::publish) from now on, nanoseconds on the clock of
    /// the data.
    pub fn set_stamp(&mut self, stamp_ns: i64) {
        self.stamp_ns = stamp_ns;
    }

    /// The run whose revisions the store holds.
    pub fn boot(&self) -> BootId {
        self.boot
    }

    /// The layers with a grid, in wire order.
    pub fn grids(&self) -> impl Iterator<Item = LayerGrid> {
        self.layers.iter().map(|(&layer, held)| LayerGrid {
            layer,
            cell_m: held.cell_m,
        })
    }

    /// The side of a cell of `layer`, metres; `None` where the layer has no grid.
    pub fn cell_m(&self, layer: LayerId) -> Option<f64> {
        self.layers.get(&layer).map(|held| held.cell_m)
    }

    /// How often `layer` has been erased in this boot.
    pub fn epoch(&self, layer: LayerId) -> u32 {
        self.layers.get(&layer).map_or(0, |held| held.epoch)
    }

    /// The greatest revision in `layer`, 0 before the first.
    pub fn head_revision(&self, layer: LayerId) -> u64 {
        self.layers.get(&layer).map_or(0, |held| held.head_revision)
    }

    /// The entry of one tile, tombstones included.
    pub fn get(&self, key: TileKey) -> Option<&StoredTile> {
        self.layers.get(&key.layer)?.tiles.get(&(key.tx, key.ty))
    }

    /// One tile as it is published, tombstones as all-unknown cells.
    pub fn tile(&self, key: TileKey) -> Option<Tile> {
        let stored = self.get(key)?;
        Some(Tile {
            key,
            boot: self.boot,
            epoch: self.epoch(key.layer),
            revision: stored.revision,
            stamp_ns: stored.stamp_ns,
            digest: stored.digest,
            cells: stored.cells().cloned().unwrap_or_else(TileCells::unknown),
        })
    }

    /// The entries of `layer` in key order, tombstones included.
    pub fn tiles(&self, layer: LayerId) -> impl Iterator<Item = (TileKey, &StoredTile)> {
        self.layers
            .get(&layer)
            .into_iter()
            .flat_map(|held| &held.tiles)
            .map(move |(&(tx, ty), stored)| (TileKey { layer, tx, ty }, stored))
    }

    /// The entries of `layer` newer than `revision`, in key order, tombstones included.
    pub fn newer_than(
        &self,
        layer: LayerId,
        revision: u64,
    ) -> impl Iterator<Item = (TileKey, &StoredTile)> {
        self.tiles(layer)
            .filter(move |(_, stored)| stored.revision > revision)
    }

    /// How many tiles of `layer` have known cells.
    pub fn tile_count(&self, layer: LayerId) -> usize {
        self.tiles(layer)
            .filter(|(_, stored)| stored.known > 0)
            .count()
    }

    /// How many cells of `layer` are known.
    pub fn cells_known(&self, layer: LayerId) -> u64 {
        self.tiles(layer)
            .map(|(_, stored)| u64::from(stored.known))
            .sum()
    }

    /// How many cells of `layer` are in each of its classes, in the order of
    /// [`LayerId::classes`]; empty for a continuous layer.
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

    /// Bytes that `layer` takes in memory.
    pub fn bytes(&self, layer: LayerId) -> u64 {
        self.tiles(layer)
            .map(|(_, stored)| match stored.content {
                Content::Cells(_) => eviction::TILE_BYTES as u64,
                Content::Blank | Content::Evicted => eviction::TOMBSTONE_BYTES as u64,
            })
            .sum()
    }

    /// Bytes that all layers take in memory: at most the limit.
    pub fn bytes_held(&self) -> usize {
        self.tiles_held * eviction::TILE_BYTES + self.tombstones * eviction::TOMBSTONE_BYTES
    }

    /// What was dropped to stay within the limit.
    pub fn counters(&self) -> StoreCounters {
        self.counters
    }

    /// Puts an entry where its key says and keeps the tallies; the layer must have a grid.
    fn insert(&mut self, key: TileKey, stored: StoredTile) {
        let Some(held) = self.layers.get_mut(&key.layer) else {
            return;
        };
        held.head_revision = held.head_revision.max(stored.revision);
        self.last_revision = self.last_revision.max(stored.revision);
        match stored.content {
            Content::Cells(_) => self.tiles_held += 1,
            Content::Blank | Content::Evicted => self.tombstones += 1,
        }
        match held.tiles.insert((key.tx, key.ty), stored) {
            Some(StoredTile {
                content: Content::Cells(_),
                ..
            }) => self.tiles_held -= 1,
            Some(_) => self.tombstones -= 1,
            None => {}
        }
    }

    /// Drops every entry of `layer`, which from now on is of `epoch`.
    fn clear_layer(&mut self, layer: LayerId, epoch: u32) {
        let Some(held) = self.layers.get_mut(&layer) else {
            return;
        };
        held.epoch = epoch;
        for stored in std::mem::take(&mut held.tiles).into_values() {
            match stored.content {
                Content::Cells(_) => self.tiles_held -= 1,
                Content::Blank | Content::Evicted => self.tombstones -= 1,
            }
        }
    }

    /// The entry for `cells`; all-unknown cells take no space.
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

#[cfg(test)]
mod tests;
