//! What was published, to go back to.

use protocol::layer::LayerId;
use protocol::tile::{TILE_CELLS, TileKey};

use super::{PublishError, Publisher, StampedCells, TileTraffic, stamped_cells};

/// All that a publisher knows, and all tiles that it published.
#[derive(Clone, Debug)]
pub(crate) struct PublisherState {
    tiles: Vec<(TileKey, StampedCells)>,
    resets: u32,
    terrain_erased: u32,
    voxels_erased: u32,
    traffic: TileTraffic,
}

impl PublisherState {
    pub(crate) fn bytes(&self) -> usize {
        self.tiles.len() * TILE_CELLS * size_of::<u16>()
    }
}

impl Publisher {
    pub(crate) fn state(&self) -> PublisherState {
        let store = self.store();
        let layers: Vec<LayerId> = store.grids().map(|grid| grid.layer).collect();
        let tiles = layers.into_iter().flat_map(|layer| store.tiles(layer));
        PublisherState {
            tiles: tiles
                .filter_map(|(key, stored)| Some((key, stamped_cells(stored)?)))
                .collect(),
            resets: self.resets,
            terrain_erased: self.terrain_erased,
            voxels_erased: self.voxels_erased,
            traffic: self.traffic,
        }
    }

    /// Publishes the tiles of then, and no others, in a new epoch of each layer.
    pub(crate) fn restore(&mut self, state: &PublisherState) -> Result<(), PublishError> {
        let mut store = self.store();
        let layers: Vec<LayerId> = store.grids().map(|grid| grid.layer).collect();
        for layer in layers {
            store.erase_layer(layer)?;
        }
        drop(store);
        self.changed.clear();
        for (key, (stamp_ns, cells)) in &state.tiles {
            self.store().set_stamp(*stamp_ns);
            self.store_tile(*key, cells.clone())?;
        }
        self.resets = state.resets;
        self.terrain_erased = state.terrain_erased;
        self.voxels_erased = state.voxels_erased;
        self.traffic = state.traffic;
        Ok(())
    }
}
