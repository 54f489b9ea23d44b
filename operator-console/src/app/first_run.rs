//! What stands where the map would be while no robot is shown: what to do.

use eframe::egui::{Align, Button, Layout, RichText, TextStyle, Ui};

use crate::panels::command_line::with_monospace_options;
use crate::panels::robots::RobotsData;
use crate::shortcuts::Action;

/// Draws it; what the operator asks for.
pub(super) fn first_run_ui(ui: &mut Ui, robots: &RobotsData) -> Option<Action> {
    let mut asked = None;
    let width = ui.available_width().min(520.0);
    ui.add_space((0.25 * ui.available_height()).min(180.0));
    ui.with_layout(Layout::top_down(Align::Center), |ui| {
        ui.label(RichText::new(robots.heading).size(24.0));
        let advice = robots.advice.as_deref().unwrap_or_default();
        let ink = ui.visuals().text_color();
        ui.label(with_monospace_options(ui, advice, &TextStyle::Body, ink));
        if !robots.is_up_to_operator || !robots.found.is_empty() {
            return;
        }
        ui.add_space(12.0);
        ui.allocate_ui_with_layout([width, 0.0].into(), Layout::top_down(Align::Min), |ui| {
            ui.strong("To begin");
            for (words, action) in [
                (
                    "A robot on another network, or behind a router:",
                    Action::TypeAddress,
                ),
                ("A recording:", Action::OpenRecording),
            ] {
                ui.horizontal_wrapped(|ui| {
                    ui.label(words);
                    let button = Button::new(action.words()).shortcut_text(action.keys());
                    if ui.add(button).clicked() {
                        asked = Some(action);
                    }
                });
            }
            ui.horizontal_wrapped(|ui| {
                ui.label("No robot available: start this program as");
                ui.label(RichText::new("operator-console --demo lake").monospace());
            });
            ui.horizontal_wrapped(|ui| {
                ui.label("A simulated robot of its own:");
                ui.label(RichText::new("robot-edge simulate rooms").monospace());
            });
        });
    });
    asked
}
