//! Tiles as textures: a bounded number of chunks, built when first seen, changed tile by tile.

use std::collections::{BTreeMap, BTreeSet};

use eframe::egui::{
    Color32, ColorImage, Context, Mesh, Painter, Rect, TextureFilter, TextureHandle,
    TextureOptions, TextureWrapMode, pos2,
};
use protocol::layer::LayerId;
use protocol::tile::{TILE_SIDE, TileKey};
use protocol::tile_store::TileStore;

use super::camera::Camera;
use super::chunks::{CHUNK_TEXELS, ChunkKey, Level, tile_image};
use super::coloring::Coloring;
use super::known_tiles::KnownTiles;

/// One mebibyte each.
const MAX_CHUNKS: usize = 96;
/// Chunks to each side of the middle of the screen; a screen of 8,000 pixels has fewer.
const MAX_REACH: i64 = 8;
/// Tiles that are turned into colours in a frame, about 5 ms; the rest waits for the next frame.
const MAX_TILES_A_FRAME: usize = 1_024;

const OPTIONS: TextureOptions = TextureOptions {
    magnification: TextureFilter::Nearest,
    minification: TextureFilter::Linear,
    wrap_mode: TextureWrapMode::ClampToEdge,
    mipmap_mode: None,
};

/// A layer as it is to be drawn.
pub(super) struct LayerLook<'a> {
    pub(super) layer: LayerId,
    pub(super) cell_m: f64,
    pub(super) store: &'a TileStore,
    pub(super) known: &'a KnownTiles,
    pub(super) coloring: &'a Coloring,
}

/// The textures of the shown layer in its colours.
#[derive(Default)]
pub(super) struct TileTextures {
    chunks: BTreeMap<ChunkKey, TextureHandle>,
    /// Changed since they were last turned into colours.
    dirty: BTreeSet<(i32, i32)>,
    level: Option<Level>,
    /// Whether every chunk that is seen and known has its texture.
    is_complete: bool,
}

impl TileTextures {
    /// Forgets everything: another layer or other colours.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }

    /// These tiles are not what they were.
    pub(super) fn changed(&mut self, tile: (i32, i32)) {
        // What no texture shows need not be remembered.
        if self.is_shown(tile) {
            self.dirty.insert(tile);
        }
    }

    /// Textures that are held.
    #[cfg(test)]
    fn len(&self) -> usize {
        self.chunks.len()
    }

    /// Makes the textures for what `camera` sees, as far as one frame's time goes; false where more is left.
    pub(super) fn prepare(
        &mut self,
        ctx: &Context,
        look: &LayerLook<'_>,
        camera: &Camera,
        screen: Rect,
    ) -> bool {
        let pixels_per_cell =
            look.cell_m * camera.points_per_m() * f64::from(ctx.pixels_per_point());
        let level = Level::for_scale(pixels_per_cell, look.coloring.has_patterns());
        self.level = Some(level);
        let visible = visible_chunks(level, look.cell_m, camera, screen);
        let mut left = MAX_TILES_A_FRAME;
        self.upload_changes(look, &visible, &mut left);
        self.is_complete = self.build_visible(ctx, look, &visible, &mut left);
        self.drop_farthest(look.cell_m, camera);
        self.is_complete && self.dirty.is_empty()
    }

    /// Draws what is there. Chunks of other levels stand in while some of the right level are missing.
    pub(super) fn paint(&self, painter: &Painter, camera: &Camera, screen: Rect, cell_m: f64) {
        let is_right = |key: &ChunkKey| Some(key.level) == self.level;
        let stand_ins = self.chunks.iter().rev().filter(|(key, _)| !is_right(key));
        let right = self.chunks.iter().filter(|(key, _)| is_right(key));
        for (key, texture) in stand_ins.filter(|_| !self.is_complete).chain(right) {
            let [low_x, low_y, high_x, high_y] = key.edges_m(cell_m);
            let rect = Rect::from_min_max(
                camera.to_screen(screen, [low_x, high_y]),
                camera.to_screen(screen, [high_x, low_y]),
            );
            if rect.intersects(screen) {
                let mut mesh = Mesh::with_texture(texture.id());
                let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
                mesh.add_rect_with_uv(rect, whole, Color32::WHITE);
                painter.add(mesh);
            }
        }
    }

    fn is_shown(&self, (tx, ty): (i32, i32)) -> bool {
        Level::all().any(|level| {
            let chunk = ChunkKey::of_tile(level, (i64::from(tx), i64::from(ty)));
            self.chunks.contains_key(&chunk)
        })
    }

