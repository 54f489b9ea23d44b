//! Lists of shores and docking sites. A click selects a shore on the map, hovering highlights it, a title sorts.

use std::sync::Arc;

use eframe::egui::accesskit::{Node, Role};
use eframe::egui::{
    Align2, Color32, FontId, FontSelection, Galley, Id, Rect, RectAlign, Response, RichText,
    ScrollArea, Sense, Tooltip, Ui, WidgetInfo, pos2, vec2,
};

use super::super::formatting::capitalised;
use super::super::legend::{SWATCH, paint_swatch};
use super::{ShoreRow, ShoresData, SortBy, TO_SHORES, TO_SITES, arrange, remember};
use crate::command::Look;
use crate::map_view::ShoreMark;

/// Minimum width for name, colour and distance, points.
const LEAST_WIDTH: f32 = 110.0;
const FEW: usize = 4;
const ROW_HEIGHT: f32 = 24.0;
const BELOW_SIZE: f32 = 12.0;
const BELOW_RISE: f32 = 4.0;
/// Below the last line of a row with several lines, points.
const BELOW_GAP: f32 = 6.0;
const LIST_HEIGHT: f32 = 192.0;
/// Width of the scroll bar to the right of the numbers, points.
const BAR: f32 = 12.0;
/// Distance of the hover text from the panel, and its maximum width, points.
const HINT_GAP: f32 = 14.0;
const HINT_WIDTH: f32 = 260.0;
const SORTS: [Option<SortBy>; 5] = [
    Some(SortBy::Number),
    None,
    Some(SortBy::Share),
    Some(SortBy::Size),
    Some(SortBy::Distance),
];

