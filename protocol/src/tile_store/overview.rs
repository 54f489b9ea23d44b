//! Overviews: tiles with an eighth of the resolution, so that a console that joins soon shows all that is mapped near the vehicle.

use std::collections::BTreeMap;

use super::{StoreError, StoredTile, TileStore};
use crate::layer::LayerId;
use crate::tile::{TILE_SIDE, Tile, TileCells, TileKey};

/// Cells along one side of the square that a cell of an overview stands for; also the number of tiles along one side of an overview.
pub const OVERVIEW_STEP: usize = STEP as usize;
const STEP: i32 = 8;

/// The tiles that the overview `key` covers, each with column and row of its lowest cell in it.
fn covered(key: TileKey) -> impl Iterator<Item = (TileKey, [usize; 2])> {
    let tile = |overview: i32, part: usize| {
        let first = overview.checked_mul(STEP)?;
        first.checked_add_unsigned(part as u32)
    };
    let parts = || 0..OVERVIEW_STEP;
    let places = parts().flat_map(move |row| parts().map(move |column| [column, row]));
    places.filter_map(move |place| {
        let (tx, ty) = (tile(key.tx, place[0])?, tile(key.ty, place[1])?);
        let first = place.map(|part| part * (TILE_SIDE / OVERVIEW_STEP));
        Some((TileKey { tx, ty, ..key }, first))
    })
}

impl TileStore {
    /// The overview `key`: a tile of the same layer whose cells stand for squares of 8 × 8 cells. It covers the tiles `8·tx … 8·tx + 7` and
    /// `8·ty … 8·ty + 7`. Each cell has the [deciding](crate::layer::LayerId::deciding) code of its square; revision and stamp are the
    /// newest of its tiles. `None` if no cell is known.
    pub fn overview(&self, key: TileKey) -> Option<Tile> {
        let mut cells = TileCells::unknown();
        let codes = cells.codes_mut();
        let (mut revision, mut stamp_ns) = (0, i64::MIN);
        for (tile, [first_x, first_y]) in covered(key) {
            let Some(stored) = self.get(tile) else {
                continue;
            };
            let Some(part) = stored.cells() else { continue };
            revision = revision.max(stored.revision());
            stamp_ns = stamp_ns.max(stored.stamp_ns());
            for y in 0..TILE_SIDE {
                let row = &mut codes[(first_y + y / OVERVIEW_STEP) * TILE_SIDE + first_x..];
                for (code, square) in row.iter_mut().zip(part.row(y).chunks(OVERVIEW_STEP)) {
                    let decides = |a, b: &u16| key.layer.deciding(a, *b);
                    *code = square.iter().fold(*code, decides);
                }
            }
        }
        (revision > 0).then(|| Tile {
            key,
            boot: self.boot(),
            epoch: self.epoch(key.layer),
            revision,
            stamp_ns,
            check: cells.digest().check(),
            cells,
        })
    }

    /// Shows an overview where no tile is here yet; returns the keys of these tiles. What is shown so is in no digest, count or export, and
    /// gives way to the tile.
    pub fn show_overview(&mut self, overview: &Tile) -> Result<Vec<TileKey>, StoreError> {
        let (key, revision, cells) = (overview.key, overview.revision, &overview.cells);
        cells
            .check(key.layer)
            .map_err(|source| StoreError::Code { key, source })?;
        if cells.digest().check() != overview.check {
            return Err(StoreError::Digest { key, revision });
        }
        let held = self.layers.get_mut(&key.layer);
        let held = held.ok_or(StoreError::NoGrid(key.layer))?;
        let mut shown = Vec::new();
        for (tile, [first_x, first_y]) in covered(key) {
            let at = (tile.tx, tile.ty);
            let code = |x: usize, y: usize| {
                cells.row(first_y + y / OVERVIEW_STEP)[first_x + x / OVERVIEW_STEP]
            };
            let part = TileCells::from_fn(code);
            if !held.tiles.contains_key(&at) && part.known() > 0 {
                held.overviews.insert(at, part);
                shown.push(tile);
            }
        }
        Ok(shown)
    }

    /// Stops showing overviews of `layer`; returns the keys of the tiles in whose place they were shown.
    pub fn forget_overviews(&mut self, layer: LayerId) -> Vec<TileKey> {
        let held = self.layers.get_mut(&layer);
        let gone = held.map(|held| std::mem::take(&mut held.overviews));
        let keys = gone.into_iter().flat_map(BTreeMap::into_keys);
        keys.map(|(tx, ty)| TileKey { layer, tx, ty }).collect()
    }

    /// Number of tiles of `layer` in whose place an overview is shown.
    pub fn overview_places(&self, layer: LayerId) -> usize {
        self.layers
            .get(&layer)
            .map_or(0, |held| held.overviews.len())
    }

