//! Plots of the last minutes, each below its key.

use eframe::egui::accesskit::Role;
use eframe::egui::{Align, Layout, Sense, Ui, Vec2, WidgetInfo, vec2};
use egui_plot::{Line, Plot, PlotPoints};

use super::LinkPlot;
use super::axis::{Axis, label};
use super::key::{Key, looks};

/// What plots reach back, seconds.
const SPAN_S: f64 = 300.0;
/// Least height of a plot without its key, points.
const LEAST: f32 = 46.0;
/// Between rows of plots, points: all of them are in sight beside the driving panel.
const ROWS_APART: f32 = 3.0;
/// Half the height of a figure on the axis, points: of its digits, which is all that there is.
const AXIS_TEXT: f64 = 6.0;
/// All plots stand in one row where each is at least so wide, points.
const WIDE: f32 = 200.0;
/// Two stand side by side where each is at least so wide, points: else the figures on its axis would leave a line little room.
const NARROW: f32 = 160.0;

/// Draws them in as many columns as there is room for. `height`: of all rows together with their keys, as long as no plot
/// becomes too low.
pub(super) fn plots_ui(ui: &mut Ui, plots: &[LinkPlot], height: f32) {
    ui.spacing_mut().item_spacing.y = ROWS_APART;
    let gap = ui.spacing().item_spacing;
    let share =
        |all: f32, gap: f32, count: usize| (all - gap * (count as f32 - 1.0)) / count as f32;
    let of_width = |columns| share(ui.available_width(), gap.x, columns);
    let columns = match (of_width(4) >= WIDE, of_width(2) >= NARROW) {
        (true, _) => 4,
        (false, true) => 2,
        (false, false) => 1,
    };
    let width = of_width(columns);
    let keys: Vec<_> = plots.iter().map(|plot| Key::new(ui, plot, width)).collect();
    // Plots that stand side by side are as high as each other.
    let key_heights: Vec<_> = keys
        .chunks(columns)
        .map(|row| row.iter().map(Key::height).fold(0.0, f32::max))
        .collect();
    let for_plots = height - key_heights.iter().sum::<f32>();
    let size = vec2(width, share(for_plots, gap.y, key_heights.len()).max(LEAST));
    let rows = plots.chunks(columns).zip(keys.chunks(columns));
    for ((plots, keys), key_height) in rows.zip(key_heights) {
        ui.horizontal_top(|ui| {
            for (plot, key) in plots.iter().zip(keys) {
                let cell = size + vec2(0.0, key_height);
                ui.allocate_ui_with_layout(cell, Layout::top_down(Align::Min), |ui| {
                    ui.spacing_mut().item_spacing.y = 0.0;
                    let above = vec2(width, key_height);
                    let (above, _) = ui.allocate_exact_size(above, Sense::hover());
                    key.paint(ui, above.left_top());
                    plot_ui(ui, plot, size);
                });
            }
        });
    }
}

fn plot_ui(ui: &mut Ui, data: &LinkPlot, size: Vec2) {
    let highest = data
        .lines
        .iter()
        .flat_map(|(_, segments)| segments.iter().flatten())
        .fold(data.least, |highest, [_, value]| highest.max(*value));
    // Figures on the axis are written around their lines, and reach beyond the first and the last.
    let between = f64::from(size.y) - 2.0 * AXIS_TEXT;
    let axis = Axis::new(highest, between);
    let edge = axis.end * AXIS_TEXT / between;
    let plot = Plot::new(data.title)
        .min_size(size)
        .width(size.x)
        .height(size.y)
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
        for ((name, segments), (color, style)) in data.lines.iter().zip(looks(dark)) {
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
    let words = accessible_text(data);
    shown
        .response
        .widget_info(|| WidgetInfo::labeled(Role::Image, true, &words));
    shown
        .response
        .on_hover_text("The last 5 minutes: a line a minute, now on the right");
}

/// What can be told of it without seeing it: what it is of, and the newest values.
fn accessible_text(data: &LinkPlot) -> String {
    let newest = data.lines.iter().filter_map(|(name, segments)| {
        let [_, value] = segments.last()?.last()?;
        Some(format!("{name} {value:.1}"))
    });
    let newest = newest.collect::<Vec<_>>().join(", ");
    format!("{}: {newest}", data.title)
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
        assert_eq!(
            accessible_text(&data),
            "Age, s: Position 0.1, Map tiles 1.2"
        );
    }
}
