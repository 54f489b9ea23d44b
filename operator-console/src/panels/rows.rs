//! Names and values in two columns.

use eframe::egui::{
    Color32, Grid, Label, Layout, Rect, RectAlign, Response, RichText, TextStyle, Tooltip, Ui, vec2,
};

use crate::theme::Tone;

pub(super) type Row = (String, String);
/// Hover text of a row, by its name.
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

/// `id`: unique id of the grid.
pub(super) fn rows_ui(ui: &mut Ui, id: &str, rows: &[Row]) {
    hinted_rows_ui(ui, id, rows, &|_name| None);
}

/// Rows with hover text.
pub(super) fn hinted_rows_ui(ui: &mut Ui, id: &str, rows: &[Row], hint: Hint<'_>) {
    grid_ui(ui, id, rows.iter().map(|row| (Tone::Good, row)), hint);
}

/// Rows with tones and hover text.
pub(super) fn toned_rows_ui(ui: &mut Ui, id: &str, rows: &[(Tone, Row)], hint: Hint<'_>) {
    grid_ui(ui, id, rows.iter().map(|(tone, row)| (*tone, row)), hint);
}

fn grid_ui<'a>(ui: &mut Ui, id: &str, rows: impl Iterator<Item = (Tone, &'a Row)>, hint: Hint<'_>) {
    let names = NAMES_SHARE * ui.available_width();
    if names < NAMES {
        let rows: Vec<_> = rows.collect();
        return narrow_rows_ui(ui, &rows, names, hint);
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

/// Long values wrap.
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
        // Accessible description.
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

/// Rows of a narrow panel. Names have at most `most` points, unless a word is longer.
fn narrow_rows_ui(ui: &mut Ui, rows: &[(Tone, &Row)], most: f32, hint: Hint<'_>) {
    let [between, below] = SPACING;
    let width = ui.available_width();
    let names = rows.iter().map(|(_, (name, _))| name);
    let longest = |widths: &dyn Fn(&str) -> f32| {
        let widths = names.clone().map(|name| widths(name));
        widths.fold(0.0, f32::max)
    };
    let names = longest(&|name| text_width(ui, name))
        .min(most)
        .max(longest(&|name| widest_word(ui, name)));
    let values = width - names - between;
    ui.scope(|ui| {
        ui.spacing_mut().item_spacing = vec2(between, below);
        ui.spacing_mut().interact_size.y = HEIGHT;
        for (tone, (name, value)) in rows {
            let labels = [name_label(ui, name), value_label(ui, *tone, value)];
            let [name_at, value_at] = if widest_word(ui, value) <= values {
                beside_ui(ui, labels, names)
            } else {
                below_ui(ui, labels)
            };
            if let Some(hint) = hint(name) {
                hint_ui(&name_at, &value_at, width, hint);
            }
        }
    });
}

/// Value beside the name.
fn beside_ui(ui: &mut Ui, [name, value]: [Label; 2], names: f32) -> [Response; 2] {
    let row = ui.horizontal_top(|ui| {
        let size = vec2(names, HEIGHT);
        let name = ui.allocate_ui_with_layout(size, Layout::default(), |ui| {
            ui.set_width(names);
            ui.add(name.wrap())
        });
        [name.inner, ui.add(value)]
    });
    row.inner
}

/// Value below the name.
fn below_ui(ui: &mut Ui, labels: [Label; 2]) -> [Response; 2] {
    let row = ui.vertical(|ui| {
        ui.spacing_mut().item_spacing.y = 0.0;
        labels.map(|label| ui.add(label.wrap()))
    });
    row.inner
}

/// Width of the longest word, points.
fn widest_word(ui: &Ui, words: &str) -> f32 {
    let widths = words.split(' ').map(|word| text_width(ui, word));
    widths.fold(0.0, f32::max)
}

fn text_width(ui: &Ui, words: &str) -> f32 {
    let font = TextStyle::Body.resolve(ui.style());
    let text = ui
        .painter()
        .layout_no_wrap(words.to_owned(), font, Color32::BLACK);
    text.size().x
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::{Shape, vec2};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    #[test]
    fn a_long_value_wraps_within_the_panel() {
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
    fn hover_text_covers_no_other_row() {
        const HINT: &str = "A hover text that is long enough for more than one line in a window";
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
                let reported = window.get_by_label(HINT).rect();
                let [name, value] = ["Keys", "Ready"].map(|of| window.get_by_label(of).rect());
                assert!(
                    !reported.intersects(name.union(value)),
                    "{label}: {reported} {name}"
                );
                assert!(
                    reported.top() < name.bottom(),
                    "beside it: {reported} {name}"
                );
            }
        }
    }

    const AROUND: f32 = 16.0;

    #[test]
    fn no_number_is_broken_in_a_narrow_panel() {
        let [x, y] = ["x\u{a0}−112.34", "y\u{a0}−12.34\u{a0}m"];
        for (width, is_beside) in [(150.0, true), (120.0, false), (100.0, false)] {
            let position = format!("{x}  {y}");
            let rows = [row("Position", position.clone()), row("Consoles", "1")];
            let mut window = Harness::builder()
                .with_size(vec2(width + AROUND, 200.0))
                .build_ui(move |ui| rows_ui(ui, "rows", &rows));
            crate::theme::set(&window.ctx);
            window.run_steps(3);
            let shapes = window.output().shapes.iter();
            let lines = shapes.filter_map(|clipped| {
                if let Shape::Text(text) = &clipped.shape {
                    (text.galley.text() == position).then_some(&text.galley.rows)
                } else {
                    None
                }
            });
            let lines = lines.flatten().map(|line| line.text().trim().to_owned());
            assert_eq!(lines.collect::<Vec<_>>(), [x, y], "{width}");
            let place = |label: &str| window.get_by_label(label).rect();
            let [name, value] = [place("Position"), place(&position)];
            assert_eq!(value.left() >= name.right(), is_beside, "{width}");
            assert_eq!(value.top() >= name.bottom() - 1.0, !is_beside, "{width}");
            assert!(value.right() <= width + 0.5 * AROUND, "{width}: {value}");
            assert!(place("Consoles").top() >= value.bottom(), "{width}");
            assert!(place("1").left() > place("Consoles").right(), "{width}");
        }
    }
}
