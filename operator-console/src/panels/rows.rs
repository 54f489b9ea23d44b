//! Names and values in two columns.

use eframe::egui::{Grid, Label, RichText, Ui};

/// A name and its value.
pub(super) type Row = (String, String);

/// Draws rows; `id` tells the columns of one panel from another's.
pub(super) fn rows_ui(ui: &mut Ui, id: &str, rows: &[Row]) {
    Grid::new(id)
        .num_columns(2)
        .min_col_width(96.0)
        .min_row_height(18.0)
        .spacing([12.0, 4.0])
        .show(ui, |ui| {
            for (name, value) in rows {
                ui.label(RichText::new(name).color(ui.visuals().weak_text_color()));
                ui.add(Label::new(value).truncate()).on_hover_text(value);
                ui.end_row();
            }
        });
}

/// A row.
pub(super) fn row(name: &str, value: impl Into<String>) -> Row {
    (name.to_owned(), value.into())
}
