use std::cell::RefCell;
use std::rc::Rc;

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use protocol::keys::Topic;
use protocol::message::{Info, Refusal, Status};
use teleop::Role;

use super::*;
use crate::model::RequestId;
use crate::test_support::{
    at, console, idle_teleop_client, idle_teleop_status, inject, inject_reply, scout,
};

fn recording(state: RecordingState) -> RecordingStatus {
    RecordingStatus {
        state,
        file: "scout-2026-03-01T123456Z.mcap".to_owned(),
        files: 2,
        duration_s: 75,
        bytes: 4_100_000,
        free_bytes: Some(52_000_000_000),
        lost: 0,
    }
}

fn model(recording: Option<RecordingStatus>) -> ConsoleModel {
    ended_model(recording, false)
}

fn ended_model(recording: Option<RecordingStatus>, has_ended: bool) -> ConsoleModel {
    let mut model = scout();
    let status = Status {
        recording,
        has_ended,
        ..Status::default()
    };
    inject(&mut model, Topic::Status, &status, at(1_000));
    model
}

fn data(recording: Option<RecordingStatus>, teleop_client: &TeleopClientState) -> RecordingData {
    RecordingData::new(&model(recording), Some(teleop_client), None, at(1_100))
}

fn text(data: &RecordingData) -> String {
    let mut lines = vec![format!("{:?} {}", data.tone, data.state)];
    lines.extend(data.advice.clone());
    if let Some(button) = &data.button {
        let words = if button.starts { "[start]" } else { "[stop]" };
        lines.push(format!("{words} {}", button.blocked.unwrap_or_default()));
    }
    lines.extend(data.refusal.clone());
    lines.extend(
        data.rows
            .iter()
            .map(|(name, value)| format!("{name}: {value}")),
    );
    lines.join("\n")
}

#[test]
fn a_running_recording_shows_length_and_size() {
    assert_eq!(
        text(&data(
            Some(recording(RecordingState::Recording)),
            &idle_teleop_client()
        )),
        "Good Recording\n\
         [stop] \n\
         Length: 1:15\n\
         Size: 4.1 MB in 2 files\n\
         Free on disk: 52.0 GB\n\
         File: scout-2026-03-01T123456Z.mcap\n\
         Folder: on the robot, as its --recordings names it"
    );
}

#[test]
fn full_disk_and_lost_messages_are_shown() {
    let full = RecordingStatus {
        files: 1,
        duration_s: 3_675,
        lost: 1_200,
        free_bytes: None,
        ..recording(RecordingState::StoppedDiskLow)
    };
    let text = text(&data(Some(full), &idle_teleop_client()));
    for words in [
        "Warning Stopped: disk nearly full\nThe robot keeps 1 GB and 5 % of its disk free.",
        "\n[start] \n",
        "Length: 1:01:15",
        "in 1 file\n",
        "Free on disk: –",
        "Lost: 1\u{a0}200 measurements",
    ] {
        assert!(text.contains(words), "{words:?} is not in {text}");
    }
}

#[test]
fn hint_for_robots_without_recording() {
    assert_eq!(
        text(&data(None, &idle_teleop_client())),
        "Waiting This robot does not record\n\
         Start robot-edge with --recordings DIR to let operators record."
    );
}

#[test]
fn a_replay_gets_no_hint_to_record() {
    let advice = |source: &str, teleop| {
        let mut model = scout();
        let info = Info {
            source: source.to_owned(),
            ..Info::default()
        };
        inject_reply(&mut model, RequestId(1), Topic::Info, &info, at(1_000));
        let status = Status {
            teleop,
            ..Status::default()
        };
        inject(&mut model, Topic::Status, &status, at(1_000));
        let data = RecordingData::new(&model, None, None, at(1_100));
        data.advice.unwrap()
    };
    let start = "Start robot-edge with --recordings DIR to let operators record.";
    let replayed =
        "Its data comes from rooms.mcap, not from sensors: there is nothing new to record.";
    assert_eq!(advice("rooms.mcap", None), replayed);
    assert_eq!(advice("", None), start);
    assert_eq!(advice("rooms", Some(idle_teleop_status())), start);
}

#[test]
fn refusals_are_shown() {
    let asked = RequestKind::Set(Setting::Recording(true));
    let refused = Answer::Refused(Refusal::Role);
    for (notice, expected) in [
        (
            TeleopNotification::Answered(asked.clone(), refused),
            Some("Recording on refused: the sender's role does not allow it"),
        ),
        (
            TeleopNotification::RequestTimedOut(asked),
            Some("Recording on: no answer"),
        ),
        (TeleopNotification::LeaseLost, None),
    ] {
        let mut teleop_client = idle_teleop_client();
        teleop_client.notice = Some(notice);
        let refusal = data(Some(recording(RecordingState::Stopped)), &teleop_client).refusal;
        assert_eq!(refusal.as_deref(), expected);
    }
}

#[test]
fn a_disabled_button_shows_the_reason() {
    let model = model(Some(recording(RecordingState::Stopped)));
    let client = |change: fn(&mut TeleopClientState)| {
        let mut client = idle_teleop_client();
        change(&mut client);
        Some(client)
    };
    let ready = || client(|_| {});
    let asking = client(|client| client.is_asking = true);
    let observer = client(|client| client.role = Some(Role::Observer));
    let no_tokens = client(|client| client.token_age = None);
    for (teleop_client, ms, reason) in [
        (ready(), 1_100, None),
        (None, 1_100, Some("No operator name is set")),
        (ready(), 9_000, Some("No data from the robot")),
        (asking, 1_100, Some("The robot is being asked")),
        (
            observer,
            1_100,
            Some("Observers start and stop no recording"),
        ),
        (no_tokens, 1_100, Some("The robot takes no requests")),
    ] {
        let data = RecordingData::new(&model, teleop_client.as_ref(), None, at(ms));
        assert_eq!(data.button.unwrap().blocked, reason);
    }
}

