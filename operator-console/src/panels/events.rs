//! What happened, the newest first, as far as the operator wants to read it.

use eframe::egui::{ComboBox, Grid, Label, RichText, ScrollArea, TextEdit, Ui};

use crate::event_log::{Entry, EventLog, Severity, Source};
use crate::theme::Tone;

/// Lines that are laid out; older ones are found by the filter.
const MAX_LINES: usize = 300;
/// Narrower panels have what happened below its heading, points.
const NARROW: f32 = 460.0;

/// What the operator wants to read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EventFilter {
    /// What matters less is left out.
    pub least: Severity,
    /// What does not have this in it is left out, whatever the case of its letters.
    pub text: String,
}

/// What the panel shows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EventsData {
    /// The newest first.
    pub lines: Vec<EventLine>,
    /// How much is left out, in words.
    pub left_out: Option<String>,
}

/// One line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EventLine {
    /// When, by the wall clock.
    pub time: String,
    /// How much it matters.
    pub severity: Severity,
    /// Who tells, and what kind of thing.
    pub heading: String,
    /// What happened.
    pub text: String,
}

impl EventFilter {
    fn passes(&self, entry: &Entry, needle: &str) -> bool {
        let has = |text: &str| text.to_lowercase().contains(needle);
        entry.severity >= self.least && (needle.is_empty() || has(&entry.text) || has(&entry.kind))
    }
}

impl EventsData {
    /// The entries that pass the filter.
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

fn line(entry: &Entry) -> EventLine {
    let who = match entry.source {
        Source::Robot => "robot",
        Source::Console => "console",
    };
    EventLine {
        time: entry.time.clone(),
        severity: entry.severity,
        heading: format!("{who}: {}", entry.kind),
        text: entry.text.clone(),
    }
}

/// Draws the panel.
pub fn events_ui(ui: &mut Ui, data: &EventsData, filter: &mut EventFilter) {
    let is_narrow = ui.available_width() < NARROW;
    ui.horizontal_wrapped(|ui| {
        let severity = ComboBox::from_id_salt("least severity")
            .selected_text(least_words(filter.least))
            .width(150.0)
            .show_ui(ui, |ui| {
                for severity in Severity::ALL {
                    let words = least_words(severity);
                    ui.selectable_value(&mut filter.least, severity, words);
                }
            });
        severity
            .response
            .on_hover_text("Leave out what matters less");
        let label = ui.label("Filter");
        ui.add(
            TextEdit::singleline(&mut filter.text)
                .hint_text("words in it")
                .char_limit(100)
                .desired_width(if is_narrow { 120.0 } else { 180.0 }),
        )
        .labelled_by(label.id);
        if let Some(left_out) = &data.left_out {
            ui.weak(left_out);
        }
    });
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
            } else {
                lines_ui(ui, &data.lines);
            }
        });
}

/// Each in a row; what is too long for it has another.
fn lines_ui(ui: &mut Ui, lines: &[EventLine]) {
    Grid::new("events")
        .num_columns(3)
        .min_row_height(18.0)
        .spacing([12.0, 3.0])
        .striped(true)
        .show(ui, |ui| {
            for line in lines {
                heading_ui(ui, line);
                ui.add(Label::new(&line.text).wrap());
                ui.end_row();
            }
        });
}

/// What happened stands below when and to whom it did.
fn narrow_line_ui(ui: &mut Ui, line: &EventLine) {
    ui.horizontal_wrapped(|ui| heading_ui(ui, line));
    ui.add(Label::new(&line.text).wrap());
    ui.add_space(4.0);
}

fn heading_ui(ui: &mut Ui, line: &EventLine) {
    ui.weak(RichText::new(&line.time).monospace().size(13.0));
    let tone = tone(line.severity).color(ui.visuals());
    let heading = RichText::new(&line.heading).size(13.0);
    ui.label(match line.severity {
        Severity::Note => heading.weak(),
        Severity::Warning | Severity::Alarm => heading.color(tone),
    })
    .on_hover_text(line.severity.words());
}

const fn tone(severity: Severity) -> Tone {
    match severity {
        Severity::Note => Tone::Waiting,
        Severity::Warning | Severity::Alarm => Tone::Warning,
    }
}

const fn least_words(least: Severity) -> &'static str {
    match least {
        Severity::Note => "Everything",
        Severity::Warning => "Warnings and alarms",
        Severity::Alarm => "Alarms only",
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use robot_edge::clock::Monotonic;

    use super::*;

    const LONG: &str = "12 files are in /home/anna/maps/a folder with a name that is much longer than one line of a \
        panel, and behind which there are many words more that nobody would want to miss";

    /// A window with the panel alone.
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
    fn a_long_line_has_more_lines_however_wide_the_panel_is() {
        for width in [240.0, 400.0, 700.0] {
            let mut log = EventLog::default();
            for (n, text) in ["short", LONG, "newest"].into_iter().enumerate() {
                log.note(
                    Severity::Note,
                    "export",
                    text,
                    Monotonic::default(),
                    n as u64,
                );
            }
            let window = window(width, &log, &EventFilter::default());
            let [newest, long, short] =
                ["newest", LONG, "short"].map(|text| window.get_by_label(text).rect());
            assert!(long.right() <= width, "{width}: {long}");
            assert!(long.height() > 1.8 * short.height(), "{width}: {long}");
            assert!(long.top() >= newest.bottom(), "{width}: {long}");
            assert!(short.top() >= long.bottom(), "{width}: {short}");
        }
    }

    #[test]
    fn an_empty_list_says_whether_the_filter_made_it_so() {
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
            (Severity::Note, "export", "12 files are in maps"),
            (Severity::Warning, "link", "Control goes by TLS"),
            (Severity::Alarm, "alert", "Emergency stop 1 is in force"),
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
    fn lines_are_filtered_by_severity_and_words() {
        let all = EventFilter::default();
        assert_eq!(
            texts(&all),
            [
                "Emergency stop 1 is in force",
                "Control goes by TLS",
                "12 files are in maps"
            ]
        );
        let alarms = EventFilter {
            least: Severity::Alarm,
            ..EventFilter::default()
        };
        assert_eq!(texts(&alarms), ["Emergency stop 1 is in force"]);
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
}
