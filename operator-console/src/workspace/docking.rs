//! How the tree of panels looks and what may be done with it.

use eframe::egui::{
    Color32, CursorIcon, Frame, Id, Margin, Painter, Rect, ScrollArea, Sense, Stroke, StrokeKind,
    Style, Ui, Visuals, WidgetText, vec2,
};
use egui_tiles::{
    Behavior, EditAction, SimplificationOptions, TabState, Tabs, Tile, TileId, Tiles, UiResponse,
};

use super::PanelId;

/// Draws the panels of one frame, and notes what happened to them.
pub(super) struct Docking<'a> {
    pub(super) draw: &'a mut dyn FnMut(&mut Ui, PanelId),
    /// The tabs that show none as long as they have one panel.
    pub(super) tabless: Option<TileId>,
    pub(super) wanted_focus: Option<PanelId>,
    pub(super) focused: Option<(TileId, PanelId)>,
    pub(super) closed: Option<PanelId>,
    /// Whether something was put elsewhere by hand.
    pub(super) is_dropped: bool,
}

impl Behavior<PanelId> for Docking<'_> {
    fn pane_ui(&mut self, ui: &mut Ui, tile: TileId, panel: &mut PanelId) -> UiResponse {
        let panel = *panel;
        let place = ui.max_rect();
        self.anchor(ui, tile, panel, place);
        if panel.fills_its_place() {
            (self.draw)(ui, panel);
        } else {
            Frame::new()
                .inner_margin(Margin::symmetric(10, 8))
                .show(ui, |ui| {
                    // Driving keeps the emergency stop in place and scrolls the rest.
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

    fn is_tab_closable(&self, tiles: &Tiles<PanelId>, tile: TileId) -> bool {
        matches!(tiles.get(tile), Some(Tile::Pane(panel)) if panel.can_be_closed())
    }

    fn on_tab_close(&mut self, tiles: &mut Tiles<PanelId>, tile: TileId) -> bool {
        // It keeps its place, to come back to.
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

impl Docking<'_> {
    /// Something in the panel that can have the keyboard although nothing in it was made for that; Tab goes on from it.
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
