//! Correlative search by branch and bound over a pyramid of a likelihood grid.
//!
//! E. Olson, "Real-Time Correlative Scan Matching", ICRA 2009, section III (likelihood grid, levels of
//! resolution); W. Hess, D. Kohler, H. Rapp, D. Andor, "Real-Time Loop Closure in 2D LIDAR SLAM", ICRA 2016, section
//! V-B (branch and bound). Hess keeps each level at full resolution; here a level is kept at twice its own, which needs
//! less than half of the memory and has somewhat looser bounds.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Isometry2, Point2, UnitComplex, Vector2};

/// Side of a cell, metres.
pub const CELL_M: f64 = 0.1;
/// Levels of the pyramid; a block of the coarsest is 4 cells, 0.4 m, wide.
const LEVELS: usize = 3;
/// Cells of a side: 35 m around the middle.
const SIDE: i32 = 704;
/// Cells at the border that stay empty, so that no block that begins outside of the grid reaches a hit.
const BORDER: i32 = 1 << LEVELS;
/// Standard deviation of the likelihood of a hit, metres.
const SIGMA_M: f64 = 0.1;
/// A search begins at the coarsest level with at least this many blocks on a side: a row of them is scored at once.
const MIN_ROW: i32 = 8;
/// Blocks that are scored at once; about eight such steps take the time of one block.
const AT_ONCE: usize = 16;

/// Likelihood of a hit, 0 to 255, for the cells around the origin of its frame. The cells of level `h` are
/// `s = 2^(h − 1)` of those of level 0 wide; cell `c` holds the greatest of cells `c·s` to `(c + 3)·s − 1` of level 0, on
/// both axes: wherever a block of `2 s` cells begins, one cell bounds it. Even and odd columns are kept apart, and so
/// are rows, so that the bounds of blocks beside each other lie beside each other.
#[derive(Clone, Debug)]
pub struct SearchGrid {
    levels: Vec<Vec<u8>>,
}

/// Region of poses, and the least score of interest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchWindow {
    /// Its middle.
    pub middle: Isometry2<f64>,
    /// Half its sides along x and y, metres.
    pub half_m: [f64; 2],
    /// Half its angle, radians.
    pub half_rad: f64,
    /// A pose of this score or less is not found; 0 to 1.
    pub min_score: f64,
    /// Penalty of the score at a Mahalanobis distance of 1 from the middle, and its standard deviations
    /// (metres, radians).
    pub prior: Option<(f64, f64, f64)>,
}

/// Best pose of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Takes points to the frame of the grid.
    pub pose: Isometry2<f64>,
    /// Mean likelihood of the points less the penalty of the prior, 0 to 1.
    pub score: f64,
}

/// Translations `offset` to `offset + 2^level − 1`, in cells, at one angle. In the order of the bounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Block {
    /// Sum over the points, less the penalty.
    bound: i32,
    level: Reverse<u8>,
    angle: u16,
    offset: [i16; 2],
}

/// A search under way: for the pose in a window at which points agree best with a grid, to a cell and to the angle at
/// which the farthest point moves by a cell.
#[derive(Clone, Debug)]
pub struct Search {
    window: SearchWindow,
    /// Sum over the points that is not of interest.
    least: i32,
    /// Turns from the middle, radians, and the cells of the points after them.
    turned: Vec<(f64, Vec<[i32; 2]>)>,
    /// Of these, those whose blocks of the coarsest level were scored.
    begun: usize,
    top: usize,
    /// Offset of the first block of the coarsest level, and the numbers of blocks along x and y.
    first: [i32; 2],
    blocks: [usize; 2],
    /// Blocks to look into.
    open: BinaryHeap<Block>,
    best: Option<Found>,
    /// Poses this near to this one are left out (metres, radians).
    except: Option<(Isometry2<f64>, f64, f64)>,
}

