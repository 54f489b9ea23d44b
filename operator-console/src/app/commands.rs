//! What the operator asks for is done: robots and recordings are shown, commands obeyed.

use std::path::Path;
use std::time::Duration;

use eframe::egui::ViewportCommand;
use robot_edge::clock;
use robot_edge::link::sessions::Endpoints;
use robot_edge::pacer::Rate;

use crate::command::Command;
use crate::event_log::Severity;
use crate::link::{FleetState, FoundRobot, RobotSession};
use crate::model::ModelSettings;
use crate::playback::{Playback, in_words, is_recording};
use crate::teleop_client::EStopState;
use crate::teleop_input::InputEvent;
use crate::teleop_session::TeleopSession;

use super::export_job::ExportJob;
use super::screenshot::{self, ScreenshotOutcome};
use super::session_monitor::SessionMonitor;
use super::{ConsoleApp, STORE_MB, desktop, pictures};

/// What is behind a name on the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SourceKind {
    /// It may be driven.
    Robot,
    /// It is replayed here.
    Recording,
}

impl ConsoleApp {
    pub(super) fn connect(&mut self, found: FoundRobot, source_kind: SourceKind) {
        let settings = ModelSettings {
            robot: found.robot.clone(),
            session: self.session_id,
            tile_store_mb: STORE_MB,
            layers: self.screen.map_view().shown_layers(),
        };
        let endpoints = Endpoints {
            connect: vec![found.endpoint.clone()],
            zenoh_config: self.zenoh_config.clone(),
            credentials: self.credentials.clone(),
            ..Endpoints::default()
        };
        let stop_is_underway = self.stop_is_underway(&found);
        // A recording's maps are others whenever it is opened.
        if let Some((before, session)) = &self.shown
            && !is_recording(&before.robot)
            && let Some(names) = session.model().take_site_names()
        {
            self.site_names.insert(before.robot.clone(), names);
        }
        self.screen.forget_robot();
        self.log_session_change(&found, source_kind);
        self.update_discovery();
        let before = self
            .last_contact(&found.robot, clock::now())
            .filter(|_| source_kind == SourceKind::Robot);
        self.alerts.change_to(&found.robot, clock::now());
        self.log.forget_robot();
        self.session_monitor = SessionMonitor::default();
        let ctx = self.ctx.clone();
        // Any delay but none: a request for now would be two frames.
        let wake = move || ctx.request_repaint_after(Duration::from_millis(1));
        // What was driven is left before anything else is.
        self.teleop_handle.take(None);
        let opened = RobotSession::open(settings, &endpoints, wake).map_err(anyhow::Error::from);
        let opened = opened.and_then(|mut session| {
            let teleop_session = session
                .take_driving()
                .filter(|_| source_kind == SourceKind::Robot)
                .map(|driving| {
                    TeleopSession::new(found.robot.clone(), self.identity.clone(), driving)
                });
            Ok((session, teleop_session.transpose()?))
        });
        match opened {
            Ok((session, teleop_session)) => {
                self.problem = None;
                if let Some(before) = before {
                    session.model().set_last_contact(before);
                }
                if let Some(names) = self.site_names.remove(&found.robot) {
                    session.model().restore_site_names(names);
                }
                self.shown = Some((found, session));
                self.joined = clock::now();
                self.teleop_handle.take(teleop_session);
                if stop_is_underway {
                    self.teleop_handle.apply(InputEvent::EStop);
                }
            }
            Err(why) => {
                tracing::error!(%why, "the robot cannot be shown");
                self.problem = Some(format!("{} cannot be shown: {why}", found.robot));
                self.shown = None;
            }
        }
    }

    /// What the robot that is shown has said of itself is newer than what looking for robots has found.
    pub(super) fn update_discovery(&self) {
        let shown = self.shown.as_ref().filter(|_| self.playback.is_none());
        let Some((found, session)) = shown else {
            return;
        };
        let model = session.model();
        if let Some((status, at)) = model.status() {
            let state = FleetState::of(status);
            self.discovery.update_state(&found.robot, state, *at);
        }
        // After its state, which poses between two statuses would be newer than.
        if let Some(at) = model.connection().last_message_at() {
            self.discovery.mark_seen(&found.robot, at);
        }
    }