#[test]
fn the_button_starts_and_stops() {
    for (state, label, drive_input) in [
        (RecordingState::Stopped, "Start recording", true),
        (RecordingState::Failed, "Start recording", true),
        (RecordingState::Recording, "Stop recording", false),
    ] {
        let data = data(Some(recording(state)), &idle_teleop_client());
        let asked = Rc::new(RefCell::new(Vec::new()));
        let contact = Rc::clone(&asked);
        let mut panel =
            Harness::new_ui(move |ui| contact.borrow_mut().extend(recording_ui(ui, &data)));
        panel.get_by_label(label).click();
        panel.run();
        let expected = Command::Drive(Intent::Set(Setting::Recording(drive_input)));
        assert_eq!(*asked.borrow(), [expected]);
    }
}

#[test]
fn an_open_recording_has_its_own_text() {
    let mut model = console("recording-1a2b3c", &[]);
    inject(&mut model, Topic::Status, &Status::default(), at(1_000));
    let data = RecordingData::new(&model, None, None, at(1_100));
    assert_eq!(
        text(&data),
        "Waiting This is a recording itself\n\
         What robots record is started and stopped here while one is shown."
    );
}

#[test]
fn files_on_this_machine_are_shown_and_opened() {
    let folder = Path::new("/home/anna/recordings");
    let data = |state, files| {
        let recording = RecordingStatus {
            files,
            ..recording(state)
        };
        let teleop_client = idle_teleop_client();
        RecordingData::new(
            &model(Some(recording)),
            Some(&teleop_client),
            Some(folder),
            at(1_100),
        )
    };
    let row = ("Folder".to_owned(), "/home/anna/recordings".to_owned());
    assert!(data(RecordingState::Recording, 1).rows.contains(&row));
    let words = |state, files| data(state, files).finished.map(|(_, words)| words);
    assert_eq!(words(RecordingState::Recording, 1), None, "it is written");
    assert_eq!(words(RecordingState::Stopped, 0), None, "there is none");
    assert_eq!(words(RecordingState::Stopped, 1), Some("Open it"));
    let several = Some("Open its last file");
    assert_eq!(words(RecordingState::StoppedDiskLow, 2), several);

    let stopped = data(RecordingState::Stopped, 1);
    let asked = Rc::new(RefCell::new(Vec::new()));
    let contact = Rc::clone(&asked);
    let mut panel =
        Harness::new_ui(move |ui| contact.borrow_mut().extend(recording_ui(ui, &stopped)));
    for label in ["Open folder", "Open it"] {
        panel.get_by_label(label).click();
        panel.run();
    }
    let file = folder.join("scout-2026-03-01T123456Z.mcap");
    let expected = [Command::OpenFolder(folder.to_owned()), Command::Open(file)];
    assert_eq!(*asked.borrow(), expected);
}

#[test]
fn file_outside_the_folder_is_not_opened() {
    let folder = Path::new("/home/anna/recordings");
    let finished = |file: &str| {
        let recording = RecordingStatus {
            file: file.to_owned(),
            ..recording(RecordingState::Stopped)
        };
        let data = RecordingData::new(&model(Some(recording)), None, Some(folder), at(1_100));
        data.finished.map(|(path, _)| path)
    };
    assert_eq!(finished("scout.mcap"), Some(folder.join("scout.mcap")));
    for elsewhere in ["../scout.mcap", "/etc/passwd", "old/scout.mcap", "..", ""] {
        assert_eq!(finished(elsewhere), None, "{elsewhere}");
    }
}

#[test]
fn states_of_live_silent_and_ended_robots() {
    use RecordingState::{Failed, Recording, Stopped};
    const ENDED: &str = "The data has ended: nothing more is written.";
    const FAILED: &str = "The event shows why. Data written before is kept.";
    const SILENT: &str = "No data from the robot";
    let check = |state, has_ended, ms, least: &str, expected: String| {
        let model = ended_model(Some(recording(state)), has_ended);
        let data = RecordingData::new(&model, Some(&idle_teleop_client()), None, at(ms));
        let extent = format!("\nLength: {least}1:15\nSize: {least}4.1 MB in 2 files\n");
        let text = text(&data);
        assert!(text.starts_with(&(expected + &extent)), "{text}");
    };
    let least = "at least ";
    check(
        Recording,
        false,
        1_100,
        "",
        "Good Recording\n[stop] ".to_owned(),
    );
    let silent = format!("Waiting Was recording\nAs of 8.0 s ago\n[stop] {SILENT}");
    check(Recording, false, 9_000, least, silent);
    let ended = format!("Waiting Recording ended\n{ENDED}\n[start] Its data has ended");
    check(Recording, true, 1_100, least, ended);
    let gone = format!("Waiting Recording ended\n{ENDED} As of 8.0 s ago\n[start] {SILENT}");
    check(Recording, true, 9_000, least, gone);
    let failed = format!("Stopped: it cannot be written\n{FAILED}");
    check(
        Failed,
        false,
        1_100,
        "",
        format!("Warning {failed}\n[start] "),
    );
    let failed = format!("Waiting {failed} As of 8.0 s ago\n[start] {SILENT}");
    check(Failed, false, 9_000, "", failed);
    check(
        Stopped,
        false,
        1_100,
        "",
        "Waiting Not recording\n[start] ".to_owned(),
    );
    let no_status = RecordingData::new(&scout(), Some(&idle_teleop_client()), None, at(1_100));
    assert_eq!(text(&no_status), "Waiting No data yet");
}
