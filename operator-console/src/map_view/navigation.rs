//! Camera movement by pointer, gestures and keys, and automatic camera modes.

use eframe::egui::{
    CursorIcon, Event, InputState, MouseWheelSource, MouseWheelUnit, PointerButton, Pos2, Rect,
    Response, Ui, Vec2, vec2,
};

use super::camera::around;
use super::cards::free_parts;
use super::drawing::vehicle_m;
use super::shores::extent_m;
use super::{CameraMode, MapView, Orientation};
use crate::model::ConsoleModel;

impl MapView {
    pub(super) fn handle_pointer(&mut self, ui: &Ui, response: &Response) {
        let drag = response.drag_delta();
        let buttons = [
            PointerButton::Primary,
            PointerButton::Middle,
            PointerButton::Secondary,
        ];
        let is_pulled = buttons.iter().any(|button| response.dragged_by(*button));
        if is_pulled && drag != vec2(0.0, 0.0) {
            self.camera.pan(drag);
            self.settings.camera_mode = CameraMode::Free;
            ui.ctx().set_cursor_icon(CursorIcon::Grabbing);
        } else if self.ruler.is_some() && response.hovered() {
            ui.ctx().set_cursor_icon(CursorIcon::Crosshair);
        }
        if response.hovered() && ui.input(|input| input.pointer.delta() != vec2(0.0, 0.0)) {
            self.is_center_probed = false;
        }
        if let Some(at) = response.interact_pointer_pos()
            && !self.is_occluded(at)
        {
            self.click(response, at);
        }
        if let Some(at) = response.hover_pos() {
            let gesture = ui.input(|input| self.gestures.take(input));
            if gesture.push != vec2(0.0, 0.0) {
                self.camera.pan(gesture.push);
                self.settings.camera_mode = CameraMode::Free;
            }
            if gesture.zooms() {
                self.zoom(at, gesture.factor);
            }
        }
    }

    fn click(&mut self, response: &Response, at: Pos2) {
        let point_m = self.camera.to_odom(at);
        if self.ruler.is_none() && response.double_clicked() {
            self.pinned_m = None;
            self.camera.center_on(point_m);
            self.settings.camera_mode = CameraMode::Free;
        } else if response.clicked() {
            self.point(point_m);
        } else if self.ruler.is_some() && response.secondary_clicked() {
            self.undo_point();
        }
    }

    pub(super) fn point(&mut self, point_m: [f64; 2]) {
        match &mut self.ruler {
            Some(ruler) => ruler.add(point_m),
            None => self.pinned_m = Some(point_m),
        }
    }

    pub(super) fn undo_point(&mut self) {
        match &mut self.ruler {
            Some(ruler) => ruler.undo_point(),
            None => self.pinned_m = None,
        }
    }

    pub(super) fn probed_place(&self, pointer: Option<Pos2>) -> Option<Pos2> {
        if self.is_center_probed {
            Some(self.camera.screen.center())
        } else {
            pointer
        }
    }

    /// In follow mode the vehicle stays centred; in fit mode zooming ends the mode.
    pub(super) fn zoom(&mut self, at: Pos2, factor: f64) {
        match self.settings.camera_mode {
            CameraMode::FollowVehicle => {
                self.camera.zoom_about(self.camera.screen.center(), factor);
            }
            CameraMode::FitMap | CameraMode::Free => {
                self.settings.camera_mode = CameraMode::Free;
                self.camera.zoom_about(at, factor);
            }
        }
    }

    pub(super) fn update_camera(&mut self, model: &ConsoleModel) {
        let vehicle_m = vehicle_m(model);
        if self.settings.orientation == Orientation::RobotUp
            && let Some(heading_rad) = model.vehicle().heading_rad()
        {
            self.camera.turn_up(heading_rad);
        }
        self.approach(model);
        match self.settings.camera_mode {
            CameraMode::Free => {}
            CameraMode::FollowVehicle => {
                if let Some(vehicle_m) = vehicle_m {
                    self.camera.center_on(vehicle_m);
                }
            }
            CameraMode::FitMap => {
                let map_m = self
                    .layers
                    .bounds_m(&self.settings.stack, model.map().store());
                if let Some(bounds_m) = with_point(map_m, vehicle_m) {
                    self.fit(bounds_m);
                }
            }
        }
    }

    fn approach(&mut self, model: &ConsoleModel) {
        if let Some(mark) = self.shore_selection.approach_target.take()
            && let Some(shores) = model.shores()
        {
            let extent_m = extent_m(shores, mark);
            // A removed shore has no extent.
            if !extent_m.is_empty() {
                self.camera.approach(around(&extent_m));
            }
        }
    }

