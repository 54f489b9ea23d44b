//! How old the tiles of the map are, by the stamps of the robot: who joins late is told the age of the map, not of its arrival.
//!
//! Stamps are of the clock of the robot's sensors, which no clock here is compared with. Only how far two stamps lie apart
//! counts: that of a tile, and the newest that the robot told of when the tile came. From then on this machine's own clock
//! tells how much older it gets, so that it ages by what it should even where the robot's clock is set. Pure: the present is
//! a parameter.

mod clock_stall;

use std::collections::BTreeMap;
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::layer::LayerId;
use protocol::tile::TileKey;

use clock_stall::{ClockStall, ClockStallDetector};

/// A pose with the stamp of a tile's data, or a newer one, comes within this where any come.
const POSE_TIMEOUT: Duration = Duration::from_secs(1);

/// Stamps ahead of the poses that are remembered; a pose comes before there are so many.
const MAX_AHEAD: usize = 10_000;

/// What is later has a greater one, also where the clock of the data was set back in between. What is ahead of the data,
/// as it is of before that, has a lesser one than all that is not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct AgeOrder {
    /// Whether its age is known.
    has_age: bool,
    times_set_back: u32,
    stamp_ns: i64,
}

/// When the tiles of one run of a robot were measured.
#[derive(Clone, Debug, Default)]
pub struct Ages {
    /// The newest stamp that was told of, nanoseconds, and when that was first.
    newest: Option<(i64, Monotonic)>,
    /// The number of the message that told so last, and when.
    last_update: Option<(u64, Monotonic)>,
    clock_stall: ClockStallDetector,
    times_set_back: u32,
    tiles: BTreeMap<TileKey, TileArrival>,
    /// Tiles of which nobody knows how old they were, since nothing as new was told of yet; by stamp.
    ahead: BTreeMap<i64, Vec<TileKey>>,
}

/// A tile that came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct TileArrival {
    stamp_ns: i64,
    at: Monotonic,
    /// How old it was.
    before: Option<Duration>,
    /// How long the clock of the data stood since.
    stalled: Duration,
    times_set_back: u32,
}

impl TileArrival {
    /// How old it is, where it is known how old it was.
    fn age(&self, now: Monotonic) -> Option<Duration> {
        let age = now.since(self.at).saturating_add(self.before?);
        Some(age.saturating_sub(self.stalled))
    }
}

impl Ages {
    /// The robot told of its newest data in message `seq`, `stamp_ns` being its stamp.
    pub(super) fn update_clock(&mut self, seq: u64, stamp_ns: i64, now: Monotonic) {
        if self
            .last_update
            .is_some_and(|(newest_seq, _)| seq < newest_seq)
        {
            // It was overtaken on its way: poses wait for nothing that is sent again.
            return;
        }
        let last = self.newest.zip(self.last_update);
        let last = last.map(|((newest_ns, _), (_, last_update))| (newest_ns, last_update));
        if let Some(stalled) = self.clock_stall.update(last, stamp_ns, now) {
            self.stalled(stalled, now);
        }
        self.last_update = Some((seq, now));
        match self.newest {
            Some((newest_ns, _)) if stamp_ns == newest_ns => return,
            Some((newest_ns, _)) => self.times_set_back += u32::from(stamp_ns < newest_ns),
            None => {}
        }
        self.newest = Some((stamp_ns, now));
        while let Some(first) = self.ahead.first_entry()
            && *first.key() <= stamp_ns
        {
            let (ahead_ns, keys) = first.remove_entry();
            let apart = apart(stamp_ns, ahead_ns).unwrap_or_default();
            for key in keys {
                if let Some(arrival) = self.tiles.get_mut(&key)
                    && arrival.stamp_ns == ahead_ns
                {
                    arrival.before = Some(apart.saturating_sub(now.since(arrival.at)));
                }
            }
        }
    }

    /// What is counted from before the clock of the data stood was counted too long.
    fn stalled(&mut self, stalled: ClockStall, now: Monotonic) {
        let since = now.since(stalled.from);
        for arrival in self.tiles.values_mut() {
            if arrival.age(now).is_some_and(|age| age >= since) {
                arrival.stalled += stalled.time;
            }
        }
    }

