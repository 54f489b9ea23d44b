//! Plots of the last minutes.

use std::f32::consts::GOLDEN_RATIO;

use eframe::egui::accesskit::Role;
use eframe::egui::{
    Align2, Color32, Pos2, Rect, Shape, Stroke, TextStyle, Ui, WidgetInfo, pos2, vec2,
};
use egui_plot::{Line, LineStyle, Plot, PlotPoints};

use super::LinkPlot;
use super::axis::{Axis, label};

/// What plots reach back, seconds.
const SPAN_S: f64 = 300.0;
/// Least height of a plot, points.
const LEAST: f32 = 62.0;
/// Half the height of a figure on the axis, points.
const AXIS_TEXT: f64 = 8.0;
/// Length of the piece of a line before its name, points.
const SAMPLE: f32 = 16.0;

/// Draws them in so many columns. `height`: of all rows together, as long as none becomes too low.
pub(super) fn plots_ui(ui: &mut Ui, plots: &[LinkPlot], columns: usize, height: f32) {
    let rows = plots.len() / columns;
    let gap = ui.spacing().item_spacing;
    let share =
        |all: f32, gap: f32, count: usize| (all - gap * (count as f32 - 1.0)) / count as f32;
    let size = vec2(
        share(ui.available_width(), gap.x, columns),
        share(height, gap.y, rows).max(LEAST),
    );
    for row in plots.chunks(columns) {
        ui.horizontal(|ui| {
            for plot in row {
                ui.allocate_ui(size, |ui| plot_ui(ui, plot, size.x, size.y));
            }
        });
    }
}

fn plot_ui(ui: &mut Ui, data: &LinkPlot, width: f32, height: f32) {
    let highest = data
        .lines
        .iter()
        .flat_map(|(_, segments)| segments.iter().flatten())
        .fold(data.least, |highest, [_, value]| highest.max(*value));
    // Figures on the axis are written around their lines, and reach beyond the first and the last.
    let between = f64::from(height) - 2.0 * AXIS_TEXT;
    let axis = Axis::new(highest, between);
    let edge = axis.end * AXIS_TEXT / between;
    let plot = Plot::new(data.title)
        .width(width)
        .height(height)
        .allow_drag(false)
        .allow_zoom(false)
        .allow_scroll(false)
        .allow_boxed_zoom(false)
        .allow_double_click_reset(false)
        .show_x(false)
        .include_x(-SPAN_S)
        .include_x(0.0)
        .include_y(-edge)
        .include_y(axis.end + edge)
        .set_margin_fraction(vec2(0.0, 0.0))
        .x_grid_spacer(|_input| {
            (-5..=0)
                .map(|minutes| egui_plot::GridMark {
                    value: f64::from(minutes) * 60.0,
                    step_size: 60.0,
                })
                .collect()
        })
        .y_grid_spacer(move |_input| axis.marks())
        .y_axis_formatter(|mark, _range| label(mark))
        .show_axes([false, true])
        .y_axis_min_width(34.0);
    let dark = ui.visuals().dark_mode;
    let shown = plot.show(ui, |plot| {
        let styles = colors(dark).into_iter().zip(STYLES);
        for ((name, segments), (color, style)) in data.lines.iter().zip(styles) {
            for segment in segments {
                let points = PlotPoints::from(segment.clone());
                plot.line(
                    Line::new(*name, points)
                        .color(color)
                        .width(1.5)
                        .style(style),
                );
            }
        }
    });
    key_ui(ui, data, shown.response.rect);
    let words = in_words(data);
    shown
        .response
        .widget_info(|| WidgetInfo::labeled(Role::Image, true, &words));
    shown
        .response
        .on_hover_text("The last 5 minutes: a line a minute, now on the right");
}

/// What can be told of it without seeing it: what it is of, and the newest values.
fn in_words(data: &LinkPlot) -> String {
    let newest = data.lines.iter().filter_map(|(name, segments)| {
        let [_, value] = segments.last()?.last()?;
        Some(format!("{name} {value:.1}"))
    });
    let newest = newest.collect::<Vec<_>>().join(", ");
    format!("{}: {newest}", data.title)
}

/// Title and, where there are several lines, what each of them is: a legend would cover a plot that is low.
fn key_ui(ui: &Ui, data: &LinkPlot, place: Rect) {
    let font = TextStyle::Small.resolve(ui.style());
    let painter = ui.painter_at(place);
    let corner = place.left_top() + vec2(6.0, 3.0);
    let ink = ui.visuals().text_color();
    let mut at = painter
        .text(corner, Align2::LEFT_TOP, data.title, font.clone(), ink)
        .right_top();
    if data.lines.len() < 2 {
        return;
    }
    let styles = colors(ui.visuals().dark_mode).into_iter().zip(STYLES);
    for ((name, _), (color, style)) in data.lines.iter().zip(styles) {
        let text = painter.layout_no_wrap((*name).to_owned(), font.clone(), color);
        let width = SAMPLE + 3.0 + text.size().x;
        at.x += 8.0;
        if at.x + width > place.right() {
            at = pos2(corner.x, at.y + text.size().y);
        }
        let y = at.y + 0.5 * text.size().y;
        let ends = [pos2(at.x, y), pos2(at.x + SAMPLE, y)];
        painter.extend(sample(&ends, style, Stroke::new(1.5, color)));
        painter.galley(pos2(at.x + SAMPLE + 3.0, at.y), text, color);
        at.x += width;
    }
}

/// A piece of a line as the plot draws it.
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

/// No line is told by its colour alone.
const STYLES: [LineStyle; 4] = [
    LineStyle::Solid,
    LineStyle::Dashed { length: 8.0 },
    LineStyle::Dotted { spacing: 4.0 },
    LineStyle::Dashed { length: 3.0 },
];

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plot_can_be_told_in_words() {
        let data = LinkPlot {
            title: "Age, s",
            least: 2.0,
            lines: vec![
                (
                    "Position",
                    vec![vec![[-3.0, 0.5]], vec![[-1.0, 0.04], [0.0, 0.06]]],
                ),
                ("State", Vec::new()),
                ("Map tiles", vec![vec![[-2.0, 1.25]]]),
            ],
        };
        assert_eq!(in_words(&data), "Age, s: Position 0.1, Map tiles 1.2");
    }
}
