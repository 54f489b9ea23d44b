//! The link: state, streams, and plots of the last minutes.

use std::f32::consts::GOLDEN_RATIO;

use eframe::egui::accesskit::Role;
use eframe::egui::{
    Align, Color32, Layout, RichText, Sense, Shape, Stroke, TextStyle, Ui, Vec2, WidgetInfo, vec2,
};
use egui_plot::{GridMark, Line, LineStyle, Plot, PlotPoints};
use measurement::time::Monotonic;

use super::connection::{ConnectionData, LinkStatus, connection_ui};
use super::formatting::age;
use super::rows::{Row, row, rows_ui};
use crate::link::Transport;
use crate::model::{ConsoleModel, LinkSample, Stream};
use crate::theme::{Tone, rgb};

/// Samples farther apart than this are not joined, s.
const GAP_S: f64 = 1.3;

#[derive(Clone, Debug, PartialEq)]
pub struct LinkData {
    pub connection: ConnectionData,
    pub transport: Option<(Tone, String)>,
    /// Shown instead of the rest if there is no link.
    pub note: Option<String>,
    pub streams: Vec<Row>,
    pub plots: Vec<TimePlot>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct TimePlot {
    pub title: &'static str,
    pub least: f64,
    pub lines: Vec<(&'static str, Segments)>,
}

/// Connected pieces of a line: time relative to now (≤ 0, s) and value.
pub type Segments = Vec<Vec<[f64; 2]>>;

impl LinkData {
    pub fn new(model: &ConsoleModel, link: &LinkStatus, now: Monotonic) -> Self {
        if let Some(recording) = &link.recording {
            return Self {
                connection: ConnectionData::new(model, link, now),
                transport: None,
                note: Some(format!(
                    "{recording} is mapped in this program: a recording has no link. The timeline shows its \
                     speed and damage."
                )),
                streams: Vec::new(),
                plots: Vec::new(),
            };
        }
        let quality = model.link_quality();
        let samples = quality.samples();
        let of = |value: &dyn Fn(&LinkSample) -> Option<f64>| {
            segments(samples.iter().map(|sample| (sample.at, value(sample))), now)
        };
        let plot = |title, least, lines| TimePlot {
            title,
            least,
            lines,
        };
        let ages = Stream::ALL.map(|stream| {
            let age_s = move |sample: &LinkSample| {
                sample.ages[stream as usize].map(|age| age.as_secs_f64())
            };
            (stream_name(stream), of(&age_s))
        });
        let trip_ms = |sample: &LinkSample| sample.round_trip.map(|trip| trip.as_secs_f64() * 1e3);
        let lost = |sample: &LinkSample| sample.missing.map(|share| f64::from(share) * 100.0);
        let kbps = |sample: &LinkSample| Some(f64::from(sample.kbps));
        let missing = model.poses_missing(now).map_or_else(
            || "–".to_owned(),
            |share| {
                format!(
                    "{:.0} % of {:.0} a second",
                    share * 100.0,
                    quality.expected_hz()
                )
            },
        );
        let streams = Stream::ALL
            .map(|stream| {
                let old = quality.age(stream, now).map_or_else(
                    || "Never received".to_owned(),
                    |old| format!("{} ago", age(old)),
                );
                row(stream_name(stream), old)
            })
            .into_iter()
            .chain([row("Poses lost", missing)])
            .collect();
        Self {
            connection: ConnectionData::new(model, link, now),
            transport: link.transport.map(transport_text),
            note: None,
            streams,
            plots: vec![
                plot("Round trip, ms", 20.0, vec![("Round trip", of(&trip_ms))]),
                plot("Poses lost, %", 10.0, vec![("Poses lost", of(&lost))]),
                plot("Received, kbit/s", 50.0, vec![("Received", of(&kbps))]),
                plot("Age, s", 2.0, ages.to_vec()),
            ],
        }
    }
}

fn transport_text(transport: Transport) -> (Tone, String) {
    let (tone, words) = match transport {
        Transport::Quic => (Tone::Good, "QUIC, secured"),
        Transport::Tls => (Tone::Good, "TLS, secured"),
        Transport::TlsInstead => (
            Tone::Warning,
            "TLS, secured, because QUIC does not answer: a lost message delays the following ones",
        ),
        Transport::Tcp => (Tone::Waiting, "TCP, not secured"),
        Transport::Other => (Tone::Waiting, "Another way"),
    };
    (tone, words.to_owned())
}

const fn stream_name(stream: Stream) -> &'static str {
    match stream {
        Stream::Pose => "Position",
        Stream::Status => "State",
        Stream::MapHead => "Map summary",
        Stream::Tiles => "Map tiles",
    }
}

/// Of samples with their times; those without a value part the line.
pub(super) fn segments(
    samples: impl Iterator<Item = (Monotonic, Option<f64>)>,
    now: Monotonic,
) -> Segments {
    let mut segments: Segments = Vec::new();
    let mut is_joined = false;
    for (at, value) in samples {
        let Some(value) = value else {
            is_joined = false;
            continue;
        };
        let point = [-now.since(at).as_secs_f64(), value];
        match segments.last_mut() {
            Some(piece)
                if is_joined && piece.last().is_some_and(|[x, _]| point[0] - x <= GAP_S) =>
            {
                piece.push(point);
            }
            Some(_) | None => segments.push(vec![point]),
        }
        is_joined = true;
    }
    segments
}

const FIGURES: f32 = 210.0;

pub fn link_ui(ui: &mut Ui, data: &LinkData) {
    if let Some(note) = &data.note {
        connection_ui(ui, &data.connection);
        ui.label(note);
        return;
    }
    // Visible height. Beside the rows, the plots have the same height as them.
    let height = ui.available_height();
    if ui.available_width() < 1.8 * FIGURES {
        figures_ui(ui, data);
        plots_ui(ui, &data.plots, height);
        return;
    }
    ui.horizontal_top(|ui| {
        ui.vertical(|ui| {
            ui.set_width(FIGURES);
            figures_ui(ui, data);
        });
        ui.vertical(|ui| plots_ui(ui, &data.plots, height));
    });
}

fn figures_ui(ui: &mut Ui, data: &LinkData) {
    connection_ui(ui, &data.connection);
    if let Some((tone, words)) = &data.transport {
        ui.label(RichText::new(words).small().color(tone.color(ui.visuals())));
    }
    rows_ui(ui, "streams", &data.streams);
}

/// Mantissas of the upper end: half of each is a short number.
const ENDS: [f64; 8] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0];
/// The plotting library fades labels that are closer than this, points.
const APART: f64 = 32.0;

