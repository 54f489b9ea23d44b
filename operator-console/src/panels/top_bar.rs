//! Top bar: robot, link, age of the last message, driver and stop.

use eframe::egui::accesskit::Role;
use eframe::egui::{
    Align, Button, Color32, Label, Layout, Response, RichText, Separator, Stroke, TextStyle, Ui,
    Vec2, WidgetInfo, vec2,
};
use measurement::time::Monotonic;

use super::connection::{
    ConnectionData, FAILED, LinkStatus, SHORT_MAP_STATES, SHORT_RECORDING_MAP_STATES,
};
use super::driving::{DrivingData, EStopButton};
use super::formatting::{age, elided};
use super::robots::{alerts, swatch_ui};
use crate::command::Command;
use crate::identity::OBSERVER_HINT;
use crate::model::{ConsoleModel, LinkState};
use crate::teleop_client::{Intent, TeleopClientState};
use crate::theme::{self, Tone, short_state_ui, state_ui};

const NO_ALERTS: &str = "No alerts";
const FEW_ALERTS: &str = "9 alerts";
const SIZE: f32 = 15.0;
const LINE: f32 = 6.0;
/// Possible texts of the link, for its width.
const LINKS: [&str; 4] = ["Live", "Silent", "Waiting", "Ended"];
const RECORDINGS: [&str; 3] = ["Recording", "Opening", FAILED];
/// Width of a usual age, long and short.
const AGES: [&str; 2] = ["< 0.2 s ago", "< 0.2 s"];
/// Below this width optional parts are omitted, points.
const NARROW: f32 = 520.0;
/// Below this width alerts are shown as a number, points.
const NARROWEST: f32 = 400.0;
const SHORT_ALERTS: &str = "88";
const ESTOP: &str = "EMERGENCY STOP";
/// Size of the emergency stop, and below this width of the bar, points.
const ESTOP_SIZE: [f32; 2] = [170.0, 32.0];
const NARROW_ESTOP_SIZE: [f32; 2] = [96.0, 32.0];
const ESTOP_NARROW: f32 = 640.0;

#[derive(Clone, Debug, PartialEq)]
pub struct TopBarData {
    pub name: String,
    pub color: Option<Color32>,
    pub link: (Tone, String),
    /// Age of the newest message. `None` before the first, for recordings, and after the end of the data.
    pub age: Option<String>,
    pub map: (Tone, String),
    pub map_short: &'static str,
    pub driver: Option<String>,
    pub estop: Option<EStopButton>,
}

impl TopBarData {
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
        // Small ages would flicker.
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
            // A stop can be pressed before the robot has answered.
            estop: driving
                .map(|driving| driving.estop)
                .or_else(|| teleop_client.and_then(EStopButton::underway)),
        }
    }
}

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

/// Link state as text, or as a mark with hover text if there is no width.
fn link_ui(ui: &mut Ui, (tone, link): &(Tone, String), room: Option<f32>) {
    if let Some(room) = room {
        slot_ui(ui, room, |ui| state_ui(ui, *tone, link, SIZE));
        return;
    }
    let label = short_state_ui(ui, *tone, "", SIZE);
    label.widget_info(|| WidgetInfo::labeled(Role::Label, true, link));
    label.on_hover_text(link);
}

