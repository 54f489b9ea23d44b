//! How tiles are gathered into textures: 512×512 texels each, finer or coarser with the magnification.
//!
//! On level 0 a texel is a cell and a chunk 8×8 tiles; on level `l` a texel is 2ˡ × 2ˡ cells. So a screen
//! shows about as many chunks however far out it is, and none of its texels is smaller than a pixel: what a
//! coarser texel shows is chosen here, not left to a filter in which walls of one cell come and go.
//! Below 0 a cell is 2 to 8 texels wide: those levels are for layers whose classes have patterns, which are laid
//! over texels and would be as coarse as the cells without them.

use eframe::egui::{Color32, ColorImage};
use protocol::tile::TILE_SIDE;

use super::coloring::Coloring;

/// Texels along one side of a chunk.
pub(super) const CHUNK_TEXELS: usize = 512;
/// Cells along one side of a tile, for indices.
pub(super) const TILE_CELLS: i64 = 64;
const _: () = assert!(TILE_CELLS as usize == TILE_SIDE);
/// On the coarsest level a tile is one texel.
const MAX_LEVEL: i8 = 6;
/// On the finest level a tile is a chunk.
const MIN_LEVEL: i8 = -3;
const _: () = assert!(TILE_SIDE << -MIN_LEVEL == CHUNK_TEXELS);

/// How coarse.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Level(i8);

/// A chunk: level, column and row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct ChunkKey {
    pub(super) level: Level,
    pub(super) x: i64,
    pub(super) y: i64,
}

impl Level {
    /// Every level, the finest first.
    pub(super) fn all() -> impl Iterator<Item = Self> {
        (MIN_LEVEL..=MAX_LEVEL).map(Self)
    }

    /// The finest level whose texels are at least a pixel, and no finer than cells where nothing `has_patterns`.
    pub(super) fn for_scale(pixels_per_cell: f64, has_patterns: bool) -> Self {
        let finest = if has_patterns { MIN_LEVEL } else { 0 };
        (finest..=MAX_LEVEL)
            .map(Self)
            .find(|level| {
                pixels_per_cell * level.cells_per_texel() as f64 >= level.texels_per_cell() as f64
            })
            .unwrap_or(Self(MAX_LEVEL))
    }

    /// Cells along one side of a texel, where that is more than one.
    pub(super) const fn cells_per_texel(self) -> usize {
        if self.0 > 0 { 1 << self.0 } else { 1 }
    }

    /// Texels along one side of a cell, where that is more than one.
    pub(super) const fn texels_per_cell(self) -> usize {
        if self.0 < 0 { 1 << -self.0 } else { 1 }
    }

    /// Texels along one side of a tile.
    pub(super) const fn tile_texels(self) -> usize {
        TILE_SIDE * self.texels_per_cell() / self.cells_per_texel()
    }

    /// The next coarser level, while there is one.
    pub(super) fn coarser(self) -> Option<Self> {
        (self.0 < MAX_LEVEL).then_some(Self(self.0 + 1))
    }

    /// The next finer level, while there is one.
    pub(super) fn finer(self) -> Option<Self> {
        (self.0 > MIN_LEVEL).then_some(Self(self.0 - 1))
    }

    /// The finest level at which so many tiles in a row lie in `chunks` chunks, wherever they begin.
    pub(super) fn for_span(tiles: i64, chunks: i64) -> Self {
        (0..=MAX_LEVEL)
            .map(Self)
            .find(|level| tiles <= (chunks - 1) * level.tiles_per_chunk() + 1)
            .unwrap_or(Self(MAX_LEVEL))
    }

    /// Tiles along one side of a chunk.
    pub(super) const fn tiles_per_chunk(self) -> i64 {
        if self.0 < 0 {
            8 >> -self.0
        } else {
            8 << self.0
        }
    }
}

impl ChunkKey {
    /// The chunk that holds a tile.
    pub(super) fn of_tile(level: Level, (tx, ty): (i64, i64)) -> Self {
        Self {
            level,
            x: tx.div_euclid(level.tiles_per_chunk()),
            y: ty.div_euclid(level.tiles_per_chunk()),
        }
    }

    /// Its tile with the lowest x and y.
    pub(super) const fn first_tile(self) -> (i64, i64) {
        let side = self.level.tiles_per_chunk();
        (self.x * side, self.y * side)
    }

