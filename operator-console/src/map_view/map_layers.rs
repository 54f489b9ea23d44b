//! The layers of one robot as they are drawn: what is known of each, its colours and its textures.

use std::collections::{BTreeMap, BTreeSet};

use eframe::egui::{Context, Painter, Rect};
use protocol::layer::{LayerId, Palette, Scheme};
use protocol::tile::TileKey;
use protocol::tile_store::{StoredTile, TileStore};

use super::camera::Camera;
use super::chunk_builder::LayerStyle;
use super::coloring::{Coloring, fitted_to, palette_of};
use super::frame_time::FrameTime;
use super::layer_compositing::{IndexedLayer, tiles_above};
use super::layer_stack::{LayerStack, StackLayer};
use super::tile_presence::TilePresence;
use super::tile_textures::TileTextures;
use crate::model::{AgeOrder, MapSync};

/// Textures of all layers together, a mebibyte each.
pub(super) const MAX_TEXTURES: usize = 192;

/// What is known and drawn of one layer.
struct MapLayer {
    known: TilePresence,
    coloring: Coloring,
    /// The layers below it that are seen, and how large their cells are, metres.
    below: Vec<(LayerId, f64)>,
    textures: TileTextures,
    /// Tiles known when the colours were fitted last.
    fitted_at: usize,
    /// The tile that was measured last.
    newest: Option<(TileKey, AgeOrder)>,
}

/// See the [module](self).
#[derive(Default)]
pub(super) struct MapLayers {
    layers: BTreeMap<LayerId, MapLayer>,
    /// Changed, and not looked at yet.
    waiting: BTreeSet<TileKey>,
    /// Whether every tile must be looked at: what is held is of another robot.
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

    /// A tile changed: it may be the newest now, or no longer.
    fn update_newest(&mut self, map: &MapSync, key: TileKey) {
        let (store, ages) = (map.store(), map.ages());
        let is_known = |stored: &StoredTile| stored.cells().is_some();
        let order = ages.order(key);
        let order = order.filter(|_| store.get(key).is_some_and(is_known));
        match (self.newest, order) {
            (None, order) => self.newest = order.map(|order| (key, order)),
            (Some((_, newest)), Some(order)) if order >= newest => self.newest = Some((key, order)),
            // Gone, perhaps with all others of its epoch, or of an earlier time of a recording.
            (Some((newest, _)), _) if newest == key => self.find_newest(map, key.layer),
            (Some(_), _) => {}
        }
    }

    /// Looks at all tiles, and not often: which of them is the newest.
    fn find_newest(&mut self, map: &MapSync, layer: LayerId) {
        let held = map.store().tiles(layer);
        let held = held.filter(|(_, stored)| stored.cells().is_some());
        let orders = held.filter_map(|(key, _)| Some((key, map.ages().order(key)?)));
        self.newest = orders.max_by_key(|(_, order)| *order);
    }

    /// What was taken for the newest may turn out to be of before the data began again.
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
        let fitted = fitted_to(*self.coloring.palette(), store);
        self.fitted_at = self.known.len();
        if fitted != *self.coloring.palette() {
            self.recolor(Coloring::new(fitted, self.coloring.is_over()));
        }
    }
}

impl MapLayers {
    /// Another robot: nothing of the last one stays.
    pub(super) fn forget(&mut self) {
        *self = Self {
            is_other: true,
            ..Self::default()
        };
    }

    /// The layers that are drawn, the lowest first, and whether each lies over another.
    pub(super) fn shown(stack: &LayerStack, store: &TileStore) -> Vec<(StackLayer, bool)> {
        let is_drawn = |held: &&StackLayer| held.is_shown && store.cell_m(held.layer).is_some();
        let drawn = stack.layers().iter().filter(is_drawn);
        drawn
            .zip(0..)
            .map(|(held, under)| (*held, under > 0))
            .collect()
    }

    /// The colours of a layer.
    pub(super) fn palette(&self, layer: LayerId) -> Palette {
        let held = self.layers.get(&layer);
        held.map_or_else(|| layer.default_palette(), |held| *held.coloring.palette())
    }

    /// Known tiles of a layer.
    pub(super) fn tiles(&self, layer: LayerId) -> usize {
        self.layers.get(&layer).map_or(0, |held| held.known.len())
    }

    /// The tile of a layer that was measured last.
    pub(super) fn newest(&self, layer: LayerId) -> Option<TileKey> {
        let newest = self.layers.get(&layer)?.newest;
        newest.map(|(key, _)| key)
    }

    /// Textures of all layers.
    pub(super) fn textures(&self) -> usize {
        self.layers.values().map(|held| held.textures.len()).sum()
    }

    /// Takes over what changed in the map, as far as `time` goes; false where more is left.
    pub(super) fn update(
        &mut self,
        map: &MapSync,
        changed: BTreeSet<TileKey>,
        stack: &LayerStack,
        time: &mut FrameTime,
    ) -> bool {
        let store = map.store();
        if self.waiting.is_empty() {
            self.waiting = changed;
        } else {
            self.waiting.extend(changed);
        }
        if std::mem::take(&mut self.is_other) {
            let all = LayerId::ALL
                .into_iter()
                .flat_map(|layer| store.tiles(layer));
            self.waiting.extend(all.map(|(key, _)| key));
        }
        while !self.waiting.is_empty() && time.take_tile() {
            let Some(key) = self.waiting.pop_first() else {
                break;
            };
            let layer = key.layer;
            let held = self
                .layers
                .entry(layer)
                .or_insert_with(|| MapLayer::new(layer));
            let is_known_elsewhere = held.known.update(store, key);
            held.textures.changed((key.tx, key.ty));
            held.update_newest(map, key);
            if is_known_elsewhere {
                self.change_above(key, store);
            }
        }
        for held in self.layers.values_mut() {
            held.recheck_newest(map);
        }
        self.color(stack, store);
        self.waiting.is_empty()
    }