/// Map state as the longest text that fits, or as a mark with hover text.
fn map_ui(ui: &mut Ui, data: &TopBarData, mark: f32) {
    let (tone, map) = &data.map;
    let short = data.map_short;
    let (all, reported): (&[&str], &str) = match tone {
        // Short texts only, so that brief changes do not flicker.
        Tone::Good => (&[short], short),
        Tone::Waiting | Tone::Warning => (&[map, short], map),
    };
    let room = ui.available_width() - mark;
    let mut fitting = all.iter().filter(|words| width(ui, words) <= room);
    let shown = fitting.next().copied().unwrap_or_default();
    let label = short_state_ui(ui, *tone, shown, SIZE);
    label.widget_info(|| WidgetInfo::labeled(Role::Label, true, reported));
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

fn slot_ui(ui: &mut Ui, width: f32, add: impl FnOnce(&mut Ui)) {
    let size = vec2(width, ui.available_height());
    let layout = Layout::left_to_right(Align::Center);
    ui.allocate_ui_with_layout(size, layout, |ui| {
        ui.set_min_width(width);
        add(ui);
    });
}

fn name_ui(ui: &mut Ui, name: &str, room: f32) {
    let shown = elided(name, |name| width(ui, name) <= room);
    let label = ui.add(Label::new(RichText::new(&shown).strong()).extend());
    label.widget_info(|| WidgetInfo::labeled(Role::Label, true, name));
    label.on_hover_text(name);
}

/// Draws stop and alerts from the right, and `middle` in the rest.
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
        let reported = match unseen {
            0 => NO_ALERTS.to_owned(),
            n => alerts(n),
        };
        let words = if is_narrowest {
            unseen.to_string()
        } else {
            reported.clone()
        };
        let [fill, ink] = theme::BANNER;
        let text = RichText::new(words);
        let button = if unseen > 0 {
            Button::new(text.strong().color(ink)).fill(fill)
        } else {
            Button::new(text).frame(false)
        };
        // The same width with and without alerts.
        let widest = match (is_narrowest, is_narrow) {
            (true, _) => SHORT_ALERTS,
            (false, true) => FEW_ALERTS,
            (false, false) => NO_ALERTS,
        };
        let room = width(ui, widest) + 2.0 * ui.spacing().button_padding.x;
        // "No alerts" is omitted if there is little space.
        if unseen > 0 || !is_narrow {
            let button = ui.add(button.min_size(vec2(room, 0.0)));
            button.widget_info(|| WidgetInfo::labeled(Role::Button, true, &reported));
            let hint = match unseen {
                0 => "Show the alerts, of all robots that were shown".to_owned(),
                _ => format!("{reported}. Show the alerts, of all robots that were shown"),
            };
            asked.shows_alerts = button.on_hover_text(hint).clicked();
        } else {
            ui.add_space(room + ui.spacing().item_spacing.x);
        }
        ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
            ui.set_clip_rect(ui.max_rect().intersect(ui.clip_rect()));
            middle(ui);
        });
    });
    asked
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct RightBar {
    pub command: Option<Command>,
    pub shows_alerts: bool,
}

