//! The map that is announced to consoles: it follows the tile store in short rounds where an operator sees the change, and seldom elsewhere.
//!
//! Map heads, lists of digests and replies describe this map, so a console that has what was pushed is synchronized and requests
//! nothing. What is held back is announced in time, and at once when nothing changes any more.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use protocol::message::View;
use protocol::tile::{TILE_SIDE, TileCells, TileKey};
use protocol::tile_store::{Publication, StoredTile, TileStore};

use crate::lock;
use crate::publishing::cells_to_tiles::with_visible_changes;
use measurement::time::Monotonic;

/// Nearer to the vehicle visible changes are announced in each round, metres.
const NEAR_M: f64 = 20.0;
/// Interval of announcements of all cells of a tile, up to the next round. With the time to push them, everything is sent 15 s after the
/// last change.
const HOLD: Duration = Duration::from_secs(11);
/// Interval of announcements of visible changes, of all tiles at once, so that messages are few: they are 2 s old at most.
const ROUND: Duration = Duration::from_millis(1900);
/// Of the tiles near the vehicle that have not changed for this long, so many are announced whole each second, the longest unchanged
/// first: where little goes on, what is shown is 2 s old at most.
const SETTLED: Duration = Duration::from_secs(1);
const SETTLED_AT_ONCE: usize = 4;
/// If nothing has changed for this long, nothing is held back.
const QUIET: Duration = Duration::from_secs(3);

/// Where changes are wanted in each round.
#[derive(Clone, Debug, Default)]
pub struct Attention {
    /// In `odom`, metres; everywhere is near if it is unknown.
    pub vehicle_m: Option<[f64; 2]>,
    pub views: Vec<View>,
}

#[derive(Debug)]
pub struct AnnouncedMap {
    /// All that is mapped.
    source: Arc<Mutex<TileStore>>,
    announced: Arc<Mutex<TileStore>>,
    /// Tiles with cells that changed since they were announced, and when they last changed.
    held: BTreeMap<TileKey, Monotonic>,
    /// When all cells of tiles were announced, if they were lately.
    announced_at: BTreeMap<TileKey, Monotonic>,
    last_round: Option<Monotonic>,
    last_settled: Option<Monotonic>,
    last_change: Option<Monotonic>,
}

impl AnnouncedMap {
    /// Everything of `source` is announced.
    pub fn new(source: Arc<Mutex<TileStore>>) -> Self {
        let announced = lock(&source).clone();
        Self {
            source,
            announced: Arc::new(Mutex::new(announced)),
            held: BTreeMap::new(),
            announced_at: BTreeMap::new(),
            last_round: None,
            last_settled: None,
            last_change: None,
        }
    }

    /// The store that is announced to consoles.
    pub fn announced(&self) -> Arc<Mutex<TileStore>> {
        Arc::clone(&self.announced)
    }

    /// Tiles that are held back.
    pub fn held(&self) -> usize {
        self.held.len()
    }

    /// Takes changed tiles; returns those that are announced now, to be pushed.
    pub fn update(
        &mut self,
        changed: BTreeSet<TileKey>,
        attention: &Attention,
        now: Monotonic,
    ) -> Vec<TileKey> {
        self.adopt_epochs(attention);
        let is_settled_due = self.last_settled.is_none_or(|at| now.since(at) >= SETTLED);
        let round_at = *self.last_round.get_or_insert(now);
        let is_round_due = now.since(round_at) >= ROUND;
        if !changed.is_empty() {
            self.last_change = Some(now);
        } else if !is_settled_due && !is_round_due {
            return Vec::new();
        }
        if is_round_due {
            self.last_round = Some(now);
        }
        let is_quiet = self.last_change.is_none_or(|at| now.since(at) >= QUIET);
        self.held.extend(changed.into_iter().map(|key| (key, now)));
        let settled = if is_settled_due {
            self.last_settled = Some(now);
            self.settled(attention, now)
        } else {
            Vec::new()
        };
        self.announced_at
            .retain(|_, at| now.since(*at) < HOLD + ROUND);
        let mut pushed = Vec::new();
        for (key, changed_at) in std::mem::take(&mut self.held) {
            let at = self.announced_at.entry(key).or_insert(now);
            let is_hold_over = is_round_due && now.since(*at) >= HOLD;
            let part = if is_quiet || is_hold_over || *at == now || settled.contains(&key) {
                *at = now;
                Part::Whole
            } else if is_round_due {
                self.part(key, attention)
            } else {
                Part::Nothing
            };
            if !self.announce(key, part, &mut pushed) {
                self.held.insert(key, changed_at);
            }
        }
        pushed
    }

