//! Legends: a colour scale with numbers, or classes with names, for each drawn layer, and the marks on the map.

use std::sync::Arc;

use eframe::egui::{
    Align2, Color32, Galley, Label, Mesh, Rangef, Rect, RichText, Sense, Shape, Stroke, StrokeKind,
    TextStyle, Ui, Vec2, pos2, vec2,
};
use protocol::layer::{LayerId, Palette, Ramp, Swatch};

use super::formatting::capitalised;
use super::layers::layer_name;
use crate::map_view::Mark;
use crate::theme;

const BAR_HEIGHT: f32 = 10.0;
const TICK: f32 = 3.0;
pub(super) const SWATCH: Vec2 = vec2(18.0, 14.0);
/// Between a colour and its name; also added between a name and the next colour, points.
const SPACING: f32 = 4.0;
const GAP: f32 = 6.0;
/// Space for half of a number at both ends of the bar.
const OVERHANG: f32 = 14.0;
const STEPS: u8 = 64;
/// Between lines; also added between legends, points.
pub const LINES_APART: f32 = 2.0;
const LEGENDS_APART: f32 = 4.0;
const ROW: f32 = 16.0;

/// Free cells of an upper layer are transparent over known cells.
const SEE_THROUGH: &str = "free: clear over the known";

#[derive(Clone, Debug, PartialEq)]
pub struct LegendsData {
    /// Topmost first. "Unknown" is listed once if it looks the same in all.
    pub legends: Vec<Legend>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Legend {
    /// May be empty.
    pub title: String,
    pub ramp: Option<Ramp>,
    pub entries: Vec<LegendEntry>,
}

#[derive(Clone, Debug, PartialEq)]
pub enum LegendEntry {
    Class(Swatch),
    Mark(Mark, Color32),
}

impl LegendEntry {
    fn name(&self) -> &str {
        match self {
            Self::Class(swatch) => &swatch.label,
            Self::Mark(mark, _) => mark.name(),
        }
    }
}

impl LegendsData {
    /// `palettes`: topmost first, with whether each layer is above another.
    pub fn new(palettes: impl IntoIterator<Item = (Palette, bool)>) -> Self {
        let legend = |(palette, is_over): (Palette, bool)| {
            let mut legend = palette.legend();
            if palette.layer() == LayerId::Shore {
                // The map uses the same names.
                "shores 1, 2 …; docking sites A, B …".clone_into(&mut legend.title);
            }
            if is_over
                && palette.layer() == LayerId::Obstacle
                && let Some(free) = legend.swatches.first_mut()
            {
                SEE_THROUGH.clone_into(&mut free.label);
            }
            Legend {
                title: legend.title,
                ramp: legend.ramp,
                entries: legend
                    .swatches
                    .into_iter()
                    .map(LegendEntry::Class)
                    .collect(),
            }
        };
        let mut legends: Vec<_> = palettes.into_iter().map(legend).collect();
        for index in 1..legends.len() {
            let below = legends[index].entries.last().cloned();
            let above = &mut legends[index - 1].entries;
            if above.last() == below.as_ref() {
                above.pop();
            }
        }
        Self { legends }
    }

    pub fn with_short_titles(palettes: impl IntoIterator<Item = (Palette, bool)>) -> Self {
        let palettes: Vec<_> = palettes.into_iter().collect();
        let mut data = Self::new(palettes.iter().copied());
        for (legend, (palette, _)) in data.legends.iter_mut().zip(&palettes) {
            let layer = palette.layer();
            let unit = layer.unit().map(|unit| format!(" ({unit})"));
            legend.title = layer_name(layer).to_owned() + &unit.unwrap_or_default();
        }
        data
    }

    pub fn add_marks(&mut self, marks: &[(Mark, Color32)]) {
        let marks = marks
            .iter()
            .map(|(mark, color)| LegendEntry::Mark(*mark, *color));
        self.legends.push(Legend {
            title: String::new(),
            ramp: None,
            entries: marks.collect(),
        });
    }

    pub fn first_title_fits(&self, ui: &Ui, width: f32) -> bool {
        let first = self.legends.first();
        first.is_none_or(|legend| text(ui, &legend.title, f32::INFINITY).size().x <= width)
    }

