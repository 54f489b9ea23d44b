//! The lists: a click shows a shore on the map, the hand over a row marks it there, a title sorts.

use eframe::egui::accesskit::Role;
use eframe::egui::{
    Align2, FontSelection, Id, Rect, Response, RichText, ScrollArea, Sense, Ui, WidgetInfo, pos2,
    vec2,
};

use super::super::legend::{SWATCH, paint_swatch};
use super::super::wording::capitalised;
use super::{ShoreRow, ShoresData, SortBy, sort};
use crate::command::Look;
use crate::map_view::ShoreMark;

/// The columns need it, points.
const LEAST_WIDTH: f32 = 310.0;
const ROW_HEIGHT: f32 = 24.0;
/// Of a row with its reason below.
const TALL_ROW_HEIGHT: f32 = 40.0;
/// The lists scroll beyond this: eight rows.
const LIST_HEIGHT: f32 = 192.0;
/// Where the columns are, as shares of the width: name, class, share, size, distance. Numbers end there.
const COLUMNS: [f32; 5] = [0.11, 0.14, 0.62, 0.81, 1.0];
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
    called_by: &'static str,
    why: &'static str,
    titles: [&'static str; 5],
    /// What the first column sorts by, in words.
    first: &'static str,
    usual: SortBy,
    /// What is said of the usual order.
    usually: &'static str,
    rows: &'a [ShoreRow],
    row_height: f32,
}

/// What a list asks for.
#[derive(Default)]
struct Asked {
    clicked: Option<Look>,
    hovered: Option<ShoreMark>,
}

/// Draws the panel; where to look when a row was clicked, and what to mark when the hand is over another. Where it is too narrow
/// for the columns, it scrolls sideways.
pub fn shores_ui(ui: &mut Ui, data: &ShoresData) -> Option<Look> {
    let shown = ScrollArea::horizontal()
        .auto_shrink([false, true])
        .show(ui, |ui| {
            ui.set_min_width(LEAST_WIDTH);
            lists_ui(ui, data)
        });
    shown.inner
}

fn lists_ui(ui: &mut Ui, data: &ShoresData) -> Option<Look> {
    for note in &data.notes {
        ui.label(RichText::new(note).small());
    }
    let mut asked = Asked::default();
    let shores = List {
        name: "shores",
        called_by: "Shores, by number",
        why: "The robot numbers its shores, and the map shows the numbers.",
        titles: ["No.", "Class", "Rigid", "Voxels", "Away"],
        first: "no.",
        usual: SortBy::Distance,
        usually: "the nearest first",
        rows: &data.shores,
        row_height: ROW_HEIGHT,
    };
    let sites = List {
        name: "docking sites",
        called_by: "Docking sites, by letter",
        why: "A letter stays with its place, also on the map, whichever site is the best.",
        titles: ["Site", "", "Cost", "Width", "Away"],
        first: "rank",
        usual: SortBy::Number,
        usually: "the best first",
        rows: &data.sites,
        row_height: TALL_ROW_HEIGHT,
    };
    for list in [shores, sites] {
        list_ui(ui, &list, data.marked, &mut asked);
    }
    let is_other = asked.hovered != data.hovered;
    asked
        .clicked
        .or_else(|| is_other.then_some(Look::Hover(asked.hovered)))
}

fn list_ui(ui: &mut Ui, list: &List<'_>, marked: Option<ShoreMark>, asked: &mut Asked) {
    if list.rows.is_empty() {
        return;
    }
    let mut rows = list.rows.to_vec();
    let id = Id::unique(list.name).with("sorted by");
    let mut by = ui.data(|data| data.get_temp(id)).unwrap_or(list.usual);
    let heading = if by == list.usual {
        format!("{}, {}", list.called_by, list.usually)
    } else {
        list.called_by.to_owned()
    };
    ui.label(RichText::new(heading).small())
        .on_hover_text(list.why);
    titles_ui(ui, list, &mut by);
    ui.data_mut(|data| data.insert_temp(id, by));
    sort(&mut rows, by);
    ui.scope(|ui| {
        ui.spacing_mut().item_spacing.y = 0.0;
        ScrollArea::vertical()
            .id_salt(list.name)
            .max_height(LIST_HEIGHT)
            .auto_shrink([false, true])
            .show_rows(ui, list.row_height, rows.len(), |ui, shown| {
                for row in &rows[shown] {
                    let is_marked = marked == Some(row.mark);
                    let response = row_ui(ui, row, list.row_height, is_marked);
                    if response.hovered() {
                        asked.hovered = Some(row.mark);
                    }
                    if response.clicked() {
                        asked.clicked = Some(Look::Mark(row.mark, row.center_m));
                    }
                }
            });
    });
}

/// The titles of the columns; those that are numbers sort.
fn titles_ui(ui: &mut Ui, list: &List<'_>, by: &mut SortBy) {
    let List {
        name,
        titles,
        first,
        ..
    } = list;
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 18.0), Sense::hover());
    paint_columns(ui, rect, *titles, true);
    for (column, sort) in SORTS.into_iter().enumerate() {
        let Some(sort) = sort else { continue };
        let right = column_x(rect, column);
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
        if response.on_hover_text(label).clicked() {
            *by = sort;
        }
    }
}

fn row_ui(ui: &mut Ui, row: &ShoreRow, height: f32, is_marked: bool) -> Response {
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
    let at = pos2(column_x(line, 1), line.center().y - 0.5 * SWATCH.y);
    paint_swatch(ui, Rect::from_min_size(at, SWATCH), &row.class);
    let class = capitalised(&row.class.label);
    let ShoreRow {
        name,
        share,
        size,
        distance,
        ..
    } = row;
    paint_columns(ui, line, [name, &class, share, size, distance], false);
    if let Some(reason) = &row.reason {
        let mut font = FontSelection::Default.resolve(ui.style());
        font.size = 12.0;
        let at = pos2(column_x(line, 1), line.bottom() - 2.0);
        let color = ui.visuals().weak_text_color();
        ui.painter_at(rect)
            .text(at, Align2::LEFT_TOP, reason, font, color);
    }
    match &row.reason {
        Some(reason) => response.on_hover_text(format!("{}: {reason}", row.sentence)),
        None => response.on_hover_text(format!("{}. Click to show it", row.sentence)),
    }
}

fn column_x(rect: Rect, column: usize) -> f32 {
    rect.left() + COLUMNS[column] * rect.width()
}

fn paint_columns(ui: &Ui, rect: Rect, texts: [&str; 5], is_title: bool) {
    let color = if is_title {
        ui.visuals().weak_text_color()
    } else {
        ui.visuals().text_color()
    };
    let mut font = FontSelection::Default.resolve(ui.style());
    font.size = 13.0;
    for (column, text) in texts.into_iter().enumerate() {
        let (x, align) = if column == 1 {
            (column_x(rect, column) + SWATCH.x + 6.0, Align2::LEFT_CENTER)
        } else {
            (column_x(rect, column), Align2::RIGHT_CENTER)
        };
        ui.painter()
            .text(pos2(x, rect.center().y), align, text, font.clone(), color);
    }
}
