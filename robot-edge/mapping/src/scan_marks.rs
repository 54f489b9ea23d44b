//! Scratch marks of one scan, so that each cell is updated once per scan and a hit wins
//! (docs/methods.md, section 2), and the supercover line walk in integers that sets them.
//!
//! A window over the scan's extent holds one byte per cell. Walking a beam only stores; one pass
//! over the touched blocks of 64 cells updates the grid.

use crate::grid::{TILE_EDGE, TILE_EDGE_CELLS, TileIndex};
use crate::occupancy_grid::mark;

/// Longest beam along x or y, cells; it keeps the window below 70 MB.
pub const MAX_BEAM_CELLS: u32 = 4000;

/// Cells of a block: one row of a tile, one cache line of marks.
pub const BLOCK: usize = TILE_EDGE;

/// Marks of one scan; all [`mark::NONE`] between scans.
#[derive(Clone, Debug, Default)]
pub struct ScanMarks {
    lowest_tile: (i32, i32),
    tiles_wide: usize,
    tiles_high: usize,
    marks: Vec<u8>,
    touched_blocks: Vec<u8>,
    touched_tiles: Vec<u8>,
}

/// Marked rows of one tile.
#[derive(Debug)]
#[must_use = "marks that stay are taken for those of the next scan"]
pub struct TouchedRows<'a> {
    /// From the tile's first block on.
    marks: &'a mut [u8],
    touched_blocks: &'a mut [u8],
    blocks_a_row: usize,
}

impl TouchedRows<'_> {
    /// Calls `each` with `(row in tile, marks)` for rows that hold marks, and clears them.
    pub fn for_each(self, mut each: impl FnMut(usize, &[u8])) {
        for row in 0..TILE_EDGE {
            let block = row * self.blocks_a_row;
            if std::mem::take(&mut self.touched_blocks[block]) != 0 {
                let marks = &mut self.marks[block * BLOCK..][..BLOCK];
                each(row, marks);
                marks.fill(mark::NONE);
            }
        }
    }
}

impl ScanMarks {
    /// Sets the window to the cells `lowest` to `highest`, both included.
    pub fn cover(&mut self, lowest: (i32, i32), highest: (i32, i32)) {
        let edge = TILE_EDGE_CELLS;
        let tile = |cell: (i32, i32)| (cell.0.div_euclid(edge), cell.1.div_euclid(edge));
        let (first, last) = (tile(lowest), tile(highest));
        self.lowest_tile = first;
        self.tiles_wide = last.0.abs_diff(first.0) as usize + 1;
        self.tiles_high = last.1.abs_diff(first.1) as usize + 1;
        let blocks = self.tiles_wide * self.tiles_high * TILE_EDGE;
        if self.marks.len() < blocks * BLOCK {
            self.marks.resize(blocks * BLOCK, mark::NONE);
            self.touched_blocks.resize(blocks, 0);
        }
    }

    /// Marks the cells crossed from `start` to `end` as free, the last one only if `whole`.
    pub fn cross(&mut self, start: FixedPoint, end: FixedPoint, whole: bool) {
        let walk = RayWalk::new(start, end);
        let row = self.tiles_wide * TILE_EDGE;
        let along_x = walk.step_x as isize;
        let along_y = walk.step_y as isize * row.cast_signed();
        let mut place = self.place(start.cell());
        let mut error = walk.error;
        for _ in 0..walk.steps + u32::from(whole) {
            self.marks[place] = mark::FREE;
            self.touched_blocks[place / BLOCK] = 1;
            // A select instead of a branch: the direction of the next step is unpredictable.
            let step_is_along_x = error < 0;
            place = place.wrapping_add_signed(if step_is_along_x { along_x } else { along_y });
            error += if step_is_along_x {
                walk.error_after_x
            } else {
                -walk.error_after_y
            };
        }
    }

    /// Marks the cell of a hit. Call it after all [`ScanMarks::cross`].
    pub fn hit(&mut self, end: FixedPoint) {
        let place = self.place(end.cell());
        self.marks[place] = mark::OCCUPIED;
        self.touched_blocks[place / BLOCK] = 1;
    }

