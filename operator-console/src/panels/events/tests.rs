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
