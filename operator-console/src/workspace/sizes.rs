//! Who gives and takes where the window grows and shrinks, and where panels come and go: the map, as far as it can.

use eframe::egui::Vec2;
use egui_tiles::{Container, LinearDir, Tile, TileId, Tree};

use super::PanelId;
use super::layout::share_of;

/// The map becomes no smaller than this for the sake of others, points, and in a small window no smaller than this share of it.
pub(super) const LEAST: f32 = 300.0;
pub(super) const LEAST_SHARE: f32 = 0.4;
/// What has just been put beside the map gets this, points: the library gives it next to nothing.
const NEW: f32 = 250.0;
/// No panel was ever made so small by hand.
const COLLAPSED: f32 = 20.0;

/// In rows and columns that the map is in, shares are points. All other panels that can be seen keep theirs, and the map
/// has what is left of `size`.
pub(super) fn resize_for_map(tree: &mut Tree<PanelId>, map: TileId, size: Vec2) {
    let mut way = vec![map];
    while let Some(parent) = tree.tiles.parent_of(way[way.len() - 1]) {
        way.push(parent);
    }
    let mut size = size;
    for pair in way.windows(2).rev() {
        let [child, parent] = [pair[0], pair[1]];
        let Some(Tile::Container(Container::Linear(linear))) = tree.tiles.get(parent) else {
            continue;
        };
        let axis = match linear.dir {
            LinearDir::Horizontal => 0,
            LinearDir::Vertical => 1,
        };
        let others: Vec<TileId> = linear
            .children
            .iter()
            .copied()
            .filter(|other| *other != child && tree.tiles.is_visible_in_layout(*other))
            .collect();
        let Some(Tile::Container(Container::Linear(linear))) = tree.tiles.get_mut(parent) else {
            continue;
        };
        let mut taken = 0.0;
        for other in others {
            let mut points = share_of(linear, other);
            if points < COLLAPSED {
                points = NEW;
                linear.shares.set_share(other, points);
            }
            taken += points;
        }
        let least = LEAST.min(LEAST_SHARE * size[axis]);
        let for_map = (size[axis] - taken).max(least);
        // Where there is too little for all, the others give in proportion: theirs are not written over, so that they have
        // them again in a larger window.
        let share = if taken + for_map > size[axis] {
            for_map * taken / (size[axis] - for_map).max(1.0)
        } else {
            for_map
        };
        linear.shares.set_share(child, share);
        size[axis] = for_map;
    }
}