    /// Whether `found` is the robot that is shown, and an emergency stop is on its way to it: that goes on by the next link.
    fn stop_is_underway(&self, found: &FoundRobot) -> bool {
        let is_same = self
            .shown
            .as_ref()
            .is_some_and(|(shown, _)| shown.robot == found.robot);
        let teleop_client = self.teleop_handle.state(clock::now()).filter(|_| is_same);
        teleop_client.is_some_and(|teleop_client| match teleop_client.estop {
            EStopState::Sending(_) | EStopState::Unsendable(_) => true,
            EStopState::Quiet | EStopState::Refused(_) => false,
        })
    }

    pub(super) fn execute(&mut self, command: Command) {
        match command {
            Command::Connect(found) => {
                self.close_recording();
                self.connect(found, SourceKind::Robot);
            }
            Command::AskForRecording => {
                let folder = self.recordings.as_ref().map(|(_, folder)| folder.clone());
                self.open_dialog.open(folder);
            }
            Command::Open(path) => self.open_recording(&path, Rate::Times(1.0)),
            Command::Playback(command) => {
                let stays = self
                    .playback
                    .as_ref()
                    .map(|playback| playback.execute(command));
                if stays == Some(false) {
                    self.close_recording();
                }
            }
            Command::AddAddress(address) => {
                self.settings.remember(&address);
                self.discovery.add_address(address);
            }
            Command::ForgetAddress(address) => {
                self.settings.forget(&address);
                self.discovery.forget_address(&address);
            }
            Command::ForgetRobot(robot) => {
                self.discovery.forget_robot(&robot);
                self.alerts.forget(&robot);
                self.site_names.remove(&robot);
            }
            Command::Look(look) => self.screen.map_view_mut().look(look),
            Command::Drive(intent) => self.teleop_handle.submit(intent, clock::now()),
            Command::Layer(command) => {
                if let Some((_, session)) = &self.shown {
                    let map_view = self.screen.map_view_mut();
                    map_view.apply(command, &session.model());
                }
            }
            Command::Acknowledge(robot, alarm) => self.alerts.acknowledge(&robot, &alarm),
            Command::AcknowledgeAll => self.alerts.acknowledge_all(),
            Command::Screenshot => {
                let recording = self.playback.as_ref().map(Playback::file_name);
                let shown = self
                    .shown
                    .as_ref()
                    .map(|(found, _)| pictures::name_for_files(&found.robot, recording.as_deref()));
                let is_taken =
                    |path: &Path| path.exists() || self.pictures.iter().any(|(one, _)| one == path);
                let path = pictures::screenshot_path(shown.as_deref(), is_taken);
                let outcome = ScreenshotOutcome::default();
                screenshot::take(&self.ctx, path.clone(), ScreenshotOutcome::clone(&outcome));
                self.pictures.push((path, outcome));
            }
            Command::Export(request) => {
                if let Some((_, session)) = &self.shown {
                    let ctx = self.ctx.clone();
                    let wake = move || ctx.request_repaint_after(Duration::from_millis(1));
                    self.export = Some(ExportJob::start(request, session.handle(), wake));
                }
            }
            Command::CancelExport => {
                if let Some(export) = &self.export {
                    export.cancel();
                }
            }
            Command::OpenFolder(folder) => {
                if let Err(why) = desktop::open_folder(&folder) {
                    if let Some(export) = &self.export {
                        export.not_opened(&folder, &why);
                    }
                    self.note(Severity::Warning, "folder", why);
                }
            }
            Command::Quit => self.ctx.send_viewport_cmd(ViewportCommand::Close),
        }
        self.ctx.request_repaint();
    }

    pub(super) fn open_recording(&mut self, path: &Path, rate: Rate) {
        // What the command line says of a file holds whenever that is opened.
        let setup = self.to_open.as_ref().filter(|said| said.path == path);
        let setup = setup.map(|said| said.setup.clone()).unwrap_or_default();
        match Playback::open(path, &setup, rate) {
            Ok(playback) => {
                self.open_dialog.close();
                self.close_recording();
                self.connect(playback.robot().clone(), SourceKind::Recording);
                self.playback = Some(playback);
                let text = format!("{} is opened", path.display());
                self.note(Severity::Info, "recording", text);
            }
            Err(why) => {
                let path = path.display().to_string();
                self.open_dialog.refuse(path, in_words(&why));
            }
        }
    }

    pub(super) fn close_recording(&mut self) {
        if self.playback.take().is_some() {
            self.shown = None;
            self.alerts.leave(clock::now());
            self.screen.forget_robot();
        }
    }
}
