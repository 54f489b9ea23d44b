//! Saying where the vehicle is in a saved map: pressed at its place, dragged ahead.

use eframe::egui::{Color32, Painter, PointerButton, Response, Stroke};
use protocol::message::MapPose;

use super::camera::Camera;

/// Shorter arrows have no direction, points.
const MIN_LENGTH: f32 = 12.0;
const COLOR: Color32 = Color32::from_rgb(0xcc, 0x00, 0x7a);

/// From the vehicle's place to a point ahead of it, m of the map.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PoseTool {
    arrow_m: Option<[[f64; 2]; 2]>,
}

impl PoseTool {
    /// Returns the pose when the button is released.
    pub(super) fn drag(&mut self, response: &Response, camera: &Camera) -> Option<MapPose> {
        let at = response.interact_pointer_pos()?;
        if response.drag_started_by(PointerButton::Primary) {
            let pressed = response.ctx.input(|input| input.pointer.press_origin());
            self.arrow_m = Some([camera.to_odom(pressed.unwrap_or(at)); 2]);
        }
        let [_, ahead_m] = self.arrow_m.as_mut()?;
        *ahead_m = camera.to_odom(at);
        if !response.drag_stopped_by(PointerButton::Primary) {
            return None;
        }
        let [from_m, to_m] = self.arrow_m.take()?;
        let length = camera.to_screen(from_m).distance(at);
        (length >= MIN_LENGTH).then(|| pose(from_m, to_m))
    }

    pub(super) fn paint(&self, painter: &Painter, camera: &Camera) {
        if let Some(arrow_m) = self.arrow_m {
            let [from, to] = arrow_m.map(|point_m| camera.to_screen(point_m));
            for stroke in [Stroke::new(5.0, Color32::WHITE), Stroke::new(3.0, COLOR)] {
                painter.circle_stroke(from, 5.0, stroke);
                painter.arrow(from, to - from, stroke);
            }
        }
    }
}

fn pose([x, y]: [f64; 2], ahead_m: [f64; 2]) -> MapPose {
    let yaw_rad = libm::atan2(ahead_m[1] - y, ahead_m[0] - x);
    let [x_mm, y_mm, yaw_mrad] = [x, y, yaw_rad].map(|n| libm::round(1000.0 * n) as i32);
    MapPose {
        x_mm,
        y_mm,
        yaw_mrad,
    }
}
