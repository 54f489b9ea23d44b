//! The drawn layers of a robot: known tiles, colours and textures.

use std::collections::{BTreeMap, BTreeSet};

use eframe::egui::{Context, Painter, TextureId};
use protocol::layer::{LayerId, Palette};
use protocol::tile::TileKey;
use protocol::tile_store::{StoredTile, TileStore};

use super::camera::{Camera, around};
use super::chunks::{ChunkKey, FrameTime, LayerStyle};
use super::coloring::{Coloring, fitted_to, palette_of};
use super::contour_lines::ContourLines;
use super::layer_compositing::{IndexedLayer, TilePresence, tiles_above};
use super::texture_check::Sample;
use super::tile_textures::TileTextures;
use super::view_settings::{LayerStack, StackLayer};
use crate::model::{AgeOrder, MapSync};

/// For all layers, a mebibyte each.
pub(super) const MAX_TEXTURES: usize = 192;

struct MapLayer {
    known: TilePresence,
    coloring: Coloring,
    /// Visible layers below it, with their cell sizes, m.
    below: Vec<(LayerId, f64)>,
    textures: TileTextures,
    /// Number of known tiles when the colours were fitted.
    fitted_at: usize,
    newest: Option<(TileKey, AgeOrder)>,
}

#[derive(Default)]
pub(super) struct MapLayers {
    layers: BTreeMap<LayerId, MapLayer>,
    waiting: BTreeSet<TileKey>,
    contours: ContourLines,
    is_other: bool,
}

impl MapLayer {
    fn new(layer: LayerId) -> Self {
        Self {
            known: TilePresence::default(),
            coloring: Coloring::new(layer.default_palette(), false),
            below: Vec::new(),
            textures: TileTextures::default(),
            fitted_at: 0,
            newest: None,
        }
    }

    fn update_newest(&mut self, map: &MapSync, key: TileKey) {
        let (store, ages) = (map.store(), map.ages());
        let is_known = |stored: &StoredTile| stored.cells().is_some();
        let order = ages.order(key);
        let order = order.filter(|_| store.get(key).is_some_and(is_known));
        match (self.newest, order) {
            (None, order) => self.newest = order.map(|order| (key, order)),
            (Some((_, newest)), Some(order)) if order >= newest => self.newest = Some((key, order)),
            (Some((newest, _)), _) if newest == key => self.find_newest(map, key.layer),
            (Some(_), _) => {}
        }
    }

    fn find_newest(&mut self, map: &MapSync, layer: LayerId) {
        let held = map.store().tiles(layer);
        let held = held.filter(|(_, stored)| stored.cells().is_some());
        let orders = held.filter_map(|(key, _)| Some((key, map.ages().order(key)?)));
        self.newest = orders.max_by_key(|(_, order)| *order);
    }

    /// A tile may turn out to be older when the data starts again.
    fn recheck_newest(&mut self, map: &MapSync) {
        if let Some((key, order)) = self.newest
            && map.ages().order(key) < Some(order)
        {
            self.find_newest(map, key.layer);
        }
    }

    fn recolor(&mut self, coloring: Coloring) {
        self.coloring = coloring;
        self.textures.recolor();
    }

    fn set_below(&mut self, below: Vec<(LayerId, f64)>) {
        if self.below != below {
            self.below = below;
            if self.coloring.lets_through() {
                self.textures.recolor();
            }
        }
    }

    fn fit(&mut self, store: &TileStore) {
        let fitted = fitted_to(self.coloring.palette, store);
        self.fitted_at = self.known.len();
        if fitted != self.coloring.palette {
            self.recolor(Coloring::new(fitted, self.coloring.is_over));
        }
    }
}

impl MapLayers {
    pub(super) fn forget(&mut self) {
        *self = Self {
            is_other: true,
            ..Self::default()
        };
    }

    /// Drawn layers, lowest first, with whether each is above another.
    pub(super) fn shown(stack: &LayerStack, store: &TileStore) -> Vec<(StackLayer, bool)> {
        let is_drawn = |held: &&StackLayer| held.is_shown && store.cell_m(held.layer).is_some();
        let drawn = stack.layers().iter().filter(is_drawn);
        drawn
            .zip(0..)
            .map(|(held, under)| (*held, under > 0))
            .collect()
    }

