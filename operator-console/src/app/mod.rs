//! The application: finds robots, shows one, executes the operator's commands.

mod choice;
mod commands;
mod desktop;
mod dialogs;
mod export_job;
mod menus;
mod robot_overlay;
mod screen;
mod screenshot;
mod session_monitor;

use std::path::PathBuf;
use std::rc::Rc;
use std::time::Duration;

use edge::replay_control::ReplayState;
use eframe::egui::{Context, Frame, Margin, Panel, Ui, Visuals};
use measurement::time::Monotonic;
use network::clock::{self, seconds_since_1970};
use network::credentials::Credentials;
use network::endpoints::check_console;
use protocol::keys::RobotId;
use protocol::tile::BootId;

use crate::alerts::{AlertSource, FleetAlerts};
use crate::command::Command;
use crate::event_log::{EventLog, Severity};
use crate::identity::Identity;
use crate::link::{Discovery, FoundRobot, RobotSession};
use crate::model::LinkState;
use crate::panels::addresses::{ListedAddress, listed};
use crate::panels::connection::LinkStatus;
use crate::panels::driving::labels;
use crate::panels::robots::{RobotEntry, RobotsData};
use crate::panels::timeline::{TimelineData, timeline_ui};
use crate::playback::{
    Failure, OpenDialog, Playback, PlaybackCommand, ToOpen, drop_hint_ui, is_recording,
};
use crate::settings::{Read, Settings, SettingsWriter, WindowPlace};
use crate::shortcuts::has_space_after_text;
use crate::teleop_handle::TeleopHandle;
use crate::teleop_input::InputEvent;
use crate::theme;
use crate::window::WindowSettings;

use choice::{RobotChoice, moved_to};
use commands::SourceKind;
use export_job::ExportJob;
use session_monitor::{LogNote, SessionMonitor};

pub use export_job::ExportProgress;
pub use screen::{Screen, ScreenContext, ShownRobot};
pub use screenshot::{Screenshot, ScreenshotOutcome, result_of};

/// Period at which settings are collected; they are written once a second at most.
const KEEP_PERIOD: Duration = Duration::from_millis(500);
const PLAYBACK_PERIOD: Duration = Duration::from_millis(50);
/// Memory for tiles, megabytes: 30,000 tiles, 30 km² at 0.5 m.
const STORE_MB: u32 = 256;

pub struct ConsoleApp {
    ctx: Context,
    zenoh_config: Option<PathBuf>,
    credentials: Option<Credentials>,
    session_id: BootId,
    discovery: Discovery,
    /// Addresses to search exclusively; empty if scouting.
    asked_alone: Vec<String>,
    choice: RobotChoice,
    recordings: Option<(FoundRobot, PathBuf)>,
    shown: Option<(FoundRobot, RobotSession)>,
    joined: Monotonic,
    problem: Option<String>,
    screen: Screen,
    screenshot: Option<Screenshot>,
    /// When a frame last showed all of the map.
    drawn: Monotonic,
    identity: Identity,
    teleop_handle: Rc<TeleopHandle>,
    settings: Settings,
    settings_writer: Option<SettingsWriter>,
    kept: Monotonic,
    log: EventLog,
    alerts: FleetAlerts,
    session_monitor: SessionMonitor,
    export: Option<ExportJob>,
    pictures: Vec<(PathBuf, ScreenshotOutcome)>,
    playback: Option<Playback>,
    to_open: Option<ToOpen>,
    open_dialog: OpenDialog,
}