struct List<'a> {
    name: &'static str,
    heading_text: &'static str,
    why: &'static str,
    titles: [&'static str; 5],
    /// Explanations of the columns; empty for plain ones.
    hints: [&'static str; 5],
    first: &'static str,
    usual: SortBy,
    usually: &'static str,
    rows: &'a [ShoreRow],
}

#[derive(Default)]
struct ListResponse {
    clicked: Option<Look>,
    hovered: Option<ShoreMark>,
}

pub fn shores_ui(ui: &mut Ui, data: &ShoresData) -> Option<Look> {
    let has_bar = data.shores.len().max(data.sites.len()) > FEW;
    let least = if has_bar {
        LEAST_WIDTH + BAR
    } else {
        LEAST_WIDTH
    };
    if ui.available_width() >= least {
        return lists_ui(ui, data);
    }
    let shown = ScrollArea::horizontal()
        .auto_shrink([false, true])
        .show(ui, |ui| {
            ui.set_min_width(least);
            lists_ui(ui, data)
        });
    shown.inner
}

fn lists_ui(ui: &mut Ui, data: &ShoresData) -> Option<Look> {
    // Scroll bars are drawn over the right edge.
    ui.set_max_width(ui.available_width() - BAR);
    for note in &data.notes {
        ui.label(RichText::new(note).small());
    }
    let mut asked = ListResponse::default();
    let shores = List {
        name: "shores",
        heading_text: "Shores, called by number",
        why: "The robot numbers its shores, and the map shows the numbers. Numbers change while the robot learns: a \
              merged cluster keeps the number of its larger part, a separated part gets a new number, and no number is \
              used twice.",
        titles: ["No.", "Class", "Rigid", "Voxels", "Away"],
        hints: ["", "", TO_RIGID, TO_VOXELS, TO_SHORES],
        first: "no.",
        usual: SortBy::Distance,
        usually: "the nearest first",
        rows: &data.shores,
    };
    let sites = List {
        name: "docking sites",
        heading_text: "Docking sites, called by letter",
        why: "Lowest price first, in steps of 0.05; within a step, the widest. The price of a gentle slope is its mean \
              cost, below 1; that of vegetation, for an emergency, is 1 plus its density. A letter stays \
              with its place, also on the map, when the order changes. The robot searches for sites in the window around it: sites \
              outside keep their class on the map, without a letter.",
        titles: ["Site", "", "Price", "Width", "Away"],
        hints: ["", "", "", "", TO_SITES],
        first: "rank",
        usual: SortBy::Number,
        usually: "the least price first by steps of 0.05, then the widest",
        rows: &data.sites,
    };
    let lists = [shores, sites];
    let (columns, width, heights) = room(ui, &lists);
    for (list, height) in lists.iter().zip(heights) {
        let room = (&columns, width, height);
        list_ui(ui, (list, room), data.marked, &mut asked);
    }
    let is_other = asked.hovered != data.hovered;
    asked
        .clicked
        .or_else(|| is_other.then_some(Look::Hover(asked.hovered)))
}

/// Columns, their total width, and the row height of each list. The scroll bar of a list is beside its columns.
fn room(ui: &Ui, lists: &[List<'_>; 2]) -> (Columns, f32, [f32; 2]) {
    let width = ui.available_width();
    let heights = |columns: &Columns, width: f32| {
        lists
            .each_ref()
            .map(|list| row_height(ui, list, columns, width))
    };
    let scrolls = |list: &List<'_>, height: f32| height * list.rows.len() as f32 > LIST_HEIGHT;
    // Rows are at least as high as their numbers, so that long lists are known to scroll without a layout.
    if !lists.iter().any(|list| scrolls(list, ROW_HEIGHT)) {
        let whole = columns(ui, lists, width);
        let heights = heights(&whole, width);
        let mut rows = lists.iter().zip(heights);
        if !rows.any(|(list, height)| scrolls(list, height)) {
            return (whole, width, heights);
        }
    }
    // With less width rows do not get lower: the list still scrolls.
    let width = width - BAR;
    let columns = columns(ui, lists, width);
    let heights = heights(&columns, width);
    (columns, width, heights)
}

fn columns(ui: &Ui, lists: &[List<'_>], width: f32) -> Columns {
    let lists = lists.iter().filter(|list| !list.rows.is_empty());
    let rows: Vec<_> = lists
        .clone()
        .flat_map(|list| list.rows.iter().map(|row| (row, class(row))))
        .collect();
    let titles = lists.map(|list| list.titles);
    let rows = rows.iter().map(|(row, class)| texts(row, class));
    Columns::new(ui, width, titles.chain(rows))
}

fn list_ui(
    ui: &mut Ui,
    (list, (columns, width, row_height)): (&List<'_>, (&Columns, f32, f32)),
    marked: Option<ShoreMark>,
    asked: &mut ListResponse,
) {
    if list.rows.is_empty() {
        return;
    }
    let mut rows = list.rows.to_vec();
    let id = Id::unique(list.name).with("sorted by");
    let mut by = ui.data(|data| data.get_temp(id)).unwrap_or(list.usual);
    let heading = if by == list.usual {
        format!("{}, {}", list.heading_text, list.usually)
    } else {
        list.heading_text.to_owned()
    };
    let heading = ui.label(RichText::new(heading).small());
    hint_ui(&heading, list.why);
    titles_ui(ui, list, (columns, width), &mut by);
    ui.data_mut(|data| data.insert_temp(id, by));
    let order = Id::unique(list.name).with("order");
    arrange(ui, order, &mut rows, by);
    let drawn = ui.scope(|ui| {
        ui.spacing_mut().item_spacing.y = 0.0;
        ScrollArea::vertical()
            .id_salt(list.name)
            .max_height(LIST_HEIGHT)
            .auto_shrink([false, true])
            .show_rows(ui, row_height, rows.len(), |ui, shown| {
                ui.set_max_width(width);
                for row in &rows[shown] {
                    let is_marked = marked == Some(row.mark);
                    let response = row_ui(ui, columns, row, row_height, is_marked);
                    if response.hovered() {
                        asked.hovered = Some(row.mark);
                    }
                    if response.clicked() {
                        asked.clicked = Some(Look::Mark(row.mark, row.center_m));
                    }
                }
            })
            .inner_rect
    });
    remember(ui, order, &rows, by, drawn.inner);
}

fn titles_ui(ui: &mut Ui, list: &List<'_>, (columns, width): (&Columns, f32), by: &mut SortBy) {
    let List {
        name,
        titles,
        hints,
        first,
        ..
    } = list;
    let (rect, _) = ui.allocate_exact_size(vec2(width, 18.0), Sense::hover());
    columns.paint(ui, rect, *titles, ui.visuals().weak_text_color());
    for (column, sort) in SORTS.into_iter().enumerate() {
        let Some(sort) = sort.filter(|_| columns.has(column)) else {
            continue;
        };
        let right = columns.x(rect, column);
        let left = (right - 0.17 * rect.width()).max(rect.left());
        let place = Rect::from_x_y_ranges(left..=right, rect.y_range());
        let label = match sort {
            SortBy::Number => format!("Sort {name} by {first}"),
            _ => format!("Sort {name} by {}", titles[column].to_lowercase()),
        };
        let response = ui.interact(place, ui.scope_id().with((name, column)), Sense::click());
        response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &label));
        if *by == sort {
            let line = (1.5, ui.visuals().text_color());
            ui.painter()
                .hline(place.right() - 24.0..=place.right(), place.bottom(), line);
        }
        match hints[column] {
            "" => hint_ui(&response, &label),
            hint => hint_ui(&response, &format!("{label}: {hint}")),
        }
        if response.clicked() {
            *by = sort;
        }
    }
}

/// Text below the numbers: omitted columns and the reason.
fn below(columns: &Columns, row: &ShoreRow) -> Option<String> {
    let left_out = Some(columns.left_out(row)).filter(|words| !words.is_empty());
    let words: Vec<_> = left_out.into_iter().chain(row.reason.clone()).collect();
    (!words.is_empty()).then(|| words.join("; "))
}

fn below_lines(ui: &Ui, columns: &Columns, row: &ShoreRow, width: f32) -> Option<Arc<Galley>> {
    let words = below(columns, row)?;
    let mut font = FontSelection::Default.resolve(ui.style());
    font.size = BELOW_SIZE;
    let room = columns.width_from_class(width);
    let color = ui.visuals().weak_text_color();
    Some(ui.painter().layout(words, font, color, room))
}

/// All rows of a list have the same height, so that visible rows are known without a layout.
fn row_height(ui: &Ui, list: &List<'_>, columns: &Columns, width: f32) -> f32 {
    let below = list.rows.iter().filter_map(|row| {
        let lines = below_lines(ui, columns, row, width)?;
        Some(lines.size().y - BELOW_RISE + BELOW_GAP)
    });
    ROW_HEIGHT + below.fold(0.0, f32::max)
}

fn row_ui(
    ui: &mut Ui,
    columns: &Columns,
    row: &ShoreRow,
    height: f32,
    is_marked: bool,
) -> Response {
    let size = vec2(ui.available_width(), height);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click());
    let info = || WidgetInfo::labeled(Role::Button, true, &row.sentence);
    response.widget_info(info);
    if is_marked {
        let fill = ui.visuals().selection.bg_fill;
        ui.painter().rect_filled(rect, 3.0, fill);
    } else if response.hovered() || response.has_focus() {
        let fill = ui.visuals().widgets.hovered.weak_bg_fill;
        ui.painter().rect_filled(rect, 3.0, fill);
    }
    let line = Rect::from_min_size(rect.min, vec2(rect.width(), ROW_HEIGHT));
    let left = columns.x(line, CLASS);
    let at = pos2(left, line.center().y - 0.5 * SWATCH.y);
    paint_swatch(ui, Rect::from_min_size(at, SWATCH), &row.class);
    let class = class(row);
    columns.paint(ui, line, texts(row, &class), ui.visuals().text_color());
    if let Some(lines) = below_lines(ui, columns, row, rect.width()) {
        let at = pos2(left, line.bottom() - BELOW_RISE);
        let color = ui.visuals().weak_text_color();
        ui.painter_at(rect).galley(at, lines, color);
    }
    let hint = match &row.reason {
        Some(reason) => format!("{}: {reason}", row.sentence),
        None => format!("{}. Click to show it", row.sentence),
    };
    hint_ui(&response, &hint);
    response
}

/// Hover text beside the panel, so that it does not cover the next rows.
fn hint_ui(response: &Response, hint: &str) {
    let describe = |node: &mut Node| node.set_description(hint);
    response.ctx.accesskit_node_builder(response.id, describe);
    let mut tooltip = Tooltip::for_enabled(response)
        .gap(HINT_GAP)
        .width(HINT_WIDTH);
    tooltip.popup = tooltip
        .popup
        .align(RectAlign::RIGHT)
        .align_alternatives(&[RectAlign::LEFT]);
    tooltip.show(|ui| {
        ui.set_max_width(HINT_WIDTH);
        ui.label(hint);
    });
}

const TO_RIGID: &str = "share of its rigid voxels, such as trunks and stones, not twigs. The vehicle may make the class of \
                        other things, too; Sparse and Dense are for docking in an emergency";
const TO_VOXELS: &str = "how many cubes of the voxel map it is made of";

const CLASS: usize = 1;
const SHARE: usize = 2;
const SIZE: usize = 3;
/// Columns that move below the row if the width is too small, in this order. Name and distance stay.
const LEFT_OUT: [usize; 3] = [CLASS, SHARE, SIZE];
const TEXT_SIZE: f32 = 13.0;
/// Gaps between name, swatch and class; minimum gap between numbers, points.
const SWATCH_GAP: f32 = 6.0;
const GAP: f32 = 8.0;
/// Minimum texts of the columns, so that a number with one more digit does not move them.
const USUAL: [&str; 5] = ["88", "Sparse", "100 %", "88\u{a0}888", "888 m"];

type Texts<'a> = [&'a str; 5];

