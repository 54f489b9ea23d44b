//! The list of all keys, over the window.

use eframe::egui::{Context, Grid, RichText, ScrollArea, Window};

use super::{Group, bindings, words};
use crate::teleop_input::SpeedStep;

/// Draws the sheet; `is_open` becomes false where it is closed.
pub fn sheet_ui(ctx: &Context, is_open: &mut bool) {
    Window::new("Keyboard shortcuts")
        .open(is_open)
        .collapsible(false)
        .resizable(false)
        .default_pos(ctx.content_rect().center() - eframe::egui::vec2(310.0, 280.0))
        .show(ctx, |ui| {
            let height = (ctx.content_rect().height() - 120.0).clamp(200.0, 560.0);
            ScrollArea::vertical().max_height(height).show(ui, |ui| {
                ui.horizontal_top(|ui| {
                    ui.vertical(|ui| {
                        driving_ui(ui);
                        group_ui(ui, Group::Map);
                    });
                    ui.add_space(24.0);
                    ui.vertical(|ui| {
                        for group in [Group::Robots, Group::Files, Group::Window] {
                            group_ui(ui, group);
                        }
                    });
                });
            });
        });
}

fn driving_ui(ui: &mut eframe::egui::Ui) {
    let steps = format!("1 to {}", SpeedStep::COUNT);
    rows_ui(
        ui,
        "Driving, while you hold the lease",
        &[
            ("W A S D, arrows".to_owned(), "Drive while held"),
            (steps, "How fast keys drive"),
            ("Space".to_owned(), "Emergency stop, always"),
        ],
    );
}

fn group_ui(ui: &mut eframe::egui::Ui, group: Group) {
    let of_group = bindings().iter().filter(|binding| binding.group == group);
    let rows: Vec<_> = of_group
        .filter(|binding| !binding.keys.is_empty())
        .map(|binding| {
            let keys: Vec<_> = binding.keys.iter().map(|keys| words(*keys)).collect();
            (keys.join(" or "), binding.words)
        })
        .collect();
    rows_ui(ui, group.title(), &rows);
}

fn rows_ui(ui: &mut eframe::egui::Ui, title: &str, rows: &[(String, &str)]) {
    ui.label(RichText::new(title).strong());
    Grid::new(title)
        .num_columns(2)
        .min_row_height(18.0)
        .spacing([12.0, 3.0])
        .show(ui, |ui| {
            for (keys, words) in rows {
                ui.label(RichText::new(keys).monospace().size(13.0));
                ui.label(*words);
                ui.end_row();
            }
        });
    ui.add_space(8.0);
}