#[derive(Clone, Copy, Debug, PartialEq)]
struct Axis {
    end: f64,
    step: f64,
}

impl Axis {
    /// `highest` > 0; `height` in points. Labels: 0, the end, and the middle if there is space.
    fn new(highest: f64, height: f64) -> Self {
        let power = libm::pow(10.0, libm::floor(libm::log10(highest)));
        let ends = ENDS.map(|end| end * power);
        let end = ends.into_iter().find(|end| *end >= highest);
        let end = end.unwrap_or(highest);
        let has_middle = 0.5 * height > APART;
        let step = if has_middle { 0.5 * end } else { end };
        Self { end, step }
    }

    fn marks(self) -> Vec<GridMark> {
        let count = libm::round(self.end / self.step) as u32;
        let mark = |number| GridMark {
            value: f64::from(number) * self.step,
            step_size: self.step,
        };
        (0..=count).map(mark).collect()
    }
}

fn label(mark: GridMark) -> String {
    // Removes the rounding error of the sum.
    let rounded = libm::round(mark.value * 1e6) / 1e6;
    rounded.to_string()
}

const SPAN_S: f64 = 300.0;
const LEAST: f32 = 46.0;
const ROWS_APART: f32 = 3.0;
const AXIS_TEXT: f64 = 6.0;
const WIDE: f32 = 200.0;
const NARROW: f32 = 160.0;