impl ConsoleApp {
    pub fn new(
        ctx: &Context,
        window: WindowSettings,
        session_id: BootId,
        screenshot: Option<Screenshot>,
        teleop_handle: Rc<TeleopHandle>,
        Read {
            settings,
            complaint,
        }: Read,
        settings_writer: Option<SettingsWriter>,
    ) -> Self {
        let waking = ctx.clone();
        // With addresses on the command line only those are searched.
        let scouts = window.connect.is_empty();
        let has_keys = window.credentials.is_some();
        let addresses = if scouts {
            let mut remembered = settings.addresses.clone();
            remembered.retain(|address| check_console(address, has_keys).is_ok());
            remembered
        } else {
            window.connect
        };
        let is_told_where = !scouts && window.demo.is_none();
        let asked_alone = if is_told_where {
            addresses.clone()
        } else {
            Vec::new()
        };
        let demo = window.robot.clone().zip(addresses.first().cloned());
        let demo = demo.map(|(robot, endpoint)| FoundRobot { robot, endpoint });
        let recordings = demo.zip(window.recordings);
        let discovery = Discovery::start(
            addresses,
            scouts,
            window.zenoh_config.clone(),
            window.credentials.clone(),
            move || {
                waking.request_repaint();
            },
        );
        let mut log = EventLog::default();
        if let Some(complaint) = complaint {
            let (now, unix_s) = (clock::now(), seconds_since_1970());
            log.note(Severity::Warning, "settings", complaint, now, unix_s);
        }
        let mut app = Self {
            ctx: ctx.clone(),
            zenoh_config: window.zenoh_config,
            credentials: window.credentials,
            session_id,
            discovery,
            asked_alone,
            recordings,
            choice: RobotChoice::new(window.robot, window.demo),
            shown: None,
            joined: Monotonic::default(),
            problem: None,
            screen: Screen::of(&settings),
            screenshot,
            drawn: Monotonic::default(),
            identity: window.identity,
            teleop_handle,
            settings,
            settings_writer,
            kept: Monotonic::default(),
            log,
            alerts: FleetAlerts::default(),
            session_monitor: SessionMonitor::default(),
            export: None,
            pictures: Vec::new(),
            playback: None,
            to_open: window.open,
            open_dialog: OpenDialog::default(),
        };
        if let Some(ToOpen { path, rate, .. }) = app.to_open.clone() {
            app.open_recording(&path, rate);
        }
        app
    }
}

impl eframe::App for ConsoleApp {
    fn logic(&mut self, ctx: &Context, _frame: &mut eframe::Frame) {
        let now = clock::now();
        if self.shown.is_none() {
            let mut found = self.discovery.found();
            found.retain(|found| !is_recording(&found.robot));
            if let Some(found) = self.choice.choose(&found, now).cloned() {
                self.connect(found, SourceKind::Robot);
            } else if let Some(rest) = self.choice.look_again_after(now) {
                ctx.request_repaint_after(rest);
            }
        }
        if let Some(found) = self.moved(now) {
            let FoundRobot { robot, endpoint } = &found;
            let text = format!("{robot} answers at {endpoint} now, and is joined there");
            self.connect(found, SourceKind::Robot);
            self.note(Severity::Info, "link", text);
        }
        self.poll_background_state(now);
        if now.since(self.kept) >= KEEP_PERIOD {
            self.kept = now;
            self.keep();
        }
        if self.settings_writer.is_some() {
            // Collects changes of the last frame even without further events.
            ctx.request_repaint_after(3 * KEEP_PERIOD);
        }
        if let Some(screenshot) = &mut self.screenshot {
            let map_view = self.screen.map_view_mut();
            map_view.hurry_checks(screenshot.is_due(now));
            screenshot.step(ctx, self.drawn, now);
        }
    }

    /// Panels use this background and are not filled again.
    fn clear_color(&self, visuals: &Visuals) -> [f32; 4] {
        visuals.panel_fill.to_normalized_gamma_f32()
    }

    fn ui(&mut self, ui: &mut Ui, _frame: &mut eframe::Frame) {
        let now = clock::now();
        let has_late_space = ui.input(|input| has_space_after_text(&input.events));
        self.screen.begin_frame(ui.ctx());
        drop_hint_ui(ui.ctx());
        let dropped_or_typed = self.open_dialog.show(ui.ctx()).map(Command::Open);
        let wound = self
            .playback
            .as_mut()
            .and_then(|playback| playback_ui(ui, playback));
        let seen = self.seen();
        let problem = self.problem.clone().or_else(|| self.discovery.problem());
        let export = self.export.as_ref().map(ExportJob::progress);
        let current = self.shown.as_ref().filter(|_| self.playback.is_none());
        let current = current.map(|(found, session)| {
            let link = session.model().connection().state(now);
            (&found.robot, link)
        });
        let mut robots = RobotsData::new(&seen, current, self.choice.sought(), problem, now);
        if !self.asked_alone.is_empty() {
            robots.set_search_addresses(&self.asked_alone);
        }
        robots.set_denied_by(&self.discovery.access_denied());
        robots.has_keys = self.credentials.is_some();
        robots.addresses = self.listed_addresses();
        let context = ScreenContext {
            robots: &robots,
            log: &self.log,
            alerts: &self.alerts,
            export: export.as_ref(),
        };
        let commands = match &self.shown {
            Some((found, session)) => {
                let link = LinkStatus {
                    is_connected: session.is_connected(),
                    problem: session.problem(),
                    recording: self.playback.as_ref().map(Playback::file_name),
                    failure: self.playback.as_mut().and_then(|playback| {
                        playback.failure().map(|failure| failure.text.clone())
                    }),
                    transport: session.transport(),
                    recordings: self
                        .recordings
                        .as_ref()
                        // A robot of another computer may have the same name.
                        .filter(|(robot, _)| robot == found)
                        .map(|(_, folder)| folder.clone()),
                };
                let mut model = session.model();
                if let Some(playback) = &mut self.playback {
                    playback.show_trail(&mut model);
                }
                if let Some(info) = model.info() {
                    self.teleop_handle.set_robot_info(info);
                }
                let teleop_client = self.teleop_handle.state(now);
                let robot = Some(ShownRobot {
                    model: &mut model,
                    link: &link,
                    teleop_client: teleop_client.as_ref(),
                    color: match &self.playback {
                        // Recordings get no colour of their own.
                        Some(_) => theme::VEHICLE,
                        None => self.settings.robots.of(&found.robot),
                    },
                });
                let commands = self.screen.show(ui, context, robot, now);
                let map_view = self.screen.map_view();
                let rectangle_m = map_view.visible_m().map(|edge_m| edge_m as f32);
                model.set_view(rectangle_m, map_view.shown_layers());
                commands
            }
            None => self.screen.show(ui, context, None, now),
        };
        if self.shown.is_none() || self.screen.map_view().is_up_to_date() {
            self.drawn = now;
        }
        let is_typing = self.screen.is_typing(ui.ctx());
        if has_late_space && !is_typing {
            self.teleop_handle.apply(InputEvent::EStop);
        }
        self.teleop_handle.apply(InputEvent::Typing(is_typing));
        let of_recordings = wound
            .map(Command::Playback)
            .into_iter()
            .chain(dropped_or_typed);
        for command in commands.into_iter().chain(of_recordings) {
            self.execute(command);
        }
    }

