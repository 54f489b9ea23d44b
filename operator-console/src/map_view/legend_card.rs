//! The card with the legends, on the map. Where they would hide much of it, those of the upper layers are shown, and a button
//! opens the others.

use eframe::egui::accesskit::Role;
use eframe::egui::{
    Align2, Area, Button, Frame, Id, Order, Rect, RichText, ScrollArea, Ui, WidgetInfo, pos2, vec2,
};
use protocol::layer::Palette;

use super::CARD_MARGIN;
use super::edges::LEAST_FOR_CARDS;
use super::scroll_keys::ScrollKeys;
use crate::panels::layers::layer_name;
use crate::panels::legend::{LegendsData, legends_height, legends_ui};
use crate::theme;

/// Within the card, points.
const PADDING: f32 = 8.0;
/// Legends are this wide, points, where the map is not narrow.
const WIDTH: f32 = 220.0;
/// Of the width of a narrow map, they have this share.
const WIDTH_SHARE: f32 = 0.45;
/// Legends that nobody has opened cover this share of the map at most, where one alone does.
const MAP_SHARE: f32 = 0.2;
/// Height of the button over the card, and between the two, points.
const BUTTON: f32 = 22.0;
const BUTTON_GAP: f32 = 3.0;

/// What the areas of the card and of the button are called.
const CARD_NAME: &str = "map legend";
const BUTTON_NAME: &str = "more legends";

/// A layer's colours, and whether it lies over another.
type Drawn = (Palette, bool);

/// The card from frame to frame.
#[derive(Default)]
pub(super) struct LegendCard {
    /// Whether the operator wants all legends where there is little room for them.
    has_all: bool,
    /// Where it was drawn last, with its button.
    place: Option<Rect>,
    /// Whether the button had the keyboard when it was drawn last: who opened the legends by it need not go elsewhere.
    is_on_button: bool,
}

impl LegendCard {
    /// Where it is on the screen, with its button, as of the last frame that it was drawn in.
    pub(super) const fn place(&self) -> Option<Rect> {
        self.place
    }

    /// Draws the card in the lower right corner of `screen`, of which so many points at its top are taken. `layers`: those
    /// that are drawn, the uppermost first.
    pub(super) fn show(&mut self, ui: &Ui, (screen, top): (Rect, f32), layers: &[Drawn]) {
        self.place = None;
        let is_on_button = std::mem::take(&mut self.is_on_button);
        if layers.is_empty() {
            return;
        }
        let fitting = fitting(ui, screen, layers);
        let shown = if self.has_all { layers.len() } else { fitting };
        let data = data(screen, &layers[..shown]);
        let corner = screen.right_bottom() - vec2(CARD_MARGIN, CARD_MARGIN);
        let is_opened = shown > fitting;
        if shown > 0 {
            let room = screen.height() - top - CARD_MARGIN - BUTTON - BUTTON_GAP - 2.0 * PADDING;
            let card = Area::new(Id::unique(CARD_NAME))
                .fixed_pos(corner)
                .pivot(Align2::RIGHT_BOTTOM)
                .constrain_to(screen)
                .order(Order::Background)
                // Hands reach through it to the map, unless it may have to be scrolled.
                .interactable(is_opened)
                .show(ui.ctx(), |ui| {
                    let card = Frame::new()
                        .fill(theme::card(ui.visuals()))
                        .corner_radius(4.0)
                        .inner_margin(PADDING);
                    card.show(ui, |ui| {
                        ui.set_width(inner_width(screen));
                        if is_opened {
                            // An area has room for what was in it before, and what scrolls would never ask for more.
                            let height =
                                |data: &LegendsData| legends_height(ui, data, inner_width(screen));
                            // No less than what is there while it is closed.
                            let least = height(&self::data(screen, &layers[..fitting.max(1)]));
                            let most = room.max(least).min(
                                screen.height()
                                    - 2.0 * CARD_MARGIN
                                    - BUTTON
                                    - BUTTON_GAP
                                    - 2.0 * PADDING,
                            );
                            let height = height(&data).min(most.max(0.0));
                            let scroll = ScrollArea::vertical()
                                .max_height(height)
                                .min_scrolled_height(height);
                            let legends = legends_height(ui, &data, inner_width(screen));
                            let keys = ScrollKeys {
                                label: "Legends; Page Up and Page Down scroll them",
                                is_needed: legends > height + 1.0,
                                is_on_button,
                            };
                            keys.show(ui, (height, scroll), |ui| legends_ui(ui, &data));
                        } else {
                            legends_ui(ui, &data);
                        }
                    });
                });
            self.place = Some(card.response.rect);
        }
        let left_out = &layers[fitting..];
        if left_out.is_empty() {
            return;
        }
        let bottom = self.place.map_or(corner.y, |card| card.top() - BUTTON_GAP);
        let button = Area::new(Id::unique(BUTTON_NAME))
            .fixed_pos(pos2(corner.x, bottom))
            .pivot(Align2::RIGHT_BOTTOM)
            .constrain_to(screen)
            .order(Order::Background)
            .show(ui.ctx(), |ui| {
                more_ui(ui, (left_out, fitting == 0), &mut self.has_all)
            });
        self.is_on_button = button.inner;
        let button = button.response.rect;
        self.place = Some(self.place.map_or(button, |card| card.union(button)));
    }
}