    pub fn take_first_title(&mut self) -> String {
        let first = self.legends.first_mut();
        first.map_or_else(String::new, |legend| std::mem::take(&mut legend.title))
    }
}

pub fn title_ui(ui: &mut Ui, title: &str) {
    ui.add(Label::new(RichText::new(capitalised(title)).small()).wrap());
}

pub fn title_height(ui: &Ui, title: &str, width: f32) -> f32 {
    text(ui, title, width).size().y
}

pub fn legends_ui(ui: &mut Ui, data: &LegendsData) {
    ui.spacing_mut().item_spacing.y = LINES_APART;
    for (index, legend) in data.legends.iter().enumerate() {
        if index > 0 {
            ui.add_space(LEGENDS_APART);
        }
        legend_ui(ui, legend);
    }
}

pub fn legends_height(ui: &Ui, data: &LegendsData, width: f32) -> f32 {
    let heights = data.legends.iter().map(|legend| {
        let title = Some(&legend.title).filter(|title| !title.is_empty());
        let title = title.map(|title| title_height(ui, title, width));
        let ramp = legend.ramp.as_ref().map(|_| ramp_height(ui));
        let rows = rows(ui, &legend.entries, width);
        let rows = rows.iter().map(|row| {
            let names = row.iter().map(|entry| {
                let width = name_width(row, width);
                text(ui, entry.name(), width).size().y
            });
            names.fold(ROW, f32::max)
        });
        let parts: Vec<_> = title.into_iter().chain(ramp).chain(rows).collect();
        parts.iter().sum::<f32>() + LINES_APART * (parts.len() as f32 - 1.0)
    });
    let heights: Vec<_> = heights.collect();
    let gaps = (heights.len() as f32 - 1.0).max(0.0) * (LEGENDS_APART + LINES_APART);
    heights.iter().sum::<f32>() + gaps
}

fn text(ui: &Ui, words: &str, width: f32) -> Arc<Galley> {
    let font = TextStyle::Small.resolve(ui.style());
    ui.painter()
        .layout(capitalised(words), font, Color32::BLACK, width)
}

fn legend_ui(ui: &mut Ui, legend: &Legend) {
    ui.spacing_mut().interact_size.y = ROW;
    if !legend.title.is_empty() {
        title_ui(ui, &legend.title);
    }
    if let Some(ramp) = &legend.ramp {
        ramp_ui(ui, ramp);
    }
    let width = ui.available_width();
    for row in rows(ui, &legend.entries, width) {
        ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = SPACING;
            for (index, entry) in row.iter().enumerate() {
                if index > 0 {
                    ui.add_space(GAP);
                }
                entry_ui(ui, entry, name_width(row, width).is_finite());
            }
        });
    }
}

/// Width of a name in a row, points. In a row of several entries all names fit.
fn name_width(row: &[LegendEntry], width: f32) -> f32 {
    match row {
        [_alone] => width - SWATCH.x - SPACING,
        _several => f32::INFINITY,
    }
}

/// Distributes entries over rows of this width. A long name has a row of its own.
fn rows<'a>(ui: &Ui, entries: &'a [LegendEntry], width: f32) -> Vec<&'a [LegendEntry]> {
    let of = |entry: &LegendEntry| {
        let text = text(ui, entry.name(), f32::INFINITY);
        SWATCH.x + SPACING + text.size().x
    };
    let mut rows = Vec::new();
    let (mut first, mut taken) = (0, 0.0);
    for (index, entry) in entries.iter().enumerate() {
        let wanted = of(entry);
        if index > first && taken + wanted > width {
            rows.push(&entries[first..index]);
            (first, taken) = (index, 0.0);
        }
        taken += wanted + SPACING + GAP;
    }
    if first < entries.len() {
        rows.push(&entries[first..]);
    }
    rows
}

fn is_see_through(swatch: &Swatch) -> bool {
    swatch.label == SEE_THROUGH
}

pub(super) fn paint_swatch(ui: &Ui, rect: Rect, swatch: &Swatch) {
    let of = |[red, green, blue, alpha]: [u8; 4]| {
        Color32::from_rgba_unmultiplied(red, green, blue, alpha)
    };
    if is_see_through(swatch) {
        let half = vec![rect.left_bottom(), rect.right_top(), rect.right_bottom()];
        let color = of(swatch.color);
        ui.painter()
            .add(Shape::convex_polygon(half, color, Stroke::NONE));
        let ink = ui.visuals().weak_text_color();
        let line = [rect.left_bottom(), rect.right_top()];
        ui.painter().line_segment(line, Stroke::new(1.0, ink));
        return frame(ui, rect);
    }
    // Translucent colours are drawn over the map's background.
    ui.painter()
        .rect_filled(rect, 0.0, theme::ground(ui.visuals()));
    ui.painter().rect_filled(rect, 0.0, of(swatch.color));
    let mut marks = Mesh::default();
    let [width, height] = [rect.width(), rect.height()].map(|side| side as usize);
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        if swatch.pattern.is_mark(x, y) {
            let at = rect.min + vec2(x as f32, y as f32);
            marks.add_colored_rect(Rect::from_min_size(at, Vec2::splat(1.0)), of(swatch.mark));
        }
    }
    ui.painter().add(marks);
    frame(ui, rect);
}

