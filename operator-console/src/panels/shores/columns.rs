//! Where the columns of the lists are: as wide as what stands in them, and as far apart as there is room for.

use eframe::egui::{Align2, Color32, FontId, FontSelection, Rect, Ui, pos2};

use super::super::legend::SWATCH;
use super::super::wording::capitalised;
use super::ShoreRow;

/// Which of the columns is the class.
pub(super) const CLASS: usize = 1;
/// Of what stands in the columns, points.
const TEXT_SIZE: f32 = 13.0;
/// Between a name and its class, between that and its name, and between numbers at least, points.
const SWATCH_GAP: f32 = 6.0;
const GAP: f32 = 8.0;
/// What is usual in the columns has room in any case: a number that grows by a digit changes nothing.
const USUAL: [&str; 5] = ["88", "Sparse", "100 %", "88\u{a0}888", "888 m"];

/// What stands in one row, or above all.
pub(super) type Texts<'a> = [&'a str; 5];

/// Where the columns are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Columns {
    /// From the left edge, points: where the class begins, and where the others end.
    at: [f32; 5],
    /// Whether the class is there in words.
    pub(super) has_class: bool,
}

impl Columns {
    /// Columns for all of these, where they have so much width, points. Where it is too little for classes in words, those
    /// are left out.
    pub(super) fn new<'a>(ui: &Ui, width: f32, texts: impl IntoIterator<Item = Texts<'a>>) -> Self {
        let mut widths = [0.0_f32; 5];
        for texts in texts {
            for (widest, text) in widths.iter_mut().zip(texts) {
                *widest = widest.max(text_width(ui, text));
            }
        }
        let usual = USUAL.map(|text| text_width(ui, text));
        Self::of(width, widths, usual)
    }

    /// For what is so wide, and what is usual.
    fn of(width: f32, mut widths: [f32; 5], usual: [f32; 5]) -> Self {
        let before_numbers = |[name, class, ..]: [f32; 5], has_class: bool| {
            let words = if has_class { SWATCH_GAP + class } else { 0.0 };
            name + SWATCH_GAP + SWATCH.x + words
        };
        let numbers = |widths: [f32; 5]| widths[2..].iter().sum::<f32>();
        let mut roomy = widths;
        for (width, usual) in roomy.iter_mut().zip(usual) {
            *width = width.max(usual);
        }
        let has_class = before_numbers(roomy, true) + numbers(roomy) + 3.0 * GAP <= width;
        if has_class {
            widths = roomy;
        }
        let begin = before_numbers(widths, has_class);
        let gap = (width - begin - numbers(widths)) / 3.0;
        let mut at = [widths[0], widths[0] + SWATCH_GAP, 0.0, 0.0, 0.0];
        let mut end = begin;
        for (at, width) in at[2..].iter_mut().zip(&widths[2..]) {
            end += gap + width;
            *at = end;
        }
        Self { at, has_class }
    }

    /// Where one is in a row, points of the screen: the left edge of the class, the right edge of any other.
    pub(super) fn x(&self, rect: Rect, column: usize) -> f32 {
        rect.left() + self.at[column]
    }

    /// What is left of so much width from where the class begins, points.
    pub(super) fn width_from_class(&self, width: f32) -> f32 {
        width - self.at[CLASS]
    }

    /// Draws a row of texts; the class only where it has room.
    pub(super) fn paint(&self, ui: &Ui, rect: Rect, texts: Texts<'_>, color: Color32) {
        for (column, text) in texts.into_iter().enumerate() {
            let x = self.x(rect, column);
            let (x, align) = if column == CLASS {
                (x + SWATCH.x + SWATCH_GAP, Align2::LEFT_CENTER)
            } else {
                (x, Align2::RIGHT_CENTER)
            };
            if column != CLASS || self.has_class {
                let at = pos2(x, rect.center().y);
                ui.painter().text(at, align, text, font(ui), color);
            }
        }
    }
}

/// What a row has in the columns, where `class` is its class in words.
pub(super) fn texts<'a>(row: &'a ShoreRow, class: &'a str) -> Texts<'a> {
    [&row.name, class, &row.share, &row.size, &row.distance]
}

/// The class of a row in words; of a docking site nothing, for its list is of no others.
pub(super) fn class(row: &ShoreRow) -> String {
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
    /// A name, a class with its colour, numbers, and what lies between them.
    const WHOLE: f32 = 20.0 + 6.0 + 18.0 + 6.0 + 40.0 + 36.0 + 42.0 + 38.0 + 3.0 * 8.0;

    #[test]
    fn classes_are_in_words_where_all_that_is_usual_has_room() {
        let fits = Columns::of(WHOLE, WIDTHS, USUAL);
        let narrow = Columns::of(WHOLE - 1.0, WIDTHS, USUAL);
        assert!(fits.has_class && !narrow.has_class);
        let bits = |at: &[f32]| at.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&fits.at), bits(&[20.0, 26.0, 134.0, 184.0, 230.0]));
        // As far apart as they can be, and up to the right edge.
        assert_eq!(bits(&narrow.at[..2]), bits(&[20.0, 26.0]));
        assert!((narrow.at[4] - 229.0).abs() < 1e-3, "{narrow:?}");
        let gap = (229.0 - 44.0 - 100.0) / 3.0;
        assert!(
            (narrow.at[2] - 44.0 - gap - 30.0).abs() < 1e-3,
            "{narrow:?}"
        );
    }

    #[test]
    fn what_is_wider_than_usual_has_what_it_needs() {
        let mut long = WIDTHS;
        long[3] = 60.0;
        assert!(!Columns::of(WHOLE, long, USUAL).has_class);
        let wide = Columns::of(WHOLE + 18.0, long, USUAL);
        assert!(wide.has_class);
        assert!(wide.at[3] - 60.0 - wide.at[2] > 7.9, "{wide:?}");
    }
}
