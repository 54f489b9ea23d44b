//! Tiles that wait to be pushed: each once, nearest first.

use std::collections::BTreeSet;

use protocol::layer::LayerId;
use protocol::tile::TileKey;

/// Maximum number of tiles. A console finds further ones by their digests.
const MAX_WAITING: usize = 100_000;

#[derive(Clone, Debug, Default)]
pub struct TileQueue {
    waiting: BTreeSet<TileKey>,
    not_queued: u64,
}

impl TileQueue {
    /// Queues a tile once: the newest state is sent.
    pub fn add(&mut self, key: TileKey) {
        if self.waiting.len() < MAX_WAITING || self.waiting.contains(&key) {
            self.waiting.insert(key);
        } else {
            self.not_queued += 1;
        }
    }

    /// Takes up to `limit` tiles, those first whose centre is nearest to any of the points `near_m`
    /// (metres in `odom`); `cell_m` gives the cell size of a tile's layer.
    pub fn take_nearest(
        &mut self,
        limit: usize,
        near_m: &[[f64; 2]],
        cell_m: impl Fn(TileKey) -> f64,
    ) -> Vec<TileKey> {
        let distance = |key: &TileKey| {
            let [x, y] = key.center_m(cell_m(*key));
            let squares = near_m
                .iter()
                .map(|[px, py]| (x - px) * (x - px) + (y - py) * (y - py));
            squares.fold(f64::INFINITY, f64::min)
        };
        let mut keys: Vec<(f64, TileKey)> = self
            .waiting
            .iter()
            .map(|key| (distance(key), *key))
            .collect();
        keys.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        keys.truncate(limit);
        for (_, key) in &keys {
            self.waiting.remove(key);
        }
        keys.into_iter().map(|(_, key)| key).collect()
    }

    /// Whether a tile waits whose centre is within `radius_m` of a point, metres in `odom`; `cell_m` as above.
    pub fn has_within(
        &self,
        radius_m: f64,
        [x, y]: [f64; 2],
        cell_m: impl Fn(TileKey) -> f64,
    ) -> bool {
        self.waiting.iter().any(|key| {
            let [tile_x, tile_y] = key.center_m(cell_m(*key));
            libm::hypot(tile_x - x, tile_y - y) <= radius_m
        })
    }

    /// Removes the tiles of layers that no console shows: a console that shows one requests it.
    pub fn keep_layers(&mut self, is_wanted: impl Fn(LayerId) -> bool) {
        self.waiting.retain(|key| is_wanted(key.layer));
    }

    pub fn clear(&mut self) {
        self.waiting.clear();
    }

    pub fn len(&self) -> usize {
        self.waiting.len()
    }

    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Changes that found the queue full.
    pub const fn not_queued(&self) -> u64 {
        self.not_queued
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(tx: i32) -> TileKey {
        TileKey {
            layer: LayerId::Occupancy,
            tx,
            ty: 0,
        }
    }

    #[test]
    fn tiles_leave_once_and_nearest_first() {
        let mut tile_queue = TileQueue::default();
        for tx in [9, -4, 0, 9, 2, -4] {
            tile_queue.add(key(tx));
        }
        let taken = tile_queue.take_nearest(3, &[[9.5 * 6.4, 0.0], [-4.0 * 6.4, 0.0]], |_| 0.1);
        assert_eq!(taken, [9, -4, 0].map(key));
        assert_eq!(tile_queue.len(), 1);
        // Its centre is at 16 m.
        assert!(tile_queue.has_within(3.5, [16.0, 0.0], |_| 0.1));
        assert!(!tile_queue.has_within(2.0, [16.0, 0.0], |_| 0.1));
        tile_queue.add(key(9));
        assert_eq!(
            tile_queue.take_nearest(9, &[[0.0, 0.0]], |_| 0.1),
            [2, 9].map(key)
        );
        assert!(tile_queue.is_empty());
    }

    #[test]
    fn a_full_outbox_counts_what_it_cannot_take() {
        let mut tile_queue = TileQueue::default();
        for tx in 0..i32::try_from(MAX_WAITING).unwrap() + 3 {
            tile_queue.add(key(tx));
        }
        tile_queue.add(key(0));
        assert_eq!(
            (tile_queue.len(), tile_queue.not_queued()),
            (MAX_WAITING, 3)
        );
    }
}
