//! Docked panels: a tree that the operator rearranges, stored between runs. The screen draws their contents.

mod layout;

use std::collections::{BTreeMap, BTreeSet};

use eframe::egui::{
    Color32, CursorIcon, Frame, Id, Margin, Painter, Rect, Response, ScrollArea, Sense, Stroke,
    StrokeKind, Style, Ui, Visuals, WidgetText, vec2,
};
use egui_tiles::{
    Behavior, Container, EditAction, SimplificationOptions, TabState, Tabs, Tile, TileId, Tiles,
    Tree, UiResponse,
};
use serde::{Deserialize, Serialize};

pub use layout::{Layout, is_tight};

pub struct Workspace {
    tree: Tree<PanelId>,
    hidden: BTreeSet<PanelId>,
    active_tabs: ActiveTabs,
    wanted_focus: Option<PanelId>,
    focused: Option<PanelId>,
}

impl Default for Workspace {
    fn default() -> Self {
        Self::of(&Layout::default())
    }
}

impl Workspace {
    pub fn of(layout: &Layout) -> Self {
        Self {
            tree: layout.clone().flattened(&BTreeSet::new()).tree(),
            hidden: layout.hidden.clone(),
            active_tabs: ActiveTabs::default(),
            wanted_focus: None,
            focused: None,
        }
    }

    pub fn layout(&self) -> Layout {
        Layout::of(&self.active_tabs.of(&self.tree), self.hidden.clone())
    }

    pub fn reset(&mut self) {
        *self = Self::default();
    }

    pub fn is_wanted(&self, panel: PanelId) -> bool {
        !self.hidden.contains(&panel)
    }

    /// Opens a panel in front of its tabs, or closes it. The map cannot be closed.
    pub fn set_wanted(&mut self, panel: PanelId, is_wanted: bool) {
        if is_wanted {
            self.hidden.remove(&panel);
            self.tree
                .make_active(|_, tile| matches!(tile, Tile::Pane(pane) if *pane == panel));
        } else if panel.can_be_closed() {
            self.hidden.insert(panel);
        }
    }

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

    pub fn shown(&self) -> Vec<PanelId> {
        let corner_and_panel = |id| {
            let panel = *self.tree.tiles.get_pane(&id)?;
            let corner = self.tree.tiles.rect(id)?.min;
            Some(([corner.x as i32, corner.y as i32], panel))
        };
        let shown = self.tree.active_tiles().into_iter();
        let mut shown: Vec<_> = shown.filter_map(corner_and_panel).collect();
        shown.sort_unstable();
        shown.into_iter().map(|(_, panel)| panel).collect()
    }

    pub fn show(
        &mut self,
        ui: &mut Ui,
        has_content: impl Fn(PanelId) -> bool,
        draw: &mut dyn FnMut(&mut Ui, PanelId),
    ) {
        let tiles = &self.tree.tiles;
        let panes = PanelId::ALL.map(|panel| (tiles.find_pane(&panel), panel));
        for (id, panel) in panes {
            let is_shown = !panel.can_be_closed() || self.is_wanted(panel) && has_content(panel);
            if let Some(id) = id {
                self.tree.set_visible(id, is_shown);
            }
        }
        let map = self.tree.tiles.find_pane(&PanelId::Map);
        self.active_tabs.restore(&mut self.tree);
        if let Some(map) = map {
            layout::resize_for_map(&mut self.tree, map, ui.available_size());
        }
        let mut behavior = PanelTreeBehavior {
            draw,
            // The map needs no tab if it is alone.
            tabless: map.and_then(|map| self.tree.tiles.parent_of(map)),
            wanted_focus: self.wanted_focus.take(),
            focused: None,
            closed: None,
            is_dropped: false,
        };
        let dragged = self.dragged(ui);
        self.tree.ui(&mut behavior, ui);
        self.active_tabs.record(&self.tree, true);
        let is_dropped = behavior.is_dropped;
        let (focused, closed) = (behavior.focused, behavior.closed);
        self.focused = focused.map(|(_, panel)| panel);
        if let Some(panel) = closed {
            self.set_wanted(panel, false);
        }
        if is_dropped {
            self.flatten(&dragged);
            ui.ctx().request_repaint();
        }
    }

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