#[derive(Clone, Copy, Debug, PartialEq)]
struct Columns {
    /// From the left edge, points: the left edge of the class, the right edge of the others.
    at: [f32; 5],
    has: [bool; 5],
}

impl Columns {
    fn new<'a>(ui: &Ui, width: f32, texts: impl IntoIterator<Item = Texts<'a>>) -> Self {
        let mut widths = [0.0_f32; 5];
        for texts in texts {
            for (widest, text) in widths.iter_mut().zip(texts) {
                *widest = widest.max(text_width(ui, text));
            }
        }
        let usual = USUAL.map(|text| text_width(ui, text));
        Self::of(width, widths, usual)
    }

    fn of(width: f32, widths: [f32; 5], usual: [f32; 5]) -> Self {
        let mut roomy = widths;
        for (width, usual) in roomy.iter_mut().zip(usual) {
            *width = width.max(usual);
        }
        let mut has = [true; 5];
        let (mut columns, mut gap) = Self::spread(width, roomy, has);
        for left_out in LEFT_OUT {
            if gap >= GAP {
                break;
            }
            has[left_out] = false;
            (columns, gap) = Self::spread(width, widths, has);
        }
        columns
    }

    /// Distributes the columns up to the right edge. Returns the gap between numbers, points.
    fn spread(width: f32, widths: [f32; 5], has: [bool; 5]) -> (Self, f32) {
        let class = if has[CLASS] {
            SWATCH_GAP + widths[CLASS]
        } else {
            0.0
        };
        let [name, ..] = widths;
        let begin = name + SWATCH_GAP + SWATCH.x + class;
        let numbers = widths[SHARE..].iter().zip(&has[SHARE..]);
        let numbers: Vec<_> = numbers
            .filter_map(|(width, has)| has.then_some(width))
            .collect();
        let gap = (width - begin - numbers.iter().copied().sum::<f32>()) / numbers.len() as f32;
        let mut at = [name, name + SWATCH_GAP, 0.0, 0.0, 0.0];
        let mut end = begin;
        for ((at, width), has) in at[SHARE..]
            .iter_mut()
            .zip(&widths[SHARE..])
            .zip(&has[SHARE..])
        {
            if *has {
                end += gap + width;
            }
            *at = end;
        }
        (Self { at, has }, gap)
    }

    const fn has(&self, column: usize) -> bool {
        self.has[column]
    }

    fn left_out(&self, row: &ShoreRow) -> String {
        let class = class(row);
        let (share, size) = if row.is_site() {
            (format!("cost {}", row.share), format!("{} wide", row.size))
        } else {
            (
                format!("{} rigid", row.share),
                format!("{} voxels", row.size),
            )
        };
        let words = LEFT_OUT.into_iter().zip([class, share, size]);
        let words = words.filter(|(column, words)| !self.has(*column) && !words.is_empty());
        let words: Vec<_> = words.map(|(_, words)| words).collect();
        capitalised(&words.join(", "))
    }

    fn x(&self, rect: Rect, column: usize) -> f32 {
        rect.left() + self.at[column]
    }

    fn width_from_class(&self, width: f32) -> f32 {
        width - self.at[CLASS]
    }

    fn paint(&self, ui: &Ui, rect: Rect, texts: Texts<'_>, color: Color32) {
        for (column, text) in texts.into_iter().enumerate() {
            let x = self.x(rect, column);
            let (x, align) = if column == CLASS {
                (x + SWATCH.x + SWATCH_GAP, Align2::LEFT_CENTER)
            } else {
                (x, Align2::RIGHT_CENTER)
            };
            if self.has(column) {
                let at = pos2(x, rect.center().y);
                ui.painter().text(at, align, text, font(ui), color);
            }
        }
    }
}

