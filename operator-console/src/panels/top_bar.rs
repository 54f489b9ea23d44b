//! Always in sight, in one line: which robot, how its link is, how long ago it was heard, who drives, and the stop.

mod layout;

use eframe::egui::accesskit::Role;
use eframe::egui::{
    Align, Button, Color32, Label, Layout, RichText, Separator, Stroke, TextStyle, Ui, WidgetInfo,
    vec2,
};
use measurement::time::Monotonic;

use super::connection::{
    ConnectionData, FAILED, LinkStatus, SHORT_MAP_STATES, SHORT_RECORDING_MAP_STATES,
};
use super::driving::{DrivingData, EStopButton, disabled_ui};
use super::elide::elided;
use super::formatting::age;
use super::robots::{alerts, swatch_ui};
use crate::command::Command;
use crate::model::{ConsoleModel, LinkState};
use crate::teleop_client::{Intent, TeleopClientState};
use crate::theme::{self, Tone, short_state_ui, state_ui};

use layout::{Wanted, Widths};

const NO_ALERTS: &str = "No alerts";
const FEW_ALERTS: &str = "9 alerts";
/// Size of marks and words, points.
const SIZE: f32 = 15.0;
/// A line between two parts, points.
const LINE: f32 = 6.0;
/// What the link of a robot may be; what a recording is.
const LINKS: [&str; 4] = ["Live", "Silent", "Waiting", "Ended"];
const RECORDINGS: [&str; 3] = ["Recording", "Opening", FAILED];
/// Ages of what is not very old are not longer, and where there is little room.
const AGES: [&str; 2] = ["< 0.2 s ago", "< 0.2 s"];
/// Bars that are narrower leave out what can be missed, points.
const NARROW: f32 = 520.0;
/// Those that are narrower still tell of alerts by their number alone, which is not longer.
const NARROWEST: f32 = 400.0;
const SHORT_ALERTS: &str = "88";

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
    /// The same in a word or two.
    pub map_short: &'static str,
    /// Who drives; none where nobody can.
    pub driver: Option<String>,
    /// The stop, where there is something to stop.
    pub estop: Option<EStopButton>,
}

impl TopBarData {
    /// The robot at `now`.
    pub fn new(
        model: &ConsoleModel,
        link: &LinkStatus,
        teleop_client: Option<&TeleopClientState>,
        color: Option<Color32>,
        now: Monotonic,
    ) -> Self {
        let connection = ConnectionData::new(model, link, now);
        let driving =
            teleop_client.and_then(|teleop_client| DrivingData::new(model, teleop_client, now));
        let is_recording = link.recording.is_some();
        let is_live = model.connection().state(now) == LinkState::Live;
        let has_ended = model.reports_ended();
        let says_nothing = is_recording || (is_live && has_ended);
        let old = model.connection().age(now).filter(|_| !says_nothing);
        // A live robot was heard some milliseconds ago: figures that flicker say less than this.
        let age = old.map(|old| match model.connection().state(now) {
            LinkState::Live if old.as_millis() < 200 => "< 0.2 s ago".to_owned(),
            LinkState::Live | LinkState::Silent | LinkState::Waiting => {
                format!("{} ago", age(old))
            }
        });
        Self {
            name: link.name_of(model.robot()),
            color,
            link: (connection.tone, connection.state),
            age,
            map: (connection.map_tone, connection.map),
            map_short: connection.map_short,
            driver: driving.as_ref().map(|driving| driving.driver.clone()),
            // A stop that is on its way is seen before anything is heard of the robot.
            estop: driving
                .map(|driving| driving.estop)
                .or_else(|| teleop_client.and_then(EStopButton::underway)),
        }
    }
}

/// Draws the robot's part of the bar, from the left.
pub fn robot_bar_ui(ui: &mut Ui, data: &TopBarData) {
    if let Some(color) = data.color {
        swatch_ui(ui, color);
    }
    let gap = ui.spacing().item_spacing.x;
    let mark = 0.8 * SIZE + gap;
    let line = LINE + gap;
    let (links, maps): (&[_], &[_]) = if RECORDINGS.contains(&&*data.link.1) {
        (&RECORDINGS, &SHORT_RECORDING_MAP_STATES)
    } else {
        (&LINKS, &SHORT_MAP_STATES)
    };
    let wanted = Wanted {
        name: width(ui, &data.name),
        link: mark + widest(ui, links),
        ages: data
            .age
            .as_ref()
            .map(|_| AGES.map(|age| gap + width(ui, age))),
        driver: data
            .driver
            .as_ref()
            .map_or(0.0, |driver| line + gap + width(ui, driver)),
        map: mark + widest(ui, maps),
        mark,
        // With the gap after what is before it.
        before_map: gap + line,
        gaps: gap,
    };
    let room = Widths::new(ui.available_width(), wanted);
    name_ui(ui, &data.name, room.name);
    link_ui(ui, &data.link, room.has_link_words.then_some(wanted.link));
    if let Some((age, (room, is_long))) = data.age.as_ref().zip(room.age) {
        let words = if is_long {
            age
        } else {
            age.trim_end_matches(" ago")
        };
        slot_ui(ui, room - gap, |ui| {
            let label = ui.label(words);
            label.widget_info(|| WidgetInfo::labeled(Role::Label, true, age));
            label.on_hover_text("Since the newest message of the robot");
        });
    }
    if let Some(driver) = &data.driver {
        line_ui(ui);
        ui.add(Label::new(driver).truncate());
    }
    if room.has_map {
        line_ui(ui);
        map_ui(ui, data, mark);
    }
}

