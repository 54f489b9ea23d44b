//! Changed tiles as messages: what differs from what was pushed before.

use std::collections::BTreeMap;
use std::sync::Mutex;

use protocol::layer::LayerId;
use protocol::message::{ChangedTile, Changes, TileBand};
use protocol::tile::codec::encode_differences;
use protocol::tile::{TileCells, TileKey};
use protocol::tile_store::TileStore;

use super::replies::{self, with_store};

/// Tiles beyond this number are pushed as a whole again. Their cells are those of the store, or were.
const MAX_TILES: usize = 4096;
/// A message gets no further tile beyond this size.
const FULL_BYTES: usize = 4096;

/// Each tile as it was pushed the last time: consoles that follow hold them.
#[derive(Default)]
pub struct PushedTiles(BTreeMap<TileKey, Pushed>);

#[derive(Clone)]
struct Pushed {
    epoch: u32,
    revision: u64,
    cells: TileCells,
}

/// A band of a tile, and its stamp, nanoseconds.
type StampedBand = (i64, TileKey, TileBand);

impl PushedTiles {
    /// Forgets the other layers: no console follows them.
    pub fn keep_layers(&mut self, is_kept: impl Fn(LayerId) -> bool) {
        self.0.retain(|key, _| is_kept(key.layer));
    }

    /// Messages with these tiles, each with its layer and the stamp of its newest tile, nanoseconds on the clock of the data.
    pub fn changes(
        &mut self,
        store: &Mutex<TileStore>,
        keys: Vec<TileKey>,
    ) -> Vec<(LayerId, i64, Changes)> {
        let mut messages: Vec<(LayerId, usize, Vec<StampedBand>)> = Vec::new();
        for key in keys {
            for (stamp_ns, band) in self.bands(store, key) {
                let bytes = band.rows.len();
                let tile = (stamp_ns, key, band);
                let place = messages
                    .iter_mut()
                    .find(|(layer, size, _)| *layer == key.layer && *size + bytes <= FULL_BYTES);
                if let Some((_, size, tiles)) = place {
                    *size += bytes;
                    tiles.push(tile);
                } else {
                    messages.push((key.layer, bytes, vec![tile]));
                }
            }
        }
        let message = |(layer, _, tiles): (_, _, Vec<StampedBand>)| {
            let newest_ns = tiles.iter().map(|(stamp_ns, ..)| *stamp_ns).max();
            let newest_ns = newest_ns.unwrap_or_default();
            let tiles = tiles.into_iter().map(|(stamp_ns, key, band)| ChangedTile {
                tx: key.tx,
                ty: key.ty,
                older_ns: newest_ns.abs_diff(stamp_ns),
                band,
            });
            let tiles = tiles.collect();
            (layer, newest_ns, Changes { tiles })
        };
        messages.into_iter().map(message).collect()
    }

    fn bands(&mut self, store: &Mutex<TileStore>, key: TileKey) -> Vec<(i64, TileBand)> {
        let Some(tile) = with_store(store, |store| store.tile(key)) else {
            self.0.remove(&key);
            return Vec::new();
        };
        if self.0.len() >= MAX_TILES && !self.0.contains_key(&key) {
            self.0.clear();
        }
        let pushed = Pushed {
            epoch: tile.epoch,
            revision: tile.revision,
            cells: tile.cells.clone(),
        };
        let before = self.0.insert(key, pushed);
        let before = before.filter(|before| before.epoch == tile.epoch);
        let differences = before.and_then(|before| {
            let rows = encode_differences(key.layer, &tile.cells, &before.cells)?;
            Some(TileBand {
                epoch: tile.epoch,
                revision: tile.revision,
                base: before.revision,
                check: tile.check,
                rows,
            })
        });
        match differences {
            Some(band) => vec![(tile.stamp_ns, band)],
            None => replies::bands_of(&tile),
        }
    }
}

#[cfg(test)]
mod tests {
    use protocol::tile::BootId;
    use protocol::tile_store::LayerGrid;

    use super::*;
    use crate::publishing::cells_to_tiles::{tile_of, uniform_tile};

    const LAYER: LayerId = LayerId::Occupancy;

    const fn key(tx: i32) -> TileKey {
        TileKey {
            layer: LAYER,
            tx,
            ty: 0,
        }
    }

    /// Coding, base and column of each band, message by message.
    fn pushed(
        tiles: &mut PushedTiles,
        store: &Mutex<TileStore>,
        keys: &[i32],
    ) -> Vec<Vec<(u8, u64, i32)>> {
        let messages = tiles.changes(store, keys.iter().map(|tx| key(*tx)).collect());
        let of = |tile: &ChangedTile| (tile.band.rows[3], tile.band.base, tile.tx);
        let messages = messages.iter();
        messages
            .map(|(_, _, changes)| changes.tiles.iter().map(of).collect())
            .collect()
    }

    fn publish(store: &Mutex<TileStore>, tx: i32, cells: TileCells) {
        drop(store.lock().unwrap().publish(key(tx), cells).unwrap());
    }

    #[test]
    fn a_tile_is_pushed_whole_once_and_then_what_differs() {
        let mut store = TileStore::new(BootId([1; 16]), 10);
        let grid = LayerGrid {
            layer: LAYER,
            cell_m: 0.1,
        };
        store.set_grid(grid).unwrap();
        let store = Mutex::new(store);
        let mut tiles = PushedTiles::default();
        for tx in 0..3 {
            publish(&store, tx, uniform_tile(5)); // revisions 1 to 3
        }
        let whole = vec![vec![(1, 0, 0), (1, 0, 1)]];
        assert_eq!(pushed(&mut tiles, &store, &[0, 1, 7]), whole);
        publish(&store, 0, uniform_tile(6));
        let both = vec![vec![(2, 1, 0), (1, 0, 2)]];
        assert_eq!(pushed(&mut tiles, &store, &[0, 2]), both);
        // A long tile has its own message; others have one, with the stamp of the newest.
        store.lock().unwrap().set_stamp(9);
        publish(&store, 1, uniform_tile(7));
        let mut state = 1_u32;
        let noise = tile_of(|_, _| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            1 + (state >> 24) as u16 % 251
        });
        publish(&store, 0, noise);
        let keys = pushed(&mut tiles, &store, &[2, 1, 0]);
        assert_eq!(keys, [vec![(2, 3, 2), (2, 2, 1)], vec![(2, 4, 0)]]);
        let stamped = tiles.changes(&store, [2, 1].map(key).into());
        let [(_, stamp_ns, Changes { tiles: both })] = &stamped[..] else {
            panic!("{stamped:?}");
        };
        let older = both.iter().map(|tile| tile.older_ns);
        assert_eq!((*stamp_ns, older.collect::<Vec<_>>()), (9, vec![9, 0]));
        // What was pushed is void after an erasure, and unknown to consoles where nobody follows.
        store.lock().unwrap().erase_layer(LAYER).unwrap();
        publish(&store, 0, uniform_tile(6));
        assert_eq!(pushed(&mut tiles, &store, &[0]), [[(1, 0, 0)]]);
        publish(&store, 0, uniform_tile(8));
        tiles.keep_layers(|layer| layer != LAYER);
        assert_eq!(pushed(&mut tiles, &store, &[0]), [[(1, 0, 0)]]);
    }
}
