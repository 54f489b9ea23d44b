//! Which tiles and cells of a layer are known, at full and at reduced resolution, and whether a cell lies over known
//! cells of a lower layer. There, free cells are transparent; elsewhere they have their own colour, so that free and
//! unknown cells look different.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use protocol::layer::{LayerId, UNKNOWN};
use protocol::tile::{TILE_SIDE, TileCells, TileKey};
use protocol::tile_store::TileStore;

use super::chunks::TILE_CELLS;

/// Below a single cell up to this number of cells per axis are examined one by one.
const FINE: f64 = 8.0;
/// Maximum number of squares per axis below one square.
const MAX_BELOW: i64 = 17;
/// Maximum number of tiles per axis above one tile.
const MAX_ABOVE: i64 = 64;
const ROUNDING: f64 = 1e-6;

#[derive(Clone, Copy)]
pub(super) struct IndexedLayer<'a> {
    pub(super) layer: LayerId,
    pub(super) cell_m: f64,
    pub(super) store: &'a TileStore,
    pub(super) known: &'a TilePresence,
}

impl IndexedLayer<'_> {
    /// The deciding codes of the squares of `step` cells of a known tile.
    pub(super) fn codes(&self, tile: (i32, i32), step: usize) -> Option<Cow<'_, [u16]>> {
        if let Some(codes) = self.known.coarse_codes(tile, step) {
            return Some(Cow::Borrowed(codes));
        }
        let (layer, (tx, ty)) = (self.layer, tile);
        let cells = self.store.shown(TileKey { layer, tx, ty })?;
        let side = TILE_SIDE / step;
        let mut codes = vec![0; side * side];
        deciding_codes(layer, cells, step, &mut codes);
        Some(Cow::Owned(codes))
    }
}

/// Whether each square of `step` cells of a tile is over a known cell of a lower layer, in order.
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
            let Some(codes) = lower.codes((tx, ty), lower_step) else {
                continue;
            };
            let row_of = |y: i64| lower_side - 1 - (y - i64::from(ty) * lower_side);
            let first_x = i64::from(tx) * lower_side;
            for (row, [low_y, high_y]) in (0..side).rev().zip(within(&rows, ty, lower_side)) {
                for (column, [low_x, high_x]) in within(&columns, tx, lower_side).enumerate() {
                    is_known[row * side + column] |= (low_y..high_y).any(|y| {
                        let first = row_of(y) * lower_side - first_x;
                        (low_x..high_x).any(|x| codes[(first + x) as usize] != UNKNOWN)
                    });
                }
            }
        }
    }
    is_known
}

/// The tiles of an upper layer over one tile: the lowest and the number per axis; `None` if too many.
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

/// Cells per square of the lower layer.
fn step_below(ratio: f64, step: usize) -> usize {
    let span = step as f64 * ratio + ROUNDING;
    let squares = if step == 1 { FINE } else { 1.0 };
    let mut lower_step = 1;
    while lower_step < TILE_SIDE && 2.0 * lower_step as f64 * squares <= span {
        lower_step *= 2;
    }
    lower_step
}

/// For each square of a tile along one axis, the range of lower squares under it.
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

fn tiles_of(columns: &[[i64; 2]], rows: &[[i64; 2]], side: i64) -> Vec<(i32, i32)> {
    let along = |texels: &[[i64; 2]]| {
        let texels = texels.iter().flat_map(|[first, behind]| *first..*behind);
        let tiles = texels.map(|texel| i32::try_from(texel.div_euclid(side)));
        tiles.flatten().collect::<BTreeSet<_>>()
    };
    let ys = along(rows);
    let pairs = along(columns)
        .into_iter()
        .flat_map(|tx| ys.iter().map(move |ty| (tx, *ty)));
    pairs.collect()
}

fn within(texels: &[[i64; 2]], tile: i32, side: i64) -> impl Iterator<Item = [i64; 2]> {
    let low = i64::from(tile) * side;
    texels
        .iter()
        .map(move |[first, behind]| [(*first).max(low), (*behind).min(low + side)])
}

/// Bounding box of a tile's known cells, ends included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct KnownBounds {
    columns: [u8; 2],
    rows: [u8; 2],
}

#[derive(Clone, Debug)]
struct IndexedTile {
    known: KnownBounds,
    shape: u64,
    coarse: CodePyramid,
}

#[derive(Clone, Debug, Default)]
pub(super) struct TilePresence {
    tiles: BTreeMap<(i32, i32), IndexedTile>,
    /// Bounding box of known cells; `None` if it must be recomputed.
    bounds_cells: Option<[i64; 4]>,
}

