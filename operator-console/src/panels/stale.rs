//! Banner over the map while the robot is silent, so that old data does not look live.

use std::time::Duration;

use eframe::egui::{Color32, RichText, Ui, Visuals};
use measurement::time::Monotonic;

use super::formatting::age;
use crate::model::{ConsoleModel, LinkState};
use crate::playback::is_recording;
use crate::theme;

/// The robot was connected and is silent now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StaleData {
    pub silent_for: Duration,
    /// Its data had ended: the silence is expected.
    pub had_ended: bool,
    pub is_vehicle: bool,
    pub is_shown: bool,
}

impl StaleData {
    /// `None` while data is live or before any data. A recording has no link: its timeline shows why it ended.
    pub fn new(model: &ConsoleModel, now: Monotonic) -> Option<Self> {
        if is_recording(model.robot()) {
            return None;
        }
        let connection = model.connection();
        match connection.state(now) {
            LinkState::Waiting | LinkState::Live => None,
            LinkState::Silent => Some(Self {
                silent_for: connection.age(now).unwrap_or_default(),
                had_ended: model.is_silence_expected(),
                is_vehicle: model.is_vehicle(),
                is_shown: model.map().head_at().is_some() || model.vehicle().pose().is_some(),
            }),
        }
    }
}

/// Whether the position is out of date, even if other messages arrive.
pub fn is_position_old(model: &ConsoleModel, now: Monotonic) -> bool {
    let pose = model.vehicle().pose();
    let longest = model.connection().silent_after();
    !is_recording(model.robot()) && pose.is_some_and(|(_, at)| now.since(at) > longest)
}

impl StaleData {
    pub fn words(&self) -> [String; 2] {
        let silent = age(self.silent_for);
        let unknown = "Robot state unknown (no data).";
        if self.had_ended {
            let why = "robot-edge has closed, or the link is lost.";
            let since = format!("No data for {silent}: {why}");
            let meaning = if self.is_vehicle {
                format!("{since} {unknown}")
            } else {
                since
            };
            return ["Its data has ended".to_owned(), meaning];
        }
        let meaning = if self.is_shown {
            format!("What is shown is old. {unknown}")
        } else {
            unknown.to_owned()
        };
        [format!("Link lost: no data for {silent}"), meaning]
    }

    /// Background and text colour. An expected end has no warning colour.
    pub fn colors(&self, visuals: &Visuals) -> [Color32; 2] {
        if self.had_ended {
            [visuals.panel_fill, visuals.text_color()]
        } else {
            theme::BANNER
        }
    }
}

/// Draws the banner with a growing time, so that it does not look like a pause.
pub fn stale_ui(ui: &mut Ui, data: &StaleData) {
    let [_, ink] = data.colors(ui.visuals());
    let [headline, meaning] = data.words();
    ui.vertical_centered(|ui| {
        ui.spacing_mut().item_spacing.y = 2.0;
        ui.label(RichText::new(headline).size(20.0).strong().color(ink));
        ui.label(RichText::new(meaning).color(ink));
    });
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::message::Status;

    use super::*;
    use crate::test_support::{at, idle_teleop_status, inject, scout};

    fn banner(has_ended: bool, can_be_driven: bool) -> StaleData {
        let mut model = scout();
        let status = Status {
            has_ended,
            teleop: can_be_driven.then(idle_teleop_status),
            ..Status::default()
        };
        inject(&mut model, Topic::Status, &status, at(1_000));
        assert_eq!(StaleData::new(&model, at(1_100)), None);
        StaleData::new(&model, at(4_100)).unwrap()
    }

    #[test]
    fn silence_after_the_end_is_not_a_lost_link() {
        let visuals = Visuals::dark();
        let meaning = "Robot state unknown (no data).".to_owned();
        let closed = "No data for 3.1 s: robot-edge has closed, or the link is lost.";
        let of_a_vehicle = format!("{closed} {meaning}");
        for (can_be_driven, says) in [(false, closed), (true, of_a_vehicle.as_str())] {
            let calm = banner(true, can_be_driven);
            assert_eq!(calm.words(), ["Its data has ended", says]);
            assert_ne!(calm.colors(&visuals), theme::BANNER);
        }
        for lost in [banner(false, false), banner(false, true)] {
            let headline = "Link lost: no data for 3.1 s".to_owned();
            assert_eq!(lost.words(), [headline.clone(), meaning.clone()]);
            let is_shown = true;
            let old = StaleData { is_shown, ..lost }.words();
            assert_eq!(old, [headline, format!("What is shown is old. {meaning}")]);
            assert_eq!(lost.colors(&visuals), theme::BANNER);
        }
    }
}
