use proptest::prelude::*;

use super::*;

const BOOT: BootId = BootId([7; 16]);

fn store() -> TileStore {
    store_of(BOOT, 100)
}

fn store_of(boot: BootId, tile_store_mb: u32) -> TileStore {
    let mut store = TileStore::new(boot, tile_store_mb);
    for layer in [LayerId::Occupancy, LayerId::Elevation, LayerId::Obstacle] {
        store.set_grid(LayerGrid { layer, cell_m: 0.1 }).unwrap();
    }
    store
}

fn key(layer: LayerId, tx: i32, ty: i32) -> TileKey {
    TileKey { layer, tx, ty }
}

fn filled(code: u16) -> TileCells {
    TileCells::from_fn(|_, _| code)
}

fn publish(store: &mut TileStore, key: TileKey, cells: TileCells) -> u64 {
    match store.publish(key, cells).unwrap() {
        Publication::Published { revision, .. } => revision,
        Publication::Unchanged => 0,
    }
}

/// Applies a published tile.
fn send(edge: &TileStore, console: &mut TileStore, key: TileKey) -> Result<Applied, StoreError> {
    console.apply(edge.tile(key).unwrap())
}

fn assert_same_cells(a: &TileStore, b: &TileStore, layer: LayerId) {
    assert_eq!(a.root_digest(layer), b.root_digest(layer));
}

#[test]
fn a_store_too_small_for_a_tile_keeps_none() {
    for limit_bytes in [0, 127, 128, 8319] {
        let mut store = TileStore::within_bytes(BOOT, limit_bytes);
        let layer = LayerId::Occupancy;
        store.set_grid(LayerGrid { layer, cell_m: 0.1 }).unwrap();
        let here = key(layer, 0, 0);
        let published = store.publish(here, filled(6)).unwrap();
        let itself = Publication::Published {
            revision: 1,
            evicted: vec![here],
        };
        assert_eq!(published, itself);
        assert_eq!(store.tile_count(layer), 0);
        assert!(store.bytes_held() <= limit_bytes);
        assert_eq!(store.head_revision(layer), 2);
    }
}

#[test]
fn tiles_keep_the_stamp_of_their_last_change() {
    let mut edge = store();
    let [here, there] = [0, 1].map(|tx| key(LayerId::Occupancy, tx, 0));
    edge.set_stamp(100);
    publish(&mut edge, here, filled(6));
    publish(&mut edge, there, filled(6));
    edge.set_stamp(200);
    publish(&mut edge, here, filled(6));
    publish(&mut edge, there, filled(7));
    let mut console = store();
    for (tile, stamp_ns) in [(here, 100), (there, 200)] {
        let published = edge.tile(tile).unwrap();
        assert_eq!(published.stamp_ns, stamp_ns);
        assert_eq!(console.apply(published), Ok(Applied::Stored));
        assert_eq!(console.get(tile).unwrap().stamp_ns(), stamp_ns);
    }
}

#[test]
fn revisions_count_changes_over_all_layers() {
    let mut store = store();
    let (a, b) = (
        key(LayerId::Occupancy, 0, 0),
        key(LayerId::Elevation, 3, -2),
    );
    assert_eq!(publish(&mut store, a, filled(6)), 1);
    assert_eq!(publish(&mut store, b, filled(32768)), 2);
    assert_eq!(store.publish(a, filled(6)), Ok(Publication::Unchanged));
    assert_eq!(publish(&mut store, a, filled(246)), 3);
    assert_eq!(store.head_revision(LayerId::Occupancy), 3);
    assert_eq!(store.head_revision(LayerId::Elevation), 2);

    let newer: Vec<TileKey> = store
        .newer_than(LayerId::Occupancy, 2)
        .map(|(key, _)| key)
        .collect();
    assert_eq!(newer, [a]);
    assert_eq!(store.newer_than(LayerId::Elevation, 2).count(), 0);
    let tile = store.tile(a).unwrap();
    assert_eq!((tile.boot, tile.epoch, tile.revision), (BOOT, 0, 3));
    assert_eq!(tile.check, filled(246).digest().check());
}

#[test]
fn tiles_come_in_key_order_with_their_counts() {
    let mut store = store();
    for (tx, ty) in [(1, -5), (-1, 4), (1, -7), (-1, 3)] {
        let cells = TileCells::from_fn(|x, y| u16::from(y == 0) + u16::from(x == 0 && y < 2));
        publish(&mut store, key(LayerId::Obstacle, tx, ty), cells);
    }
    let places: Vec<(i32, i32)> = store
        .tiles(LayerId::Obstacle)
        .map(|(key, _)| (key.tx, key.ty))
        .collect();
    assert_eq!(places, [(-1, 3), (-1, 4), (1, -7), (1, -5)]);
    assert_eq!(store.tile_count(LayerId::Obstacle), 4);
    assert_eq!(store.cells_known(LayerId::Obstacle), 4 * 65);
    assert_eq!(
        store.class_counts(LayerId::Obstacle),
        [("free", 4 * 64), ("obstacle", 4)]
    );
    assert_eq!(store.class_counts(LayerId::Elevation), []);
    assert_eq!(store.bytes(LayerId::Obstacle), 4 * 8320);
    assert_eq!(store.bytes_held(), 4 * 8320);
}

