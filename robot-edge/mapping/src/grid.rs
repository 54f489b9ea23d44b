//! Cells, tiles, voxels, and an unbounded sparse grid of tiles.

use std::collections::HashMap;
use std::ops::Range;

use nalgebra::{Point2, Point3};

/// Cells along the edge of a tile.
pub const TILE_EDGE: usize = 64;
/// [`TILE_EDGE`] for signed indices.
pub const TILE_EDGE_CELLS: i32 = 64;
/// Cells of a tile.
pub const TILE_CELLS: usize = TILE_EDGE * TILE_EDGE;

/// A cell of a grid fixed in `odom`: cell (x, y) covers `[x, x+1)·cell_m` by `[y, y+1)·cell_m`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CellIndex {
    /// Along x of `odom`.
    pub x: i32,
    /// Along y of `odom`.
    pub y: i32,
}

/// A tile of 64×64 cells: cells `64·x … 64·x + 63` by `64·y … 64·y + 63`.
///
/// Ordered by y, then x.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TileIndex {
    /// Along x of `odom`.
    pub x: i32,
    /// Along y of `odom`.
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
    /// The cell that contains `point`, metres in `odom`.
    pub fn containing(point: Point2<f64>, cell_m: f64) -> Self {
        let index = |coordinate: f64| libm::floor(coordinate / cell_m) as i32;
        Self {
            x: index(point.x),
            y: index(point.y),
        }
    }

    /// [`CellIndex::containing`] with the inverse cell size. It avoids a division and a call of
    /// `floor` per coordinate, which dominated the cost per point.
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

    /// Its tile and its index there, row by row.
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

    /// Index of the cell where rows of `width` cells follow each other upwards from the cell `first`;
    /// `None` beside and below them.
    pub(crate) fn place_in(self, first: Self, width: usize) -> Option<usize> {
        let offset = |at: i32, first: i32| usize::try_from(at.checked_sub(first)?).ok();
        let x = offset(self.x, first.x).filter(|x| *x < width)?;
        Some(offset(self.y, first.y)? * width + x)
    }
}

/// Sides of the cells of a map fixed in `odom`: cell (x, y) covers `[x, x+1)·x_m` by `[y, y+1)·y_m`
/// (\[LOD\] §4.2.2: cw and ch).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellSize {
    x_m: f64,
    y_m: f64,
    /// 1 for squares.
    x_over_y: f64,
}

/// Share of a cell below which an overlap is rounding.
const OVERLAP_MIN: f64 = 1e-6;

impl CellSize {
    /// Sides along x and y of `odom`, metres.
    pub fn new(x_m: f64, y_m: f64) -> Self {
        Self {
            x_m,
            y_m,
            x_over_y: x_m / y_m,
        }
    }

    /// Sides along x and y of `odom`, metres.
    pub const fn sides_m(self) -> [f64; 2] {
        [self.x_m, self.y_m]
    }

    /// The shorter side, metres.
    pub const fn shorter_m(self) -> f64 {
        self.x_m.min(self.y_m)
    }

    /// The point with its y stretched so that cells are squares of `x_m`; squares leave it as it is.
    pub(crate) fn squared(self, point: Point2<f64>) -> Point2<f64> {
        Point2::new(point.x, point.y * self.x_over_y)
    }

    /// The cell that contains `point`, metres in `odom`.
    pub fn containing(self, point: Point2<f64>) -> CellIndex {
        CellIndex::containing(self.squared(point), self.x_m)
    }

    /// The middle of a cell, metres in `odom`.
    pub(crate) fn centre(self, cell: CellIndex) -> Point2<f64> {
        let centre = cell.centre(self.x_m);
        Point2::new(centre.x, centre.y / self.x_over_y)
    }

    /// The squares of the shorter side whose centres are in `cell`: at least one, and each is in one
    /// cell only.
    pub fn squares(self, cell: CellIndex) -> impl Iterator<Item = CellIndex> {
        let ends = |index: i32, side_m: f64| {
            let squares = side_m / self.shorter_m();
            let first = |index: i32| libm::ceil(f64::from(index) * squares - 0.5) as i32;
            first(index)..first(index.saturating_add(1))
        };
        cells_of(ends(cell.x, self.x_m), ends(cell.y, self.y_m))
    }

