//! What goes on beside the frames: happenings are noted, alerts raised, settings kept.

use eframe::egui::Context;
use protocol::keys::RobotId;
use robot_edge::clock::{Monotonic, seconds_since_1970};
use robot_edge::link::endpoints::check_console;

use crate::alerts::Subject;
use crate::event_log::Severity;
use crate::link::FoundRobot;
use crate::locks::lock;
use crate::model::LinkState;
use crate::panels::address_list::{ListedAddress, listed};
use crate::panels::driving::words;
use crate::panels::robots::Seen;
use crate::playback::{Playback, is_recording};
use crate::settings::{Keeper, WindowPlace};

use super::choice::moved_to;
use super::watch::Note;
use super::{ConsoleApp, desktop};

impl ConsoleApp {
    pub(super) fn note(&mut self, severity: Severity, kind: &str, text: impl Into<String>) {
        let (now, unix_s) = (Monotonic::now(), seconds_since_1970());
        self.log.note(severity, kind, text, now, unix_s);
    }

    /// Looks at what is to be noted: robot, link, exports, pictures, settings.
    pub(super) fn look_around(&mut self, now: Monotonic) {
        let mut notes = Vec::new();
        if let Some((_, session)) = &self.shown {
            let model = session.model();
            let recording = self.playback.as_ref().map(Playback::file_name);
            let subject = match &recording {
                Some(_) => Subject::Recording,
                None => Subject::Robot,
            };
            let name = recording.unwrap_or_else(|| model.robot().to_string());
            let news = self.log.hear(&model, &name, now, seconds_since_1970());
            let alerts = self.alerts.shown_mut();
            let begun = alerts.map(|alerts| alerts.look(&model, subject, &news, now));
            for (_alarm, text) in begun.into_iter().flatten() {
                notes.push((Severity::Alarm, "alert", format!("{name}: {text}")));
            }
            // The link to a recording leaves this program as little as the recording does.
            if self.playback.is_none() {
                notes.extend(self.watch.look(&model, session.transport(), now));
            }
        }
        let sightings = self.discovery.sightings();
        for text in self.alerts.look_around(&sightings, now) {
            notes.push((Severity::Alarm, "alert", text));
        }
        if let Some(why) = self.choice.take_end() {
            let text = format!("The demo has ended: {why}");
            notes.push((Severity::Alarm, "demo", text));
        }
        if let Some(playback) = &mut self.playback {
            let name = playback.file_name();
            for damage in playback.damage_to_tell() {
                notes.push((
                    Severity::Warning,
                    "recording",
                    format!("{name} is {damage}"),
                ));
            }
            if let Some(why) = playback.failure_to_tell() {
                let text = format!("{name} cannot be shown: {why}");
                notes.push((Severity::Alarm, "recording", text));
            }
        }
        notes.extend(self.driving_notes());
        if let Some(export) = &mut self.export
            && let Some(end) = export.take_end()
        {
            notes.push(end.note);
            if let Some(folder) = end.folder.filter(|_| desktop::has_desktop())
                && let Err(why) = desktop::open_folder(&folder)
            {
                export.not_opened(&folder, &why);
                notes.push((Severity::Note, "folder", why));
            }
        }
        self.pictures.retain(|(path, outcome)| {
            let Some(outcome) = lock(outcome).take() else {
                return true;
            };
            notes.push(match outcome {
                Ok(()) => (
                    Severity::Note,
                    "screenshot",
                    format!("Saved as {}", path.display()),
                ),
                Err(why) => (Severity::Warning, "screenshot", format!("{why:#}")),
            });
            false
        });
        if let Some(problem) = self.keeper.as_ref().and_then(Keeper::take_problem) {
            notes.push((Severity::Warning, "settings", problem));
        }
        for (severity, kind, text) in notes {
            self.note(severity, kind, text);
        }
    }

    /// What did not succeed at the helm: the rest, and who drives, the robot tells everybody.
    pub(super) fn driving_notes(&self) -> impl Iterator<Item = Note> + use<> {
        let notes = self.hands.take_notes().into_iter();
        notes.filter_map(|note| {
            let (text, is_failure) = words::note(&note);
            is_failure.then_some((Severity::Warning, "driving", text))
        })
    }

    /// Puts what is to be kept where it is written.
    pub(super) fn keep(&mut self) {
        let Some(keeper) = &mut self.keeper else {
            return;
        };
        self.screen.keep(&mut self.settings);
        if let Some(place) = window_place(&self.ctx) {
            self.settings.window = Some(place);
        }
        keeper.keep(self.settings.clone());
    }

    /// Where the robot that is shown answers by now, where it is heard there no more.
    pub(super) fn moved(&self, now: Monotonic) -> Option<FoundRobot> {
        let (shown, session) = self.shown.as_ref().filter(|_| self.playback.is_none())?;
        let model = session.model();
        let link = model.connection();
        if link.state(now) == LinkState::Live {
            return None;
        }
        // It may have been silent for long before it was joined: the link has its time all the same.
        let joined = now.since(self.joined);
        let silent = link.age(now).map_or(joined, |age| age.min(joined));
        moved_to(shown, silent, &self.discovery.sightings(), now)
    }

    /// The addresses that are remembered and could be asked in this run, and those that the command line names.
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

    /// The robots that were seen, with their colours and alerts.
    pub(super) fn seen(&mut self) -> Vec<Seen> {
        self.tell_of_shown();
        let shown = self.shown.as_ref().filter(|_| self.playback.is_none());
        let moved = shown.and_then(|(found, session)| {
            let own_motion = session.model().own_motion(Monotonic::now())?;
            Some((found.robot.clone(), own_motion))
        });
        let own_motion = |robot: &RobotId| {
            let moved = moved.as_ref().filter(|(moved, _)| moved == robot);
            moved.map(|(_, own_motion)| *own_motion)
        };
        let sightings = self.discovery.sightings();
        sightings
            .into_iter()
            .filter(|sighting| !is_recording(&sighting.found.robot))
            .map(|sighting| Seen {
                color: self.settings.robots.of(&sighting.found.robot),
                alerts: self.alerts.unseen_of(&sighting.found.robot),
                own_motion: own_motion(&sighting.found.robot),
                sighting,
            })
            .collect()
    }
}

/// Where the window is, in points of the system; `None` where the system does not tell.
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
    place.is_sound().then_some(place)
}
