//! Always in sight, in one line: which robot, how its link is, how old what is shown is, who drives, and the stop.

use eframe::egui::{Align, Button, Color32, Label, Layout, RichText, Stroke, Ui, vec2};
use robot_edge::clock::Monotonic;

use super::connection::{ConnectionData, LinkSight};
use super::driving::{DrivingData, EStopFace};
use super::robots::swatch_ui;
use super::wording::age;
use crate::command::Command;
use crate::helm::{HelmSight, Intent};
use crate::model::{ConsoleModel, LinkState};
use crate::theme::{self, Tone, state_ui};

/// Longer names are cut off, points: what follows matters more.
const NAME: f32 = 220.0;
/// The name has at most this share of its part of the bar.
const NAME_SHARE: f32 = 0.35;
/// Bars that are narrower leave out what can be missed, points.
const NARROW: f32 = 330.0;

/// What the bar shows of a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct TopBarData {
    /// Its name; of a recording, the file's.
    pub name: String,
    /// Its own colour, where it is to be told from others.
    pub color: Option<Color32>,
    /// How the link is.
    pub link: (Tone, String),
    /// How long ago the robot was heard; none before that, and of a recording and a robot whose data has ended, where it
    /// says nothing.
    pub age: Option<String>,
    /// Whether the map is the robot's.
    pub map: (Tone, String),
    /// Who drives; none where nobody can.
    pub driver: Option<String>,
    /// The stop, where there is something to stop.
    pub estop: Option<EStopFace>,
}

impl TopBarData {
    /// The robot at `now`.
    pub fn new(
        model: &ConsoleModel,
        link: &LinkSight,
        helm: Option<&HelmSight>,
        color: Option<Color32>,
        now: Monotonic,
    ) -> Self {
        let connection = ConnectionData::new(model, link, now);
        let driving = helm.and_then(|helm| DrivingData::new(model, helm, now));
        let is_recording = link.recording.is_some();
        let is_live = model.connection().state(now) == LinkState::Live;
        let has_ended = model.says_ended();
        let says_nothing = is_recording || (is_live && has_ended);
        let old = model.connection().age(now).filter(|_| !says_nothing);
        // Live data is some milliseconds old: figures that flicker say less than this.
        let age = old.map(|old| match model.connection().state(now) {
            LinkState::Live if old.as_millis() < 200 => "< 0.2 s old".to_owned(),
            LinkState::Live | LinkState::Silent | LinkState::Waiting => {
                format!("{} old", age(old))
            }
        });
        Self {
            name: link.name_of(model.robot()),
            color,
            link: (connection.tone, connection.state),
            age,
            map: (connection.map_tone, connection.map),
            driver: driving.as_ref().map(|driving| driving.driver.clone()),
            estop: driving.map(|driving| driving.estop),
        }
    }
}

/// Draws the robot's part of the bar, from the left.
pub fn robot_bar_ui(ui: &mut Ui, data: &TopBarData) {
    if let Some(color) = data.color {
        swatch_ui(ui, color);
    }
    ui.scope(|ui| {
        ui.set_max_width((NAME_SHARE * ui.available_width()).min(NAME));
        let name = RichText::new(&data.name).strong();
        ui.add(Label::new(name).truncate())
            .on_hover_text(&data.name);
    });
    state_ui(ui, data.link.0, &data.link.1, 15.0);
    if let Some(age) = &data.age {
        ui.label(age)
            .on_hover_text("Since the newest message of the robot");
    }
    ui.separator();
    state_ui(ui, data.map.0, &data.map.1, 15.0);
    if let Some(driver) = &data.driver {
        ui.separator();
        ui.add(Label::new(driver).truncate());
    }
}

/// Draws the stop and the alerts that nobody has seen from the right, and `middle` in what is left.
pub fn right_bar_ui(
    ui: &mut Ui,
    data: Option<&TopBarData>,
    unseen: usize,
    middle: impl FnOnce(&mut Ui),
) -> RightBar {
    let mut asked = RightBar::default();
    ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
        if let Some(estop) = data.and_then(|data| data.estop.as_ref()) {
            asked.command = stop_ui(ui, estop).map(Command::Drive);
        }
        let words = match unseen {
            0 => "No alerts".to_owned(),
            1 => "1 alert".to_owned(),
            n => format!("{n} alerts"),
        };
        let [fill, ink] = theme::BANNER;
        let text = RichText::new(words);
        let button = if unseen > 0 {
            Button::new(text.strong().color(ink)).fill(fill)
        } else {
            Button::new(text).frame(false)
        };
        // Where there is little room, it is for what the link is like.
        if unseen > 0 || ui.available_width() >= NARROW {
            let button = ui.add(button);
            asked.shows_alerts = button.on_hover_text("Show the alerts").clicked();
        }
        ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
            // What does not fit is cut off, and moves nothing.
            ui.set_clip_rect(ui.max_rect().intersect(ui.clip_rect()));
            middle(ui);
        });
    });
    asked
}

/// What was asked for on the right of the bar.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RightBar {
    /// Of the robot.
    pub command: Option<Command>,
    /// To see the alerts.
    pub shows_alerts: bool,
}

/// Always the same size at the same place, whatever it says.
fn stop_ui(ui: &mut Ui, face: &EStopFace) -> Option<Intent> {
    let [danger, on_danger] = theme::DANGER;
    let [banner, on_banner] = theme::BANNER;
    let (words, fill, ink, hint) = match face {
        EStopFace::Ready | EStopFace::Refused(_) => (
            "Stop",
            danger,
            on_danger,
            "Emergency stop: stops at once, and stays stopped until it is reset (Space)",
        ),
        EStopFace::Sending(_) => (
            "Stopping…",
            banner,
            on_banner,
            "The emergency stop is being sent and is not acknowledged; press again if you like",
        ),
        EStopFace::InForce { .. } => (
            "Stopped",
            on_danger,
            danger,
            "An emergency stop is in force; it is reset in the driving panel",
        ),
    };
    let text = RichText::new(words).strong().color(ink);
    let button = Button::new(text)
        .fill(fill)
        .stroke(Stroke::new(1.5, danger))
        .min_size(vec2(96.0, 28.0));
    // Pressing again what is in force does no harm, and is what one does.
    ui.add(button)
        .on_hover_text(hint)
        .clicked()
        .then_some(Intent::EStop)
}
