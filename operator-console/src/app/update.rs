//! Periodic work beside the frames: log, alerts, settings, list of robots.

use eframe::egui::Context;
use measurement::time::Monotonic;
use protocol::keys::RobotId;
use robot_edge::clock::{self, seconds_since_1970};
use robot_edge::network::endpoints::check_console;

use crate::alerts::AlertSource;
use crate::event_log::Severity;
use crate::link::FoundRobot;
use crate::lock;
use crate::model::LinkState;
use crate::panels::address_list::{ListedAddress, listed};
use crate::panels::driving::labels;
use crate::panels::robots::RobotEntry;
use crate::playback::{Playback, is_recording};
use crate::settings::{SettingsWriter, WindowPlace};

use super::choice::moved_to;
use super::session_monitor::LogNote;
use super::{ConsoleApp, desktop};

impl ConsoleApp {
    pub(super) fn note(&mut self, severity: Severity, kind: &str, text: impl Into<String>) {
        let (now, unix_s) = (clock::now(), seconds_since_1970());
        self.log.note(severity, kind, text, now, unix_s);
    }

    /// Logs news of robot, link, exports, screenshots and settings.
    pub(super) fn poll_background_state(&mut self, now: Monotonic) {
        let mut notes = Vec::new();
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
            if let Some(why) = playback.take_failure() {
                let text = format!("{name} cannot be shown: {why}");
                notes.push((Severity::Alarm, "recording", text));
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
            let Some(outcome) = lock(outcome).take() else {
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

    /// Failures of the teleop client. The robot reports everything else as events.
    pub(super) fn teleop_notes(&self) -> impl Iterator<Item = LogNote> + use<> {
        let notes = self.teleop_handle.take_notifications().into_iter();
        notes.filter_map(|note| {
            let (text, is_failure) = labels::note(&note);
            is_failure.then_some((Severity::Warning, "driving", text))
        })
    }

    /// Passes the settings to their writer.
    pub(super) fn keep(&mut self) {
        let Some(settings_writer) = &mut self.settings_writer else {
            return;
        };
        self.screen.keep(&mut self.settings);
        if let Some(place) = window_place(&self.ctx) {
            self.settings.window = Some(place);
        }
        settings_writer.save(self.settings.clone());
    }

    /// The present address of the shown robot, if it is silent here and answers there.
    pub(super) fn moved(&self, now: Monotonic) -> Option<FoundRobot> {
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

    /// Saved addresses that can be searched in this run, and those of the command line.
    pub(super) fn listed_addresses(&self) -> Vec<ListedAddress> {
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

    /// Discovered robots with their colours and alerts.
    pub(super) fn seen(&mut self) -> Vec<RobotEntry> {
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