    /// Calls `each` for every touched tile, and clears the marks.
    pub fn drain(&mut self, mut each: impl FnMut(TileIndex, TouchedRows<'_>)) {
        self.find_touched_tiles();
        for slot in 0..self.touched_tiles.len() {
            if self.touched_tiles[slot] == 0 {
                continue;
            }
            let (tile_x, tile_y) = (slot % self.tiles_wide, slot / self.tiles_wide);
            let index = TileIndex {
                x: self.lowest_tile.0.wrapping_add_unsigned(tile_x as u32),
                y: self.lowest_tile.1.wrapping_add_unsigned(tile_y as u32),
            };
            let first_block = tile_y * TILE_EDGE * self.tiles_wide + tile_x;
            let rows = TouchedRows {
                marks: &mut self.marks[first_block * BLOCK..],
                touched_blocks: &mut self.touched_blocks[first_block..],
                blocks_a_row: self.tiles_wide,
            };
            each(index, rows);
        }
    }

    fn find_touched_tiles(&mut self) {
        self.touched_tiles.clear();
        self.touched_tiles
            .resize(self.tiles_wide * self.tiles_high, 0);
        let rows_of_tiles = self
            .touched_blocks
            .chunks_exact(self.tiles_wide * TILE_EDGE);
        let tiles = self.touched_tiles.chunks_exact_mut(self.tiles_wide);
        for (tiles, blocks) in tiles.zip(rows_of_tiles) {
            for row in blocks.chunks_exact(self.tiles_wide) {
                for (tile, &block) in tiles.iter_mut().zip(row) {
                    *tile |= block;
                }
            }
        }
    }

    /// Memory of the window, bytes.
    pub fn bytes(&self) -> usize {
        self.marks.capacity() + self.touched_blocks.capacity() + self.touched_tiles.capacity()
    }

    fn place(&self, cell: (i32, i32)) -> usize {
        let edge = TILE_EDGE_CELLS;
        let x = (cell.0 - self.lowest_tile.0 * edge) as usize;
        let y = (cell.1 - self.lowest_tile.1 * edge) as usize;
        y * self.tiles_wide * TILE_EDGE + x
    }
}

/// 2¹⁶ steps per cell: a point moves by less than 2 µm for 0.1 m cells.
const FRACTION_BITS: u32 = 16;
const FRACTION: i64 = 1 << FRACTION_BITS;

/// A point in fixed-point cells. Its cell is the floor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FixedPoint {
    x: i64,
    y: i64,
}

/// Greatest distance from the origin of `odom`, cells: tile indices have 32 bits and products of
/// coordinates must fit in 64.
const MAX_CELL: f64 = (1u64 << 30) as f64;

impl FixedPoint {
    /// `None` if not finite or farther than 2³⁰ cells from the origin of `odom`.
    pub fn from_metres(x_m: f64, y_m: f64, cell_m: f64) -> Option<Self> {
        let (x, y) = (x_m / cell_m, y_m / cell_m);
        let fits = |cells: f64| cells.abs() < MAX_CELL; // false for NaN
        let fixed = |cells: f64| rounded_down(cells * FRACTION as f64);
        (fits(x) && fits(y)).then(|| Self {
            x: fixed(x),
            y: fixed(y),
        })
    }

    /// One cell.
    pub const fn cell(self) -> (i32, i32) {
        (
            (self.x >> FRACTION_BITS) as i32,
            (self.y >> FRACTION_BITS) as i32,
        )
    }
}

/// Floor of `value`; faster than a call of `floor`.
fn rounded_down(value: f64) -> i64 {
    let towards_zero = value as i64;
    towards_zero - i64::from(value < towards_zero as f64)
}

/// A walk along a segment. Each step crosses one cell edge, so diagonals are never skipped; at an
/// exact corner one of the two adjacent cells is included.
///
/// Bresenham's algorithm with every crossed cell (docs/methods.md, section 2; \[LRF\] §2): the sign
/// of `error` selects the next edge, vertical or horizontal. Integers only, so no error
/// accumulates.
#[derive(Clone, Copy, Debug)]
pub struct RayWalk {
    /// Steps from the first cell to the last: |Δx| + |Δy|.
    pub steps: u32,
    /// −1 or 1.
    pub step_x: i32,
    /// −1 or 1.
    pub step_y: i32,
    /// Negative: the next step is along x.
    pub error: i64,
    /// Added after a step along x.
    pub error_after_x: i64,
    /// Subtracted after a step along y.
    pub error_after_y: i64,
}