    fn flatten(&mut self, dropped: &BTreeSet<PanelId>) {
        let layout = self.layout();
        let flattened = layout.clone().flattened(dropped);
        if flattened != layout {
            self.tree = flattened.tree();
            // The new tabs have other ids. Their front panels are part of the layout.
            self.active_tabs = ActiveTabs::default();
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PanelId {
    Map,
    Robots,
    Robot,
    Layers,
    Shores,
    Driving,
    Link,
    Sensors,
    Recording,
    Events,
    Alerts,
    Losses,
}

impl PanelId {
    pub const ALL: [Self; 12] = [
        Self::Map,
        Self::Robots,
        Self::Robot,
        Self::Layers,
        Self::Shores,
        Self::Driving,
        Self::Link,
        Self::Sensors,
        Self::Recording,
        Self::Events,
        Self::Alerts,
        Self::Losses,
    ];

    pub const fn title(self) -> &'static str {
        match self {
            Self::Map => "Map",
            Self::Robots => "Robots",
            Self::Robot => "Robot",
            Self::Layers => "Layers",
            Self::Shores => "Shores",
            Self::Driving => "Driving",
            Self::Link => "Link",
            Self::Sensors => "Sensors",
            Self::Recording => "Recording",
            Self::Events => "Events",
            Self::Alerts => "Alerts",
            Self::Losses => "Losses",
        }
    }

    pub const fn hint(self) -> &'static str {
        match self {
            Self::Map => "The map with its layers and the vehicle",
            Self::Robots => "Robots on the network, and addresses to search",
            Self::Robot => "The shown robot: position, speed and heading",
            Self::Layers => "Order, opacity and colours of the map's layers",
            Self::Shores => "Shores and docking sites with their distances",
            Self::Driving => "Control, speeds and limits of the vehicle",
            Self::Link => "Delay, loss and data rate of the link",
            Self::Sensors => "Rates and faults of the sensors",
            Self::Recording => "The recording on the robot's disk",
            Self::Events => "What happened, with its source",
            Self::Alerts => "What needs attention, of all robots",
            Self::Losses => "Dropped messages by reason",
        }
    }

    pub const fn can_be_closed(self) -> bool {
        !matches!(self, Self::Map)
    }

    pub const fn needs_a_robot(self) -> bool {
        !matches!(self, Self::Map | Self::Robots | Self::Events | Self::Alerts)
    }

    /// Whether it reserves the width of the scroll bar itself.
    const fn leaves_room_for_bars(self) -> bool {
        matches!(self, Self::Shores | Self::Events)
    }
}

/// The library forgets which tab the operator chose when a panel without content is hidden.
#[derive(Clone, Debug, Default)]
struct ActiveTabs(BTreeMap<u64, ActiveTab>);

#[derive(Clone, Copy, Debug)]
struct ActiveTab {
    chosen: TileId,
    shown: TileId,
}

impl ActiveTabs {
    /// Before a frame: records new choices, and shows chosen panels if they are visible.
    fn restore(&mut self, tree: &mut Tree<PanelId>) {
        self.record(tree, true);
        self.activate(tree, |tree, chosen| tree.tiles.is_visible_in_layout(chosen));
        self.record(tree, false);
    }

    /// The tree with all chosen panels in front, for the stored layout.
    fn of(&self, tree: &Tree<PanelId>) -> Tree<PanelId> {
        let mut tree = tree.clone();
        self.activate(&mut tree, |_, _| true);
        tree
    }

    /// Shows the chosen panels for which `is_shown` is true.
    fn activate(
        &self,
        tree: &mut Tree<PanelId>,
        is_shown: impl Fn(&Tree<PanelId>, TileId) -> bool,
    ) {
        for (tabs, front) in &self.0 {
            let tabs = TileId::from_u64(*tabs);
            if is_shown(tree, front.chosen)
                && let Some(Tile::Container(Container::Tabs(tabs))) = tree.tiles.get_mut(tabs)
                && tabs.children.contains(&front.chosen)
            {
                tabs.set_active(front.chosen);
            }
        }
    }

    /// Records the front panels. `is_choice`: a changed front panel that was not hidden is a choice.
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
                // The library replaced a hidden panel by another one.
                Some(front) if !tree.tiles.is_visible_in_layout(front.shown) => front.chosen,
                Some(_) | None => shown,
            };
            now.insert(id.0, ActiveTab { chosen, shown });
        }
        self.0 = now;
    }
}

struct PanelTreeBehavior<'a> {
    draw: &'a mut dyn FnMut(&mut Ui, PanelId),
    /// Tabs without a title while they have one panel.
    tabless: Option<TileId>,
    wanted_focus: Option<PanelId>,
    focused: Option<(TileId, PanelId)>,
    closed: Option<PanelId>,
    is_dropped: bool,
}

