//! Where the columns of the lists are: as wide as what stands in them, and as far apart as there is room for.

use eframe::egui::{Align2, Color32, FontId, FontSelection, Rect, Ui, pos2};

use super::super::formatting::capitalised;
use super::super::legend::SWATCH;
use super::ShoreRow;

pub(super) const RIGID: &str = "Rigid";
pub(super) const VOXELS: &str = "Voxels";
/// What stands in these columns.
pub(super) const TO_RIGID: &str = "share of its voxels in which something rigid stands, a trunk or a stone and no twig. Below 25 % \
                                   the shore is Sparse, above 68 % Solid, between them Dense; the first two are for docking in \
                                   an emergency";
pub(super) const TO_VOXELS: &str = "how many cubes of the voxel map it is made of";

/// Which of the columns is the class, which the share and which the size.
pub(super) const CLASS: usize = 1;
const SHARE: usize = 2;
const SIZE: usize = 3;
/// What stands below a row where it has no room beside the others, one after the other. What the row is called and how
/// far away it is stay.
const LEFT_OUT: [usize; 3] = [CLASS, SHARE, SIZE];
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
    /// Which are there: the class in words.
    has: [bool; 5],
}

impl Columns {
    /// Columns for as many of these as there is room for where they have so much width, points.
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

    /// Those that are there, and how far apart their numbers are, points: as far as they can be, up to the right edge.
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

    /// Whether a column is there, the class in words.
    pub(super) const fn has(&self, column: usize) -> bool {
        self.has[column]
    }

    /// What of a row is in no column, in words; empty where all is.
    pub(super) fn left_out(&self, row: &ShoreRow) -> String {
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

    /// Where one is in a row, points of the screen: the left edge of the class, the right edge of any other.
    pub(super) fn x(&self, rect: Rect, column: usize) -> f32 {
        rect.left() + self.at[column]
    }

    /// What is left of so much width from where the class begins, points.
    pub(super) fn width_from_class(&self, width: f32) -> f32 {
        width - self.at[CLASS]
    }

    /// Draws a row of texts, as far as they have columns.
    pub(super) fn paint(&self, ui: &Ui, rect: Rect, texts: Texts<'_>, color: Color32) {
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
        assert_eq!(fits.has, [true; 5]);
        assert_eq!(narrow.has, [true, false, true, true, true]);
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
        assert!(!Columns::of(WHOLE, long, USUAL).has(CLASS));
        let wide = Columns::of(WHOLE + 18.0, long, USUAL);
        assert!(wide.has(CLASS));
        assert!(wide.at[3] - 60.0 - wide.at[2] > 7.9, "{wide:?}");
    }

    #[test]
    fn numbers_that_would_touch_are_left_out_but_for_how_far_away_it_is() {
        /// A name and its colour.
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
            // The last ends where the row does.
            assert!((columns.at[4] - width).abs() < 1e-3, "{columns:?}");
        }
    }
}