    /// Where a tile of this chunk begins in its image: column and row from the upper left.
    pub(super) fn texel_of(self, (tx, ty): (i32, i32)) -> [usize; 2] {
        let side = self.level.tiles_per_chunk();
        let column = i64::from(tx).rem_euclid(side) as usize;
        let row = (side - 1 - i64::from(ty).rem_euclid(side)) as usize;
        [column, row].map(|tile| tile * self.level.tile_texels())
    }

    /// Lowest and greatest x and y, metres.
    pub(super) fn edges_m(self, cell_m: f64) -> [f64; 4] {
        let side_m = (self.level.tiles_per_chunk() * TILE_CELLS) as f64 * cell_m;
        let (x, y) = (self.x as f64, self.y as f64);
        // Neighbours work out their common edge from the same numbers, so no gap opens between them.
        [
            x * side_m,
            y * side_m,
            (x + 1.0) * side_m,
            (y + 1.0) * side_m,
        ]
    }
}

/// The codes of a tile's texels, or of its cells where those are larger, the greatest y first.
#[derive(Clone, Copy)]
pub(super) struct Codes<'a> {
    /// The highest of each.
    pub(super) highest: &'a [u16],
    /// Whether each lies over something known; empty where that makes no difference, as where there are patterns.
    pub(super) is_over_known: &'a [bool],
}

/// Writes a tile as texels into `texels`, which are `width` wide and whose first is the tile's upper left one. A texel
/// shows the highest code of its cells, so that walls stay visible, as in exported pictures. `at` is where the tile
/// begins in its chunk: there its patterns go on from those of its neighbours.
pub(super) fn paint_tile(
    texels: &mut [Color32],
    width: usize,
    level: Level,
    at: [usize; 2],
    codes: Codes<'_>,
    coloring: &Coloring,
) {
    let per_cell = level.texels_per_cell();
    let side = TILE_SIDE / level.cells_per_texel();
    let rows = texels.chunks_mut(width).take(level.tile_texels());
    for (y, row) in rows.enumerate() {
        let first = y / per_cell * side;
        let highest = &codes.highest[first..][..side];
        let row = &mut row[..level.tile_texels()];
        if coloring.has_patterns() || per_cell > 1 {
            for (x, texel) in row.iter_mut().enumerate() {
                *texel = coloring.color_at(highest[x / per_cell], at[0] + x, at[1] + y);
            }
        } else if codes.is_over_known.is_empty() {
            for (texel, code) in row.iter_mut().zip(highest) {
                *texel = coloring.plain(*code);
            }
        } else {
            let is_over_known = &codes.is_over_known[first..][..side];
            for ((texel, code), is_over) in row.iter_mut().zip(highest).zip(is_over_known) {
                *texel = if *is_over {
                    coloring.plain(*code)
                } else {
                    coloring.alone(*code)
                };
            }
        }
    }
}

/// A tile of `level` as a picture of its own.
pub(super) fn tile_image(
    codes: Codes<'_>,
    level: Level,
    at: [usize; 2],
    coloring: &Coloring,
) -> ColorImage {
    let side = level.tile_texels();
    let mut image = ColorImage::filled([side; 2], Color32::TRANSPARENT);
    paint_tile(&mut image.pixels, side, level, at, codes, coloring);
    image
}

#[cfg(test)]
mod tests {
    use protocol::layer::LayerId;
    use protocol::tile::TileCells;

    use super::super::max_codes::max_codes;
    use super::*;

    fn chunk(level: i8, tile: (i64, i64)) -> ChunkKey {
        ChunkKey::of_tile(Level(level), tile)
    }

    #[test]
    fn tiles_left_of_and_below_the_origin_are_in_negative_chunks() {
        let at = |level, tile| {
            let chunk = chunk(level, tile);
            (chunk.x, chunk.y)
        };
        assert_eq!(at(0, (0, 7)), (0, 0));
        assert_eq!(at(0, (-1, 8)), (-1, 1));
        assert_eq!(at(0, (-8, -9)), (-1, -2));
        assert_eq!(at(1, (-16, 15)), (-1, 0));
        assert_eq!(at(6, (511, -512)), (0, -1));
        assert_eq!(chunk(1, (-1, -17)).first_tile(), (-16, -32));
    }

