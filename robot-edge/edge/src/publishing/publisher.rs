//! Writes changed map cells to the tile store, which is published and exported.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard};

use protocol::layer::LayerId;
use protocol::tile::codec;
use protocol::tile::{BootId, TILE_CELLS, TileCells, TileKey};
use protocol::tile_store::{LayerGrid, Publication, StoreError, StoredTile, TileStore};

use super::cells_to_tiles::{CellCoder, fill_unknown, key, set_code};
use crate::lock;
use mapping::Mapper;
use mapping::cost_map::{CostCell, CostMap};
use mapping::grid::{CellIndex, CellSize, TileIndex};
use mapping::terrain::Terrain;
use mapping::voxel_layers::VoxelLayers;
use measurement::time::RobotTime;

pub struct Publisher {
    /// Shared with the network; locked for one tile at a time.
    store: Arc<Mutex<TileStore>>,
    /// Since the last [`Publisher::take_changed`].
    changed: Vec<TileKey>,
    coder: CellCoder,
    measures_bytes: bool,
    /// Numbers of erasures of the mapper when last published.
    resets: u32,
    terrain_erased: u32,
    voxels_erased: u32,
    traffic: TileTraffic,
    /// The replaced cells, if they are to be restored.
    replaced: Option<BTreeMap<TileKey, Option<StampedCells>>>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TileTraffic {
    pub published: u64,
    /// Encoded size, bytes; 0 if tiles are not encoded.
    pub bytes: u64,
    /// Their size at 4 bytes a cell.
    pub raw_bytes: u64,
    /// Tiles that were evicted from the mapping memory; the store keeps them.
    pub evicted_from_mapping: u64,
}

#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    #[error("the tile store refused a tile: {0}")]
    Store(#[from] StoreError),
}

impl Publisher {
    /// A publisher of the layers of `mapper`, with a store of at most `tile_store_mb` megabytes.
    ///
    /// `measures_bytes`: encode the tiles to know their size.
    pub fn new(
        boot: BootId,
        tile_store_mb: u32,
        mapper: &Mapper,
        measures_bytes: bool,
    ) -> Result<Self, PublishError> {
        let mut store = TileStore::new(boot, tile_store_mb);
        for grid in grids(mapper) {
            store.set_grid(grid)?;
        }
        Ok(Self {
            store: Arc::new(Mutex::new(store)),
            changed: Vec::new(),
            coder: CellCoder::new(),
            measures_bytes,
            resets: mapper.resets(),
            terrain_erased: mapper.terrain().map_or(0, Terrain::epoch),
            voxels_erased: mapper.voxels().map_or(0, VoxelLayers::epoch),
            traffic: TileTraffic::default(),
            replaced: None,
        })
    }

    /// Where the vehicle is, and the stamp of what is published next.
    pub(crate) fn set_now(&self, mapper: &Mapper, stamp: RobotTime) {
        let vehicle = mapper.vehicle_in_odom();
        let mut store = self.store();
        store.set_focus([vehicle.x, vehicle.y]);
        store.set_stamp(stamp.as_nanos());
    }

    /// Publishes every changed tile, then enforces the mapper's memory limits. `stamp`: of the newest scan in the
    /// maps.
    pub fn publish(&mut self, mapper: &mut Mapper, stamp: RobotTime) -> Result<(), PublishError> {
        self.set_now(mapper, stamp);
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
            let size = terrain.elevation().size();
            let heights = terrain.elevation_mut().take_changed().into_iter();
            let heights = heights.map(|(cell, value)| (cell, CellCoder::elevation(&value)));
            self.publish_cells(LayerId::Elevation, in_squares(size, heights))?;
            let size = terrain.obstacle().size();
            let classes = terrain.obstacle_mut().take_changed().into_iter();
            let classes = classes.map(|(cell, class)| (cell, CellCoder::obstacle(class)));
            self.publish_cells(LayerId::Obstacle, in_squares(size, classes))?;
        }
        if let Some(voxels) = mapper.voxels_mut() {
            self.publish_voxel_layers(voxels)?;
        }
        self.traffic.evicted_from_mapping += mapper.enforce_memory_limits() as u64;
        Ok(())
    }

