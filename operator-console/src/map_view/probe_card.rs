//! The card with what the map says at a point, and the mark of a point that is pinned.

use eframe::egui::{Color32, Frame, Grid, Label, Painter, Pos2, Rect, RichText, Stroke, Ui, pos2};

use super::CARD_MARGIN;
use super::probe::ProbeData;
use crate::panels::layers::layer_name;
use crate::theme;

const INNER: f32 = 8.0;
/// A card that is narrower has too many lines, points.
const LEAST: f32 = 330.0;

/// Where the card stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CardPlace {
    /// Its lower left corner.
    pub(super) corner: Pos2,
    /// What it has for its width, points.
    pub(super) width: f32,
}

impl CardPlace {
    /// Beside the legend where both fit, else above it; over the scale bar, whose upper edge is `bar`, in any case.
    pub(super) fn new(screen: Rect, bar: f32, legend: Option<Rect>) -> Self {
        let left = screen.left() + CARD_MARGIN;
        let beside = legend.map_or(screen.right(), |legend| legend.left()) - CARD_MARGIN - left;
        match legend {
            Some(legend) if beside < LEAST => Self {
                corner: pos2(left, bar.min(legend.top() - CARD_MARGIN)),
                width: screen.right() - CARD_MARGIN - left,
            },
            Some(_) | None => Self {
                corner: pos2(left, bar),
                width: beside,
            },
        }
    }
}

/// Draws the card, `width` points wide at most; whether the pin is to be taken out.
pub(super) fn probe_card_ui(ui: &mut Ui, data: &ProbeData, is_pinned: bool, width: f32) -> bool {
    let mut is_over = false;
    Frame::new()
        .fill(theme::card(ui.visuals()))
        .corner_radius(4.0)
        .inner_margin(INNER)
        .show(ui, |ui| {
            ui.set_max_width(width - 2.0 * INNER);
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
            // Columns are as wide as they were: those of other layers would overlap.
            let layers: Vec<_> = data.cells.iter().map(|cell| cell.layer).collect();
            Grid::new(("probe", layers))
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
                        let origin = RichText::new(cell.origin()).small().color(weak);
                        ui.add(Label::new(origin).wrap());
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

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;

    use super::*;

    #[test]
    fn the_card_is_never_under_the_legend() {
        let legend_of = |screen: Rect| {
            let corner = screen.right_bottom() - vec2(CARD_MARGIN, CARD_MARGIN);
            Rect::from_min_max(corner - vec2(236.0, 140.0), corner)
        };
        for (size, is_beside) in [
            (vec2(700.0, 560.0), true),
            (vec2(500.0, 560.0), false),
            (vec2(270.0, 300.0), false),
        ] {
            let screen = Rect::from_min_size(pos2(280.0, 40.0), size);
            let (bar, legend) = (screen.bottom() - 60.0, legend_of(screen));
            let place = CardPlace::new(screen, bar, Some(legend));
            let right = place.corner.x + place.width;
            assert_eq!(right <= legend.left(), is_beside, "{size}");
            assert!(is_beside || place.corner.y <= legend.top(), "{size}");
            assert!(place.corner.y <= bar && right <= screen.right(), "{size}");
        }
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(270.0, 300.0));
        let alone = CardPlace::new(screen, 240.0, None);
        assert_eq!((alone.corner, alone.width), (pos2(12.0, 240.0), 246.0));
    }
}