fn stop_ui(ui: &mut Ui, face: &EStopButton) -> Option<Intent> {
    let is_narrow = ui.available_width() < ESTOP_NARROW;
    let size = if is_narrow {
        NARROW_ESTOP_SIZE
    } else {
        ESTOP_SIZE
    };
    let size = Vec2::from(size);
    let [danger, on_danger] = theme::DANGER;
    let [banner, on_banner] = theme::BANNER;
    let refused;
    let (words, fill, ink, hint) = match face {
        EStopButton::Ready => (
            ESTOP,
            danger,
            on_danger,
            "Stops at once, and stays stopped until it is reset (Space)",
        ),
        EStopButton::Refused(why) => {
            refused = format!("The robot does not stop for you: {why}. Press again if you like");
            ("Refused", banner, on_banner, &*refused)
        }
        EStopButton::ReadOnly => {
            observer_stop_ui(ui, size, is_narrow);
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
    let button = Button::new(estop_text(words, is_narrow).color(ink))
        .fill(fill)
        .stroke(Stroke::new(1.5, danger))
        .min_size(size);
    let button = estop_button_ui(ui, |ui| ui.add(button));
    button.widget_info(|| WidgetInfo::labeled(Role::Button, true, words));
    // Pressing again is allowed.
    button
        .on_hover_text(hint)
        .clicked()
        .then_some(Intent::EStop)
}

/// In two lines in a narrow bar.
fn estop_text(words: &str, is_narrow: bool) -> RichText {
    if is_narrow && words == ESTOP {
        RichText::new("EMERGENCY\nSTOP").strong().size(11.0)
    } else {
        RichText::new(words).strong()
    }
}

/// Without vertical padding, so that two lines are not higher than the bar.
fn estop_button_ui(ui: &mut Ui, add: impl FnOnce(&mut Ui) -> Response) -> Response {
    let shown = ui.scope(|ui| {
        ui.spacing_mut().button_padding.y = 0.0;
        add(ui)
    });
    shown.inner
}

fn observer_stop_ui(ui: &mut Ui, size: Vec2, is_narrow: bool) {
    let button = Button::new(estop_text(ESTOP, is_narrow)).min_size(size);
    let name = format!("{ESTOP}. {OBSERVER_HINT}");
    let shown = estop_button_ui(ui, |ui| ui.add_enabled(false, button));
    shown.widget_info(|| WidgetInfo::labeled(Role::Button, false, &name));
    shown.on_disabled_hover_text(OBSERVER_HINT);
}

/// Minimum width of a long name, points.
const LEAST_NAME: f32 = 64.0;
/// Longer names are shortened to this width, or to this share of a wide bar, points.
const NAME: f32 = 220.0;
const NAME_SHARE: f32 = 0.4;

/// Requested widths of the parts and gaps, points.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Wanted {
    name: f32,
    link: f32,
    /// Long and short text with the gap before it; `None` if there is no age.
    ages: Option<[f32; 2]>,
    /// Including its separator; 0 if the robot cannot be driven.
    driver: f32,
    /// Of a synchronized map.
    map: f32,
    mark: f32,
    before_map: f32,
    gaps: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Widths {
    name: f32,
    has_link_words: bool,
    /// Width of the age, and whether it is the long text.
    age: Option<(f32, bool)>,
    has_map: bool,
}

impl Widths {
    /// Priority: driver, link state, data age, map, robot name. Changing values do not move the layout.
    fn new(available: f32, wanted: Wanted) -> Self {
        let Wanted {
            name,
            link,
            ages,
            driver,
            map,
            mark,
            before_map,
            gaps,
        } = wanted;
        let name = name.min(NAME.max(NAME_SHARE * available));
        let [long, short] = [true, false]
            .map(|is_long| ages.map(|[long, short]| (if is_long { long } else { short }, is_long)));
        // Widths of link, age and map, in order of preference.
        let kinds = [
            (link, long, Some(map)),
            (link, short, Some(map)),
            (link, None, Some(map)),
            (link, None, Some(mark)),
            (mark, None, Some(mark)),
            (mark, None, None),
        ];
        let free = |(link, age, map): (f32, Option<(f32, bool)>, Option<f32>)| {
            let age = age.map_or(0.0, |(age, _)| age);
            let map = map.map_or(0.0, |map| before_map + map);
            available - link - age - driver - map - gaps
        };
        let [.., last] = kinds;
        let fits = |kind: &_| free(*kind) >= name.min(LEAST_NAME);
        let kind = kinds.into_iter().find(fits).unwrap_or(last);
        let (link_has, age, map) = kind;
        Self {
            // The driver is shortened if even the last choice is too wide.
            name: free(kind).max(LEAST_NAME).min(name).min(available.max(0.0)),
            has_link_words: link_has > mark,
            age,
            has_map: map.is_some(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use egui_kittest::Harness;
    use egui_kittest::kittest::{NodeT as _, Queryable as _};

    use super::*;
    use crate::teleop_client::EStopState;
    use crate::test_support::{at, console, idle_teleop_client};

    fn data() -> TopBarData {
        TopBarData {
            name: "scout-1".to_owned(),
            color: None,
            link: (Tone::Good, "Live".to_owned()),
            age: Some("< 0.2 s ago".to_owned()),
            map: (Tone::Good, "Synchronized".to_owned()),
            map_short: "Synchronized",
            driver: Some("Nobody drives".to_owned()),
            estop: Some(EStopButton::Ready),
        }
    }

    fn bar(width: f32, data: TopBarData, unseen: usize) -> Harness<'static> {
        let mut window = Harness::builder()
            .with_size(vec2(width, 44.0))
            .build_ui(move |ui| {
                ui.horizontal(|ui| {
                    _ = right_bar_ui(ui, Some(&data), unseen, |ui| robot_bar_ui(ui, &data));
                });
            });
        crate::theme::set(&window.ctx);
        window.run_steps(3);
        window
    }

    #[test]
    fn a_stop_is_shown_before_the_robot_answers() {
        let model = console("scout", &[]);
        assert!(model.status().is_none());
        let mut teleop_client = idle_teleop_client();
        let estop = |teleop_client: &TeleopClientState| {
            let link = LinkStatus::default();
            TopBarData::new(&model, &link, Some(teleop_client), None, at(0)).estop
        };
        assert_eq!(estop(&teleop_client), None);
        teleop_client.estop = EStopState::Unsendable(Duration::from_secs(3));
        let words = "Not sent for 3.0 s: no robot connected".to_owned();
        assert_eq!(estop(&teleop_client), Some(EStopButton::Sending(words)));
    }

    #[test]
    fn a_press_stops_in_every_state_and_width() {
        let states = [
            (EStopButton::Ready, ESTOP),
            (EStopButton::Sending(String::new()), "Stopping…"),
            (EStopButton::Refused("no".to_owned()), "Refused"),
        ];
        for (width, size) in [
            (446.0, NARROW_ESTOP_SIZE),
            (639.0, NARROW_ESTOP_SIZE),
            (900.0, ESTOP_SIZE),
        ] {
            for (estop, label) in states.clone() {
                let estop = Some(estop);
                let data = TopBarData { estop, ..data() };
                let mut window = Harness::builder()
                    .with_size(vec2(width, 44.0))
                    .build_ui_state(
                        move |ui, pressed: &mut Option<Command>| {
                            ui.horizontal(|ui| {
                                let asked = right_bar_ui(ui, Some(&data), 0, |_| {});
                                *pressed = pressed.take().or(asked.command);
                            });
                        },
                        None,
                    );
                crate::theme::set(&window.ctx);
                window.run_steps(3);
                let button = window.get_by_label(label);
                assert_eq!(button.rect().size(), Vec2::from(size), "{width} {label}");
                button.click();
                window.run_steps(2);
                let stop = Some(Command::Drive(Intent::EStop));
                assert_eq!(*window.state(), stop, "{width} {label}");
            }
        }
    }

    #[test]
    fn an_observers_stop_is_disabled() {
        let estop = Some(EStopButton::ReadOnly);
        let window = bar(900.0, TopBarData { estop, ..data() }, 0);
        let stop =
            window.get_by_label("EMERGENCY STOP. Observers neither drive nor stop the vehicle");
        assert!(stop.accesskit_node().is_disabled());
        let usual = bar(900.0, data(), 0);
        let pressed = usual.get_by_label(ESTOP);
        assert!(!pressed.accesskit_node().is_disabled());
        assert_eq!(stop.rect(), pressed.rect());
    }

    #[test]
    fn a_refused_stop_looks_different() {
        let why = "the sender's role does not allow it".to_owned();
        let estop = Some(EStopButton::Refused(why));
        let mut window = bar(900.0, TopBarData { estop, ..data() }, 0);
        assert!(window.query_by_label(ESTOP).is_none());
        let refused = window.get_by_label("Refused");
        assert!(!refused.accesskit_node().is_disabled());
        let place = refused.rect();
        assert_eq!(place, bar(900.0, data(), 0).get_by_label(ESTOP).rect());
        window.hover_at(place.center());
        window.run_steps(60);
        let reported = "The robot does not stop for you: the sender's role does not allow it. Press again if you like";
        window.get_by_label(reported);
    }

    #[test]
    fn a_recently_synchronized_map_is_synchronized() {
        let map = (Tone::Good, "Synchronized 0.5 s ago".to_owned());
        let mut window = bar(900.0, TopBarData { map, ..data() }, 0);
        let place = window.get_by_label("Synchronized").rect();
        window.hover_at(place.center());
        window.run_steps(60);
        window.get_by_label("Synchronized 0.5 s ago");
    }

    #[test]
    fn nothing_is_cut_in_a_small_window() {
        let blue = Some(Color32::BLUE);
        for (name, color) in [
            ("two", None),
            ("demo", None),
            ("demo", blue),
            ("scout-1", blue),
        ] {
            let of = || TopBarData {
                name: name.to_owned(),
                color,
                ..data()
            };
            let wide = bar(1120.0, of(), 0);
            let whole = |label| wide.get_by_label(label).rect().width();
            for (width, unseen) in [446.0, 499.0, 563.0]
                .map(|width| [(width, 0), (width, 1)])
                .concat()
            {
                let window = bar(width, of(), unseen);
                let place = |label: &str| window.get_by_label(label).rect();
                let is_whole = |label| (place(label).width() - whole(label)).abs() < 0.5;
                assert!(is_whole(name), "{width} {name}: {}", place(name));
                assert!(is_whole("Nobody drives"), "{width} {name}");
                for label in ["Live", "Synchronized"] {
                    let is_mark = place(label).width() < 20.5;
                    assert!(is_whole(label) || is_mark, "{width}: {}", place(label));
                }
                let end = if unseen > 0 { "1 alert" } else { ESTOP };
                let parts = [name, "Live", "Nobody drives", "Synchronized", end].map(place);
                for pair in parts.windows(2) {
                    assert!(pair[0].right() < pair[1].left(), "{width} {name}: {pair:?}");
                }
            }
        }
    }

    #[test]
    fn a_short_link_state_has_hover_text() {
        let mut window = bar(
            446.0,
            TopBarData {
                driver: Some("You drive (annabelle-1)".to_owned()),
                link: (Tone::Warning, "Silent".to_owned()),
                ..data()
            },
            0,
        );
        let mark = window.get_by_label("Silent").rect();
        assert!(mark.width() < 20.5, "{mark}");
        window.hover_at(mark.center());
        window.run_steps(60);
        assert_eq!(window.get_all_by_label("Silent").count(), 2);
    }

    const WANTED: Wanted = Wanted {
        name: 450.0,
        link: 60.0,
        ages: Some([90.0, 60.0]),
        driver: 120.0,
        map: 65.0,
        mark: 20.0,
        before_map: 14.0,
        gaps: 26.0,
    };

    #[test]
    fn widths_by_priority() {
        let room = |available| {
            let room = Widths::new(available, WANTED);
            assert!(room.has_link_words && room.has_map, "{available}: {room:?}");
            (room.name, room.age)
        };
        let [long, short] = [Some((90.0, true)), Some((60.0, false))];
        assert_eq!(room(1200.0), (450.0, long));
        assert_eq!(room(1000.0), (400.0, long));
        assert_eq!(room(600.0), (225.0, long));
        assert_eq!(room(475.0), (100.0, long));
        assert_eq!(room(439.0), (LEAST_NAME, long));
        assert_eq!(room(438.0), (93.0, short));
        assert_eq!(room(409.0), (LEAST_NAME, short));
        assert_eq!(room(408.0), (123.0, None));
        assert_eq!(room(349.0), (LEAST_NAME, None));
        assert_eq!(room(348.0), (108.0, None));
        assert_eq!(room(304.0), (LEAST_NAME, None));
    }

    #[test]
    fn other_texts_shrink_before_a_short_name() {
        let room = |available, name| {
            let room = Widths::new(available, Wanted { name, ..WANTED });
            (room.name, room.has_link_words, room.has_map)
        };
        for (available, words, map) in [
            (349.0, true, true),
            (280.0, true, true),
            (279.0, false, true),
            (240.0, false, true),
            (239.0, false, false),
            (206.0, false, false),
            (150.0, false, false),
        ] {
            let expected = (40.0, words, map);
            assert_eq!(room(available, 40.0), expected, "{available}");
        }
        assert_eq!(room(303.0, 450.0), (103.0, false, true));
        assert_eq!(room(100.0, 450.0), (LEAST_NAME, false, false));
    }
}