    pub(super) fn palette(&self, layer: LayerId) -> Palette {
        let held = self.layers.get(&layer);
        held.map_or_else(|| layer.default_palette(), |held| held.coloring.palette)
    }

    pub(super) fn tiles(&self, layer: LayerId) -> usize {
        self.layers.get(&layer).map_or(0, |held| held.known.len())
    }

    pub(super) fn newest(&self, layer: LayerId) -> Option<TileKey> {
        let newest = self.layers.get(&layer)?.newest;
        newest.map(|(key, _)| key)
    }

    pub(super) fn textures(&self) -> usize {
        self.layers.values().map(|held| held.textures.len()).sum()
    }

    /// Processes changed tiles within `time`. Returns whether all are processed.
    pub(super) fn update(
        &mut self,
        map: &MapSync,
        changed: BTreeSet<TileKey>,
        stack: &LayerStack,
        time: &mut FrameTime,
    ) -> bool {
        let store = map.store();
        self.waiting.extend(changed);
        if std::mem::take(&mut self.is_other) {
            let all = LayerId::ALL
                .into_iter()
                .flat_map(|layer| store.all_shown(layer));
            self.waiting.extend(all.map(|(key, _)| key));
        }
        while !self.waiting.is_empty() && time.take_tile() {
            let Some(key) = self.waiting.pop_first() else {
                break;
            };
            let held = self.layers.entry(key.layer);
            let held = held.or_insert_with(|| MapLayer::new(key.layer));
            let is_known_elsewhere = held.known.update(store, key);
            held.textures.changed((key.tx, key.ty));
            held.update_newest(map, key);
            self.contours.change(key);
            if is_known_elsewhere {
                self.change_above(key, store);
            }
        }
        for held in self.layers.values_mut() {
            held.recheck_newest(map);
        }
        self.color(stack, store);
        self.contours.update(store, time) && self.waiting.is_empty()
    }

    fn change_above(&mut self, key: TileKey, store: &TileStore) {
        for (layer, held) in &mut self.layers {
            let mut below = held.below.iter();
            let below = below.find(|(below, _)| *below == key.layer);
            let (Some((_, below_m)), Some(cell_m)) = (below, store.cell_m(*layer)) else {
                continue;
            };
            if !held.coloring.lets_through() {
                continue;
            }
            match tiles_above((key.tx, key.ty), below_m / cell_m) {
                Some((first, side)) => {
                    for tile in held.known.in_square(first, side) {
                        held.textures.changed(tile);
                    }
                }
                None => held.textures.recolor(),
            }
        }
    }

    pub(super) fn fit_colors(&mut self, layer: LayerId, store: &TileStore) {
        if let Some(held) = self.layers.get_mut(&layer) {
            held.fit(store);
        }
    }

    fn color(&mut self, stack: &LayerStack, store: &TileStore) {
        let shown = Self::shown(stack, store);
        for (layer, held) in &mut self.layers {
            let Some((wanted, is_over)) = shown.iter().find(|(one, _)| one.layer == *layer) else {
                held.textures.clear();
                continue;
            };
            let palette = held.coloring.palette;
            if palette.scheme() != wanted.scheme {
                held.fitted_at = 0;
                held.recolor(Coloring::new(palette_of(*layer, wanted.scheme), *is_over));
            } else if held.coloring.is_over != *is_over {
                held.recolor(Coloring::new(palette, *is_over));
            }
            held.set_below(seen_below(*layer, &shown, store));
            // The range of values is unknown in advance. It is fitted each time the map has doubled, so that colours
            // rarely change their meaning, and only when all waiting tiles are processed.
            let has_grown = held.known.len() >= 2 * held.fitted_at.max(1);
            if wanted.scheme.is_fitted() && has_grown && self.waiting.is_empty() {
                held.fit(store);
            }
        }
    }

    pub(super) fn bounds_m(&mut self, stack: &LayerStack, store: &TileStore) -> Option<[f64; 4]> {
        let shown = Self::shown(stack, store);
        let edges = shown.iter().filter_map(|(held, _)| {
            let cell_m = store.cell_m(held.layer)?;
            let bounds_cells = self.layers.get_mut(&held.layer)?.known.bounds_cells()?;
            Some(bounds_cells.map(|cell| cell as f64 * cell_m))
        });
        edges.reduce(|a, b| around(&[[a[0], a[1]], [a[2], a[3]], [b[0], b[1]], [b[2], b[3]]]))
    }

