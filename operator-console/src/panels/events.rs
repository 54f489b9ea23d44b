//! Events, newest first, filtered by severity and text.

use eframe::egui::accesskit::Role;
use eframe::egui::{
    ComboBox, Grid, Label, RichText, ScrollArea, TextEdit, TextStyle, Ui, WidgetInfo,
};

use super::formatting::{elided, with_monospace_options};
use crate::event_log::{Entry, EventLog, Severity, Source};
use crate::theme::Tone;

/// Number of drawn lines. Older events can be found by the filter.
const MAX_LINES: usize = 300;
/// Below this width the text is below its heading, points.
const NARROW: f32 = 460.0;

/// Longer names are shortened to so many characters.
const MAX_NAME: usize = 16;

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EventFilter {
    pub least: Severity,
    /// Text that an event or its source must contain; the case is ignored.
    pub text: String,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EventsData {
    pub lines: Vec<EventLine>,
    pub left_out: Option<String>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EventLine {
    pub time: String,
    pub severity: Severity,
    pub heading: String,
    pub text: String,
}

impl EventFilter {
    fn passes(&self, entry: &Entry, needle: &str) -> bool {
        let has = |text: &str| text.to_lowercase().contains(needle);
        let is_meant = || has(&entry.text) || has(&entry.kind) || has(source_name(entry));
        entry.severity >= self.least && (needle.is_empty() || is_meant())
    }
}

impl EventsData {
    pub fn new(log: &EventLog, filter: &EventFilter) -> Self {
        let needle = filter.text.trim().to_lowercase();
        let all = log.entries();
        let passing = all
            .iter()
            .rev()
            .filter(|entry| filter.passes(entry, &needle));
        let lines: Vec<_> = passing.take(MAX_LINES).map(line).collect();
        let left_out = match all.len() - lines.len() {
            0 => None,
            1 => Some("1 line is not shown".to_owned()),
            n => Some(format!("{n} lines are not shown")),
        };
        Self { lines, left_out }
    }
}

fn source_name(entry: &Entry) -> &str {
    match &entry.source {
        Source::Robot(name) => name,
        Source::Console => "console",
    }
}

fn line(entry: &Entry) -> EventLine {
    let who = elided(source_name(entry), |name| name.chars().count() <= MAX_NAME);
    EventLine {
        time: entry.time.clone(),
        severity: entry.severity,
        heading: format!("{who}: {}", entry.kind),
        text: entry.text.clone(),
    }
}

pub fn events_ui(ui: &mut Ui, data: &EventsData, filter: &mut EventFilter) {
    let is_narrow = ui.available_width() < NARROW;
    filter_ui(ui, filter, data.left_out.as_deref(), is_narrow);
    if data.lines.is_empty() {
        ui.label(match data.left_out {
            Some(_) => "Nothing of that kind has happened.",
            None => "Nothing has happened.",
        });
    }
    ScrollArea::vertical()
        .id_salt("events")
        .auto_shrink([false, false])
        .show(ui, |ui| {
            if is_narrow {
                for line in &data.lines {
                    narrow_line_ui(ui, line);
                }
                // Shown only if there is space beside the filter.
                if let Some(left_out) = &data.left_out {
                    ui.weak(left_out);
                }
            } else {
                lines_ui(ui, &data.lines);
            }
        });
}

/// Always one line, because the panel may be low.
fn filter_ui(ui: &mut Ui, filter: &mut EventFilter, left_out: Option<&str>, is_narrow: bool) {
    ui.horizontal(|ui| {
        let (label, width) = if is_narrow {
            (short_filter_label(filter.least), 84.0)
        } else {
            (filter_label(filter.least), 150.0)
        };
        let severity = ComboBox::from_id_salt("least severity")
            .selected_text(label)
            .width(width)
            .show_ui(ui, |ui| {
                for severity in Severity::ALL {
                    let words = filter_label(severity);
                    ui.selectable_value(&mut filter.least, severity, words)
                        .on_hover_text("Shows events of this severity and above");
                }
            });
        let chosen = filter_label(filter.least);
        severity.response.widget_info(|| {
            WidgetInfo::labeled(Role::ComboBox, true, format!("Least severity: {chosen}"))
        });
        severity.response.on_hover_text("Minimum severity");
        let text = TextEdit::singleline(&mut filter.text)
            .hint_text("Filter: words")
            .char_limit(100)
            .desired_width(ui.available_width().min(180.0));
        let text = ui.add(text).on_hover_text("List events with these words");
        ui.ctx()
            .accesskit_node_builder(text.id, |node| node.set_label("Filter"));
        if let Some(left_out) = left_out.filter(|_| !is_narrow) {
            ui.weak(left_out);
        }
    });
}

fn lines_ui(ui: &mut Ui, lines: &[EventLine]) {
    Grid::new("events")
        .num_columns(3)
        .min_row_height(18.0)
        .spacing([12.0, 3.0])
        .striped(true)
        .show(ui, |ui| {
            for line in lines {
                heading_ui(ui, line);
                text_of_ui(ui, line, &TextStyle::Body);
                ui.end_row();
            }
        });
}

fn narrow_line_ui(ui: &mut Ui, line: &EventLine) {
    ui.scope(|ui| {
        ui.spacing_mut().item_spacing.y = 0.0;
        ui.spacing_mut().interact_size.y = 0.0;
        ui.horizontal_wrapped(|ui| heading_ui(ui, line));
        text_of_ui(ui, line, &TextStyle::Small);
    });
}

fn heading_ui(ui: &mut Ui, line: &EventLine) {
    ui.weak(RichText::new(&line.time).monospace().size(13.0));
    let tone = tone(line.severity).color(ui.visuals());
    let heading = RichText::new(&line.heading).size(13.0);
    ui.label(match line.severity {
        Severity::Info => heading.weak(),
        Severity::Warning | Severity::Alarm => heading.color(tone),
    })
    .on_hover_text(line.severity.label());
}

fn text_of_ui(ui: &mut Ui, line: &EventLine, style: &TextStyle) {
    let ink = ui.visuals().text_color();
    ui.add(Label::new(with_monospace_options(ui, &line.text, style, ink)).wrap());
}

const fn tone(severity: Severity) -> Tone {
    match severity {
        Severity::Info => Tone::Waiting,
        Severity::Warning | Severity::Alarm => Tone::Warning,
    }
}

const fn filter_label(least: Severity) -> &'static str {
    match least {
        Severity::Info => "Everything",
        Severity::Warning => "Warnings and alarms",
        Severity::Alarm => "Alarms only",
    }
}

const fn short_filter_label(least: Severity) -> &'static str {
    match least {
        Severity::Info => "All",
        Severity::Warning => "Warnings",
        Severity::Alarm => "Alarms",
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use measurement::time::Monotonic;
    use protocol::keys::Topic;
    use protocol::message::{self, Event};

    use super::*;
    use crate::test_support::{at, console, inject};

    fn window(width: f32, log: &EventLog, filter: &EventFilter) -> Harness<'static> {
        let data = EventsData::new(log, filter);
        let mut filter = filter.clone();
        let mut window = Harness::builder()
            .with_size(vec2(width, 400.0))
            .build_ui(move |ui| events_ui(ui, &data, &mut filter));
        window.run_steps(4);
        window
    }

    #[test]
    fn an_empty_list_mentions_the_filter() {
        let filter = EventFilter {
            text: "no such words".to_owned(),
            ..EventFilter::default()
        };
        let of_that_kind = "Nothing of that kind has happened.";
        let at_all = "Nothing has happened.";
        let filtered = window(600.0, &log(), &filter);
        filtered.get_by_label(of_that_kind);
        filtered.get_by_label("3 lines are not shown");
        assert!(filtered.query_by_label(at_all).is_none());
        let empty = window(600.0, &EventLog::default(), &filter);
        empty.get_by_label(at_all);
        assert!(empty.query_by_label(of_that_kind).is_none());
        let all = window(600.0, &log(), &EventFilter::default());
        for words in [of_that_kind, at_all] {
            assert!(all.query_by_label(words).is_none());
        }
    }

    fn log() -> EventLog {
        let mut log = EventLog::default();
        for (n, (severity, kind, text)) in [
            (Severity::Info, "export", "12 files are in maps"),
            (Severity::Warning, "link", "Control goes by TLS"),
            (Severity::Alarm, "alert", "Emergency stop 1 is active"),
        ]
        .into_iter()
        .enumerate()
        {
            log.note(severity, kind, text, Monotonic::default(), n as u64);
        }
        log
    }

    fn texts(filter: &EventFilter) -> Vec<String> {
        let data = EventsData::new(&log(), filter);
        data.lines.into_iter().map(|line| line.text).collect()
    }

    #[test]
    fn events_are_filtered_by_severity_and_text() {
        let all = EventFilter::default();
        assert_eq!(
            texts(&all),
            [
                "Emergency stop 1 is active",
                "Control goes by TLS",
                "12 files are in maps"
            ]
        );
        let alarms = EventFilter {
            least: Severity::Alarm,
            ..EventFilter::default()
        };
        assert_eq!(texts(&alarms), ["Emergency stop 1 is active"]);
        let left_out = EventsData::new(&log(), &alarms).left_out;
        assert_eq!(left_out.as_deref(), Some("2 lines are not shown"));
        for text in ["tls", " LINK "] {
            let words = EventFilter {
                text: text.to_owned(),
                ..EventFilter::default()
            };
            assert_eq!(texts(&words), ["Control goes by TLS"]);
        }
        let line = &EventsData::new(&log(), &all).lines[1];
        assert_eq!(
            (line.time.as_str(), line.heading.as_str()),
            ("00:00:01", "console: link")
        );
    }

    #[test]
    fn events_name_their_source() {
        let mut log = log();
        for name in ["boat", "lake-2026-11-22T150130Z.mcap"] {
            let mut model = console("robot", &[]);
            let event = Event {
                kind: "pose_jump".to_owned(),
                severity: message::Severity::Warning,
                message: format!("The pose jumped {} m", name.len()),
            };
            inject(&mut model, Topic::Event, &event, at(1_000));
            log.forget_robot();
            assert_eq!(log.add_robot_events(&model, name, at(1_000), 60).len(), 1);
        }
        let all = EventsData::new(&log, &EventFilter::default());
        let headings: Vec<_> = all.lines.iter().map(|line| line.heading.as_str()).collect();
        assert_eq!(
            headings[..3],
            [
                "lake-2…130Z.mcap: pose jump",
                "boat: pose jump",
                "console: alert"
            ]
        );
        let of_boat = EventFilter {
            text: "boat".to_owned(),
            ..EventFilter::default()
        };
        let lines = EventsData::new(&log, &of_boat).lines;
        assert_eq!(lines.len(), 1);
        assert_eq!(lines[0].text, "The pose jumped 4 m");
    }
}