fn entry_ui(ui: &mut Ui, entry: &LegendEntry, may_wrap: bool) {
    let (rect, _) = ui.allocate_exact_size(SWATCH, Sense::hover());
    match entry {
        LegendEntry::Class(swatch) => paint_swatch(ui, rect, swatch),
        LegendEntry::Mark(mark, color) => {
            let painter = ui.painter().with_clip_rect(ui.clip_rect().intersect(rect));
            painter.rect_filled(rect, 0.0, theme::ground(ui.visuals()));
            mark.paint_sample(&painter, rect.shrink(1.0), *color);
            frame(ui, rect);
        }
    }
    let name = Label::new(RichText::new(capitalised(entry.name())).small());
    ui.add(if may_wrap { name.wrap() } else { name.extend() });
}

fn ramp_height(ui: &Ui) -> f32 {
    BAR_HEIGHT + TICK + TextStyle::Small.resolve(ui.style()).size + 4.0
}

fn ramp_ui(ui: &mut Ui, ramp: &Ramp) {
    let font = TextStyle::Small.resolve(ui.style());
    let size = vec2(ui.available_width(), ramp_height(ui));
    let (rect, _) = ui.allocate_exact_size(size, Sense::hover());
    let bar =
        Rect::from_min_size(rect.min, vec2(rect.width(), BAR_HEIGHT)).shrink2(vec2(OVERHANG, 0.0));
    let x_of = |value: f32| {
        let part = (value - ramp.low) / (ramp.high - ramp.low);
        bar.left() + part.clamp(0.0, 1.0) * bar.width()
    };
    let step = (ramp.high - ramp.low) / f32::from(STEPS);
    for index in 0..STEPS {
        let low = ramp.low + step * f32::from(index);
        let [red, green, blue, _] = ramp.color(low + 0.5 * step);
        let slice = Rect::from_x_y_ranges(x_of(low)..=x_of(low + step), bar.y_range());
        let color = Color32::from_rgb(red, green, blue);
        ui.painter().rect_filled(slice, 0.0, color);
    }
    frame(ui, bar);
    let ink = ui.visuals().text_color();
    let numbers = ramp.ticks.iter().map(|tick| {
        let x = x_of(tick.value);
        let text = ui
            .painter()
            .layout_no_wrap(tick.label.clone(), font.clone(), ink);
        let at = pos2(x, bar.bottom() + TICK + 1.0);
        let place = Align2::CENTER_TOP.anchor_size(at, text.size());
        let shift = (rect.right() - place.right()).min(0.0) + (rect.left() - place.left()).max(0.0);
        (x, place.translate(vec2(shift, 0.0)), text)
    });
    let numbers: Vec<_> = numbers.collect();
    let digits = ui.painter().layout_no_wrap("00".to_owned(), font, ink);
    let spans = numbers.iter().map(|(_, place, _)| place.x_range());
    let is_kept = kept(&spans.collect::<Vec<_>>(), digits.size().x);
    let tick = Rangef::new(bar.bottom(), bar.bottom() + TICK);
    for ((x, place, text), _) in numbers.into_iter().zip(is_kept).filter(|(_, kept)| *kept) {
        ui.painter().vline(x, tick, Stroke::new(1.0, ink));
        ui.painter().galley(place.min, text, ink);
    }
}

/// Indices of the numbers to draw: both ends, and those between that have `apart` points on both sides.
fn kept(spans: &[Rangef], apart: f32) -> Vec<bool> {
    let mut is_kept = vec![false; spans.len()];
    let last = spans.len().saturating_sub(1);
    let from_the_ends = [0, last].into_iter().chain(1..last);
    for index in from_the_ends.filter(|index| *index < spans.len()) {
        let span = spans[index].expand(apart);
        let mut others = spans.iter().zip(&is_kept).filter(|(_, kept)| **kept);
        is_kept[index] |= others.all(|(other, _)| !span.intersects(*other));
    }
    is_kept
}

