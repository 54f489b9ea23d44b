//! The link: how it is, what it carries, and both over the last minutes.

mod axis;
mod key;
mod plots;

use eframe::egui::{RichText, Ui};
use measurement::time::Monotonic;

use super::connection::{ConnectionData, LinkStatus, connection_ui};
use super::formatting::age;
use super::rows::{Row, row, rows_ui};
use crate::link::Transport;
use crate::model::{ConsoleModel, LinkSample, Stream};
use crate::theme::Tone;

use plots::plots_ui;

/// Samples that lie farther apart are not joined, seconds.
const GAP_S: f64 = 1.3;

/// What the panel shows.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkData {
    /// The state, in short.
    pub connection: ConnectionData,
    /// By what way messages come.
    pub transport: Option<(Tone, String)>,
    /// Said instead of all that follows where there is no link.
    pub note: Option<String>,
    /// Ages of the streams, loss.
    pub streams: Vec<Row>,
    /// Round trip, loss, rate, ages.
    pub plots: Vec<LinkPlot>,
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
    pub fn new(model: &ConsoleModel, link: &LinkStatus, now: Monotonic) -> Self {
        if let Some(recording) = &link.recording {
            return Self {
                connection: ConnectionData::new(model, link, now),
                transport: None,
                note: Some(format!(
                    "{recording} is mapped in this program: a recording has no link. How fast it plays is said on the time \
                     line, what of it is damaged in Events, too."
                )),
                streams: Vec::new(),
                plots: Vec::new(),
            };
        }
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

/// How a transport is told.
fn transport_text(transport: Transport) -> (Tone, String) {
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
const FIGURES: f32 = 210.0;

/// Draws the panel: plots beside the figures where there is room, else below them.
pub fn link_ui(ui: &mut Ui, data: &LinkData) {
    if let Some(note) = &data.note {
        connection_ui(ui, &data.connection);
        ui.label(note);
        return;
    }
    // What can be seen without scrolling. Beside the figures, the row is as high as they are.
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

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use eframe::egui::accesskit::Role;
    use eframe::egui::{Rect, vec2};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;
    use crate::test_support::{at, scout};
    use crate::theme;

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
        let (tone, words) = transport_text(Transport::TlsInstead);
        assert_eq!(tone, Tone::Warning);
        assert!(words.contains("QUIC does not answer"));
        assert_eq!(transport_text(Transport::Quic).0, Tone::Good);
        assert!(transport_text(Transport::Tcp).1.contains("not secured"));
    }

    /// The panel with its longest words, on so wide a window; it may be higher than that, for it scrolls.
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
        // 216 points are 200 and the margins of a window.
        for width in [216.0, 300.0, 380.0, 400.0, 467.0, 560.0, 760.0, 1100.0] {
            let window = window(width);
            let places = |role| {
                let found = window.query_all_by_role(role).map(|node| node.rect());
                found.collect::<Vec<Rect>>()
            };
            let (plots, words) = (places(Role::Image), places(Role::Label));
            assert_eq!(plots.len(), 4, "{width}");
            // The words above each are drawn, and no labels.
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
}
