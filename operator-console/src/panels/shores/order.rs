//! In which order the rows of a list stand: as its column says, and still while the pointer is among them.
//!
//! Distances change with every pose. Rows that changed places below the pointer would be clicked by mistake.

use eframe::egui::{Id, Rect, Ui};

use super::{ShoreRow, SortBy, sort};
use crate::map_view::ShoreMark;

/// How a list was drawn.
#[derive(Clone, Debug)]
struct DrawnList {
    /// In which pass: the order of a list that was hidden since is no longer what anybody sees.
    pass: u64,
    by: SortBy,
    /// Where its rows were, points of the screen.
    place: Rect,
    /// From above.
    order: Vec<ShoreMark>,
}

/// Sorts rows; while the pointer is among them, those that were there stay as they were drawn last, and new ones come
/// after them. What the list is remembered by is `id`.
pub(super) fn arrange(ui: &Ui, id: Id, rows: &mut [ShoreRow], by: SortBy) {
    sort(rows, by);
    let drawn: Option<DrawnList> = ui.data(|data| data.get_temp(id));
    let is_held = |drawn: &DrawnList| {
        drawn.by == by
            && drawn.pass + 1 == ui.ctx().cumulative_pass_nr()
            && ui.rect_contains_pointer(drawn.place)
    };
    if let Some(drawn) = drawn.filter(is_held) {
        keep_order(rows, &drawn.order);
    }
}

/// These rows were drawn in this order, sorted by `by`, and there (points of the screen).
pub(super) fn remember(ui: &Ui, id: Id, rows: &[ShoreRow], by: SortBy, place: Rect) {
    let drawn = DrawnList {
        pass: ui.ctx().cumulative_pass_nr(),
        by,
        place,
        order: rows.iter().map(|row| row.mark).collect(),
    };
    ui.data_mut(|data| data.insert_temp(id, drawn));
}

/// Rows in this order; those that it does not have come after the others, as they stood among themselves.
fn keep_order(rows: &mut [ShoreRow], order: &[ShoreMark]) {
    rows.sort_by_cached_key(|row| {
        let at = order.iter().position(|mark| *mark == row.mark);
        at.unwrap_or(order.len())
    });
}