    /// Updates textures: holes of all layers within `holes`, then the rest within `time`, of which each layer has its
    /// share. Returns whether all are up to date.
    pub(super) fn prepare(
        &mut self,
        ctx: &Context,
        stack: &LayerStack,
        store: &TileStore,
        camera: &Camera,
        holes: &mut FrameTime,
        time: &mut FrameTime,
    ) -> bool {
        let shown = Self::shown(stack, store);
        let shown = || shown.iter().map(|(held, _)| held.layer);
        let allowance = MAX_TEXTURES / shown().count().max(1);
        for layer in shown() {
            let held = self.layers.get_mut(&layer);
            let bounds_cells = held.and_then(|held| held.known.bounds_cells());
            self.with_textures(layer, store, |textures, style| {
                textures.fill_holes(ctx, style, camera, bounds_cells, allowance, holes);
            });
        }
        let mut is_complete = true;
        for (layer, users) in shown().zip((1..=shown().count() as u32).rev()) {
            let mut share = time.share(users);
            let is_current = self.with_textures(layer, store, |textures, style| {
                textures.update(ctx, style, camera, &mut share)
            });
            time.take_back(share);
            is_complete &= is_current.unwrap_or(true);
        }
        is_complete
    }

    /// A tile of a drawn layer that should be drawn as the map has it; another one for each `number`.
    pub(super) fn sample(
        &mut self,
        stack: &LayerStack,
        store: &TileStore,
        number: u64,
    ) -> Option<Sample> {
        if !self.waiting.is_empty() {
            return None;
        }
        let shown = Self::shown(stack, store);
        let layers = shown.len() as u64;
        let (held, _) = shown.get(number.checked_rem(layers)? as usize)?;
        self.with_textures(held.layer, store, |textures, style| {
            textures.sample(style, number / layers)
        })?
    }

    /// After so many samples with consecutive numbers there was one of each visible chunk.
    pub(super) fn chunks_to_check(&self, stack: &LayerStack, store: &TileStore) -> u64 {
        let shown = Self::shown(stack, store);
        let chunks = shown.iter().filter_map(|(held, _)| {
            let held = self.layers.get(&held.layer)?;
            Some(held.textures.visible_chunks())
        });
        (shown.len() * chunks.max().unwrap_or_default()) as u64
    }

    /// Drops a chunk whose texture is not what was uploaded. Returns whether it had this one.
    pub(super) fn drop_chunk(&mut self, layer: LayerId, key: ChunkKey, texture: TextureId) -> bool {
        let held = self.layers.get_mut(&layer);
        held.is_some_and(|held| held.textures.drop_chunk(key, texture))
    }

    fn with_textures<T>(
        &mut self,
        layer: LayerId,
        store: &TileStore,
        work: impl FnOnce(&mut TileTextures, LayerStyle<'_>) -> T,
    ) -> Option<T> {
        // Taken out, because the other layers are borrowed meanwhile.
        let mut textures = std::mem::take(&mut self.layers.get_mut(&layer)?.textures);
        let held = self.layers.get(&layer)?;
        let result = self.indexed(layer, store).map(|indexed| {
            let below = held.below.iter();
            let below = below.filter_map(|(layer, _)| self.indexed(*layer, store));
            let style = LayerStyle {
                indexed,
                coloring: &held.coloring,
                below: &below.collect::<Vec<_>>(),
            };
            work(&mut textures, style)
        });
        self.layers.get_mut(&layer)?.textures = textures;
        result
    }

    fn indexed<'a>(&'a self, layer: LayerId, store: &'a TileStore) -> Option<IndexedLayer<'a>> {
        Some(IndexedLayer {
            layer,
            cell_m: store.cell_m(layer)?,
            store,
            known: &self.layers.get(&layer)?.known,
        })
    }

    pub(super) fn paint(
        &self,
        painter: &Painter,
        stack: &LayerStack,
        store: &TileStore,
        camera: &Camera,
    ) {
        for (held, _) in Self::shown(stack, store) {
            let layer = self.layers.get(&held.layer);
            if let Some((layer, cell_m)) = layer.zip(store.cell_m(held.layer)) {
                layer.textures.paint(painter, camera, cell_m, held.opacity);
                if held.layer == LayerId::Depth {
                    self.contours.paint(painter, camera, cell_m);
                }
            }
        }
    }
}

fn seen_below(
    layer: LayerId,
    shown: &[(StackLayer, bool)],
    store: &TileStore,
) -> Vec<(LayerId, f64)> {
    let below = shown.iter().take_while(|(one, _)| one.layer != layer);
    let seen = below.filter(|(one, _)| one.opacity > 0.0);
    let seen = seen.filter_map(|(one, _)| Some((one.layer, store.cell_m(one.layer)?)));
    let mut seen: Vec<_> = seen.collect();
    seen.sort_by_key(|(one, _)| *one);
    seen
}

#[cfg(test)]
mod tests {
    use eframe::egui::{Color32, ColorImage, ImageData, Rect, pos2, vec2};

