//! The list of all shortcuts.

use eframe::egui::{
    Align2, Context, Grid, RichText, ScrollArea, Ui, Vec2, Window, WindowDrag, vec2,
};

use super::{Action, Binding, Group, bindings};
use crate::teleop_input::SpeedStep;

const COLUMN: f32 = 300.0;
const BETWEEN: f32 = 24.0;
const FRAME: [f32; 2] = [40.0, 70.0];

#[derive(Debug, Default)]
pub struct Sheet {
    pub is_open: bool,
    /// Until the operator moves it, it is at the left, away from the emergency stop.
    pub is_moved: bool,
}

pub fn sheet_ui(ctx: &Context, sheet: &mut Sheet) {
    let content = ctx.content_rect();
    let room = content.size() - vec2(FRAME[0], FRAME[1]);
    let mut window = Window::new("Keyboard shortcuts")
        .open(&mut sheet.is_open)
        .collapsible(false)
        .resizable(false)
        // With a drag by the title only, egui 0.37 does not move it.
        .drag_area(WindowDrag::Anywhere)
        .pivot(Align2::LEFT_CENTER);
    if !sheet.is_moved {
        window = window.current_pos(content.left_center());
    }
    let shown = window.show(ctx, |ui| contents_ui(ui, room));
    sheet.is_moved |= shown.is_some_and(|shown| shown.response.dragged());
}

fn contents_ui(ui: &mut Ui, room: Vec2) {
    let columns = columns(room.x);
    let width = columns.len() as f32 * (COLUMN + BETWEEN) - BETWEEN;
    ScrollArea::both()
        .min_scrolled_width(room.x.min(width))
        .min_scrolled_height(room.y)
        .max_height(room.y)
        .show(ui, |ui| {
            ui.horizontal_top(|ui| {
                ui.spacing_mut().item_spacing.x = BETWEEN;
                for (index, groups) in columns.into_iter().enumerate() {
                    ui.vertical(|ui| {
                        ui.spacing_mut().item_spacing.x = 8.0;
                        ui.set_width(COLUMN);
                        if index == 0 {
                            driving_ui(ui);
                        }
                        for group in groups {
                            rows_ui(ui, group.title(), &rows(*group));
                        }
                    });
                }
            });
        });
}

/// Distributes the groups over as many columns as fit, with similar heights. The first column begins with the driving
/// keys, which are not in the table.
fn columns(width: f32) -> Vec<&'static [Group]> {
    let ends: &[usize] = match (width + BETWEEN) / (COLUMN + BETWEEN) {
        3.0.. => &[1, 3, 5],
        2.0.. => &[1, 5],
        _ => &[5],
    };
    let begins = [0].into_iter().chain(ends.iter().copied());
    begins
        .zip(ends)
        .map(|(begin, end)| &Group::ALL[begin..*end])
        .collect()
}

fn driving_ui(ui: &mut Ui) {
    let steps = format!("1 to {}", SpeedStep::COUNT);
    rows_ui(
        ui,
        "Driving, while you hold the lease",
        &[
            ("W A S D, arrows".to_owned(), "Drive while held"),
            ("Q E".to_owned(), "Go sideways while held, if the robot can"),
            (steps, "How fast keys drive"),
            ("Space".to_owned(), "Emergency stop, always"),
        ],
    );
}

fn rows(group: Group) -> Vec<(String, &'static str)> {
    let of_group = bindings().iter().filter(|binding| binding.group == group);
    let of_widgets = of_widgets(group).iter();
    let of_widgets = of_widgets.map(|(keys, words)| ((*keys).to_owned(), *words));
    of_group.filter_map(row).chain(of_widgets).collect()
}

const fn of_widgets(group: Group) -> &'static [(&'static str, &'static str)] {
    match group {
        Group::Map => &[("PgUp, PgDn", "Scroll opened legends")],
        Group::Window => &[
            ("Tab", "To the next control"),
            ("Shift+Tab", "To the one before"),
        ],
        Group::Robots | Group::Recording | Group::Files => &[],
    }
}

/// Keys and text; `None` without keys. The robots share one row.
fn row(binding: &Binding) -> Option<(String, &'static str)> {
    if let Action::Robot(number) = binding.action {
        let all = || {
            let first = Action::Robot(1).keys();
            (format!("{first} … 9"), "Robot 1 to 9")
        };
        return (number == 1).then(all);
    }
    let keys: Vec<_> = binding.keys.iter().map(|(text, _)| *text).collect();
    (!keys.is_empty()).then(|| (keys.join(" or "), binding.words))
}

fn rows_ui(ui: &mut Ui, title: &str, rows: &[(String, &str)]) {
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

#[cfg(test)]
mod tests {
    use eframe::egui::accesskit::Role;
    use eframe::egui::{Pos2, Rect, pos2};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;

    #[test]
    fn the_sheet_has_as_many_columns_as_fit() {
        for (width, count) in [(200.0, 1), (623.0, 1), (624.0, 2), (948.0, 3), (4000.0, 3)] {
            let columns = columns(width);
            assert_eq!(columns.len(), count, "{width}");
            assert_eq!(columns.concat(), Group::ALL);
        }
    }

    #[test]
    fn the_sheet_lists_every_key() {
        let rows: Vec<_> = Group::ALL.into_iter().flat_map(rows).collect();
        let says = |keys: &str, words: &str| {
            let is_it = |row: &&(String, &str)| row.0 == keys && row.1 == words;
            assert!(rows.iter().any(|row| is_it(&row)), "{keys}: {words}");
        };
        says("Ctrl+1 … 9", "Robot 1 to 9");
        says("R", "Toggle looping");
        says("Ctrl+Shift+D", "Switch dark and light");
        says("+ or =", "Zoom in");
        says("PgUp, PgDn", "Scroll opened legends");
        says("Tab", "To the next control");
        let keyless = bindings().iter().filter(|binding| binding.keys.is_empty());
        assert_eq!(rows.len(), bindings().len() - keyless.count() - 8 + 3);
    }

    #[test]
    fn the_sheet_opens_beside_the_driving_panel() {
        for size in [vec2(1280.0, 800.0), vec2(700.0, 620.0)] {
            let mut window = Harness::builder().with_size(size).build_ui(|ui| {
                crate::theme::set(ui.ctx());
                let mut sheet = Sheet {
                    is_open: true,
                    is_moved: false,
                };
                sheet_ui(ui.ctx(), &mut sheet);
            });
            window.run_steps(6);
            let place = window
                .get_by_role_and_label(Role::Window, "Keyboard shortcuts")
                .rect();
            let off = place.left_center() - pos2(0.0, 0.5 * size.y);
            assert!(off.length() < 1.5, "{place} in {size}");
            assert!(Rect::from_min_size(Pos2::ZERO, size).contains_rect(place));
            // It does not cover the emergency stop if there is space.
            assert!(size.x < 1000.0 || place.right() < 1000.0, "{place}");
        }
    }
}
