//! The tiles of one layer as textures: a bounded number of chunks, made when they are first seen, changed tile by tile.
//!
//! A few coarse chunks of the whole map, the *base*, are made first and kept. Where a finer chunk is not made yet, or
//! not made anew yet, what there is stands in for it, so that no hole opens under the hand that moves the map.

use std::collections::{BTreeMap, BTreeSet};

use eframe::egui::{
    Color32, Context, Painter, Rect, TextureFilter, TextureHandle, TextureOptions, TextureWrapMode,
    pos2,
};
use protocol::tile::TILE_SIDE;

use super::camera::{Camera, around};
use super::chunk_builder::{ChunkBuilder, LayerStyle};
use super::chunks::{ChunkKey, Level, TILE_CELLS};
use super::frame_time::FrameTime;
use super::tile_mesh::{WHOLE, corners, paint_quad, part_of};

/// The base is the finest level at which the map has this many chunks to a side at most.
const BASE_SIDE: i64 = 2;
/// Tiles of a chunk that change one by one; where more have changed, the chunk is made anew.
const MAX_CHANGED: usize = 64;

const OPTIONS: TextureOptions = TextureOptions {
    magnification: TextureFilter::Nearest,
    minification: TextureFilter::Linear,
    wrap_mode: TextureWrapMode::ClampToEdge,
    mipmap_mode: None,
};

struct Chunk {
    texture: TextureHandle,
    /// Not as the texture has them.
    changed: BTreeSet<(i32, i32)>,
    /// To be made anew.
    is_outdated: bool,
}

/// The textures of a layer.
#[derive(Default)]
pub(super) struct TileTextures {
    chunks: BTreeMap<ChunkKey, Chunk>,
    build: Option<ChunkBuilder>,
    /// On the screen, of the level that suits it.
    visible: BTreeSet<ChunkKey>,
    base: BTreeSet<ChunkKey>,
}

impl TileTextures {
    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }

    /// These tiles are not what they were.
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

    /// Every colour is another. Until they are made anew, chunks are as they were.
    pub(super) fn recolor(&mut self) {
        self.build = None;
        for chunk in self.chunks.values_mut() {
            chunk.is_outdated = true;
            chunk.changed.clear();
        }
    }

    /// Textures that are held: a mebibyte each.
    pub(super) fn len(&self) -> usize {
        self.chunks.len()
    }

    /// Makes the textures for what `camera` sees, `allowance` of them at most, as far as `time` goes; false where more
    /// is left to do. `bounds_cells` are the edges of what is known.
    pub(super) fn prepare(
        &mut self,
        ctx: &Context,
        style: LayerStyle<'_>,
        (camera, screen): (&Camera, Rect),
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
            style.cell_m * camera.points_per_m() * f64::from(ctx.pixels_per_point());
        let level = Level::for_scale(pixels_per_cell, style.coloring.has_patterns());
        let room = allowance.saturating_sub(self.base.len()).max(1);
        self.visible = visible_chunks(level, style.cell_m, camera, screen, bounds_cells, room);
        self.evict(style.cell_m, camera, allowance);
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

    /// Draws what there is, `opacity` 0 … 1.
    pub(super) fn paint(
        &self,
        painter: &Painter,
        (camera, screen): (&Camera, Rect),
        cell_m: f64,
        opacity: f32,
    ) {
        let tint = Color32::WHITE.gamma_multiply(opacity);
        for key in &self.visible {
            if let Some(chunk) = self.chunks.get(key) {
                let corners = corners(key.edges_m(cell_m), camera, screen);
                paint_quad(painter, &chunk.texture, corners, WHOLE, tint);
            } else {
                for (chunk, edges_m, part) in self.fallbacks(*key, cell_m) {
                    let corners = corners(edges_m, camera, screen);
                    paint_quad(painter, &chunk.texture, corners, part, tint);
                }
            }
        }
    }

    /// What is drawn for a chunk that is not made: pieces that do not overlap, where they are in `odom`, and which part
    /// of their texture it is.
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
            let parts: Vec<_> = self
                .chunks
                .iter()
                .filter(|(part, _)| is_part(part))
                .map(|(part, chunk)| (chunk, part.edges_m(cell_m), WHOLE))
                .collect();
            if !parts.is_empty() {
                return parts;
            }
        }
        Vec::new()
    }

    fn is_wanted(&self, key: &ChunkKey) -> bool {
        self.visible.contains(key) || self.base.contains(key)
    }

    /// Brings the tiles that changed into the chunks that are seen.
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

    /// Makes chunks that are wanted, the base first, then from the middle outwards; whether all are made.
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
            let distance = |key: &ChunkKey| distance_squared(key, style.cell_m, camera);
            distance(a).total_cmp(&distance(b))
        });
        let base = self.base.iter().filter(lacks).copied();
        let is_base_drawn = self.base.iter().any(|key| self.chunks.contains_key(key));
        // What stands in for everything comes first; once there is something, what is seen.
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

    fn finish(&mut self, ctx: &Context, mut build: ChunkBuilder) {
        let (key, changed) = (build.key, std::mem::take(&mut build.changed));
        let image = build.into_image();
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

    /// Drops what is beyond the allowance, other levels and what is far away first, and what has old colours.
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
    let [x_m, y_m] = camera.center_m();
    let [low_x, low_y, high_x, high_y] = key.edges_m(cell_m);
    let (dx, dy) = (0.5 * (low_x + high_x) - x_m, 0.5 * (low_y + high_y) - y_m);
    dx * dx + dy * dy
}

/// Tiles from the first to the last known one, in both directions.
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
    // A map that even the coarsest level does not hold has its base around its lowest corner; it is 2000 km wide.
    let end = |low: i64, high: i64| low..=high.min(low + BASE_SIDE - 1);
    end(low.x, high.x)
        .flat_map(|x| end(low.y, high.y).map(move |y| ChunkKey { level, x, y }))
        .collect()
}

/// No tile is farther out than this, whatever a pose claims.
const REACH: f64 = 2.0 * i32::MAX as f64;

/// The chunks of the map on the screen, of `level` or of the next coarser one of which there are at most `room`.
fn visible_chunks(
    level: Level,
    cell_m: f64,
    camera: &Camera,
    screen: Rect,
    bounds_cells: [i64; 4],
    room: usize,
) -> BTreeSet<ChunkKey> {
    let tile_m = TILE_SIDE as f64 * cell_m;
    let seen = camera
        .visible_m(screen)
        .map(|edge_m| (edge_m / tile_m).floor().clamp(-REACH, REACH) as i64);
    let known = tile_bounds(bounds_cells);
    let low_tile = (seen[0].max(known[0]), seen[1].max(known[1]));
    let high_tile = (seen[2].min(known[2]), seen[3].min(known[3]));
    if low_tile.0 > high_tile.0 || low_tile.1 > high_tile.1 {
        return BTreeSet::new();
    }
    let is_seen = |key: &ChunkKey| {
        let corners = corners(key.edges_m(cell_m), camera, screen);
        let points = corners.map(|corner| [f64::from(corner.x), f64::from(corner.y)]);
        let [left, top, right, bottom] = around(&points).map(|edge| edge as f32);
        Rect::from_min_max(pos2(left, top), pos2(right, bottom)).intersects(screen)
    };
    let mut level = level;
    loop {
        let low = ChunkKey::of_tile(level, low_tile);
        let high = ChunkKey::of_tile(level, high_tile);
        let count = (high.x - low.x + 1).saturating_mul(high.y - low.y + 1);
        let coarser = level.coarser();
        // Of a map that is turned, a third of what is counted may be out of sight.
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

#[cfg(test)]
mod tests;
