//! The highest code of squares of a tile's cells: what a texel shows that is larger than a cell.

use protocol::tile::{TILE_SIDE, TileCells};

/// Squares of 8, 16, 32 and 64 cells are worked out when a tile changes: a great map is far away, and shows a
/// thousand tiles where it would show one.
const COARSE: [usize; 4] = [8, 16, 32, 64];
const LEN: usize = 64 + 16 + 4 + 1;

/// The highest codes of a tile in squares of 8 cells and more, the greatest y first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct CodePyramid([u16; LEN]);

impl CodePyramid {
    pub(super) fn of(cells: &TileCells) -> Self {
        let mut codes = [0; LEN];
        max_codes(cells, COARSE[0], &mut codes[..64]);
        let mut from = 0;
        for step in &COARSE[1..] {
            let side = TILE_SIDE / step;
            let (finer, coarser) = codes[from..].split_at_mut(4 * side * side);
            for (index, code) in coarser.iter_mut().take(side * side).enumerate() {
                let (x, y) = (2 * (index % side), 2 * (index / side));
                let first = y * 2 * side + x;
                let four = [first, first + 1, first + 2 * side, first + 2 * side + 1];
                *code = four.map(|at| finer[at]).into_iter().max().unwrap_or(0);
            }
            from += 4 * side * side;
        }
        Self(codes)
    }

    /// Those of squares of `step` cells; `None` where they are finer than are kept.
    pub(super) fn of_step(&self, step: usize) -> Option<&[u16]> {
        let mut from = 0;
        for coarse in COARSE {
            let len = (TILE_SIDE / coarse) * (TILE_SIDE / coarse);
            if coarse == step {
                return Some(&self.0[from..from + len]);
            }
            from += len;
        }
        None
    }
}

/// The highest code of each square of `step` × `step` cells into `highest`, the greatest y first.
pub(super) fn max_codes(cells: &TileCells, step: usize, highest: &mut [u16]) {
    let texels = TILE_SIDE / step;
    if step == 1 {
        for (texel_row, row) in highest.chunks_exact_mut(texels).zip((0..TILE_SIDE).rev()) {
            texel_row.copy_from_slice(cells.row(row));
        }
        return;
    }
    highest.fill(0);
    let mut columns = [0_u16; TILE_SIDE];
    for (texel_row, top) in highest.chunks_exact_mut(texels).zip((0..texels).rev()) {
        columns.copy_from_slice(cells.row(top * step));
        for row in top * step + 1..(top + 1) * step {
            for (highest, code) in columns.iter_mut().zip(cells.row(row)) {
                *highest = (*highest).max(*code);
            }
        }
        for (texel, codes) in texel_row.iter_mut().zip(columns.chunks_exact(step)) {
            *texel = codes.iter().copied().max().unwrap_or(0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coarse_codes_are_those_that_cells_have() {
        let cells = TileCells::from_fn(|x, y| ((x * 7919 + y * 104_729) % 251) as u16);
        let coarse = CodePyramid::of(&cells);
        for step in [1, 2, 4, 8, 16, 32, 64] {
            let side = TILE_SIDE / step;
            let mut found = vec![9; side * side];
            max_codes(&cells, step, &mut found);
            for (index, code) in found.iter().enumerate() {
                let (x, y) = (index % side * step, (side - 1 - index / side) * step);
                let of_cells = (y..y + step)
                    .flat_map(|row| &cells.row(row)[x..x + step])
                    .max();
                assert_eq!(Some(code), of_cells, "{step}: {x} {y}");
            }
            match coarse.of_step(step) {
                Some(codes) => assert_eq!(codes, found, "{step}"),
                None => assert!(step < 8),
            }
        }
    }
}
