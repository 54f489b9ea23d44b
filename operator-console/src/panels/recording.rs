//! Recording on the robot: state, size, start and stop.

use std::path::{Path, PathBuf};

use eframe::egui::{Button, Label, RichText, TextStyle, Ui, vec2};
use measurement::time::{Monotonic, RobotDuration};
use protocol::message::{Answer, RecordingState, RecordingStatus, Setting};

use super::driving::labels;
use super::formatting::{age, bytes, capitalised, count, with_monospace_options};
use super::rows::{Row, row, rows_ui};
use super::timeline::clock;
use crate::command::Command;
use crate::model::{ConsoleModel, LinkState};
use crate::playback::is_recording;
use crate::teleop_client::{Intent, RequestKind, TeleopClientState, TeleopNotification};
use crate::theme::{Tone, state_ui};

const WIDE: f32 = 520.0;
const BUTTONS: f32 = 290.0;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordingData {
    pub tone: Tone,
    pub state: String,
    pub advice: Option<String>,
    pub rows: Vec<(String, String)>,
    pub button: Option<RecordingButton>,
    /// Folder of the recordings, if it is on this machine.
    pub folder: Option<PathBuf>,
    /// The last complete file, if it is on this machine, with the text of its button.
    pub finished: Option<(PathBuf, &'static str)>,
    pub refusal: Option<String>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordingButton {
    pub starts: bool,
    pub blocked: Option<&'static str>,
}

impl RecordingData {
    /// `folder`: of the robot's recordings, if it is on this machine.
    pub fn new(
        model: &ConsoleModel,
        teleop_client: Option<&TeleopClientState>,
        folder: Option<&Path>,
        now: Monotonic,
    ) -> Self {
        let is_live = model.connection().state(now) == LinkState::Live;
        let Some((recording, (status, at))) = model.recording().zip(model.status()) else {
            return Self::unavailable(model);
        };
        let (tone, state, texts) = state_text(recording.state, is_live, status.has_ended);
        let reported = (!is_live).then(|| format!("As of {} ago", age(now.since(*at))));
        let advice: Vec<_> = texts
            .map(str::to_owned)
            .into_iter()
            .chain(reported)
            .collect();
        let is_running = recording.state == RecordingState::Recording;
        // The file may have grown since the last status.
        let may_be_more = is_running && (!is_live || status.has_ended);
        let blocked = match teleop_client {
            _ if !is_live => Some("No data from the robot"),
            _ if status.has_ended => Some("Its data has ended"),
            None => Some("No operator name is set"),
            Some(teleop_client) if teleop_client.is_observer() => {
                Some("Observers start and stop no recording")
            }
            Some(teleop_client) if teleop_client.is_asking => Some("The robot is being asked"),
            Some(teleop_client) if teleop_client.token_age.is_none() => {
                Some("The robot takes no requests")
            }
            Some(_) => None,
        };
        Self {
            tone: if is_live { tone } else { Tone::Waiting },
            state: state.to_owned(),
            advice: (!advice.is_empty()).then(|| advice.join(" ")),
            rows: rows(recording, folder, may_be_more),
            folder: folder.map(Path::to_owned),
            finished: finished(recording, folder),
            button: Some(RecordingButton {
                starts: !is_running || status.has_ended,
                blocked,
            }),
            refusal: teleop_client
                .and_then(|teleop_client| teleop_client.notice.as_ref())
                .and_then(refusal),
        }
    }

    fn unavailable(model: &ConsoleModel) -> Self {
        let (state, advice) = if model.status().is_none() {
            ("No data yet", None)
        } else if is_recording(model.robot()) {
            let advice = "What robots record is started and stopped here while one is shown.";
            ("This is a recording itself", Some(advice.to_owned()))
        } else if let Some(source) = played(model) {
            let advice = format!(
                "Its data comes from {source}, not from sensors: there is nothing new to record."
            );
            ("This robot does not record", Some(advice))
        } else {
            let advice = "Start robot-edge with --recordings DIR to let operators record.";
            ("This robot does not record", Some(advice.to_owned()))
        };
        Self {
            tone: Tone::Waiting,
            state: state.to_owned(),
            advice,
            rows: Vec::new(),
            button: None,
            folder: None,
            finished: None,
            refusal: None,
        }
    }
}

fn played(model: &ConsoleModel) -> Option<&str> {
    let (status, _) = model.status()?;
    let source = model.info()?.source.as_str();
    (!source.is_empty() && status.teleop.is_none()).then_some(source)
}

fn state_text(
    state: RecordingState,
    is_live: bool,
    has_ended: bool,
) -> (Tone, &'static str, Option<&'static str>) {
    match state {
        RecordingState::Recording if has_ended => (
            Tone::Waiting,
            "Recording ended",
            Some("The data has ended: nothing more is written."),
        ),
        RecordingState::Recording if !is_live => (Tone::Waiting, "Was recording", None),
        RecordingState::Recording => (Tone::Good, "Recording", None),
        RecordingState::Stopped => (Tone::Waiting, "Not recording", None),
        RecordingState::StoppedDiskLow => (
            Tone::Warning,
            "Stopped: disk nearly full",
            Some(
                "The robot keeps 1 GB and 5 % of its disk free. Make room on it, then start again.",
            ),
        ),
        RecordingState::Failed => (
            Tone::Warning,
            "Stopped: it cannot be written",
            Some("The event shows why. Data written before is kept."),
        ),
    }
}

fn finished(recording: &RecordingStatus, folder: Option<&Path>) -> Option<(PathBuf, &'static str)> {
    let is_finished = recording.files > 0 && recording.state != RecordingState::Recording;
    let file = Path::new(&recording.file);
    // The robot sends the name: a path must not be followed.
    let is_name = file.file_name().is_some_and(|name| name == file);
    let path = folder.filter(|_| is_finished && is_name)?.join(file);
    let words = if recording.files == 1 {
        "Open it"
    } else {
        "Open its last file"
    };
    Some((path, words))
}

fn rows(recording: &RecordingStatus, folder: Option<&Path>, may_be_more: bool) -> Vec<Row> {
    let mut rows = Vec::new();
    if recording.files > 0 {
        let files = if recording.files == 1 {
            "file"
        } else {
            "files"
        };
        let least = if may_be_more { "at least " } else { "" };
        let length = clock(RobotDuration::from_secs_f64(recording.duration_s.into()));
        let length = length.trim_end_matches(".0");
        let size = bytes(recording.bytes);
        rows.push(row("Length", format!("{least}{length}")));
        rows.push(row(
            "Size",
            format!("{least}{size} in {} {files}", recording.files),
        ));
    }
    let free = recording.free_bytes.map_or_else(|| "–".to_owned(), bytes);
    rows.push(row("Free on disk", free));
    if recording.lost > 0 {
        rows.push(row(
            "Lost",
            format!("{} measurements", count(recording.lost)),
        ));
    }
    if recording.files > 0 {
        rows.push(row("File", recording.file.clone()));
        let folder = folder.map_or_else(
            || "on the robot, as its --recordings names it".to_owned(),
            |folder| folder.display().to_string(),
        );
        rows.push(row("Folder", folder));
    }
    rows
}

fn refusal(note: &TeleopNotification) -> Option<String> {
    match note {
        TeleopNotification::Answered(
            RequestKind::Set(Setting::Recording(_)),
            Answer::Refused(_),
        )
        | TeleopNotification::RequestTimedOut(RequestKind::Set(Setting::Recording(_)))
        | TeleopNotification::NotSent(RequestKind::Set(Setting::Recording(_)), _) => {
            Some(capitalised(&labels::note(note).0))
        }
        _ => None,
    }
}

/// Draws the panel: rows beside the buttons if there is space.
pub fn recording_ui(ui: &mut Ui, data: &RecordingData) -> Option<Command> {
    if ui.available_width() < WIDE || data.rows.is_empty() {
        let asked = state_and_buttons_ui(ui, data);
        rows_ui(ui, "recording", &data.rows);
        return asked;
    }
    let columns = ui.horizontal_top(|ui| {
        let buttons = ui.vertical(|ui| {
            ui.set_width(BUTTONS);
            state_and_buttons_ui(ui, data)
        });
        ui.vertical(|ui| rows_ui(ui, "recording", &data.rows));
        buttons.inner
    });
    columns.inner
}

fn state_and_buttons_ui(ui: &mut Ui, data: &RecordingData) -> Option<Command> {
    state_ui(ui, data.tone, &data.state, 20.0);
    if let Some(advice) = &data.advice {
        let ink = ui.visuals().text_color();
        let advice = with_monospace_options(ui, advice, &TextStyle::Small, ink);
        ui.add(Label::new(advice).wrap());
    }
    let asked = ui.horizontal_wrapped(|ui| {
        let pressed = data
            .button
            .as_ref()
            .and_then(|button| button_ui(ui, button));
        pressed.or(files_ui(ui, data))
    });
    if let Some(refusal) = &data.refusal {
        let warning = Tone::Warning.color(ui.visuals());
        ui.add(Label::new(RichText::new(refusal).small().color(warning)).wrap());
    }
    asked.inner
}

fn files_ui(ui: &mut Ui, data: &RecordingData) -> Option<Command> {
    let folder = data.folder.as_ref()?;
    let mut command = None;
    let show = ui.button("Open folder");
    if show.on_hover_text(folder.display().to_string()).clicked() {
        command = Some(Command::OpenFolder(folder.clone()));
    }
    if let Some((path, words)) = &data.finished {
        let hint = "Shown in this window instead of the robot";
        if ui.button(*words).on_hover_text(hint).clicked() {
            command = Some(Command::Open(path.clone()));
        }
    }
    command
}

fn button_ui(ui: &mut Ui, button: &RecordingButton) -> Option<Command> {
    let (words, hint) = if button.starts {
        (
            "Start recording",
            "The robot writes all that its sensors measure to its own disk",
        )
    } else {
        ("Stop recording", "The file is finished and kept")
    };
    let shown = Button::new(words).min_size(vec2(140.0, 28.0));
    let response = ui.add_enabled(button.blocked.is_none(), shown);
    let response = match button.blocked {
        Some(why) => response.on_disabled_hover_text(why),
        None => response.on_hover_text(hint),
    };
    response
        .clicked()
        .then_some(Command::Drive(Intent::Set(Setting::Recording(
            button.starts,
        ))))
}

#[cfg(test)]
mod tests;
