//! Title and line names above a plot. Inside the plot they would cover its lines.

use std::f32::consts::GOLDEN_RATIO;
use std::sync::Arc;

use eframe::egui::{Color32, Galley, Pos2, Shape, Stroke, TextStyle, Ui, Vec2, pos2, vec2};
use egui_plot::LineStyle;

use super::LinkPlot;

/// Length of a sample line, and the same with its gap, points.
const SAMPLE: f32 = 16.0;
const INDENT: f32 = SAMPLE + 3.0;
/// Horizontal gap, points.
const APART: f32 = 8.0;

pub(super) struct Key {
    words: Vec<KeyText>,
    height: f32,
}

struct KeyText {
    text: Arc<Galley>,
    /// Upper left corner relative to the key, points.
    at: Vec2,
    /// Style of the named line; `None` for the title.
    look: Option<(Color32, LineStyle)>,
}

impl Key {
    /// Lays out the key in `width` points; long texts wrap.
    pub(super) fn new(ui: &Ui, plot: &LinkPlot, width: f32) -> Self {
        let font = TextStyle::Small.resolve(ui.style());
        let lay_out = |words: &str, color, width: f32| {
            let words = words.to_owned();
            ui.painter().layout(words, font.clone(), color, width)
        };
        let title = lay_out(plot.title, ui.visuals().text_color(), width);
        let mut height = title.size().y;
        let mut at = vec2(title.size().x + APART, 0.0);
        let mut words = vec![KeyText {
            text: title,
            at: Vec2::ZERO,
            look: None,
        }];
        // A single line needs no name.
        let lines = plot.lines.iter().filter(|_| plot.lines.len() > 1);
        for ((name, _), look) in lines.zip(looks(ui.visuals().dark_mode)) {
            let text = lay_out(name, look.0, width - INDENT);
            let taken = INDENT + text.size().x;
            if at.x + taken > width {
                at = vec2(0.0, height);
            }
            height = height.max(at.y + text.size().y);
            words.push(KeyText {
                text,
                at,
                look: Some(look),
            });
            at.x += taken + APART;
        }
        Self { words, height }
    }

    /// Total height, points.
    pub(super) const fn height(&self) -> f32 {
        self.height
    }

    pub(super) fn paint(&self, ui: &Ui, corner: Pos2) {
        let ink = ui.visuals().text_color();
        let middle = 0.5 * ui.text_style_height(&TextStyle::Small);
        for KeyText { text, at, look } in &self.words {
            let at = corner + *at;
            let Some((color, style)) = look else {
                ui.painter().galley(at, Arc::clone(text), ink);
                continue;
            };
            let y = at.y + middle;
            let ends = [pos2(at.x, y), pos2(at.x + SAMPLE, y)];
            let line = sample(&ends, *style, Stroke::new(1.5, *color));
            ui.painter().extend(line);
            let at = at + vec2(INDENT, 0.0);
            ui.painter().galley(at, Arc::clone(text), *color);
        }
    }
}

/// Styles of the lines of a plot. They differ by more than their colour.
pub(super) fn looks(dark: bool) -> impl Iterator<Item = (Color32, LineStyle)> {
    const STYLES: [LineStyle; 4] = [
        LineStyle::Solid,
        LineStyle::Dashed { length: 8.0 },
        LineStyle::Dotted { spacing: 4.0 },
        LineStyle::Dashed { length: 3.0 },
    ];
    colors(dark).into_iter().zip(STYLES)
}

const fn colors(dark: bool) -> [Color32; 4] {
    let rgb = Color32::from_rgb;
    if dark {
        [
            rgb(0x56, 0xb4, 0xe9),
            rgb(0xe6, 0x9f, 0x00),
            rgb(0x2f, 0xc4, 0x97),
            rgb(0xcc, 0x79, 0xa7),
        ]
    } else {
        [
            rgb(0x00, 0x5d, 0x92),
            rgb(0xa8, 0x48, 0x00),
            rgb(0x00, 0x74, 0x55),
            rgb(0x8e, 0x24, 0x6a),
        ]
    }
}

/// Sample of a line.
fn sample(ends: &[Pos2], style: LineStyle, stroke: Stroke) -> Vec<Shape> {
    match style {
        LineStyle::Solid => vec![Shape::line(ends.to_vec(), stroke)],
        LineStyle::Dotted { spacing } => {
            Shape::dotted_line(ends, stroke.color, spacing, stroke.width)
        }
        LineStyle::Dashed { length } => {
            let gap = length * (GOLDEN_RATIO - 1.0);
            Shape::dashed_line(ends, stroke, length, gap)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::rc::Rc;

    use eframe::egui::Rect;
    use egui_kittest::Harness;

    use super::*;
    use crate::theme;

    /// Positions of the texts and samples, and the total height.
    fn laid_out(plot: &LinkPlot, width: f32) -> (Vec<Rect>, f32) {
        let seen = Rc::new(RefCell::new((Vec::new(), 0.0)));
        let (plot, kept) = (plot.clone(), Rc::clone(&seen));
        let mut window = Harness::builder().build_ui(move |ui| {
            theme::set(ui.ctx());
            let key = Key::new(ui, &plot, width);
            let place = |words: &KeyText| {
                let indent = words.look.map_or(0.0, |_| INDENT);
                let size = words.text.size() + vec2(indent, 0.0);
                Rect::from_min_size(words.at.to_pos2(), size)
            };
            let places = key.words.iter().map(place).collect();
            *kept.borrow_mut() = (places, key.height());
        });
        window.run_steps(3);
        seen.take()
    }

    #[test]
    fn no_text_of_the_key_is_cut_or_covered() {
        let names = ["Position", "State", "Map summary", "Map tiles"];
        let plot = |title, lines: &[&'static str]| LinkPlot {
            title,
            least: 1.0,
            lines: lines.iter().map(|name| (*name, Vec::new())).collect(),
        };
        let plots = [
            plot("Received, kbit/s", &["Received"]),
            plot("Age, s", &names),
        ];
        for width in [60.0, 112.0, 160.0, 200.0, 368.0] {
            for plot in &plots {
                let (places, height) = laid_out(plot, width);
                let names = plot.lines.len();
                assert_eq!(places.len(), if names > 1 { names + 1 } else { 1 });
                for (index, place) in places.iter().enumerate() {
                    assert!(place.right() <= width + 0.5, "{width}: {place}");
                    assert!(place.bottom() <= height + 0.5, "{width}: {place}");
                    let apart = |other: &Rect| !other.shrink(0.5).intersects(place.shrink(0.5));
                    assert!(places[..index].iter().all(apart), "{width}: {places:?}");
                }
            }
        }
        let (places, height) = laid_out(&plots[1], 400.0);
        assert!(places.iter().all(|place| place.top() < 0.5), "{places:?}");
        assert!(height < 20.0, "{height}");
    }
}
