//! The textures of one layer: a limited number of chunks, created when they become visible and updated tile by tile.
//!
//! A few coarse chunks of the whole map, the *base*, are always kept. Missing or outdated chunks are replaced by
//! coarser or finer ones, so that a moving map has no holes.

use std::collections::{BTreeMap, BTreeSet};

use eframe::egui::epaint::Vertex;
use eframe::egui::{
    Color32, Context, Mesh, Painter, Pos2, Rect, TextureFilter, TextureHandle, TextureOptions,
    TextureWrapMode, pos2,
};
use protocol::tile::TILE_SIDE;

use super::camera::{Camera, around};
use super::chunks::{ChunkBuilder, ChunkKey, FrameTime, LayerStyle, Level, TILE_CELLS};

/// The base is the finest level with at most this number of chunks per side.
const BASE_SIDE: i64 = 2;
/// If more tiles of a chunk have changed, the chunk is recreated.
const MAX_CHANGED: usize = 64;

const OPTIONS: TextureOptions = TextureOptions {
    magnification: TextureFilter::Nearest,
    minification: TextureFilter::Linear,
    wrap_mode: TextureWrapMode::ClampToEdge,
    mipmap_mode: None,
};

struct Chunk {
    texture: TextureHandle,
    /// Tiles that differ from the texture.
    changed: BTreeSet<(i32, i32)>,
    /// To be recreated.
    is_outdated: bool,
}

#[derive(Default)]
pub(super) struct TileTextures {
    chunks: BTreeMap<ChunkKey, Chunk>,
    build: Option<ChunkBuilder>,
    visible: BTreeSet<ChunkKey>,
    base: BTreeSet<ChunkKey>,
}

