//! The textures of one layer: a limited number of chunks, created when they become visible and updated tile by tile.
//!
//! A few coarse chunks of the whole map, the *base*, are always kept. Missing or outdated chunks are replaced by
//! coarser or finer ones, so that a moving map has no holes.

use std::collections::{BTreeMap, BTreeSet};

use eframe::egui::epaint::Vertex;
use eframe::egui::{
    Color32, Context, Mesh, Painter, Pos2, Rect, TextureFilter, TextureHandle, TextureId,
    TextureOptions, TextureWrapMode, pos2,
};
use protocol::tile::TILE_SIDE;

use super::camera::{Camera, around};
use super::chunks::{ChunkBuilder, ChunkKey, FrameTime, LayerStyle, Level, TILE_CELLS};
use super::texture_check::Sample;

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

    /// Chooses the chunks to draw, at most `allowance`, and fills holes.
    /// `bounds_cells`: bounding box of known cells.
    pub(super) fn fill_holes(
        &mut self,
        ctx: &Context,
        style: LayerStyle<'_>,
        camera: &Camera,
        bounds_cells: Option<[i64; 4]>,
        allowance: usize,
        time: &mut FrameTime,
    ) {
        let Some(bounds_cells) = bounds_cells else {
            self.clear();
            return;
        };
        self.base = base_chunks(bounds_cells);
        let pixels_per_cell =
            style.indexed.cell_m * camera.points_per_m * f64::from(ctx.pixels_per_point());
        let level = Level::for_scale(pixels_per_cell, style.coloring.has_patterns());
        let room = allowance.saturating_sub(self.base.len()).max(1);
        self.visible = visible_chunks(level, style.indexed.cell_m, camera, bounds_cells, room);
        self.evict(style.indexed.cell_m, camera, allowance);
        let holes = outwards(self.holes(), style.indexed.cell_m, camera);
        self.make(ctx, style, holes, time);
    }

    /// Visible chunks that neither exist nor are covered by a coarser one.
    pub(super) fn holes(&self) -> Vec<ChunkKey> {
        let is_hole =
            |key: &&ChunkKey| !self.chunks.contains_key(key) && self.coarser(**key).is_none();
        self.visible.iter().filter(is_hole).copied().collect()
    }

    /// Updates chunks and creates missing ones within `time`. Returns whether all are up to date.
    pub(super) fn update(
        &mut self,
        ctx: &Context,
        style: LayerStyle<'_>,
        camera: &Camera,
        time: &mut FrameTime,
    ) -> bool {
        let mut share = time.share(2);
        self.upload_changes(style, &mut share);
        time.take_back(share);
        let lacks = |key: &&ChunkKey| self.chunks.get(key).is_none_or(|chunk| chunk.is_outdated);
        let lacking = self.visible.iter().filter(lacks).copied().collect();
        let lacking = outwards(lacking, style.indexed.cell_m, camera);
        let base = self.base.difference(&self.visible).filter(lacks).copied();
        let is_base_drawn = self.base.iter().any(|key| self.chunks.contains_key(key));
        // The base first, so that something is drawn.
        let lacking: Vec<_> = if is_base_drawn {
            lacking.into_iter().chain(base).collect()
        } else {
            base.chain(lacking).collect()
        };
        self.make(ctx, style, lacking, time) && self.is_current()
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

    /// For a missing chunk: rectangles in `odom` that do not overlap, with the part of the texture to draw.
    fn fallbacks(&self, key: ChunkKey, cell_m: f64) -> Vec<(&Chunk, [f64; 4], Rect)> {
        if let Some((whole, chunk)) = self.coarser(key) {
            return vec![(chunk, key.edges_m(cell_m), part_of(whole, key))];
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

    /// The finest of the coarser chunks that contain this one.
    fn coarser(&self, key: ChunkKey) -> Option<(ChunkKey, &Chunk)> {
        let mut coarser = std::iter::successors(key.level.coarser(), |level| level.coarser());
        coarser.find_map(|level| {
            let whole = ChunkKey::of_tile(level, key.first_tile());
            Some((whole, self.chunks.get(&whole)?))
        })
    }

    /// A tile of a visible chunk that should be drawn as the map has it; another one for each `number`.
    pub(super) fn sample(&self, style: LayerStyle<'_>, number: u64) -> Option<Sample> {
        let drawn = self.visible.iter().filter_map(|key| {
            let chunk = self.chunks.get(key)?;
            (!chunk.is_outdated && chunk.changed.is_empty()).then_some((*key, chunk))
        });
        let drawn: Vec<_> = drawn.collect();
        let (key, chunk) = *pick(&drawn, number)?;
        let side = key.level.tiles_per_chunk();
        let known: Vec<_> = style
            .indexed
            .known
            .in_square(key.first_tile(), side)
            .collect();
        // Another tile each time that it is the turn of this chunk.
        let tile = *pick(&known, (number / drawn.len() as u64).wrapping_mul(SCATTER))?;
        Some(Sample {
            layer: style.indexed.layer,
            key,
            texture: chunk.texture.id(),
            texel: key.texel_of(tile),
            expected: style.image(tile, key),
        })
    }

    pub(super) fn visible_chunks(&self) -> usize {
        self.visible.len()
    }

    /// Drops a chunk whose texture is not what was uploaded. Returns whether it had this one.
    pub(super) fn drop_chunk(&mut self, key: ChunkKey, texture: TextureId) -> bool {
        let is_it = self
            .chunks
            .get(&key)
            .is_some_and(|chunk| chunk.texture.id() == texture);
        if is_it {
            self.chunks.remove(&key);
        }
        is_it
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

    /// Creates these chunks in this order, that under way first. Returns whether all exist.
    fn make(
        &mut self,
        ctx: &Context,
        style: LayerStyle<'_>,
        mut lacking: Vec<ChunkKey>,
        time: &mut FrameTime,
    ) -> bool {
        if let Some(build) = &self.build
            && !self.is_wanted(&build.key)
        {
            self.build = None;
        }
        // Else two chunks that need several frames could replace each other for ever.
        if let Some(build) = &self.build
            && let Some(at) = lacking.iter().position(|key| *key == build.key)
        {
            lacking[..=at].rotate_right(1);
        }
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
        let lacking = visible.union(base);
        let lacking = lacking.filter(|key| !self.chunks.contains_key(key)).count();
        if lacking == 0 {
            self.chunks
                .retain(|key, chunk| !chunk.is_outdated || is_wanted(key));
        }
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

/// A large odd number.
const SCATTER: u64 = 0x9E37_79B9_7F4A_7C15;

fn pick<T>(items: &[T], number: u64) -> Option<&T> {
    let at = number.checked_rem(items.len() as u64)?;
    items.get(at as usize)
}

fn distance_squared(key: &ChunkKey, cell_m: f64, camera: &Camera) -> f64 {
    let [x_m, y_m] = camera.center_m;
    let [low_x, low_y, high_x, high_y] = key.edges_m(cell_m);
    let (dx, dy) = (0.5 * (low_x + high_x) - x_m, 0.5 * (low_y + high_y) - y_m);
    dx * dx + dy * dy
}

/// Sorts chunks from the middle of the view outwards.
fn outwards(mut keys: Vec<ChunkKey>, cell_m: f64, camera: &Camera) -> Vec<ChunkKey> {
    let distance = |key: &ChunkKey| distance_squared(key, cell_m, camera);
    keys.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    keys
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
mod tests {
    use eframe::egui::{self, RawInput, Shape, vec2};
    use protocol::layer::LayerId;
    use protocol::tile_store::TileStore;

    use super::super::coloring::Coloring;
    use super::super::layer_compositing::{IndexedLayer, TilePresence};
    use super::super::tests::publish;
    use super::*;
    use crate::test_support::store_of;

    const LAYER: LayerId = LayerId::Occupancy;
    const CELL_M: f64 = 0.1;
    const ALLOWANCE: usize = 60;

    /// Position (`None` for a whole texture) and size.
    type Upload = (Option<[usize; 2]>, [usize; 2]);

    struct Rig {
        ctx: Context,
        store: TileStore,
        known: TilePresence,
        coloring: Coloring,
        textures: TileTextures,
        camera: Camera,
    }

    fn screen() -> Rect {
        Rect::from_min_size(pos2(0.0, 0.0), vec2(800.0, 600.0))
    }

    impl Rig {
        fn new() -> Self {
            Self {
                ctx: Context::default(),
                store: store_of(&[LAYER]),
                known: TilePresence::default(),
                coloring: Coloring::new(LAYER.default_palette(), false),
                textures: TileTextures::default(),
                camera: Camera::on(screen()),
            }
        }

        fn put(&mut self, tile: (i32, i32), code: u16) {
            let key = publish(&mut self.store, LAYER, tile, |_, _| code);
            self.known.update(&self.store, key);
            self.textures.changed(tile);
        }

        /// Whether all is done after a frame with time for `tiles` tiles, and its uploads.
        fn frame_of(&mut self, tiles: usize) -> (bool, Vec<Upload>) {
            let bounds_cells = self.known.bounds_cells();
            let style = LayerStyle {
                indexed: IndexedLayer {
                    layer: LAYER,
                    cell_m: CELL_M,
                    store: &self.store,
                    known: &self.known,
                },
                coloring: &self.coloring,
                below: &[],
            };
            let (ctx, view) = (&self.ctx, &self.camera);
            let mut holes = FrameTime::of_tiles(0);
            self.textures
                .fill_holes(ctx, style, view, bounds_cells, ALLOWANCE, &mut holes);
            let mut time = FrameTime::of_tiles(tiles);
            let is_complete =
                bounds_cells.is_none() || self.textures.update(ctx, style, view, &mut time);
            let mut delta = self.ctx.tex_manager().write().take_delta();
            let mut uploads: Vec<_> = delta
                .set
                .values()
                .flatten()
                .map(|part| (part.pos, part.image.size()))
                .filter(|(at, size)| at.is_some() || *size == [512; 2])
                .collect();
            uploads.sort_unstable();
            delta.clear();
            (is_complete, uploads)
        }

        fn frame(&mut self) -> (bool, Vec<Upload>) {
            self.frame_of(usize::MAX)
        }

        fn look_at(&mut self, center_m: [f64; 2], points_per_m: f64) {
            let factor = points_per_m / self.camera.points_per_m;
            self.camera.zoom_about(screen().center(), factor);
            self.camera.center_on(center_m);
        }

        fn drawn_m(&self) -> Vec<[f64; 4]> {
            let input = RawInput {
                screen_rect: Some(screen()),
                ..RawInput::default()
            };
            let mut output = self.ctx.run_ui(input, |ui| {
                let painter = ui.ctx().layer_painter(egui::LayerId::background());
                let view = &self.camera;
                self.textures.paint(&painter, view, CELL_M, 0.5);
            });
            output.textures_delta.clear();
            let meshes = output.shapes.iter().filter_map(|shape| {
                let Shape::Mesh(mesh) = &shape.shape else {
                    return None;
                };
                Some(mesh.calc_bounds())
            });
            let pieces = meshes.map(|bounds| {
                let [low_x, low_y] = self.camera.to_odom(bounds.left_bottom());
                let [high_x, high_y] = self.camera.to_odom(bounds.right_top());
                [low_x, low_y, high_x, high_y]
            });
            pieces.collect()
        }
    }

    #[test]
    fn a_changed_tile_uploads_only_its_part() {
        let mut rig = Rig::new();
        assert_eq!(rig.frame(), (true, vec![]), "an empty map has no textures");
        rig.put((0, 0), 1);
        rig.put((-1, 0), 251);
        assert_eq!(rig.frame(), (true, vec![(None, [512, 512]); 2]));
        assert_eq!(rig.frame(), (true, vec![]));
        rig.put((1, 0), 251);
        rig.put((-1, 0), 3);
        assert_eq!(
            rig.frame(),
            (
                true,
                vec![(Some([64, 448]), [64, 64]), (Some([448, 448]), [64, 64])]
            )
        );
        assert_eq!(rig.frame(), (true, vec![]));
    }

    #[test]
    fn many_changes_recreate_a_chunk() {
        let mut rig = Rig::new();
        for index in 0..4_900 {
            rig.put((index % 70, index / 70), 251);
        }
        // 448 m on 600 points: level 3 with 64×64 tiles per chunk and 8×8 texels per tile.
        rig.look_at([224.0, 224.0], 1.25);
        // The base is one chunk of level 4.
        assert_eq!(rig.frame().1, vec![(None, [512, 512]); 5]);
        rig.put((69, 69), 1);
        let parts = vec![(Some([40, 464]), [8, 8]), (Some([276, 232]), [4, 4])];
        assert_eq!(rig.frame(), (true, parts));
        for index in 0..100 {
            rig.put((index % 10, index / 10), 1);
        }
        assert_eq!(rig.frame(), (true, vec![(None, [512, 512]); 2]));
    }

    #[test]
    fn distant_tiles_cost_little() {
        let mut rig = Rig::new();
        rig.put((0, 0), 1);
        rig.frame();
        rig.put((1000, 1000), 1);
        // The base becomes coarser and contains the new tile.
        let (is_complete, uploads) = rig.frame();
        assert!(is_complete && uploads.len() <= 2, "{uploads:?}");
        assert_eq!(rig.frame(), (true, vec![]));
        rig.look_at([6400.0, 6400.0], 40.0);
        assert_eq!(rig.frame(), (true, vec![(None, [512, 512])]));
    }

    #[test]
    fn textures_are_limited_and_recreated() {
        let mut rig = Rig::new();
        for column in 0..200 {
            rig.put((8 * column, 0), 1);
        }
        for column in 0..200 {
            rig.look_at([f64::from(column) * 51.2 + 1.0, 1.0], 40.0);
            assert!(rig.frame().0);
            assert!(rig.textures.len() <= ALLOWANCE);
        }
        assert_eq!(rig.textures.len(), ALLOWANCE);
        rig.look_at([1.0, 1.0], 40.0);
        assert!(rig.frame().1.contains(&(None, [512, 512])));
        assert_eq!(rig.frame().1, []);
    }

    #[test]
    fn missing_chunks_are_replaced_without_holes() {
        let mut rig = Rig::new();
        for index in 0..4_900 {
            rig.put((index % 70, index / 70), 251);
        }
        rig.look_at([224.0, 224.0], 1.25);
        assert!(rig.frame().0);
        // Closer, without time for new chunks.
        for (points_per_m, turn_rad) in [(9.0, 0.0), (3.0, 0.0), (1.25, 0.0), (0.4, 0.0)] {
            rig.camera.turn_up(std::f64::consts::FRAC_PI_2 + turn_rad);
            rig.look_at([200.0, 210.0], points_per_m);
            let (is_complete, uploads) = rig.frame_of(0);
            assert_eq!(uploads, []);
            let seen = rig.camera.visible_m();
            let known = [0.0, 0.0, 448.0, 448.0];
            let expected_m2 = area_m2(overlap(seen, known));
            let drawn_m = rig.drawn_m();
            // Textures are empty beyond known cells, so their drawn area there does not matter.
            let drawn_m2: f64 = drawn_m
                .iter()
                .map(|piece| area_m2(overlap(overlap(*piece, seen), known)))
                .sum();
            let part = drawn_m2 / expected_m2;
            assert!(
                (part - 1.0).abs() < 1e-3,
                "{points_per_m}: {part}, {is_complete}"
            );
        }
    }

    #[test]
    fn a_rotated_map_needs_few_more_chunks() {
        let mut rig = Rig::new();
        for index in 0..4_900 {
            rig.put((index % 70, index / 70), 251);
        }
        rig.look_at([224.0, 224.0], 10.0);
        rig.frame();
        let straight = rig.textures.visible.len();
        rig.camera.turn_up(0.7);
        rig.frame();
        let turned = rig.textures.visible.len();
        assert!(turned <= 2 * straight, "{turned} and {straight}");
    }

    #[test]
    fn recoloring_leaves_no_hole() {
        let mut rig = Rig::new();
        rig.put((0, 0), 1);
        rig.frame();
        rig.textures.recolor();
        let (is_complete, uploads) = rig.frame_of(0);
        assert_eq!((is_complete, uploads), (false, vec![]));
        assert!(!rig.drawn_m().is_empty(), "the old ones are drawn");
        assert_eq!(rig.frame(), (true, vec![(None, [512, 512])]));
    }

    #[test]
    fn a_chunk_built_over_several_frames_misses_no_change() {
        let mut rig = Rig::new();
        for index in 0..40 {
            rig.put((index % 8, index / 8), 251);
        }
        assert_eq!(rig.frame_of(25), (false, vec![]));
        rig.put((0, 0), 1);
        rig.put((7, 7), 1);
        assert_eq!(rig.frame_of(30), (false, vec![(None, [512, 512])]));
        // (0, 0) was still to be painted; (7, 7) is new.
        assert_eq!(rig.frame(), (true, vec![(Some([448, 0]), [64, 64])]));
    }

    #[test]
    fn chunks_of_several_frames_do_not_replace_each_other() {
        let mut rig = Rig::new();
        for index in 0..40 {
            rig.put((index % 8, index / 8), 251);
            rig.put((8 + index % 8, index / 8), 251);
        }
        // Each is nearer in every other frame. With the base 160 tiles are painted.
        for x_m in [40.0, 60.0, 40.0, 60.0, 40.0, 60.0, 40.0] {
            rig.look_at([x_m, 10.0], 10.0);
            rig.frame_of(25);
        }
        assert_eq!(rig.frame(), (true, vec![]));
    }

    fn overlap(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [
            a[0].max(b[0]),
            a[1].max(b[1]),
            a[2].min(b[2]),
            a[3].min(b[3]),
        ]
    }

    fn area_m2([low_x, low_y, high_x, high_y]: [f64; 4]) -> f64 {
        (high_x - low_x).max(0.0) * (high_y - low_y).max(0.0)
    }
}