impl RayWalk {
    /// `start` and `end` must be fewer than 2²⁰ cells apart.
    pub fn new(start: FixedPoint, end: FixedPoint) -> Self {
        let (x0, y0) = start.cell();
        let (x1, y1) = end.cell();
        let (dx, dy) = ((end.x - start.x).abs(), (end.y - start.y).abs());
        let to_edge_x = distance_to_edge(start.x, end.x >= start.x);
        let to_edge_y = distance_to_edge(start.y, end.y >= start.y);
        Self {
            steps: x1.abs_diff(x0) + y1.abs_diff(y0),
            step_x: if end.x >= start.x { 1 } else { -1 },
            step_y: if end.y >= start.y { 1 } else { -1 },
            // The vertical edge comes first if to_edge_x / dx < to_edge_y / dy.
            error: to_edge_x * dy - to_edge_y * dx,
            error_after_x: 2 * FRACTION * dy,
            error_after_y: 2 * FRACTION * dx,
        }
    }
}

/// Twice the distance to the first cell edge. Points are the middle of their fixed-point step
/// (hence twice, and odd), so that none is on an edge and a walk ends exactly in its last cell.
const fn distance_to_edge(coordinate: i64, forward: bool) -> i64 {
    let twice = 2 * (coordinate & (FRACTION - 1)) + 1;
    if forward { 2 * FRACTION - twice } else { twice }
}

#[cfg(test)]
mod scan_marks_tests {
    use std::collections::BTreeMap;

    use super::*;

    fn drained(marks: &mut ScanMarks) -> BTreeMap<(i32, i32), u8> {
        let mut cells = BTreeMap::new();
        marks.drain(|tile, rows| {
            rows.for_each(|row, block| {
                for (column, &mark) in block.iter().enumerate().filter(|(_, mark)| **mark != 0) {
                    let cell = (
                        (tile.x * 64).wrapping_add_unsigned(column as u32),
                        (tile.y * 64).wrapping_add_unsigned(row as u32),
                    );
                    assert_eq!(cells.insert(cell, mark), None, "{cell:?} handed out twice");
                }
            });
        });
        cells
    }

    #[test]
    fn a_hit_wins_over_a_beam_that_crosses_it() {
        let point = |x: f64, y: f64| FixedPoint::from_metres(x, y, 1.0).unwrap();
        let mut marks = ScanMarks::default();
        marks.cover((-70, 0), (2, 0));
        let (sensor, near, far) = (point(2.5, 0.5), point(-0.5, 0.5), point(-69.5, 0.5));
        marks.cross(sensor, far, false);
        marks.cross(sensor, near, false);
        marks.hit(far);
        marks.hit(near);
        let cells = drained(&mut marks);
        assert_eq!(cells.len(), 73);
        assert_eq!(
            (
                cells[&(2, 0)],
                cells[&(-1, 0)],
                cells[&(-2, 0)],
                cells[&(-70, 0)]
            ),
            (1, 2, 1, 2)
        );
        assert_eq!(drained(&mut marks), BTreeMap::new(), "not cleared");
    }

    #[test]
    fn a_smaller_window_after_a_larger_one_starts_clean() {
        let point = |x: f64, y: f64| FixedPoint::from_metres(x, y, 1.0).unwrap();
        let mut marks = ScanMarks::default();
        marks.cover((0, 0), (500, 500));
        marks.cross(point(0.5, 0.5), point(500.5, 500.5), true);
        assert_eq!(drained(&mut marks).len(), 1001);
        marks.cover((1000, -1000), (1003, -1000));
        marks.cross(point(1000.5, -999.5), point(1003.5, -999.5), true);
        let cells = drained(&mut marks);
        assert_eq!(
            cells.into_keys().collect::<Vec<_>>(),
            [1000, 1001, 1002, 1003].map(|x| (x, -1000))
        );
    }
}

#[cfg(test)]
mod ray_tests {
    use proptest::prelude::*;

    use super::*;

    fn cells(start: FixedPoint, end: FixedPoint) -> Vec<(i32, i32)> {
        let walk = RayWalk::new(start, end);
        let (mut cell, mut error) = (start.cell(), walk.error);
        let mut crossed = vec![cell];
        for _ in 0..walk.steps {
            if error < 0 {
                cell.0 += walk.step_x;
                error += walk.error_after_x;
            } else {
                cell.1 += walk.step_y;
                error -= walk.error_after_y;
            }
            crossed.push(cell);
        }
        crossed
    }

