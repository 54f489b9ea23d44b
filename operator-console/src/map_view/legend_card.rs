//! Legends on the map, in the lower right corner below the compass. On small maps only those of the upper layers are
//! shown, and a button opens the others. On very small maps there is only the button.

use eframe::egui::accesskit::Role;
use eframe::egui::style::ScrollAnimation;
use eframe::egui::{
    Align2, Area, Button, Color32, Id, Key, LayerId, Modifiers, Order, Pos2, Rect, RichText,
    ScrollArea, Sense, StrokeKind, TextStyle, TextWrapMode, Ui, UiBuilder, Vec2, WidgetInfo, pos2,
    vec2,
};
use protocol::layer::Palette;

use super::cards::MIN_MAP_FOR_CARDS;
use super::marks::Mark;
use super::{CARD_MARGIN, card_frame};
use crate::panels::layers::layer_name;
use crate::panels::legend::{
    LINES_APART, LegendsData, legends_height, legends_ui, title_height, title_ui,
};
use crate::theme;

const PADDING: f32 = 8.0;
/// On maps that are not narrow, points.
const WIDTH: f32 = 220.0;
/// Maximum and minimum share of a narrow map; in between the scale bar keeps its width, points.
const WIDTH_SHARES: [f32; 2] = [0.57, 0.45];
const BESIDE: f32 = 116.0;
/// Closed legends cover at most this share of the map.
const MAP_SHARE: f32 = 0.2;
/// Height of the button, and its gap to the title, points.
const BUTTON: f32 = 20.0;
const BUTTON_GAP: f32 = 4.0;
/// Minimum height of opened legends that have no title row, points.
const LEAST_OPENED: f32 = 60.0;

const CARD_NAME: &str = "map legend";
const BUTTON_NAME: &str = "more legends";

/// What the legends explain.
#[derive(Clone, Copy)]
pub(super) struct Drawn<'a> {
    /// Topmost first, with whether each layer is above another.
    pub(super) palettes: &'a [(Palette, bool)],
    pub(super) marks: &'a [(Mark, Color32)],
}

impl Drawn<'_> {
    /// Number of legends: the marks have one.
    fn count(self) -> usize {
        self.palettes.len() + usize::from(!self.marks.is_empty())
    }

    /// Names of all legends after the first `shown`.
    fn left_out(self, shown: usize) -> Vec<&'static str> {
        let layers = self.palettes.iter();
        let names = layers.map(|(palette, _)| layer_name(palette.layer()));
        let marks = (!self.marks.is_empty()).then_some("Marks");
        names.chain(marks).skip(shown).collect()
    }
}

#[derive(Default)]
pub(super) struct LegendCard {
    has_all: bool,
    pub(super) place: Option<Rect>,
    /// Whether the button had the focus in the last frame: then keys scroll the legends.
    is_on_button: bool,
}

impl LegendCard {
    pub(super) fn show(&mut self, ui: &Ui, map: &LegendPlace, drawn: Drawn<'_>) {
        self.place = None;
        let is_on_button = std::mem::take(&mut self.is_on_button);
        if drawn.count() == 0 {
            return;
        }
        let screen = map.screen;
        let fitting = fitting(ui, map, drawn);
        let button = (fitting < drawn.count()).then(|| button_width(ui, drawn, fitting));
        let least = if fitting > 0 { 0.0 } else { LEAST_OPENED };
        let opened = button.and_then(|_| map.opened(vec2(width(screen), least)));
        let opened = opened.filter(|_| self.has_all);
        let shown = opened.map_or(fitting, |_| drawn.count());
        if shown > 0 {
            let content = Content::new(ui, screen, drawn, (shown, button));
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
                // The map gets clicks through the card, unless the card scrolls.
                .interactable(opened.is_some())
                .show(ui.ctx(), |ui| {
                    let card = card_frame(ui, PADDING);
                    card.show(ui, |ui| content.show(ui, opened, is_on_button));
                });
            self.place = Some(card.response.rect);
        }
        let Some(width) = button else {
            return;
        };
        // The button has its own area, because the card ignores clicks.
        let (at, pivot) = if let Some(card) = self.place {
            (
                card.right_top() + vec2(-PADDING, PADDING),
                Align2::RIGHT_TOP,
            )
        } else if let Some(corner) = map.button(vec2(width, BUTTON)) {
            (corner, Align2::RIGHT_BOTTOM)
        } else {
            return;
        };
        let is_alone = self.place.is_none();
        let button = Area::new(Id::unique(BUTTON_NAME))
            .fixed_pos(at)
            .pivot(pivot)
            .constrain_to(screen)
            .order(Order::Background)
            .show(ui.ctx(), |ui| {
                more_ui(ui, (drawn, fitting), is_alone, opened.is_some())
            });
        let (is_pressed, has_keyboard) = button.inner;
        if is_pressed {
            self.has_all = opened.is_none();
        }
        if !is_alone {
            // The button stays above a scrolled card.
            let [card, button] = [CARD_NAME, BUTTON_NAME]
                .map(|name| LayerId::new(Order::Background, Id::unique(name)));
            ui.ctx().set_sublayer(card, button);
        }
        self.is_on_button = has_keyboard;
        let button = button.response.rect;
        self.place = Some(self.place.map_or(button, |card| card.union(button)));
    }
}

