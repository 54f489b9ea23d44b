//! Which tiles of a layer know anything, where in them, and what of them is seen from afar: what there is to draw
//! and to fit.

use std::collections::BTreeMap;

use protocol::layer::UNKNOWN;
use protocol::tile::{TILE_SIDE, TileCells, TileKey};
use protocol::tile_store::TileStore;

use super::chunks::TILE_CELLS;
use super::max_codes::CodePyramid;

/// Columns and rows of a tile between which its known cells lie, both ends included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct KnownBounds {
    columns: [u8; 2],
    rows: [u8; 2],
}

#[derive(Clone, Debug)]
struct IndexedTile {
    known: KnownBounds,
    /// Where in the tile: other cells have another number.
    shape: u64,
    coarse: CodePyramid,
}

/// The known tiles of one layer.
#[derive(Clone, Debug, Default)]
pub(super) struct TilePresence {
    tiles: BTreeMap<(i32, i32), IndexedTile>,
    /// Lowest and greatest x and y of known cells, in cells; `None` where it must be worked out again.
    bounds_cells: Option<[i64; 4]>,
}

impl TilePresence {
    /// Looks at one tile again; whether other cells of it are known than were.
    pub(super) fn update(&mut self, store: &TileStore, key: TileKey) -> bool {
        let cells = store.get(key).and_then(|stored| stored.cells());
        let tile = cells.and_then(|cells| {
            let (known, coarse) = (KnownBounds::of(cells)?, CodePyramid::of(cells));
            Some(IndexedTile {
                known,
                shape: shape(cells),
                coarse,
            })
        });
        let at = (key.tx, key.ty);
        let after = tile.as_ref().map(|tile| tile.known.edges(at));
        let shape_after = tile.as_ref().map(|tile| tile.shape);
        let before = match tile {
            Some(tile) => self.tiles.insert(at, tile),
            None => self.tiles.remove(&at),
        };
        let shape_before = before.as_ref().map(|tile| tile.shape);
        let before = before.map(|tile| tile.known.edges(at));
        match (before, after) {
            // Maps grow: only what shrinks has to be looked for.
            (before, Some(after)) if before.is_none_or(|before| join(before, after) == after) => {
                if self.tiles.len() == 1 {
                    self.bounds_cells = Some(after);
                } else if let Some(bounds) = &mut self.bounds_cells {
                    *bounds = join(*bounds, after);
                }
            }
            (None, None) => {}
            (Some(_), _) | (None, Some(_)) => self.bounds_cells = None,
        }
        shape_before != shape_after
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.tiles.len()
    }

    /// The highest codes of a tile in squares of `step` cells, where they are kept.
    pub(super) fn coarse_codes(&self, tile: (i32, i32), step: usize) -> Option<&[u16]> {
        self.tiles.get(&tile)?.coarse.of_step(step)
    }

    /// The known tiles in a square of `side` × `side` tiles whose lowest tile is `(tx, ty)`.
    pub(super) fn in_square(
        &self,
        (tx, ty): (i64, i64),
        side: i64,
    ) -> impl Iterator<Item = (i32, i32)> {
        let clamp = |tile: i64| tile.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32;
        let is_on_map = [tx, ty]
            .into_iter()
            .all(|first| first <= i64::from(i32::MAX) && first + side > i64::from(i32::MIN));
        let columns = clamp(tx)..=clamp(tx + side - 1);
        let rows = (clamp(ty), clamp(ty + side - 1));
        columns
            .filter(move |_| is_on_map)
            .flat_map(move |column| self.tiles.range((column, rows.0)..=(column, rows.1)))
            .map(|(at, _)| *at)
    }

    /// Lowest and greatest x and y of what is known, in cells (the greatest ends exclusive).
    pub(super) fn bounds_cells(&mut self) -> Option<[i64; 4]> {
        if self.bounds_cells.is_none() {
            let edges = self.tiles.iter().map(|(at, tile)| tile.known.edges(*at));
            self.bounds_cells = edges.reduce(join);
        }
        self.bounds_cells
    }
}

/// A number that stands for which cells are known.
fn shape(cells: &TileCells) -> u64 {
    (0..TILE_SIDE).fold(0xcbf2_9ce4_8422_2325, |shape: u64, row| {
        let known = cells.row(row).iter();
        let known = known.fold(0, |bits, code| bits << 1 | u64::from(*code != UNKNOWN));
        (shape ^ known)
            .wrapping_mul(0x0000_0100_0000_01b3)
            .rotate_left(29)
    })
}

