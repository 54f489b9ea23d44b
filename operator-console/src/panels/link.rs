//! The link: how it is, what it carries, and both over the last minutes.

use eframe::egui::{Align2, Color32, RichText, TextStyle, Ui, vec2};
use egui_plot::{Corner, Legend, Line, LineStyle, Plot, PlotPoints};
use robot_edge::clock::Monotonic;

use super::connection::{ConnectionData, LinkSight, connection_ui};
use super::rows::{Row, row, rows_ui};
use super::wording::age;
use crate::link::Transport;
use crate::model::{ConsoleModel, LinkSample, Stream};
use crate::theme::Tone;

/// Samples that lie farther apart are not joined, seconds.
const GAP_S: f64 = 1.3;
/// What plots reach back, seconds.
const SPAN_S: f64 = 300.0;

/// What the panel shows.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkData {
    /// The state, in short.
    pub connection: ConnectionData,
    /// By what way messages come.
    pub transport: Option<(Tone, String)>,
    /// Ages of the streams, loss.
    pub streams: Vec<Row>,
    /// Round trip, loss, rate, ages.
    pub plots: [LinkPlot; 4],
}

/// Something over the last minutes.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkPlot {
    /// What, with its unit.
    pub title: &'static str,
    /// The axis reaches at least this far.
    pub least: f64,
    /// Its lines, each with a name.
    pub lines: Vec<(&'static str, Segments)>,
}

/// Pieces of a line, with gaps between them: seconds from now, which are negative, and values.
pub type Segments = Vec<Vec<[f64; 2]>>;

impl LinkData {
    /// The link at `now`.
    pub fn new(model: &ConsoleModel, link: &LinkSight, now: Monotonic) -> Self {
        let quality = model.link_quality();
        let samples = quality.samples();
        let of = |value: &dyn Fn(&LinkSample) -> Option<f64>| segments(samples.iter(), value, now);
        let plot = |title, least, lines| LinkPlot {
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
        let missing = quality.missing(now).map_or_else(
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
                    || "Never heard".to_owned(),
                    |old| format!("{} old", age(old)),
                );
                row(stream_name(stream), old)
            })
            .into_iter()
            .chain([row("Poses lost", missing)])
            .collect();
        Self {
            connection: ConnectionData::new(model, link, now),
            transport: link.transport.map(transport_words),
            streams,
            plots: [
                plot("Round trip, ms", 20.0, vec![("Round trip", of(&trip_ms))]),
                plot("Poses lost, %", 10.0, vec![("Poses lost", of(&lost))]),
                plot("Received, kbit/s", 50.0, vec![("Received", of(&kbps))]),
                plot("Age, s", 2.0, ages.to_vec()),
            ],
        }
    }
}