    use super::super::probe::tests::model_of;
    use super::super::tests::publish;
    use super::super::view_settings::LayerCommand;
    use super::*;
    use crate::model::ConsoleModel;
    use crate::test_support::store_of;
    use crate::test_support::{at, push_tile};

    struct Rig {
        ctx: Context,
        robot: TileStore,
        model: ConsoleModel,
        layers: MapLayers,
        stack: LayerStack,
    }

    impl Rig {
        /// Costs that are free everywhere above shores in the upper half.
        fn new() -> Self {
            let mut robot = store_of(&[LayerId::Cost, LayerId::Shore]);
            let free = LayerId::Cost.quantisation().encode(0.0);
            publish(&mut robot, LayerId::Cost, (0, 0), |_, _| free);
            publish(&mut robot, LayerId::Shore, (0, 0), |_, y| {
                u16::from(y >= 32)
            });
            let mut stack = LayerStack::default();
            stack.apply(LayerCommand::Below(LayerId::Shore, LayerId::Cost));
            Self {
                ctx: Context::default(),
                model: model_of(&robot),
                robot,
                layers: MapLayers::default(),
                stack,
            }
        }

        /// The robot maps shores in these rows (by y).
        fn find_shores(&mut self, code: u16, rows: std::ops::Range<usize>) {
            let shore = |_, y| code * u16::from(rows.contains(&y));
            let key = publish(&mut self.robot, LayerId::Shore, (0, 0), shore);
            push_tile(&mut self.model, &self.robot, key, at(2_100));
        }

        /// Images uploaded in a frame without a limit.
        fn frame(&mut self) -> Vec<ColorImage> {
            let (is_made, images) = self.frame_within(FrameTime::of_tiles(usize::MAX));
            assert!(is_made);
            images
        }

        /// Whether all textures are up to date after a frame, and the images uploaded in it.
        fn frame_within(&mut self, mut time: FrameTime) -> (bool, Vec<ColorImage>) {
            let changed = self.model.take_changed_tiles();
            let map = self.model.map();
            let mut all = FrameTime::of_tiles(usize::MAX);
            assert!(self.layers.update(map, changed, &self.stack, &mut all));
            let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(800.0, 600.0));
            let (camera, store) = (Camera::on(screen), map.store());
            let (view, mut holes) = (&camera, FrameTime::for_holes());
            let (ctx, stack) = (&self.ctx, &self.stack);
            let is_made = self
                .layers
                .prepare(ctx, stack, store, view, &mut holes, &mut time);
            let mut delta = self.ctx.tex_manager().write().take_delta();
            let images = delta.set.values().flatten().map(|part| {
                let ImageData::Color(image) = &part.image;
                ColorImage::clone(image)
            });
            let images = images.collect();
            delta.clear();
            (is_made, images)
        }

        fn free(&self) -> Color32 {
            let palette = self.layers.palette(LayerId::Cost);
            Coloring::new(palette, false).plain(LayerId::Cost.quantisation().encode(0.0))
        }
    }

    /// Columns and rows of these pixels, from the upper left.
    fn places(images: &[ColorImage], color: Color32) -> Vec<[usize; 2]> {
        let places = images.iter().flat_map(|image| {
            let pixels = image.pixels.iter().enumerate();
            let found = pixels.filter(move |(_, pixel)| **pixel == color);
            found.map(|(at, _)| [at % image.width(), at / image.width()])
        });
        places.collect()
    }

