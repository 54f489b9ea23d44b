//! What stands at the edges of the map: the banner of a lost link, buttons, compass and legends; and where a notice lies.

use std::f64::consts::FRAC_PI_2;

use eframe::egui::{Align, Frame, Layout, Pos2, Rect, Sense, Ui, UiBuilder, pos2, vec2};

use super::card_place::LEAST;
use super::legend_place::LegendPlace;
use super::map_layers::MapLayers;
use super::overlays::compass::{self, CompassData};
use super::toolbar::{self, ToolbarData};
use super::{CARD_MARGIN, CameraMode, MapView, Overlay, legend_card};
use crate::command::Look;
use crate::model::ConsoleModel;
use crate::panels::notice::NoticeRoom;
use crate::panels::stale::{StaleData, stale_ui};

/// Within the banner, points.
const PADDING: f32 = 8.0;
/// From the lower edge to what stands over the scale bar, points.
pub(super) const OVER_SCALE_BAR: f32 = 60.0;
/// From the lower left corner to where nothing of the longest scale bar is, points.
const SCALE_BAR: [f32; 2] = [190.0, OVER_SCALE_BAR];
/// A map that is smaller says nothing of what is under the pointer: the card would hide it. Width and height, points.
pub(super) const LEAST_FOR_CARDS: [f32; 2] = [200.0, 160.0];

/// Whether y of `odom` points north.
pub(super) fn knows_north(model: &ConsoleModel) -> bool {
    model.shores().is_some_and(|shores| shores.datum.is_some())
}

impl MapView {
    pub(super) fn has_room_for_cards(&self) -> bool {
        let [width, height] = LEAST_FOR_CARDS;
        self.screen.width() >= width && self.screen.height() >= height
    }

    /// The legends with their button, where they are drawn.
    pub(super) fn legends_place(&self) -> Option<Rect> {
        let place = self.legends.place();
        place.filter(|_| self.settings.has(Overlay::Legend))
    }

    /// Where the compass is, below the buttons as they were drawn last.
    fn compass_place(&self) -> Option<Rect> {
        self.compass_below(self.buttons.bottom())
    }

    /// Where it is below buttons that end there.
    fn compass_below(&self, buttons: f32) -> Option<Rect> {
        let right = self.screen.right() - CARD_MARGIN;
        let at = pos2(right - compass::SIZE, buttons + CARD_MARGIN);
        let place = Rect::from_min_size(at, vec2(compass::SIZE, compass::SIZE));
        self.settings.has(Overlay::Compass).then_some(place)
    }

    /// Whether buttons, compass or legends stand at this place of the screen: who points there does not mean the map
    /// below. The card with what is read does not count, for that makes way.
    pub(super) fn is_occluded(&self, place: Pos2) -> bool {
        let occluders = [
            Some(self.buttons),
            self.compass_place(),
            self.legends_place(),
        ];
        let mut occluders = occluders.into_iter().flatten();
        occluders.any(|occluders| occluders.contains(place))
    }

    /// Where a notice lies, as of the last frame; `None` where the map is too small for it.
    pub fn notice_room(&self) -> Option<NoticeRoom> {
        if !self.has_room_for_cards() {
            return None;
        }
        let legends = self.legends_place();
        let [width, height] = SCALE_BAR;
        let corner = self.screen.left_bottom();
        let scale_bar = Rect::from_two_pos(corner, corner + vec2(width, -height));
        let occluders = self.occluders.iter().copied().chain(legends);
        let whole = self.screen.shrink(CARD_MARGIN);
        // Beside the legends, above which it would be where the vehicle is.
        let beside = legends.map(|legends| whole.with_max_x(legends.left() - CARD_MARGIN));
        let beside = beside.filter(|beside| beside.width() >= LEAST);
        Some(NoticeRoom {
            place: beside.unwrap_or(whole),
            taken: occluders.chain([scale_bar]).collect(),
        })
    }

