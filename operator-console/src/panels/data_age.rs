//! How old the shown data is: the banner over the map of a silent robot, and texts for the age of map data.

use std::time::Duration;

use eframe::egui::{Color32, RichText, Ui, Visuals};
use measurement::time::Monotonic;
use protocol::tile::TileKey;

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

/// Ages below this are shown as the end itself.
const NEGLIGIBLE: Duration = Duration::from_millis(50);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataAge {
    /// Age in the robot's time, or at the shown time of a recording.
    Old(Duration),
    BeforeEnd(Duration),
    /// The data is newer than the robot's clock, because the clock was set back.
    Unknown,
}

impl DataAge {
    pub fn new(model: &ConsoleModel, key: TileKey, now: Monotonic) -> Self {
        let ages = model.map().ages();
        let before_newest = || ages.before_newest(key);
        if is_recording(model.robot()) {
            // Ages do not grow while a recording is paused.
            return Self::Old(before_newest());
        }
        if model.reports_ended() {
            return Self::BeforeEnd(before_newest());
        }
        ages.age(key, now).map_or(Self::Unknown, Self::Old)
    }

    /// Text after "newest".
    pub fn words(self) -> String {
        match self {
            Self::Old(time) => format!("{} old", age(time)),
            Self::BeforeEnd(time) if time < NEGLIGIBLE => "as of the end".to_owned(),
            Self::BeforeEnd(time) => format!("{} before the end", age(time)),
            Self::Unknown => "of before the data began again".to_owned(),
        }
    }

    /// Text after "changed".
    pub fn moment(self) -> String {
        match self {
            Self::Old(time) => format!("{} ago", age(time)),
            Self::BeforeEnd(time) if time < NEGLIGIBLE => "at the end".to_owned(),
            Self::BeforeEnd(time) => format!("{} before the end", age(time)),
            Self::Unknown => "before the data began again".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::layer::LayerId;
    use protocol::message::Status;
    use protocol::tile::TileCells;

    use super::*;

    use crate::test_support::{
        announce_map, at, console, describe_layers, ended_status, idle_teleop_status, inject,
        inject_at, pose_at_rest, push_tile, scout, store_of,
    };

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

    const LAYER: LayerId = LayerId::Occupancy;
    const KEY: TileKey = TileKey {
        layer: LAYER,
        tx: 0,
        ty: 0,
    };
    const SECOND_NS: i64 = 1_000_000_000;

    /// A robot whose clock is at 100 s at the first contact, with a tile measured at 60 s.
    fn late(robot: &str) -> ConsoleModel {
        let mut store = store_of(&[LAYER]);
        store.set_stamp(60 * SECOND_NS);
        drop(store.publish(KEY, TileCells::from_fn(|_, _| 7)).unwrap());
        let mut model = console(robot, &[LAYER]);
        announce_map(&mut model, &store, at(1_000));
        describe_layers(&mut model, &[LAYER], at(1_000));
        stands(&mut model, 1_000);
        push_tile(&mut model, &store, KEY, at(1_000));
        model
    }

    fn stands(model: &mut ConsoleModel, ms: u64) {
        inject_at(model, 100 * SECOND_NS, Topic::Pose, &pose_at_rest(), at(ms));
    }

    fn words(model: &ConsoleModel, ms: u64) -> String {
        DataAge::new(model, KEY, at(ms)).words()
    }

    #[test]
    fn map_age_is_that_of_its_measurements() {
        let model = late("scout");
        assert_eq!(words(&model, 1_000), "40 s old");
        assert_eq!(words(&model, 6_000), "45 s old");
        let age = DataAge::new(&model, KEY, at(6_000));
        assert_eq!(age.moment(), "45 s ago");
    }

    #[test]
    fn a_paused_recording_does_not_age() {
        let mut recording = late("recording-1");
        let mut ended = late("scout");
        let status = ended_status();
        inject_at(
            &mut ended,
            100 * SECOND_NS,
            Topic::Status,
            &status,
            at(1_500),
        );
        for ms in [6_000, 60_000] {
            for model in [&mut recording, &mut ended] {
                stands(model, ms);
            }
            assert_eq!(words(&recording, ms), "40 s old");
            assert_eq!(words(&ended, ms), "40 s before the end");
        }
        let end = DataAge::BeforeEnd(Duration::from_millis(20));
        assert_eq!(end.words(), "as of the end");
        assert_eq!(end.moment(), "at the end");
    }

    #[test]
    fn tiles_newer_than_the_clock_have_unknown_age() {
        let mut model = late("scout");
        let mut store = store_of(&[LAYER]);
        store.set_stamp(160 * SECOND_NS);
        for code in [8, 9] {
            drop(store.publish(KEY, TileCells::from_fn(|_, _| code)).unwrap());
        }
        push_tile(&mut model, &store, KEY, at(1_500));
        stands(&mut model, 2_501);
        assert_eq!(words(&model, 2_600), "of before the data began again");
        let moment = DataAge::new(&model, KEY, at(2_600)).moment();
        assert_eq!(moment, "before the data began again");
    }
}