    #[test]
    fn a_tile_lies_in_its_own_part_of_the_image_upside_down() {
        let texel = |level, (tx, ty): (i32, i32)| {
            chunk(level, (i64::from(tx), i64::from(ty))).texel_of((tx, ty))
        };
        assert_eq!(texel(0, (0, 0)), [0, 448]);
        assert_eq!(texel(0, (7, 7)), [448, 0]);
        assert_eq!(texel(0, (-1, -8)), [448, 448]);
        assert_eq!(texel(1, (1, 0)), [32, 480]);
        assert_eq!(texel(6, (-1, -1)), [511, 0]);
        assert_eq!(texel(-3, (-1, 5)), [0, 0]);
        assert_eq!(texel(-1, (-1, 5)), [384, 256]);
    }

    #[test]
    fn a_chunk_has_the_edges_of_its_tiles() {
        for level in Level::all() {
            let key = ChunkKey { level, x: -2, y: 1 };
            let (tx, ty) = key.first_tile();
            let side_m = TILE_SIDE as f64 * 0.25;
            let [low_x, low_y, high_x, high_y] = key.edges_m(0.25);
            let tiles = level.tiles_per_chunk();
            // Exact: a quarter of a metre and powers of two.
            let edges = [low_x, low_y, high_x, high_y].map(f64::to_bits);
            let expected = [tx, ty, tx + tiles, ty + tiles].map(|tile| tile as f64 * side_m);
            assert_eq!(edges, expected.map(f64::to_bits));
            assert_eq!(tiles as usize * level.tile_texels(), CHUNK_TEXELS);
        }
    }

    #[test]
    fn a_span_fits_its_chunks_wherever_it_begins() {
        for (tiles, level) in [(1, 0), (9, 0), (10, 1), (157, 5), (129, 4), (1 << 40, 6)] {
            assert_eq!(Level::for_span(tiles, 2), Level(level), "{tiles}");
        }
    }

    #[test]
    fn texels_are_never_smaller_than_a_pixel_while_there_are_levels() {
        for (pixels_per_cell, level) in [
            (30.0, 0),
            (1.0, 0),
            (0.99, 1),
            (0.5, 1),
            (0.1, 4),
            (0.02, 6),
            (1e-9, 6),
        ] {
            assert_eq!(Level::for_scale(pixels_per_cell, false), Level(level));
        }
        for (pixels_per_cell, level) in [
            (100.0, -3),
            (8.0, -3),
            (7.9, -2),
            (2.0, -1),
            (1.9, 0),
            (0.3, 2),
        ] {
            assert_eq!(Level::for_scale(pixels_per_cell, true), Level(level));
        }
    }

    /// As [`tile_image`], from cells.
    fn image_of(
        cells: &TileCells,
        level: Level,
        at: [usize; 2],
        coloring: &Coloring,
    ) -> ColorImage {
        let side = TILE_SIDE / level.cells_per_texel();
        let mut highest = vec![0; side * side];
        max_codes(cells, level.cells_per_texel(), &mut highest);
        let codes = Codes {
            highest: &highest,
            is_over_known: &[],
        };
        tile_image(codes, level, at, coloring)
    }

    #[test]
    fn a_wall_of_one_cell_is_there_on_every_level() {
        let cells = TileCells::from_fn(|x, y| if (x, y) == (9, 60) { 2 } else { 1 });
        let coloring = Coloring::new(LayerId::Obstacle.default_palette(), false);
        let wall = coloring.color_at(2, 0, 0);
        for level in Level::all() {
            let image = image_of(&cells, level, [0, 0], &coloring);
            let found: Vec<_> = image
                .pixels
                .iter()
                .enumerate()
                .filter(|(_, color)| **color == wall)
                .map(|(at, _)| [at % image.width(), at / image.width()])
                .collect();
            let (step, per_cell) = (level.cells_per_texel(), level.texels_per_cell());
            assert_eq!(found.len(), per_cell * per_cell, "{level:?}");
            assert_eq!(found[0], [9, 3].map(|n| n / step * per_cell), "{level:?}");
        }
    }

    #[test]
    fn patterns_are_texels_wide_and_go_on_across_tiles() {
        let palette = LayerId::Shore.default_palette();
        let coloring = Coloring::new(palette, false);
        let cells = TileCells::from_fn(|_, _| 4);
        for level in Level::all() {
            let tile = (3, 2);
            let chunk = ChunkKey::of_tile(level, (3, 2));
            let at = chunk.texel_of(tile);
            let image = image_of(&cells, level, at, &coloring);
            for (index, color) in image.pixels.iter().enumerate() {
                let [x, y] = [index % image.width(), index / image.width()];
                let expected = palette.color_at(4, at[0] + x, at[1] + y);
                assert_eq!(color.to_srgba_unmultiplied(), expected, "{level:?} {x} {y}");
            }
        }
    }
}