    /// The banner over the upper edge, where nothing is heard. The map below it stays where it is, for somebody may be
    /// pointing at it; what can be pressed moves out of the way.
    pub(super) fn banner_ui(&mut self, ui: &mut Ui, stale: Option<&StaleData>) {
        let before = std::mem::replace(&mut self.map_top, self.screen.top());
        if let Some(stale) = stale {
            let whole = UiBuilder::new()
                .max_rect(self.screen)
                .layout(Layout::top_down(Align::Min));
            let [ground, _] = stale.colors(ui.visuals());
            let banner = ui.scope_builder(whole, |ui| {
                let frame = Frame::new().fill(ground).inner_margin(PADDING);
                frame.show(ui, |ui| {
                    ui.set_width(ui.available_width());
                    stale_ui(ui, stale);
                });
            });
            let banner = banner.response.rect;
            // Nobody reads or moves what is under it.
            let id = ui.scope_id().with("banner");
            ui.interact(banner, id, Sense::CLICK | Sense::DRAG);
            self.occluders.push(banner);
            // On a map that is hardly higher than the banner, the buttons lie over it.
            let lowest = (self.screen.bottom() - 2.0 * CARD_MARGIN).max(self.screen.top());
            self.map_top = banner.bottom().min(lowest);
        }
        if (self.map_top - before).abs() > 0.5 {
            // Cards look at where the buttons were.
            ui.ctx().request_repaint();
        }
    }

    /// What the buttons ask for.
    pub(super) fn buttons_ui(&mut self, ui: &mut Ui) -> Option<Look> {
        let top_right = UiBuilder::new()
            .max_rect(self.screen.with_min_y(self.map_top).shrink(CARD_MARGIN))
            .layout(Layout::top_down(Align::Max));
        let data = ToolbarData {
            camera_mode: self.settings.camera_mode,
            orientation: self.settings.orientation,
            has_grid: self.settings.has(Overlay::Grid),
            is_measuring: self.ruler.is_some(),
        };
        let buttons = ui.scope_builder(top_right, |ui| toolbar::toolbar_ui(ui, data));
        self.buttons = buttons.response.rect;
        self.occluders.push(self.buttons);
        buttons.inner
    }

    pub(super) fn compass_ui(&mut self, ui: &Ui, model: &ConsoleModel) -> Option<Look> {
        let rect = self.compass_place()?;
        let data = CompassData {
            north: self.camera.direction(FRAC_PI_2),
            is_on_earth: knows_north(model),
            orientation: self.settings.orientation,
        };
        self.occluders.push(rect);
        compass::compass_ui(ui, rect, data).then(|| Look::Up(self.settings.orientation.other()))
    }

    /// Of the legends' card, points.
    pub(super) fn legend_width(&self) -> f32 {
        legend_card::width(self.screen)
    }

    pub(super) fn legend_ui(&mut self, ui: &Ui, model: &ConsoleModel) {
        let shown = MapLayers::shown(self.stack(), model.map().store());
        let palettes = shown.iter().rev();
        let palettes: Vec<_> = palettes
            .map(|(held, is_over)| (self.layers.palette(held.layer), *is_over))
            .collect();
        // The buttons are drawn after this, and no lower.
        let buttons = self.map_top + CARD_MARGIN + toolbar::HEIGHT;
        let map = LegendPlace {
            screen: self.screen,
            buttons,
            compass: self.compass_below(buttons),
        };
        let before = self.legends.place();
        self.legends.show(ui, &map, &palettes);
        let is_other = match (before, self.legends.place()) {
            (Some(before), Some(now)) => (now.size() - before.size()).length() > 0.5,
            (before, now) => before.is_some() != now.is_some(),
        };
        if self.settings.camera_mode == CameraMode::FitMap && is_other {
            // The whole map is beside them.
            ui.ctx().request_repaint();
        }
    }
}