impl Default for SearchGrid {
    fn default() -> Self {
        let level = |level: usize| vec![0; side(level) * side(level)];
        Self {
            levels: (0..LEVELS).map(level).collect(),
        }
    }
}

/// A number of cells or blocks, of which a grid has fewer than 65,536 along a side.
fn small(number: usize) -> i32 {
    i32::from(number as u16)
}

impl SearchGrid {
    /// Adds a hit.
    pub fn add(&mut self, point: &Point2<f64>) {
        let [x, y] = cell_of(point);
        for cy in y - 1..=y + 1 {
            for cx in x - 1..=x + 1 {
                let middle = Point2::new(
                    (f64::from(cx) + 0.5) * CELL_M,
                    (f64::from(cy) + 0.5) * CELL_M,
                );
                let square = (middle - point).norm_squared() / (SIGMA_M * SIGMA_M);
                self.raise(cx, cy, (255.0 * libm::exp(-0.5 * square)) as u8);
            }
        }
    }

    fn raise(&mut self, cx: i32, cy: i32, value: u8) {
        let half = SIDE / 2;
        let (x, y) = (cx + half, cy + half);
        let inside = BORDER..SIDE - BORDER;
        if !inside.contains(&x) || !inside.contains(&y) {
            return;
        }
        for (level, cells) in self.levels.iter_mut().enumerate() {
            let shift = level.saturating_sub(1);
            let (x, y) = (x as usize >> shift, y as usize >> shift);
            let behind = if level > 0 { 2 } else { 0 };
            for y in y - behind..=y {
                for x in x - behind..=x {
                    let cell = &mut cells[place(level, x, y)];
                    *cell = value.max(*cell);
                }
            }
        }
    }

    /// Sum over points of the greatest likelihood in the block that begins at an offset; 0 if it is certainly not above `least`.
    fn bound(&self, level: usize, points: &[[i32; 2]], [dx, dy]: [i32; 2], least: i32) -> i32 {
        let (shift, cells) = (level.saturating_sub(1), &self.levels[level]);
        let value = |&[x, y]: &[i32; 2]| {
            let (x, y) = (x + dx + SIDE / 2, y + dy + SIDE / 2);
            if !(0..SIDE).contains(&x) || !(0..SIDE).contains(&y) {
                return 0;
            }
            i32::from(cells[place(level, x as usize >> shift, y as usize >> shift)])
        };
        let (mut sum, mut rest) = (0, 255 * small(points.len()));
        for part in points.chunks(16) {
            sum += part.iter().map(value).sum::<i32>();
            rest -= 255 * small(part.len());
            if sum + rest <= least {
                return 0;
            }
        }
        sum
    }

    /// Of blocks beside each other, of which the first begins at an offset, the number of points with a hit in the block.
    fn hits(
        &self,
        level: usize,
        points: &[[i32; 2]],
        first: [i32; 2],
        [columns, rows]: [usize; 2],
    ) -> Vec<u8> {
        let (shift, cells) = (level.saturating_sub(1), &self.levels[level]);
        let (step, blocks) = (step(level), side(level) / step(level));
        let mut sums = vec![0_u8; columns * rows];
        // The first of `number` blocks that begins in the grid, and the blocks behind the last that does.
        let clip = |begin: i32, number: usize| {
            let number = small(number);
            let from = (-begin).clamp(0, number);
            (from, (small(blocks) - begin).clamp(from, number))
        };
        for [x, y] in points {
            let x = (x + first[0] + SIDE / 2) >> shift;
            let y = (y + first[1] + SIDE / 2) >> shift;
            let [column, row] = [x, y].map(|at| at.div_euclid(small(step)));
            let [odd_x, odd_y] = [x, y].map(|at| at.rem_euclid(small(step)) as usize);
            let plane = &cells[(odd_y * step + odd_x) * blocks * blocks..][..blocks * blocks];
            let (from, end) = clip(column, columns);
            if from == end {
                continue;
            }
            let (from_row, end_row) = clip(row, rows);
            for at in from_row..end_row {
                let sums = &mut sums[at as usize * columns..];
                let sums = &mut sums[from as usize..end as usize];
                let cells = &plane[(row + at) as usize * blocks + (column + from) as usize..];
                for (sum, cell) in sums.iter_mut().zip(cells) {
                    *sum += (*cell).min(1);
                }
            }
        }
        sums
    }
}