/// How the link is, in so much room; without any, by its mark alone: who asks for the word, or hears it, has it.
fn link_ui(ui: &mut Ui, (tone, link): &(Tone, String), room: Option<f32>) {
    if let Some(room) = room {
        slot_ui(ui, room, |ui| state_ui(ui, *tone, link, SIZE));
        return;
    }
    let label = short_state_ui(ui, *tone, "", SIZE);
    label.widget_info(|| WidgetInfo::labeled(Role::Label, true, link));
    label.on_hover_text(link);
}

/// How the map is, in as many words as there is room for beside a mark so wide, or by that alone; who asks for them, or hears
/// them, has all.
fn map_ui(ui: &mut Ui, data: &TopBarData, mark: f32) {
    let (tone, map) = &data.map;
    let short = data.map_short;
    let (all, told): (&[&str], &str) = match tone {
        // It may have been so a moment ago: words that come and go say no more.
        Tone::Good => (&[short], short),
        Tone::Waiting | Tone::Warning => (&[map, short], map),
    };
    let room = ui.available_width() - mark;
    let mut fitting = all.iter().filter(|words| width(ui, words) <= room);
    let shown = fitting.next().copied().unwrap_or_default();
    let label = short_state_ui(ui, *tone, shown, SIZE);
    label.widget_info(|| WidgetInfo::labeled(Role::Label, true, told));
    label.on_hover_text(map);
}

fn width(ui: &Ui, words: &str) -> f32 {
    let font = TextStyle::Body.resolve(ui.style());
    let galley = ui
        .painter()
        .layout_no_wrap(words.to_owned(), font, Color32::BLACK);
    galley.size().x.ceil()
}

fn widest(ui: &Ui, all: &[&str]) -> f32 {
    let widths = all.iter().map(|words| width(ui, words));
    widths.fold(0.0, f32::max)
}

fn line_ui(ui: &mut Ui) {
    ui.add(Separator::default().spacing(LINE));
}

/// A part that is so wide whatever is in it.
fn slot_ui(ui: &mut Ui, width: f32, add: impl FnOnce(&mut Ui)) {
    let size = vec2(width, ui.available_height());
    let layout = Layout::left_to_right(Align::Center);
    ui.allocate_ui_with_layout(size, layout, |ui| {
        ui.set_min_width(width);
        add(ui);
    });
}

/// The name, or its beginning and its end; who asks for it, or hears it, has the whole.
fn name_ui(ui: &mut Ui, name: &str, room: f32) {
    let shown = elided(name, |name| width(ui, name) <= room);
    let label = ui.add(Label::new(RichText::new(&shown).strong()).extend());
    label.widget_info(|| WidgetInfo::labeled(Role::Label, true, name));
    label.on_hover_text(name);
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
        let is_narrow = ui.available_width() < NARROW;
        let is_narrowest = ui.available_width() < NARROWEST;
        let told = match unseen {
            0 => NO_ALERTS.to_owned(),
            n => alerts(n),
        };
        let words = if is_narrowest {
            unseen.to_string()
        } else {
            told.clone()
        };
        let [fill, ink] = theme::BANNER;
        let text = RichText::new(words);
        let button = if unseen > 0 {
            Button::new(text.strong().color(ink)).fill(fill)
        } else {
            Button::new(text).frame(false)
        };
        // As wide with alerts as without: what is beside it stays.
        let widest = match (is_narrowest, is_narrow) {
            (true, _) => SHORT_ALERTS,
            (false, true) => FEW_ALERTS,
            (false, false) => NO_ALERTS,
        };
        let room = width(ui, widest) + 2.0 * ui.spacing().button_padding.x;
        // Where there is little room, that there is none is not said.
        if unseen > 0 || !is_narrow {
            let button = ui.add(button.min_size(vec2(room, 0.0)));
            button.widget_info(|| WidgetInfo::labeled(Role::Button, true, &told));
            let hint = match unseen {
                0 => "Show the alerts, of all robots that were shown".to_owned(),
                _ => format!("{told}. Show the alerts, of all robots that were shown"),
            };
            asked.shows_alerts = button.on_hover_text(hint).clicked();
        } else {
            ui.add_space(room + ui.spacing().item_spacing.x);
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
fn stop_ui(ui: &mut Ui, face: &EStopButton) -> Option<Intent> {
    let size = vec2(96.0, 28.0);
    let [danger, on_danger] = theme::DANGER;
    let [banner, on_banner] = theme::BANNER;
    let refused;
    let (words, fill, ink, hint) = match face {
        EStopButton::Ready => (
            "Stop",
            danger,
            on_danger,
            "Emergency stop: stops at once, and stays stopped until it is reset (Space)",
        ),
        EStopButton::Refused(why) => {
            refused = format!("The robot does not stop for you: {why}. Press again if you like");
            ("Refused", banner, on_banner, &*refused)
        }
        EStopButton::ReadOnly => {
            disabled_ui(ui, "Stop", size);
            return None;
        }
        EStopButton::Sending(_) => (
            "Stopping…",
            banner,
            on_banner,
            "The emergency stop is being sent and is not acknowledged; press again if you like",
        ),
        EStopButton::InForce { .. } => (
            "Stopped",
            on_danger,
            danger,
            "An emergency stop is active; it is reset in the driving panel",
        ),
    };
    let text = RichText::new(words).strong().color(ink);
    let button = Button::new(text)
        .fill(fill)
        .stroke(Stroke::new(1.5, danger))
        .min_size(size);
    // Pressing again what is in force does no harm, and is what one does.
    ui.add(button)
        .on_hover_text(hint)
        .clicked()
        .then_some(Intent::EStop)
}

#[cfg(test)]
mod tests;
