//! A pose by the mouse: pressed at its place, dragged ahead. Where the vehicle is in a saved map, or where it is to go.

use eframe::egui::{Color32, Painter, PointerButton, Pos2, Response, Stroke, Vec2};
use protocol::message::{MapPose, Plan};

use super::camera::Camera;

/// Shorter arrows have no direction, points.
const MIN_LENGTH: f32 = 12.0;
const COLOR: Color32 = Color32::from_rgb(0xcc, 0x00, 0x7a);

/// What the pose is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PosePurpose {
    /// Where the vehicle is.
    Locate,
    /// The goal of a planner.
    Goal,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct PoseTool {
    pub(super) purpose: PosePurpose,
    /// From the place to a point ahead of it, m of the map.
    arrow_m: Option<[[f64; 2]; 2]>,
}

impl PoseTool {
    pub(super) const fn new(purpose: PosePurpose) -> Self {
        Self {
            purpose,
            arrow_m: None,
        }
    }

    /// Returns the pose when the button is released. A click is a goal, as which it looks away from the vehicle.
    pub(super) fn drag(
        &mut self,
        response: &Response,
        camera: &Camera,
        vehicle_m: Option<[f64; 2]>,
    ) -> Option<MapPose> {
        let at = response.interact_pointer_pos()?;
        if self.purpose == PosePurpose::Goal && response.clicked_by(PointerButton::Primary) {
            let [x, y] = camera.to_odom(at);
            let [from_x, from_y] = vehicle_m.unwrap_or([x - 1.0, y]);
            return Some(pose([x, y], [2.0 * x - from_x, 2.0 * y - from_y]));
        }
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
            paint_arrow(painter, from, to - from);
        }
    }
}

fn paint_arrow(painter: &Painter, from: Pos2, ahead: Vec2) {
    for stroke in [Stroke::new(5.0, Color32::WHITE), Stroke::new(3.0, COLOR)] {
        painter.circle_stroke(from, 5.0, stroke);
        painter.arrow(from, ahead, stroke);
    }
}

/// The goal that runs, and the path to it.
pub(super) fn paint_goal(painter: &Painter, camera: &Camera, goal: MapPose, plan: &Plan) {
    let to_screen = |[x_mm, y_mm]: [i32; 2]| {
        camera.to_screen([x_mm, y_mm].map(|along_mm| f64::from(along_mm) / 1000.0))
    };
    let path: Vec<_> = plan.points_mm.iter().copied().map(to_screen).collect();
    for stroke in [Stroke::new(4.0, Color32::WHITE), Stroke::new(2.0, COLOR)] {
        painter.line(path.clone(), stroke);
    }
    let ahead = camera.direction(f64::from(goal.yaw_mrad) / 1000.0) * (2.0 * MIN_LENGTH);
    paint_arrow(painter, to_screen([goal.x_mm, goal.y_mm]), ahead);
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