    /// The data's time begins anew, where it began or elsewhere: a recording was wound, or maps were erased.
    pub(super) fn restart(&mut self) {
        self.newest = None;
        self.clock_stall = ClockStallDetector::default();
    }

    /// A tile came whose newest data has this stamp.
    pub(super) fn on_tile(&mut self, key: TileKey, stamp_ns: i64, now: Monotonic) {
        let before = self.newest.and_then(|(newest_ns, last_update)| {
            // The data went on since it was told of; a new stamp would have been told.
            Some(apart(newest_ns, stamp_ns)?.saturating_add(now.since(last_update)))
        });
        if before.is_none() {
            self.ahead.entry(stamp_ns).or_default().push(key);
            if self.ahead.len() > MAX_AHEAD {
                // Those that wait shortest: the others know first.
                self.ahead.pop_last();
            }
        }
        let arrival = TileArrival {
            stamp_ns,
            at: now,
            before,
            stalled: Duration::ZERO,
            times_set_back: self.times_set_back,
        };
        self.tiles.insert(key, arrival);
    }

    /// How old a tile is; `None` where nobody knows, as the clock of the data was set back behind it.
    pub fn age(&self, key: TileKey, now: Monotonic) -> Option<Duration> {
        let arrival = self.tiles.get(&key)?;
        arrival
            .age(now)
            .or_else(|| (!self.is_ahead(arrival)).then(|| now.since(arrival.at)))
    }

    /// Whether the data goes on, and still has not come to where a tile was measured. Where nothing was told since that
    /// came, nobody knows.
    fn is_ahead(&self, arrival: &TileArrival) -> bool {
        let last_update = self
            .last_update
            .map(|(_, last_update)| last_update.since(arrival.at));
        arrival.before.is_none() && last_update > Some(POSE_TIMEOUT)
    }

    /// How long before the newest data a tile was measured.
    pub fn before_newest(&self, key: TileKey) -> Duration {
        let both = self.newest.zip(self.tiles.get(&key));
        let apart = both.and_then(|((newest_ns, _), arrival)| apart(newest_ns, arrival.stamp_ns));
        apart.unwrap_or_default()
    }

    /// When a tile came.
    pub fn received_at(&self, key: TileKey) -> Option<Monotonic> {
        self.tiles.get(&key).map(|arrival| arrival.at)
    }

    /// Which of two tiles is newer, as far as it is known by now.
    pub fn order(&self, key: TileKey) -> Option<AgeOrder> {
        let arrival = self.tiles.get(&key)?;
        Some(AgeOrder {
            has_age: !self.is_ahead(arrival),
            times_set_back: arrival.times_set_back,
            stamp_ns: arrival.stamp_ns,
        })
    }

    /// Tiles that are known.
    pub(super) fn len(&self) -> usize {
        self.tiles.len()
    }

    /// The tile is gone.
    pub(super) fn remove(&mut self, key: TileKey) {
        self.tiles.remove(&key);
    }

    /// A layer was erased.
    pub(super) fn forget(&mut self, layer: LayerId) {
        self.retain(|key| key.layer != layer);
    }

    /// All others are gone.
    pub(super) fn retain(&mut self, is_there: impl Fn(TileKey) -> bool) {
        self.tiles.retain(|key, _| is_there(*key));
        for keys in self.ahead.values_mut() {
            keys.retain(|key| is_there(*key));
        }
        self.ahead.retain(|_, keys| !keys.is_empty());
    }
}

