//! The card with what the map says at a point, and the mark of a point that is pinned.

use eframe::egui::{
    Area, Color32, Frame, Grid, Id, Label, Order, Painter, Pos2, RichText, Stroke, Ui,
};
use measurement::time::Monotonic;

use super::card_place::{CardPlace, Others};
use super::chunks::TILE_CELLS;
use super::map_controls::OVER_SCALE_BAR;
use super::overlays::compass;
use super::probe::ProbeData;
use super::{CARD_MARGIN, MapView};
use crate::model::ConsoleModel;
use crate::panels::layers::layer_name;
use crate::theme;

const INNER: f32 = 8.0;
/// On narrower maps the card says less, so that it has few lines, points.
const NARROW: f32 = 480.0;
/// What ages in the card are those of: once over their column, for all rows.
const TILE_CHANGED: &str = "Tile changed";

impl MapView {
    /// The card with what is read where it was pinned, or where somebody points at, if anywhere.
    pub(super) fn probe_ui(
        &mut self,
        ui: &Ui,
        probed_place: Option<Pos2>,
        model: &ConsoleModel,
        now: Monotonic,
    ) {
        let aimed_at = probed_place.map(|at| self.camera.to_odom(self.screen, at));
        let Some(point_m) = self.pinned_m.or(aimed_at) else {
            return;
        };
        let data = ProbeData::new(model, self.stack(), point_m, now);
        let is_pinned = self.pinned_m.is_some();
        let others = Others {
            screen: self.screen,
            map_top: self.map_top,
            bar: self.screen.bottom() - OVER_SCALE_BAR,
            legend: self.legends_place(),
            buttons: self.buttons,
            compass: self.screen.right() - CARD_MARGIN - compass::SIZE,
        };
        // A card with a button must not flee from the pointer.
        let read = self.camera.to_screen(self.screen, point_m);
        let vehicle = self.vehicle_place(model);
        let points: Vec<_> = [read].into_iter().chain(vehicle).collect();
        let place = CardPlace::new(others, self.card_size, &points);
        let card = Area::new(Id::unique("map probe"))
            .fixed_pos(place.corner)
            .pivot(place.align)
            .constrain_to(self.screen)
            .order(Order::Background)
            .interactable(is_pinned)
            .show(ui.ctx(), |ui| {
                let is_narrow = self.screen.width() < NARROW;
                probe_card_ui(ui, &data, is_pinned, (place.width, is_narrow))
            });
        self.card_size = card.response.rect.size();
        self.occluders.push(card.response.rect);
        if card.inner {
            self.pinned_m = None;
        }
    }
}

/// Draws the card, `width` points wide at most; whether the pin is to be taken out. That of a narrow map says when
/// tiles changed, of the layers that are drawn, and not what values come from.
fn probe_card_ui(
    ui: &mut Ui,
    data: &ProbeData,
    is_pinned: bool,
    (width, is_narrow): (f32, bool),
) -> bool {
    let mut is_over = false;
    Frame::new()
        .fill(theme::card(ui.visuals()))
        .corner_radius(4.0)
        .inner_margin(INNER)
        .show(ui, |ui| {
            ui.set_max_width(width - 2.0 * INNER);
            ui.spacing_mut().item_spacing.y = 3.0;
            ui.horizontal(|ui| {
                let place = RichText::new(data.place()).strong();
                ui.label(if is_narrow { place.small() } else { place });
                if is_pinned {
                    let unpin = ui.small_button("Unpin");
                    is_over = unpin
                        .on_hover_text("Read under the pointer (Esc)")
                        .clicked();
                }
            });
            // Columns are as wide as they were: those of other layers would overlap.
            let cells = data.cells.iter();
            let cells: Vec<_> = cells.filter(|cell| cell.is_shown || !is_narrow).collect();
            let layers: Vec<_> = cells.iter().map(|cell| cell.layer).collect();
            Grid::new(("probe", layers))
                .num_columns(3)
                .min_row_height(16.0)
                .spacing([10.0, 2.0])
                .show(ui, |ui| {
                    let weak = ui.visuals().weak_text_color();
                    // Also where nothing is known: a card that changes its height leaps.
                    if !cells.is_empty() {
                        head_ui(ui, weak);
                    }
                    for cell in cells {
                        let name = RichText::new(layer_name(cell.layer)).small();
                        let mut value = RichText::new(cell.text()).small().strong();
                        if cell.value.is_none() || !cell.is_shown {
                            value = value.color(weak);
                        }
                        ui.label(name);
                        ui.label(value);
                        let origin = if is_narrow {
                            cell.changed().unwrap_or_default()
                        } else {
                            cell.origin()
                        };
                        let origin = RichText::new(origin).small().color(weak);
                        ui.add(Label::new(origin).wrap());
                        ui.end_row();
                    }
                });
        });
    is_over
}

/// Says over the third column whose the ages below are.
fn head_ui(ui: &mut Ui, ink: Color32) {
    ui.small("");
    ui.small("");
    let head = RichText::new(TILE_CHANGED).small().color(ink);
    let hint = format!(
        "The newest change of the {TILE_CELLS} × {TILE_CELLS} cells around this one, which may be older itself"
    );
    ui.add(Label::new(head).wrap()).on_hover_text(hint);
    ui.end_row();
}

/// Draws the mark of a pinned point: a cross with a gap, so that the point itself is seen.
pub(super) fn paint_pin(painter: &Painter, at: Pos2) {
    for (width, color) in [(4.0, Color32::WHITE), (2.0, Color32::BLACK)] {
        for [x, y] in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]] {
            let towards = eframe::egui::vec2(x, y);
            let ends = [at + 4.0 * towards, at + 12.0 * towards];
            painter.line_segment(ends, Stroke::new(width, color));
        }
    }
}
