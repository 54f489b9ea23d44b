//! The card with the legends, on the map. Where they would hide much of it, those of the upper layers are shown, on a
//! narrow map that of the uppermost alone; and a button in the row of the first title opens the others. Where not even
//! that has room beside buttons and compass, the button stands alone.

use eframe::egui::accesskit::Role;
use eframe::egui::{
    Align2, Area, Button, Frame, Id, LayerId, Order, Rect, RichText, ScrollArea, Sense, TextStyle,
    TextWrapMode, Ui, UiBuilder, WidgetInfo, vec2,
};
use protocol::layer::Palette;

use super::legend_place::LegendPlace;
use super::map_controls::LEAST_FOR_CARDS;
use super::scroll_keys::ScrollKeys;
use crate::panels::layers::layer_name;
use crate::panels::legend::{
    LINES_APART, LegendsData, legends_height, legends_ui, title_height, title_ui,
};
use crate::theme;

/// Within the card, and beside the words on the button, points.
const PADDING: f32 = 8.0;
/// Legends are this wide, points, where the map is not narrow.
const WIDTH: f32 = 220.0;
/// Of the width of a narrow map, they have this share at most, and that one at least: in between, what the shortest scale bar
/// leaves, which is beside them, with margins and paddings, points.
const WIDTH_SHARES: [f32; 2] = [0.57, 0.45];
const BESIDE: f32 = 116.0;
/// Legends that nobody has opened cover this share of the map at most, where one alone does.
const MAP_SHARE: f32 = 0.2;
/// Height of the button, points, and between it and the title that it stands beside.
const BUTTON: f32 = 20.0;
const BUTTON_GAP: f32 = 4.0;
/// Where the button stood alone, legends that are opened have so much height at least, points: two lines below it.
const LEAST_OPENED: f32 = 60.0;

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

    /// Draws the card in the lower right corner of `map`. `layers`: those that are drawn, the uppermost first.
    pub(super) fn show(&mut self, ui: &Ui, map: &LegendPlace, layers: &[Drawn]) {
        self.place = None;
        let is_on_button = std::mem::take(&mut self.is_on_button);
        if layers.is_empty() {
            return;
        }
        let screen = map.screen;
        let fitting = fitting(ui, map, layers);
        let button = (fitting < layers.len()).then(|| button_width(ui, layers, fitting));
        let least = if fitting > 0 { 0.0 } else { LEAST_OPENED };
        let opened = button.and_then(|_| map.opened(vec2(width(screen), least)));
        let opened = opened.filter(|_| self.has_all);
        let shown = opened.map_or(fitting, |_| layers.len());
        if shown > 0 {
            let content = Content::new(ui, screen, layers, (shown, button));
            let corner = opened.unwrap_or_else(|| map.below()).right_bottom();
            let opened = opened.map(|room| {
                let others = 2.0 * PADDING + content.head_height(ui);
                (room.height() - others).max(0.0)
            });
            let card = Area::new(Id::unique(CARD_NAME))
                .fixed_pos(corner)
                .pivot(Align2::RIGHT_BOTTOM)
                .constrain_to(screen)
                .order(Order::Background)
                // Hands reach through it to the map, unless it may have to be scrolled.
                .interactable(opened.is_some())
                .show(ui.ctx(), |ui| {
                    let card = Frame::new()
                        .fill(theme::card(ui.visuals()))
                        .corner_radius(4.0)
                        .inner_margin(PADDING);
                    card.show(ui, |ui| content.show(ui, opened, is_on_button));
                });
            self.place = Some(card.response.rect);
        }
        let Some(width) = button else {
            return;
        };
        // In an area of its own, for hands reach through the card.
        let place = if let Some(card) = self.place {
            let corner = card.right_top() + vec2(-PADDING, PADDING);
            Some((corner, Align2::RIGHT_TOP))
        } else {
            let corner = map.button(vec2(width, BUTTON));
            corner.map(|corner| (corner, Align2::RIGHT_BOTTOM))
        };
        let Some((at, pivot)) = place else {
            return;
        };
        let is_alone = self.place.is_none();
        let button = Area::new(Id::unique(BUTTON_NAME))
            .fixed_pos(at)
            .pivot(pivot)
            .constrain_to(screen)
            .order(Order::Background)
            .show(ui.ctx(), |ui| {
                more_ui(ui, (layers, fitting), is_alone, opened.is_some())
            });
        let (is_pressed, has_keyboard) = button.inner;
        if is_pressed {
            self.has_all = opened.is_none();
        }
        if !is_alone {
            // Who scrolls the card would lay it over the button.
            let [card, button] = [CARD_NAME, BUTTON_NAME]
                .map(|name| LayerId::new(Order::Background, Id::unique(name)));
            ui.ctx().set_sublayer(card, button);
        }
        self.is_on_button = has_keyboard;
        let button = button.response.rect;
        self.place = Some(self.place.map_or(button, |card| card.union(button)));
    }
}

