//! Cards and buttons on the map. None of them covers the vehicle: they move or fold. The whole map is fitted beside them.

use std::f64::consts::FRAC_PI_2;
use std::iter;

use eframe::egui::{
    Align, Align2, Area, Frame, Id, Layout, Order, Pos2, Rect, Sense, Ui, UiBuilder, Vec2, pos2,
    vec2,
};
use measurement::time::Monotonic;

use super::grid::{self, COMPASS_SIZE, CompassData};
use super::legend_card::{self, Drawn, LegendPlace};
use super::map_layers::MapLayers;
use super::probe::{self, ProbeData};
use super::toolbar::{self, ToolbarData};
use super::{CARD_MARGIN, CameraMode, MapView, Overlay, PosePurpose, can_set_pose};
use crate::command::Look;
use crate::model::ConsoleModel;
use crate::panels::data_age::{StaleData, stale_ui};
use crate::panels::notice::NoticeRoom;

const PADDING: f32 = 8.0;
/// Distance of cards above the scale bar from the lower edge, points.
const OVER_SCALE_BAR: f32 = 60.0;
/// Width of the longest scale bar with its margins, points.
const SCALE_BAR: f32 = 190.0;
/// Smaller maps have no probe card, because it would hide them. Width and height, points.
pub(super) const MIN_MAP_FOR_CARDS: [f32; 2] = [200.0, 160.0];
/// A narrower card has too many lines, points.
const MIN_CARD_WIDTH: f32 = 330.0;
/// On narrower maps the probe card has short texts, points.
const NARROW: f32 = 480.0;
/// Width of folded buttons with their margin, points.
const FOLDED_BUTTONS: f32 = 160.0;
/// From the pointer to the probe card, points.
const POINTER: f32 = 8.0;
/// Around the vehicle, points.
const VEHICLE_MARGIN: f32 = 4.0;
/// Of a larger vehicle only the middle is kept free of cards, points.
const MAX_VEHICLE: f32 = 80.0;

/// In the last frame.
pub(super) struct Cards {
    pub(super) buttons: Rect,
    /// Size of the buttons that are not folded.
    whole_buttons: Vec2,
    /// Lower edge of the banner, or upper edge of the map.
    map_top: f32,
    /// Buttons and cards, without legends and scale bar.
    pub(super) occluders: Vec<Rect>,
    probe_size: Vec2,
    pinned_probe: Option<Rect>,
    /// In this frame.
    vehicle: Option<Rect>,
}

impl Default for Cards {
    fn default() -> Self {
        Self {
            buttons: Rect::NOTHING,
            whole_buttons: Vec2::ZERO,
            map_top: 0.0,
            occluders: Vec::new(),
            probe_size: Vec2::ZERO,
            pinned_probe: None,
            vehicle: None,
        }
    }
}

impl MapView {
    pub(super) fn set_vehicle_place(&mut self, vehicle: Option<Rect>) {
        self.cards.vehicle = vehicle.map(|vehicle| {
            let size = vehicle.size().min(Vec2::splat(MAX_VEHICLE));
            Rect::from_center_size(vehicle.center(), size).expand(VEHICLE_MARGIN)
        });
    }

    fn hides_vehicle(&self, card: Rect) -> bool {
        let vehicle = self.cards.vehicle;
        vehicle.is_some_and(|vehicle| vehicle.intersects(card))
    }

    /// Whether a card folds because it would cover the vehicle. The whole map, with the vehicle, is beside all cards.
    pub(super) fn folds(&self, card: Rect) -> bool {
        self.settings.camera_mode != CameraMode::FitMap && self.hides_vehicle(card)
    }

    pub(super) fn has_room_for_cards(&self) -> bool {
        let [width, height] = MIN_MAP_FOR_CARDS;
        self.camera.screen.width() >= width && self.camera.screen.height() >= height
    }

    pub(super) fn legends_place(&self) -> Option<Rect> {
        let place = self.legends.place.filter(|place| !self.folds(*place));
        place.filter(|_| self.settings.has(Overlay::Legend))
    }

    fn compass_below(&self, buttons: f32) -> Option<Rect> {
        let right = self.camera.screen.right() - CARD_MARGIN;
        let at = pos2(right - COMPASS_SIZE, buttons + CARD_MARGIN);
        let place = Rect::from_min_size(at, Vec2::splat(COMPASS_SIZE));
        (self.settings.has(Overlay::Compass) && !self.folds(place)).then_some(place)
    }