#[test]
fn a_tile_that_becomes_unknown_is_published_and_takes_no_space() {
    let mut store = store();
    let tile = key(LayerId::Obstacle, 0, 0);
    let empty = store.root_digest(LayerId::Obstacle);
    assert_eq!(
        store.publish(tile, TileCells::unknown()),
        Ok(Publication::Unchanged)
    );
    publish(&mut store, tile, filled(1));
    assert_ne!(store.root_digest(LayerId::Obstacle), empty);
    assert_eq!(publish(&mut store, tile, TileCells::unknown()), 2);
    assert_eq!(store.root_digest(LayerId::Obstacle), empty);
    assert_eq!(store.tile(tile).unwrap().cells, TileCells::unknown());
    assert_eq!(store.bytes_held(), 128);
    assert_eq!(
        store.publish(tile, TileCells::unknown()),
        Ok(Publication::Unchanged)
    );
}

#[test]
fn erasing_a_layer_voids_what_was_published() {
    let mut edge = store();
    let mut console = store();
    let tile = key(LayerId::Elevation, 0, 0);
    publish(&mut edge, tile, filled(32768));
    let old = edge.tile(tile).unwrap();
    assert_eq!(edge.erase_layer(LayerId::Elevation), Ok(1));
    assert_eq!(edge.cells_known(LayerId::Elevation), 0);
    assert_eq!(edge.bytes_held(), 0);
    publish(&mut edge, tile, filled(32769));
    assert_eq!(console.apply(old.clone()), Ok(Applied::Stored));
    assert_eq!(send(&edge, &mut console, tile), Ok(Applied::Stored));
    assert_eq!(console.apply(old), Ok(Applied::OldEpoch));
    assert_same_cells(&console, &edge, LayerId::Elevation);
    assert!(console.adopt_epoch(LayerId::Elevation, 2));
    assert_eq!(console.cells_known(LayerId::Elevation), 0);
}

#[test]
fn new_boot_empties_receiver_and_old_boot_is_refused() {
    let tile = key(LayerId::Occupancy, 0, 0);
    let other = key(LayerId::Occupancy, 1, 0);
    let mut before = store();
    let mut after = store_of(BootId([8; 16]), 100);
    publish(&mut before, tile, filled(6));
    publish(&mut after, other, filled(246));
    let mut console = store_of(BootId([0; 16]), 100);
    assert_eq!(send(&before, &mut console, tile), Ok(Applied::Stored));
    assert_eq!(send(&after, &mut console, other), Ok(Applied::Stored));
    assert_eq!(send(&before, &mut console, tile), Ok(Applied::OldBoot));
    assert_same_cells(&console, &after, LayerId::Occupancy);
    assert_eq!(send(&after, &mut console, other), Ok(Applied::OldRevision));
}

#[test]
fn what_is_refused_changes_nothing() {
    let mut edge = store();
    let tile = key(LayerId::Occupancy, 0, 0);
    publish(&mut edge, tile, filled(6));
    let mut damaged = edge.tile(tile).unwrap();
    damaged.boot = BootId([9; 16]);
    damaged.cells.codes_mut()[17] = 7;
    let mut console = store();
    publish(&mut console, key(LayerId::Occupancy, 5, 5), filled(6));
    let before = console.root_digest(LayerId::Occupancy);
    assert_eq!(
        console.apply(damaged),
        Err(StoreError::Digest {
            key: tile,
            revision: 1
        })
    );
    assert_eq!(console.root_digest(LayerId::Occupancy), before);
    assert_eq!(console.boot(), BOOT);

    let shore = key(LayerId::Shore, 0, 0);
    assert_eq!(
        console.publish(shore, filled(1)),
        Err(StoreError::NoGrid(LayerId::Shore))
    );
    let error = console.publish(tile, filled(252)).unwrap_err().to_string();
    assert_eq!(
        error,
        "tile occupancy/0/0: cell (0, 0) of the tile holds code 252, which layer occupancy does not use"
    );
}

#[test]
fn a_cell_size_must_be_one_and_stay() {
    let mut store = store();
    let grid = |cell_m| LayerGrid {
        layer: LayerId::Occupancy,
        cell_m,
    };
    for senseless in [0.0, -0.1, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            store.set_grid(grid(senseless)),
            Err(StoreError::CellSize { .. })
        ));
    }
    let fine = store.root_digest(LayerId::Occupancy);
    assert_eq!(store.set_grid(grid(0.2)), Ok(()));
    assert_ne!(
        store.root_digest(LayerId::Occupancy),
        fine,
        "cell size is hashed"
    );
    publish(&mut store, key(LayerId::Occupancy, 0, 0), filled(1));
    assert_eq!(store.set_grid(grid(0.2)), Ok(()));
    let error = store.set_grid(grid(0.1)).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("holds tiles of 0.2 m cells, not 0.1 m"),
        "{error}"
    );
}

