//! A ring around what the collision monitor holds the vehicle back for.

use eframe::egui::{Color32, Painter, Rect};

use super::super::camera::Camera;

/// So large that whatever is ringed can be seen in it, points.
const RADIUS: f32 = 10.0;
/// Points.
const LINE: f32 = 2.5;

/// Draws it, where the map shows this place, metres in `odom`.
pub(in crate::map_view) fn paint(
    painter: &Painter,
    position_m: [f64; 2],
    (camera, screen): (&Camera, Rect),
    color: Color32,
) {
    let at = camera.to_screen(screen, position_m);
    if !screen.expand(RADIUS).contains(at) {
        return;
    }
    // It is to be seen on every palette.
    painter.circle_stroke(at, RADIUS, (2.0 * LINE, Color32::from_black_alpha(180)));
    painter.circle_stroke(at, RADIUS, (LINE, color));
}
