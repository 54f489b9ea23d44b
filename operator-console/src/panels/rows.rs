//! Names and values in two columns.

use eframe::egui::{Grid, Label, RichText, Ui};

use crate::theme::Tone;

/// A name and its value.
pub(super) type Row = (String, String);
/// What is told of a row to whoever points at it, by its name.
pub(super) type Hint<'a> = &'a dyn Fn(&str) -> Option<&'static str>;

/// The column of the names, points, and what it has at most of a panel that is narrow.
const NAMES: f32 = 96.0;
const NAMES_SHARE: f32 = 0.46;

/// Draws rows; `id` tells the columns of one panel from another's.
pub(super) fn rows_ui(ui: &mut Ui, id: &str, rows: &[Row]) {
    grid_ui(ui, id, rows.iter().map(|row| (Tone::Good, row)), &|_name| {
        None
    });
}

/// Draws rows of which some want to be looked at, and some have more to say to whoever points at them: `hint`, by their names.
pub(super) fn toned_rows_ui(ui: &mut Ui, id: &str, rows: &[(Tone, Row)], hint: Hint<'_>) {
    grid_ui(ui, id, rows.iter().map(|(tone, row)| (*tone, row)), hint);
}

fn grid_ui<'a>(ui: &mut Ui, id: &str, rows: impl Iterator<Item = (Tone, &'a Row)>, hint: Hint<'_>) {
    let names = NAMES.min(NAMES_SHARE * ui.available_width());
    Grid::new(id)
        .num_columns(2)
        .min_col_width(names)
        .min_row_height(18.0)
        .spacing([12.0, 4.0])
        .show(ui, |ui| {
            for (tone, (name, value)) in rows {
                let hint = hint(name);
                let name = RichText::new(name).color(ui.visuals().weak_text_color());
                let name = if names < NAMES {
                    let narrow = ui.scope(|ui| {
                        ui.set_max_width(names);
                        ui.add(Label::new(name).wrap())
                    });
                    narrow.inner
                } else {
                    ui.label(name)
                };
                let value = RichText::new(value);
                let value = match tone {
                    Tone::Warning => value.color(tone.color(ui.visuals())),
                    Tone::Good | Tone::Waiting => value,
                };
                // What is too long for its line has another: nothing is cut off.
                let value = ui.add(Label::new(value).wrap());
                if let Some(hint) = hint {
                    name.on_hover_text(hint);
                    value.on_hover_text(hint);
                }
                ui.end_row();
            }
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
        let long = "Sees nothing new: nothing moves, and that is said at length";
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
}