    /// Buttons, compass and legends.
    fn fixed_cards(&self) -> impl Iterator<Item = Rect> {
        let buttons = self.cards.buttons;
        let compass = self.compass_below(buttons.bottom());
        let cards = [Some(buttons), compass, self.legends_place()];
        cards.into_iter().flatten()
    }

    pub(super) fn is_occluded(&self, place: Pos2) -> bool {
        self.fixed_cards().any(|card| card.contains(place))
    }

    pub(super) fn width_beside_legend(&self) -> f32 {
        let legend = if self.settings.has(Overlay::Legend) {
            legend_card::width(self.camera.screen) + CARD_MARGIN
        } else {
            0.0
        };
        self.camera.screen.width() - legend - 2.0 * CARD_MARGIN
    }

    /// The longest scale bar, whose length changes with the scale, with its margins.
    pub(super) fn scale_bar_room(&self) -> Rect {
        let corner = self.camera.screen.left_bottom();
        let width = SCALE_BAR.min(self.width_beside_legend() + CARD_MARGIN);
        Rect::from_two_pos(corner, corner + vec2(width, -OVER_SCALE_BAR))
    }

    /// Cards that do not follow the pointer, without the banner, whose appearance must not move the map.
    pub(super) fn cards(&self) -> Vec<Rect> {
        let screen = self.camera.screen;
        let banner = (self.cards.map_top - screen.top()).max(0.0);
        let buttons = self.cards.buttons.translate(vec2(0.0, -banner));
        let pinned = self
            .cards
            .pinned_probe
            .filter(|_| self.has_room_for_cards());
        let cards = [
            Some(self.scale_bar_room()),
            pinned,
            Some(buttons),
            self.compass_below(buttons.bottom()),
            self.legends_place(),
        ];
        cards
            .into_iter()
            .flatten()
            .filter(|card| card.is_positive() && card.intersects(screen))
            .collect()
    }

    pub fn notice_room(&self) -> Option<NoticeRoom> {
        if !self.has_room_for_cards() {
            return None;
        }
        let legends = self.legends_place();
        let occluders = self.cards.occluders.iter().copied().chain(legends);
        let occluders = occluders.chain(self.cards.vehicle);
        let whole = self.camera.screen.shrink(CARD_MARGIN);
        // Beside the legends: above them the notice would be near the vehicle.
        let beside = legends.map(|legends| whole.with_max_x(legends.left() - CARD_MARGIN));
        let beside = beside.filter(|beside| beside.width() >= MIN_CARD_WIDTH);
        Some(NoticeRoom {
            place: beside.unwrap_or(whole),
            taken: occluders.chain([self.scale_bar_room()]).collect(),
        })
    }

    /// Draws the probe card, unless it would cover the vehicle at both places.
    pub(super) fn probe_ui(
        &mut self,
        ui: &Ui,
        probed_place: Option<Pos2>,
        model: &ConsoleModel,
        now: Monotonic,
    ) {
        self.cards.pinned_probe = None;
        let probed_m = probed_place.map(|at| self.camera.to_odom(at));
        let Some(point_m) = self.pinned_m.or(probed_m) else {
            return;
        };
        let data = ProbeData::new(model, self.stack(), point_m, now);
        let is_pinned = self.pinned_m.is_some();
        let point = self.camera.to_screen(point_m);
        let mut anchors = self.probe_card_anchors().to_vec();
        let place = |(corner, align, _): &(Pos2, Align2, f32)| {
            align.anchor_size(*corner, self.cards.probe_size)
        };
        anchors.retain(|anchor| !self.hides_vehicle(place(anchor)));
        let is_clear =
            |anchor: &&(Pos2, Align2, f32)| !place(anchor).expand(POINTER).contains(point);
        let anchor = anchors.iter().find(is_clear).or(anchors.first());
        let Some((corner, align, width)) = anchor.copied() else {
            return;
        };
        let card = Area::new(Id::unique("map probe"))
            .fixed_pos(corner)
            .pivot(align)
            .constrain_to(self.camera.screen)
            .order(Order::Background)
            .interactable(is_pinned)
            .show(ui.ctx(), |ui| {
                let is_narrow = self.camera.screen.width() < NARROW;
                probe::probe_card_ui(ui, &data, is_pinned, (width, is_narrow))
            });
        let place = card.response.rect;
        self.cards.probe_size = place.size();
        self.cards.pinned_probe = is_pinned.then_some(place);
        self.cards.occluders.push(place);
        if card.inner {
            self.pinned_m = None;
        }
    }