    /// Announces everything; returns the tiles to be pushed.
    pub fn announce_all(&mut self, changed: BTreeSet<TileKey>) -> Vec<TileKey> {
        self.adopt_epochs(&Attention::default());
        let held = std::mem::take(&mut self.held).into_keys();
        let mut pushed = Vec::new();
        for key in held.chain(changed).collect::<BTreeSet<_>>() {
            self.announce(key, Part::Whole, &mut pushed);
        }
        pushed
    }

    /// Announces erasures. What follows them is new, and does not wait.
    fn adopt_epochs(&mut self, attention: &Attention) {
        let source = lock(&self.source);
        let mut announced = lock(&self.announced);
        for layer in source.grids().map(|grid| grid.layer) {
            let epoch = source.epoch(layer);
            if epoch != announced.epoch(layer) {
                announced.adopt_epoch(layer, epoch);
                self.announced_at.retain(|key, _| key.layer != layer);
            }
        }
        if let Some(vehicle_m) = attention.vehicle_m {
            announced.set_focus(vehicle_m);
        }
    }

    /// The tiles that have not changed for [`SETTLED`] and are announced now.
    fn settled(&self, attention: &Attention, now: Monotonic) -> Vec<TileKey> {
        let held = self
            .held
            .iter()
            .map(|(key, changed_at)| (*changed_at, *key));
        let settled = held.filter(|(changed_at, key)| {
            now.since(*changed_at) >= SETTLED && self.is_near(*key, attention)
        });
        let mut settled: Vec<_> = settled.collect();
        settled.sort_unstable();
        settled.truncate(SETTLED_AT_ONCE);
        settled.into_iter().map(|(_, key)| key).collect()
    }

    /// Least and greatest corner of a tile in `odom`, metres; `None` if its layer is not announced.
    fn corners_m(&self, key: TileKey) -> Option<[[f64; 2]; 2]> {
        let side_m = TILE_SIDE as f64 * lock(&self.announced).cell_m(key.layer)?;
        Some(
            [0, 1].map(|far| {
                [key.tx, key.ty].map(|index| (f64::from(index) + f64::from(far)) * side_m)
            }),
        )
    }

    fn is_near(&self, key: TileKey, attention: &Attention) -> bool {
        let (Some(vehicle_m), Some([low_m, high_m])) = (attention.vehicle_m, self.corners_m(key))
        else {
            return true;
        };
        let apart_m = [0, 1]
            .map(|axis: usize| (low_m[axis] - vehicle_m[axis]).max(vehicle_m[axis] - high_m[axis]));
        libm::hypot(apart_m[0].max(0.0), apart_m[1].max(0.0)) <= NEAR_M
    }

    /// What of a tile may not wait.
    fn part(&self, key: TileKey, attention: &Attention) -> Part {
        let views = attention.views.iter();
        let mut views = views
            .filter(|view| view.layers & (1 << key.layer as u32) != 0)
            .peekable();
        // Of what no console shows, nothing is pushed.
        let (Some(_), Some([low_m, high_m])) = (views.peek(), self.corners_m(key)) else {
            return Part::Whole;
        };
        let mut is_in_view = || {
            views.any(|view| {
                let [low_x, low_y, high_x, high_y] = view.rectangle_m.map(f64::from);
                low_m[0] <= high_x && high_m[0] >= low_x && low_m[1] <= high_y && high_m[1] >= low_y
            })
        };
        if self.is_near(key, attention) || is_in_view() {
            Part::Visible
        } else {
            Part::Nothing
        }
    }

