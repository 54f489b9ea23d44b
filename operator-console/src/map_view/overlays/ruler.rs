//! The line that is measured, its lengths beside it.

use eframe::egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, vec2};

use super::super::camera::Camera;
use super::super::ruler::{Leg, total};

const LINE: Color32 = Color32::from_rgb(0xcc, 0x00, 0x7a);

/// Draws points (metres in `odom`) and the pieces between them, one fewer than points.
pub(in crate::map_view) fn paint(
    painter: &Painter,
    points_m: &[[f64; 2]],
    legs: &[Leg],
    (camera, screen): (&Camera, Rect),
    ink: Color32,
    paper: Color32,
) {
    let points: Vec<Pos2> = points_m
        .iter()
        .map(|point_m| camera.to_screen(screen, *point_m))
        .collect();
    for pair in points.windows(2) {
        painter.line_segment([pair[0], pair[1]], Stroke::new(4.0, Color32::WHITE));
        painter.line_segment([pair[0], pair[1]], Stroke::new(2.0, LINE));
    }
    for point in &points {
        painter.circle(*point, 4.0, LINE, Stroke::new(1.5, Color32::WHITE));
    }
    let card = |at: Pos2, text: String| {
        let text = painter.layout_no_wrap(text, FontId::proportional(13.0), ink);
        let place = Align2::CENTER_BOTTOM.anchor_size(at - vec2(0.0, 10.0), text.size());
        painter.rect_filled(place.expand2(vec2(5.0, 2.0)), 4.0, paper);
        painter.galley(place.min, text, ink);
    };
    for (pair, leg) in points.windows(2).zip(legs) {
        card(pair[0].lerp(pair[1], 0.5), leg.label());
    }
    if let (Some(total), Some(end)) = (total(legs), points.last()) {
        card(*end + vec2(0.0, 44.0), total);
    }
}
