//! Age of each map tile, from the robot's stamps. A console that joins late shows the age of the data, not of its
//! arrival.
//!
//! Stamps come from the robot's sensor clock and are never compared with a clock of this machine. Only the difference
//! of two stamps counts: the stamp of the tile and the newest stamp that had arrived with it. From then on this
//! machine's clock adds to the age, so a step of the robot's clock does not change it.

use std::collections::BTreeMap;
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::layer::LayerId;
use protocol::tile::TileKey;

/// A pose with the stamp of a tile's data, or a newer one, arrives within this time.
const POSE_TIMEOUT: Duration = Duration::from_secs(1);

/// Limit of stamps that are ahead of the newest pose.
const MAX_AHEAD: usize = 10_000;

/// Newer data is greater, also across a clock that was set back. Tiles that stay ahead of the data are least.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct AgeOrder {
    has_age: bool,
    times_set_back: u32,
    stamp_ns: i64,
}

#[derive(Clone, Debug, Default)]
pub struct TileAges {
    /// The newest stamp, nanoseconds, and when it first arrived.
    newest: Option<(i64, Monotonic)>,
    /// Sequence number of the newest message with a stamp, and when it arrived.
    last_update: Option<(u64, Monotonic)>,
    clock_stall: ClockStallDetector,
    times_set_back: u32,
    tiles: BTreeMap<TileKey, TileArrival>,
    /// Tiles whose stamp is newer than the newest pose, by stamp. Their age is still unknown.
    ahead: BTreeMap<i64, Vec<TileKey>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct TileArrival {
    stamp_ns: i64,
    at: Monotonic,
    before: Option<Duration>,
    /// Time that the data's clock stood still since.
    stalled: Duration,
    times_set_back: u32,
}

impl TileArrival {
    fn age(&self, now: Monotonic) -> Option<Duration> {
        let age = now.since(self.at).saturating_add(self.before?);
        Some(age.saturating_sub(self.stalled))
    }
}

impl TileAges {
    pub(super) fn update_clock(&mut self, seq: u64, stamp_ns: i64, now: Monotonic) {
        if self
            .last_update
            .is_some_and(|(newest_seq, _)| seq < newest_seq)
        {
            // A newer message has overtaken this one: poses are not retransmitted in order.
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

    /// Corrects the ages that were counted while the data's clock stood still.
    fn stalled(&mut self, stalled: ClockStall, now: Monotonic) {
        let since = now.since(stalled.from);
        for arrival in self.tiles.values_mut() {
            if arrival.age(now).is_some_and(|age| age >= since) {
                arrival.stalled += stalled.time;
            }
        }
    }

    /// The data's time restarts: a recording was seeked or maps were erased.
    pub(super) fn restart(&mut self) {
        self.newest = None;
        self.clock_stall = ClockStallDetector::default();
    }

    pub(super) fn on_tile(&mut self, key: TileKey, stamp_ns: i64, now: Monotonic) {
        let before = self.newest.and_then(|(newest_ns, last_update)| {
            // The data has advanced since the newest stamp.
            Some(apart(newest_ns, stamp_ns)?.saturating_add(now.since(last_update)))
        });
        if before.is_none() {
            self.ahead.entry(stamp_ns).or_default().push(key);
            if self.ahead.len() > MAX_AHEAD {
                // The most recent stamps: the others are resolved first.
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

    /// Age of a tile; `None` if it is unknown because the data's clock was set back behind it.
    pub fn age(&self, key: TileKey, now: Monotonic) -> Option<Duration> {
        let arrival = self.tiles.get(&key)?;
        arrival
            .age(now)
            .or_else(|| (!self.is_ahead(arrival)).then(|| now.since(arrival.at)))
    }

    /// Whether the data goes on but has not reached the stamp of a tile.
    fn is_ahead(&self, arrival: &TileArrival) -> bool {
        let last_update = self
            .last_update
            .map(|(_, last_update)| last_update.since(arrival.at));
        arrival.before.is_none() && last_update > Some(POSE_TIMEOUT)
    }

    /// How much older than the newest data a tile is.
    pub fn before_newest(&self, key: TileKey) -> Duration {
        let both = self.newest.zip(self.tiles.get(&key));
        let apart = both.and_then(|((newest_ns, _), arrival)| apart(newest_ns, arrival.stamp_ns));
        apart.unwrap_or_default()
    }

    pub fn received_at(&self, key: TileKey) -> Option<Monotonic> {
        self.tiles.get(&key).map(|arrival| arrival.at)
    }

    pub fn order(&self, key: TileKey) -> Option<AgeOrder> {
        let arrival = self.tiles.get(&key)?;
        Some(AgeOrder {
            has_age: !self.is_ahead(arrival),
            times_set_back: arrival.times_set_back,
            stamp_ns: arrival.stamp_ns,
        })
    }

    pub(super) fn len(&self) -> usize {
        self.tiles.len()
    }

    pub(super) fn remove(&mut self, key: TileKey) {
        self.tiles.remove(&key);
    }

    pub(super) fn forget(&mut self, layer: LayerId) {
        self.retain(|key| key.layer != layer);
    }

    /// Removes all other tiles.
    pub(super) fn retain(&mut self, is_there: impl Fn(TileKey) -> bool) {
        self.tiles.retain(|key, _| is_there(*key));
        for keys in self.ahead.values_mut() {
            keys.retain(|key| is_there(*key));
        }
        self.ahead.retain(|_, keys| !keys.is_empty());
    }
}

fn apart(later_ns: i64, earlier_ns: i64) -> Option<Duration> {
    let apart_ns = i128::from(later_ns) - i128::from(earlier_ns);
    u64::try_from(apart_ns).ok().map(Duration::from_nanos)
}

/// Poses and statuses arrive more often.
const SILENT_AFTER: Duration = Duration::from_secs(1);
/// Stamps are observed for this long after a silence.
const OBSERVATION_TIME: Duration = Duration::from_secs(1);
/// Stamps may run ahead of this machine's clock by this much after a silence: the last one before it may be lost.
const SLACK: Duration = Duration::from_millis(500);

/// Detects that the data's clock stood still while the robot was silent, for example because its program was suspended.
/// Then nothing was measured meanwhile, and tiles are no older than their stamps say.
///
/// After a link failure the data has gone on: stamps are later by the length of the silence, or arrive in a burst. So
/// the detector observes the stamps for a while before it decides.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ClockStallDetector(Option<Silence>);

#[derive(Clone, Copy, Debug)]
struct Silence {
    from: Monotonic,
    to: Monotonic,
    /// The newest stamp before it, nanoseconds.
    stamp_ns: i64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ClockStall {
    pub(super) from: Monotonic,
    pub(super) time: Duration,
}

impl ClockStallDetector {
    /// `last` is the newest stamp before this one and when it arrived. Returns a stall once for each silence.
    pub(super) fn update(
        &mut self,
        last: Option<(i64, Monotonic)>,
        stamp_ns: i64,
        now: Monotonic,
    ) -> Option<ClockStall> {
        if let Some((stamp_ns, from)) = last.filter(|(_, from)| now.since(*from) > SILENT_AFTER) {
            let to = now;
            self.0 = Some(Silence { from, to, stamp_ns });
        }
        let silence = self.0?;
        let since = now.since(silence.to);
        let went = apart(stamp_ns, silence.stamp_ns).filter(|went| *went <= since + SLACK);
        let Some(went) = went else {
            // The clock was set or went on.
            self.0 = None;
            return None;
        };
        // A dead sensor also stops the stamps while the robot sends: that is no stall.
        if since < OBSERVATION_TIME || went < since / 2 {
            return None;
        }
        self.0 = None;
        Some(ClockStall {
            from: silence.from,
            time: silence.to.since(silence.from),
        })
    }
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

    fn update_clock(ages: &mut TileAges, stamp_ns: i64, now: Monotonic) {
        let seq = ages.last_update.map_or(0, |(seq, _)| seq + 1);
        ages.update_clock(seq, stamp_ns, now);
    }

    fn secs(ages: &TileAges, tx: i32, ms: u64) -> Option<f64> {
        ages.age(key(tx), at(ms)).map(|age| age.as_secs_f64())
    }

    #[test]
    fn late_tile_has_the_age_of_its_data() {
        let mut ages = TileAges::default();
        update_clock(&mut ages, 100 * SECOND_NS, at(5_000));
        ages.on_tile(key(0), 60 * SECOND_NS, at(5_020));
        assert_eq!(secs(&ages, 0, 5_020), Some(40.02));
        assert_eq!(secs(&ages, 0, 8_020), Some(43.02));
        assert_eq!(ages.received_at(key(0)), Some(at(5_020)));
        // The robot's clock steps forward; the tile still ages by this machine's clock.
        update_clock(&mut ages, 5_000 * SECOND_NS, at(6_000));
        assert_eq!(secs(&ages, 0, 8_020), Some(43.02));
        ages.on_tile(key(1), 4_999 * SECOND_NS, at(6_000));
        assert_eq!(secs(&ages, 1, 6_000), Some(1.0));
        assert!(ages.order(key(1)) > ages.order(key(0)));
    }

    #[test]
    fn age_grows_while_data_stands_still() {
        let mut ages = TileAges::default();
        for ms in (0..=600_000).step_by(50) {
            update_clock(&mut ages, 9 * SECOND_NS, at(ms));
        }
        ages.on_tile(key(0), 8 * SECOND_NS, at(600_000));
        assert_eq!(secs(&ages, 0, 600_000), Some(601.0));
        assert_eq!(ages.before_newest(key(0)), Duration::from_secs(1));
        // The data goes on, and a tile overtakes the pose of its data.
        ages.on_tile(key(1), 10 * SECOND_NS, at(600_500));
        assert_eq!(secs(&ages, 1, 600_600), Some(0.1));
        update_clock(&mut ages, 10 * SECOND_NS, at(600_600));
        assert_eq!(secs(&ages, 1, 601_500), Some(1.0));
    }

    #[test]
    fn tiles_of_suspended_robot_have_age_of_stamps() {
        const MS_NS: i64 = 1_000_000;
        let mut ages = TileAges::default();
        for n in 0..=40 {
            update_clock(&mut ages, 50 * MS_NS * n, at(50 * n as u64));
        }
        ages.on_tile(key(0), 1_900 * MS_NS, at(2_000));
        assert_eq!(secs(&ages, 0, 8_000), Some(6.1), "no newer stamp yet");
        // The robot was suspended for 7 s. One tile was in flight and another comes after it resumes.
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
    fn tile_after_link_failure_gets_age_from_first_pose() {
        let mut ages = TileAges::default();
        update_clock(&mut ages, 100 * SECOND_NS, at(0));
        // The link was gone for 30 s, and a tile arrives first.
        ages.on_tile(key(0), 101 * SECOND_NS, at(30_000));
        update_clock(&mut ages, 130 * SECOND_NS, at(30_040));
        assert_eq!(secs(&ages, 0, 30_040), Some(29.0));
    }

    #[test]
    fn age_is_unknown_after_clock_was_set_back() {
        let mut ages = TileAges::default();
        update_clock(&mut ages, 3_600 * SECOND_NS, at(0));
        ages.on_tile(key(0), 3_599 * SECOND_NS, at(0));
        update_clock(&mut ages, SECOND_NS, at(1_000));
        assert_eq!(secs(&ages, 0, 1_000), Some(2.0), "this console was there");
        ages.on_tile(key(1), SECOND_NS, at(1_000));
        assert!(ages.order(key(1)) > ages.order(key(0)));
        assert_eq!(secs(&ages, 1, 1_500), Some(0.5));
        // A console that joins now.
        let mut late = TileAges::default();
        update_clock(&mut late, 5 * SECOND_NS, at(5_000));
        late.on_tile(key(0), 3_599 * SECOND_NS, at(5_000));
        assert_eq!(secs(&late, 0, 9_000), Some(4.0), "nothing came since");
        update_clock(&mut late, 6 * SECOND_NS, at(6_001));
        assert_eq!(secs(&late, 0, 6_001), None);
        assert_eq!(late.before_newest(key(0)), Duration::ZERO);
        assert_eq!(secs(&late, 7, 6_001), None, "it is not there");
    }

    #[test]
    fn tile_ahead_of_the_data_is_not_newest() {
        let mut ages = TileAges::default();
        update_clock(&mut ages, 5 * SECOND_NS, at(5_000));
        ages.on_tile(key(0), 50 * SECOND_NS, at(5_000));
        ages.on_tile(key(1), 4 * SECOND_NS, at(5_000));
        assert!(ages.order(key(0)) > ages.order(key(1)), "a pose may come");
        update_clock(&mut ages, 6 * SECOND_NS + 1, at(6_001));
        assert!(ages.order(key(0)) < ages.order(key(1)));
        // The data reaches the stamp of the tile, or the tile is measured again.
        update_clock(&mut ages, 50 * SECOND_NS, at(50_000));
        assert!(ages.order(key(0)) > ages.order(key(1)));
        ages.on_tile(key(1), 50 * SECOND_NS, at(50_000));
        assert!(ages.order(key(0)) <= ages.order(key(1)));
    }

    #[test]
    fn overtaken_messages_set_no_clock_back() {
        let mut ages = TileAges::default();
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
        // Seeking back in a recording erases its maps.
        ages.restart();
        ages.on_tile(key(1), 50 * SECOND_NS, at(1_300));
        ages.update_clock(12, 50 * SECOND_NS, at(1_350));
        assert_eq!(ages.before_newest(key(1)), Duration::ZERO);
        assert_eq!(secs(&ages, 1, 1_350), Some(0.05));
    }

    #[test]
    fn erased_tile_has_no_age() {
        let mut ages = TileAges::default();
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

    /// The result for these arrival times and stamps, both in milliseconds.
    fn found(samples: impl IntoIterator<Item = (u64, i64)>) -> Option<ClockStall> {
        let mut clock_stall = ClockStallDetector::default();
        let mut last = None;
        samples.into_iter().find_map(|(ms, stamp_ms)| {
            let stamp_ns = stamp_ms * 1_000_000;
            let stalled = clock_stall.update(last, stamp_ns, at(ms));
            last = Some((stamp_ns, at(ms)));
            stalled
        })
    }

    /// Messages until 2 s and from 9 s on: first with the stamp `then_ms`, then later by `step_ms` every 50 ms.
    fn behind_silence(then_ms: i64, step_ms: i64) -> Option<ClockStall> {
        let before = (0..=40).map(|n: u32| (50 * u64::from(n), 50 * i64::from(n)));
        let after = (0..100).map(|n: u32| {
            let ms = 9_000 + 50 * u64::from(n);
            (ms, then_ms + step_ms * i64::from(n))
        });
        found(before.chain(after))
    }

    #[test]
    fn clock_that_resumes_was_stalled() {
        let stalled = ClockStall {
            from: at(2_000),
            time: Duration::from_secs(7),
        };
        assert_eq!(behind_silence(2_000, 50), Some(stalled));
        assert_eq!(behind_silence(2_050, 50), Some(stalled));
    }

    #[test]
    fn running_or_set_clock_was_not_stalled() {
        assert_eq!(behind_silence(9_000, 50), None, "the link was cut");
        assert_eq!(behind_silence(2_050, 400), None, "a heap that waited");
        assert_eq!(behind_silence(1_000, 50), None, "it was set back");
        assert_eq!(behind_silence(2_000, 0), None, "a sensor is dead");
        assert_eq!(behind_silence(5_500, 25), None, "at half the speed");
    }
}
