//! Tiles are combined into textures (chunks) of 512×512 texels at several levels of detail, and painted within the
//! time of a frame.
//!
//! On level 0 a texel is a cell and a chunk 8×8 tiles; on level `l` a texel is 2ˡ × 2ˡ cells. The number of chunks on
//! the screen is therefore nearly constant, and no texel is smaller than a pixel. A coarse texel shows the deciding
//! code of its cells: a texture filter would make walls of one cell flicker. On levels below 0 a cell is 2 to 8
//! texels wide, for layers with patterns.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::time::Duration;

use eframe::egui::{Color32, ColorImage};
use measurement::time::Monotonic;
use network::clock;
use protocol::layer::UNKNOWN;
use protocol::tile::TILE_SIDE;

use super::coloring::Coloring;
use super::layer_compositing::{IndexedLayer, known_below};

pub(super) const CHUNK_TEXELS: usize = 512;
pub(super) const TILE_CELLS: i64 = 64;
const _: () = assert!(TILE_CELLS as usize == TILE_SIDE);
/// A tile is one texel.
const MAX_LEVEL: i8 = 6;
/// A tile is a chunk.
const MIN_LEVEL: i8 = -3;
const _: () = assert!(TILE_SIDE << -MIN_LEVEL == CHUNK_TEXELS);

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Level(i8);

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct ChunkKey {
    pub(super) level: Level,
    pub(super) x: i64,
    pub(super) y: i64,
}

impl Level {
    pub(super) fn all() -> impl Iterator<Item = Self> {
        (MIN_LEVEL..=MAX_LEVEL).map(Self)
    }

    /// The finest level whose texels are at least a pixel. Levels below 0 are for layers with patterns.
    pub(super) fn for_scale(pixels_per_cell: f64, has_patterns: bool) -> Self {
        let finest = if has_patterns { MIN_LEVEL } else { 0 };
        (finest..=MAX_LEVEL)
            .map(Self)
            .find(|level| {
                pixels_per_cell * level.cells_per_texel() as f64 >= level.texels_per_cell() as f64
            })
            .unwrap_or(Self(MAX_LEVEL))
    }

    pub(super) const fn cells_per_texel(self) -> usize {
        if self.0 > 0 { 1 << self.0 } else { 1 }
    }

    pub(super) const fn texels_per_cell(self) -> usize {
        if self.0 < 0 { 1 << -self.0 } else { 1 }
    }

    pub(super) const fn tile_texels(self) -> usize {
        TILE_SIDE * self.texels_per_cell() / self.cells_per_texel()
    }

    pub(super) fn coarser(self) -> Option<Self> {
        (self.0 < MAX_LEVEL).then_some(Self(self.0 + 1))
    }

    pub(super) fn finer(self) -> Option<Self> {
        (self.0 > MIN_LEVEL).then_some(Self(self.0 - 1))
    }

    /// The finest level at which `tiles` tiles in a row are in at most `chunks` chunks, for any start.
    pub(super) fn for_span(tiles: i64, chunks: i64) -> Self {
        (0..=MAX_LEVEL)
            .map(Self)
            .find(|level| tiles <= (chunks - 1) * level.tiles_per_chunk() + 1)
            .unwrap_or(Self(MAX_LEVEL))
    }

    pub(super) const fn tiles_per_chunk(self) -> i64 {
        if self.0 < 0 {
            8 >> -self.0
        } else {
            8 << self.0
        }
    }
}

impl ChunkKey {
    pub(super) fn of_tile(level: Level, (tx, ty): (i64, i64)) -> Self {
        Self {
            level,
            x: tx.div_euclid(level.tiles_per_chunk()),
            y: ty.div_euclid(level.tiles_per_chunk()),
        }
    }

    pub(super) const fn first_tile(self) -> (i64, i64) {
        let side = self.level.tiles_per_chunk();
        (self.x * side, self.y * side)
    }

    pub(super) fn texel_of(self, (tx, ty): (i32, i32)) -> [usize; 2] {
        let side = self.level.tiles_per_chunk();
        let column = i64::from(tx).rem_euclid(side) as usize;
        let row = (side - 1 - i64::from(ty).rem_euclid(side)) as usize;
        [column, row].map(|tile| tile * self.level.tile_texels())
    }

    pub(super) fn edges_m(self, cell_m: f64) -> [f64; 4] {
        let side_m = (self.level.tiles_per_chunk() * TILE_CELLS) as f64 * cell_m;
        let (x, y) = (self.x as f64, self.y as f64);
        // Adjacent chunks compute their common edge from the same numbers, so that there is no gap.
        [
            x * side_m,
            y * side_m,
            (x + 1.0) * side_m,
            (y + 1.0) * side_m,
        ]
    }
}

