//! Cells, the tiles they lie in, and a sparse grid of tiles without bounds.

use std::collections::HashMap;

use nalgebra::Point2;

/// Cells along the edge of a tile.
pub const TILE_EDGE: usize = 64;
/// [`TILE_EDGE`] for cell and tile indices, which are signed.
pub const TILE_EDGE_CELLS: i32 = 64;
/// Cells of a tile.
pub const TILE_CELLS: usize = TILE_EDGE * TILE_EDGE;

/// A cell of a grid fixed in `odom`: cell (x, y) covers `[x, x+1)·cell_m` by `[y, y+1)·cell_m`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CellIndex {
    /// Towards x of `odom`.
    pub x: i32,
    /// Towards y of `odom`.
    pub y: i32,
}

/// A tile: 64×64 cells, tile (x, y) holding cells `64·x … 64·x + 63` by `64·y … 64·y + 63`.
///
/// Ordered by y, then x: the order of rows in a picture seen from below.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TileIndex {
    /// Towards x of `odom`.
    pub x: i32,
    /// Towards y of `odom`.
    pub y: i32,
}

impl PartialOrd for TileIndex {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for TileIndex {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.y, self.x).cmp(&(other.y, other.x))
    }
}

impl CellIndex {
    /// The cell that `point`, metres in `odom`, lies in.
    pub fn containing(point: Point2<f64>, cell_m: f64) -> Self {
        let index = |coordinate: f64| libm::floor(coordinate / cell_m) as i32;
        Self {
            x: index(point.x),
            y: index(point.y),
        }
    }

    /// As [`CellIndex::containing`] with the inverse of the cell's side, and in line: for every point of every
    /// scan, where a division and a call to `floor` for each coordinate would take longer than the rest.
    pub fn near(point: Point2<f64>, cells_per_m: f64) -> Self {
        let index = |coordinate: f64| {
            let cells = coordinate * cells_per_m;
            let towards_zero = cells as i32;
            towards_zero.saturating_sub(i32::from(cells < f64::from(towards_zero)))
        };
        Self {
            x: index(point.x),
            y: index(point.y),
        }
    }

    /// The tile it lies in and its place there, row by row.
    pub const fn split(self) -> (TileIndex, usize) {
        let edge = TILE_EDGE_CELLS;
        let place = self.y.rem_euclid(edge) * edge + self.x.rem_euclid(edge);
        (
            TileIndex {
                x: self.x.div_euclid(edge),
                y: self.y.div_euclid(edge),
            },
            place as usize,
        )
    }

    /// Its centre, metres in `odom`.
    pub fn centre(self, cell_m: f64) -> Point2<f64> {
        Point2::new(
            (f64::from(self.x) + 0.5) * cell_m,
            (f64::from(self.y) + 0.5) * cell_m,
        )
    }
}

/// One tile of a [`TiledGrid`].
#[derive(Clone, Debug)]
pub struct GridTile<T> {
    /// Where it lies.
    pub index: TileIndex,
    /// Its cells, row by row, y upwards.
    pub cells: Box<[T; TILE_CELLS]>,
    /// Touched since the changes were last taken.
    changed: bool,
}

/// A grid without bounds, stored as the tiles that were ever touched.
#[derive(Clone, Debug)]
pub struct TiledGrid<T> {
    blank: T,
    slots: HashMap<TileIndex, u32>,
    tiles: Vec<GridTile<T>>,
    changed: Vec<TileIndex>,
}

impl<T: Copy> TiledGrid<T> {
    /// An empty grid whose cells begin as `blank`.
    pub fn new(blank: T) -> Self {
        Self {
            blank,
            slots: HashMap::new(),
            tiles: Vec::new(),
            changed: Vec::new(),
        }
    }

    /// The tile at `index`, if it was ever touched.
    pub fn get(&self, index: TileIndex) -> Option<&GridTile<T>> {
        self.slots
            .get(&index)
            .map(|&slot| &self.tiles[slot as usize])
    }