    fn publish_voxel_layers(&mut self, voxels: &mut VoxelLayers) -> Result<(), PublishError> {
        let maps_metrics = voxels.maps_metrics();
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
            if maps_metrics {
                let intra = changed.iter().map(|(cell, value)| (*cell, value.intra));
                self.publish_cells(LayerId::Intra, intra.map(CellCoder::metric))?;
                let inter = changed.iter().map(|(cell, value)| (*cell, value.inter));
                self.publish_cells(LayerId::Inter, inter.map(CellCoder::metric))?;
            }
        }
        if let Some(depth) = voxels.depth_mut() {
            let changed = depth.take_changed().into_iter();
            let depths = changed.map(|(cell, depth_m)| (cell, CellCoder::depth(depth_m)));
            self.publish_cells(LayerId::Depth, depths)?;
        }
        if let Some(shore) = voxels.shore_mut() {
            let changed = shore.take_changed().into_iter();
            let cells = changed.map(|(cell, class)| (cell, CellCoder::shore(class)));
            self.publish_cells(LayerId::Shore, cells)?;
        }
        Ok(())
    }

    /// Erases the layers that the mapper has erased.
    fn publish_erasures(&mut self, mapper: &Mapper) -> Result<(), PublishError> {
        let mut store = lock(&self.store);
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

    /// Publishes single cells; a later one of the same place wins. The other cells of their tiles keep their
    /// values: cells outside a window that moves with the vehicle are still valid.
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
        let store = lock(&self.store);
        // A tile that was evicted and is mapped again starts empty; published cells stay valid until newer ones
        // are known.
        if let Some(before) = store.get(key).and_then(|stored| stored.cells()) {
            fill_unknown(&mut cells, before);
        }
        drop(store);
        self.store_tile(key, cells)
    }

    fn store_tile(&mut self, key: TileKey, cells: TileCells) -> Result<(), PublishError> {
        let mut store = lock(&self.store);
        if let Some(replaced) = &mut self.replaced {
            let before = || store.get(key).and_then(stamped_cells);
            replaced.entry(key).or_insert_with(before);
        }
        if let Publication::Published { evicted, .. } = store.publish(key, cells)? {
            self.traffic.published += 1;
            self.traffic.raw_bytes += 4 * TILE_CELLS as u64;
            if self.measures_bytes
                && let Some(cells) = store.get(key).and_then(|stored| stored.cells())
            {
                let bands = codec::encode(key.layer, cells);
                self.traffic.bytes += bands.iter().map(|band| band.len() as u64).sum::<u64>();
            }
            self.changed.push(key);
            self.changed.extend(evicted);
        }
        Ok(())
    }

    pub fn store(&self) -> MutexGuard<'_, TileStore> {
        lock(&self.store)
    }

    pub fn shared_store(&self) -> Arc<Mutex<TileStore>> {
        Arc::clone(&self.store)
    }

    /// The changed tiles since the last call, in the order of publication.
    pub fn take_changed(&mut self) -> Vec<TileKey> {
        std::mem::take(&mut self.changed)
    }

    pub const fn traffic(&self) -> TileTraffic {
        self.traffic
    }
}

/// Cells and their [`StoredTile::stamp_ns`].
type StampedCells = (i64, TileCells);

fn stamped_cells(stored: &StoredTile) -> Option<StampedCells> {
    Some((stored.stamp_ns(), stored.cells()?.clone()))
}

/// Tiles have square cells: a cell whose sides differ is published as squares of the shorter one.
fn in_squares(
    size: CellSize,
    cells: impl Iterator<Item = (CellIndex, u16)>,
) -> impl Iterator<Item = (CellIndex, u16)> {
    cells.flat_map(move |(cell, code)| size.squares(cell).map(move |square| (square, code)))
}

fn grids(mapper: &Mapper) -> Vec<LayerGrid> {
    let mut grids = Vec::new();
    if let Some(occupancy) = mapper.occupancy() {
        grids.push(LayerGrid {
            layer: LayerId::Occupancy,
            cell_m: occupancy.cell_m(),
        });
    }
    if let Some(terrain) = mapper.terrain() {
        let sizes = [
            (LayerId::Elevation, terrain.elevation().size()),
            (LayerId::Obstacle, terrain.obstacle().size()),
        ];
        grids.extend(sizes.map(|(layer, size)| LayerGrid {
            layer,
            cell_m: size.shorter_m(),
        }));
    }
    grids.extend(mapper.voxels().into_iter().flat_map(voxel_grids));
    grids
}

/// The layers that are derived from an octree.
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
        (LayerId::Intra, voxels.maps_metrics()),
        (LayerId::Inter, voxels.maps_metrics()),
        (LayerId::Depth, voxels.depth().is_some()),
    ];
    let mapped = layers.into_iter().filter(|(_, is_mapped)| *is_mapped);
    mapped
        .map(|(layer, _)| LayerGrid { layer, cell_m })
        .collect()
}

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

    /// Publishes the tiles of the saved state, and no others, in a new epoch of each layer.
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

/// The replaced cells; `None` if the tile did not exist.
#[derive(Debug)]
pub struct ReplacedTiles(BTreeMap<TileKey, Option<StampedCells>>);

impl Publisher {
    /// Another publisher to the same store, which keeps what it replaces.
    pub(crate) fn with_undo(&self) -> Self {
        Self {
            store: Arc::clone(&self.store),
            changed: Vec::new(),
            coder: CellCoder::new(),
            measures_bytes: false,
            resets: self.resets,
            terrain_erased: self.terrain_erased,
            voxels_erased: self.voxels_erased,
            traffic: TileTraffic::default(),
            replaced: Some(BTreeMap::new()),
        }
    }

    pub(crate) fn into_replaced(self) -> ReplacedTiles {
        ReplacedTiles(self.replaced.unwrap_or_default())
    }

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

    pub(crate) fn add_changed(&mut self, changed: Vec<TileKey>) {
        self.changed.extend(changed);
    }

    /// Publishes the tiles of `other`, and makes the cells of all others unknown. What does not change is not published again.
    pub(crate) fn replace(&mut self, other: &Self) -> Result<(), PublishError> {
        let (own, others) = (self.state(), other.state());
        let keys: BTreeSet<TileKey> = others.tiles.iter().map(|(key, _)| *key).collect();
        for (key, _) in own.tiles.iter().filter(|(key, _)| !keys.contains(key)) {
            self.store_tile(*key, TileCells::unknown())?;
        }
        for (key, (_, cells)) in others.tiles {
            self.store_tile(key, cells)?;
        }
        self.resets = others.resets;
        self.terrain_erased = others.terrain_erased;
        self.voxels_erased = others.voxels_erased;
        Ok(())
    }

    /// Erases every layer, and publishes `mapper` from now on.
    pub(crate) fn restart(&mut self, mapper: &Mapper) -> Result<(), PublishError> {
        let mut store = lock(&self.store);
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
    use crate::publishing::cells_to_tiles::uniform_tile;

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
