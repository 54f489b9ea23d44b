//! The panels and where they are: a tree that the operator rearranges, and that is kept between runs.
//!
//! What a panel shows is not known here. The screen draws it; this says where, and which can be seen at the moment.

mod active_tabs;
mod docking;
mod flattening;
mod layout;
mod min_layout;
mod panel_id;
mod sizes;

use std::collections::BTreeSet;

use eframe::egui::Ui;
use egui_tiles::{Tile, TileId, Tree};

pub use layout::Layout;
pub use min_layout::is_tight;
pub use panel_id::PanelId;

use active_tabs::ActiveTabs;
use docking::Docking;

/// The panels and where they are.
pub struct Workspace {
    tree: Tree<PanelId>,
    /// Closed by the operator.
    hidden: BTreeSet<PanelId>,
    active_tabs: ActiveTabs,
    /// Whose turn it is to have the keyboard, from the next frame on.
    wanted_focus: Option<PanelId>,
    /// Who has it.
    focused: Option<PanelId>,
}

impl Default for Workspace {
    fn default() -> Self {
        Self::of(&Layout::default())
    }
}

impl Workspace {
    /// The panels of a layout that was kept.
    pub fn of(layout: &Layout) -> Self {
        Self {
            tree: layout.clone().flattened(&BTreeSet::new()).tree(),
            hidden: layout.hidden.clone(),
            active_tabs: ActiveTabs::default(),
            wanted_focus: None,
            focused: None,
        }
    }

    /// What is to be kept.
    pub fn layout(&self) -> Layout {
        Layout::of(&self.active_tabs.of(&self.tree), self.hidden.clone())
    }

    /// Puts every panel back where it was at first.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Whether the operator wants to see a panel.
    pub fn is_wanted(&self, panel: PanelId) -> bool {
        !self.hidden.contains(&panel)
    }

    /// Shows a panel, in front of others in the same place, or hides it. The map stays.
    pub fn set_wanted(&mut self, panel: PanelId, is_wanted: bool) {
        if is_wanted {
            self.hidden.remove(&panel);
            self.tree
                .make_active(|_, tile| matches!(tile, Tile::Pane(pane) if *pane == panel));
        } else if panel.can_be_closed() {
            self.hidden.insert(panel);
        }
    }

    /// Gives the keyboard to the next panel that can be seen, or to the one before.
    pub fn cycle_focus(&mut self, is_forward: bool) {
        let shown = self.shown();
        let at = self
            .focused
            .and_then(|panel| shown.iter().position(|shown| *shown == panel));
        let count = shown.len();
        let next = match (at, is_forward) {
            (None, true) => 0,
            (None, false) => count.saturating_sub(1),
            (Some(at), true) => (at + 1) % count,
            (Some(at), false) => (at + count - 1) % count,
        };
        self.wanted_focus = shown.get(next).copied();
    }

    /// The panels that can be seen, from the upper left to the lower right.
    pub fn shown(&self) -> Vec<PanelId> {
        let mut shown: Vec<_> = self
            .tree
            .active_tiles()
            .into_iter()
            .filter_map(|id| {
                let panel = *self.tree.tiles.get_pane(&id)?;
                let corner = self.tree.tiles.rect(id)?.min;
                Some(([corner.x as i32, corner.y as i32], panel))
            })
            .collect();
        shown.sort_unstable();
        shown.into_iter().map(|(_, panel)| panel).collect()
    }

    /// Draws those that `has_content` says can be shown at the moment, each by `draw`.
    pub fn show(
        &mut self,
        ui: &mut Ui,
        has_content: impl Fn(PanelId) -> bool,
        draw: &mut dyn FnMut(&mut Ui, PanelId),
    ) {
        let panes: Vec<(TileId, PanelId)> = self
            .tree
            .tiles
            .iter()
            .filter_map(|(id, tile)| match tile {
                Tile::Pane(panel) => Some((*id, *panel)),
                Tile::Container(_) => None,
            })
            .collect();
        let mut map = None;
        for (id, panel) in panes {
            if panel == PanelId::Map {
                map = Some(id);
            }
            let is_shown = !panel.can_be_closed() || self.is_wanted(panel) && has_content(panel);
            self.tree.set_visible(id, is_shown);
        }
        self.active_tabs.restore(&mut self.tree);
        if let Some(map) = map {
            sizes::resize_for_map(&mut self.tree, map, ui.available_size());
        }
        let mut docking = Docking {
            draw,
            // A map that shares its place with nothing needs no tab.
            tabless: map.and_then(|map| self.tree.tiles.parent_of(map)),
            wanted_focus: self.wanted_focus.take(),
            focused: None,
            closed: None,
            is_dropped: false,
        };
        let dragged = self.dragged(ui);
        self.tree.ui(&mut docking, ui);
        self.active_tabs.record_choices(&self.tree);
        let is_dropped = docking.is_dropped;
        let (focused, closed) = (docking.focused, docking.closed);
        self.focused = focused.map(|(_, panel)| panel);
        if let Some(panel) = closed {
            self.set_wanted(panel, false);
        }
        if is_dropped {
            self.flatten(&dragged);
            ui.ctx().request_repaint();
        }
    }

    /// The panels in the operator's hand.
    fn dragged(&self, ui: &Ui) -> BTreeSet<PanelId> {
        let mut open: Vec<_> = self.tree.dragged_id(ui.ctx()).into_iter().collect();
        let mut panels = BTreeSet::new();
        while let Some(tile) = open.pop() {
            match self.tree.tiles.get(tile) {
                Some(Tile::Pane(panel)) => {
                    panels.insert(*panel);
                }
                Some(Tile::Container(container)) => open.extend(container.children()),
                None => {}
            }
        }
        panels
    }

    /// Takes tabs and rows out of tabs that these panels were dropped into.
    fn flatten(&mut self, dropped: &BTreeSet<PanelId>) {
        let layout = self.layout();
        let flattened = layout.clone().flattened(dropped);
        if flattened != layout {
            self.tree = flattened.tree();
            // The tabs are new ones; what is in front of each is in the layout.
            self.active_tabs = ActiveTabs::default();
        }
    }
}

#[cfg(test)]
mod tests;