    /// The cells to draw at a tile: its own, or those of an overview.
    pub fn shown(&self, key: TileKey) -> Option<&TileCells> {
        let held = self.layers.get(&key.layer)?;
        let at = (key.tx, key.ty);
        let overview = || held.overviews.get(&at);
        let tile = held.tiles.get(&at).and_then(StoredTile::cells);
        tile.or_else(overview)
    }

    /// All cells to draw of `layer`, as [`shown`](Self::shown).
    pub fn all_shown(&self, layer: LayerId) -> impl Iterator<Item = (TileKey, &TileCells)> {
        let held = self.layers.get(&layer).into_iter();
        held.flat_map(|held| {
            let tiles = held.tiles.iter();
            let tiles = tiles.filter_map(|(at, stored)| Some((at, stored.cells()?)));
            tiles.chain(&held.overviews)
        })
        .map(move |(&(tx, ty), cells)| (TileKey { layer, tx, ty }, cells))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layer::UNKNOWN;
    use crate::tile::BootId;
    use crate::tile_store::{Applied, LayerGrid};

    const LAYER: LayerId = LayerId::Occupancy;

    fn store(boot: u8) -> TileStore {
        let mut store = TileStore::new(BootId([boot; 16]), 10);
        let grid = LayerGrid {
            layer: LAYER,
            cell_m: 0.1,
        };
        store.set_grid(grid).unwrap();
        store
    }

    const fn key(tx: i32, ty: i32) -> TileKey {
        TileKey {
            layer: LAYER,
            tx,
            ty,
        }
    }

    #[test]
    fn an_overview_is_shown_until_its_tiles_come() {
        let mut robot = store(1);
        // A wall of one cell in free space, and a tile of the neighbouring overview.
        let wall = |x, y| match (x, y) {
            (13, 60) => 200,
            (0..32, _) => 5,
            _ => UNKNOWN,
        };
        for tile in [key(-1, 2), key(0, 0)] {
            drop(robot.publish(tile, TileCells::from_fn(wall)).unwrap());
        }
        assert_eq!(robot.overview(key(3, 3)), None);
        let overview = robot.overview(key(-1, 0)).unwrap();
        assert_eq!((overview.revision, overview.cells.known()), (1, 4 * 8));
        // Tile (-1, 2) is the last of its row and the third from below.
        let code = |x: usize, y: usize| overview.cells.get(7 * 8 + x, 2 * 8 + y).unwrap();
        assert_eq!([code(1, 7), code(1, 6), code(4, 7)], [200, 5, UNKNOWN]);

        let mut console = store(1);
        let blank = console.root_digest(LAYER);
        assert_eq!(console.show_overview(&overview), Ok(vec![key(-1, 2)]));
        let shown = console.shown(key(-1, 2)).unwrap();
        let codes = [(8, 56), (15, 63), (7, 56), (8, 55), (32, 60)];
        let codes = codes.map(|(x, y)| shown.get(x, y).unwrap());
        assert_eq!(codes, [200, 200, 5, 5, UNKNOWN]);
        assert_eq!(console.overview_places(LAYER), 1);
        assert_eq!(console.all_shown(LAYER).count(), 1);
        assert_eq!(
            (console.root_digest(LAYER), console.tile_count(LAYER)),
            (blank, 0)
        );

        let tile = robot.tile(key(-1, 2)).unwrap();
        assert_eq!(console.apply(tile.clone()), Ok(Applied::Stored));
        assert_eq!(console.shown(key(-1, 2)), Some(&tile.cells));
        assert_eq!(console.overview_places(LAYER), 0);
        assert_eq!(console.all_shown(LAYER).count(), 1);
        assert_eq!(console.show_overview(&overview), Ok(vec![]));
        let other = robot.overview(key(0, 0)).unwrap();
        assert_eq!(console.show_overview(&other), Ok(vec![key(0, 0)]));
        assert_eq!(console.forget_overviews(LAYER), [key(0, 0)]);
        assert_eq!(console.shown(key(0, 0)), None);
    }

    #[test]
    fn damaged_overviews_and_places_beyond_the_map_are_refused() {
        let mut robot = store(1);
        drop(
            robot
                .publish(key(0, 0), TileCells::from_fn(|_, _| 5))
                .unwrap(),
        );
        assert_eq!(robot.overview(key(i32::MAX, i32::MIN)), None);
        let mut damaged = robot.overview(key(0, 0)).unwrap();
        damaged.cells.codes_mut()[0] = 6;
        let refused = robot.show_overview(&damaged);
        assert!(matches!(refused, Err(StoreError::Digest { .. })));
    }
}