    /// Brings the tiles that changed into the chunks that are seen, and drops those chunks that are not.
    fn upload_changes(
        &mut self,
        look: &LayerLook<'_>,
        visible: &BTreeSet<ChunkKey>,
        left: &mut usize,
    ) {
        while *left > 0
            && let Some(tile) = self.dirty.pop_first()
        {
            for level in Level::all() {
                let chunk = ChunkKey::of_tile(level, (i64::from(tile.0), i64::from(tile.1)));
                if !visible.contains(&chunk) {
                    self.chunks.remove(&chunk);
                } else if let Some(texture) = self.chunks.get_mut(&chunk) {
                    *left = left.saturating_sub(level.tile_cost());
                    texture.set_partial(chunk.texel_of(tile), look.image(tile, chunk), OPTIONS);
                }
            }
        }
    }

    /// Builds chunks that are seen and known; whether all of them are there.
    fn build_visible(
        &mut self,
        ctx: &Context,
        look: &LayerLook<'_>,
        visible: &BTreeSet<ChunkKey>,
        left: &mut usize,
    ) -> bool {
        let mut is_complete = true;
        for chunk in visible {
            if self.chunks.contains_key(chunk) {
                continue;
            }
            let side = chunk.level.tiles_per_chunk();
            let tiles: Vec<_> = look.known.in_square(chunk.first_tile(), side).collect();
            if tiles.is_empty() {
                continue;
            }
            if *left == 0 {
                is_complete = false;
                continue;
            }
            // One chunk may be more than a frame's worth, but it is built in one go.
            *left = left.saturating_sub(tiles.len() * chunk.level.tile_cost());
            let image = chunk_image(*chunk, look, &tiles);
            let texture = ctx.load_texture("map", image, OPTIONS);
            self.chunks.insert(*chunk, texture);
        }
        is_complete
    }

    fn drop_farthest(&mut self, cell_m: f64, camera: &Camera) {
        let excess = self.chunks.len().saturating_sub(MAX_CHUNKS);
        if excess == 0 {
            return;
        }
        let [x_m, y_m] = camera.center_m();
        let distance = |key: &ChunkKey| {
            let [low_x, low_y, high_x, high_y] = key.edges_m(cell_m);
            let (dx, dy) = (0.5 * (low_x + high_x) - x_m, 0.5 * (low_y + high_y) - y_m);
            dx * dx + dy * dy
        };
        let mut keys: Vec<_> = self.chunks.keys().copied().collect();
        let is_other = |key: &ChunkKey| Some(key.level) != self.level;
        keys.sort_by(|a, b| {
            let by_distance = distance(b).total_cmp(&distance(a));
            is_other(b).cmp(&is_other(a)).then(by_distance)
        });
        for key in keys.into_iter().take(excess) {
            self.chunks.remove(&key);
        }
    }
}

impl LayerLook<'_> {
    /// A tile's part of a chunk.
    fn image(&self, (tx, ty): (i32, i32), chunk: ChunkKey) -> ColorImage {
        let layer = self.layer;
        let level = chunk.level;
        let stored = self.store.get(TileKey { layer, tx, ty });
        match stored.and_then(|stored| stored.cells()) {
            Some(cells) => tile_image(cells, level, chunk.texel_of((tx, ty)), self.coloring),
            None => ColorImage::filled([level.tile_texels(); 2], self.coloring.unknown()),
        }
    }
}

fn chunk_image(chunk: ChunkKey, look: &LayerLook<'_>, tiles: &[(i32, i32)]) -> ColorImage {
    let mut image = ColorImage::filled([CHUNK_TEXELS; 2], look.coloring.unknown());
    for tile in tiles {
        let part = look.image(*tile, chunk);
        let [column, row] = chunk.texel_of(*tile);
        let rows = image.pixels.chunks_exact_mut(CHUNK_TEXELS).skip(row);
        for (to, from) in rows.zip(part.pixels.chunks_exact(part.width())) {
            to[column..][..from.len()].copy_from_slice(from);
        }
    }
    image
}

/// No tile is farther out than this, whatever a pose claims.
const REACH: f64 = 2.0 * i32::MAX as f64;

/// The chunks on the screen, those around its middle where they are too many.
fn visible_chunks(level: Level, cell_m: f64, camera: &Camera, screen: Rect) -> BTreeSet<ChunkKey> {
    let tile_m = TILE_SIDE as f64 * cell_m;
    let [low_x, low_y, high_x, high_y] = camera
        .visible_m(screen)
        .map(|edge_m| (edge_m / tile_m).floor().clamp(-REACH, REACH) as i64);
    let low = ChunkKey::of_tile(level, (low_x, low_y));
    let high = ChunkKey::of_tile(level, (high_x, high_y));
    let narrowed = |low: i64, high: i64| {
        let middle = low + (high - low) / 2;
        low.max(middle - MAX_REACH)..=high.min(middle + MAX_REACH)
    };
    narrowed(low.x, high.x)
        .flat_map(|x| narrowed(low.y, high.y).map(move |y| ChunkKey { level, x, y }))
        .collect()
}

#[cfg(test)]
mod tests;