impl Search {
    /// Of points in the frame of the vehicle, at most 250.
    pub fn new(points: &[Point2<f64>], window: SearchWindow) -> Self {
        let farthest = points.iter().map(|point| point.coords.norm_squared());
        let step_rad = CELL_M / libm::sqrt(farthest.fold(1.0, f64::max));
        let turns = libm::ceil(window.half_rad / step_rad) as i32;
        let half = window
            .half_m
            .map(|half_m| libm::ceil(half_m / CELL_M) as i32);
        let turn = |turn| {
            let turn_rad = f64::from(turn) * step_rad;
            let pose = Isometry2::from_parts(
                window.middle.translation,
                window.middle.rotation * UnitComplex::new(turn_rad),
            );
            (
                turn_rad,
                points
                    .iter()
                    .map(|point| cell_of(&(pose * point)))
                    .collect(),
            )
        };
        let blocks = |level: usize| half.map(|half| 1 + ((2 * half) >> level));
        let top = (1..LEVELS).rfind(|level| blocks(*level)[0] >= MIN_ROW);
        let top = top.unwrap_or(1);
        let [columns, rows] = blocks(top).map(|blocks| blocks as usize);
        Self {
            window,
            least: (window.min_score * 255.0 * points.len() as f64) as i32,
            turned: (-turns..=turns).map(turn).collect(),
            begun: 0,
            top,
            first: half.map(|half| -half),
            blocks: [columns.next_multiple_of(AT_ONCE), rows],
            open: BinaryHeap::new(),
            best: None,
            except: None,
        }
    }

    /// Goes on by about `max_blocks` blocks; whether it is finished.
    pub fn advance(&mut self, grid: &SearchGrid, max_blocks: usize) -> bool {
        let mut scored = 0;
        while self.begun < self.turned.len() && scored < max_blocks {
            let cells = &self.turned[self.begun].1;
            let [columns, rows] = self.blocks;
            let hits = grid.hits(self.top, cells, self.first, self.blocks);
            for (at, hits) in hits.into_iter().enumerate() {
                let bound = 255 * i32::from(hits);
                if bound <= self.least {
                    continue;
                }
                let place = [at % columns, at / columns].map(|at| small(at << self.top));
                let block = self.with_penalty(Block {
                    bound,
                    level: Reverse(self.top as u8),
                    angle: self.begun as u16,
                    offset: [0, 1].map(|axis| (self.first[axis] + place[axis]) as i16),
                });
                if block.bound > self.least {
                    self.open.push(block);
                }
            }
            self.begun += 1;
            scored += (columns / AT_ONCE * rows).div_ceil(8);
        }
        while self.begun == self.turned.len() && scored < max_blocks {
            let Some(block) = self.open.pop() else {
                return true;
            };
            if self.is_left_out(&block) {
                continue;
            }
            let Reverse(level) = block.level;
            if level > 0 {
                let half = 1 << (level - 1);
                for (x, y) in [(0, 0), (half, 0), (0, half), (half, half)] {
                    let part = self.part(grid, &block, [x, y]);
                    if part.bound > self.least {
                        self.open.push(part);
                    }
                }
                scored += 4;
                continue;
            }
            // No bound is greater.
            let score = f64::from(block.bound) / (255.0 * self.turned[0].1.len() as f64);
            let pose = self.pose(&block);
            self.best = Some(Found { pose, score });
            return true;
        }
        false
    }

    /// The best pose; `None` before the end, and if none is above the least score.
    pub const fn best(&self) -> Option<Found> {
        self.best
    }

