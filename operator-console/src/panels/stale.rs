//! Old data must not pass for live: what stands above the map while the robot is silent.

use std::time::Duration;

use eframe::egui::{RichText, Ui};
use robot_edge::clock::Monotonic;

use super::wording::age;
use crate::model::{ConsoleModel, LinkState};
use crate::playback::is_recording;
use crate::theme;

/// The robot was heard, but is not heard now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StaleData {
    /// Since the newest message.
    pub silent_for: Duration,
}

impl StaleData {
    /// `None` while data is live, or none has ever come. A recording has no link to lose: why it ends, its time line says.
    pub fn new(model: &ConsoleModel, now: Monotonic) -> Option<Self> {
        if is_recording(model.robot()) {
            return None;
        }
        let connection = model.connection();
        match connection.state(now) {
            LinkState::Waiting | LinkState::Live => None,
            LinkState::Silent => Some(Self {
                silent_for: connection.age(now).unwrap_or_default(),
            }),
        }
    }
}

/// Whether the position is not what it is now, although something else may be heard.
pub fn is_position_old(model: &ConsoleModel, now: Monotonic) -> bool {
    let pose = model.vehicle().pose();
    let longest = model.connection().silent_after();
    !is_recording(model.robot()) && pose.is_some_and(|(_, at)| now.since(at) > longest)
}

/// Draws the warning, on a ground of [`theme::BANNER`]. A link that is lost is no pause: it counts on, and says that
/// nobody here knows.
pub fn stale_ui(ui: &mut Ui, data: &StaleData) {
    let [_, ink] = theme::BANNER;
    let since = format!("Link lost: nothing heard for {}", age(data.silent_for));
    ui.vertical_centered(|ui| {
        ui.spacing_mut().item_spacing.y = 2.0;
        ui.label(RichText::new(since).size(20.0).strong().color(ink));
        ui.label(
            RichText::new("What is shown is old. What the robot does now is not known here.")
                .color(ink),
        );
    });
}
