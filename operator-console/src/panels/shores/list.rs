//! The lists: a click shows a shore on the map and marks its row, the hand over a row lets it stand out there, too, a title
//! sorts.

use std::sync::Arc;

use eframe::egui::accesskit::Role;
use eframe::egui::{
    FontSelection, Galley, Id, Rect, RectAlign, Response, RichText, ScrollArea, Sense, Tooltip, Ui,
    WidgetInfo, pos2, vec2,
};

use super::super::legend::{SWATCH, paint_swatch};
use super::columns::{CLASS, Columns, RIGID, TO_RIGID, TO_VOXELS, VOXELS, class, texts};
use super::distance::{TO_SHORES, TO_SITES};
use super::order::{arrange, remember};
use super::{ShoreRow, ShoresData, SortBy};
use crate::command::Look;
use crate::map_view::ShoreMark;

/// A name, its colour and how far away it is need it, points: nobody makes a panel so narrow to read it.
const LEAST_WIDTH: f32 = 110.0;
/// Longer lists may scroll in a panel that is narrow, and have a bar beside the numbers.
const FEW: usize = 4;
const ROW_HEIGHT: f32 = 24.0;
/// Of what stands below the numbers of a row.
const BELOW_SIZE: f32 = 12.0;
/// It reaches a little into the row's first line, points.
const BELOW_RISE: f32 = 4.0;
/// Under the last line of a row that has several, points.
const BELOW_GAP: f32 = 6.0;
/// The lists scroll beyond this: eight rows.
const LIST_HEIGHT: f32 = 192.0;
/// On the right of the numbers, points.
const BAR: f32 = 12.0;
/// From a row to what is told of it beside the panel, and how wide that is at most, points.
const HINT_GAP: f32 = 14.0;
const HINT_WIDTH: f32 = 260.0;
/// What each column but the class sorts by.
const SORTS: [Option<SortBy>; 5] = [
    Some(SortBy::Number),
    None,
    Some(SortBy::Share),
    Some(SortBy::Size),
    Some(SortBy::Distance),
];

/// What is listed, and how.
struct List<'a> {
    name: &'static str,
    /// What its rows are called by.
    heading_text: &'static str,
    why: &'static str,
    titles: [&'static str; 5],
    /// From where to where the last column is.
    away: &'static str,
    /// What the first column sorts by, in words.
    first: &'static str,
    usual: SortBy,
    /// What is said of the usual order.
    usually: &'static str,
    rows: &'a [ShoreRow],
}

/// What a list asks for.
#[derive(Default)]
struct ListResponse {
    clicked: Option<Look>,
    hovered: Option<ShoreMark>,
}

/// Draws the panel; where to look when a row was clicked, and what stands out, too, when the hand is over another.
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
    // Bars of lists that scroll lie over their right edge.
    ui.set_max_width(ui.available_width() - BAR);
    for note in &data.notes {
        ui.label(RichText::new(note).small());
    }
    let mut asked = ListResponse::default();
    let shores = List {
        name: "shores",
        heading_text: "Shores, called by number",
        why: "The robot numbers its shores, and the map shows the numbers. Numbers change while the robot learns: what \
              has merged keeps the number of the larger part, a part that comes off gets a new number, and no number is \
              given twice.",
        titles: ["No.", "Class", RIGID, VOXELS, "Away"],
        away: TO_SHORES,
        first: "no.",
        usual: SortBy::Distance,
        usually: "the nearest first",
        rows: &data.shores,
    };
    let sites = List {
        name: "docking sites",
        heading_text: "Docking sites, called by letter",
        why: "The least mean slope cost first, in steps of 0.05; of the same step, the widest. A letter stays with its \
              place, also on the map, whichever site is the first. The robot looks for sites in its window: what it has left behind \
              keeps its class on the map, and has no letter.",
        titles: ["Site", "", "Cost", "Width", "Away"],
        away: TO_SITES,
        first: "rank",
        usual: SortBy::Number,
        usually: "the gentlest first by steps of 0.05, then the widest",
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

/// Where the columns are, how wide they are together, and how high the rows of each list are, points. A list that scrolls has a
/// bar of its own, which lies beside them.
fn room(ui: &Ui, lists: &[List<'_>; 2]) -> (Columns, f32, [f32; 2]) {
    let width = ui.available_width();
    let heights = |columns: &Columns, width: f32| {
        lists
            .each_ref()
            .map(|list| row_height(ui, list, columns, width))
    };
    let scrolls = |list: &List<'_>, height: f32| height * list.rows.len() as f32 > LIST_HEIGHT;
    // No row is lower than its numbers: many scroll whatever stands below these, which is laid out once for them.
    if !lists.iter().any(|list| scrolls(list, ROW_HEIGHT)) {
        let whole = columns(ui, lists, width);
        let heights = heights(&whole, width);
        let mut rows = lists.iter().zip(heights);
        if !rows.any(|(list, height)| scrolls(list, height)) {
            return (whole, width, heights);
        }
    }
    // With less room its rows are no lower: it scrolls all the same.
    let width = width - BAR;
    let columns = columns(ui, lists, width);
    let heights = heights(&columns, width);
    (columns, width, heights)
}

/// The same for all lists that have something in them.
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

/// The titles of the columns; those that are numbers sort.
fn titles_ui(ui: &mut Ui, list: &List<'_>, (columns, width): (&Columns, f32), by: &mut SortBy) {
    let List {
        name,
        titles,
        away,
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
            SortBy::Share | SortBy::Size | SortBy::Distance => {
                format!("Sort {name} by {}", titles[column].to_lowercase())
            }
        };
        let response = ui.interact(place, ui.scope_id().with((name, column)), Sense::click());
        response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &label));
        if *by == sort {
            let line = (1.5, ui.visuals().text_color());
            ui.painter()
                .hline(place.right() - 24.0..=place.right(), place.bottom(), line);
        }
        match sort {
            SortBy::Distance => hint_ui(&response, &format!("{label}: {away}")),
            // Of docking sites there are other figures in these columns.
            SortBy::Share if titles[column] == RIGID => {
                hint_ui(&response, &format!("{label}: {TO_RIGID}"));
            }
            SortBy::Size if titles[column] == VOXELS => {
                hint_ui(&response, &format!("{label}: {TO_VOXELS}"));
            }
            SortBy::Number | SortBy::Share | SortBy::Size => hint_ui(&response, &label),
        }
        if response.clicked() {
            *by = sort;
        }
    }
}

/// What stands below the numbers of a row: what has no room beside them, and the reason of a docking site.
fn below(columns: &Columns, row: &ShoreRow) -> Option<String> {
    let left_out = Some(columns.left_out(row)).filter(|words| !words.is_empty());
    let words: Vec<_> = left_out.into_iter().chain(row.reason.clone()).collect();
    (!words.is_empty()).then(|| words.join("; "))
}

/// The same in lines, none of which is wider than the panel.
fn below_lines(ui: &Ui, columns: &Columns, row: &ShoreRow, width: f32) -> Option<Arc<Galley>> {
    let words = below(columns, row)?;
    let mut font = FontSelection::Default.resolve(ui.style());
    font.size = BELOW_SIZE;
    let room = columns.width_from_class(width);
    let color = ui.visuals().weak_text_color();
    Some(ui.painter().layout(words, font, color, room))
}

/// Rows are as high as the highest of them: so it is known which of many are in sight.
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

/// Beside the panel: below the hand it would hide the rows that are read next.
fn hint_ui(response: &Response, hint: &str) {
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
