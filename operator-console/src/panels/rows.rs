//! Names and values in two columns.

mod narrow;

use eframe::egui::{Grid, Label, Rect, RectAlign, Response, RichText, Tooltip, Ui, vec2};

use crate::theme::Tone;

/// A name and its value.
pub(super) type Row = (String, String);
/// What is told of a row to whoever points at it, by its name.
pub(super) type Hint<'a> = &'a dyn Fn(&str) -> Option<&'static str>;

/// The column of the names, points, and what it has at most of a panel that is narrow.
const NAMES: f32 = 96.0;
const NAMES_SHARE: f32 = 0.46;
/// Between a name and its value, and between rows; and the least height of a row, points.
const SPACING: [f32; 2] = [12.0, 4.0];
const HEIGHT: f32 = 18.0;
/// What is told of a row stands beside so much of it, points, or of a narrower panel: behind the values of other rows.
const ROW: f32 = 300.0;
const HINT_WIDTH: f32 = 300.0;

/// Draws rows; `id` tells the columns of one panel from another's.
pub(super) fn rows_ui(ui: &mut Ui, id: &str, rows: &[Row]) {
    hinted_rows_ui(ui, id, rows, &|_name| None);
}

/// Draws rows of which some have more to say to whoever points at them: `hint`, by their names.
pub(super) fn hinted_rows_ui(ui: &mut Ui, id: &str, rows: &[Row], hint: Hint<'_>) {
    grid_ui(ui, id, rows.iter().map(|row| (Tone::Good, row)), hint);
}

/// Draws rows of which some want to be looked at, and some have more to say, as above.
pub(super) fn toned_rows_ui(ui: &mut Ui, id: &str, rows: &[(Tone, Row)], hint: Hint<'_>) {
    grid_ui(ui, id, rows.iter().map(|(tone, row)| (*tone, row)), hint);
}

fn grid_ui<'a>(ui: &mut Ui, id: &str, rows: impl Iterator<Item = (Tone, &'a Row)>, hint: Hint<'_>) {
    let names = NAMES_SHARE * ui.available_width();
    if names < NAMES {
        let rows: Vec<_> = rows.collect();
        return narrow::rows_ui(ui, &rows, names, hint);
    }
    let width = ROW.min(ui.available_width());
    Grid::new(id)
        .num_columns(2)
        .min_col_width(NAMES)
        .min_row_height(HEIGHT)
        .spacing(SPACING)
        .show(ui, |ui| {
            for (tone, (name, value)) in rows {
                let hint = hint(name);
                let name = ui.add(name_label(ui, name));
                let value = ui.add(value_label(ui, tone, value));
                if let Some(hint) = hint {
                    hint_ui(&name, &value, width, hint);
                }
                ui.end_row();
            }
        });
}

fn name_label(ui: &Ui, name: &str) -> Label {
    Label::new(RichText::new(name).color(ui.visuals().weak_text_color()))
}

/// What is too long for its line has another: nothing is cut off.
fn value_label(ui: &Ui, tone: Tone, value: &str) -> Label {
    let value = RichText::new(value);
    let value = match tone {
        Tone::Warning => value.color(tone.color(ui.visuals())),
        Tone::Good | Tone::Waiting => value,
    };
    Label::new(value).wrap()
}

/// Beside the row, which is so wide at least: whoever reads it reads the rows below as well. Where there is no room
/// beside it, above it.
fn hint_ui(name: &Response, value: &Response, width: f32, hint: &str) {
    for part in [name, value] {
        // Who hears the window hears it too.
        _ = part
            .ctx
            .accesskit_node_builder(part.id, |node| node.set_description(hint));
    }
    let pointed = name.union(value.clone());
    let room = Rect::from_min_size(name.rect.min, vec2(width, pointed.rect.height()));
    let row = pointed.rect.union(room);
    let mut tooltip = Tooltip::for_enabled(&pointed).width(HINT_WIDTH);
    tooltip.popup = tooltip
        .popup
        .anchor(row)
        .align(RectAlign::RIGHT_START)
        .align_alternatives(&[
            RectAlign::LEFT_START,
            RectAlign::TOP_START,
            RectAlign::BOTTOM_START,
        ]);
    tooltip.show(|ui| {
        ui.set_max_width(HINT_WIDTH);
        ui.label(hint)
    });
}

/// A row.
pub(super) fn row(name: &str, value: impl Into<String>) -> Row {
    (name.to_owned(), value.into())
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;

    #[test]
    fn a_long_value_has_more_lines_and_stays_within_the_panel() {
        const WIDTH: f32 = 280.0;
        let long = "Its data is late: nothing moves, and that is said at length";
        let rows = [row("Guard", long), row("Keys", "Ready")];
        let mut window = Harness::builder()
            .with_size(vec2(WIDTH, 200.0))
            .build_ui(move |ui| rows_ui(ui, "rows", &rows));
        window.run_steps(3);
        let [long, short] = [long, "Ready"].map(|value| window.get_by_label(value).rect());
        assert!(long.right() <= WIDTH, "{long}");
        assert!(long.height() > 1.8 * short.height(), "{long} {short}");
        assert!(short.top() >= long.bottom(), "{long} {short}");
    }

    #[test]
    fn what_is_told_of_a_row_covers_no_other() {
        const HINT: &str =
            "told of it, at some length, so that it has more lines than one in a window";
        // The panel is on the right of a window, and on its left.
        for left in [true, false] {
            let rows = [row("Guard", "On"), row("Keys", "Ready")];
            let mut window = Harness::builder()
                .with_size(vec2(700.0, 200.0))
                .build_ui(move |ui| {
                    ui.horizontal_top(|ui| {
                        if !left {
                            ui.add_space(400.0);
                        }
                        ui.vertical(|ui| {
                            ui.set_max_width(280.0);
                            let hint = |name: &str| (name == "Guard").then_some(HINT);
                            hinted_rows_ui(ui, "rows", &rows, &hint);
                        });
                    });
                });
            for label in ["Guard", "On"] {
                let place = window.get_by_label(label).rect();
                window.hover_at(place.center());
                window.run_steps(60);
                let told = window.get_by_label(HINT).rect();
                let [name, value] = ["Keys", "Ready"].map(|of| window.get_by_label(of).rect());
                assert!(
                    !told.intersects(name.union(value)),
                    "{label}: {told} {name}"
                );
                assert!(told.top() < name.bottom(), "beside it: {told} {name}");
            }
        }
    }
}
