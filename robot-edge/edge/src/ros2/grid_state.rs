//! One layer as an occupancy grid of ROS, and what of it must be published next. Pure.
//!
//! The grid covers whole tiles, so that it seldom grows. A part replaces the cells of its rectangle, whatever was there.

use std::time::Duration;

use measurement::time::{Monotonic, RobotTime};
use protocol::export::Trinary;
use protocol::layer::LayerId;
use protocol::tile::{TILE_SIDE, TileCells, TileKey};
use protocol::tile_store::TileStore;

/// The whole grid follows its updates after this time, for subscribers without updates (as those of Nav2's static layer).
const WHOLE_PERIOD: Duration = Duration::from_secs(5);

const UNKNOWN: i8 = -1;
const LETHAL: i8 = 100;
/// The greatest passable cost: 99 is "inscribed" in Nav2.
const COST_MAX: f32 = 98.0;

/// [`TILE_SIDE`] for indices.
const SIDE: i64 = 64;

/// Columns and rows of tiles: the first, and one past the last.
type TileRange = [[i64; 2]; 2];

pub(super) struct GridState {
    layer: LayerId,
    /// Of each code.
    values: Vec<i8>,
    sent: Option<Sent>,
}

#[derive(Clone, Copy, Debug)]
struct Sent {
    epoch: u32,
    revision: u64,
    range: TileRange,
    whole_at: Monotonic,
    /// Updates followed the whole.
    is_behind: bool,
}

/// A rectangle of cells.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct GridPart {
    pub(super) stamp: RobotTime,
    pub(super) cell_m: f64,
    /// Column and row of its first cell in the grid; `None`: it is the whole grid.
    pub(super) first: Option<[i32; 2]>,
    /// Of the first cell of the grid, metres.
    pub(super) origin_m: [f64; 2],
    pub(super) size: [u32; 2],
    /// In rows from the least y; −1 unknown, 0 free … 100 occupied or lethal.
    pub(super) cells: Vec<i8>,
}

/// The grid has more cells than may be published.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TooLarge;

/// Tiles of a rectangle that are copied, so that the store is locked no longer than that takes.
pub(super) struct CollectedTiles {
    stamp: RobotTime,
    cell_m: f64,
    grid: TileRange,
    part: TileRange,
    tiles: Vec<(TileKey, TileCells)>,
}

impl GridState {
    /// Of occupancy or cost.
    pub(super) fn new(layer: LayerId) -> Self {
        Self {
            layer,
            values: (0..=u16::MAX).map(|code| value(layer, code)).collect(),
            sent: None,
        }
    }

    /// What subscribers lack; `None` if they lack nothing. `is_new`: there is a new subscriber. `takes_updates`: somebody
    /// takes parts.
    pub(super) fn take_change(
        &mut self,
        store: &TileStore,
        now: Monotonic,
        (is_new, takes_updates): (bool, bool),
        max_cells: u64,
    ) -> Result<Option<CollectedTiles>, TooLarge> {
        let (epoch, revision) = (store.epoch(self.layer), store.head_revision(self.layer));
        let sent = self.sent.filter(|_| !is_new);
        let is_whole_due = |sent: &Sent| sent.is_behind && now.since(sent.whole_at) >= WHOLE_PERIOD;
        if let Some(sent) = &sent
            && (sent.epoch, sent.revision) == (epoch, revision)
            && !is_whole_due(sent)
        {
            return Ok(None);
        }
        let Some(range) = self.range(store) else {
            return Ok(None);
        };
        let base = sent.filter(|sent| {
            takes_updates && (sent.epoch, sent.range) == (epoch, range) && !is_whole_due(sent)
        });
        let part = match base {
            Some(sent) => {
                let changed = store.newer_than(self.layer, sent.revision);
                joined(changed.map(|(key, _)| key)).unwrap_or(range)
            }
            None => range,
        };
        check_size(range, max_cells)?;
        self.sent = Some(Sent {
            epoch,
            revision,
            range,
            whole_at: base.map_or(now, |sent| sent.whole_at),
            is_behind: base.is_some(),
        });
        Ok(self.part(store, range, part))
    }

    /// The whole grid, for one who subscribes late.
    pub(super) fn whole(
        &self,
        store: &TileStore,
        max_cells: u64,
    ) -> Result<Option<CollectedTiles>, TooLarge> {
        let Some(range) = self.range(store) else {
            return Ok(None);
        };
        check_size(range, max_cells)?;
        Ok(self.part(store, range, range))
    }