    /// After the end: goes on for a pose that is not near (metres, radians) to the best one, with at least this share of
    /// its score.
    pub fn search_elsewhere(&mut self, share: f64, (near_m, near_rad): (f64, f64)) {
        if let Some(best) = self.best.take() {
            self.except = Some((best.pose, near_m, near_rad));
            let points = self.turned[0].1.len() as f64;
            self.least = self.least.max((share * best.score * 255.0 * points) as i32);
            self.open.retain(|block| block.bound > self.least);
        }
    }

    /// Whether all poses of a block are near the one that is left out.
    fn is_left_out(&self, block: &Block) -> bool {
        self.except.is_some_and(|(except, near_m, near_rad)| {
            let pose = self.pose(block);
            let first = pose.translation.vector - except.translation.vector;
            let last = first.add_scalar(f64::from((1 << block.level.0) - 1) * CELL_M);
            let farthest = first.abs().sup(&last.abs());
            farthest.norm() < near_m && pose.rotation.angle_to(&except.rotation).abs() < near_rad
        })
    }

    /// A quarter of a block, at an offset from it.
    fn part(&self, grid: &SearchGrid, block: &Block, [x, y]: [i16; 2]) -> Block {
        let level = block.level.0 - 1;
        let offset = [block.offset[0] + x, block.offset[1] + y];
        let cells = &self.turned[usize::from(block.angle)].1;
        self.with_penalty(Block {
            bound: grid.bound(level.into(), cells, offset.map(i32::from), self.least),
            level: Reverse(level),
            offset,
            ..*block
        })
    }

    /// A single pose has a penalty by the prior.
    fn with_penalty(&self, mut block: Block) -> Block {
        if let (Reverse(0), Some((penalty, sigma_m, sigma_rad))) = (block.level, self.window.prior)
        {
            let (turn_rad, cells) = &self.turned[usize::from(block.angle)];
            let [x, y] = block
                .offset
                .map(|cells| f64::from(cells) * CELL_M / sigma_m);
            let turn = turn_rad / sigma_rad;
            let square = x * x + y * y + turn * turn;
            block.bound -= (penalty * 0.5 * square * 255.0 * cells.len() as f64) as i32;
        }
        block
    }

    fn pose(&self, block: &Block) -> Isometry2<f64> {
        let [x, y] = block.offset.map(|cells| f64::from(cells) * CELL_M);
        let middle = &self.window.middle;
        Isometry2::new(
            middle.translation.vector + Vector2::new(x, y),
            self.turned[usize::from(block.angle)].0 + middle.rotation.angle(),
        )
    }
}

/// Cells of a side of a level.
const fn side(level: usize) -> usize {
    SIDE as usize >> level.saturating_sub(1)
}

/// Cells of a level from one block to the next.
const fn step(level: usize) -> usize {
    if level > 0 { 2 } else { 1 }
}

/// Index of a cell of a level.
const fn place(level: usize, x: usize, y: usize) -> usize {
    let (step, blocks) = (step(level), side(level) / step(level));
    ((y % step) * step + x % step) * blocks * blocks + (y / step) * blocks + x / step
}