    fn walk(from: (f64, f64), to: (f64, f64)) -> Vec<(i32, i32)> {
        let point = |(x, y)| FixedPoint::from_metres(x, y, 1.0).unwrap();
        cells(point(from), point(to))
    }

    #[test]
    fn a_shallow_beam_crosses_every_cell_on_its_way() {
        let drawn = walk((0.5, 0.5), (3.5, 1.5));
        // Edges are crossed at x = 1 (y = 0.67), y = 1 (x = 2 exactly: one of two), x = 3 (y =
        // 1.33).
        assert_eq!(drawn.first(), Some(&(0, 0)));
        assert_eq!(drawn.last(), Some(&(3, 1)));
        assert_eq!(drawn.len(), 5);
        assert_eq!(walk((0.2, 0.9), (0.9, 0.2)), [(0, 0)]);
        assert_eq!(walk((0.5, 0.5), (-1.5, 0.5)), [(0, 0), (-1, 0), (-2, 0)]);
        assert_eq!(walk((0.1, 0.8), (0.9, 1.9)), [(0, 0), (0, 1)]);
    }

    #[test]
    fn points_are_rounded_down_on_both_sides_of_zero() {
        for value in [-2.0, -1.75, -1.0, -1e-9, -0.0, 0.0, 0.25, 1.0, 1.75] {
            assert_eq!(rounded_down(value), libm::floor(value) as i64, "{value}");
        }
    }

    #[test]
    fn far_or_senseless_points_have_no_cell() {
        for x in [f64::NAN, f64::INFINITY, 2e9, -2e9] {
            assert_eq!(FixedPoint::from_metres(x, 0.0, 1.0), None, "{x}");
        }
    }

    /// Liang–Barsky: the parameter interval of the segment inside the open cell; `None` if
    /// disjoint.
    fn overlap(from: (f64, f64), to: (f64, f64), cell: (i32, i32)) -> Option<f64> {
        let (mut t0, mut t1) = (0.0f64, 1.0f64);
        for (a, b, low) in [(from.0, to.0, cell.0), (from.1, to.1, cell.1)] {
            let (low, high) = (f64::from(low), f64::from(low) + 1.0);
            let d = b - a;
            if d == 0.0 {
                if a < low || a >= high {
                    return None;
                }
                continue;
            }
            let (near, far) = ((low - a) / d, (high - a) / d);
            t0 = t0.max(near.min(far));
            t1 = t1.min(near.max(far));
        }
        (t1 > t0).then_some(t1 - t0)
    }

    proptest! {
        #[test]
        fn the_walk_is_the_supercover(
            x0 in -40.0..40.0f64, y0 in -40.0..40.0f64, x1 in -40.0..40.0f64, y1 in -40.0..40.0f64,
        ) {
            let crossed = walk((x0, y0), (x1, y1));
            for pair in crossed.windows(2) {
                let moved = (pair[1].0 - pair[0].0).abs() + (pair[1].1 - pair[0].1).abs();
                prop_assert_eq!(moved, 1, "a diagonal step");
            }
            let length = ((x1 - x0).powi(2) + (y1 - y0).powi(2)).sqrt();
            for x in -41..=41 {
                for y in -41..=41 {
                    // Overlaps shorter than a fixed-point step may go either way.
                    let inside = overlap((x0, y0), (x1, y1), (x, y)).map_or(0.0, |t| t * length);
                    let walked = crossed.contains(&(x, y));
                    prop_assert!(inside <= 1e-3 || walked, "({x}, {y}) left out");
                    if walked {
                        let near = (-1..=1).any(|i| (-1..=1).any(|j| {
                            overlap((x0, y0), (x1, y1), (x + i, y + j)).is_some()
                        }));
                        prop_assert!(near, "({x}, {y}) is not on the beam");
                    }
                }
            }
        }

        #[test]
        fn both_directions_cross_equally_many_cells(
            x0 in -1e6..1e6f64, y0 in -1e6..1e6f64, dx in -9e3..9e3f64, dy in -9e3..9e3f64,
        ) {
            let (from, to) = ((x0, y0), (x0 + dx, y0 + dy));
            let (there, back) = (walk(from, to), walk(to, from));
            prop_assert_eq!(there.first(), back.last());
            prop_assert_eq!(there.last(), back.first());
            prop_assert_eq!(there.len(), back.len());
        }
    }
}