/// From one stamp to a later one.
fn apart(later_ns: i64, earlier_ns: i64) -> Option<Duration> {
    let apart_ns = i128::from(later_ns) - i128::from(earlier_ns);
    u64::try_from(apart_ns).ok().map(Duration::from_nanos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::at;

    const SECOND_NS: i64 = 1_000_000_000;

    fn key(tx: i32) -> TileKey {
        let layer = LayerId::Occupancy;
        TileKey { layer, tx, ty: 0 }
    }

    /// Each message is behind the one before.
    fn update_clock(ages: &mut Ages, stamp_ns: i64, now: Monotonic) {
        let seq = ages.last_update.map_or(0, |(seq, _)| seq + 1);
        ages.update_clock(seq, stamp_ns, now);
    }

    fn secs(ages: &Ages, tx: i32, ms: u64) -> Option<f64> {
        ages.age(key(tx), at(ms)).map(|age| age.as_secs_f64())
    }

    #[test]
    fn what_comes_late_is_as_old_as_it_is() {
        let mut ages = Ages::default();
        update_clock(&mut ages, 100 * SECOND_NS, at(5_000));
        ages.on_tile(key(0), 60 * SECOND_NS, at(5_020));
        assert_eq!(secs(&ages, 0, 5_020), Some(40.02));
        assert_eq!(secs(&ages, 0, 8_020), Some(43.02));
        assert_eq!(ages.received_at(key(0)), Some(at(5_020)));
        // While the robot's own clock is set on, it ages on by this one.
        update_clock(&mut ages, 5_000 * SECOND_NS, at(6_000));
        assert_eq!(secs(&ages, 0, 8_020), Some(43.02));
        ages.on_tile(key(1), 4_999 * SECOND_NS, at(6_000));
        assert_eq!(secs(&ages, 1, 6_000), Some(1.0));
        assert!(ages.order(key(1)) > ages.order(key(0)));
    }

    #[test]
    fn data_that_stands_still_grows_old() {
        let mut ages = Ages::default();
        for ms in (0..=600_000).step_by(50) {
            update_clock(&mut ages, 9 * SECOND_NS, at(ms));
        }
        ages.on_tile(key(0), 8 * SECOND_NS, at(600_000));
        assert_eq!(secs(&ages, 0, 600_000), Some(601.0));
        assert_eq!(ages.before_newest(key(0)), Duration::from_secs(1));
        // It goes on, and a tile overtakes the pose of its data.
        ages.on_tile(key(1), 10 * SECOND_NS, at(600_500));
        assert_eq!(secs(&ages, 1, 600_600), Some(0.1));
        update_clock(&mut ages, 10 * SECOND_NS, at(600_600));
        assert_eq!(secs(&ages, 1, 601_500), Some(1.0));
    }

    #[test]
    fn what_a_suspended_robot_goes_on_with_is_as_old_as_its_stamps_say() {
        const MS_NS: i64 = 1_000_000;
        let mut ages = Ages::default();
        for n in 0..=40 {
            update_clock(&mut ages, 50 * MS_NS * n, at(50 * n as u64));
        }
        ages.on_tile(key(0), 1_900 * MS_NS, at(2_000));
        assert_eq!(secs(&ages, 0, 8_000), Some(6.1), "nobody knows more yet");
        // It was suspended for 7 s with a tile on its way, and another comes when it goes on.
        ages.on_tile(key(1), 1_800 * MS_NS, at(9_000));
        for n in 0..=25 {
            update_clock(
                &mut ages,
                (2_000 + 50 * n) * MS_NS,
                at(9_000 + 50 * n as u64),
            );
            if n == 10 {
                ages.on_tile(key(2), 2_400 * MS_NS, at(9_500));
            }
        }
        let old = [0, 1, 2].map(|tx| secs(&ages, tx, 10_250));
        assert_eq!(old, [Some(1.35), Some(1.45), Some(0.85)]);
        assert_eq!(secs(&ages, 1, 20_250), Some(11.45), "it ages on");
    }

    #[test]
    fn what_was_behind_a_cut_is_as_old_as_the_first_pose_says() {
        let mut ages = Ages::default();
        update_clock(&mut ages, 100 * SECOND_NS, at(0));
        // The link was gone for 30 s, and the tile comes first.
        ages.on_tile(key(0), 101 * SECOND_NS, at(30_000));
        update_clock(&mut ages, 130 * SECOND_NS, at(30_040));
        assert_eq!(secs(&ages, 0, 30_040), Some(29.0));
    }

    #[test]
    fn nobody_knows_how_old_it_is_where_the_clock_was_set_back() {
        let mut ages = Ages::default();
        update_clock(&mut ages, 3_600 * SECOND_NS, at(0));
        ages.on_tile(key(0), 3_599 * SECOND_NS, at(0));
        update_clock(&mut ages, SECOND_NS, at(1_000));
        assert_eq!(secs(&ages, 0, 1_000), Some(2.0), "this console was there");
        ages.on_tile(key(1), SECOND_NS, at(1_000));
        assert!(ages.order(key(1)) > ages.order(key(0)));
        assert_eq!(secs(&ages, 1, 1_500), Some(0.5));
        // One that comes now.
        let mut late = Ages::default();
        update_clock(&mut late, 5 * SECOND_NS, at(5_000));
        late.on_tile(key(0), 3_599 * SECOND_NS, at(5_000));
        assert_eq!(secs(&late, 0, 9_000), Some(4.0), "nothing came since");
        update_clock(&mut late, 6 * SECOND_NS, at(6_001));
        assert_eq!(secs(&late, 0, 6_001), None);
        assert_eq!(late.before_newest(key(0)), Duration::ZERO);
        assert_eq!(secs(&late, 7, 6_001), None, "it is not there");
    }

    #[test]
    fn what_is_ahead_of_the_data_is_not_the_newest() {
        let mut ages = Ages::default();
        update_clock(&mut ages, 5 * SECOND_NS, at(5_000));
        ages.on_tile(key(0), 50 * SECOND_NS, at(5_000));
        ages.on_tile(key(1), 4 * SECOND_NS, at(5_000));
        assert!(ages.order(key(0)) > ages.order(key(1)), "a pose may come");
        update_clock(&mut ages, 6 * SECOND_NS + 1, at(6_001));
        assert!(ages.order(key(0)) < ages.order(key(1)));
        // The data comes to where it was measured, or it is measured anew.
        update_clock(&mut ages, 50 * SECOND_NS, at(50_000));
        assert!(ages.order(key(0)) > ages.order(key(1)));
        ages.on_tile(key(1), 50 * SECOND_NS, at(50_000));
        assert!(ages.order(key(0)) <= ages.order(key(1)));
    }

    #[test]
    fn overtaken_messages_set_no_clock_back() {
        let mut ages = Ages::default();
        ages.update_clock(10, 100 * SECOND_NS, at(1_000));
        ages.update_clock(9, 99 * SECOND_NS, at(1_100));
        ages.on_tile(key(0), 100 * SECOND_NS, at(1_100));
        assert_eq!(secs(&ages, 0, 1_100), Some(0.1));
        let order = |times_set_back, secs| {
            Some(AgeOrder {
                has_age: true,
                times_set_back,
                stamp_ns: secs * SECOND_NS,
            })
        };
        assert_eq!(ages.order(key(0)), order(0, 100));
        ages.update_clock(11, 99 * SECOND_NS, at(1_200));
        ages.on_tile(key(1), 99 * SECOND_NS, at(1_200));
        assert_eq!(ages.order(key(1)), order(1, 99));
        // A recording that is wound back erases its maps.
        ages.restart();
        ages.on_tile(key(1), 50 * SECOND_NS, at(1_300));
        ages.update_clock(12, 50 * SECOND_NS, at(1_350));
        assert_eq!(ages.before_newest(key(1)), Duration::ZERO);
        assert_eq!(secs(&ages, 1, 1_350), Some(0.05));
    }

    #[test]
    fn what_was_erased_has_no_age() {
        let mut ages = Ages::default();
        ages.on_tile(key(0), SECOND_NS, at(0));
        ages.on_tile(key(1), 2 * SECOND_NS, at(0));
        ages.remove(key(0));
        assert_eq!((ages.len(), secs(&ages, 0, 0)), (1, None));
        ages.forget(LayerId::Occupancy);
        assert_eq!((ages.len(), ages.ahead.len()), (0, 0));
        update_clock(&mut ages, i64::MAX, at(0));
        ages.on_tile(key(0), i64::MIN, at(u64::MAX / 2_000_000));
        let oldest = ages.age(key(0), at(0)).unwrap();
        assert!(oldest > Duration::from_nanos(u64::MAX), "{oldest:?}");
    }
}