const SAMPLE: f32 = 16.0;

/// Draws the plots in as many columns as fit. `height`: of all rows, if no plot gets too low.
pub(super) fn plots_ui(ui: &mut Ui, plots: &[TimePlot], height: f32) {
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
    let cell = vec2(
        of_width(columns),
        share(height, gap.y, plots.len().div_ceil(columns)),
    );
    for row in plots.chunks(columns) {
        ui.horizontal_top(|ui| {
            for plot in row {
                ui.allocate_ui_with_layout(cell, Layout::top_down(Align::Min), |ui| {
                    ui.set_width(cell.x);
                    ui.spacing_mut().item_spacing.y = 0.0;
                    key_ui(ui, plot);
                    let height = ui.available_height().max(LEAST);
                    plot_ui(ui, plot, vec2(cell.x, height));
                });
            }
        });
    }
}

/// Title and line names above a plot. Inside the plot they would cover its lines.
fn key_ui(ui: &mut Ui, plot: &TimePlot) {
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().interact_size.y = 0.0;
        ui.label(RichText::new(plot.title).small());
        // A single line needs no name.
        let lines = plot.lines.iter().filter(|_| plot.lines.len() > 1);
        for ((name, _), (color, style)) in lines.zip(looks(ui.visuals().dark_mode)) {
            let name = RichText::new(*name).small().color(color);
            let height = ui.text_style_height(&TextStyle::Small);
            let (sample, _) = ui.allocate_exact_size(vec2(SAMPLE, height), Sense::hover());
            let ends = [sample.left_center(), sample.right_center()];
            let stroke = Stroke::new(1.5, color);
            ui.painter().extend(match style {
                LineStyle::Solid => vec![Shape::line_segment(ends, stroke)],
                LineStyle::Dotted { spacing } => {
                    Shape::dotted_line(&ends, color, spacing, stroke.width)
                }
                LineStyle::Dashed { length } => {
                    Shape::dashed_line(&ends, stroke, length, length * (GOLDEN_RATIO - 1.0))
                }
            });
            ui.label(name);
        }
    });
}

fn looks(dark: bool) -> impl Iterator<Item = (Color32, LineStyle)> {
    const STYLES: [LineStyle; 4] = [
        LineStyle::Solid,
        LineStyle::Dashed { length: 8.0 },
        LineStyle::Dotted { spacing: 4.0 },
        LineStyle::Dashed { length: 3.0 },
    ];
    let colors = if dark {
        [0x56b4e9, 0xe69f00, 0x2fc497, 0xcc79a7]
    } else {
        [0x005d92, 0xa84800, 0x007455, 0x8e246a]
    };
    colors.map(rgb).into_iter().zip(STYLES)
}