    /// The cells of the tile at `index`, made blank if it is new, and marked as changed.
    pub fn touch(&mut self, index: TileIndex) -> &mut [T; TILE_CELLS] {
        let slot = *self.slots.entry(index).or_insert_with(|| {
            let cells = Box::new([self.blank; TILE_CELLS]);
            self.tiles.push(GridTile {
                index,
                cells,
                changed: false,
            });
            (self.tiles.len() - 1) as u32
        });
        let tile = &mut self.tiles[slot as usize];
        if !tile.changed {
            tile.changed = true;
            self.changed.push(index);
        }
        &mut tile.cells
    }

    /// All tiles, in the order in which they were first touched.
    pub fn tiles(&self) -> impl ExactSizeIterator<Item = &GridTile<T>> {
        self.tiles.iter()
    }

    /// The tiles touched since the last call, in tile order.
    pub fn take_changed(&mut self) -> Vec<TileIndex> {
        let mut changed = std::mem::take(&mut self.changed);
        changed.sort_unstable();
        for index in &changed {
            if let Some(&slot) = self.slots.get(index) {
                self.tiles[slot as usize].changed = false;
            }
        }
        changed
    }

    /// Removes every tile; changes that nobody took are forgotten.
    pub fn erase(&mut self) {
        self.slots.clear();
        self.tiles.clear();
        self.changed.clear();
    }

    /// Where there are more than `limit` tiles, removes those farthest from `centre` (a tile) until 31/32 of
    /// the limit are left, so that not every call has to; says how many.
    ///
    /// Call it after [`TiledGrid::take_changed`], or changes are lost with the tiles.
    pub fn evict_farthest(&mut self, centre: TileIndex, limit: usize) -> usize {
        let kept = limit - limit / 32;
        let excess = if self.tiles.len() > limit {
            self.tiles.len() - kept
        } else {
            0
        };
        if excess > 0 {
            self.tiles.sort_by_key(|tile| {
                let along = |a: i32, b: i32| i64::from(a) - i64::from(b);
                let (dx, dy) = (along(tile.index.x, centre.x), along(tile.index.y, centre.y));
                (dx * dx + dy * dy, tile.index)
            });
            self.tiles.truncate(kept);
            self.slots = self
                .tiles
                .iter()
                .enumerate()
                .map(|(slot, tile)| (tile.index, slot as u32))
                .collect();
        }
        excess
    }

    /// Memory of the cells, bytes.
    pub fn bytes(&self) -> usize {
        self.tiles.len() * size_of::<[T; TILE_CELLS]>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_left_of_zero_belong_to_the_tile_left_of_zero() {
        let cell = CellIndex::containing(Point2::new(-0.05, 6.4), 0.1);
        assert_eq!(cell, CellIndex { x: -1, y: 64 });
        assert_eq!(cell.split(), (TileIndex { x: -1, y: 1 }, 63));
        assert!((cell.centre(0.1) - Point2::new(-0.05, 6.45)).norm() < 1e-12);
    }

    #[test]
    fn changes_are_taken_once_and_in_order() {
        let mut grid = TiledGrid::new(0u8);
        for (x, y) in [(3, 1), (-2, 1), (0, -5), (3, 1)] {
            grid.touch(TileIndex { x, y })[0] += 1;
        }
        let taken: Vec<_> = grid
            .take_changed()
            .iter()
            .map(|tile| (tile.x, tile.y))
            .collect();
        assert_eq!(taken, [(0, -5), (-2, 1), (3, 1)]);
        assert_eq!(grid.take_changed(), []);
        assert_eq!(grid.get(TileIndex { x: 3, y: 1 }).unwrap().cells[0], 2);
    }

    #[test]
    fn the_farthest_tiles_go_first() {
        let mut grid = TiledGrid::new(0u8);
        for x in -5..=5 {
            grid.touch(TileIndex { x, y: 0 })[0] = (10 + x) as u8;
        }
        assert_eq!(grid.evict_farthest(TileIndex { x: 4, y: 0 }, 3), 8);
        let mut left: Vec<_> = grid
            .tiles()
            .map(|tile| (tile.index.x, tile.cells[0]))
            .collect();
        left.sort_unstable();
        assert_eq!(left, [(3, 13), (4, 14), (5, 15)]);
        assert_eq!(grid.get(TileIndex { x: 5, y: 0 }).unwrap().cells[0], 15);
        assert!(grid.get(TileIndex { x: 0, y: 0 }).is_none());
    }
}