/// Codes of a tile's texels, or of its cells if these are larger. Row 0 has the greatest y.
struct Codes<'a> {
    deciding: Cow<'a, [u16]>,
    /// Whether each is over known cells of a lower layer; empty if irrelevant.
    is_over_known: Vec<bool>,
}

/// Paints a tile into `texels` of row length `width`. A texel shows the deciding code of its cells, so that walls stay
/// visible, as in exported pictures. `at` is the position in the chunk, so that patterns continue across tiles.
fn paint_tile(
    texels: &mut [Color32],
    width: usize,
    level: Level,
    at: [usize; 2],
    codes: &Codes<'_>,
    coloring: &Coloring,
) {
    let per_cell = level.texels_per_cell();
    let side = TILE_SIDE / level.cells_per_texel();
    let rows = texels.chunks_mut(width).take(level.tile_texels());
    for (y, row) in rows.enumerate() {
        let first = y / per_cell * side;
        let deciding = &codes.deciding[first..][..side];
        let row = &mut row[..level.tile_texels()];
        if coloring.has_patterns() || per_cell > 1 {
            for (x, texel) in row.iter_mut().enumerate() {
                *texel = coloring.color_at(deciding[x / per_cell], at[0] + x, at[1] + y);
            }
        } else if codes.is_over_known.is_empty() {
            for (texel, code) in row.iter_mut().zip(deciding) {
                *texel = coloring.plain(*code);
            }
        } else {
            let is_over_known = &codes.is_over_known[first..][..side];
            for ((texel, code), is_over) in row.iter_mut().zip(deciding).zip(is_over_known) {
                *texel = if *is_over {
                    coloring.plain(*code)
                } else {
                    coloring.alone(*code)
                };
            }
        }
    }
}

fn tile_image(codes: &Codes<'_>, level: Level, at: [usize; 2], coloring: &Coloring) -> ColorImage {
    let side = level.tile_texels();
    let mut image = ColorImage::filled([side; 2], Color32::TRANSPARENT);
    paint_tile(&mut image.pixels, side, level, at, codes, coloring);
    image
}

#[derive(Clone, Copy)]
pub(super) struct LayerStyle<'a> {
    pub(super) indexed: IndexedLayer<'a>,
    pub(super) coloring: &'a Coloring,
    pub(super) below: &'a [IndexedLayer<'a>],
}

pub(super) struct ChunkBuilder {
    pub(super) key: ChunkKey,
    pub(super) image: ColorImage,
    /// Tiles to paint, the next is last.
    left: Vec<(i32, i32)>,
    /// Painted tiles that have changed since.
    pub(super) changed: BTreeSet<(i32, i32)>,
}

impl ChunkBuilder {
    pub(super) fn begin(key: ChunkKey, style: LayerStyle<'_>) -> Option<Self> {
        let side = key.level.tiles_per_chunk();
        let known = style.indexed.known;
        let left: Vec<_> = known.in_square(key.first_tile(), side).collect();
        (!left.is_empty()).then(|| Self {
            key,
            image: ColorImage::filled([CHUNK_TEXELS; 2], style.coloring.plain(UNKNOWN)),
            left,
            changed: BTreeSet::new(),
        })
    }

    /// Paints tiles while there is time. Returns whether all are painted.
    pub(super) fn advance(&mut self, style: LayerStyle<'_>, time: &mut FrameTime) -> bool {
        while let Some(tile) = self.left.last().copied() {
            if !time.take_tile() {
                return false;
            }
            self.left.pop();
            let at = self.key.texel_of(tile);
            let first = at[1] * CHUNK_TEXELS + at[0];
            let (texels, level) = (&mut self.image.pixels[first..], self.key.level);
            if let Some(codes) = style.codes(tile, level) {
                paint_tile(texels, CHUNK_TEXELS, level, at, &codes, style.coloring);
            }
        }
        true
    }

    pub(super) fn tile_changed(&mut self, tile: (i32, i32)) {
        let tile_at = (i64::from(tile.0), i64::from(tile.1));
        if ChunkKey::of_tile(self.key.level, tile_at) == self.key && !self.left.contains(&tile) {
            self.changed.insert(tile);
        }
    }
}

impl LayerStyle<'_> {
    pub(super) fn image(&self, tile: (i32, i32), chunk: ChunkKey) -> ColorImage {
        let level = chunk.level;
        match self.codes(tile, level) {
            Some(codes) => tile_image(&codes, level, chunk.texel_of(tile), self.coloring),
            None => ColorImage::filled([level.tile_texels(); 2], self.coloring.plain(UNKNOWN)),
        }
    }

    fn codes(&self, tile: (i32, i32), level: Level) -> Option<Codes<'_>> {
        let step = level.cells_per_texel();
        let mut is_over_known = Vec::new();
        if self.coloring.lets_through() {
            is_over_known = known_below(self.below, (tile, self.indexed.cell_m), step);
        }
        Some(Codes {
            deciding: self.indexed.codes(tile, step)?,
            is_over_known,
        })
    }
}

