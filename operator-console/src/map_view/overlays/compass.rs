//! Where north is; a click turns the map between north-up and robot-up.

use eframe::egui::accesskit::Role;
use eframe::egui::{Align2, FontId, Rect, Sense, Shape, Stroke, Ui, Vec2, WidgetInfo, vec2};

use super::super::view_settings::Orientation;
use crate::theme;

/// Across, points.
pub(in crate::map_view) const SIZE: f32 = 44.0;

/// What it shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::map_view) struct CompassData {
    /// Where y of `odom` is on the screen.
    pub(in crate::map_view) north: Vec2,
    /// Whether y of `odom` is known to be north on Earth.
    pub(in crate::map_view) is_on_earth: bool,
    pub(in crate::map_view) orientation: Orientation,
}

impl CompassData {
    fn hint(self) -> String {
        let turn = match self.orientation {
            Orientation::NorthUp => "Turn the map with the robot (N)",
            Orientation::RobotUp => "North up (N)",
        };
        let note = if self.is_on_earth {
            ""
        } else {
            ". The robot does not know where north is: y of its map stands for it"
        };
        format!("{turn}{note}")
    }
}

/// Draws it in `rect`; whether it was clicked.
pub(in crate::map_view) fn compass_ui(ui: &Ui, rect: Rect, data: CompassData) -> bool {
    let response = ui.interact(rect, ui.scope_id().with("compass"), Sense::click());
    let label = match (data.orientation, data.is_on_earth) {
        (Orientation::NorthUp, true) => "Compass: north up",
        (Orientation::NorthUp, false) => "Compass: y up",
        (Orientation::RobotUp, _) => "Compass: robot up",
    };
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, label));
    let painter = ui.painter();
    let ink = ui.visuals().text_color();
    let (middle, radius) = (rect.center(), 0.5 * SIZE - 1.0);
    painter.circle_filled(middle, radius, theme::card(ui.visuals()));
    let rim = if response.hovered() || response.has_focus() {
        Stroke::new(2.0, ink)
    } else {
        Stroke::new(1.0, ui.visuals().weak_text_color())
    };
    painter.circle_stroke(middle, radius, rim);
    let side = vec2(-data.north.y, data.north.x);
    let (tip, tail) = (data.north * 0.42 * radius, data.north * -0.72 * radius);
    let wing = |factor: f32| middle + side * factor * radius;
    let north_half = vec![middle + tip, wing(0.26), wing(-0.26)];
    let south_half = vec![middle + tail, wing(0.26), wing(-0.26)];
    painter.add(Shape::convex_polygon(
        north_half,
        theme::VEHICLE,
        Stroke::NONE,
    ));
    painter.add(Shape::convex_polygon(
        south_half,
        ui.visuals().weak_text_color(),
        Stroke::NONE,
    ));
    let letter = if data.is_on_earth { "N" } else { "y" };
    painter.text(
        middle + data.north * 0.72 * radius,
        Align2::CENTER_CENTER,
        letter,
        FontId::proportional(13.0),
        ink,
    );
    response.on_hover_text(data.hint()).clicked()
}
