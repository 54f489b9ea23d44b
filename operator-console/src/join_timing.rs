//! How long after discovery what was there: the figures by which a join is judged.

use robot_edge::clock;
use std::io::{self, Write};
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::layer::LayerId;
use protocol::tile::TileKey;

use crate::model::ConsoleModel;

/// Half the side of the square around the vehicle that counts as the visible area, metres.
pub(crate) const VISIBLE_M: f64 = 20.0;

/// When what was first there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JoinTiming {
    discovered: Monotonic,
    pose: Option<Duration>,
    tile: Option<Duration>,
    synchronized: Option<Duration>,
}

impl JoinTiming {
    pub(crate) const fn new(discovered: Monotonic) -> Self {
        Self {
            discovered,
            pose: None,
            tile: None,
            synchronized: None,
        }
    }

    /// Looks at the model as it is now.
    pub(crate) fn update(&mut self, model: &ConsoleModel, is_synchronized: bool) {
        let after = clock::elapsed(self.discovered);
        let note = |milestone: &mut Option<Duration>, is_there: bool| {
            if is_there {
                milestone.get_or_insert(after);
            }
        };
        note(&mut self.pose, model.vehicle().pose().is_some());
        let has_tiles = |layer| model.map().store().tiles(layer).next().is_some();
        note(&mut self.tile, LayerId::ALL.into_iter().any(has_tiles));
        note(&mut self.synchronized, is_synchronized);
    }

    /// Says them, with when the last of the tiles near the vehicle came, which tells something only where the
    /// map stood still.
    pub(crate) fn print(&self, model: &ConsoleModel, out: &mut dyn Write) -> io::Result<()> {
        for (what, after) in [
            ("first pose", self.pose),
            ("first tile", self.tile),
            ("visible area", self.visible_area(model)),
            ("synchronized", self.synchronized),
        ] {
            if let Some(after) = after {
                writeln!(
                    out,
                    "{what}: {:.0} ms after discovery",
                    after.as_secs_f64() * 1e3
                )?;
            }
        }
        Ok(())
    }

    fn visible_area(&self, model: &ConsoleModel) -> Option<Duration> {
        let (pose, _) = model.vehicle().pose()?;
        let [x, y, _] = pose.position_m;
        let map = model.map();
        let is_near = |key: TileKey, cell_m: f64| {
            let [tile_x, tile_y] = key.center_m(cell_m);
            (tile_x - x).abs() <= VISIBLE_M && (tile_y - y).abs() <= VISIBLE_M
        };
        let near = map.store().grids().flat_map(|grid| {
            let tiles = map.store().tiles(grid.layer).map(|(key, _)| key);
            tiles.filter(move |key| is_near(*key, grid.cell_m))
        });
        let last = near.filter_map(|key| map.ages().received_at(key)).max()?;
        Some(last.since(self.discovered))
    }
}
