//! The card with what the map says at a point, and the mark of a point that is pinned.

use eframe::egui::{Color32, Frame, Grid, Painter, Pos2, RichText, Stroke, Ui};

use super::probe::ProbeData;
use crate::panels::layers::layer_name;
use crate::theme;

/// Draws the card; whether the pin is to be taken out.
pub(super) fn probe_card_ui(ui: &mut Ui, data: &ProbeData, is_pinned: bool) -> bool {
    let mut is_over = false;
    Frame::new()
        .fill(theme::card(ui.visuals()))
        .corner_radius(4.0)
        .inner_margin(8.0)
        .show(ui, |ui| {
            ui.spacing_mut().item_spacing.y = 3.0;
            ui.horizontal(|ui| {
                ui.label(RichText::new(data.place()).strong());
                if is_pinned {
                    let unpin = ui.small_button("Unpin");
                    is_over = unpin
                        .on_hover_text("Read under the pointer (Esc)")
                        .clicked();
                }
            });
            Grid::new("probe")
                .num_columns(3)
                .min_row_height(16.0)
                .spacing([10.0, 2.0])
                .show(ui, |ui| {
                    for cell in &data.cells {
                        let weak = ui.visuals().weak_text_color();
                        let name = RichText::new(layer_name(cell.layer)).small();
                        let mut value = RichText::new(cell.text()).small().strong();
                        if cell.value.is_none() || !cell.is_shown {
                            value = value.color(weak);
                        }
                        ui.label(name);
                        ui.label(value);
                        ui.label(RichText::new(cell.origin()).small().color(weak));
                        ui.end_row();
                    }
                });
        });
    is_over
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
