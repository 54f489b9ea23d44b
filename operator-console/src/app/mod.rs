//! The program behind the window: finds robots, shows one, does what the operator asks.

mod choice;
mod commands;
mod desktop;
mod dialogs;
mod export_job;
mod first_run;
mod last_contact;
mod menus;
mod pictures;
mod robot_overlay;
mod screen;
mod screenshot;
mod session_change;
mod session_monitor;
mod timeline;
mod update;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::Duration;

use eframe::egui::{Context, Ui, Visuals};
use measurement::time::Monotonic;
use protocol::keys::RobotId;
use protocol::tile::BootId;
use robot_edge::clock::{self, seconds_since_1970};
use robot_edge::credentials::Credentials;
use robot_edge::link::endpoints::check_console;

use crate::alerts::FleetAlerts;
use crate::command::Command;
use crate::demo::DemoFailure;
use crate::event_log::{EventLog, Severity};
use crate::identity::Identity;
use crate::link::{Discovery, FoundRobot, RobotSession};
use crate::model::SavedSiteNames;
use crate::panels::connection::LinkStatus;
use crate::panels::robots::RobotsData;
use crate::playback::{OpenDialog, Playback, ToOpen, drop_hint_ui, is_recording};
use crate::settings::{Settings, SettingsWriter};
use crate::shortcuts::has_space_after_text;
use crate::teleop_handle::TeleopHandle;
use crate::teleop_input::InputEvent;
use crate::theme;

use choice::RobotChoice;
use commands::SourceKind;
use export_job::ExportJob;
use session_monitor::SessionMonitor;
use timeline::playback_ui;

pub use export_job::ExportProgress;
pub use screen::{Screen, ScreenContext, ShownRobot};
pub use screenshot::{Screenshot, ScreenshotOutcome, result_of};

/// What is to be kept is looked at this often; it is written once a second at most.
const KEEP_PERIOD: Duration = Duration::from_millis(500);
/// Memory for tiles, megabytes: 30,000 tiles, 30 km² at 0.5 m.
const STORE_MB: u32 = 256;

/// What the app is started with.
pub struct AppSettings {
    /// Addresses that are asked for robots besides scouting.
    pub connect: Vec<String>,
    /// The robot to show.
    pub robot: Option<RobotId>,
    /// Why that robot is gone, where this program simulates it.
    pub demo: Option<DemoFailure>,
    /// Where that robot's recordings are, where that is on this machine.
    pub recordings: Option<PathBuf>,
    /// A Zenoh configuration to lay ours over.
    pub zenoh_config: Option<PathBuf>,
    /// Who the operator is, where the link is secured.
    pub credentials: Option<Credentials>,
    /// This run of the console: random.
    pub session: BootId,
    /// A picture to take.
    pub screenshot: Option<Screenshot>,
    /// Who drives.
    pub identity: Identity,
    /// What drives.
    pub teleop_handle: Rc<TeleopHandle>,
    /// A recording to show.
    pub open: Option<ToOpen>,
    /// What was kept of the last run.
    pub settings: Settings,
    /// What keeps it for the next; none where nothing is to be kept.
    pub settings_writer: Option<SettingsWriter>,
    /// What of the last run could not be used.
    pub complaint: Option<String>,
}

/// The app.
pub struct ConsoleApp {
    ctx: Context,
    zenoh_config: Option<PathBuf>,
    credentials: Option<Credentials>,
    session_id: BootId,
    discovery: Discovery,
    /// Where robots are looked for and nowhere else, where that is so.
    asked_alone: Vec<String>,
    choice: RobotChoice,
    /// The robot whose recordings are on this machine, and their folder.
    recordings: Option<(FoundRobot, PathBuf)>,
    shown: Option<(FoundRobot, RobotSession)>,
    /// When the last robot was joined.
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
    /// What is shown instead of a robot.
    playback: Option<Playback>,
    /// What was to be shown from the start on.
    to_open: Option<ToOpen>,
    open_dialog: OpenDialog,
}

impl ConsoleApp {
    /// Begins to look for robots.
    pub fn new(ctx: &Context, settings: AppSettings) -> Self {
        let waking = ctx.clone();
        // Whoever names an address wants what is there, and not what was elsewhere another day.
        let scouts = settings.connect.is_empty();
        let has_keys = settings.credentials.is_some();
        let addresses = if scouts {
            let mut remembered = settings.settings.addresses.clone();
            remembered.retain(|address| check_console(address, has_keys).is_ok());
            remembered
        } else {
            settings.connect
        };
        let is_told_where = !scouts && settings.demo.is_none();
        let asked_alone = if is_told_where {
            addresses.clone()
        } else {
            Vec::new()
        };
        let demo = settings.robot.clone().zip(addresses.first().cloned());
        let demo = demo.map(|(robot, endpoint)| FoundRobot { robot, endpoint });
        let recordings = demo.zip(settings.recordings);
        let discovery = Discovery::start(
            addresses,
            scouts,
            settings.zenoh_config.clone(),
            settings.credentials.clone(),
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
            zenoh_config: settings.zenoh_config,
            credentials: settings.credentials,
            session_id: settings.session,
            discovery,
            asked_alone,
            recordings,
            choice: RobotChoice::new(settings.robot, settings.demo),
            shown: None,
            joined: Monotonic::default(),
            problem: None,
            screen: Screen::of(&settings.settings),
            screenshot: settings.screenshot,
            identity: settings.identity,
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
            to_open: settings.open,
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
            // What the last frame changed is looked at although nothing else happens.
            ctx.request_repaint_after(3 * KEEP_PERIOD);
        }
        if let Some(screenshot) = &mut self.screenshot {
            screenshot.step(ctx, now);
        }
    }

    /// Panels lie on this, and need not be filled again.
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
                        // Another computer's robot may have the same name.
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
                        // It is given no colour of its own, to be remembered.
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
        // Waits until it is written.
        self.settings_writer = None;
    }
}
