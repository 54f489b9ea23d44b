//! The drawn layers of a robot: known tiles, colours and textures.

use std::collections::{BTreeMap, BTreeSet};

use eframe::egui::{Context, Painter};
use protocol::layer::{LayerId, Palette, Scheme};
use protocol::tile::TileKey;
use protocol::tile_store::{StoredTile, TileStore};

use super::camera::{Camera, around};
use super::chunks::{FrameTime, LayerStyle};
use super::coloring::{Coloring, fitted_to, palette_of};
use super::layer_compositing::{IndexedLayer, TilePresence, tiles_above};
use super::layer_stack::{LayerStack, StackLayer};
use super::tile_textures::TileTextures;
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
    /// Whether all tiles must be processed, after a change of robots.
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
                .flat_map(|layer| store.tiles(layer));
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
            // The range of heights is unknown in advance. It is fitted each time the map has doubled, so that colours
            // rarely change their meaning, and only when all waiting tiles are processed.
            let has_grown = held.known.len() >= 2 * held.fitted_at.max(1);
            if wanted.scheme == Scheme::Cividis && has_grown && self.waiting.is_empty() {
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

    /// Updates textures within `time`. Returns whether all are up to date.
    pub(super) fn prepare(
        &mut self,
        ctx: &Context,
        stack: &LayerStack,
        store: &TileStore,
        camera: &Camera,
        time: &mut FrameTime,
    ) -> bool {
        let shown = Self::shown(stack, store);
        let allowance = MAX_TEXTURES / shown.len().max(1);
        let mut is_complete = true;
        for (stacked, _) in shown {
            let layer = stacked.layer;
            let Some(held) = self.layers.get_mut(&layer) else {
                continue;
            };
            let bounds_cells = held.known.bounds_cells();
            // Taken out, because the other layers are borrowed meanwhile.
            let mut textures = std::mem::take(&mut held.textures);
            if let Some(held) = self.layers.get(&layer)
                && let Some(indexed) = self.indexed(layer, store)
            {
                let below = held.below.iter();
                let below = below.filter_map(|(layer, _)| self.indexed(*layer, store));
                let style = LayerStyle {
                    indexed,
                    coloring: &held.coloring,
                    below: &below.collect::<Vec<_>>(),
                };
                is_complete &= textures.prepare(ctx, style, camera, bounds_cells, allowance, time);
            }
            if let Some(held) = self.layers.get_mut(&layer) {
                held.textures = textures;
            }
        }
        is_complete
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
mod tests;