    /// Corner, alignment and greatest width of the probe card: in the lower left corner, and in the upper left one. The
    /// legends and the compass are to its right if there is enough width.
    fn probe_card_anchors(&self) -> [(Pos2, Align2, f32); 2] {
        let screen = self.camera.screen;
        let left = screen.left() + CARD_MARGIN;
        let bottom = screen.bottom() - OVER_SCALE_BAR;
        let legends = self.legends_place();
        let right = legends.map_or(screen.right(), |legends| legends.left()) - CARD_MARGIN;
        let lower = match legends {
            Some(legends) if right - left < MIN_CARD_WIDTH => {
                let bottom = bottom.min(legends.top() - CARD_MARGIN);
                let width = screen.width() - 2.0 * CARD_MARGIN;
                (pos2(left, bottom), Align2::LEFT_BOTTOM, width)
            }
            _ => (pos2(left, bottom), Align2::LEFT_BOTTOM, right - left),
        };
        let top = self.cards.buttons.bottom().max(self.cards.map_top) + CARD_MARGIN;
        let right = screen.right() - 2.0 * CARD_MARGIN - COMPASS_SIZE;
        let upper = (pos2(left, top), Align2::LEFT_TOP, (right - left).max(0.0));
        [lower, upper]
    }

    /// Banner of a silent robot.
    pub(super) fn banner_ui(&mut self, ui: &mut Ui, stale: Option<&StaleData>) {
        let screen = self.camera.screen;
        let before = std::mem::replace(&mut self.cards.map_top, screen.top());
        if let Some(stale) = stale {
            let whole = UiBuilder::new()
                .max_rect(screen)
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
            // Blocks clicks on the map below.
            let id = ui.scope_id().with("banner");
            ui.interact(banner, id, Sense::CLICK | Sense::DRAG);
            self.cards.occluders.push(banner);
            // On a very low map the buttons are over the banner.
            let lowest = (screen.bottom() - 2.0 * CARD_MARGIN).max(screen.top());
            self.cards.map_top = banner.bottom().min(lowest);
        }
        if (self.cards.map_top - before).abs() > 0.5 {
            // The cards follow the buttons.
            ui.ctx().request_repaint();
        }
    }

    /// Draws the buttons in the upper right corner. They fold if they would cover the vehicle, in the corner that is
    /// farther from it.
    pub(super) fn buttons_ui(&mut self, ui: &mut Ui, model: &ConsoleModel) -> Option<Look> {
        let screen = self.camera.screen;
        let mut room = screen.with_min_y(self.cards.map_top).shrink(CARD_MARGIN);
        let whole = Align2::RIGHT_TOP.anchor_size(room.right_top(), self.cards.whole_buttons);
        let is_folded = self.folds(whole);
        let vehicle = self.cards.vehicle.filter(|_| is_folded);
        if vehicle.is_some_and(|vehicle| vehicle.center().x > screen.center().x) {
            room.max.x = room.right().min(screen.left() + FOLDED_BUTTONS);
        }
        let room = UiBuilder::new()
            .max_rect(room)
            .layout(Layout::top_down(Align::Max));
        let sets = |purpose| self.pose_tool.is_some_and(|tool| tool.purpose == purpose);
        let data = ToolbarData {
            camera_mode: self.settings.camera_mode,
            orientation: self.settings.orientation,
            has_grid: self.settings.has(Overlay::Grid),
            is_measuring: self.ruler.is_some(),
            is_setting_pose: can_set_pose(model).then_some(sets(PosePurpose::Locate)),
            goal: self.goal_offer.button(sets(PosePurpose::Goal)),
            is_folded,
        };
        let buttons = ui.scope_builder(room, |ui| toolbar::toolbar_ui(ui, data));
        self.cards.buttons = buttons.response.rect;
        if !is_folded {
            self.cards.whole_buttons = self.cards.buttons.size();
        }
        self.cards.occluders.push(self.cards.buttons);
        buttons.inner
    }

