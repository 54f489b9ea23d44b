//! Changed map cells go into the tile store: what is published *is* what is exported.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use protocol::layer::LayerId;
use protocol::tile::codec::Encoder;
use protocol::tile::{BootId, TILE_CELLS, TileCells, TileKey};
use protocol::tile_store::{LayerGrid, Publication, StoreError, StoredTile, TileStore};

use super::cells_to_tiles::{CellCoder, fill_unknown, key, set_code};
use mapping::Mapper;
use mapping::cost_map::{CostCell, CostMap};
use mapping::grid::{CellIndex, TileIndex};
use mapping::terrain::Terrain;
use mapping::voxel_layers::VoxelLayers;
use measurement::time::RobotTime;

mod checkpoint;
mod undo;

pub(crate) use checkpoint::PublisherState;
pub use undo::ReplacedTiles;

/// Publishes the changes of a mapper.
pub struct Publisher {
    /// Shared with whoever answers consoles; held for one tile at a time.
    store: Arc<Mutex<TileStore>>,
    /// Published since [`Publisher::take_changed`].
    changed: Vec<TileKey>,
    coder: CellCoder,
    encoder: Option<Encoder>,
    /// How often the mapper had forgotten everything, and how often the terrain, when last published.
    resets: u32,
    terrain_erased: u32,
    voxels_erased: u32,
    traffic: TileTraffic,
    /// The cells that were replaced, where they are to be put back.
    replaced: Option<BTreeMap<TileKey, Option<StampedCells>>>,
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
    /// For the layers of `mapper`, with a store of at most `tile_store_mb` megabytes.
    ///
    /// Tiles are encoded only if `encode`: somebody listens, or wants to know what it would cost.
    pub fn new(
        boot: BootId,
        tile_store_mb: u32,
        mapper: &Mapper,
        encode: bool,
    ) -> Result<Self, PublishError> {
        let mut store = TileStore::new(boot, tile_store_mb);
        for grid in grids(mapper) {
            store.set_grid(grid)?;
        }
        let encoder = if encode { Some(Encoder::new()?) } else { None };
        Ok(Self {
            store: Arc::new(Mutex::new(store)),
            changed: Vec::new(),
            coder: CellCoder::new(),
            encoder,
            resets: mapper.resets(),
            terrain_erased: mapper.terrain().map_or(0, Terrain::epoch),
            voxels_erased: mapper.voxels().map_or(0, VoxelLayers::epoch),
            traffic: TileTraffic::default(),
            replaced: None,
        })
    }

    /// Publishes every tile that changed since the last call, then keeps the mapper's memory limits. `stamp`: of the newest
    /// scan in the maps.
    pub fn publish(&mut self, mapper: &mut Mapper, stamp: RobotTime) -> Result<(), PublishError> {
        let vehicle = mapper.vehicle_in_odom();
        let mut store = self.store();
        store.set_focus([vehicle.x, vehicle.y]);
        store.set_stamp(stamp.as_nanos());
        drop(store);
        self.publish_erasures(mapper)?;
        if let Some(occupancy) = mapper.occupancy_mut() {
            for index in occupancy.take_changed() {
                if let Some(tile) = occupancy.grid().get(index) {
                    let cells = self.coder.occupancy(tile);
                    self.publish_tile(key(LayerId::Occupancy, index), cells)?;
                }
            }
        }
        if let Some(terrain) = mapper.terrain_mut() {
            let heights = terrain.elevation_mut().take_changed().into_iter();
            let heights = heights.map(|(cell, value)| (cell, CellCoder::elevation(&value)));
            self.publish_cells(LayerId::Elevation, heights)?;
            let classes = terrain.obstacle_mut().take_changed().into_iter();
            let classes = classes.map(|(cell, class)| (cell, CellCoder::obstacle(class)));
            self.publish_cells(LayerId::Obstacle, classes)?;
        }
        if let Some(voxels) = mapper.voxels_mut() {
            self.publish_voxel_layers(voxels)?;
        }
        self.traffic.evicted_from_mapping += mapper.enforce_memory_limits() as u64;
        Ok(())
    }

    fn publish_voxel_layers(&mut self, voxels: &mut VoxelLayers) -> Result<(), PublishError> {
        if let Some(cost) = voxels.cost_mut() {
            let changed = cost.take_changed();
            let costs = changed
                .iter()
                .map(|(cell, value)| (*cell, CellCoder::cost(value)));
            self.publish_cells(LayerId::Cost, costs)?;
            if voxels.cost().is_some_and(CostMap::classifies_rigidity) {
                let rigid = |(cell, value): &(CellIndex, CostCell)| {
                    (*cell, CellCoder::rigidity(value.rigidity))
                };
                self.publish_cells(LayerId::Rigidity, changed.iter().map(rigid))?;
            }
        }
        if let Some(shore) = voxels.shore_mut() {
            let changed = shore.take_changed().into_iter();
            let cells = changed.map(|(cell, class)| (cell, CellCoder::shore(class)));
            self.publish_cells(LayerId::Shore, cells)?;
        }
        Ok(())
    }

