//! What happened to the robot, the newest first.

use eframe::egui::{RichText, ScrollArea, Ui};
use robot_edge::clock::Monotonic;

use super::wording::age;
use crate::model::ConsoleModel;

/// What the panel shows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EventsData {
    /// The newest first.
    pub events: Vec<EventLine>,
}

/// One event.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EventLine {
    /// Kind and age.
    pub heading: String,
    /// What happened.
    pub message: String,
}

impl EventsData {
    /// The events with their ages at `now`.
    pub fn new(model: &ConsoleModel, now: Monotonic) -> Self {
        let line = |(event, at): &(protocol::message::Event, Monotonic)| EventLine {
            heading: format!("{}, {} ago", event.kind, age(now.since(*at))),
            message: event.message.clone(),
        };
        Self {
            events: model.events().iter().rev().map(line).collect(),
        }
    }
}

/// Draws the panel.
pub fn events_ui(ui: &mut Ui, data: &EventsData) {
    if data.events.is_empty() {
        ui.label("Nothing has happened.");
    }
    ScrollArea::vertical()
        .id_salt("events")
        .max_height(180.0)
        .auto_shrink([false, true])
        .show(ui, |ui| {
            for event in &data.events {
                let weak = ui.visuals().weak_text_color();
                ui.label(RichText::new(&event.heading).small().color(weak));
                ui.label(&event.message);
            }
        });
}