    /// The cells of size `other` that share area with `cell`.
    pub fn overlapping(self, cell: CellIndex, other: Self) -> impl Iterator<Item = CellIndex> {
        let ends = |index: i32, ratio: f64| {
            let at = |index: i32| f64::from(index) * ratio;
            let first = libm::floor(at(index) + OVERLAP_MIN) as i32;
            first..libm::ceil(at(index.saturating_add(1)) - OVERLAP_MIN) as i32
        };
        cells_of(
            ends(cell.x, self.x_m / other.x_m),
            ends(cell.y, self.y_m / other.y_m),
        )
    }
}

fn cells_of(columns: Range<i32>, rows: Range<i32>) -> impl Iterator<Item = CellIndex> {
    rows.flat_map(move |y| columns.clone().map(move |x| CellIndex { x, y }))
}

/// One tile of a [`TiledGrid`].
#[derive(Clone, Debug)]
pub struct GridTile<T> {
    /// Its index.
    pub index: TileIndex,
    /// Cells row by row, y upwards.
    pub cells: Box<[T; TILE_CELLS]>,
    /// Touched since the changes were last taken.
    changed: bool,
}

/// An unbounded grid that stores the tiles that were ever touched.
#[derive(Clone, Debug)]
pub struct TiledGrid<T> {
    blank: T,
    slots: HashMap<TileIndex, u32>,
    tiles: Vec<GridTile<T>>,
    changed: Vec<TileIndex>,
}

impl<T: Copy> TiledGrid<T> {
    /// An empty grid; new cells are `blank`.
    pub fn new(blank: T) -> Self {
        Self {
            blank,
            slots: HashMap::new(),
            tiles: Vec::new(),
            changed: Vec::new(),
        }
    }

    /// `None` if it was never touched.
    pub fn get(&self, index: TileIndex) -> Option<&GridTile<T>> {
        self.slots
            .get(&index)
            .map(|&slot| &self.tiles[slot as usize])
    }

    /// The cells of a tile, created if necessary, and marked as changed.
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

    /// All tiles, in the order of their creation.
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

    /// Removes all tiles and untaken changes.
    pub fn erase(&mut self) {
        self.slots.clear();
        self.tiles.clear();
        self.changed.clear();
    }

    /// If there are more than `limit` tiles, removes those farthest from the tile `centre` until
    /// 31/32 of the limit remain (so that not every call evicts); returns their number.
    ///
    /// Call it after [`TiledGrid::take_changed`]: changes of evicted tiles are lost.
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

/// A voxel: (x, y, z) covers `[x, x+1)·cell_m` by `[y, y+1)·cell_m` by `[z, z+1)·cell_m`.
///
/// Ordered by x, y, z, so the voxels of a column are contiguous and columns are in the order of
/// [`CellIndex`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct VoxelIndex {
    /// Along x of `odom`.
    pub x: i32,
    /// Along y of `odom`.
    pub y: i32,
    /// Upwards.
    pub z: i32,
}

impl VoxelIndex {
    /// The voxel that contains `point`, metres in `odom`; saturates at the range of an index.
    pub fn containing(point: Point3<f64>, cell_m: f64) -> Self {
        let index = |coordinate: f64| libm::floor(coordinate / cell_m) as i32;
        Self {
            x: index(point.x),
            y: index(point.y),
            z: index(point.z),
        }
    }

    /// Its centre, metres in `odom`.
    pub fn centre(self, cell_m: f64) -> Point3<f64> {
        Point3::new(
            (f64::from(self.x) + 0.5) * cell_m,
            (f64::from(self.y) + 0.5) * cell_m,
            (f64::from(self.z) + 0.5) * cell_m,
        )
    }

    /// Its column.
    pub const fn column(self) -> CellIndex {
        CellIndex {
            x: self.x,
            y: self.y,
        }
    }
}

#[cfg(test)]
mod grid_tests {
    use super::*;