    /// Other cells of a tile are known than were: what lies over it lets through others.
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

    /// Spreads the colours of a layer over its values.
    pub(super) fn fit_colors(&mut self, layer: LayerId, store: &TileStore) {
        if let Some(held) = self.layers.get_mut(&layer) {
            held.fit(store);
        }
    }

    /// Gives every layer that is shown the colours that its place in the stack asks for.
    fn color(&mut self, stack: &LayerStack, store: &TileStore) {
        let shown = Self::shown(stack, store);
        for (layer, held) in &mut self.layers {
            let Some((wanted, is_over)) = shown.iter().find(|(one, _)| one.layer == *layer) else {
                held.textures.clear();
                continue;
            };
            let palette = *held.coloring.palette();
            if palette.scheme() != wanted.scheme {
                held.fitted_at = 0;
                held.recolor(Coloring::new(palette_of(*layer, wanted.scheme), *is_over));
            } else if held.coloring.is_over() != *is_over {
                held.recolor(Coloring::new(palette, *is_over));
            }
            held.set_below(seen_below(*layer, &shown, store));
            // Heights are not known beforehand: as the map grows, so does the range of its colours, seldom enough that
            // a colour keeps its meaning. Not before the tiles that came at once are all looked at.
            let has_grown = held.known.len() >= 2 * held.fitted_at.max(1);
            if wanted.scheme == Scheme::Cividis && has_grown && self.waiting.is_empty() {
                held.fit(store);
            }
        }
    }

    /// Lowest and greatest x and y of what is known in the layers that are drawn, metres.
    pub(super) fn bounds_m(&mut self, stack: &LayerStack, store: &TileStore) -> Option<[f64; 4]> {
        let shown = Self::shown(stack, store);
        let edges = shown.iter().filter_map(|(held, _)| {
            let cell_m = store.cell_m(held.layer)?;
            let bounds_cells = self.layers.get_mut(&held.layer)?.known.bounds_cells()?;
            Some(bounds_cells.map(|cell| cell as f64 * cell_m))
        });
        edges.reduce(|a, b| {
            [
                a[0].min(b[0]),
                a[1].min(b[1]),
                a[2].max(b[2]),
                a[3].max(b[3]),
            ]
        })
    }

    /// Makes textures as far as `time` goes; false where more is left.
    pub(super) fn prepare(
        &mut self,
        ctx: &Context,
        stack: &LayerStack,
        store: &TileStore,
        (camera, screen): (&Camera, Rect),
        time: &mut FrameTime,
    ) -> bool {
        let shown = Self::shown(stack, store);
        let allowance = MAX_TEXTURES / shown.len().max(1);
        let mut is_complete = true;
        for (stacked, _) in shown {
            let layer = stacked.layer;
            let (Some(held), Some(cell_m)) = (self.layers.get_mut(&layer), store.cell_m(layer))
            else {
                continue;
            };
            let bounds_cells = held.known.bounds_cells();
            // Apart, while this layer and those below it are looked at.
            let mut textures = std::mem::take(&mut held.textures);
            if let Some(held) = self.layers.get(&layer) {
                let below = self.known_layers(&held.below, store);
                let style = LayerStyle {
                    layer,
                    cell_m,
                    store,
                    known: &held.known,
                    coloring: &held.coloring,
                    below: &below,
                };
                let view = (camera, screen);
                is_complete &= textures.prepare(ctx, style, view, bounds_cells, allowance, time);
            }
            if let Some(held) = self.layers.get_mut(&layer) {
                held.textures = textures;
            }
        }
        is_complete
    }

    /// What these layers know.
    fn known_layers<'a>(
        &'a self,
        layers: &[(LayerId, f64)],
        store: &'a TileStore,
    ) -> Vec<IndexedLayer<'a>> {
        let known = layers.iter().filter_map(|(layer, cell_m)| {
            Some(IndexedLayer {
                layer: *layer,
                cell_m: *cell_m,
                store,
                known: &self.layers.get(layer)?.known,
            })
        });
        known.collect()
    }

    /// Draws the layers that are shown.
    pub(super) fn paint(
        &self,
        painter: &Painter,
        stack: &LayerStack,
        store: &TileStore,
        view: (&Camera, Rect),
    ) {
        for (held, _) in Self::shown(stack, store) {
            if let (Some(layer), Some(cell_m)) =
                (self.layers.get(&held.layer), store.cell_m(held.layer))
            {
                layer.textures.paint(painter, view, cell_m, held.opacity);
            }
        }
    }
}

/// The layers below `layer` that are seen, and how large their cells are, metres.
fn seen_below(
    layer: LayerId,
    shown: &[(StackLayer, bool)],
    store: &TileStore,
) -> Vec<(LayerId, f64)> {
    let below = shown.iter().take_while(|(one, _)| one.layer != layer);
    let seen = below.filter(|(one, _)| one.opacity > 0.0);
    let mut seen: Vec<_> = seen
        .filter_map(|(one, _)| Some((one.layer, store.cell_m(one.layer)?)))
        .collect();
    seen.sort_by_key(|(one, _)| *one);
    seen
}

#[cfg(test)]
mod tests;