/// How a transport is told.
fn transport_words(transport: Transport) -> (Tone, String) {
    let (tone, words) = match transport {
        Transport::Quic => (Tone::Good, "QUIC, secured"),
        Transport::Tls => (Tone::Good, "TLS, secured"),
        Transport::TlsInstead => (
            Tone::Warning,
            "TLS, secured, since QUIC does not answer: what is lost holds up what follows",
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

/// A value over time, in pieces: nothing is drawn where nothing was measured.
fn segments<'a>(
    samples: impl Iterator<Item = &'a LinkSample>,
    value: &dyn Fn(&LinkSample) -> Option<f64>,
    now: Monotonic,
) -> Segments {
    let mut segments: Segments = Vec::new();
    let mut is_joined = false;
    for sample in samples {
        let Some(value) = value(sample) else {
            is_joined = false;
            continue;
        };
        let point = [-now.since(sample.at).as_secs_f64(), value];
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

/// Width of the figures beside the plots, points.
const FIGURES: f32 = 240.0;
/// Least height of a plot, points.
const PLOT: f32 = 68.0;

/// Draws the panel: plots beside the figures where there is room, else below them.
pub fn link_ui(ui: &mut Ui, data: &LinkData) {
    if ui.available_width() < 1.8 * FIGURES {
        figures_ui(ui, data);
        plots_ui(ui, data, 1);
        return;
    }
    ui.horizontal_top(|ui| {
        ui.vertical(|ui| {
            ui.set_width(FIGURES);
            figures_ui(ui, data);
        });
        ui.vertical(|ui| plots_ui(ui, data, 2));
    });
}

fn figures_ui(ui: &mut Ui, data: &LinkData) {
    connection_ui(ui, &data.connection);
    if let Some((tone, words)) = &data.transport {
        ui.label(RichText::new(words).small().color(tone.color(ui.visuals())));
    }
    rows_ui(ui, "streams", &data.streams);
}

fn plots_ui(ui: &mut Ui, data: &LinkData, columns: usize) {
    let rows = data.plots.len() / columns;
    let gap = ui.spacing().item_spacing;
    let share =
        |all: f32, gap: f32, count: usize| (all - gap * (count as f32 - 1.0)) / count as f32;
    let size = vec2(
        share(ui.available_width(), gap.x, columns),
        share(ui.available_height(), gap.y, rows).max(PLOT),
    );
    for row in data.plots.chunks(columns) {
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
    let mut plot = Plot::new(data.title)
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
        .include_y(0.0)
        .include_y(highest * 1.05)
        .set_margin_fraction(vec2(0.0, 0.0))
        .x_grid_spacer(|_input| {
            (-5..=0)
                .map(|minutes| egui_plot::GridMark {
                    value: f64::from(minutes) * 60.0,
                    step_size: 60.0,
                })
                .collect()
        })
        .show_axes([false, true])
        .y_axis_min_width(34.0);
    if data.lines.len() > 1 {
        plot = plot.legend(Legend::default().position(Corner::LeftBottom));
    }
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
    let place = shown.response.rect;
    ui.painter().text(
        place.left_top() + vec2(6.0, 3.0),
        Align2::LEFT_TOP,
        data.title,
        TextStyle::Small.resolve(ui.style()),
        ui.visuals().text_color(),
    );
    shown
        .response
        .on_hover_text("The last 5 minutes: a line a minute, now on the right");
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
    use std::time::Duration;

    use super::*;

    const fn at(ms: u64) -> Monotonic {
        Monotonic::from_nanos(ms * 1_000_000)
    }

    #[test]
    fn what_was_not_measured_is_a_gap_and_no_line() {
        let sample = |ms, round_trip_ms: Option<u64>| LinkSample {
            at: at(ms),
            round_trip: round_trip_ms.map(Duration::from_millis),
            pose_hz: 20.0,
            missing: None,
            kbps: 8.0,
            ages: [None; 4],
        };
        let samples = [
            sample(0, Some(10)),
            sample(500, Some(20)),
            sample(1_000, None),
            sample(1_500, Some(30)),
            sample(6_000, Some(40)),
        ];
        let trip_ms = |sample: &LinkSample| sample.round_trip.map(|trip| trip.as_secs_f64() * 1e3);
        let pieces = segments(samples.iter(), &trip_ms, at(6_000));
        assert_eq!(
            pieces,
            [
                vec![[-6.0, 10.0], [-5.5, 20.0]],
                vec![[-4.5, 30.0]],
                vec![[0.0, 40.0]]
            ]
        );
        assert!(
            segments(
                samples.iter(),
                &|sample| sample.missing.map(f64::from),
                at(6_000)
            )
            .is_empty()
        );
    }

    #[test]
    fn the_way_that_messages_take_is_told() {
        let (tone, words) = transport_words(Transport::TlsInstead);
        assert_eq!(tone, Tone::Warning);
        assert!(words.contains("QUIC does not answer"));
        assert_eq!(transport_words(Transport::Quic).0, Tone::Good);
        assert!(transport_words(Transport::Tcp).1.contains("not secured"));
    }
}