fn inner_width(screen: Rect) -> f32 {
    WIDTH.min(WIDTH_SHARE * screen.width())
}

/// Of the card on a map that is so large, points.
pub(super) fn width(screen: Rect) -> f32 {
    inner_width(screen) + 2.0 * PADDING
}

fn data(screen: Rect, layers: &[Drawn]) -> LegendsData {
    let layers = layers.iter().copied();
    if inner_width(screen) < WIDTH {
        LegendsData::with_short_titles(layers)
    } else {
        LegendsData::new(layers)
    }
}

/// How many legends there is room for: one at least, but where a map is so small that even that would hide it.
fn fitting(ui: &Ui, screen: Rect, layers: &[Drawn]) -> usize {
    let most = MAP_SHARE * screen.area() / width(screen) - 2.0 * PADDING;
    let fits = |count: &usize| {
        let data = data(screen, &layers[..*count]);
        legends_height(ui, &data, inner_width(screen)) <= most
    };
    let is_tiny = screen.width() < LEAST_FOR_CARDS[0] || screen.height() < LEAST_FOR_CARDS[1];
    let least = usize::from(!is_tiny);
    (1..=layers.len()).rev().find(fits).unwrap_or(least)
}

/// The button that opens the legends that are left out, and closes them; whether it has the keyboard.
fn more_ui(ui: &mut Ui, (left_out, are_all): (&[Drawn], bool), has_all: &mut bool) -> bool {
    let count = left_out.len();
    let words = match (*has_all, are_all, count) {
        (true, ..) => "Fewer".to_owned(),
        (false, true, 1) => "Legend".to_owned(),
        (false, true, _) => "Legends".to_owned(),
        (false, false, _) => format!("{count} more"),
    };
    let names: Vec<_> = left_out
        .iter()
        .map(|(palette, _)| layer_name(palette.layer()))
        .collect();
    let (legends, names) = (
        if count == 1 { "legend" } else { "legends" },
        names.join(", "),
    );
    let hint = match (*has_all, are_all) {
        (true, _) => "Fewer legends".to_owned(),
        (false, true) => format!("{words}: {names}"),
        (false, false) => format!("{words} {legends}: {names}"),
    };
    let paper = theme::card(ui.visuals());
    let visuals = &mut ui.visuals_mut().widgets;
    for widget in [
        &mut visuals.inactive,
        &mut visuals.hovered,
        &mut visuals.active,
    ] {
        widget.weak_bg_fill = paper;
    }
    ui.spacing_mut().button_padding = vec2(PADDING, 2.0);
    ui.spacing_mut().interact_size.y = BUTTON;
    let button = ui.add(Button::new(RichText::new(words).small()));
    button.widget_info(|| WidgetInfo::labeled(Role::Button, true, &hint));
    let has_keyboard = button.has_focus();
    if button.on_hover_text(hint).clicked() {
        *has_all = !*has_all;
    }
    has_keyboard
}