struct Content {
    /// Title beside the button and its width, points. A title that does not fit is empty here and drawn below.
    head: Option<(String, f32)>,
    legends: LegendsData,
    /// Without padding, points.
    width: f32,
}

impl Content {
    /// `shown` legends, with the width of the button beside them.
    fn new(ui: &Ui, screen: Rect, drawn: Drawn<'_>, (shown, beside): (usize, Option<f32>)) -> Self {
        let width = inner_width(screen);
        let is_narrow = is_narrow(screen);
        let palettes = drawn.palettes.iter().copied();
        let mut legends = if is_narrow {
            // "Unknown" belongs to the lowest layer, shown or not.
            let mut all = LegendsData::with_short_titles(palettes);
            all.legends.truncate(shown);
            all
        } else {
            LegendsData::new(palettes.take(shown))
        };
        if shown > drawn.palettes.len() {
            legends.add_marks(drawn.marks);
        }
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

    fn head_height(&self, ui: &Ui) -> f32 {
        self.head.as_ref().map_or(0.0, |(title, left)| {
            title_height(ui, title, *left).max(BUTTON) + LINES_APART
        })
    }

    fn height(&self, ui: &Ui) -> f32 {
        self.head_height(ui) + legends_height(ui, &self.legends, self.width)
    }

    /// `opened`: the height of opened legends, points.
    fn show(&self, ui: &mut Ui, opened: Option<f32>, is_on_button: bool) {
        ui.set_width(self.width);
        ui.spacing_mut().item_spacing.y = 0.0;
        self.head_ui(ui);
        let Some(most) = opened else {
            return legends_ui(ui, &self.legends);
        };
        let whole = legends_height(ui, &self.legends, self.width);
        let height = whole.min(most);
        let is_needed = whole > height + 1.0;
        let legends = |ui: &mut Ui| legends_ui(ui, &self.legends);
        scroll_ui(ui, height, (is_needed, is_on_button), legends);
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
        // One-line titles are centred in their row.
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

pub(super) fn width(screen: Rect) -> f32 {
    inner_width(screen) + 2.0 * PADDING
}

/// Number of legends that fit. At least one if the map is large enough; one on a narrow map.
fn fitting(ui: &Ui, map: &LegendPlace, drawn: Drawn<'_>) -> usize {
    let screen = map.screen;
    let height = |count: usize| {
        let beside = (count < drawn.count()).then(|| button_width(ui, drawn, count));
        2.0 * PADDING + Content::new(ui, screen, drawn, (count, beside)).height(ui)
    };
    let room = map.below().height();
    let most = MAP_SHARE * screen.area() / width(screen);
    let is_tiny = screen.width() < MIN_MAP_FOR_CARDS[0] || screen.height() < MIN_MAP_FOR_CARDS[1];
    let least = usize::from(!is_tiny && height(1) <= room);
    let greatest = if is_narrow(screen) { 1 } else { drawn.count() };
    let fits = |count: &usize| height(*count) <= most.min(room);
    (1..=greatest).rev().find(fits).unwrap_or(least)
}

fn words(count: usize, are_all: bool) -> [String; 2] {
    let more = match (are_all, count) {
        (true, 1) => "Legend".to_owned(),
        (true, _) => "Legends".to_owned(),
        (false, _) => format!("{count} more"),
    };
    [more, "Fewer".to_owned()]
}

fn button_width(ui: &Ui, drawn: Drawn<'_>, fitting: usize) -> f32 {
    let font = TextStyle::Small.resolve(ui.style());
    let ink = ui.visuals().text_color();
    let widths = words(drawn.count() - fitting, fitting == 0).map(|words| {
        let text = ui.painter().layout_no_wrap(words, font.clone(), ink);
        text.size().x + 2.0 * PADDING
    });
    widths[0].max(widths[1])
}

/// The button that opens and closes the legends. Returns whether it was pressed and whether it has the focus.
fn more_ui(
    ui: &mut Ui,
    (drawn, fitting): (Drawn<'_>, usize),
    is_alone: bool,
    are_opened: bool,
) -> (bool, bool) {
    let left_out = drawn.left_out(fitting);
    let (count, are_all) = (left_out.len(), fitting == 0);
    let [more, fewer] = words(count, are_all);
    let names = left_out.join(", ");
    let legends = if count == 1 { "legend" } else { "legends" };
    let hint = match (are_opened, are_all) {
        (true, _) => "Fewer legends".to_owned(),
        (false, true) => format!("{more}: {names}"),
        (false, false) => format!("{more} {legends}: {names}"),
    };
    if is_alone {
        let paper = theme::card(ui.visuals());
        let widgets = &mut ui.visuals_mut().widgets;
        widgets.inactive.weak_bg_fill = paper;
        widgets.hovered.weak_bg_fill = paper;
        widgets.active.weak_bg_fill = paper;
    }
    ui.spacing_mut().button_padding = vec2(PADDING, 2.0);
    ui.spacing_mut().interact_size.y = BUTTON;
    let words = if are_opened { fewer } else { more };
    let button = Button::new(RichText::new(words).small());
    // Without wrapping, because an area starts with the width of the last frame.
    let button = ui.add(button.wrap_mode(TextWrapMode::Extend));
    button.widget_info(|| WidgetInfo::labeled(Role::Button, true, &hint));
    let has_keyboard = button.has_focus();
    (button.on_hover_text(hint).clicked(), has_keyboard)
}

const LEAST_GAP: f32 = 4.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LegendPlace {
    pub(super) screen: Rect,
    pub(super) buttons: f32,
    pub(super) compass: Option<Rect>,
}

impl LegendPlace {
    fn top_widgets_bottom(&self) -> f32 {
        let compass = self
            .compass
            .map_or(self.buttons, |compass| compass.bottom());
        compass.max(self.buttons)
    }

    pub(super) fn below(&self) -> Rect {
        let whole = self.screen.shrink(CARD_MARGIN);
        let top = self.top_widgets_bottom() + CARD_MARGIN;
        whole.with_min_y(top.min(whole.bottom()))
    }

    fn beside(&self) -> Rect {
        let whole = self.screen.shrink(CARD_MARGIN);
        let right = self.compass.map_or(whole.right(), |compass| {
            whole.right().min(compass.left() - LEAST_GAP)
        });
        let top = self.buttons + LEAST_GAP;
        let left = self.screen.left() + LEAST_GAP;
        let corner = pos2(right.max(left), whole.bottom());
        Rect::from_min_max(pos2(left, top.min(corner.y)), corner)
    }

    /// Area for opened legends of this minimum size: below the compass, or beside it; `None` if too small.
    pub(super) fn opened(&self, least: Vec2) -> Option<Rect> {
        let rooms = [self.below(), self.beside()];
        let has_room = |room: &Rect| room.width() >= least.x && room.height() >= least.y;
        rooms.into_iter().find(has_room)
    }

    /// Lower right corner of the button if no legend fits: below the compass, or beside it; `None` if too small.
    pub(super) fn button(&self, size: Vec2) -> Option<Pos2> {
        let (screen, whole) = (self.screen, self.screen.shrink(CARD_MARGIN));
        let lowest = self.top_widgets_bottom() + LEAST_GAP + size.y;
        if lowest + LEAST_GAP <= screen.bottom() {
            return Some(pos2(whole.right(), lowest.max(whole.bottom())));
        }
        let beside = self.beside();
        let has_room = beside.width() >= size.x && beside.height() >= size.y;
        has_room.then(|| beside.right_bottom())
    }
}

const PAGE: f32 = 0.8;
const FRAME: f32 = 3.0;

/// Draws an area of this height that scrolls by Page Up and Page Down, because arrow keys drive. `is_needed`: the
/// content is higher than the area. `is_on_button`: the legend button has the focus, and keys scroll, too.
fn scroll_ui(
    ui: &mut Ui,
    height: f32,
    (is_needed, is_on_button): (bool, bool),
    add: impl FnOnce(&mut Ui),
) {
    // A scroll area must get its height explicitly: it would keep that of the last frame.
    let scroll = ScrollArea::vertical()
        .max_height(height)
        .min_scrolled_height(height);
    if !is_needed {
        scroll.show(ui, add);
        return;
    }
    // Before its content, so that it gets the focus first.
    let size = vec2(ui.available_width(), height);
    let place = Rect::from_min_size(ui.next_widget_position(), size);
    let id = ui.scope_id().with("scrolled by keys");
    let response = ui.interact(place, id, Sense::focusable_noninteractive());
    let label = "Legends; Page Up and Page Down scroll them";
    response.widget_info(|| WidgetInfo::labeled(Role::ScrollView, true, label));
    let pages = if response.has_focus() || is_on_button {
        ui.input_mut(|input| {
            let mut pressed = |key| input.count_and_consume_key(Modifiers::NONE, key) as f32;
            pressed(Key::PageUp) - pressed(Key::PageDown)
        })
    } else {
        0.0
    };
    scroll.show(ui, |ui| {
        if pages.abs() > 0.5 {
            let by = vec2(0.0, pages * PAGE * height);
            ui.scroll_with_delta_animation(by, ScrollAnimation::none());
        }
        add(ui);
    });
    if response.has_focus() {
        let line = ui.visuals().selection.stroke;
        let frame = place.expand(FRAME);
        ui.painter()
            .rect_stroke(frame, 2.0, line, StrokeKind::Inside);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::vec2;

    const BUTTON: Vec2 = vec2(65.0, 20.0);

    fn map(width: f32, height: f32, banner: f32) -> LegendPlace {
        let compass = pos2(width - CARD_MARGIN - 44.0, banner + 48.0 + CARD_MARGIN);
        LegendPlace {
            screen: Rect::from_min_size(Pos2::ZERO, vec2(width, height)),
            buttons: banner + 48.0,
            compass: Some(Rect::from_min_size(compass, vec2(44.0, 44.0))),
        }
    }

    #[test]
    fn place_of_the_legend_button() {
        for (height, banner, expected) in [
            (300.0, 0.0, Some(pos2(201.0, 288.0))),
            (140.0, 0.0, Some(pos2(201.0, 128.0))),
            (134.0, 0.0, Some(pos2(201.0, 128.0))),
            (131.0, 0.0, Some(pos2(153.0, 119.0))),
            (168.0, 80.0, Some(pos2(153.0, 156.0))),
            (168.0, 90.0, None),
        ] {
            let map = map(213.0, height, banner);
            let corner = map.button(BUTTON);
            assert_eq!(corner, expected, "{height}, {banner}");
            if let Some(corner) = corner {
                let button = Rect::from_min_max(corner - BUTTON, corner);
                assert!(!button.intersects(map.compass.unwrap()), "{button}");
                assert!(
                    button.top() > map.buttons && map.screen.contains_rect(button),
                    "{button}"
                );
            }
        }
        assert_eq!(map(120.0, 120.0, 0.0).button(BUTTON), None);
        let bare = LegendPlace {
            compass: None,
            ..map(120.0, 120.0, 0.0)
        };
        assert_eq!(bare.button(BUTTON), Some(pos2(108.0, 108.0)));
    }

    #[test]
    fn opened_legends_may_be_beside_the_compass() {
        let least = vec2(113.0, 60.0);
        let high = map(213.0, 300.0, 0.0);
        assert_eq!(high.opened(least), Some(high.below()));
        assert!((high.below().top() - 116.0).abs() < 1e-3);
        let low = map(213.0, 168.0, 0.0);
        let room = low.opened(least).unwrap();
        assert_eq!(room.right_bottom(), pos2(153.0, 156.0));
        assert!(room.top() > low.buttons && room.height() > 100.0, "{room}");
        assert_eq!(map(160.0, 168.0, 0.0).opened(least), None, "too narrow");
        assert_eq!(map(213.0, 110.0, 0.0).opened(least), None, "too low");
    }
}