    pub(super) fn compass_ui(&mut self, ui: &Ui, model: &ConsoleModel) -> Option<Look> {
        let rect = self.compass_below(self.cards.buttons.bottom())?;
        let data = CompassData {
            north: self.camera.direction(FRAC_PI_2),
            is_on_earth: knows_north(model),
            orientation: self.settings.orientation,
        };
        self.cards.occluders.push(rect);
        grid::compass_ui(ui, rect, data).then(|| Look::Up(self.settings.orientation.other()))
    }

    /// Draws the legends, unless they would cover the vehicle.
    pub(super) fn legend_ui(&mut self, ui: &Ui, model: &ConsoleModel, is_old: bool) {
        if self.legends.place.is_some_and(|place| self.folds(place)) {
            return;
        }
        let shown = MapLayers::shown(self.stack(), model.map().store());
        let palettes = shown.iter().rev();
        let palettes: Vec<_> = palettes
            .map(|(held, is_over)| (self.layers.palette(held.layer), *is_over))
            .collect();
        // The buttons are drawn later, and are not lower than this.
        let buttons = self.cards.map_top + CARD_MARGIN + toolbar::HEIGHT;
        let map = LegendPlace {
            screen: self.camera.screen,
            buttons,
            compass: self.compass_below(buttons),
        };
        let marks = self.marks(model).into_iter();
        let marks: Vec<_> = marks
            .map(|mark| (mark, self.mark_color(mark, is_old)))
            .collect();
        let drawn = Drawn {
            palettes: &palettes,
            marks: &marks,
        };
        self.legends.show(ui, &map, drawn);
    }
}

/// Rectangles of `screen` without cards; all that cannot be larger are among them.
pub(super) fn free_parts(screen: Rect, cards: &[Rect]) -> Vec<Rect> {
    let edges = |first: f32, of: fn(&Rect) -> f32| -> Vec<f32> {
        iter::once(first).chain(cards.iter().map(of)).collect()
    };
    let lefts = edges(screen.left(), Rect::right);
    let rights = edges(screen.right(), Rect::left);
    let tops = edges(screen.top(), Rect::bottom);
    let bottoms = edges(screen.bottom(), Rect::top);
    let columns = lefts
        .iter()
        .flat_map(|left| rights.iter().map(move |right| (*left, *right)));
    let rows = || {
        tops.iter()
            .flat_map(|top| bottoms.iter().map(move |bottom| (*top, *bottom)))
    };
    let parts = columns.flat_map(|(left, right)| {
        rows().map(move |(top, bottom)| Rect::from_min_max(pos2(left, top), pos2(right, bottom)))
    });
    let is_free = |part: &Rect| {
        // Their edges may touch.
        let inside = part.shrink(0.5);
        inside.is_positive() && !cards.iter().any(|card| card.intersects(inside))
    };
    parts.filter(is_free).collect()
}

pub(super) fn knows_north(model: &ConsoleModel) -> bool {
    model.shores().is_some_and(|shores| shores.datum.is_some())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn largest_parts_without_cards() {
        let rect =
            |left, top, right, bottom| Rect::from_min_max(pos2(left, top), pos2(right, bottom));
        let screen = rect(0.0, 0.0, 400.0, 300.0);
        assert_eq!(free_parts(screen, &[]), [screen]);
        let legends = rect(250.0, 200.0, 400.0, 300.0);
        let parts = free_parts(screen, &[legends]);
        for expected in [rect(0.0, 0.0, 250.0, 300.0), rect(0.0, 0.0, 400.0, 200.0)] {
            assert!(parts.contains(&expected), "{expected} of {parts:?}");
        }
        let buttons = rect(100.0, 0.0, 400.0, 40.0);
        let scale_bar = rect(0.0, 240.0, 190.0, 300.0);
        let cards = [legends, buttons, scale_bar];
        let parts = free_parts(screen, &cards);
        assert!(parts.contains(&rect(0.0, 40.0, 400.0, 200.0)), "{parts:?}");
        assert!(parts.contains(&rect(0.0, 0.0, 100.0, 240.0)), "{parts:?}");
        let between = rect(190.0, 40.0, 250.0, 300.0);
        assert!(parts.contains(&between), "{parts:?}");
        for part in &parts {
            assert!(screen.contains_rect(*part), "{part}");
            let card = cards.iter().find(|card| card.shrink(0.5).intersects(*part));
            assert_eq!(card, None, "{part}");
        }
        assert!(free_parts(screen, &[screen]).is_empty());
    }
}