fn join(a: [i64; 4], b: [i64; 4]) -> [i64; 4] {
    [
        a[0].min(b[0]),
        a[1].min(b[1]),
        a[2].max(b[2]),
        a[3].max(b[3]),
    ]
}

impl KnownBounds {
    /// Lowest and greatest x and y, in cells (the greatest ends exclusive), of the box in the tile at `(tx, ty)`.
    fn edges(self, (tx, ty): (i32, i32)) -> [i64; 4] {
        let (x, y) = (i64::from(tx) * TILE_CELLS, i64::from(ty) * TILE_CELLS);
        let [left, right] = self.columns.map(i64::from);
        let [bottom, top] = self.rows.map(i64::from);
        [x + left, y + bottom, x + right + 1, y + top + 1]
    }

    fn of(cells: &TileCells) -> Option<Self> {
        let mut known: Option<Self> = None;
        for row in 0..TILE_SIDE {
            let codes = cells.row(row);
            let is_known = |code: &u16| *code != UNKNOWN;
            let (Some(left), Some(right)) = (
                codes.iter().position(is_known),
                codes.iter().rposition(is_known),
            ) else {
                continue;
            };
            let (left, right, row) = (left as u8, right as u8, row as u8);
            let so_far = known.get_or_insert(Self {
                columns: [left, right],
                rows: [row, row],
            });
            so_far.columns[0] = so_far.columns[0].min(left);
            so_far.columns[1] = so_far.columns[1].max(right);
            so_far.rows[1] = row;
        }
        known
    }
}

#[cfg(test)]
mod tests {
    use protocol::layer::LayerId;
    use protocol::tile::BootId;
    use protocol::tile_store::LayerGrid;

    use super::*;

    const LAYER: LayerId = LayerId::Occupancy;

    fn key(tx: i32, ty: i32) -> TileKey {
        TileKey {
            layer: LAYER,
            tx,
            ty,
        }
    }

    fn publish(store: &mut TileStore, key: TileKey, known: &[(usize, usize)]) {
        let cells = TileCells::from_fn(|x, y| u16::from(known.contains(&(x, y))));
        drop(store.publish(key, cells).unwrap());
    }

    fn of_layer(store: &TileStore) -> TilePresence {
        let mut known = TilePresence::default();
        for (key, _) in store.tiles(LAYER) {
            known.update(store, key);
        }
        known
    }

    #[test]
    fn bounds_are_those_of_known_cells_and_follow_changes() {
        let mut store = TileStore::new(BootId([1; 16]), 10);
        store
            .set_grid(LayerGrid {
                layer: LAYER,
                cell_m: 0.1,
            })
            .unwrap();
        publish(&mut store, key(-1, 0), &[(60, 5), (62, 3)]);
        publish(&mut store, key(2, 1), &[(0, 0)]);
        let mut known = of_layer(&store);
        assert_eq!(known.bounds_cells(), Some([-4, 3, 129, 65]));
        publish(&mut store, key(2, 1), &[]);
        assert!(known.update(&store, key(2, 1)));
        assert_eq!(known.bounds_cells(), Some([-4, 3, -1, 6]));
        publish(&mut store, key(-1, 0), &[(60, 5), (61, 4), (62, 3)]);
        assert!(known.update(&store, key(-1, 0)), "within the same bounds");
        assert!(!known.update(&store, key(-1, 0)));
        publish(&mut store, key(-1, 0), &[]);
        known.update(&store, key(-1, 0));
        assert_eq!(known.len(), 0);
        assert_eq!(known.bounds_cells(), None);
    }

    #[test]
    fn squares_hold_their_tiles_on_both_sides_of_the_origin() {
        let mut store = TileStore::new(BootId([1; 16]), 10);
        store
            .set_grid(LayerGrid {
                layer: LAYER,
                cell_m: 0.1,
            })
            .unwrap();
        for (tx, ty) in [
            (-9, 0),
            (-8, -8),
            (-1, -1),
            (-1, 0),
            (0, -1),
            (7, 7),
            (8, 0),
        ] {
            publish(&mut store, key(tx, ty), &[(1, 1)]);
        }
        let known = of_layer(&store);
        let square = |at| known.in_square(at, 8).collect::<Vec<_>>();
        assert_eq!(square((-8, -8)), [(-8, -8), (-1, -1)]);
        assert_eq!(square((0, 0)), [(7, 7)]);
        assert_eq!(square((-16, 0)), [(-9, 0)]);
        assert_eq!(square((1 << 40, 0)), []);
    }
}
