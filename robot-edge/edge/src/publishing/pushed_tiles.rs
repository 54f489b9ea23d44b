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

impl PushedTiles {
    /// Forgets the other layers: no console follows them.
    pub fn keep_layers(&mut self, is_kept: impl Fn(LayerId) -> bool) {
        self.0.retain(|key, _| is_kept(key.layer));
    }

    /// Messages with these tiles, each with its layer and the stamp of its tiles, nanoseconds on the clock of the data.
    pub fn changes(
        &mut self,
        store: &Mutex<TileStore>,
        keys: Vec<TileKey>,
    ) -> Vec<(LayerId, i64, Changes)> {
        let mut messages: Vec<(LayerId, i64, Changes)> = Vec::new();
        let mut sizes: Vec<usize> = Vec::new();
        for key in keys {
            for (stamp_ns, band) in self.bands(store, key) {
                let bytes = band.rows.len();
                let found = messages
                    .iter()
                    .zip(&sizes)
                    .position(|((layer, stamp, _), size)| {
                        *layer == key.layer && *stamp == stamp_ns && size + bytes <= FULL_BYTES
                    });
                let (tx, ty) = (key.tx, key.ty);
                let tile = ChangedTile { tx, ty, band };
                if let Some(place) = found {
                    messages[place].2.tiles.push(tile);
                    sizes[place] += bytes;
                } else {
                    messages.push((key.layer, stamp_ns, Changes { tiles: vec![tile] }));
                    sizes.push(bytes);
                }
            }
        }
        messages
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
