//! Keeps a store within its memory limit.

use super::TileStore;
use crate::tile::{TILE_CELLS, TileKey};
use crate::tile_store::Content;

/// Memory of an entry without cells: its fields, key and share of the tree, rounded up.
pub(super) const TOMBSTONE_BYTES: usize = 128;
/// Memory of an entry with cells.
pub(super) const TILE_BYTES: usize = 2 * TILE_CELLS + TOMBSTONE_BYTES;

/// An eviction frees one part in this many beyond the need: finding the farthest tiles visits all
/// of them.
const SLACK: usize = 32;
/// Tombstones may take one part in this many of the limit.
const TOMBSTONE_SHARE: usize = 8;

impl TileStore {
    /// Replaces the tiles farthest from the focus by tombstones if the limit is exceeded; returns
    /// their keys. A publisher gives each the next revision; a receiver keeps their revisions.
    pub(super) fn evict_beyond_limit(&mut self, is_publisher: bool) -> Vec<TileKey> {
        if self.bytes_held() <= self.limit_bytes {
            return Vec::new();
        }
        self.forget_old_tombstones();
        let target_bytes = self.limit_bytes - self.limit_bytes / SLACK;
        let excess_bytes = self.bytes_held().saturating_sub(target_bytes);
        let count = excess_bytes.div_ceil(TILE_BYTES - TOMBSTONE_BYTES);
        let evicted = self.farthest(count);
        for &key in &evicted {
            let Some(held) = self.get(key) else { continue };
            let (revision, stamp_ns) = if is_publisher {
                (self.last_revision + 1, self.stamp_ns)
            } else {
                (held.revision, held.stamp_ns)
            };
            let tombstone = self.tombstone(revision, stamp_ns, Content::Evicted);
            self.insert(key, tombstone);
        }
        self.counters.tiles_evicted += evicted.len() as u64;
        self.forget_old_tombstones();
        evicted
    }

    /// The `count` tiles with cells farthest from the focus, farthest first.
    fn farthest(&self, count: usize) -> Vec<TileKey> {
        let [focus_x, focus_y] = self.focus_m;
        let mut by_distance: Vec<(f64, TileKey)> = self
            .grids()
            .flat_map(|grid| {
                self.tiles(grid.layer)
                    .filter(|(_, stored)| stored.cells().is_some())
                    .map(move |(key, _)| {
                        let [x, y] = key.center_m(grid.cell_m);
                        let (dx, dy) = (x - focus_x, y - focus_y);
                        (dx * dx + dy * dy, key)
                    })
            })
            .collect();
        by_distance.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        by_distance.truncate(count);
        by_distance.into_iter().map(|(_, key)| key).collect()
    }

    /// Removes the older half of the tombstones if they exceed their share.
    fn forget_old_tombstones(&mut self) {
        if self.tombstones * TOMBSTONE_BYTES <= self.limit_bytes / TOMBSTONE_SHARE {
            return;
        }
        let mut revisions: Vec<u64> = self
            .layers
            .values()
            .flat_map(|held| held.tiles.values())
            .filter(|stored| stored.cells().is_none())
            .map(|stored| stored.revision)
            .collect();
        revisions.sort_unstable();
        let Some(&newest_forgotten) = revisions.get(revisions.len() / 2) else {
            return;
        };
        let before = self.tombstones;
        for held in self.layers.values_mut() {
            held.tiles.retain(|_, stored| {
                let keep = stored.cells().is_some() || stored.revision > newest_forgotten;
                self.tombstones -= usize::from(!keep);
                keep
            });
        }
        self.counters.tombstones_forgotten += (before - self.tombstones) as u64;
    }
}