    fn on_exit(&mut self, _gl: Option<&eframe::glow::Context>) {
        self.keep();
        // Dropping it waits until the settings are written.
        self.settings_writer = None;
        for (_, outcome) in self.pictures.drain(..) {
            drop(screenshot::result_of(&outcome));
        }
    }
}

impl ConsoleApp {
    pub const fn event_log(&self) -> &EventLog {
        &self.log
    }

    fn note(&mut self, severity: Severity, kind: &str, text: impl Into<String>) {
        let (now, unix_s) = (clock::now(), seconds_since_1970());
        self.log.note(severity, kind, text, now, unix_s);
    }

    fn poll_background_state(&mut self, now: Monotonic) {
        let mut notes = Vec::new();
        if let Some(repairs) = self.screen.map_view_mut().take_repairs(now) {
            let text = format!(
                "A part of the map was not drawn as received, and was drawn again ({repairs} times so far)"
            );
            notes.push((Severity::Warning, "map", text));
        }
        if let Some((_, session)) = &self.shown {
            let model = session.model();
            let recording = self.playback.as_ref().map(Playback::file_name);
            let source = match &recording {
                Some(_) => AlertSource::Recording,
                None => AlertSource::Robot,
            };
            let name = recording.unwrap_or_else(|| model.robot().to_string());
            let new_events = self
                .log
                .add_robot_events(&model, &name, now, seconds_since_1970());
            let alerts = self.alerts.shown_mut();
            let begun = alerts.map(|alerts| alerts.update(&model, source, &new_events, now));
            for (_alarm, text) in begun.into_iter().flatten() {
                notes.push((Severity::Alarm, "alert", format!("{name}: {text}")));
            }
            // The link to a recording is internal.
            if self.playback.is_none() {
                notes.extend(
                    self.session_monitor
                        .update(&model, session.transport(), now),
                );
            }
        }
        let discovered_robots = self.discovery.discovered_robots();
        for text in self.alerts.update_background(&discovered_robots, now) {
            notes.push((Severity::Alarm, "alert", text));
        }
        if let Some(why) = self.choice.take_end() {
            let text = format!("The demo has ended: {why}");
            notes.push((Severity::Alarm, "demo", text));
        }
        if let Some(playback) = &mut self.playback {
            let name = playback.file_name();
            for damage in playback.take_new_damage() {
                notes.push((
                    Severity::Warning,
                    "recording",
                    format!("{name} is {damage}"),
                ));
            }
            if let Some(Failure { text, choices }) = playback.take_failure() {
                notes.push(if choices.is_empty() {
                    let text = format!("{name} cannot be shown: {text}");
                    (Severity::Alarm, "recording", text)
                } else {
                    let text = format!("{name} needs a choice: {text}");
                    (Severity::Info, "recording", text)
                });
            }
        }
        notes.extend(self.teleop_notes());
        if let Some(export) = &mut self.export
            && let Some(end) = export.take_end()
        {
            notes.push(end.note);
            if let Some(folder) = end.folder.filter(|_| desktop::has_desktop())
                && let Err(why) = desktop::open_folder(&folder)
            {
                export.not_opened(&folder, &why);
                notes.push((Severity::Info, "folder", why));
            }
        }
        self.pictures.retain(|(path, outcome)| {
            let Some(outcome) = screenshot::take_result(outcome) else {
                return true;
            };
            notes.push(match outcome {
                Ok(()) => (
                    Severity::Info,
                    "screenshot",
                    format!("Saved as {}", path.display()),
                ),
                Err(why) => (Severity::Warning, "screenshot", format!("{why:#}")),
            });
            false
        });
        if let Some(problem) = self
            .settings_writer
            .as_ref()
            .and_then(SettingsWriter::take_problem)
        {
            notes.push((Severity::Warning, "settings", problem));
        }
        for (severity, kind, text) in notes {
            self.note(severity, kind, text);
        }
    }