impl TilePresence {
    pub(super) fn update(&mut self, store: &TileStore, key: TileKey) -> bool {
        let tile = store.shown(key).and_then(|cells| {
            let (known, coarse) = (KnownBounds::of(cells)?, CodePyramid::of(key.layer, cells));
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
            // Growth extends the bounds; a tile that shrinks makes them invalid.
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

    pub(super) fn len(&self) -> usize {
        self.tiles.len()
    }

    /// Deciding codes of a tile's squares of `step` cells, if stored.
    pub(super) fn coarse_codes(&self, tile: (i32, i32), step: usize) -> Option<&[u16]> {
        self.tiles.get(&tile)?.coarse.of_step(step)
    }

    /// Known tiles in a square of `side` tiles from its lowest tile.
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

    /// Bounding box of known cells, in cells (upper ends exclusive).
    pub(super) fn bounds_cells(&mut self) -> Option<[i64; 4]> {
        if self.bounds_cells.is_none() {
            let edges = self.tiles.iter().map(|(at, tile)| tile.known.edges(*at));
            self.bounds_cells = edges.reduce(join);
        }
        self.bounds_cells
    }
}

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
    /// Bounding box in cells (upper ends exclusive) for the tile `(tx, ty)`.
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
            let ends = codes.iter().position(is_known);
            let Some((left, right)) = ends.zip(codes.iter().rposition(is_known)) else {
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

/// Computed when a tile changes, because a zoomed-out map shows a thousand tiles.
const COARSE: [usize; 4] = [8, 16, 32, 64];
const LEN: usize = 64 + 16 + 4 + 1;

/// Deciding codes of a tile at several resolutions. Row 0 has the greatest y.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct CodePyramid([u16; LEN]);

impl CodePyramid {
    pub(super) fn of(layer: LayerId, cells: &TileCells) -> Self {
        let mut codes = [0; LEN];
        for step in COARSE {
            deciding_codes(layer, cells, step, &mut codes[Self::range(step)]);
        }
        Self(codes)
    }

    pub(super) fn of_step(&self, step: usize) -> Option<&[u16]> {
        COARSE.contains(&step).then(|| &self.0[Self::range(step)])
    }

    fn range(step: usize) -> Range<usize> {
        let len = |step| (TILE_SIDE / step) * (TILE_SIDE / step);
        let finer = COARSE.into_iter().take_while(|finer| *finer < step);
        let first = finer.map(len).sum();
        first..first + len(step)
    }
}

/// Writes the deciding code of each square of `step` cells to `deciding`. Row 0 has the greatest y.
pub(super) fn deciding_codes(layer: LayerId, cells: &TileCells, step: usize, deciding: &mut [u16]) {
    let texels = TILE_SIDE / step;
    if step == 1 {
        for (texel_row, row) in deciding.chunks_exact_mut(texels).zip((0..TILE_SIDE).rev()) {
            texel_row.copy_from_slice(cells.row(row));
        }
        return;
    }
    deciding.fill(0);
    let mut columns = [0_u16; TILE_SIDE];
    for (texel_row, top) in deciding.chunks_exact_mut(texels).zip((0..texels).rev()) {
        columns.copy_from_slice(cells.row(top * step));
        for row in top * step + 1..(top + 1) * step {
            for (deciding, code) in columns.iter_mut().zip(cells.row(row)) {
                *deciding = layer.deciding(*deciding, *code);
            }
        }
        for (texel, codes) in texel_row.iter_mut().zip(columns.chunks_exact(step)) {
            *texel = codes.iter().fold(0, |a, b| layer.deciding(a, *b));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::store_of;

    const LOWER: LayerId = LayerId::Shore;

    /// Squares of a tile with cells of `cell_m` that are over known cells of tile (0, 0) of a lower layer: columns
    /// and rows from the lower left.
    fn over(
        (lower_m, known): (f64, &[(usize, usize)]),
        (tile, cell_m): ((i32, i32), f64),
        step: usize,
    ) -> Vec<(usize, usize)> {
        let mut store = store_of(&[LOWER]);
        let is_known = |x, y| u16::from(known.contains(&(x, y)));
        let key = super::super::tests::publish(&mut store, LOWER, (0, 0), is_known);
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
    fn known_below_for_different_cell_sizes() {
        let known: &[(usize, usize)] = &[(3, 60), (40, 7)];
        let same = |tile, step| over((0.1, known), (tile, 0.1), step);
        assert_eq!(same((0, 0), 1), [(3, 60), (40, 7)]);
        assert_eq!(same((0, 0), 8), [(0, 7), (5, 0)]);
        assert_eq!(same((0, 0), 64), [(0, 0)]);
        assert_eq!(same((1, 0), 1), []);
        assert_eq!(same((-1, 0), 1), []);
        // Three times as large.
        let large = |tile, step| over((0.1, known), (tile, 0.3), step);
        assert_eq!(large((0, 0), 1), [(1, 20), (13, 2)]);
        assert_eq!(large((-1, 0), 1), []);
        // Half as large.
        let small = over((0.2, &[(40, 7)]), ((1, 0), 0.1), 1);
        assert_eq!(small, [(16, 14), (16, 15), (17, 14), (17, 15)]);
        assert_eq!(over((0.2, &[(40, 7)]), ((0, 0), 0.1), 1), []);
    }

    #[test]
    fn extreme_cell_sizes_cost_little() {
        for (lower_m, cell_m) in [(1e-9, 1.0), (1.0, 1e-9), (1e300, 1e-300)] {
            over((lower_m, &[(0, 0)]), ((0, 0), cell_m), 1);
            over((lower_m, &[(0, 0)]), ((i32::MAX, i32::MIN), cell_m), 64);
        }
    }

    #[test]
    fn tiles_above_overlap() {
        assert_eq!(tiles_above((5, -3), 1.0), Some(((5, -3), 1)));
        assert_eq!(tiles_above((1, -1), 0.3 / 0.1), Some(((3, -3), 3)));
        assert_eq!(tiles_above((7, -1), 0.5), Some(((3, -1), 1)));
        assert_eq!(tiles_above((1, 1), 1.5), Some(((1, 1), 2)));
        for ratio in [1e9, 0.0, f64::INFINITY, f64::NAN] {
            assert_eq!(tiles_above((1, 1), ratio), None);
        }
    }

    const LAYER: LayerId = LayerId::Occupancy;

    fn publish(store: &mut TileStore, tile: (i32, i32), known: &[(usize, usize)]) -> TileKey {
        let is_known = |x, y| u16::from(known.contains(&(x, y)));
        super::super::tests::publish(store, LAYER, tile, is_known)
    }

    fn of_layer(store: &TileStore) -> TilePresence {
        let mut known = TilePresence::default();
        for (key, _) in store.tiles(LAYER) {
            known.update(store, key);
        }
        known
    }

    #[test]
    fn bounds_follow_known_cells() {
        let mut store = store_of(&[LAYER]);
        let left = publish(&mut store, (-1, 0), &[(60, 5), (62, 3)]);
        let right = publish(&mut store, (2, 1), &[(0, 0)]);
        let mut known = of_layer(&store);
        assert_eq!(known.bounds_cells(), Some([-4, 3, 129, 65]));
        publish(&mut store, (2, 1), &[]);
        assert!(known.update(&store, right));
        assert_eq!(known.bounds_cells(), Some([-4, 3, -1, 6]));
        publish(&mut store, (-1, 0), &[(60, 5), (61, 4), (62, 3)]);
        assert!(known.update(&store, left), "within the same bounds");
        assert!(!known.update(&store, left));
        publish(&mut store, (-1, 0), &[]);
        known.update(&store, left);
        assert_eq!(known.len(), 0);
        assert_eq!(known.bounds_cells(), None);
    }

    #[test]
    fn tiles_in_a_square_around_the_origin() {
        let mut store = store_of(&[LAYER]);
        let [a, b, c, d] = [(-9, 0), (-8, -8), (-1, -1), (-1, 0)];
        for tile in [a, b, c, d, (0, -1), (7, 7), (8, 0)] {
            publish(&mut store, tile, &[(1, 1)]);
        }
        let known = of_layer(&store);
        let square = |at| known.in_square(at, 8).collect::<Vec<_>>();
        assert_eq!(square((-8, -8)), [(-8, -8), (-1, -1)]);
        assert_eq!(square((0, 0)), [(7, 7)]);
        assert_eq!(square((-16, 0)), [(-9, 0)]);
        assert_eq!(square((1 << 40, 0)), []);
    }

    #[test]
    fn coarse_codes_are_the_deciding_ones_of_cells() {
        let cells = TileCells::from_fn(|x, y| ((x * 7919 + y * 104_729) % 251) as u16);
        let steps = [1, 2, 4, 8, 16, 32, 64];
        for (layer, step) in [LayerId::Cost, LayerId::Inter]
            .into_iter()
            .flat_map(|layer| steps.map(|step| (layer, step)))
        {
            let coarse = CodePyramid::of(layer, &cells);
            let side = TILE_SIDE / step;
            let mut found = vec![9; side * side];
            deciding_codes(layer, &cells, step, &mut found);
            for (index, code) in found.iter().enumerate() {
                let (x, y) = (index % side * step, (side - 1 - index / side) * step);
                let of_cells = (y..y + step).flat_map(|row| &cells.row(row)[x..x + step]);
                let known = of_cells.filter(|code| **code != 0);
                let decides = match layer {
                    LayerId::Inter => known.min(),
                    _ => known.max(),
                };
                assert_eq!(*code, decides.copied().unwrap_or(0), "{step}: {x} {y}");
            }
            match coarse.of_step(step) {
                Some(codes) => assert_eq!(codes, found, "{step}"),
                None => assert!(step < 8),
            }
        }
    }
}