fn frame(ui: &Ui, rect: Rect) {
    let line = Stroke::new(1.0, ui.visuals().weak_text_color());
    ui.painter()
        .rect_stroke(rect, 0.0, line, StrokeKind::Outside);
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::rc::Rc;

    use super::*;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    #[test]
    fn every_class_and_the_unknown_are_named() {
        for palette in LayerId::ALL.into_iter().flat_map(LayerId::palettes) {
            let data = LegendsData::new([(palette, false)]);
            let harness = Harness::builder()
                .with_size(vec2(236.0, 200.0))
                .build_ui(|ui| legends_ui(ui, &data));
            let title = capitalised(&data.legends[0].title);
            assert!(harness.query_all_by_label(&title).next().is_some());
            for entry in &data.legends[0].entries {
                let name = capitalised(entry.name());
                let place = harness.get_all_by_label(&name).last().unwrap().rect();
                assert!(place.right() <= 236.0, "{name}: {place:?}");
            }
        }
    }

    #[test]
    fn a_scan_is_not_called_an_obstacle() {
        let marks = [Mark::Path, Mark::Scan, Mark::LimitingObstacle];
        let mut data = LegendsData::new([]);
        data.add_marks(&marks.map(|mark| (mark, mark.color())));
        let harness = Harness::builder()
            .with_size(vec2(236.0, 100.0))
            .build_ui(|ui| legends_ui(ui, &data));
        for name in ["Last scan: hits on any surface", "Limiting obstacle"] {
            let place = harness.get_by_label(name).rect();
            assert!(place.right() <= 236.0, "{name}: {place:?}");
        }
    }

    #[test]
    fn legends_have_their_computed_size() {
        for width in [95.0, 150.0, 220.0] {
            // Upper layers have the longest texts.
            let palettes = LayerId::ALL.map(|layer| (layer.default_palette(), true));
            let mut data = LegendsData::with_short_titles(palettes);
            data.add_marks(
                &[Mark::Path, Mark::Scan, Mark::StoppingDistance].map(|mark| (mark, mark.color())),
            );
            if width > 200.0 {
                assert_ne!(data.take_first_title(), "");
            }
            let sizes = Rc::new(Cell::new((0.0, Vec2::ZERO)));
            let seen = Rc::clone(&sizes);
            let mut window = Harness::builder()
                .with_size(vec2(width + 16.0, 900.0))
                .build_ui(move |ui| {
                    ui.set_width(width);
                    let reported = legends_height(ui, &data, width);
                    let drawn = ui.scope(|ui| legends_ui(ui, &data));
                    seen.set((reported, drawn.response.rect.size()));
                });
            crate::theme::set(&window.ctx);
            window.run_steps(3);
            let (reported, drawn) = sizes.get();
            assert!(
                (reported - drawn.y).abs() < 2.0,
                "{width}: {reported} {drawn}"
            );
            assert!(drawn.x < width + 0.5, "{width}: {drawn}");
        }
    }

    #[test]
    fn scale_numbers_do_not_overlap() {
        let check = |spans: &[[f32; 2]], expected: &[bool]| {
            let spans: Vec<_> = spans.iter().map(|[a, b]| Rangef::new(*a, *b)).collect();
            assert_eq!(kept(&spans, 12.0), expected, "{spans:?}");
        };
        // Avoids "0.0  0.2  0.4 ≥ 0.5".
        check(
            &[[0.0, 18.0], [60.0, 78.0], [140.0, 158.0], [163.0, 195.0]],
            &[true, true, false, true],
        );
        check(
            &[[0.0, 18.0], [31.0, 49.0], [62.0, 80.0]],
            &[true, true, true],
        );
        check(
            &[[0.0, 18.0], [29.0, 47.0], [62.0, 80.0]],
            &[true, false, true],
        );
        check(&[[0.0, 18.0], [20.0, 38.0]], &[true, false]);
        check(&[[0.0, 18.0]], &[true]);
        check(&[], &[]);
    }

    #[test]
    fn short_titles() {
        let palettes = [LayerId::Shore, LayerId::Elevation, LayerId::Cost]
            .map(|layer| (layer.default_palette(), false));
        let data = LegendsData::with_short_titles(palettes);
        let titles = data.legends.iter().map(|legend| legend.title.as_str());
        let titles: Vec<_> = titles.collect();
        assert_eq!(titles, ["Shore", "Elevation (m)", "Slope cost"]);
    }

    #[test]
    fn unknown_is_listed_once() {
        let palette = |layer: LayerId| layer.default_palette();
        let both = [
            (palette(LayerId::Obstacle), true),
            (palette(LayerId::Elevation), false),
        ];
        let data = LegendsData::new(both);
        let labels = data.legends.iter().map(|legend| {
            let labels = legend.entries.iter().map(LegendEntry::name);
            labels.collect::<Vec<_>>()
        });
        assert_eq!(
            labels.collect::<Vec<_>>(),
            [
                vec!["free: clear over the known", "obstacle"],
                vec!["unknown"]
            ]
        );
        let entries = data.legends.iter().flat_map(|legend| &legend.entries);
        let see_through = entries
            .map(|entry| matches!(entry, LegendEntry::Class(swatch) if is_see_through(swatch)));
        assert_eq!(see_through.collect::<Vec<_>>(), [true, false, false]);
    }
}
