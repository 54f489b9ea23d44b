//! Names and values in two columns.

use eframe::egui::{Grid, Label, Rect, RectAlign, Response, RichText, Tooltip, Ui, vec2};

use crate::theme::Tone;

pub(super) type Row = (String, String);
pub(super) type Hint<'a> = &'a dyn Fn(&str) -> Option<&'static str>;

/// Minimum width of the name column, points, and its greatest share of the width.
const NAMES: f32 = 96.0;
const NAMES_SHARE: f32 = 0.46;
/// Column and row spacing, and minimum row height, points.
const SPACING: [f32; 2] = [12.0, 4.0];
const HEIGHT: f32 = 18.0;
/// Hover text is placed beside this width, so that it does not cover other values, points.
const ROW: f32 = 300.0;
const HINT_WIDTH: f32 = 300.0;

pub(super) fn rows_ui(ui: &mut Ui, id: &str, rows: &[Row]) {
    hinted_rows_ui(ui, id, rows, &|_name| None);
}

pub(super) fn hinted_rows_ui(ui: &mut Ui, id: &str, rows: &[Row], hint: Hint<'_>) {
    grid_ui(ui, id, rows.iter().map(|row| (Tone::Good, row)), hint);
}

pub(super) fn toned_rows_ui(ui: &mut Ui, id: &str, rows: &[(Tone, Row)], hint: Hint<'_>) {
    grid_ui(ui, id, rows.iter().map(|(tone, row)| (*tone, row)), hint);
}

fn grid_ui<'a>(ui: &mut Ui, id: &str, rows: impl Iterator<Item = (Tone, &'a Row)>, hint: Hint<'_>) {
    let names = NAMES_SHARE * ui.available_width();
    if names < NAMES {
        let rows: Vec<_> = rows.collect();
        return narrow_rows_ui(ui, &rows, hint);
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

fn value_label(ui: &Ui, tone: Tone, value: &str) -> Label {
    let value = RichText::new(value);
    let value = match tone {
        Tone::Warning => value.color(tone.color(ui.visuals())),
        Tone::Good | Tone::Waiting => value,
    };
    Label::new(value).wrap()
}

/// Shows hover text beside the row, or above it if there is no space, so that the next rows stay readable.
fn hint_ui(name: &Response, value: &Response, width: f32, hint: &str) {
    for part in [name, value] {
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

pub(super) fn row(name: &str, value: impl Into<String>) -> Row {
    (name.to_owned(), value.into())
}

/// Rows of a narrow panel: values that do not fit beside their name are below it.
fn narrow_rows_ui(ui: &mut Ui, rows: &[(Tone, &Row)], hint: Hint<'_>) {
    let width = ui.available_width();
    for (tone, (name, value)) in rows {
        let row = ui.horizontal_wrapped(|ui| {
            ui.spacing_mut().item_spacing = SPACING.into();
            ui.spacing_mut().interact_size.y = HEIGHT;
            let name = ui.add(name_label(ui, name));
            (name, ui.add(value_label(ui, *tone, value)))
        });
        if let Some(hint) = hint(name) {
            hint_ui(&row.inner.0, &row.inner.1, width, hint);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::{Shape, vec2};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    const AROUND: f32 = 16.0;

    #[test]
    fn no_number_is_broken_in_a_narrow_panel() {
        let [x, y] = ["x\u{a0}−112.34", "y\u{a0}−12.34\u{a0}m"];
        for width in [150.0, 120.0, 100.0] {
            let position = format!("{x}  {y}");
            let rows = [row("Position", position.clone()), row("Consoles", "1")];
            let mut window = Harness::builder()
                .with_size(vec2(width + AROUND, 200.0))
                .build_ui(move |ui| rows_ui(ui, "rows", &rows));
            crate::theme::set(&window.ctx);
            window.run_steps(3);
            let shapes = window.output().shapes.iter();
            let lines = shapes.filter_map(|clipped| match &clipped.shape {
                Shape::Text(text) if text.galley.text() == position => Some(&text.galley.rows),
                _ => None,
            });
            let lines = lines.flatten().map(|line| line.text().trim().to_owned());
            let lines: Vec<_> = lines.filter(|line| !line.is_empty()).collect();
            assert_eq!(lines, [x, y], "{width}");
            let place = |label: &str| window.get_by_label(label).rect();
            let value = place(&position);
            assert!(value.right() <= width + 0.5 * AROUND, "{width}: {value}");
            assert!(place("Consoles").top() >= value.bottom(), "{width}");
            assert!(place("1").left() > place("Consoles").right(), "{width}");
        }
    }
}
