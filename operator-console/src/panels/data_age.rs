//! Text for the age of map data.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::tile::TileKey;

use super::formatting::age;
use crate::model::ConsoleModel;
use crate::playback::is_recording;

/// Ages below this are shown as the end itself.
const NEGLIGIBLE: Duration = Duration::from_millis(50);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataAge {
    /// Age in the robot's time, or at the shown time of a recording.
    Old(Duration),
    /// Age at the end of the robot's data.
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
    use protocol::message::{Info, LayerInfo, Status};
    use protocol::tile::TileCells;
    use protocol::tile_store::{LayerGrid, TileStore};

    use super::*;
    use crate::model::RequestId;
    use crate::test_support::{
        BOOT, announce_map, at, console, inject_at, inject_reply, pose_at_rest, push_tile,
    };

    const LAYER: LayerId = LayerId::Occupancy;
    const KEY: TileKey = TileKey {
        layer: LAYER,
        tx: 0,
        ty: 0,
    };
    const SECOND_NS: i64 = 1_000_000_000;

    /// A robot whose clock is at 100 s at the first contact, with a tile measured at 60 s.
    fn late(robot: &str) -> ConsoleModel {
        let mut store = TileStore::new(BOOT, 10);
        let cell_m = 0.1;
        store
            .set_grid(LayerGrid {
                layer: LAYER,
                cell_m,
            })
            .unwrap();
        store.set_stamp(60 * SECOND_NS);
        drop(store.publish(KEY, TileCells::from_fn(|_, _| 7)).unwrap());
        let mut model = console(robot, &[LAYER]);
        let info = Info {
            layers: vec![LayerInfo {
                layer: LAYER,
                cell_m,
            }],
            ..Info::default()
        };
        announce_map(&mut model, &store, at(1_000));
        inject_reply(&mut model, RequestId(1), Topic::Info, &info, at(1_000));
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
        let status = Status {
            has_ended: true,
            ..Status::default()
        };
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
        let mut store = TileStore::new(BOOT, 10);
        let (layer, cell_m) = (LAYER, 0.1);
        store.set_grid(LayerGrid { layer, cell_m }).unwrap();
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