    fn teleop_notes(&self) -> impl Iterator<Item = LogNote> + use<> {
        let notes = self.teleop_handle.take_notifications().into_iter();
        notes.filter_map(|note| {
            let (text, is_failure) = labels::note(&note);
            is_failure.then_some((Severity::Warning, "driving", text))
        })
    }

    fn keep(&mut self) {
        let Some(settings_writer) = &mut self.settings_writer else {
            return;
        };
        self.screen.keep(&mut self.settings);
        if let Some(place) = window_place(&self.ctx) {
            self.settings.window = Some(place);
        }
        settings_writer.save(self.settings.clone());
    }

    fn moved(&self, now: Monotonic) -> Option<FoundRobot> {
        let (shown, session) = self.shown.as_ref().filter(|_| self.playback.is_none())?;
        let model = session.model();
        let link = model.connection();
        if link.state(now) == LinkState::Live {
            return None;
        }
        // A new link needs time even if the robot was silent long before.
        let joined = now.since(self.joined);
        let silent = link.age(now).map_or(joined, |age| age.min(joined));
        moved_to(shown, silent, &self.discovery.discovered_robots(), now)
    }

    fn listed_addresses(&self) -> Vec<ListedAddress> {
        let has_keys = self.credentials.is_some();
        let remembered = self.settings.addresses.iter();
        let remembered = remembered.filter(|address| check_console(address, has_keys).is_ok());
        listed(
            &self.asked_alone,
            remembered,
            &self.discovery.asked(),
            &self.discovery.found(),
        )
    }

    fn seen(&mut self) -> Vec<RobotEntry> {
        self.update_discovery();
        let shown = self.shown.as_ref().filter(|_| self.playback.is_none());
        let moved = shown.and_then(|(found, session)| {
            let uncommanded_motion = session.model().uncommanded_motion(clock::now())?;
            Some((found.robot.clone(), uncommanded_motion))
        });
        let uncommanded_motion = |robot: &RobotId| {
            let moved = moved.as_ref().filter(|(moved, _)| moved == robot);
            moved.map(|(_, uncommanded_motion)| *uncommanded_motion)
        };
        let discovered_robots = self.discovery.discovered_robots();
        discovered_robots
            .into_iter()
            .filter(|discovered| !is_recording(&discovered.found.robot))
            .map(|discovered| RobotEntry {
                color: self.settings.robots.of(&discovered.found.robot),
                alerts: self.alerts.unacknowledged_of(&discovered.found.robot),
                uncommanded_motion: uncommanded_motion(&discovered.found.robot),
                discovered,
            })
            .collect()
    }
}

/// Position of the window in the system's points; `None` if unknown.
fn window_place(ctx: &Context) -> Option<WindowPlace> {
    let scale = ctx.zoom_factor();
    let place = ctx.input(|input| {
        let window = input.viewport();
        let size = window.inner_rect?.size() * scale;
        let corner = window.outer_rect.map(|outer| outer.min * scale);
        Some(WindowPlace {
            size: size.round().into(),
            corner: corner.map(|corner| corner.round().into()),
            is_maximized: window.maximized.unwrap_or(false),
        })
    })?;
    place.is_valid().then_some(place)
}

fn playback_ui(ui: &mut Ui, playback: &mut Playback) -> Option<PlaybackCommand> {
    let name = playback.file_name();
    let status = playback.status();
    playback.update_damage(&status);
    let data = TimelineData::new(&name, &status, playback.failure());
    if !matches!(status.state, ReplayState::Paused | ReplayState::Ended) || !status.is_settled {
        ui.ctx().request_repaint_after(PLAYBACK_PERIOD);
    }
    let frame = Frame::new().inner_margin(Margin::symmetric(12, 6));
    let panel = Panel::bottom("timeline").frame(frame).resizable(false);
    panel.show(ui, |ui| timeline_ui(ui, &data)).inner
}
