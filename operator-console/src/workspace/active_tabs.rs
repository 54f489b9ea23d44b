//! Which of several panels in one place is in front: the one that the operator chose, whenever it can be seen.
//!
//! The library forgets that choice as soon as the panel is hidden, and a panel is hidden until there is something in it.

use std::collections::BTreeMap;

use egui_tiles::{Container, Tile, TileId, Tree};

use super::PanelId;

/// What is in front of which tabs.
#[derive(Clone, Debug, Default)]
pub(super) struct ActiveTabs(BTreeMap<u64, ActiveTab>);

#[derive(Clone, Copy, Debug)]
struct ActiveTab {
    /// By choice.
    chosen: TileId,
    /// In the last frame.
    shown: TileId,
}

impl ActiveTabs {
    /// Before a frame: takes over what was chosen since the last one, and puts it in front where it can be seen.
    pub(super) fn restore(&mut self, tree: &mut Tree<PanelId>) {
        self.record(tree, true);
        for (tabs, front) in &self.0 {
            let tabs = TileId::from_u64(*tabs);
            if tree.tiles.is_visible_in_layout(front.chosen)
                && let Some(Tile::Container(Container::Tabs(tabs))) = tree.tiles.get_mut(tabs)
                && tabs.children.contains(&front.chosen)
            {
                tabs.set_active(front.chosen);
            }
        }
        self.record(tree, false);
    }

    /// What is chosen, for a layout that is kept: the tree as it would be if all could be seen.
    pub(super) fn of(&self, tree: &Tree<PanelId>) -> Tree<PanelId> {
        let mut tree = tree.clone();
        for (tabs, front) in &self.0 {
            let tabs = TileId::from_u64(*tabs);
            if let Some(Tile::Container(Container::Tabs(tabs))) = tree.tiles.get_mut(tabs)
                && tabs.children.contains(&front.chosen)
            {
                tabs.set_active(front.chosen);
            }
        }
        tree
    }

    /// After a frame. What is in front now although nobody hid anything was chosen.
    pub(super) fn record_choices(&mut self, tree: &Tree<PanelId>) {
        self.record(tree, true);
    }

    fn record(&mut self, tree: &Tree<PanelId>, is_choice: bool) {
        let mut now = BTreeMap::new();
        for (id, tile) in tree.tiles.iter() {
            let Tile::Container(Container::Tabs(tabs)) = tile else {
                continue;
            };
            let Some(shown) = tabs.active else { continue };
            let before = self.0.get(&id.0).copied();
            let chosen = match before {
                Some(front) if !is_choice || front.shown == shown => front.chosen,
                // The chosen one can not be seen: another took its place by itself.
                Some(front) if !tree.tiles.is_visible_in_layout(front.shown) => front.chosen,
                Some(_) | None => shown,
            };
            now.insert(id.0, ActiveTab { chosen, shown });
        }
        self.0 = now;
    }
}