    #[test]
    fn free_cells_have_colour_over_unknown_cells() {
        let mut rig = Rig::new();
        let images = rig.frame();
        // The tile is in the lower left corner of its chunk, 64 texels wide; shores are known in its upper half.
        let seen = places(&images, rig.free());
        assert_eq!(seen.len(), 64 * 32);
        assert!(seen.iter().all(|[x, y]| *x < 64 && *y >= 512 - 32));
        assert_eq!(rig.frame(), []);

        // Other shore classes do not change the costs.
        let is_clear = |image: &ColorImage| {
            let mut pixels = image.pixels.iter();
            image.size == [64, 64] && pixels.all(|pixel| *pixel == Color32::TRANSPARENT)
        };
        rig.find_shores(2, 32..64);
        let images = rig.frame();
        assert_eq!(places(&images, rig.free()), [] as [[usize; 2]; 0]);
        assert!(!images.is_empty() && !images.iter().any(is_clear));
        // Costs become transparent over new shores.
        rig.find_shores(2, 0..64);
        assert_eq!(
            rig.frame().iter().filter(|image| is_clear(image)).count(),
            1
        );
        rig.find_shores(2, 63..64);
        let seen = places(&rig.frame(), rig.free());
        assert_eq!(seen.len(), 64 * 63);
        assert!(seen.iter().all(|[_, y]| *y > 0));
    }

    #[test]
    fn invisible_layers_do_not_count_as_below() {
        let mut rig = Rig::new();
        rig.frame();
        rig.stack.apply(LayerCommand::Opacity(LayerId::Shore, 0.0));
        let seen = places(&rig.frame(), rig.free());
        assert_eq!(seen.len(), 64 * 64);
        rig.stack.apply(LayerCommand::Opacity(LayerId::Shore, 0.1));
        assert_eq!(places(&rig.frame(), rig.free()).len(), 64 * 32);
        // The lowest layer does not depend on the others.
        rig.stack
            .apply(LayerCommand::Below(LayerId::Cost, LayerId::Shore));
        let textures = rig.layers.textures();
        assert_eq!(places(&rig.frame(), rig.free()).len(), 64 * 64);
        assert_eq!(rig.layers.textures(), textures);
    }

    /// Around the origin of `odom`, so that each is in another chunk.
    const QUADRANTS: [(i32, i32); 4] = [(0, 0), (-1, 0), (0, -1), (-1, -1)];

    /// A window that was covered draws a single frame when a screenshot is taken. Each layer once lacked what was over the
    /// three textures of a frame.
    #[test]
    fn first_frame_has_no_hole_in_any_layer() {
        let mut rig = Rig::new();
        for tile in QUADRANTS {
            for layer in [LayerId::Cost, LayerId::Shore] {
                let key = publish(&mut rig.robot, layer, tile, |_, _| 1);
                push_tile(&mut rig.model, &rig.robot, key, at(2_100));
            }
        }
        rig.frame_within(FrameTime::over());
        for layer in [LayerId::Cost, LayerId::Shore] {
            let textures = &rig.layers.layers[&layer].textures;
            assert!(textures.len() >= QUADRANTS.len());
            assert_eq!(textures.holes(), []);
        }
    }

    #[test]
    fn a_busy_layer_leaves_time_for_the_others() {
        let mut rig = Rig::new();
        rig.frame();
        for index in 0..60 {
            let tile = (index % 8, index / 8);
            let key = publish(&mut rig.robot, LayerId::Shore, tile, |_, _| 1);
            push_tile(&mut rig.model, &rig.robot, key, at(2_100));
        }
        rig.frame();
        for index in 0..60 {
            let tile = (index % 8, index / 8);
            let key = publish(&mut rig.robot, LayerId::Shore, tile, |_, _| 2);
            push_tile(&mut rig.model, &rig.robot, key, at(2_200));
        }
        let key = publish(&mut rig.robot, LayerId::Cost, (0, 0), |_, _| 200);
        push_tile(&mut rig.model, &rig.robot, key, at(2_200));
        let (is_made, images) = rig.frame_within(FrameTime::over());
        assert!(!is_made);
        let cost = Coloring::new(rig.layers.palette(LayerId::Cost), false);
        let is_cost = |image: &&ColorImage| image.pixels.contains(&cost.plain(200));
        assert_eq!(images.iter().filter(is_cost).count(), 1);
    }
}
