//! What is known below a layer. There its free cells let through what lies below; elsewhere they have colours of their own, for
//! what is free must not look like what nobody has seen.

use std::collections::BTreeSet;

use protocol::layer::{LayerId, UNKNOWN};
use protocol::tile::{TILE_CELLS as CELLS, TILE_SIDE, TileKey};
use protocol::tile_store::TileStore;

use super::max_codes::max_codes;
use super::tile_presence::TilePresence;

/// Below a single cell so many are looked at one by one, along either axis; of a square of several, what is little coarser.
const FINE: f64 = 8.0;
/// Squares below one square, along either axis, that are looked at at most: more only of cells that differ beyond all sense.
const MAX_BELOW: i64 = 17;
/// Tiles above one tile, along either axis, that are looked for at most.
const MAX_ABOVE: i64 = 64;
/// Of a cell: 0.3 m are three times 0.1 m, whatever their quotient is.
const ROUNDING: f64 = 1e-6;

/// A layer as far as it is asked what it knows.
#[derive(Clone, Copy)]
pub(super) struct IndexedLayer<'a> {
    pub(super) layer: LayerId,
    pub(super) cell_m: f64,
    pub(super) store: &'a TileStore,
    pub(super) known: &'a TilePresence,
}

impl IndexedLayer<'_> {
    /// Hands on the highest codes of a tile's squares of `step` cells, where it is known.
    pub(super) fn with_codes(&self, tile: (i32, i32), step: usize, take: impl FnOnce(&[u16])) {
        if let Some(codes) = self.known.coarse_codes(tile, step) {
            return take(codes);
        }
        let (layer, (tx, ty)) = (self.layer, tile);
        let stored = self.store.get(TileKey { layer, tx, ty });
        if let Some(cells) = stored.and_then(|stored| stored.cells()) {
            let mut codes = [0; CELLS];
            let side = TILE_SIDE / step;
            let codes = &mut codes[..side * side];
            max_codes(cells, step, codes);
            take(codes);
        }
    }
}

