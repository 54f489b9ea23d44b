//! The list of all shortcuts.

use eframe::egui::{
    Align2, Context, Grid, RichText, ScrollArea, Ui, Vec2, Window, WindowDrag, vec2,
};

use super::{Action, Binding, Group, bindings, words};
use crate::teleop_input::SpeedStep;

/// Minimum width of a column, points.
const COLUMN: f32 = 300.0;
const BETWEEN: f32 = 24.0;
/// Width and height of the window frame, points.
const FRAME: [f32; 2] = [40.0, 70.0];

#[derive(Debug)]
pub struct Sheet {
    is_open: bool,
    /// Until the operator moves it, it is at the left, away from the emergency stop.
    is_moved: bool,
}

impl Sheet {
    pub const CLOSED: Self = Self {
        is_open: false,
        is_moved: false,
    };

    pub const fn toggle(&mut self) {
        *self = Self {
            is_open: !self.is_open,
            ..Self::CLOSED
        };
    }

    /// Returns whether it was open.
    pub const fn close(&mut self) -> bool {
        std::mem::replace(self, Self::CLOSED).is_open
    }

    pub fn show(&mut self, ctx: &Context) {
        if !self.is_open {
            return;
        }
        let content = ctx.content_rect();
        let room = content.size() - vec2(FRAME[0], FRAME[1]);
        let mut window = Window::new("Keyboard shortcuts")
            .open(&mut self.is_open)
            .collapsible(false)
            .resizable(false)
            // With a drag by the title only, egui 0.37 does not move it.
            .drag_area(WindowDrag::Anywhere)
            .pivot(Align2::LEFT_CENTER);
        if !self.is_moved {
            window = window.current_pos(content.left_center());
        }
        let shown = window.show(ctx, |ui| contents_ui(ui, room));
        self.is_moved |= shown.is_some_and(|shown| shown.response.dragged());
    }
}

fn contents_ui(ui: &mut Ui, room: Vec2) {
    let columns = columns(room.x);
    let width = columns.len() as f32 * (COLUMN + BETWEEN) - BETWEEN;
    // Scrolls if the window is too small.
    ScrollArea::both()
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
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Block {
    /// Keys that are not in the table.
    Driving,
    Of(Group),
}

/// Distributes the groups over as many columns as fit, with similar heights.
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
    rows_ui(ui, group.title(), &rows(group));
}

/// Rows of a group.
fn rows(group: Group) -> Vec<(String, &'static str)> {
    let of_group = bindings().iter().filter(|binding| binding.group == group);
    let of_widgets = of_widgets(group).iter();
    let of_widgets = of_widgets.map(|(keys, words)| ((*keys).to_owned(), *words));
    of_group.filter_map(row).chain(of_widgets).collect()
}

/// Keys that widgets handle.
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
            let blocks = columns.concat();
            assert_eq!(blocks[0], Block::Driving);
            let groups: Vec<_> = Group::ALL.into_iter().map(Block::Of).collect();
            assert_eq!(blocks[1..], groups);
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

    fn window(size: [f32; 2]) -> Harness<'static, Sheet> {
        let mut harness = Harness::builder()
            .with_size(Vec2::from(size))
            .build_ui_state(
                |ui, sheet: &mut Sheet| {
                    crate::theme::set(ui.ctx());
                    sheet.show(ui.ctx());
                },
                Sheet::CLOSED,
            );
        harness.state_mut().toggle();
        harness.run_steps(6);
        harness
    }

    fn place(window: &Harness<'_, Sheet>) -> Rect {
        let sheet = window.get_by_role_and_label(Role::Window, "Keyboard shortcuts");
        sheet.rect()
    }

    /// Number of horizontal and vertical scroll bars.
    fn bars(window: &Harness<'_, Sheet>) -> [usize; 2] {
        let bars = window.query_all_by_role(Role::ScrollBar);
        let lies: Vec<_> = bars
            .map(|bar| bar.rect().width() > bar.rect().height())
            .collect();
        [true, false].map(|which| lies.iter().filter(|lies| **lies == which).count())
    }

    #[test]
    fn scroll_bars_only_if_needed() {
        for (size, expected) in [
            ([1280.0, 800.0], [0, 0]),
            ([700.0, 620.0], [0, 1]),
            ([300.0, 620.0], [1, 1]),
        ] {
            assert_eq!(bars(&window(size)), expected, "{size:?}");
        }
    }

    #[test]
    fn the_sheet_opens_beside_the_driving_panel() {
        let mut window = window([700.0, 620.0]);
        let is_left = |window: &Harness<'_, Sheet>, size: Vec2| {
            let place = place(window);
            let off = place.left_center() - pos2(0.0, 0.5 * size.y);
            assert!(off.length() < 1.5, "{place} in {size}");
            assert!(Rect::from_min_size(Pos2::ZERO, size).contains_rect(place));
            // It does not cover the emergency stop if there is space.
            assert!(size.x < 1000.0 || place.right() < 1000.0, "{place}");
        };
        is_left(&window, vec2(700.0, 620.0));
        // Reopened in a larger window, which then shrinks.
        window.state_mut().toggle();
        window.run_steps(2);
        for size in [vec2(1280.0, 800.0), vec2(700.0, 620.0)] {
            window.set_size(size);
            if size.x > 1000.0 {
                window.state_mut().toggle();
            }
            window.run_steps(6);
            is_left(&window, size);
        }
    }

    #[test]
    fn a_moved_sheet_keeps_its_place_until_reopened() {
        let mut window = window([1280.0, 800.0]);
        let opened = place(&window).center();
        let title = pos2(opened.x - 200.0, place(&window).top() + 12.0);
        window.hover_at(title);
        window.run_steps(1);
        window.drag_at(title);
        window.run_steps(1);
        window.hover_at(title + vec2(60.0, 20.0));
        window.run_steps(2);
        window.drop_at(title + vec2(60.0, 20.0));
        window.run_steps(4);
        let by = place(&window).center() - opened;
        assert!((by - vec2(60.0, 20.0)).length() < 1.5, "{by}");
        for _time in 0..2 {
            window.state_mut().toggle();
            window.run_steps(4);
        }
        assert!((place(&window).center() - opened).length() < 1.5);
    }
}