impl TileTextures {
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }

    pub(super) fn changed(&mut self, tile: (i32, i32)) {
        for level in Level::all() {
            let key = ChunkKey::of_tile(level, (i64::from(tile.0), i64::from(tile.1)));
            if let Some(chunk) = self.chunks.get_mut(&key)
                && !chunk.is_outdated
            {
                chunk.change(tile);
            }
        }
        if let Some(build) = &mut self.build {
            build.tile_changed(tile);
        }
    }

    /// Marks all chunks as outdated, after a change of colours.
    pub(super) fn recolor(&mut self) {
        self.build = None;
        for chunk in self.chunks.values_mut() {
            chunk.is_outdated = true;
            chunk.changed.clear();
        }
    }

    pub(super) fn len(&self) -> usize {
        self.chunks.len()
    }

    /// Creates textures for the visible map within `time`, at most `allowance`. Returns whether all are up to date.
    /// `bounds_cells`: bounding box of known cells.
    pub(super) fn prepare(
        &mut self,
        ctx: &Context,
        style: LayerStyle<'_>,
        camera: &Camera,
        bounds_cells: Option<[i64; 4]>,
        allowance: usize,
        time: &mut FrameTime,
    ) -> bool {
        let Some(bounds_cells) = bounds_cells else {
            self.clear();
            return true;
        };
        self.base = base_chunks(bounds_cells);
        let pixels_per_cell =
            style.indexed.cell_m * camera.points_per_m * f64::from(ctx.pixels_per_point());
        let level = Level::for_scale(pixels_per_cell, style.coloring.has_patterns());
        let room = allowance.saturating_sub(self.base.len()).max(1);
        self.visible = visible_chunks(level, style.indexed.cell_m, camera, bounds_cells, room);
        self.evict(style.indexed.cell_m, camera, allowance);
        self.upload_changes(style, time);
        self.make(ctx, style, camera, time) && self.is_current()
    }

    fn is_current(&self) -> bool {
        let mut wanted = self.visible.iter().chain(&self.base);
        wanted.all(|key| {
            let chunk = self.chunks.get(key);
            chunk.is_none_or(|chunk| !chunk.is_outdated && chunk.changed.is_empty())
        })
    }

    pub(super) fn paint(&self, painter: &Painter, camera: &Camera, cell_m: f64, opacity: f32) {
        let tint = Color32::WHITE.gamma_multiply(opacity);
        for key in &self.visible {
            let pieces = match self.chunks.get(key) {
                Some(chunk) => vec![(chunk, key.edges_m(cell_m), WHOLE)],
                None => self.fallbacks(*key, cell_m),
            };
            for (chunk, edges_m, part) in pieces {
                let corners = corners(edges_m, camera);
                paint_quad(painter, &chunk.texture, corners, part, tint);
            }
        }
    }

    /// Replacements of a missing chunk: rectangles in `odom` that do not overlap, with the part of the texture to
    /// draw.
    fn fallbacks(&self, key: ChunkKey, cell_m: f64) -> Vec<(&Chunk, [f64; 4], Rect)> {
        let coarser = std::iter::successors(key.level.coarser(), |level| level.coarser());
        for level in coarser {
            let whole = ChunkKey::of_tile(level, key.first_tile());
            if let Some(chunk) = self.chunks.get(&whole) {
                return vec![(chunk, key.edges_m(cell_m), part_of(whole, key))];
            }
        }
        let finer = std::iter::successors(key.level.finer(), |level| level.finer());
        for level in finer {
            let is_part = |part: &ChunkKey| {
                part.level == level && ChunkKey::of_tile(key.level, part.first_tile()) == key
            };
            let parts = self.chunks.iter().filter(|(part, _)| is_part(part));
            let parts = parts.map(|(part, chunk)| (chunk, part.edges_m(cell_m), WHOLE));
            let parts: Vec<_> = parts.collect();
            if !parts.is_empty() {
                return parts;
            }
        }
        Vec::new()
    }

    fn is_wanted(&self, key: &ChunkKey) -> bool {
        self.visible.contains(key) || self.base.contains(key)
    }

    /// Uploads changed tiles of visible chunks.
    fn upload_changes(&mut self, style: LayerStyle<'_>, time: &mut FrameTime) {
        for key in self.visible.iter().chain(&self.base) {
            let Some(chunk) = self.chunks.get_mut(key) else {
                continue;
            };
            while let Some(tile) = chunk.changed.first().copied() {
                if !time.take_tile() {
                    return;
                }
                chunk.changed.remove(&tile);
                let image = style.image(tile, *key);
                chunk
                    .texture
                    .set_partial(key.texel_of(tile), image, OPTIONS);
            }
        }
    }

    /// Creates missing chunks, base first, then from the middle outwards. Returns whether all exist.
    fn make(
        &mut self,
        ctx: &Context,
        style: LayerStyle<'_>,
        camera: &Camera,
        time: &mut FrameTime,
    ) -> bool {
        if let Some(build) = &self.build
            && !self.is_wanted(&build.key)
        {
            self.build = None;
        }
        let lacks = |key: &&ChunkKey| self.chunks.get(key).is_none_or(|chunk| chunk.is_outdated);
        let mut lacking: Vec<_> = self.visible.iter().filter(lacks).copied().collect();
        lacking.sort_by(|a, b| {
            let distance = |key: &ChunkKey| distance_squared(key, style.indexed.cell_m, camera);
            distance(a).total_cmp(&distance(b))
        });
        let base = self.base.iter().filter(lacks).copied();
        let is_base_drawn = self.base.iter().any(|key| self.chunks.contains_key(key));
        // The base first, so that something is drawn.
        let lacking: Vec<_> = if is_base_drawn {
            lacking.into_iter().chain(base).collect()
        } else {
            base.chain(lacking).collect()
        };
        for key in lacking {
            let under_way = self.build.take_if(|build| build.key == key);
            let Some(mut build) = under_way.or_else(|| ChunkBuilder::begin(key, style)) else {
                self.chunks.remove(&key);
                continue;
            };
            if !build.advance(style, time) || !time.take_upload() {
                self.build = Some(build);
                return false;
            }
            self.finish(ctx, build);
        }
        true
    }

    fn finish(&mut self, ctx: &Context, build: ChunkBuilder) {
        let ChunkBuilder {
            key,
            image,
            changed,
            ..
        } = build;
        let mut chunk = match self.chunks.remove(&key) {
            Some(mut chunk) => {
                chunk.texture.set(image, OPTIONS);
                chunk
            }
            None => Chunk {
                texture: ctx.load_texture("map", image, OPTIONS),
                changed: BTreeSet::new(),
                is_outdated: false,
            },
        };
        chunk.is_outdated = false;
        chunk.changed.clear();
        for tile in changed {
            chunk.change(tile);
        }
        self.chunks.insert(key, chunk);
    }

    /// Drops chunks beyond the allowance: outdated, other levels and distant ones first.
    fn evict(&mut self, cell_m: f64, camera: &Camera, allowance: usize) {
        let (visible, base) = (&self.visible, &self.base);
        let is_wanted = |key: &ChunkKey| visible.contains(key) || base.contains(key);
        self.chunks
            .retain(|key, chunk| !chunk.is_outdated || is_wanted(key));
        let lacking = visible.union(base);
        let lacking = lacking.filter(|key| !self.chunks.contains_key(key)).count();
        let excess = (self.chunks.len() + lacking).saturating_sub(allowance);
        if excess == 0 {
            return;
        }
        let level = visible.first().map(|key| key.level);
        let mut unseen: Vec<_> = self.chunks.keys().copied().collect();
        unseen.retain(|key| !is_wanted(key));
        unseen.sort_by(|a, b| {
            let is_other = |key: &ChunkKey| Some(key.level) != level;
            let distance = |key: &ChunkKey| distance_squared(key, cell_m, camera);
            let by_distance = distance(b).total_cmp(&distance(a));
            is_other(b).cmp(&is_other(a)).then(by_distance)
        });
        for key in unseen.into_iter().take(excess) {
            self.chunks.remove(&key);
        }
    }
}

impl Chunk {
    fn change(&mut self, tile: (i32, i32)) {
        self.changed.insert(tile);
        if self.changed.len() > MAX_CHANGED {
            self.changed.clear();
            self.is_outdated = true;
        }
    }
}