fn plot_ui(ui: &mut Ui, data: &TimePlot, size: Vec2) {
    let highest = data
        .lines
        .iter()
        .flat_map(|(_, segments)| segments.iter().flatten())
        .fold(data.least, |highest, [_, value]| highest.max(*value));
    // Labels are centred on their lines and extend beyond the plot.
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

fn accessible_text(data: &TimePlot) -> String {
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
    use eframe::egui::accesskit::Role;
    use eframe::egui::{Rect, vec2};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use crate::test_support::{at, scout};
    use crate::theme;

    #[test]
    fn missing_samples_are_gaps() {
        let samples = [
            (0, Some(10.0)),
            (500, Some(20.0)),
            (1_000, None),
            (1_500, Some(30.0)),
            (6_000, Some(40.0)),
        ];
        let samples = samples.map(|(ms, value)| (at(ms), value));
        assert_eq!(
            segments(samples.into_iter(), at(6_000)),
            [
                vec![[-6.0, 10.0], [-5.5, 20.0]],
                vec![[-4.5, 30.0]],
                vec![[0.0, 40.0]]
            ]
        );
        assert!(segments([(at(0), None)].into_iter(), at(6_000)).is_empty());
    }

    #[test]
    fn the_transport_is_shown() {
        let (tone, words) = transport_text(Transport::TlsInstead);
        assert_eq!(tone, Tone::Warning);
        assert!(words.contains("QUIC does not answer"));
        assert_eq!(transport_text(Transport::Quic).0, Tone::Good);
        assert!(transport_text(Transport::Tcp).1.contains("not secured"));
    }

    fn window(width: f32) -> Harness<'static> {
        let mut data = LinkData::new(&scout(), &LinkStatus::default(), at(1_000));
        data.connection.map = "Was synchronized 1.0 s before the link was lost".to_owned();
        data.transport = Some(transport_text(Transport::TlsInstead));
        let mut window = Harness::builder()
            .with_size(vec2(width, 300.0))
            .build_ui(move |ui| {
                theme::set(ui.ctx());
                link_ui(ui, &data);
            });
        window.run_steps(4);
        window
    }

    #[test]
    fn nothing_is_cut_in_a_narrow_panel() {
        for width in [216.0, 300.0, 380.0, 400.0, 467.0, 560.0, 760.0, 1100.0] {
            let window = window(width);
            let places = |role| {
                let found = window.query_all_by_role(role).map(|node| node.rect());
                found.collect::<Vec<Rect>>()
            };
            let (plots, words) = (places(Role::Image), places(Role::Label));
            assert_eq!(plots.len(), 4, "{width}");
            for pair in plots
                .windows(2)
                .filter(|pair| pair[1].top() > pair[0].bottom())
            {
                let between = pair[1].top() - pair[0].bottom();
                assert!(between > 12.0, "{width}: {pair:?}");
            }
            assert!(words.len() >= 12, "{width}: {words:?}");
            for place in plots.iter().chain(&words) {
                assert!(place.right() <= width, "{width}: {place}");
            }
            for (index, plot) in plots.iter().enumerate() {
                assert!(
                    plot.width() > 100.0 && plot.height() > 45.0,
                    "{width}: {plot}"
                );
                let others = plots[..index].iter().chain(&words);
                let apart = |other: &Rect| !other.shrink(0.5).intersects(*plot);
                assert!(
                    others.copied().all(|other| apart(&other)),
                    "{width}: {plot}"
                );
            }
        }
    }

    fn labels(highest: f64, height: f64) -> Vec<String> {
        let marks = Axis::new(highest, height).marks();
        marks.into_iter().map(label).collect()
    }

    #[test]
    fn an_axis_has_two_numbers_and_covers_all_values() {
        assert_eq!(labels(50.0, 48.0), ["0", "50"]);
        assert_eq!(labels(50.0, 90.0), ["0", "25", "50"]);
        assert_eq!(labels(81.0, 90.0), ["0", "50", "100"]);
        assert_eq!(labels(2.0, 90.0), ["0", "1", "2"]);
        assert_eq!(labels(0.03, 90.0), ["0", "0.015", "0.03"]);
        for (highest, end) in [
            (1.5, 2.0),
            (2.1, 3.0),
            (3.1, 4.0),
            (41.0, 50.0),
            (51.0, 60.0),
            (0.61, 0.8),
            (81.0, 100.0),
        ] {
            let reached = Axis::new(highest, 90.0).end;
            assert!((reached - end).abs() < 1e-9, "{highest}: {reached}");
        }
        assert_eq!(labels(50.0, 2.0 * APART), ["0", "50"]);
        for highest in [0.1, 9.99, 10.0, 19.9, 21.0, 77.7, 4_321.0, 1e7] {
            for height in [40.0, 62.0, 200.0] {
                let axis = Axis::new(highest, height);
                assert!(axis.end >= highest && axis.end <= 2.0 * highest, "{axis:?}");
                let marks = axis.marks();
                assert!(marks.len() >= 2, "{axis:?}");
                let apart = axis.step / axis.end * height;
                assert!(apart > APART, "{axis:?}: {apart}");
            }
        }
    }

    #[test]
    fn plot_has_an_accessible_text() {
        let data = TimePlot {
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
