#![expect(clippy::float_cmp, reason = "these values are exact")]

use protocol::tile::BootId;
use protocol::tile_store::LayerGrid;

use super::*;
use crate::publishing::cells_to_tiles::uniform_tile;

const FREE: u16 = 6;
const UNDECIDED: u16 = 126;
const OCCUPIED: u16 = 246;
const MAX_CELLS: u64 = 1 << 20;

const fn at(s: u64) -> Monotonic {
    Monotonic::from_nanos(s * 1_000_000_000)
}

fn empty_store() -> TileStore {
    let mut store = TileStore::new(BootId([1; 16]), 10);
    let (layer, cell_m) = (LayerId::Occupancy, 0.05);
    store.set_grid(LayerGrid { layer, cell_m }).unwrap();
    store
}

fn publish(store: &mut TileStore, [tx, ty]: [i32; 2], code: u16) {
    let layer = LayerId::Occupancy;
    let key = TileKey { layer, tx, ty };
    assert!(store.publish(key, uniform_tile(code)).is_ok());
}

#[derive(Debug, PartialEq)]
enum Sent {
    Nothing,
    /// Columns and rows.
    Whole([u32; 2]),
    /// Its first column and row, and its size.
    Part([i32; 2], [u32; 2]),
}

/// The grid of a subscriber.
#[derive(Default)]
struct Received {
    origin_m: [f64; 2],
    width: usize,
    cells: Vec<i8>,
}

impl Received {
    fn take(&mut self, part: GridPart) -> Sent {
        let Some([x, y]) = part.first else {
            self.origin_m = part.origin_m;
            self.width = part.size[0] as usize;
            self.cells = part.cells;
            return Sent::Whole(part.size);
        };
        let rows = part.cells.chunks(part.size[0] as usize);
        for (row, cells) in (y as usize..).zip(rows) {
            self.cells[row * self.width + x as usize..][..cells.len()].copy_from_slice(cells);
        }
        Sent::Part([x, y], part.size)
    }
}

#[test]
fn parts_are_sent_where_that_is_enough_and_make_the_whole() {
    enum Change {
        None,
        Tile([i32; 2], u16),
        Erasure,
    }
    use Change::{Erasure, Tile};
    let mut store = empty_store();
    let mut state = GridState::new(LayerId::Occupancy);
    let mut received = Received::default();
    let updates = (false, true);
    for (change, at_s, takers, expected) in [
        (Change::None, 0, updates, Sent::Nothing),
        (Tile([0, 0], FREE), 1, updates, Sent::Whole([64, 64])),
        (Change::None, 2, updates, Sent::Nothing),
        // The bounds move.
        (Tile([-2, 1], FREE), 4, updates, Sent::Whole([192, 128])),
        (
            Tile([-1, 0], UNDECIDED),
            5,
            updates,
            Sent::Part([64, 0], [64, 64]),
        ),
        (
            Tile([0, 0], OCCUPIED),
            6,
            updates,
            Sent::Part([128, 0], [64, 64]),
        ),
        // Who takes no updates has it after a while.
        (Change::None, 9, updates, Sent::Whole([192, 128])),
        (Change::None, 20, updates, Sent::Nothing),
        (
            Tile([0, 1], OCCUPIED),
            21,
            (false, false),
            Sent::Whole([192, 128]),
        ),
        (Change::None, 22, (true, true), Sent::Whole([192, 128])),
        (Erasure, 23, updates, Sent::Whole([192, 128])),
        (Tile([0, 0], FREE), 24, updates, Sent::Whole([64, 64])),
    ] {
        match change {
            Change::None => {}
            Tile(at, code) => publish(&mut store, at, code),
            Erasure => {
                store.erase_layer(LayerId::Occupancy).unwrap();
            }
        }
        let change = state
            .take_change(&store, at(at_s), takers, MAX_CELLS)
            .unwrap();
        let change = change.map(|part| state.assemble(&part));
        let sent = change.map_or(Sent::Nothing, |part| received.take(part));
        assert_eq!(sent, expected, "{at_s} s");
        if let Some(whole) = state.whole(&store, MAX_CELLS).unwrap() {
            let whole = state.assemble(&whole);
            assert_eq!(received.origin_m, whole.origin_m, "{at_s} s");
            assert_eq!(received.cells, whole.cells, "{at_s} s");
        }
    }
    assert_eq!(received.cells, [0; 64 * 64]);
}

#[test]
fn cells_lie_where_they_are_in_the_map() {
    let mut store = empty_store();
    publish(&mut store, [-1, 0], OCCUPIED);
    publish(&mut store, [0, 1], FREE);
    let state = GridState::new(LayerId::Occupancy);
    let whole = state.assemble(&state.whole(&store, MAX_CELLS).unwrap().unwrap());
    assert_eq!((whole.size, whole.first), ([128, 128], None));
    assert_eq!(whole.origin_m, [-64.0 * 0.05, 0.0]);
    for (x, y, expected) in [(0, 0, 100), (63, 63, 100), (64, 63, -1), (64, 64, 0)] {
        assert_eq!(whole.cells[y * 128 + x], expected, "{x} {y}");
    }
}

#[test]
fn a_grid_of_any_size_is_refused_beyond_the_limit() {
    let mut store = empty_store();
    let mut state = GridState::new(LayerId::Occupancy);
    publish(&mut store, [0, 0], FREE);
    publish(&mut store, [1, 0], FREE);
    let mut take = |store: &TileStore, max| {
        let change = state.take_change(store, at(0), (false, true), max);
        change.map(|part| part.is_some())
    };
    assert_eq!(take(&store, 2 * 64 * 64 - 1), Err(TooLarge));
    assert_eq!(take(&store, 2 * 64 * 64), Ok(true));
    publish(&mut store, [i32::MAX, i32::MIN], FREE);
    assert_eq!(take(&store, u64::MAX / 2), Err(TooLarge));
}

/// As Nav2 reads our export, and by the scale of its costmaps.
#[test]
fn codes_have_the_values_of_ros() {
    for (layer, code, expected) in [
        (LayerId::Occupancy, 0, -1),
        (LayerId::Occupancy, FREE, 0),
        (LayerId::Occupancy, UNDECIDED, -1),
        (LayerId::Occupancy, OCCUPIED, 100),
        (LayerId::Cost, 0, -1),
        (LayerId::Cost, 1, 0),
        (LayerId::Cost, 126, 49),
        (LayerId::Cost, 250, 98),
        (LayerId::Cost, 251, 100),
    ] {
        assert_eq!(value(layer, code), expected, "{layer} {code}");
    }
}
