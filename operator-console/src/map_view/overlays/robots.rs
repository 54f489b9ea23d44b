//! Other robots: small marks in their colours, with their names.

use eframe::egui::{Align2, Color32, FontId, Painter, Rect, Shape, Stroke, vec2};

use super::super::camera::Camera;
use super::super::surroundings::OtherRobot;

const ARROW: f32 = 14.0;

/// Draws those that are on the screen.
pub(in crate::map_view) fn paint(
    painter: &Painter,
    others: &[OtherRobot],
    (camera, screen): (&Camera, Rect),
    ink: Color32,
    paper: Color32,
) {
    for robot in others {
        let at = camera.to_screen(screen, robot.position_m);
        if !screen.expand(ARROW).contains(at) {
            continue;
        }
        let ahead = camera.direction(robot.heading_rad) * ARROW;
        let side = vec2(-ahead.y, ahead.x);
        let corners = vec![
            at + 0.6 * ahead,
            at - 0.4 * ahead + 0.4 * side,
            at - 0.4 * ahead - 0.4 * side,
        ];
        painter.add(Shape::convex_polygon(
            corners,
            robot.color,
            Stroke::new(1.5, Color32::WHITE),
        ));
        let font = FontId::proportional(13.0);
        let text = painter.layout_no_wrap(robot.name.clone(), font, ink);
        let place = Align2::CENTER_TOP.anchor_size(at + vec2(0.0, 0.8 * ARROW), text.size());
        painter.rect_filled(place.expand2(vec2(4.0, 1.0)), 3.0, paper);
        painter.galley(place.min, text, ink);
    }
}