fn cell_of(point: &Point2<f64>) -> [i32; 2] {
    [point.x, point.y].map(|metres| libm::floor(metres / CELL_M) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An L-shaped wall and a post.
    fn points() -> Vec<Point2<f64>> {
        let wall = (0..40).map(|at| Point2::new(3.0, -2.0 + 0.1 * f64::from(at)));
        let other = (0..20).map(|at| Point2::new(1.0 + 0.1 * f64::from(at), 2.0));
        wall.chain(other).chain([Point2::new(-2.0, -1.0)]).collect()
    }

    fn grid() -> SearchGrid {
        let mut grid = SearchGrid::default();
        for point in points() {
            grid.add(&point);
        }
        grid
    }

    const WINDOW: SearchWindow = SearchWindow {
        middle: Isometry2 {
            rotation: UnitComplex::new_unchecked(nalgebra::Complex::new(1.0, 0.0)),
            translation: nalgebra::Translation2::new(0.0, 0.0),
        },
        half_m: [2.0; 2],
        half_rad: 0.5,
        min_score: 0.2,
        prior: None,
    };

    fn search(points: &[Point2<f64>], window: SearchWindow) -> Option<Found> {
        let (mut search, grid) = (Search::new(points, window), grid());
        // In steps of any size.
        while !search.advance(&grid, 50) {}
        let found = search.best();
        search.search_elsewhere(0.8, (0.7, 0.3));
        search.advance(&grid, usize::MAX);
        assert_eq!(search.best(), None);
        found
    }

    #[test]
    fn every_level_bounds_the_poses_of_its_blocks() {
        let (grid, search) = (grid(), Search::new(&points(), WINDOW));
        let (_, cells) = &search.turned[search.turned.len() / 3];
        for level in 1..LEVELS {
            for [x, y] in [[-7, 3], [0, 0], [5, -11], [1, 1]] {
                let bound = grid.bound(level, cells, [x, y], 0);
                let size = 1 << level;
                let block = (0..size * size).map(|at| [x + at % size, y + at / size]);
                let best = block
                    .map(|offset| grid.bound(0, cells, offset, 0))
                    .max()
                    .unwrap();
                assert!(bound >= best, "level {level}: {bound} < {best}");
                let loose = 255 * small(cells.len()) * 6 / 10;
                assert!(
                    level > 3 || bound < best + loose,
                    "level {level}: {bound}, {best}"
                );
            }
        }
    }

    #[test]
    fn hits_in_blocks_beside_each_other_are_those_in_each() {
        let grid = grid();
        // The others reach beyond the grid on all sides.
        for (middle_m, number) in [(0.0, 9), (-36.0, 50), (36.0, 50)] {
            let cells: Vec<_> = points()
                .iter()
                .map(|point| cell_of(&(point + Vector2::new(middle_m, middle_m))))
                .collect();
            for level in 1..LEVELS {
                let first = -((number / 2) << level) - 3;
                let hits = grid.hits(level, &cells, [first; 2], [number as usize; 2]);
                for (at, hits) in (0..).zip(hits) {
                    let offset = [at % number, at / number].map(|at| first + (at << level));
                    let each = cells
                        .iter()
                        .filter(|cell| grid.bound(level, &[**cell], offset, 0) > 0);
                    assert_eq!(usize::from(hits), each.count());
                }
            }
        }
    }

    #[test]
    fn a_moved_scan_is_found_and_another_place_is_not() {
        let pose = Isometry2::new(Vector2::new(-1.3, 0.7), 0.3);
        let scan: Vec<_> = points()
            .iter()
            .map(|point| pose.inverse() * point)
            .collect();
        let found = search(&scan, WINDOW).unwrap();
        let step = found.pose.translation.vector - pose.translation.vector;
        assert!(step.norm() < 0.15, "{found:?}");
        assert!(
            found.pose.rotation.angle_to(&pose.rotation).abs() < 0.04,
            "{found:?}"
        );
        assert!(found.score > 0.7, "{found:?}");
        let beside = SearchWindow {
            half_m: [0.5; 2],
            min_score: 0.8 * found.score,
            ..WINDOW
        };
        assert_eq!(search(&scan, beside), None);
    }

    #[test]
    fn a_prior_decides_where_the_scan_does_not() {
        let wall: Vec<_> = (0..20)
            .map(|at| Point2::new(3.0, -1.0 + 0.05 * f64::from(at)))
            .collect();
        let window = SearchWindow {
            prior: Some((0.02, 0.1, 0.1)),
            ..WINDOW
        };
        let (mut search, grid) = (Search::new(&wall, window), grid());
        assert!(search.advance(&grid, usize::MAX));
        let found = search.best().unwrap();
        assert!(found.pose.translation.vector.norm() < 0.15, "{found:?}");
    }
}