#[test]
fn farthest_tiles_are_evicted_and_tombstones_propagate() {
    let mut edge = store_of(BOOT, 1);
    let mut console = store_of(BOOT, 100);
    let mut evicted_in_order = Vec::new();
    for tx in 0..300 {
        edge.set_focus([f64::from(tx) * 6.4, 0.0]);
        let tile = key(LayerId::Occupancy, tx, 0);
        let Publication::Published { evicted, .. } = edge.publish(tile, filled(6)).unwrap() else {
            panic!("unchanged");
        };
        assert!(edge.bytes_held() <= 1_000_000, "{}", edge.bytes_held());
        assert_eq!(send(&edge, &mut console, tile), Ok(Applied::Stored));
        for key in evicted {
            assert!(edge.get(key).unwrap().is_evicted());
            assert_eq!(send(&edge, &mut console, key), Ok(Applied::Stored));
            evicted_in_order.push(key.tx);
        }
    }
    assert!(evicted_in_order.len() > 150 && evicted_in_order.is_sorted());
    assert_eq!(edge.counters().tiles_evicted, evicted_in_order.len() as u64);
    assert!(
        edge.get(key(LayerId::Occupancy, 299, 0))
            .unwrap()
            .cells()
            .is_some()
    );
    assert_same_cells(&console, &edge, LayerId::Occupancy);
}

#[test]
fn tombstones_are_bounded_too() {
    let mut store = store_of(BOOT, 1);
    for tx in 0..3000 {
        store.set_focus([f64::from(tx) * 6.4, 0.0]);
        publish(&mut store, key(LayerId::Occupancy, tx, 0), filled(6));
        assert!(store.bytes_held() <= 1_000_000);
    }
    let counters = store.counters();
    let entries = store.tiles(LayerId::Occupancy).count() as u64;
    assert_eq!(entries + counters.tombstones_forgotten, 3000);
    assert!(counters.tombstones_forgotten > 1000, "{counters:?}");
    assert!(
        store.get(key(LayerId::Occupancy, 0, 0)).is_none(),
        "the oldest is forgotten"
    );
}

#[test]
fn a_receiver_that_had_to_evict_takes_the_same_tile_again() {
    let mut edge = store_of(BOOT, 100);
    let mut console = store_of(BOOT, 1);
    for tx in 0..200 {
        let tile = key(LayerId::Occupancy, tx, 0);
        publish(&mut edge, tile, filled(6));
        send(&edge, &mut console, tile).unwrap();
    }
    let far = key(LayerId::Occupancy, 150, 0);
    assert!(console.get(far).unwrap().is_evicted());
    assert_eq!(console.get(far).unwrap().revision(), 151);
    assert_ne!(
        console.root_digest(LayerId::Occupancy),
        edge.root_digest(LayerId::Occupancy)
    );
    console.set_focus([150.0 * 6.4, 0.0]);
    assert_eq!(send(&edge, &mut console, far), Ok(Applied::Stored));
    assert!(console.get(far).unwrap().cells().is_some());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_root_digest_is_a_function_of_the_cells_alone(
        history in prop::collection::vec((-3..3_i32, -3..3_i32, 0_u16..252), 1..40),
        seed in any::<u64>(),
    ) {
        let mut edge = store();
        for &(tx, ty, code) in &history {
            publish(&mut edge, key(LayerId::Occupancy, tx, ty), filled(code));
        }
        let mut finals: Vec<TileKey> = edge.tiles(LayerId::Occupancy).map(|(key, _)| key).collect();
        finals.sort_by_key(|key| blake3::hash(format!("{seed}{key}").as_bytes()).as_bytes()[0]);
        let mut in_other_order = store();
        for key in finals {
            publish(&mut in_other_order, key, edge.tile(key).unwrap().cells);
        }
        assert_same_cells(&edge, &in_other_order, LayerId::Occupancy);
        let counted: usize = edge.tiles(LayerId::Occupancy).filter(|(_, t)| t.cells().is_some()).count();
        prop_assert_eq!(edge.cells_known(LayerId::Occupancy), 4096 * counted as u64);
    }

    #[test]
    fn tiles_in_any_order_end_in_the_publishers_state(
        history in prop::collection::vec((0..2_i32, 0..2_i32, 0_u16..3), 1..30),
        seed in any::<u64>(),
    ) {
        let mut edge = store();
        let mut sent = Vec::new();
        for &(tx, ty, code) in &history {
            let key = key(LayerId::Obstacle, tx, ty);
            if publish(&mut edge, key, filled(code)) > 0 {
                sent.push(edge.tile(key).unwrap());
            }
        }
        sent.sort_by_key(|tile| {
            blake3::hash(format!("{seed}{}", tile.revision).as_bytes()).as_bytes()[0]
        });
        let mut console = store();
        for tile in sent {
            console.apply(tile).unwrap();
        }
        assert_same_cells(&console, &edge, LayerId::Obstacle);
        prop_assert_eq!(console.head_revision(LayerId::Obstacle), edge.head_revision(LayerId::Obstacle));
    }
}
