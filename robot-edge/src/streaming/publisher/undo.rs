//! Publishing what is taken back later.

use std::collections::BTreeMap;
use std::sync::{Arc, PoisonError};

use protocol::tile::{TileCells, TileKey};

use super::{PublishError, Publisher, StampedCells, TileTraffic, grids};
use crate::streaming::cells_to_tiles::CellCoder;
use mapping::Mapper;
use mapping::terrain::Terrain;
use mapping::voxel_layers::VoxelLayers;

/// What was in the tiles before they were published; `None` where nothing was.
#[derive(Debug)]
pub struct ReplacedTiles(BTreeMap<TileKey, Option<StampedCells>>);

impl Publisher {
    /// Another publisher into the same store, which remembers what it replaces.
    pub(crate) fn with_undo(&self) -> Self {
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
    pub(crate) fn into_replaced(self) -> ReplacedTiles {
        ReplacedTiles(self.replaced.unwrap_or_default())
    }

    /// Puts back what was replaced.
    pub(crate) fn restore_replaced(
        &mut self,
        published: ReplacedTiles,
    ) -> Result<(), PublishError> {
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
    pub(crate) fn restart(&mut self, mapper: &Mapper) -> Result<(), PublishError> {
        let mut store = self.store.lock().unwrap_or_else(PoisonError::into_inner);
        for grid in grids(mapper) {
            store.erase_layer(grid.layer)?;
        }
        drop(store);
        self.changed.clear();
        self.resets = mapper.resets();
        self.terrain_erased = mapper.terrain().map_or(0, Terrain::epoch);
        self.voxels_erased = mapper.voxels().map_or(0, VoxelLayers::epoch);
        self.traffic = TileTraffic::default();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use protocol::layer::LayerId;
    use protocol::tile::BootId;

    use super::*;
    use crate::config::load;
    use crate::streaming::cells_to_tiles::uniform_tile;

    /// A tile of the occupancy grid.
    const fn key(tx: i32) -> TileKey {
        let layer = LayerId::Occupancy;
        TileKey { layer, tx, ty: 0 }
    }

    fn publish(publisher: &mut Publisher, stamp_ns: i64, tx: i32, code: u16) {
        publisher.store().set_stamp(stamp_ns);
        publisher.store_tile(key(tx), uniform_tile(code)).unwrap();
    }

    /// Stamp and first code of each tile.
    fn published(publisher: &Publisher) -> Vec<(i32, i64, Option<u16>)> {
        let store = publisher.store();
        let tiles = store.tiles(LayerId::Occupancy);
        let known = tiles.filter(|(_, stored)| stored.known() > 0);
        let tiles = known.map(|(key, stored)| {
            let code = stored.cells().and_then(|cells| cells.get(0, 0));
            (key.tx, stored.stamp_ns(), code)
        });
        tiles.collect()
    }

    #[test]
    fn what_is_put_back_is_as_old_as_it_was() {
        let config = load("generic2d", &[]).unwrap();
        let mapper = Mapper::new(
            &config.mapping,
            config.vehicle.shape(),
            &config.range_models(),
        );
        let mut publisher = Publisher::new(BootId([7; 16]), 1, &mapper, false).unwrap();
        publish(&mut publisher, 5, 0, 10);
        publish(&mut publisher, 7, 1, 20);
        publish(&mut publisher, 8, 2, 30);
        let before = published(&publisher);
        assert_eq!(
            before,
            [(0, 5, Some(10)), (1, 7, Some(20)), (2, 8, Some(30))]
        );

        let mut ended = publisher.with_undo();
        publish(&mut ended, 9, 0, 11);
        publish(&mut ended, 9, 1, 21);
        // Twice: what was there before the first is what comes back.
        publish(&mut ended, 9, 1, 22);
        publish(&mut ended, 9, 3, 40);
        assert_eq!(
            published(&publisher),
            [
                (0, 9, Some(11)),
                (1, 9, Some(22)),
                (2, 8, Some(30)),
                (3, 9, Some(40)),
            ]
        );
        publisher.restore_replaced(ended.into_replaced()).unwrap();
        assert_eq!(published(&publisher), before);
    }
}