fn distance_squared(key: &ChunkKey, cell_m: f64, camera: &Camera) -> f64 {
    let [x_m, y_m] = camera.center_m;
    let [low_x, low_y, high_x, high_y] = key.edges_m(cell_m);
    let (dx, dy) = (0.5 * (low_x + high_x) - x_m, 0.5 * (low_y + high_y) - y_m);
    dx * dx + dy * dy
}

fn tile_bounds([low_x, low_y, high_x, high_y]: [i64; 4]) -> [i64; 4] {
    [low_x, low_y, high_x - 1, high_y - 1].map(|cell| cell.div_euclid(TILE_CELLS))
}

fn base_chunks(bounds_cells: [i64; 4]) -> BTreeSet<ChunkKey> {
    let [low_x, low_y, high_x, high_y] = tile_bounds(bounds_cells);
    let span = (high_x - low_x).max(high_y - low_y) + 1;
    let level = Level::for_span(span, BASE_SIDE);
    let (low, high) = (
        ChunkKey::of_tile(level, (low_x, low_y)),
        ChunkKey::of_tile(level, (high_x, high_y)),
    );
    // For maps beyond the coarsest level (2000 km), the base is at their lowest corner.
    let end = |low: i64, high: i64| low..=high.min(low + BASE_SIDE - 1);
    end(low.x, high.x)
        .flat_map(|x| end(low.y, high.y).map(move |y| ChunkKey { level, x, y }))
        .collect()
}

const REACH: f64 = 2.0 * i32::MAX as f64;

/// Visible chunks of `level`, or of the next coarser level with at most `room` chunks.
fn visible_chunks(
    level: Level,
    cell_m: f64,
    camera: &Camera,
    bounds_cells: [i64; 4],
    room: usize,
) -> BTreeSet<ChunkKey> {
    let tile_m = TILE_SIDE as f64 * cell_m;
    let seen = camera
        .visible_m()
        .map(|edge_m| (edge_m / tile_m).floor().clamp(-REACH, REACH) as i64);
    let known = tile_bounds(bounds_cells);
    let low_tile = (seen[0].max(known[0]), seen[1].max(known[1]));
    let high_tile = (seen[2].min(known[2]), seen[3].min(known[3]));
    if low_tile.0 > high_tile.0 || low_tile.1 > high_tile.1 {
        return BTreeSet::new();
    }
    let is_seen = |key: &ChunkKey| {
        let corners = corners(key.edges_m(cell_m), camera);
        let points = corners.map(|corner| [f64::from(corner.x), f64::from(corner.y)]);
        let [left, top, right, bottom] = around(&points).map(|edge| edge as f32);
        Rect::from_min_max(pos2(left, top), pos2(right, bottom)).intersects(camera.screen)
    };
    let mut level = level;
    loop {
        let low = ChunkKey::of_tile(level, low_tile);
        let high = ChunkKey::of_tile(level, high_tile);
        let count = (high.x - low.x + 1).saturating_mul(high.y - low.y + 1);
        let coarser = level.coarser();
        // Up to a third of the counted chunks of a rotated map may be invisible.
        if usize::try_from(count).is_ok_and(|count| count <= 2 * room) || coarser.is_none() {
            let keys = (low.x..=high.x)
                .flat_map(|x| (low.y..=high.y).map(move |y| ChunkKey { level, x, y }))
                .take(4 * room);
            let keys: BTreeSet<_> = keys.filter(is_seen).collect();
            if keys.len() <= room || coarser.is_none() {
                return keys;
            }
        }
        level = coarser.unwrap_or(level);
    }
}

const WHOLE: Rect = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));

/// The part of the texture of `whole` that shows `part`.
fn part_of(whole: ChunkKey, part: ChunkKey) -> Rect {
    let ((left, bottom), (x, y)) = (whole.first_tile(), part.first_tile());
    let side = whole.level.tiles_per_chunk() as f32;
    let part_side = part.level.tiles_per_chunk() as f32;
    let (from_left, from_bottom) = ((x - left) as f32, (y - bottom) as f32);
    Rect::from_min_max(
        pos2(from_left / side, 1.0 - (from_bottom + part_side) / side),
        pos2((from_left + part_side) / side, 1.0 - from_bottom / side),
    )
}

fn corners([low_x, low_y, high_x, high_y]: [f64; 4], camera: &Camera) -> [Pos2; 4] {
    [
        [low_x, high_y],
        [high_x, high_y],
        [high_x, low_y],
        [low_x, low_y],
    ]
    .map(|corner_m| camera.to_screen(corner_m))
}

fn paint_quad(
    painter: &Painter,
    texture: &TextureHandle,
    corners: [Pos2; 4],
    part: Rect,
    color: Color32,
) {
    let mut mesh = Mesh::with_texture(texture.id());
    let uvs = [
        part.left_top(),
        part.right_top(),
        part.right_bottom(),
        part.left_bottom(),
    ];
    let vertex = |(pos, uv)| Vertex { pos, uv, color };
    mesh.vertices = corners.into_iter().zip(uvs).map(vertex).collect();
    mesh.indices = vec![0, 1, 2, 0, 2, 3];
    painter.add(mesh);
}

#[cfg(test)]
mod tests;