/// What the card shows.
struct Content {
    /// The first title, where it stands beside the button, and what that leaves it, points. One that would be broken there
    /// is empty: it stands below, where it has the whole width.
    head: Option<(String, f32)>,
    /// What is below it.
    legends: LegendsData,
    /// Of the card within its padding, points.
    width: f32,
}

impl Content {
    /// Legends of so many of the layers, beside a button that is so wide where there is one.
    fn new(ui: &Ui, screen: Rect, layers: &[Drawn], (shown, beside): (usize, Option<f32>)) -> Self {
        let width = inner_width(screen);
        let is_narrow = is_narrow(screen);
        let mut legends = if is_narrow {
            // What is unknown is said with the lowest, whether that is shown or not.
            let mut all = LegendsData::with_short_titles(layers.iter().copied());
            all.legends.truncate(shown);
            all
        } else {
            LegendsData::new(layers[..shown].iter().copied())
        };
        let head = beside.map(|button| {
            let left = (width - button - BUTTON_GAP).max(0.0);
            let is_beside = !is_narrow || legends.first_title_fits(ui, left);
            let title = is_beside.then(|| legends.take_first_title());
            (title.unwrap_or_default(), left)
        });
        Self {
            head,
            legends,
            width,
        }
    }

    /// Of the row with the first title and the button, and of the gap below it, points.
    fn head_height(&self, ui: &Ui) -> f32 {
        self.head.as_ref().map_or(0.0, |(title, left)| {
            title_height(ui, title, *left).max(BUTTON) + LINES_APART
        })
    }

    fn height(&self, ui: &Ui) -> f32 {
        self.head_height(ui) + legends_height(ui, &self.legends, self.width)
    }

    /// Draws it. Where it is `opened`, what is below its head has so much height, points.
    fn show(&self, ui: &mut Ui, opened: Option<f32>, is_on_button: bool) {
        ui.set_width(self.width);
        ui.spacing_mut().item_spacing.y = 0.0;
        self.head_ui(ui);
        let Some(most) = opened else {
            return legends_ui(ui, &self.legends);
        };
        // An area has room for what was in it before, and what scrolls would never ask for more.
        let legends = legends_height(ui, &self.legends, self.width);
        let height = legends.min(most);
        let scroll = ScrollArea::vertical()
            .max_height(height)
            .min_scrolled_height(height);
        let keys = ScrollKeys {
            label: "Legends; Page Up and Page Down scroll them",
            is_needed: legends > height + 1.0,
            is_on_button,
        };
        keys.show(ui, (height, scroll), |ui| legends_ui(ui, &self.legends));
    }

    fn head_ui(&self, ui: &mut Ui) {
        let Some((title, left)) = &self.head else {
            return;
        };
        let size = vec2(self.width, self.head_height(ui));
        let (row, _) = ui.allocate_exact_size(size, Sense::hover());
        if title.is_empty() {
            return;
        }
        // A title of one line stands in the middle of its row.
        let above = 0.5 * (BUTTON - title_height(ui, title, *left)).max(0.0);
        let place = Rect::from_min_size(row.min + vec2(0.0, above), vec2(*left, row.height()));
        let mut beside = ui.new_child(UiBuilder::new().max_rect(place));
        title_ui(&mut beside, title);
    }
}