/// Whether each square of `step` cells of a tile (of cells so large, metres) lies over anything that one of these layers knows:
/// in the order of its codes, the greatest y first.
pub(super) fn known_below(
    below: &[IndexedLayer<'_>],
    (tile, cell_m): ((i32, i32), f64),
    step: usize,
) -> Vec<bool> {
    let side = TILE_SIDE / step;
    let mut is_known = vec![false; side * side];
    for lower in below {
        let ratio = cell_m / lower.cell_m;
        let lower_step = step_below(ratio, step);
        let columns = texels_below(tile.0, step, ratio, lower_step);
        let rows = texels_below(tile.1, step, ratio, lower_step);
        let lower_side = (TILE_SIDE / lower_step).cast_signed() as i64;
        for (tx, ty) in tiles_of(&columns, &rows, lower_side) {
            lower.with_codes((tx, ty), lower_step, |codes| {
                let row_of = |y: i64| lower_side - 1 - (y - i64::from(ty) * lower_side);
                for (row, [low_y, high_y]) in (0..side).rev().zip(within(&rows, ty, lower_side)) {
                    for (column, [low_x, high_x]) in within(&columns, tx, lower_side).enumerate() {
                        let first_x = i64::from(tx) * lower_side;
                        let is_any = (low_y..high_y).any(|y| {
                            let first = row_of(y) * lower_side - first_x;
                            (low_x..high_x).any(|x| codes[(first + x) as usize] != UNKNOWN)
                        });
                        is_known[row * side + column] |= is_any;
                    }
                }
            });
        }
    }
    is_known
}

/// The tiles of a layer whose cells are so much smaller than those of another, over one tile of that: the lowest, and how many
/// there are along either axis; `None` where there are too many.
pub(super) fn tiles_above(tile: (i32, i32), ratio: f64) -> Option<((i64, i64), i64)> {
    if !(ratio.is_finite() && ratio > 0.0) {
        return None;
    }
    let span = |at: i32| {
        let [low, high] = [at, at.saturating_add(1)].map(|edge| f64::from(edge) * ratio);
        let first = (low + ROUNDING).floor() as i64;
        (
            first,
            ((high - ROUNDING).ceil() as i64).saturating_sub(first),
        )
    };
    let ((x, columns), (y, rows)) = (span(tile.0), span(tile.1));
    let side = columns.max(rows).max(1);
    (side <= MAX_ABOVE).then_some(((x, y), side))
}

/// How many cells the squares of a lower layer have that are looked at below one of `step` cells.
fn step_below(ratio: f64, step: usize) -> usize {
    let span = step as f64 * ratio + ROUNDING;
    let squares = if step == 1 { FINE } else { 1.0 };
    let mut lower_step = 1;
    while lower_step < TILE_SIDE && 2.0 * lower_step as f64 * squares <= span {
        lower_step *= 2;
    }
    lower_step
}

/// For each square of a tile along one axis, the squares of a lower layer that it lies over: the first, and the one behind the
/// last.
fn texels_below(tile: i32, step: usize, ratio: f64, lower_step: usize) -> Vec<[i64; 2]> {
    let side = TILE_SIDE / step;
    let scale = ratio * step as f64 / lower_step as f64;
    let texel = |index: usize| {
        let low = f64::from(tile) * side as f64 + index as f64;
        let first = (low * scale + ROUNDING).floor() as i64;
        let behind = ((low + 1.0) * scale - ROUNDING).ceil() as i64;
        [
            first,
            behind.clamp(first.saturating_add(1), first.saturating_add(MAX_BELOW)),
        ]
    };
    (0..side).map(texel).collect()
}

/// The tiles in which these squares lie.
fn tiles_of(columns: &[[i64; 2]], rows: &[[i64; 2]], side: i64) -> Vec<(i32, i32)> {
    let along = |texels: &[[i64; 2]]| {
        let tiles = texels.iter().flat_map(|[first, behind]| {
            (*first..*behind).map(|texel| i32::try_from(texel.div_euclid(side)))
        });
        tiles.filter_map(Result::ok).collect::<BTreeSet<_>>()
    };
    let ys = along(rows);
    let pairs = along(columns)
        .into_iter()
        .flat_map(|tx| ys.iter().map(move |ty| (tx, *ty)));
    pairs.collect()
}

/// What of these squares lies in a tile.
fn within(texels: &[[i64; 2]], tile: i32, side: i64) -> impl Iterator<Item = [i64; 2]> {
    let low = i64::from(tile) * side;
    texels
        .iter()
        .map(move |[first, behind]| [(*first).max(low), (*behind).min(low + side)])
}

#[cfg(test)]
mod tests {
    use protocol::tile::{BootId, TileCells};
    use protocol::tile_store::LayerGrid;

    use super::*;

    const LOWER: LayerId = LayerId::Shore;

    /// A lower layer that knows these cells of its tile (0, 0), and whether a tile of cells of `cell_m` lies over them: columns
    /// and rows of squares, counted with x and y.
    fn over(
        (lower_m, known): (f64, &[(usize, usize)]),
        (tile, cell_m): ((i32, i32), f64),
        step: usize,
    ) -> Vec<(usize, usize)> {
        let mut store = TileStore::new(BootId([1; 16]), 10);
        let grid = LayerGrid {
            layer: LOWER,
            cell_m: 0.1,
        };
        store.set_grid(grid).unwrap();
        let key = TileKey {
            layer: LOWER,
            tx: 0,
            ty: 0,
        };
        let cells = TileCells::from_fn(|x, y| u16::from(known.contains(&(x, y))));
        drop(store.publish(key, cells).unwrap());
        let mut tiles = TilePresence::default();
        tiles.update(&store, key);
        let lower = IndexedLayer {
            layer: LOWER,
            cell_m: lower_m,
            store: &store,
            known: &tiles,
        };
        let side = TILE_SIDE / step;
        let is_known = known_below(&[lower], (tile, cell_m), step);
        assert_eq!(is_known.len(), side * side);
        let found = is_known
            .iter()
            .enumerate()
            .filter(|(_, is_known)| **is_known);
        let mut found: Vec<_> = found
            .map(|(at, _)| (at % side, side - 1 - at / side))
            .collect();
        found.sort_unstable();
        found
    }

    #[test]
    fn what_is_known_below_is_found_whatever_the_cells() {
        let known: &[(usize, usize)] = &[(3, 60), (40, 7)];
        let same = |tile, step| over((0.1, known), (tile, 0.1), step);
        assert_eq!(same((0, 0), 1), [(3, 60), (40, 7)]);
        assert_eq!(same((0, 0), 8), [(0, 7), (5, 0)]);
        assert_eq!(same((0, 0), 64), [(0, 0)]);
        assert_eq!(same((1, 0), 1), []);
        assert_eq!(same((-1, 0), 1), []);
        // Three times as large: each lies over nine, and none is missed.
        let large = |tile, step| over((0.1, known), (tile, 0.3), step);
        assert_eq!(large((0, 0), 1), [(1, 20), (13, 2)]);
        assert_eq!(large((-1, 0), 1), []);
        // Half as large: four lie over each.
        let small = over((0.2, &[(40, 7)]), ((1, 0), 0.1), 1);
        assert_eq!(small, [(16, 14), (16, 15), (17, 14), (17, 15)]);
        assert_eq!(over((0.2, &[(40, 7)]), ((0, 0), 0.1), 1), []);
    }

    #[test]
    fn cells_beyond_all_sense_cost_little() {
        for (lower_m, cell_m) in [(1e-9, 1.0), (1.0, 1e-9), (1e300, 1e-300)] {
            over((lower_m, &[(0, 0)]), ((0, 0), cell_m), 1);
            over((lower_m, &[(0, 0)]), ((i32::MAX, i32::MIN), cell_m), 64);
        }
    }

    #[test]
    fn the_tiles_above_one_are_those_that_overlap_it() {
        assert_eq!(tiles_above((5, -3), 1.0), Some(((5, -3), 1)));
        assert_eq!(tiles_above((1, -1), 0.3 / 0.1), Some(((3, -3), 3)));
        assert_eq!(tiles_above((7, -1), 0.5), Some(((3, -1), 1)));
        assert_eq!(tiles_above((1, 1), 1.5), Some(((1, 1), 2)));
        for ratio in [1e9, 0.0, f64::INFINITY, f64::NAN] {
            assert_eq!(tiles_above((1, 1), ratio), None);
        }
    }
}