    /// Fits the whole map beside all cards, where it is largest.
    fn fit(&mut self, bounds_m: [f64; 4]) {
        let screen = self.camera.screen;
        let fitted = |part: Rect| {
            let mut camera = self.camera;
            camera.fit(part, bounds_m);
            (camera, part.area())
        };
        let parts = free_parts(screen, &self.cards()).into_iter().map(fitted);
        let largest = parts.max_by(|(a, a_area), (b, b_area)| {
            let by_scale = a.points_per_m.total_cmp(&b.points_per_m);
            by_scale.then(a_area.total_cmp(b_area))
        });
        (self.camera, _) = largest.unwrap_or_else(|| fitted(screen));
    }
}

fn with_point(bounds_m: Option<[f64; 4]>, point_m: Option<[f64; 2]>) -> Option<[f64; 4]> {
    let Some([x, y]) = point_m else {
        return bounds_m;
    };
    let [low_x, low_y, high_x, high_y] = bounds_m.unwrap_or([x, y, x, y]);
    Some([low_x.min(x), low_y.min(y), high_x.max(x), high_y.max(y)])
}

/// Scroll distance for a zoom by e, points.
const SCROLL_PER_E: f64 = 450.0;

/// The scrolling device. egui distributes its scrolling over several frames.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct GestureTracker {
    is_of_fingers: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Gesture {
    /// Zoom factor about the pointer.
    pub(super) factor: f64,
    pub(super) push: Vec2,
}

impl GestureTracker {
    pub(super) fn take(&mut self, input: &InputState) -> Gesture {
        if let Some(last) = input.events.iter().rev().find_map(is_of_fingers) {
            self.is_of_fingers = last;
        }
        if let Some(touch) = input.multi_touch() {
            return Gesture {
                factor: f64::from(touch.zoom_delta),
                push: touch.translation_delta,
            };
        }
        let pinch = f64::from(input.zoom_delta());
        let scroll = input.smooth_scroll_delta();
        // With Shift, egui scrolls sideways.
        if self.is_of_fingers || scroll.x != 0.0 {
            return Gesture {
                factor: pinch,
                push: scroll,
            };
        }
        let wheel = libm::exp(f64::from(scroll.y) / SCROLL_PER_E);
        Gesture {
            factor: pinch * wheel,
            push: Vec2::ZERO,
        }
    }
}

impl Gesture {
    pub(super) fn zooms(&self) -> bool {
        (self.factor - 1.0).abs() > 1e-6
    }
}

/// If the system does not report it: touch pads scroll in points, wheels in lines.
fn is_of_fingers(event: &Event) -> Option<bool> {
    let Event::MouseWheel { unit, source, .. } = event else {
        return None;
    };
    Some(match source {
        MouseWheelSource::Trackpad | MouseWheelSource::Momentum => true,
        MouseWheelSource::Wheel => false,
        MouseWheelSource::Unknown => *unit == MouseWheelUnit::Point,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::{Context, Modifiers, RawInput, TouchPhase, vec2};

    /// The sum of all frames after one wheel step or touch pad stroke.
    fn gesture(unit: MouseWheelUnit, modifiers: Modifiers) -> Gesture {
        let ctx = Context::default();
        let mut gestures = GestureTracker::default();
        let (mut factor, mut push) = (1.0, Vec2::ZERO);
        for frame in 0..30 {
            let wheel = Event::MouseWheel {
                unit,
                delta: vec2(0.0, 12.0),
                phase: TouchPhase::Move,
                source: MouseWheelSource::Unknown,
                modifiers,
            };
            let input = RawInput {
                time: Some(f64::from(frame) * 0.02),
                events: if frame == 0 { vec![wheel] } else { Vec::new() },
                ..RawInput::default()
            };
            let mut is_first_pass = true;
            let output = ctx.run_ui(input, |ui| {
                if std::mem::take(&mut is_first_pass) {
                    let gesture = ui.input(|input| gestures.take(input));
                    factor *= gesture.factor;
                    push += gesture.push;
                }
            });
            output.drop_without_applying_deltas();
        }
        Gesture { factor, push }
    }

    #[test]
    fn wheel_zooms_and_two_fingers_pan() {
        let wheel = gesture(MouseWheelUnit::Line, Modifiers::NONE);
        assert!(wheel.factor > 1.5 && wheel.push == Vec2::ZERO, "{wheel:?}");
        let fingers = gesture(MouseWheelUnit::Point, Modifiers::NONE);
        assert!(!fingers.zooms(), "{fingers:?}");
        assert!(
            (fingers.push - vec2(0.0, 12.0)).length() < 0.5,
            "{fingers:?}"
        );
        let sideways = gesture(MouseWheelUnit::Line, Modifiers::SHIFT);
        assert!(!sideways.zooms() && sideways.push.x > 100.0, "{sideways:?}");
        let pinch = gesture(MouseWheelUnit::Line, Modifiers::COMMAND);
        assert!(pinch.factor > 1.5 && pinch.push == Vec2::ZERO, "{pinch:?}");
    }
}