    pub(super) fn assemble(&self, collected: &CollectedTiles) -> GridPart {
        let CollectedTiles {
            stamp,
            cell_m,
            grid,
            part,
            ref tiles,
        } = *collected;
        let [width, height] = cells(part);
        let mut values = vec![UNKNOWN; (width * height) as usize];
        for (key, tile) in tiles {
            let [column, row] =
                [(key.tx, 0), (key.ty, 1)].map(|(at, axis)| i64::from(at) - part[0][axis]);
            for y in 0..TILE_SIDE {
                let at =
                    (row as usize * TILE_SIDE + y) * width as usize + column as usize * TILE_SIDE;
                for (value, &code) in values[at..at + TILE_SIDE].iter_mut().zip(tile.row(y)) {
                    *value = self.values[usize::from(code)];
                }
            }
        }
        let first = [0, 1].map(|axis| ((part[0][axis] - grid[0][axis]) * SIDE) as i32);
        GridPart {
            stamp,
            cell_m,
            first: (part != grid).then_some(first),
            origin_m: grid[0].map(|tile| (tile * SIDE) as f64 * cell_m),
            size: [width, height].map(|cells| cells as u32),
            cells: values,
        }
    }

    /// Where there are tiles; after an erasure, where there were.
    fn range(&self, store: &TileStore) -> Option<TileRange> {
        let tiles = store.tiles(self.layer);
        let known = tiles.filter(|(_, stored)| stored.cells().is_some());
        joined(known.map(|(key, _)| key)).or(self.sent.map(|sent| sent.range))
    }

    fn part(&self, store: &TileStore, grid: TileRange, part: TileRange) -> Option<CollectedTiles> {
        let is_inside = |key: &TileKey| {
            let [[x, y], [end_x, end_y]] = part;
            (x..end_x).contains(&key.tx.into()) && (y..end_y).contains(&key.ty.into())
        };
        let mut stamp = RobotTime::MIN;
        let mut tiles = Vec::new();
        for (key, stored) in store.tiles(self.layer) {
            stamp = stamp.max(RobotTime::from_nanos(stored.stamp_ns()));
            if let Some(cells) = stored.cells()
                && is_inside(&key)
            {
                tiles.push((key, cells.clone()));
            }
        }
        Some(CollectedTiles {
            stamp,
            cell_m: store.cell_m(self.layer)?,
            // A part that reaches beyond, where a tile was evicted, is no part of this grid: all of it is sent.
            part: if is_within(part, grid) { part } else { grid },
            grid,
            tiles,
        })
    }
}

fn joined(keys: impl Iterator<Item = TileKey>) -> Option<TileRange> {
    let ranges = keys.map(|key| {
        let [x, y] = [key.tx, key.ty].map(i64::from);
        [[x, y], [x + 1, y + 1]]
    });
    ranges.reduce(|[a, a_end], [b, b_end]| {
        [
            [0, 1].map(|axis| a[axis].min(b[axis])),
            [0, 1].map(|axis| a_end[axis].max(b_end[axis])),
        ]
    })
}

fn is_within([first, end]: TileRange, [outer, outer_end]: TileRange) -> bool {
    (0..2).all(|axis| outer[axis] <= first[axis] && end[axis] <= outer_end[axis])
}

/// Columns and rows.
fn cells([first, end]: TileRange) -> [u64; 2] {
    [0, 1].map(|axis| end[axis].abs_diff(first[axis]) * TILE_SIDE as u64)
}

fn check_size(range: TileRange, max_cells: u64) -> Result<(), TooLarge> {
    let [width, height] = cells(range);
    let is_small = width
        .checked_mul(height)
        .is_some_and(|cells| cells <= max_cells);
    if is_small { Ok(()) } else { Err(TooLarge) }
}

/// Occupancy as `map_server` reads our export (trinary); cost by the scale of Nav2's costmaps.
fn value(layer: LayerId, code: u16) -> i8 {
    let Some(value) = layer.quantisation().decode(code) else {
        return UNKNOWN;
    };
    if layer == LayerId::Cost {
        return if value >= 1.0 {
            LETHAL
        } else {
            (value * COST_MAX).round() as i8
        };
    }
    match Trinary::of(value) {
        Trinary::Occupied => LETHAL,
        Trinary::Free => 0,
        Trinary::Undecided => UNKNOWN,
    }
}

#[cfg(test)]
mod tests;