fn texts<'a>(row: &'a ShoreRow, class: &'a str) -> Texts<'a> {
    [&row.name, class, &row.share, &row.size, &row.distance]
}

fn class(row: &ShoreRow) -> String {
    if row.is_site() {
        String::new()
    } else {
        capitalised(&row.class.label)
    }
}

fn font(ui: &Ui) -> FontId {
    let mut font = FontSelection::Default.resolve(ui.style());
    font.size = TEXT_SIZE;
    font
}

fn text_width(ui: &Ui, text: &str) -> f32 {
    let galley = ui
        .painter()
        .layout_no_wrap(text.to_owned(), font(ui), Color32::BLACK);
    galley.size().x.ceil()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTHS: [f32; 5] = [20.0, 40.0, 30.0, 40.0, 30.0];
    const USUAL: [f32; 5] = [16.0, 0.0, 36.0, 42.0, 38.0];

    #[test]
    fn narrow_columns_are_omitted_except_distance() {
        const NAME: f32 = 20.0 + 6.0 + 18.0;
        let three = NAME + 100.0 + 3.0 * 8.0;
        let two = NAME + 70.0 + 2.0 * 8.0;
        for (width, has) in [
            (three, [true, false, true, true, true]),
            (three - 1.0, [true, false, false, true, true]),
            (two, [true, false, false, true, true]),
            (two - 1.0, [true, false, false, false, true]),
            (NAME, [true, false, false, false, true]),
        ] {
            let columns = Columns::of(width, WIDTHS, USUAL);
            assert_eq!(columns.has, has, "{width}");
            assert!((columns.at[4] - width).abs() < 1e-3, "{columns:?}");
        }
    }
}
