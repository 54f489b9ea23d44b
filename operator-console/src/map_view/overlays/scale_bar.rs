//! A bar of a round length in metres.

use std::sync::Arc;

use eframe::egui::{
    Align2, Color32, FontId, Galley, Painter, Pos2, Rect, Stroke, StrokeKind, pos2, vec2,
};
use protocol::export::{length_label, round_length_m};

/// Longest bar, points.
const MAX_BAR: f32 = 160.0;
/// What is shorter is no help, points.
const MIN_BAR: f32 = 48.0;
const HEIGHT: f32 = 6.0;
const PADDING: f32 = 8.0;

/// A round length and how long it is on the screen.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::map_view) struct ScaleBar {
    pub(in crate::map_view) label: String,
    /// Points.
    pub(in crate::map_view) length: f32,
}

impl ScaleBar {
    /// The longest bar of 1, 2 or 5 times a power of ten metres whose card fits into `room` points.
    pub(in crate::map_view) fn new(points_per_m: f64, room: f32) -> Self {
        let longest = (room - 2.0 * PADDING).clamp(MIN_BAR, MAX_BAR);
        let length_m = round_length_m(f64::from(longest) / points_per_m);
        Self {
            label: length_label(length_m),
            length: (length_m * points_per_m) as f32,
        }
    }
}

/// The card of the bar whose lower left corner is at `at`, and its words.
fn card(painter: &Painter, at: Pos2, bar: &ScaleBar, ink: Color32) -> (Rect, Arc<Galley>) {
    let text = painter.layout_no_wrap(bar.label.clone(), FontId::proportional(14.0), ink);
    let width = bar.length.max(text.size().x) + 2.0 * PADDING;
    let height = text.size().y + HEIGHT + 3.0 + 1.5 * PADDING;
    let card = Rect::from_min_size(at - vec2(0.0, height), vec2(width, height));
    (card, text)
}

/// What the bar covers whose lower left corner is at `at`.
pub(in crate::map_view) fn place(painter: &Painter, at: Pos2, bar: &ScaleBar) -> Rect {
    let (card, _) = card(painter, at, bar, Color32::BLACK);
    card
}

/// Draws the bar on a card whose lower left corner is at `at`.
pub(in crate::map_view) fn paint(
    painter: &Painter,
    at: Pos2,
    bar: &ScaleBar,
    ink: Color32,
    paper: Color32,
) {
    let (card, text) = card(painter, at, bar, ink);
    painter.rect_filled(card, 4.0, paper);
    let left = card.center().x - 0.5 * bar.length;
    let bottom = card.bottom() - PADDING;
    let whole = Rect::from_min_max(pos2(left, bottom - HEIGHT), pos2(left + bar.length, bottom));
    // The second half hollow, so that the bar is also a ruler for half its length.
    let half = whole.with_max_x(left + 0.5 * bar.length);
    painter.rect_filled(half, 0.0, ink);
    painter.rect_stroke(whole, 0.0, Stroke::new(1.0, ink), StrokeKind::Inside);
    let text_at = pos2(card.center().x, whole.top() - 3.0);
    let text_rect = Align2::CENTER_BOTTOM.anchor_size(text_at, text.size());
    painter.galley(text_rect.min, text, ink);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_round_and_fit() {
        for (points_per_m, label, length) in [
            (40.0, "2 m", 80.0),
            (31.0, "5 m", 155.0),
            (160.0, "1 m", 160.0),
            (161.0, "50 cm", 80.5),
            (2000.0, "5 cm", 100.0),
            (0.05, "2 km", 100.0),
            (0.3, "500 m", 150.0),
        ] {
            let bar = ScaleBar::new(points_per_m, 500.0);
            assert_eq!(bar.label, label, "{points_per_m}");
            assert!((bar.length - length).abs() < 1e-3, "{points_per_m}");
        }
        // Beside something else there is less room.
        for (room, label) in [(176.0, "2 m"), (95.0, "1 m"), (10.0, "1 m")] {
            assert_eq!(ScaleBar::new(40.0, room).label, label, "{room}");
        }
    }
}
