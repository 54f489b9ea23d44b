//! Moves the camera: by hands and keys, and by itself where something is kept in sight.

use eframe::egui::{CursorIcon, PointerButton, Pos2, Rect, Response, Ui, vec2};

use super::camera::around;
use super::overlays::shores::extent_m;
use super::toolbar;
use super::{CARD_MARGIN, CameraMode, MapView, Orientation};
use crate::model::ConsoleModel;

/// A map that would be smaller than this part of what it could be goes on under the legends.
const LEAST_PART: f64 = 0.5;

impl MapView {
    pub(super) fn handle_pointer(&mut self, ui: &Ui, response: &Response) {
        let drag = response.drag_delta();
        let is_pulled = [
            PointerButton::Primary,
            PointerButton::Middle,
            PointerButton::Secondary,
        ]
        .into_iter()
        .any(|button| response.dragged_by(button));
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
        let point_m = self.camera.to_odom(self.screen, at);
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

    /// Measures to this point of `odom`, metres, or reads it wherever the pointer is.
    pub(super) fn point(&mut self, point_m: [f64; 2]) {
        match &mut self.ruler {
            Some(ruler) => {
                ruler.add(point_m);
            }
            None => self.pinned_m = Some(point_m),
        }
    }

    /// As if the last point had not been pointed at.
    pub(super) fn undo_point(&mut self) {
        match &mut self.ruler {
            Some(ruler) => ruler.undo_point(),
            None => self.pinned_m = None,
        }
    }

    /// What is pointed at: by the pointer, or by keys.
    pub(super) fn probed_place(&self, pointer: Option<Pos2>) -> Option<Pos2> {
        if self.is_center_probed {
            Some(self.screen.center())
        } else {
            pointer
        }
    }

    /// Who follows the vehicle goes on following it; who saw the whole map chose a part of it.
    pub(super) fn zoom(&mut self, at: Pos2, factor: f64) {
        match self.settings.camera_mode {
            CameraMode::FollowVehicle => {
                self.camera
                    .zoom_about(self.screen, self.screen.center(), factor);
            }
            CameraMode::FitMap | CameraMode::Free => {
                self.settings.camera_mode = CameraMode::Free;
                self.camera.zoom_about(self.screen, at, factor);
            }
        }
    }

    pub(super) fn update_camera(&mut self, model: &ConsoleModel) {
        let vehicle_m = model.vehicle().pose().map(|(pose, _)| {
            let [x, y, _] = pose.position_m;
            [x, y]
        });
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

    /// Comes near a shore or docking site that was chosen.
    fn approach(&mut self, model: &ConsoleModel) {
        if let Some(mark) = self.shore_selection.take_approach_target()
            && let Some(shores) = model.shores()
        {
            let extent_m = extent_m(shores, model.site_names(), mark);
            // There is none of a shore that is gone: then there is no more than its middle to look at.
            if !extent_m.is_empty() {
                self.camera.approach(self.screen, around(&extent_m));
            }
        }
    }

    /// Shows all of the map: where legends would cover some of it, beside or above them, whichever shows it larger.
    fn fit(&mut self, bounds_m: [f64; 4]) {
        let (screen, whole) = (self.screen, self.fit_screen());
        let fitted = |part: Rect| {
            let mut camera = self.camera;
            camera.fit(screen, part, bounds_m);
            camera
        };
        let under = fitted(whole);
        let covers = |legends: &Rect| under.place_of(screen, bounds_m).intersects(*legends);
        let Some(legends) = self.legends_place().filter(covers) else {
            self.camera = under;
            return;
        };
        let [right, bottom] = [legends.left(), legends.top()].map(|edge| edge - CARD_MARGIN);
        let parts = [whole.with_max_x(right), whole.with_max_y(bottom)];
        let parts = parts.into_iter().filter(Rect::is_positive);
        let least = LEAST_PART * under.points_per_m();
        let beside = parts
            .map(fitted)
            .filter(|camera| camera.points_per_m() >= least)
            .max_by(|a, b| a.points_per_m().total_cmp(&b.points_per_m()));
        self.camera = beside.unwrap_or(under);
    }

    /// The screen as `fit` takes it: the same middle, but away from bar, buttons and edges.
    fn fit_screen(&self) -> Rect {
        self.screen
            .shrink2(vec2(0.0, toolbar::HEIGHT + CARD_MARGIN))
    }
}

fn with_point(bounds_m: Option<[f64; 4]>, point_m: Option<[f64; 2]>) -> Option<[f64; 4]> {
    let Some([x, y]) = point_m else {
        return bounds_m;
    };
    let [low_x, low_y, high_x, high_y] = bounds_m.unwrap_or([x, y, x, y]);
    Some([low_x.min(x), low_y.min(y), high_x.max(x), high_y.max(y)])
}
