//! What the panel offers who may only watch: nothing to press, and why.

use eframe::egui::accesskit::Role;
use eframe::egui::{Button, Label, Response, Ui, Vec2, WidgetInfo};

use crate::role::WATCHES;

/// A button that cannot be pressed; who asks for it, or hears it, is told why.
pub(crate) fn disabled_ui(ui: &mut Ui, label: &str, size: Vec2) -> Response {
    let shown = ui.add_enabled(false, Button::new(label).min_size(size));
    let name = format!("{label}. {WATCHES}");
    shown.widget_info(|| WidgetInfo::labeled(Role::Button, false, &name));
    shown.on_disabled_hover_text(WATCHES)
}

/// The emergency stop, as large as one that can be pressed.
pub(super) fn estop_ui(ui: &mut Ui, size: Vec2) {
    disabled_ui(ui, "EMERGENCY STOP", size);
}

/// Where the lease is asked for by others.
pub(super) fn lease_ui(ui: &mut Ui) {
    disabled_ui(ui, "Drive", Vec2::ZERO);
    ui.add(Label::new(WATCHES).wrap());
}
