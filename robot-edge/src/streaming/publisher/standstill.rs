//! Publishing what is taken back later.

use std::collections::BTreeMap;
use std::sync::{Arc, PoisonError};

use protocol::tile::{TileCells, TileKey};

use super::{PublishError, Publisher, StampedCells, TileTraffic, grids};
use crate::mapping::Mapper;
use crate::mapping::terrain::Terrain;
use crate::mapping::voxel_layers::VoxelLayers;
use crate::streaming::cells_to_tiles::CellCoder;

/// What was in the tiles before they were published; `None` where nothing was.
#[derive(Debug)]
pub struct Published(BTreeMap<TileKey, Option<StampedCells>>);

impl Publisher {
    /// Another publisher into the same store, which remembers what it replaces.
    pub(crate) fn remembering(&self) -> Self {
        Self {
            store: Arc::clone(&self.store),
            changed: Vec::new(),
            coder: CellCoder::new(),
            encoder: None,
            resets: self.resets,
            terrain_erased: self.terrain_erased,
            voxels_erased: self.voxels_erased,
            traffic: TileTraffic::default(),
            replaced: Some(BTreeMap::new()),
        }
    }

    /// What it replaced.
    pub(crate) fn into_published(self) -> Published {
        Published(self.replaced.unwrap_or_default())
    }

    /// Puts back what was replaced.
    pub(crate) fn take_back(&mut self, published: Published) -> Result<(), PublishError> {
        for (key, before) in published.0 {
            match before {
                Some((stamp_ns, cells)) => {
                    self.store().set_stamp(stamp_ns);
                    self.store_tile(key, cells)?;
                }
                None => self.store_tile(key, TileCells::unknown())?,
            }
        }
        Ok(())
    }

    /// Adds to what changed: another publisher published it.
    pub(crate) fn add_changed(&mut self, changed: Vec<TileKey>) {
        self.changed.extend(changed);
    }

    /// Erases every layer, and from now on publishes the changes of `mapper`.
    pub(crate) fn begin_anew(&mut self, mapper: &Mapper) -> Result<(), PublishError> {
        let mut store = self.store.lock().unwrap_or_else(PoisonError::into_inner);
        for grid in grids(mapper) {
            store.erase_layer(grid.layer)?;
        }
        drop(store);
        self.changed.clear();
        self.resets = mapper.resets();
        self.terrain_erased = mapper.terrain().map_or(0, Terrain::erased);
        self.voxels_erased = mapper.voxels().map_or(0, VoxelLayers::erased);
        self.traffic = TileTraffic::default();
        Ok(())
    }
}
