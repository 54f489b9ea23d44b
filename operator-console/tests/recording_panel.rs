//! Text of the Recording panel in unusual states.

#![allow(
    clippy::unwrap_used,
    reason = "the lint knows functions marked as tests, not what they call"
)]

use std::path::Path;
use std::time::Duration;

use measurement::time::Monotonic;
use operator_console::model::{ConsoleModel, Incoming, ModelSettings};
use operator_console::panels::recording::RecordingData;
use operator_console::teleop_client::{EStopState, Lease, TeleopClientState};
use operator_console::teleop_input::{DriveInput, SpeedStep};
use operator_console::theme::Tone;
use protocol::keys::Topic;
use protocol::message::{RecordingState, RecordingStatus, Status};
use protocol::tile::BootId;
use protocol::wire::{self, Header};

const fn at(ms: u64) -> Monotonic {
    Monotonic::from_nanos(ms * 1_000_000)
}

fn recording(state: RecordingState) -> RecordingStatus {
    RecordingStatus {
        state,
        file: "scout.mcap".to_owned(),
        files: 1,
        duration_s: 75,
        bytes: 4_100_000,
        free_bytes: None,
        lost: 0,
    }
}

/// A robot without any message.
fn silent() -> ConsoleModel {
    ConsoleModel::new(ModelSettings {
        robot: "scout".parse().unwrap(),
        session: BootId([1; 16]),
        tile_store_mb: 1,
        layers: [].into(),
    })
    .unwrap()
}

/// A robot with this state of its recording at 1 s.
fn model(recording: RecordingStatus, has_ended: bool) -> ConsoleModel {
    let mut model = silent();
    let status = Status {
        recording: Some(recording),
        has_ended,
        ..Status::default()
    };
    let header = Header {
        boot: BootId([7; 16]),
        seq: 1,
        robot_time_ns: 0,
    };
    let sample = Incoming::Sample {
        key: Topic::Status.key(model.robot()),
        payload: wire::encode(&header, &status).unwrap(),
    };
    model.apply(sample, at(1_000));
    model
}

fn teleop_client(token_age: Option<Duration>) -> TeleopClientState {
    TeleopClientState {
        operator: "anna".parse().unwrap(),
        role: None,
        lease: Lease::None,
        last_grant: None,
        step: SpeedStep::default(),
        limits: [1.0, 1.5],
        drive_input: DriveInput::NEUTRAL,
        keys: Vec::new(),
        ignored: None,
        is_ready: true,
        token_age,
        is_asking: false,
        notice: None,
        estop: EStopState::Quiet,
    }
}

fn data(model: &ConsoleModel, ms: u64) -> RecordingData {
    let teleop_client = teleop_client(Some(Duration::from_millis(20)));
    RecordingData::new(model, Some(&teleop_client), None, at(ms))
}

/// Duration and size.
fn extent(data: &RecordingData) -> [&str; 2] {
    ["Length", "Size"].map(|name| {
        let mut rows = data.rows.iter();
        let (_, value) = rows.find(|(row, _)| row == name).unwrap();
        value.as_str()
    })
}

/// Tone, text, advice, and why the button is disabled.
fn said(data: &RecordingData) -> (Tone, &str, Option<&str>, Option<&str>) {
    let button = data.button.as_ref();
    let blocked = button.and_then(|button| button.blocked);
    (data.tone, &data.state, data.advice.as_deref(), blocked)
}

#[test]
fn file_outside_the_folder_is_not_opened() {
    let folder = Path::new("/home/anna/recordings");
    let finished = |file: &str| {
        let recording = RecordingStatus {
            file: file.to_owned(),
            ..recording(RecordingState::Stopped)
        };
        let data = RecordingData::new(&model(recording, false), None, Some(folder), at(1_100));
        data.finished.map(|(path, _)| path)
    };
    assert_eq!(finished("scout.mcap"), Some(folder.join("scout.mcap")));
    for elsewhere in ["../scout.mcap", "/etc/passwd", "old/scout.mcap", "..", ""] {
        assert_eq!(finished(elsewhere), None, "{elsewhere}");
    }
}

#[test]
fn end_of_data_ends_recording_display() {
    let ended = model(recording(RecordingState::Recording), true);
    let why = "The data has ended: nothing more is written.";
    let gone = format!("{why} As of 8.0 s ago");
    for (ms, advice, blocked) in [
        (1_100, why, "Its data has ended"),
        (9_000, gone.as_str(), "No data from the robot"),
    ] {
        let data = data(&ended, ms);
        let headline = "Recording ended";
        let expected = (Tone::Waiting, headline, Some(advice), Some(blocked));
        assert_eq!(said(&data), expected);
        let least = ["at least 1:15", "at least 4.1 MB in 1 file"];
        assert_eq!(extent(&data), least);
        assert!(data.button.unwrap().starts, "there is nothing to stop");
    }
}

#[test]
fn silent_robot_shows_age_of_recording_status() {
    let model = model(recording(RecordingState::Recording), false);
    let live = data(&model, 1_100);
    assert_eq!(said(&live), (Tone::Good, "Recording", None, None));
    let silent = data(&model, 9_000);
    let expected = (
        Tone::Waiting,
        "Was recording",
        Some("As of 8.0 s ago"),
        Some("No data from the robot"),
    );
    assert_eq!(said(&silent), expected);
    assert_eq!(extent(&live), ["1:15", "4.1 MB in 1 file"]);
    let least = ["at least 1:15", "at least 4.1 MB in 1 file"];
    assert_eq!(extent(&silent), least);
    let others = |data: &RecordingData| data.rows[2..].to_vec();
    assert_eq!(others(&silent), others(&live));
    assert!(!silent.button.unwrap().starts);
}

#[test]
fn stopped_recording_does_not_grow() {
    let stopped = model(recording(RecordingState::Failed), false);
    let silent = data(&stopped, 9_000);
    let advice = "The event shows why. Data written before is kept. As of 8.0 s ago";
    assert_eq!(silent.advice.as_deref(), Some(advice));
    assert_eq!(extent(&silent), ["1:15", "4.1 MB in 1 file"]);
}

#[test]
fn a_recording_that_failed_is_a_warning() {
    let failed = model(recording(RecordingState::Failed), false);
    let advice = Some("The event shows why. Data written before is kept.");
    let expected = (Tone::Warning, "Stopped: it cannot be written", advice, None);
    assert_eq!(said(&data(&failed, 1_100)), expected);
}

#[test]
fn robot_without_tokens_takes_no_recording_requests() {
    let model = model(recording(RecordingState::Stopped), false);
    let teleop_client = teleop_client(None);
    let data = RecordingData::new(&model, Some(&teleop_client), None, at(1_100));
    let expected = (
        Tone::Waiting,
        "Not recording",
        None,
        Some("The robot takes no requests"),
    );
    assert_eq!(said(&data), expected);
}

#[test]
fn robot_without_status_shows_no_recording() {
    let expected = (Tone::Waiting, "No data yet", None, None);
    assert_eq!(said(&data(&silent(), 1_100)), expected);
}