const TIME: Duration = Duration::from_millis(4);
/// Whole textures uploaded in a frame: a mebibyte each, about a millisecond.
const UPLOADS: usize = 3;
/// Tiles that are painted even if the time is over, so that a slow machine makes progress.
const MIN_TILES: usize = 16;
/// Chunks and tiles of a frame that would otherwise be holes in the map.
const HOLES: usize = 8;
const HOLE_TILES: usize = HOLES * 64;

/// What may still be done in a frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrameTime {
    end: Monotonic,
    min_tiles: usize,
    tiles: usize,
    uploads: usize,
}

impl FrameTime {
    pub(super) fn new() -> Self {
        Self {
            end: clock::now() + TIME,
            min_tiles: MIN_TILES,
            tiles: usize::MAX,
            uploads: UPLOADS,
        }
    }

    /// For holes of all layers, whatever the clock says.
    pub(super) const fn for_holes() -> Self {
        Self {
            end: Monotonic::from_nanos(u64::MAX),
            min_tiles: 0,
            tiles: HOLE_TILES,
            uploads: HOLES,
        }
    }

    /// The share of one of `users` that have not had theirs, with at least one upload.
    pub(super) fn share(&self, users: u32) -> Self {
        let now = clock::now();
        Self {
            end: now + self.end.since(now) / users,
            min_tiles: MIN_TILES,
            tiles: self.tiles,
            uploads: self.uploads.max(1),
        }
    }

    /// Takes back what is left of a share.
    pub(super) const fn take_back(&mut self, share: Self) {
        self.tiles = share.tiles;
        self.uploads = share.uploads;
    }

    #[cfg(test)]
    pub(super) const fn of_tiles(tiles: usize) -> Self {
        Self {
            end: Monotonic::from_nanos(u64::MAX),
            min_tiles: 0,
            tiles,
            uploads: usize::MAX,
        }
    }

    /// The clock says that it is over.
    #[cfg(test)]
    pub(super) const fn over() -> Self {
        Self {
            end: Monotonic::from_nanos(0),
            min_tiles: MIN_TILES,
            tiles: usize::MAX,
            uploads: UPLOADS,
        }
    }

    pub(super) fn take_tile(&mut self) -> bool {
        let has_some = self.tiles > 0 && (self.min_tiles > 0 || clock::now() < self.end);
        self.tiles = self.tiles.saturating_sub(1);
        self.min_tiles = self.min_tiles.saturating_sub(1);
        has_some
    }

    pub(super) fn take_upload(&mut self) -> bool {
        let has_some = self.uploads > 0;
        self.uploads = self.uploads.saturating_sub(1);
        has_some
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::layer::LayerId;
    use protocol::tile::TileCells;

    use super::super::layer_compositing::deciding_codes;

    fn chunk(level: i8, tile: (i64, i64)) -> ChunkKey {
        ChunkKey::of_tile(Level(level), tile)
    }

    #[test]
    fn negative_tiles_are_in_negative_chunks() {
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
    fn position_of_a_tile_in_its_chunk() {
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
            let edges = [low_x, low_y, high_x, high_y].map(f64::to_bits);
            let expected = [tx, ty, tx + tiles, ty + tiles].map(|tile| tile as f64 * side_m);
            assert_eq!(edges, expected.map(f64::to_bits));
            assert_eq!(tiles as usize * level.tile_texels(), CHUNK_TEXELS);
        }
    }

    #[test]
    fn level_for_span() {
        for (tiles, level) in [(1, 0), (9, 0), (10, 1), (157, 5), (129, 4), (1 << 40, 6)] {
            assert_eq!(Level::for_span(tiles, 2), Level(level), "{tiles}");
        }
    }

    #[test]
    fn texels_are_at_least_a_pixel() {
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

    fn image_of(
        cells: &TileCells,
        level: Level,
        at: [usize; 2],
        coloring: &Coloring,
    ) -> ColorImage {
        let side = TILE_SIDE / level.cells_per_texel();
        let mut deciding = vec![0; side * side];
        deciding_codes(
            coloring.palette.layer(),
            cells,
            level.cells_per_texel(),
            &mut deciding,
        );
        let codes = Codes {
            deciding: Cow::Owned(deciding),
            is_over_known: Vec::new(),
        };
        tile_image(&codes, level, at, coloring)
    }

    #[test]
    fn a_wall_of_one_cell_is_visible_on_all_levels() {
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
    fn patterns_continue_across_tiles() {
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
