//! Scratch marks of one scan, so that each cell is updated once per scan and a hit wins.
//!
//! A window over the scan's extent holds one byte per cell. Walking a beam only stores; deciding is left
//! to one pass over the blocks of 64 cells that were touched.

use super::grid::{TILE_EDGE, TILE_EDGE_CELLS, TileIndex};
use super::log_odds::mark;
use super::ray::{FixedPoint, RayWalk};

/// Longest beam along x or y, cells: with it the window stays below 70 MB.
pub const MAX_BEAM_CELLS: u32 = 4000;

/// Cells of a block: one row of a tile, one cache line of marks.
pub const BLOCK: usize = TILE_EDGE;

/// The marks of one scan. Between scans all of them are [`mark::NONE`].
#[derive(Clone, Debug, Default)]
pub struct ScanMarks {
    lowest_tile: (i32, i32),
    tiles_wide: usize,
    tiles_high: usize,
    marks: Vec<u8>,
    touched_blocks: Vec<u8>,
    touched_tiles: Vec<u8>,
}

/// What a scan marked in one tile, which stays marked until it is handed out.
#[derive(Debug)]
#[must_use = "marks that stay are taken for those of the next scan"]
pub struct TouchedRows<'a> {
    /// From the tile's first block on, as are the next.
    marks: &'a mut [u8],
    touched_blocks: &'a mut [u8],
    blocks_a_row: usize,
}

impl TouchedRows<'_> {
    /// Hands out the rows of the tile that hold marks, as `(row in tile, marks)`, and clears them.
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
    /// Lays the window over the cells `lowest` to `highest`, both included.
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

    /// Marks the cells crossed on the way from `start` to `end` as free, the last one only if `whole`.
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
            // Selected, not branched on: the direction of the next step cannot be predicted.
            let step_is_along_x = error < 0;
            place = place.wrapping_add_signed(if step_is_along_x { along_x } else { along_y });
            error += if step_is_along_x {
                walk.error_after_x
            } else {
                -walk.error_after_y
            };
        }
    }

    /// Marks the cell of a hit, over whatever beams crossed it. Call it after all [`ScanMarks::cross`].
    pub fn hit(&mut self, end: FixedPoint) {
        let place = self.place(end.cell());
        self.marks[place] = mark::OCCUPIED;
        self.touched_blocks[place / BLOCK] = 1;
    }

    /// Hands out every touched tile once, and clears the marks.
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

#[cfg(test)]
mod tests {
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
