//! Execution of the operator's commands.

use std::path::Path;
use std::time::Duration;

use edge::cli::VehicleOptions;
use edge::pacer::Rate;
use eframe::egui::ViewportCommand;
use measurement::time::Monotonic;
use network::clock;
use network::sessions::Endpoints;
use protocol::keys::RobotId;

use super::export_job::ExportJob;
use super::screenshot::{self, ScreenshotOutcome};
use super::session_monitor::{LogNote, SessionMonitor};
use super::{ConsoleApp, STORE_MB, desktop};
use crate::command::Command;
use crate::event_log::Severity;
use crate::link::{FleetState, FoundRobot, RobotSession, SEEN_RECENTLY};
use crate::model::{LastContact, ModelSettings, SILENT_AFTER_UNSTEADY};
use crate::playback::{Playback, PlaybackCommand, in_words};
use crate::teleop_client::{EStopState, TeleopClientState};
use crate::teleop_handle::TeleopSession;
use crate::teleop_input::InputEvent;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SourceKind {
    Robot,
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
        // With a delay of zero egui would paint two frames.
        let wake = move || ctx.request_repaint_after(Duration::from_millis(1));
        // Release the last robot first.
        self.teleop_handle.set_session(None);
        let mut session = RobotSession::open(settings, &endpoints, wake);
        let driving = session
            .take_driving()
            .filter(|_| source_kind == SourceKind::Robot);
        let teleop_session = driving
            .map(|driving| TeleopSession::new(found.robot.clone(), self.identity.clone(), driving));
        match teleop_session.transpose() {
            Ok(teleop_session) => {
                self.problem = None;
                if let Some(before) = before {
                    session.model().set_last_contact(before);
                }
                self.shown = Some((found, session));
                self.joined = clock::now();
                self.teleop_handle.set_session(teleop_session);
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
        // After the state: poses between two statuses are newer than it.
        if let Some(at) = model.connection().last_message_at() {
            self.discovery.mark_seen(&found.robot, at);
        }
    }

    /// Whether `found` is the shown robot and has an unacknowledged emergency stop. The next link continues it.
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
            Command::Playback(PlaybackCommand::Choose(choice)) => {
                if let Some(playback) = &self.playback
                    && let Some(setup) = playback.setup_with(choice)
                {
                    let (path, rate) = (playback.path().to_owned(), playback.status().rate);
                    self.open_with(&path, &setup, rate);
                }
            }
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
                    .map(|(found, _)| desktop::name_for_files(&found.robot, recording.as_deref()));
                let is_taken =
                    |path: &Path| path.exists() || self.pictures.iter().any(|(one, _)| one == path);
                let path = desktop::screenshot_path(shown.as_deref(), is_taken);
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
        // The options of the command line apply whenever that file is opened.
        let setup = self.to_open.as_ref().filter(|said| said.path == path);
        let setup = setup.map(|said| said.setup.clone()).unwrap_or_default();
        self.open_with(path, &setup, rate);
    }

    fn open_with(&mut self, path: &Path, setup: &VehicleOptions, rate: Rate) {
        match Playback::open(path, setup, rate) {
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

impl ConsoleApp {
    pub(super) fn log_session_change(&mut self, next: &FoundRobot, source_kind: SourceKind) {
        let Some((shown, _)) = &self.shown else {
            return;
        };
        let mut notes: Vec<_> = self.teleop_notes().collect();
        if let Some(teleop_client) = self.teleop_handle.state(clock::now()) {
            notes.extend(ended(
                &shown.robot,
                &teleop_client,
                &next.robot,
                source_kind,
            ));
        }
        for (severity, kind, text) in notes {
            self.note(severity, kind, text);
        }
    }
}

fn ended(
    robot: &RobotId,
    teleop_client: &TeleopClientState,
    next: &RobotId,
    source_kind: SourceKind,
) -> Vec<LogNote> {
    let mut notes = Vec::new();
    let is_same = robot == next;
    if teleop_client.lease.held().is_some() {
        let why = match source_kind {
            SourceKind::Robot if is_same => {
                "it is reconnected: press Request control again".to_owned()
            }
            SourceKind::Robot => format!("{next} is shown"),
            SourceKind::Recording => "a recording is shown".to_owned(),
        };
        let text = format!("Driving {robot} has ended: {why}");
        notes.push((Severity::Warning, "driving", text));
    }
    if teleop_client.is_asking {
        let text = format!("{robot} has not answered the last request: show it again to check");
        notes.push((Severity::Warning, "driving", text));
    }
    match teleop_client.estop {
        // The next link continues it.
        EStopState::Sending(_) | EStopState::Unsendable(_) if !is_same => {
            let text = format!(
                "{robot} has not acknowledged the emergency stop, and is sent it no more: show it again and look"
            );
            notes.push((Severity::Alarm, "driving", text));
        }
        EStopState::Sending(_)
        | EStopState::Unsendable(_)
        | EStopState::Quiet
        | EStopState::Refused(_) => {}
    }
    notes
}

/// A first link takes several round trips to open, more with QUIC and TLS.
const FIRST_LINK: Duration = Duration::from_secs(5);

impl ConsoleApp {
    pub(super) fn last_contact(&self, robot: &RobotId, now: Monotonic) -> Option<LastContact> {
        let discovered_robots = self.discovery.discovered_robots();
        let discovered = discovered_robots
            .iter()
            .find(|one| one.found.robot == *robot)?;
        Some(LastContact {
            had_ended: discovered.has_ended(),
            ..before(discovered.seen, self.alerts.knows(robot), now)
        })
    }
}

fn before(last: Monotonic, was_shown: bool, now: Monotonic) -> LastContact {
    let patience = if now.since(last) > SEEN_RECENTLY {
        Duration::ZERO
    } else if was_shown {
        SILENT_AFTER_UNSTEADY
    } else {
        FIRST_LINK
    };
    LastContact {
        last,
        expected_from: now + patience,
        had_ended: false,
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::teleop_client::Lease;
    use crate::test_support::{at, idle_teleop_client};

    #[test]
    fn session_change_is_logged() {
        let [boat, scout]: [RobotId; 2] = ["boat", "scout"].map(|name| name.parse().unwrap());
        let actual =
            |teleop_client: &TeleopClientState, next, source_kind| -> Vec<(Severity, String)> {
                let notes = ended(&boat, teleop_client, next, source_kind).into_iter();
                notes.map(|(severity, _, text)| (severity, text)).collect()
            };
        let mut teleop_client = idle_teleop_client();
        assert_eq!(actual(&teleop_client, &scout, SourceKind::Robot), []);
        teleop_client.lease = Lease::Held(3);
        for (next, source_kind, why) in [
            (&scout, SourceKind::Robot, "scout is shown"),
            (
                &boat,
                SourceKind::Robot,
                "it is reconnected: press Request control again",
            ),
            (&scout, SourceKind::Recording, "a recording is shown"),
        ] {
            let text = format!("Driving boat has ended: {why}");
            assert_eq!(
                actual(&teleop_client, next, source_kind),
                [(Severity::Warning, text)]
            );
        }
        teleop_client.lease = Lease::None;
        teleop_client.is_asking = true;
        let text = "boat has not answered the last request: show it again to check";
        let note = (Severity::Warning, text.to_owned());
        for (next, source_kind) in [(&boat, SourceKind::Robot), (&scout, SourceKind::Recording)] {
            assert_eq!(
                actual(&teleop_client, next, source_kind),
                std::slice::from_ref(&note)
            );
        }
        teleop_client.is_asking = false;
        teleop_client.estop = EStopState::Sending(Duration::from_secs(1));
        assert_eq!(
            actual(&teleop_client, &boat, SourceKind::Robot),
            [],
            "the next link continues it"
        );
        let [(severity, text)] = &actual(&teleop_client, &scout, SourceKind::Robot)[..] else {
            panic!();
        };
        assert_eq!(*severity, Severity::Alarm);
        assert!(
            text.starts_with("boat has not acknowledged the emergency stop"),
            "{text}"
        );
    }

    #[test]
    fn expected_contact_depends_on_last_contact() {
        for (last_ms, was_shown, missed_from_ms) in [
            (19_000, true, 21_500),
            (19_000, false, 25_000),
            (5_000, true, 21_500),
            (4_999, true, 20_000),
            (4_999, false, 20_000),
        ] {
            let expected = LastContact {
                last: at(last_ms),
                expected_from: at(missed_from_ms),
                had_ended: false,
            };
            let actual = before(at(last_ms), was_shown, at(20_000));
            assert_eq!(actual, expected, "{last_ms} {was_shown}");
        }
    }
}
