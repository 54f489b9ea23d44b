//! Names and values in a narrow panel. A value with a word, or a number, that is longer than its column stands below its name:
//! half of a number is another number.

use eframe::egui::{Color32, Label, Layout, Response, TextStyle, Ui, vec2};

use super::{HEIGHT, Hint, Row, SPACING, hint_ui, name_label, value_label};
use crate::theme::Tone;

/// Draws rows of which the names have so much at most, points, as far as none of their words is longer.
pub(super) fn rows_ui(ui: &mut Ui, rows: &[(Tone, &Row)], most: f32, hint: Hint<'_>) {
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

/// A name that has so much, points, and its value beside it.
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

/// A name, and its value below it.
fn below_ui(ui: &mut Ui, labels: [Label; 2]) -> [Response; 2] {
    let row = ui.vertical(|ui| {
        ui.spacing_mut().item_spacing.y = 0.0;
        labels.map(|label| ui.add(label.wrap()))
    });
    row.inner
}

/// Of the longest part that is broken only where it is longer than a line, points.
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
    use eframe::egui::Shape;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::super::{row, rows_ui};
    use super::*;

    /// Around a panel in a test's window, points, in sum of both sides.
    const AROUND: f32 = 16.0;

    #[test]
    fn no_number_is_broken_however_narrow_the_panel_is() {
        let [x, y] = ["x\u{a0}−112.34", "y\u{a0}−12.34\u{a0}m"];
        // What a window of 640 points leaves of the robot's panel, and less.
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
