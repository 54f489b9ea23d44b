//! The console's tile store: any sequence of tiles, boots and epochs leaves a store that is within
//! its limit and consistent.
//!
//! Input: a byte that sets the limit, from no tile to five; then steps of eight bytes.
#![no_main]

use std::cell::OnceCell;

use libfuzzer_sys::fuzz_target;
use protocol::layer::LayerId;
use protocol::tile::{BootId, Tile, TileCells, TileDigest, TileKey};
use protocol::tile_store::{Applied, LayerGrid, StoreError, TileStore};

const GRIDS: [LayerId; 3] = [LayerId::Occupancy, LayerId::Elevation, LayerId::Obstacle];
/// Limits that hold from no tile (8320 bytes) to five, and down to no tombstone (128 bytes).
const LIMIT_STEP_BYTES: usize = 180;

thread_local! {
    /// Hashed once: hashing in every step would dominate the time.
    static CELLS: OnceCell<Vec<(TileCells, TileDigest)>> = const { OnceCell::new() };
}

fuzz_target!(|input: &[u8]| {
    CELLS.with(|cells| run(input, cells.get_or_init(all_cells)));
});

/// Unknown cells, cells of all layers, of elevation alone, and a single known one.
fn all_cells() -> Vec<(TileCells, TileDigest)> {
    let mut single = TileCells::unknown();
    single.codes_mut()[4095] = 1;
    let filled = |code| TileCells::from_fn(|_, _| code);
    [TileCells::unknown(), filled(1), filled(40_000), single]
        .map(|cells| (cells.clone(), cells.digest()))
        .to_vec()
}

fn run(input: &[u8], cells: &[(TileCells, TileDigest)]) {
    let Some((&limit, steps)) = input.split_first() else {
        return;
    };
    let limit_bytes = usize::from(limit) * LIMIT_STEP_BYTES;
    let mut store = TileStore::within_bytes(BootId([0; 16]), limit_bytes);
    for layer in GRIDS {
        store.set_grid(LayerGrid { layer, cell_m: 0.1 }).unwrap();
    }
    for &step in steps.as_chunks().0 {
        take(&mut store, step, cells);
        assert!(
            store.bytes_held() <= limit_bytes,
            "{} of {limit_bytes} bytes",
            store.bytes_held()
        );
        let counted: u64 = LayerId::ALL.iter().map(|layer| store.bytes(*layer)).sum();
        assert_eq!(counted, store.bytes_held() as u64);
    }
    for layer in GRIDS {
        let head = store.head_revision(layer);
        for (key, stored) in store.tiles(layer) {
            assert!(stored.revision() <= head);
            assert_eq!(stored.cells().is_some(), stored.known() > 0);
            let (held, _) = cells
                .iter()
                .find(|(_, digest)| *digest == stored.digest())
                .unwrap();
            assert!(store.tile(key).unwrap().cells == *held);
        }
        assert_eq!(store.newer_than(layer, head).count(), 0);
        assert!(store.root_digest(layer).is_some());
    }
}

fn take(store: &mut TileStore, step: [u8; 8], all: &[(TileCells, TileDigest)]) {
    let [what, layer, tx, ty, epoch, boot, low, high] = step;
    let layer = LayerId::ALL[usize::from(layer) % LayerId::ALL.len()];
    let boot = BootId([boot % 20; 16]);
    let epoch = u32::from(epoch);
    // The last bits reach far: keys at the ends of i32, revisions at the end of u64.
    let far =
        |number: u8| i32::from(number.cast_signed()) << (if what & 0x40 == 0 { 0 } else { 24 });
    let revision = match u16::from_le_bytes([low, high]) {
        u16::MAX => u64::MAX,
        revision => u64::from(revision),
    };
    match what & 0x0F {
        0 => drop(store.adopt_boot(boot)),
        1 => drop(store.adopt_epoch(layer, epoch)),
        2 => store.set_focus([f64::from(far(tx)), f64::from(far(ty))]),
        3 => store.set_focus([f64::NAN, f64::INFINITY]),
        _ => {
            let (cells, digest) = all[usize::from(what >> 4 & 3)].clone();
            let key = TileKey {
                layer,
                tx: far(tx),
                ty: far(ty),
            };
            let digest = if what & 0x80 == 0 {
                digest
            } else {
                TileDigest([7; 32])
            };
            let tile = Tile {
                key,
                boot,
                epoch,
                revision,
                stamp_ns: 0,
                check: digest.check(),
                cells,
            };
            apply(store, tile);
        }
    }
}

fn apply(store: &mut TileStore, tile: Tile) {
    let (key, boot, epoch, revision, check) =
        (tile.key, tile.boot, tile.epoch, tile.revision, tile.check);
    let state = |store: &TileStore| {
        let heads = GRIDS.map(|layer| (store.epoch(layer), store.head_revision(layer)));
        (store.boot(), heads, store.bytes_held(), store.counters())
    };
    let before = state(store);
    let result = store.apply(tile);
    match result {
        Ok(Applied::Stored) => {
            assert_eq!((store.boot(), store.epoch(key.layer)), (boot, epoch));
            assert!(store.head_revision(key.layer) >= revision);
            // A missing entry was evicted at once, and its tombstone removed.
            if let Some(stored) = store.get(key) {
                assert_eq!(stored.revision(), revision);
                assert!(stored.is_evicted() || stored.digest().check() == check);
            }
        }
        Ok(Applied::OldRevision) => assert!(store.get(key).unwrap().revision() >= revision),
        Ok(Applied::OldEpoch) => assert!(epoch < store.epoch(key.layer)),
        Ok(Applied::OldBoot) => assert_ne!(boot, store.boot()),
        Err(StoreError::NoGrid(layer)) => assert!(!GRIDS.contains(&layer)),
        Err(StoreError::Code { .. }) => assert_ne!(key.layer, LayerId::Elevation),
        Err(StoreError::Digest { .. }) => assert_eq!(check, TileDigest([7; 32]).check()),
        Err(error @ (StoreError::CellSize { .. } | StoreError::GridInUse { .. })) => {
            panic!("no grid was set: {error}")
        }
    }
    if result != Ok(Applied::Stored) {
        assert_eq!(
            before,
            state(store),
            "a tile that was refused changed something"
        );
    }
}
