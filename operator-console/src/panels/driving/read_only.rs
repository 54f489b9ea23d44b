//! What the panel offers who may only watch, or not take over: nothing to press, and why.

use eframe::egui::accesskit::Role;
use eframe::egui::{Button, Label, Layout, Response, Ui, Vec2, WidgetInfo};

use crate::role::{OBSERVER_HINT, OPERATOR_HINT};

/// A button that observers cannot press.
pub(crate) fn disabled_ui(ui: &mut Ui, label: &str, size: Vec2) -> Response {
    disabled_reason_ui(ui, label, size, OBSERVER_HINT)
}

/// A button that cannot be pressed; who asks for it, or hears it, is told why.
fn disabled_reason_ui(ui: &mut Ui, label: &str, size: Vec2, why: &str) -> Response {
    let shown = ui.add_enabled(false, Button::new(label).min_size(size));
    let name = format!("{label}. {why}");
    shown.widget_info(|| WidgetInfo::labeled(Role::Button, false, &name));
    shown.on_disabled_hover_text(why)
}

/// The emergency stop, as large as one that can be pressed, and with its words where that has them: in the middle.
pub(super) fn estop_ui(ui: &mut Ui, size: Vec2) {
    let middle = Layout::centered_and_justified(ui.layout().main_dir());
    ui.allocate_ui_with_layout(size, middle, |ui| {
        disabled_ui(ui, "EMERGENCY STOP", size);
    });
}

/// Where the lease is asked for by others.
pub(super) fn lease_ui(ui: &mut Ui) {
    disabled_ui(ui, "Request control", Vec2::ZERO);
    ui.add(Label::new(OBSERVER_HINT).wrap());
}

/// Where supervisors take over.
pub(super) fn take_over_ui(ui: &mut Ui, label: &str) {
    disabled_reason_ui(ui, label, Vec2::ZERO, OPERATOR_HINT);
}

#[cfg(test)]
mod tests {
    use eframe::egui::{Shape, vec2};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;

    #[test]
    fn the_words_on_the_stop_are_in_its_middle() {
        let size = vec2(260.0, 64.0);
        let mut window = Harness::builder()
            .with_size(vec2(300.0, 120.0))
            .build_ui(move |ui| estop_ui(ui, size));
        window.run_steps(2);
        let name = format!("EMERGENCY STOP. {OBSERVER_HINT}");
        let button = window.get_by_label(&name).rect();
        assert!((button.size() - size).length() < 1.0, "{button}");
        let words = window.output().shapes.iter().find_map(|clipped| {
            if let Shape::Text(text) = &clipped.shape {
                Some(text.visual_bounding_rect().center())
            } else {
                None
            }
        });
        let away = words.unwrap() - button.center();
        assert!(away.abs().max_elem() < 4.0, "{away}");
    }
}