    #[test]
    fn negative_cells_are_in_negative_tiles() {
        let cell = CellIndex::containing(Point2::new(-0.05, 6.4), 0.1);
        assert_eq!(cell, CellIndex { x: -1, y: 64 });
        assert_eq!(cell.split(), (TileIndex { x: -1, y: 1 }, 63));
        assert!((cell.centre(0.1) - Point2::new(-0.05, 6.45)).norm() < 1e-12);
    }

    #[test]
    fn a_place_is_in_its_row() {
        let place = |x, y| CellIndex { x, y }.place_in(CellIndex { x: -2, y: 5 }, 3);
        assert_eq!(
            [place(-2, 5), place(0, 5), place(-1, 7)],
            [0, 2, 7].map(Some)
        );
        let outside = [
            (-3, 5),
            (1, 5),
            (-2, 4),
            (i32::MAX, 5),
            (i32::MIN, i32::MIN),
        ];
        assert_eq!(outside.map(|(x, y)| place(x, y)), [None; 5]);
    }

    #[test]
    fn oblong_cells_are_made_of_squares_and_overlap_cells_of_other_sizes() {
        let cell = |x, y| CellIndex { x, y };
        let oblong = CellSize::new(0.2, 0.5);
        assert_eq!(oblong.containing(Point2::new(-0.1, 1.1)), cell(-1, 2));
        assert!((oblong.shorter_m() - 0.2).abs() < 1e-12);
        // Rows of 0.2 m whose middles, at 0.1 m, 0.3 m, ..., are in rows of 0.5 m.
        let rows = |y| -> Vec<_> { oblong.squares(cell(3, y)).collect() };
        assert_eq!(rows(0), [cell(3, 0), cell(3, 1)]);
        assert_eq!(rows(1), [cell(3, 2), cell(3, 3), cell(3, 4)]);
        assert_eq!(rows(-1), [cell(3, -3), cell(3, -2), cell(3, -1)]);
        let square = |side_m| CellSize::new(side_m, side_m);
        for (from, to, index, expected) in [
            (square(0.1), square(0.1), cell(-7, 9), vec![cell(-7, 9)]),
            (
                square(0.2),
                square(0.1),
                cell(-1, 0),
                vec![cell(-2, 0), cell(-1, 0), cell(-2, 1), cell(-1, 1)],
            ),
            (square(0.1), square(0.2), cell(-1, 3), vec![cell(-1, 1)]),
            (
                oblong,
                square(0.3),
                cell(1, 0),
                vec![cell(0, 0), cell(1, 0), cell(0, 1), cell(1, 1)],
            ),
        ] {
            let found: Vec<_> = from.overlapping(index, to).collect();
            assert_eq!(found, expected, "{from:?} {to:?} {index:?}");
        }
        for side_m in [0.05, 0.1, 0.2, 0.3, 1.7] {
            for index in [cell(-100_001, 3), cell(0, 0), cell(7, 99_999)] {
                let size = square(side_m);
                assert_eq!(size.squares(index).collect::<Vec<_>>(), [index]);
                assert_eq!(size.overlapping(index, size).collect::<Vec<_>>(), [index]);
            }
        }
    }

    #[test]
    fn changes_are_taken_once_in_order() {
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
    fn farthest_tiles_are_evicted_first() {
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

#[cfg(test)]
mod voxel_tests {
    use super::*;

    #[test]
    fn negative_coordinates_round_down() {
        let voxel = VoxelIndex::containing(Point3::new(-0.05, 0.05, -0.31), 0.1);
        assert_eq!(voxel, VoxelIndex { x: -1, y: 0, z: -4 });
        assert_eq!(voxel.column(), CellIndex { x: -1, y: 0 });
        let centre = Point3::new(-0.05, 0.05, -0.35);
        assert!((voxel.centre(0.1) - centre).norm() < 1e-12);
    }

    #[test]
    fn voxels_of_a_column_are_contiguous() {
        let at = |x, y, z| VoxelIndex { x, y, z };
        let mut voxels = [at(1, 0, 0), at(0, 1, -3), at(0, 0, 7), at(0, 1, 2)];
        voxels.sort_unstable();
        assert_eq!(
            voxels,
            [at(0, 0, 7), at(0, 1, -3), at(0, 1, 2), at(1, 0, 0)]
        );
    }
}
