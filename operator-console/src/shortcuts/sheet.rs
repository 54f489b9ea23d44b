//! The list of all keys, over the window.

use eframe::egui::{Align2, Context, Grid, RichText, ScrollArea, Ui, Window, vec2};

use super::{Action, Binding, Group, bindings, words};
use crate::teleop_input::SpeedStep;

/// A column with the longest words, points.
const COLUMN: f32 = 300.0;
const BETWEEN: f32 = 24.0;
/// What the frame of the window takes of its width and of its height, points.
const FRAME: [f32; 2] = [40.0, 70.0];

/// Draws the sheet; `is_open` becomes false where it is closed.
pub fn sheet_ui(ctx: &Context, is_open: &mut bool) {
    let room = ctx.content_rect().size() - vec2(FRAME[0], FRAME[1]);
    let columns = columns(room.x);
    let width = columns.len() as f32 * (COLUMN + BETWEEN) - BETWEEN;
    Window::new("Keyboard shortcuts")
        .open(is_open)
        .collapsible(false)
        .resizable(false)
        .pivot(Align2::CENTER_CENTER)
        .default_pos(ctx.content_rect().center())
        .show(ctx, |ui| {
            ScrollArea::both()
                // It scrolls only what the whole window has no room for.
                .min_scrolled_width(room.x.min(width))
                .min_scrolled_height(room.y)
                .max_height(room.y)
                .show(ui, |ui| {
                    ui.horizontal_top(|ui| {
                        ui.spacing_mut().item_spacing.x = BETWEEN;
                        for blocks in columns {
                            ui.vertical(|ui| {
                                ui.spacing_mut().item_spacing.x = 8.0;
                                ui.set_width(COLUMN);
                                for block in blocks {
                                    block.show(ui);
                                }
                            });
                        }
                    });
                });
        });
}

/// What stands in one column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Block {
    /// Keys that are not in the table.
    Driving,
    /// Those of the table.
    Of(Group),
}

/// Everything, in as many columns as there is room for, of much the same height.
fn columns(width: f32) -> Vec<&'static [Block]> {
    static ALL: [Block; 6] = [
        Block::Driving,
        Block::Of(Group::Map),
        Block::Of(Group::Robots),
        Block::Of(Group::Recording),
        Block::Of(Group::Files),
        Block::Of(Group::Window),
    ];
    let ends: &[usize] = match (width + BETWEEN) / (COLUMN + BETWEEN) {
        3.0.. => &[2, 4, 6],
        2.0.. => &[2, 6],
        _ => &[6],
    };
    let begins = [0].into_iter().chain(ends.iter().copied());
    begins
        .zip(ends)
        .map(|(begin, end)| &ALL[begin..*end])
        .collect()
}

impl Block {
    fn show(self, ui: &mut Ui) {
        match self {
            Self::Driving => driving_ui(ui),
            Self::Of(group) => group_ui(ui, group),
        }
    }
}

fn driving_ui(ui: &mut Ui) {
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

fn group_ui(ui: &mut Ui, group: Group) {
    let of_group = bindings().iter().filter(|binding| binding.group == group);
    let rows: Vec<_> = of_group.filter_map(row).collect();
    rows_ui(ui, group.title(), &rows);
}

/// Keys and what they do; `None` where there are none. Robots have one row together.
fn row(binding: &Binding) -> Option<(String, &'static str)> {
    if let Action::Robot(number) = binding.action {
        let all = || {
            let [first, last] = [1, 9].map(|number| Action::Robot(number).keys());
            (format!("{first} to {last}"), "Robot 1 to 9")
        };
        return (number == 1).then(all);
    }
    let keys: Vec<_> = binding.keys.iter().map(|keys| words(*keys)).collect();
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
    use super::*;

    #[test]
    fn everything_stands_in_as_many_columns_as_there_is_room_for() {
        for (width, count) in [(200.0, 1), (623.0, 1), (624.0, 2), (948.0, 3), (4000.0, 3)] {
            let columns = columns(width);
            assert_eq!(columns.len(), count, "{width}");
            let blocks = columns.concat();
            assert_eq!(blocks[0], Block::Driving);
            let groups: Vec<_> = Group::ALL.into_iter().map(Block::Of).collect();
            assert_eq!(blocks[1..], groups);
        }
    }

    #[test]
    fn every_key_of_the_table_is_on_it() {
        let rows: Vec<_> = bindings().iter().filter_map(row).collect();
        let says = |keys: &str, words: &str| {
            let is_it = |row: &&(String, &str)| row.0 == keys && row.1 == words;
            assert!(rows.iter().any(|row| is_it(&row)), "{keys}: {words}");
        };
        says("Ctrl+1 to Ctrl+9", "Robot 1 to 9");
        says("R", "At the end, begin anew");
        says("+ or =", "Closer");
        let keyless = bindings().iter().filter(|binding| binding.keys.is_empty());
        assert_eq!(rows.len(), bindings().len() - keyless.count() - 8);
    }
}