    /// What the mapper has forgotten is void everywhere.
    fn publish_erasures(&mut self, mapper: &Mapper) -> Result<(), PublishError> {
        let mut store = self.store.lock().unwrap_or_else(PoisonError::into_inner);
        if mapper.resets() != self.resets && mapper.occupancy().is_some() {
            store.erase_layer(LayerId::Occupancy)?;
        }
        self.resets = mapper.resets();
        if let Some(terrain) = mapper.terrain()
            && terrain.epoch() != self.terrain_erased
        {
            self.terrain_erased = terrain.epoch();
            store.erase_layer(LayerId::Elevation)?;
            store.erase_layer(LayerId::Obstacle)?;
        }
        if let Some(voxels) = mapper.voxels()
            && voxels.epoch() != self.voxels_erased
        {
            self.voxels_erased = voxels.epoch();
            for grid in voxel_grids(voxels) {
                store.erase_layer(grid.layer)?;
            }
        }
        Ok(())
    }

    /// Publishes single cells, of which a later one of the same place wins; the rest of their tiles stays as
    /// it was published: what has left a window that moves with the vehicle is still true.
    fn publish_cells(
        &mut self,
        layer: LayerId,
        cells: impl Iterator<Item = (CellIndex, u16)>,
    ) -> Result<(), PublishError> {
        let mut tiles: BTreeMap<TileIndex, Vec<(usize, u16)>> = BTreeMap::new();
        for (cell, code) in cells {
            let (tile, place) = cell.split();
            tiles.entry(tile).or_default().push((place, code));
        }
        for (index, changes) in tiles {
            let key = key(layer, index);
            let before = self
                .store()
                .get(key)
                .and_then(|stored| stored.cells().cloned());
            let mut cells = before.unwrap_or_else(TileCells::unknown);
            for (place, code) in changes {
                set_code(&mut cells, place, code);
            }
            self.store_tile(key, cells)?;
        }
        Ok(())
    }

    fn publish_tile(&mut self, key: TileKey, mut cells: TileCells) -> Result<(), PublishError> {
        let store = self.store.lock().unwrap_or_else(PoisonError::into_inner);
        // A tile that was evicted from the mapping memory and seen again starts blank there, but what was
        // published stays true until something newer is known.
        if let Some(before) = store.get(key).and_then(|stored| stored.cells()) {
            fill_unknown(&mut cells, before);
        }
        drop(store);
        self.store_tile(key, cells)
    }

    fn store_tile(&mut self, key: TileKey, cells: TileCells) -> Result<(), PublishError> {
        let mut store = self.store.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(replaced) = &mut self.replaced {
            let before = || store.get(key).and_then(stamped_cells);
            replaced.entry(key).or_insert_with(before);
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

/// Cells, and their [`StoredTile::stamp_ns`].
type StampedCells = (i64, TileCells);

fn stamped_cells(stored: &StoredTile) -> Option<StampedCells> {
    Some((stored.stamp_ns(), stored.cells()?.clone()))
}

/// The layers of a mapper.
fn grids(mapper: &Mapper) -> Vec<LayerGrid> {
    let mut grids = Vec::new();
    if let Some(occupancy) = mapper.occupancy() {
        grids.push(LayerGrid {
            layer: LayerId::Occupancy,
            cell_m: occupancy.cell_m(),
        });
    }
    if let Some(terrain) = mapper.terrain() {
        let cell_m = terrain.elevation().cell_m();
        grids.extend(
            [LayerId::Elevation, LayerId::Obstacle].map(|layer| LayerGrid { layer, cell_m }),
        );
    }
    grids.extend(mapper.voxels().into_iter().flat_map(voxel_grids));
    grids
}

/// The layers that are made of an octree.
fn voxel_grids(voxels: &VoxelLayers) -> Vec<LayerGrid> {
    let cell_m = voxels.octree().cell_m();
    let cost = voxels.cost();
    let layers = [
        (LayerId::Cost, cost.is_some()),
        (
            LayerId::Rigidity,
            cost.is_some_and(CostMap::classifies_rigidity),
        ),
        (LayerId::Shore, voxels.shore().is_some()),
    ];
    let mapped = layers.into_iter().filter(|(_, is_mapped)| *is_mapped);
    mapped
        .map(|(layer, _)| LayerGrid { layer, cell_m })
        .collect()
}