fn inner_width(screen: Rect) -> f32 {
    let [most, least] = WIDTH_SHARES.map(|share| share * screen.width());
    let narrow = most.min(screen.width() - BESIDE).max(least);
    WIDTH.min(narrow)
}

fn is_narrow(screen: Rect) -> bool {
    inner_width(screen) < WIDTH
}

/// Of the card on a map that is so large, points.
pub(super) fn width(screen: Rect) -> f32 {
    inner_width(screen) + 2.0 * PADDING
}

/// How many legends there is room for beside buttons and compass: where one is, that is shown, but where a map is so
/// small that even that would hide it. A narrow map has one.
fn fitting(ui: &Ui, map: &LegendPlace, layers: &[Drawn]) -> usize {
    let screen = map.screen;
    let height = |count: usize| {
        let beside = (count < layers.len()).then(|| button_width(ui, layers, count));
        2.0 * PADDING + Content::new(ui, screen, layers, (count, beside)).height(ui)
    };
    let room = map.below().height();
    let most = MAP_SHARE * screen.area() / width(screen);
    let is_tiny = screen.width() < LEAST_FOR_CARDS[0] || screen.height() < LEAST_FOR_CARDS[1];
    let least = usize::from(!is_tiny && height(1) <= room);
    let greatest = if is_narrow(screen) { 1 } else { layers.len() };
    let fits = |count: &usize| height(*count) <= most.min(room);
    (1..=greatest).rev().find(fits).unwrap_or(least)
}

/// Words on the button where so many legends are left out, and where they are opened.
fn words(count: usize, are_all: bool) -> [String; 2] {
    let more = match (are_all, count) {
        (true, 1) => "Legend".to_owned(),
        (true, _) => "Legends".to_owned(),
        (false, _) => format!("{count} more"),
    };
    [more, "Fewer".to_owned()]
}

/// Of the button, whatever it says, points.
fn button_width(ui: &Ui, layers: &[Drawn], fitting: usize) -> f32 {
    let font = TextStyle::Small.resolve(ui.style());
    let ink = ui.visuals().text_color();
    let words = words(layers.len() - fitting, fitting == 0);
    let widths = words.map(|words| {
        let text = ui.painter().layout_no_wrap(words, font.clone(), ink);
        text.size().x + 2.0 * PADDING
    });
    widths.into_iter().fold(0.0, f32::max)
}

/// The button that opens the legends that are left out, and closes them where they are opened; whether it was pressed,
/// and whether it has the keyboard. Alone on the map it has paper of its own.
fn more_ui(
    ui: &mut Ui,
    (layers, fitting): (&[Drawn], usize),
    is_alone: bool,
    are_opened: bool,
) -> (bool, bool) {
    let left_out = &layers[fitting..];
    let (count, are_all) = (left_out.len(), fitting == 0);
    let [more, fewer] = words(count, are_all);
    let names: Vec<_> = left_out
        .iter()
        .map(|(palette, _)| layer_name(palette.layer()))
        .collect();
    let (legends, names) = (
        if count == 1 { "legend" } else { "legends" },
        names.join(", "),
    );
    let hint = match (are_opened, are_all) {
        (true, _) => "Fewer legends".to_owned(),
        (false, true) => format!("{more}: {names}"),
        (false, false) => format!("{more} {legends}: {names}"),
    };
    if is_alone {
        let paper = theme::card(ui.visuals());
        let visuals = &mut ui.visuals_mut().widgets;
        for widget in [
            &mut visuals.inactive,
            &mut visuals.hovered,
            &mut visuals.active,
        ] {
            widget.weak_bg_fill = paper;
        }
    }
    ui.spacing_mut().button_padding = vec2(PADDING, 2.0);
    ui.spacing_mut().interact_size.y = BUTTON;
    let words = if are_opened { fewer } else { more };
    let button = Button::new(RichText::new(words).small());
    // An area begins as wide as it was, when other words stood in it, or in another type.
    let button = ui.add(button.wrap_mode(TextWrapMode::Extend));
    button.widget_info(|| WidgetInfo::labeled(Role::Button, true, &hint));
    let has_keyboard = button.has_focus();
    (button.on_hover_text(hint).clicked(), has_keyboard)
}
