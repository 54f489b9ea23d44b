//! Changed map cells go into the tile store: what is published *is* what is exported.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use protocol::layer::LayerId;
use protocol::tile::codec::Encoder;
use protocol::tile::{BootId, TILE_CELLS, TileCells, TileKey};
use protocol::tile_store::{LayerGrid, Publication, StoreError, TileStore};

use super::cells_to_tiles::{CellCoder, keep_known, key};
use crate::mapping::Mapper;

/// Publishes the changes of a mapper.
pub struct Publisher {
    /// Shared with whoever answers consoles; held for one tile at a time.
    store: Arc<Mutex<TileStore>>,
    /// Published since [`Publisher::take_changed`].
    changed: Vec<TileKey>,
    coder: CellCoder,
    encoder: Option<Encoder>,
    traffic: TileTraffic,
}

/// What publishing amounted to so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TileTraffic {
    /// Tiles that changed and were published.
    pub published: u64,
    /// Their encoded size, bytes; 0 where nobody listens and nothing is encoded.
    pub bytes: u64,
    /// Their size at 4 bytes a cell.
    pub raw_bytes: u64,
    /// Tiles that left the mapping memory to keep its limit; the store still holds them.
    pub evicted_from_mapping: u64,
}

/// Why publishing stopped.
#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    /// The store refused a tile.
    #[error("the tile store refused a tile: {0}")]
    Store(#[from] StoreError),
    /// zstd could not be set up.
    #[error("zstd could not be set up: {0}")]
    Encoder(#[from] std::io::Error),
}

impl Publisher {
    /// For the layers of `mapper`, with a store of at most `store_mb` megabytes.
    ///
    /// Tiles are encoded only if `encode`: somebody listens, or wants to know what it would cost.
    pub fn new(
        boot: BootId,
        store_mb: u32,
        mapper: &Mapper,
        encode: bool,
    ) -> Result<Self, PublishError> {
        let mut store = TileStore::new(boot, store_mb);
        let cell_m = mapper.occupancy().cell_m();
        store.set_grid(LayerGrid {
            layer: LayerId::Occupancy,
            cell_m,
        })?;
        let encoder = if encode { Some(Encoder::new()?) } else { None };
        Ok(Self {
            store: Arc::new(Mutex::new(store)),
            changed: Vec::new(),
            coder: CellCoder::new(),
            encoder,
            traffic: TileTraffic::default(),
        })
    }

    /// Publishes every tile that changed since the last call, then keeps the mapper's memory limits.
    pub fn publish(&mut self, mapper: &mut Mapper) -> Result<(), PublishError> {
        let vehicle = mapper.vehicle_in_odom();
        self.store().set_focus([vehicle.x, vehicle.y]);
        for index in mapper.take_changed_occupancy() {
            if let Some(tile) = mapper.occupancy().grid().get(index) {
                let cells = self.coder.occupancy(tile);
                self.publish_tile(key(LayerId::Occupancy, index), cells)?;
            }
        }
        self.traffic.evicted_from_mapping += mapper.keep_limits() as u64;
        Ok(())
    }

    fn publish_tile(&mut self, key: TileKey, mut cells: TileCells) -> Result<(), PublishError> {
        let mut store = self.store.lock().unwrap_or_else(PoisonError::into_inner);
        // A tile that was evicted from the mapping memory and seen again starts blank there, but what was
        // published stays true until something newer is known.
        if let Some(before) = store.get(key).and_then(|stored| stored.cells()) {
            keep_known(&mut cells, before);
        }
        if let Publication::Published { evicted, .. } = store.publish(key, cells)? {
            self.traffic.published += 1;
            self.traffic.raw_bytes += 4 * TILE_CELLS as u64;
            if let (Some(encoder), Some(cells)) = (
                &mut self.encoder,
                store.get(key).and_then(|stored| stored.cells()),
            ) {
                let bands = encoder.encode(cells);
                self.traffic.bytes += bands.iter().map(|band| band.len() as u64).sum::<u64>();
            }
            self.changed.push(key);
            self.changed.extend(evicted);
        }
        Ok(())
    }

    /// The store, for as long as the guard is held.
    pub fn store(&self) -> MutexGuard<'_, TileStore> {
        self.store.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The store, to be shared with the link.
    pub fn shared_store(&self) -> Arc<Mutex<TileStore>> {
        Arc::clone(&self.store)
    }

    /// The tiles that changed since the last call, in the order of publication.
    pub fn take_changed(&mut self) -> Vec<TileKey> {
        std::mem::take(&mut self.changed)
    }

    /// What publishing amounted to so far.
    pub const fn traffic(&self) -> TileTraffic {
        self.traffic
    }
}