    /// Announces this part of a tile, which is pushed if that changes it. Returns whether all of its cells are announced now.
    fn announce(&self, key: TileKey, part: Part, pushed: &mut Vec<TileKey>) -> bool {
        if part == Part::Nothing {
            return false;
        }
        // Mapping waits for this lock: one tile at a time.
        let source = lock(&self.source);
        let stored = source.get(key);
        let stamp_ns = stored.map_or(0, StoredTile::stamp_ns);
        let cells = stored.and_then(StoredTile::cells).cloned();
        drop(source);
        let whole = cells.unwrap_or_else(TileCells::unknown);
        let mut announced = lock(&self.announced);
        let before = announced.get(key).and_then(StoredTile::cells);
        let cells = match before.filter(|_| part == Part::Visible) {
            Some(before) => with_visible_changes(key.layer, before, &whole),
            None => whole.clone(),
        };
        let is_whole = cells == whole;
        announced.set_stamp(stamp_ns);
        match announced.publish(key, cells) {
            Ok(Publication::Published { evicted, .. }) => {
                pushed.push(key);
                pushed.extend(evicted);
            }
            Ok(Publication::Unchanged) => {}
            Err(why) => tracing::error!(%why, "a tile was not announced"),
        }
        is_whole
    }
}

/// What of a tile is announced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Nothing,
    /// Cells that changed so much that an operator sees it.
    Visible,
    Whole,
}

#[cfg(test)]
mod tests {
    use protocol::layer::LayerId;
    use protocol::tile::BootId;
    use protocol::tile_store::LayerGrid;

    use super::*;
    use crate::publishing::cells_to_tiles::{tile_of, uniform_tile};

    const CELL_M: f64 = 0.1;
    const FAR: i32 = 10;

    fn at(s: u64) -> Monotonic {
        Monotonic::from_nanos(s * 1_000_000_000)
    }

    fn view(to_x: f32, layers: u32) -> View {
        View {
            rectangle_m: [-5.0, -5.0, to_x, 5.0],
            layers,
            revision: 0,
            is_synchronized: false,
            wants_scan: false,
        }
    }

    struct Rig {
        map: AnnouncedMap,
        attention: Attention,
    }

    impl Rig {
        fn new(views: Vec<View>) -> Self {
            let mut store = TileStore::new(BootId([1; 16]), 10);
            for layer in [LayerId::Occupancy, LayerId::Obstacle] {
                let grid = LayerGrid {
                    layer,
                    cell_m: CELL_M,
                };
                store.set_grid(grid).unwrap();
            }
            let vehicle_m = Some([6.0, 3.0]);
            Self {
                map: AnnouncedMap::new(Arc::new(Mutex::new(store))),
                attention: Attention { vehicle_m, views },
            }
        }

        fn publish(&mut self, key: TileKey, cells: TileCells) -> BTreeSet<TileKey> {
            let mut source = self.map.source.lock().unwrap();
            drop(source.publish(key, cells).unwrap());
            BTreeSet::from([key])
        }

        fn is_all_announced(&self, layer: LayerId) -> bool {
            let [source, announced] = [&self.map.source, &self.map.announced]
                .map(|store| store.lock().unwrap().root_digest(layer));
            source == announced && self.map.held() == 0
        }
    }

    #[test]
    fn far_tiles_are_announced_seldom_and_all_when_nothing_changes() {
        let (wavers, flips) = ([100, 112, 124], [100, 125, 150]);
        let all = u32::MAX;
        let here = || vec![view(20.0, all)];
        let wide = || vec![view(0.0, all), view(80.0, all)];
        let (seldom, often) = (vec![0, 12, 24], (0..27).step_by(2).collect::<Vec<u64>>());
        let cases = [
            // 19.6 m, 26 m and 25.2 m from the vehicle.
            (LayerId::Occupancy, 4, flips, here(), &often),
            (LayerId::Occupancy, 4, wavers, here(), &seldom),
            (LayerId::Occupancy, 5, flips, here(), &seldom),
            (LayerId::Occupancy, -4, flips, here(), &seldom),
            (LayerId::Occupancy, FAR, flips, wide(), &often),
            (LayerId::Occupancy, FAR, wavers, wide(), &seldom),
            (LayerId::Occupancy, FAR, [1, 0, 200], wide(), &often),
            (LayerId::Obstacle, FAR, [1, 2, 0], wide(), &often),
            (LayerId::Obstacle, FAR, [1, 2, 0], here(), &seldom),
            // Nobody looks at it.
            (LayerId::Occupancy, FAR, flips, vec![view(80.0, 0)], &often),
            (LayerId::Occupancy, FAR, flips, Vec::new(), &often),
        ];
        for (layer, tx, codes, views, expected) in cases {
            let key = TileKey { layer, tx, ty: 0 };
            let case = format!("{key} {codes:?} {views:?}");
            let mut rig = Rig::new(views);
            let mut announced = Vec::new();
            for s in 0..27 {
                let changed = rig.publish(key, uniform_tile(codes[s as usize % 5 / 2]));
                if !rig.map.update(changed, &rig.attention, at(s)).is_empty() {
                    announced.push(s);
                }
            }
            assert_eq!(announced, *expected, "{case}");
            assert_eq!(rig.is_all_announced(layer), expected == &often, "{case}");
            for s in 27..30 {
                rig.map.update(BTreeSet::new(), &rig.attention, at(s));
            }
            assert!(rig.is_all_announced(layer), "{case}");
        }
    }