impl Behavior<PanelId> for PanelTreeBehavior<'_> {
    fn pane_ui(&mut self, ui: &mut Ui, tile: TileId, panel: &mut PanelId) -> UiResponse {
        let panel = *panel;
        let place = ui.max_rect();
        self.anchor(ui, tile, panel, place);
        if panel == PanelId::Map {
            (self.draw)(ui, panel);
        } else {
            Frame::new()
                .inner_margin(Margin::symmetric(10, 8))
                .show(ui, |ui| {
                    // The driving panel scrolls itself, below the emergency stop.
                    if panel == PanelId::Driving {
                        (self.draw)(ui, panel);
                        return;
                    }
                    ScrollArea::vertical()
                        .id_salt(panel)
                        .auto_shrink([false, false])
                        .show(ui, |ui| {
                            if !panel.leaves_room_for_bars() {
                                let bar = ui.spacing().scroll;
                                let taken = bar.bar_inner_margin + bar.bar_width;
                                ui.set_max_width(ui.available_width() - taken);
                            }
                            (self.draw)(ui, panel);
                        });
                });
        }
        UiResponse::None
    }

    fn tab_title_for_pane(&mut self, panel: &PanelId) -> WidgetText {
        panel.title().into()
    }

    fn on_tab_button(
        &mut self,
        tiles: &mut Tiles<PanelId>,
        tile: TileId,
        button: Response,
    ) -> Response {
        match tiles.get_pane(&tile) {
            Some(panel) => button.on_hover_text(panel.hint()),
            None => button,
        }
    }

    fn is_tab_closable(&self, tiles: &Tiles<PanelId>, tile: TileId) -> bool {
        matches!(tiles.get(tile), Some(Tile::Pane(panel)) if panel.can_be_closed())
    }

    fn on_tab_close(&mut self, tiles: &mut Tiles<PanelId>, tile: TileId) -> bool {
        self.closed = tiles.get_pane(&tile).copied();
        false
    }

    fn on_edit(&mut self, edit: EditAction) {
        self.is_dropped |= edit == EditAction::TileDropped;
    }

    fn tab_hover_cursor_icon(&self) -> CursorIcon {
        CursorIcon::Default
    }

    fn is_tab_bar_visible(&self, tile: TileId, tabs: &Tabs) -> bool {
        self.tabless != Some(tile) || tabs.children.len() > 1
    }

    fn simplification_options(&self) -> SimplificationOptions {
        SimplificationOptions {
            all_panes_must_have_tabs: true,
            ..SimplificationOptions::default()
        }
    }

    fn paint_on_top_of_tile(&self, painter: &Painter, style: &Style, tile: TileId, rect: Rect) {
        if self.focused.is_some_and(|(focused, _)| focused == tile) {
            let stroke = Stroke::new(2.0, style.visuals.selection.bg_fill);
            painter.rect_stroke(rect, 2.0, stroke, StrokeKind::Inside);
        }
    }

    fn tab_bar_height(&self, _style: &Style) -> f32 {
        28.0
    }

    /// So that four tabs fit beside each other in the default layout.
    fn tab_title_spacing(&self, _visuals: &Visuals) -> f32 {
        4.0
    }

    fn min_size(&self) -> f32 {
        80.0
    }

    fn gap_width(&self, _style: &Style) -> f32 {
        3.0
    }

    fn tab_bar_color(&self, visuals: &Visuals) -> Color32 {
        if visuals.dark_mode {
            visuals.extreme_bg_color
        } else {
            Color32::from_gray(0xdd)
        }
    }

    fn tab_text_color(
        &self,
        visuals: &Visuals,
        _tiles: &Tiles<PanelId>,
        _tile: TileId,
        state: &TabState,
    ) -> Color32 {
        if state.active {
            visuals.text_color()
        } else {
            visuals.weak_text_color()
        }
    }

    fn tab_outline_stroke(
        &self,
        _visuals: &Visuals,
        _tiles: &Tiles<PanelId>,
        _tile: TileId,
        _state: &TabState,
    ) -> Stroke {
        Stroke::NONE
    }
}

impl PanelTreeBehavior<'_> {
    /// A focusable area, so that panels without focusable content can get the keyboard focus.
    fn anchor(&mut self, ui: &Ui, tile: TileId, panel: PanelId, place: Rect) {
        let id = Id::unique(("panel", panel));
        let corner = Rect::from_min_size(place.min, vec2(1.0, 1.0));
        let anchor = ui.interact(corner, id, Sense::focusable_noninteractive());
        if self.wanted_focus == Some(panel) {
            anchor.request_focus();
        }
        if anchor.has_focus() {
            self.focused = Some((tile, panel));
        }
    }
}

#[cfg(test)]
mod tests;
