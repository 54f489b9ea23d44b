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
mod update;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::Duration;

use eframe::egui::{Context, Frame, Margin, Panel, Ui, Visuals};
use measurement::time::Monotonic;
use protocol::keys::RobotId;
use protocol::tile::BootId;
use robot_edge::clock::{self, seconds_since_1970};
use robot_edge::credentials::Credentials;
use robot_edge::network::endpoints::check_console;
use robot_edge::replay_control::ReplayState;

use crate::alerts::FleetAlerts;
use crate::command::Command;
use crate::event_log::{EventLog, Severity};
use crate::identity::Identity;
use crate::link::{Discovery, FoundRobot, RobotSession};
use crate::model::SavedSiteNames;
use crate::panels::connection::LinkStatus;
use crate::panels::robots::RobotsData;
use crate::panels::timeline::{TimelineData, timeline_ui};
use crate::playback::{OpenDialog, Playback, PlaybackCommand, ToOpen, drop_hint_ui, is_recording};
use crate::settings::{Settings, SettingsWriter};
use crate::shortcuts::has_space_after_text;
use crate::teleop_handle::TeleopHandle;
use crate::teleop_input::InputEvent;
use crate::theme;
use crate::window::WindowSettings;

use choice::RobotChoice;
use commands::SourceKind;
use export_job::ExportJob;
use session_monitor::SessionMonitor;

pub use export_job::ExportProgress;
pub use screen::{Screen, ScreenContext, ShownRobot};
pub use screenshot::{Screenshot, ScreenshotOutcome, result_of};

/// Period at which settings are collected; they are written once a second at most.
const KEEP_PERIOD: Duration = Duration::from_millis(500);
/// Refresh period of the position.
const PLAYBACK_PERIOD: Duration = Duration::from_millis(50);
/// Memory for tiles, megabytes: 30,000 tiles, 30 km² at 0.5 m.
const STORE_MB: u32 = 256;

pub struct AppSettings {
    pub window: WindowSettings,
    /// Random number of this run.
    pub session: BootId,
    pub screenshot: Option<Screenshot>,
    pub teleop_handle: Rc<TeleopHandle>,
    /// Settings of the last run.
    pub settings: Settings,
    /// `None` if settings are not saved.
    pub settings_writer: Option<SettingsWriter>,
    /// Why settings of the last run could not be used.
    pub complaint: Option<String>,
}

pub struct ConsoleApp {
    ctx: Context,
    zenoh_config: Option<PathBuf>,
    credentials: Option<Credentials>,
    session_id: BootId,
    discovery: Discovery,
    /// Addresses to search exclusively; empty if scouting.
    asked_alone: Vec<String>,
    choice: RobotChoice,
    /// The simulated robot, and the folder of its recordings.
    recordings: Option<(FoundRobot, PathBuf)>,
    shown: Option<(FoundRobot, RobotSession)>,
    joined: Monotonic,
    /// Why a robot cannot be shown.
    problem: Option<String>,
    screen: Screen,
    screenshot: Option<Screenshot>,
    identity: Identity,
    teleop_handle: Rc<TeleopHandle>,
    settings: Settings,
    settings_writer: Option<SettingsWriter>,
    kept: Monotonic,
    log: EventLog,
    alerts: FleetAlerts,
    /// Of robots that were shown before.
    site_names: BTreeMap<RobotId, SavedSiteNames>,
    session_monitor: SessionMonitor,
    export: Option<ExportJob>,
    /// Screenshots that are being saved.
    pictures: Vec<(PathBuf, ScreenshotOutcome)>,
    playback: Option<Playback>,
    /// The recording of the command line.
    to_open: Option<ToOpen>,
    open_dialog: OpenDialog,
}

impl ConsoleApp {
    pub fn new(ctx: &Context, settings: AppSettings) -> Self {
        let window = settings.window;
        let waking = ctx.clone();
        // With addresses on the command line only those are searched.
        let scouts = window.connect.is_empty();
        let has_keys = window.credentials.is_some();
        let addresses = if scouts {
            let mut remembered = settings.settings.addresses.clone();
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
        if let Some(complaint) = settings.complaint {
            let (now, unix_s) = (clock::now(), seconds_since_1970());
            log.note(Severity::Warning, "settings", complaint, now, unix_s);
        }
        let mut app = Self {
            ctx: ctx.clone(),
            zenoh_config: window.zenoh_config,
            credentials: window.credentials,
            session_id: settings.session,
            discovery,
            asked_alone,
            recordings,
            choice: RobotChoice::new(window.robot, window.demo),
            shown: None,
            joined: Monotonic::default(),
            problem: None,
            screen: Screen::of(&settings.settings),
            screenshot: settings.screenshot,
            identity: window.identity,
            teleop_handle: settings.teleop_handle,
            settings: settings.settings,
            settings_writer: settings.settings_writer,
            kept: Monotonic::default(),
            log,
            alerts: FleetAlerts::default(),
            site_names: BTreeMap::new(),
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
            screenshot.step(ctx, now);
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
                    failure: self
                        .playback
                        .as_mut()
                        .and_then(|playback| playback.failure().map(str::to_owned)),
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
    }
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