    #[test]
    fn a_tile_nearby_that_has_settled_is_announced_whole() {
        for (tx, announced) in [(4, [0, 3]), (5, [0, 6])] {
            let layer = LayerId::Occupancy;
            let key = TileKey { layer, tx, ty: 0 };
            let other = TileKey { ty: 9, ..key };
            let mut rig = Rig::new(vec![view(20.0, u32::MAX)]);
            let announces = |rig: &mut Rig, s: u64| {
                let mut changed = BTreeSet::new();
                if s < 4 {
                    // Something else goes on.
                    changed.extend(rig.publish(other, uniform_tile(s as u16)));
                }
                if s < 3 {
                    // It wavers.
                    changed.extend(rig.publish(key, uniform_tile(100 + s as u16)));
                }
                let pushed = rig.map.update(changed, &rig.attention, at(s));
                pushed.contains(&key)
            };
            let times: Vec<_> = (0..9).filter(|&s| announces(&mut rig, s)).collect();
            assert_eq!(times, announced, "{tx}");
        }
    }

    #[test]
    fn of_a_tile_nearby_the_visible_changes_are_announced_first() {
        let key = TileKey {
            layer: LayerId::Occupancy,
            tx: 0,
            ty: 0,
        };
        let mut rig = Rig::new(vec![view(20.0, u32::MAX)]);
        let announced = |rig: &mut Rig, s, codes: [u16; 4]| {
            let cells = tile_of(|x, y| if y == 0 && x < 4 { codes[x] } else { 9 });
            let changed = rig.publish(key, cells);
            let pushed = rig.map.update(changed, &rig.attention, at(s));
            let store = rig.map.announced.lock().unwrap();
            let cells = store.get(key).unwrap().cells().unwrap();
            let codes: [u16; 4] = cells.codes()[..4].try_into().unwrap();
            (pushed.len(), codes, rig.map.held())
        };
        for (s, mapped, pushed, shown, held) in [
            (0, [0, 50, 60, 70], 1, [0, 50, 60, 70], 0),
            (2, [1, 0, 85, 94], 1, [1, 0, 85, 70], 1),
            (4, [1, 0, 85, 93], 0, [1, 0, 85, 70], 1),
            // It moved on a little each time.
            (6, [1, 0, 85, 95], 1, [1, 0, 85, 95], 0),
            (8, [1, 0, 84, 95], 0, [1, 0, 85, 95], 1),
            (12, [1, 0, 84, 95], 1, [1, 0, 84, 95], 0),
        ] {
            assert_eq!(
                announced(&mut rig, s, mapped),
                (pushed, shown, held),
                "{s} s"
            );
        }
        assert!(rig.is_all_announced(LayerId::Occupancy));
        // An erasure is announced at once, and what is mapped after it.
        let erased = rig
            .map
            .source
            .lock()
            .unwrap()
            .erase_layer(LayerId::Occupancy);
        rig.map.update(BTreeSet::new(), &rig.attention, at(13));
        let store = rig.map.announced();
        let is_announced = |tiles| {
            let store = store.lock().unwrap();
            let epoch = store.epoch(LayerId::Occupancy);
            (epoch, store.tile_count(LayerId::Occupancy)) == (erased.clone().unwrap(), tiles)
        };
        assert!(is_announced(0));
        assert_eq!(announced(&mut rig, 14, [1, 0, 84, 96]).2, 0);
        assert!(is_announced(1));
    }
}
