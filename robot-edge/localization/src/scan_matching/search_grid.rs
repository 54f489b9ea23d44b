//! Correlative search by branch and bound over a pyramid of a likelihood grid.
//!
//! E. Olson, "Real-Time Correlative Scan Matching", ICRA 2009, section III (likelihood grid, levels of
//! resolution); W. Hess, D. Kohler, H. Rapp, D. Andor, "Real-Time Loop Closure in 2D LIDAR SLAM", ICRA 2016, section
//! V-B (branch and bound). Hess keeps each level at full resolution; here a level is kept at twice its own, which needs
//! less than half of the memory and has somewhat looser bounds.

use nalgebra::{Isometry2, Point2, UnitComplex, Vector2};

/// Side of a cell, metres.
pub const CELL_M: f64 = 0.1;
/// Levels of the pyramid; a block of the coarsest is 32 cells, 3.2 m, wide.
const LEVELS: usize = 6;
/// Cells of a side, a multiple of the coarsest block: 35 m around the middle.
const SIDE: i32 = 22 << (LEVELS - 1);
/// Standard deviation of the likelihood of a hit, metres.
const SIGMA_M: f64 = 0.1;

/// Likelihood of a hit, 0 to 255, for the cells around the origin of its frame. The cells of level `h` are
/// `s = 2^(h − 1)` of those of level 0 wide; cell `c` holds the greatest of cells `c·s` to `(c + 3)·s − 1` of level 0, on
/// both axes: wherever a block of `2 s` cells begins, one cell bounds it.
#[derive(Clone, Debug)]
pub struct SearchGrid {
    levels: Vec<Vec<u8>>,
}

/// Region of poses, and the least score of interest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchWindow {
    /// Its middle.
    pub middle: Isometry2<f64>,
    /// Half its side along x and y, metres.
    pub half_m: f64,
    /// Half its angle, radians.
    pub half_rad: f64,
    /// A pose of this score or less is not found; 0 to 1.
    pub min_score: f64,
    /// Penalty of the score at a Mahalanobis distance of 1 from the middle, and its standard deviations
    /// (metres, radians).
    pub prior: Option<(f64, f64, f64)>,
    /// Poses this near to this one are left out (metres, radians).
    pub except: Option<(Isometry2<f64>, f64, f64)>,
}

/// Best pose of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Takes points to the frame of the grid.
    pub pose: Isometry2<f64>,
    /// Mean likelihood of the points less the penalty of the prior, 0 to 1.
    pub score: f64,
}

/// Translations `offset` to `offset + 2^level − 1`, in cells, at one angle.
#[derive(Clone, Copy, Debug)]
struct Block {
    bound: f64,
    level: usize,
    angle: usize,
    offset: [i32; 2],
}

/// A search under way: for the pose in a window at which points agree best with a grid, to a cell and to the angle at
/// which the farthest point moves by a cell.
#[derive(Clone, Debug)]
pub struct Search {
    window: SearchWindow,
    /// Turns from the middle, radians, and the cells of the points after them.
    turned: Vec<(f64, Vec<[i32; 2]>)>,
    /// Offsets at which blocks of the coarsest level begin, and how many of the blocks were scored.
    starts: Vec<[i32; 2]>,
    begun: usize,
    top: usize,
    /// Blocks to look into, the best on top.
    open: Vec<Block>,
    best: Option<Found>,
}

impl Default for SearchGrid {
    fn default() -> Self {
        let level = |level: usize| vec![0; side(level) * side(level)];
        Self {
            levels: (0..LEVELS).map(level).collect(),
        }
    }
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
        if !(0..SIDE).contains(&x) || !(0..SIDE).contains(&y) {
            return;
        }
        let (x, y) = (x as usize, y as usize);
        for (level, cells) in self.levels.iter_mut().enumerate() {
            let shift = level.saturating_sub(1);
            let (side, x, y) = (side(level), x >> shift, y >> shift);
            let behind = if level > 0 { 2 } else { 0 };
            for y in y.saturating_sub(behind)..=y {
                for x in x.saturating_sub(behind)..=x {
                    let cell = &mut cells[y * side + x];
                    *cell = value.max(*cell);
                }
            }
        }
    }

    fn bound(&self, level: usize, points: &[[i32; 2]], offset: [i32; 2]) -> f64 {
        let (side, shift, cells) = (side(level), level.saturating_sub(1), &self.levels[level]);
        let half = SIDE / 2;
        let [dx, dy] = [offset[0] + half, offset[1] + half];
        let value = |&[x, y]: &[i32; 2]| {
            // A block that begins before the grid may reach into it: the first cell bounds it.
            let (x, y) = (x + dx, y + dy);
            let reach = -(1 << level);
            if x <= reach || y <= reach {
                return 0;
            }
            let (x, y) = (x.max(0) as usize >> shift, y.max(0) as usize >> shift);
            if x >= side || y >= side {
                return 0;
            }
            u32::from(cells[y * side + x])
        };
        let sum: u32 = points.iter().map(value).sum();
        f64::from(sum) / (255.0 * points.len() as f64)
    }
}

impl Search {
    /// Of points in the frame of the vehicle.
    pub fn new(points: &[Point2<f64>], window: SearchWindow) -> Self {
        let farthest = points.iter().map(|point| point.coords.norm_squared());
        let step_rad = CELL_M / libm::sqrt(farthest.fold(1.0, f64::max));
        let turns = libm::ceil(window.half_rad / step_rad) as i32;
        let half = libm::ceil(window.half_m / CELL_M) as i32;
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
        // The coarsest level whose blocks are no larger than the window.
        let top = (0..LEVELS).rfind(|level| 1 << level <= half).unwrap_or(0);
        let offsets = || (-half..=half).step_by(1 << top);
        let starts = offsets()
            .flat_map(|y| offsets().map(move |x| [x, y]))
            .collect();
        Self {
            window,
            turned: (-turns..=turns).map(turn).collect(),
            starts,
            begun: 0,
            top,
            open: Vec::new(),
            best: None,
        }
    }

    /// Goes on by about `max_blocks` blocks; whether it is finished.
    pub fn advance(&mut self, grid: &SearchGrid, max_blocks: usize) -> bool {
        let mut least = self.best.map_or(self.window.min_score, |best| best.score);
        let starts = self.turned.len() * self.starts.len();
        let end = starts.min(self.begun.saturating_add(max_blocks));
        let mut scored = end - self.begun;
        for start in self.begun..end {
            let block = Block {
                bound: 0.0,
                level: self.top,
                angle: start / self.starts.len(),
                offset: self.starts[start % self.starts.len()],
            };
            self.open.extend(self.scored(grid, block, least));
        }
        if end == starts && self.begun < starts {
            self.open.sort_by(|a, b| a.bound.total_cmp(&b.bound));
        }
        self.begun = end;
        while self.begun == starts && scored < max_blocks {
            let Some(block) = self.open.pop() else {
                return true;
            };
            if block.bound <= least {
                continue;
            }
            if block.level == 0 {
                let pose = self.pose(&block);
                let is_left_out = self
                    .window
                    .except
                    .is_some_and(|(except, near_m, near_rad)| {
                        let way = pose.translation.vector - except.translation.vector;
                        way.norm() < near_m
                            && pose.rotation.angle_to(&except.rotation).abs() < near_rad
                    });
                if !is_left_out {
                    least = block.bound;
                    self.best = Some(Found { pose, score: least });
                }
                continue;
            }
            let level = block.level - 1;
            let half = 1 << level;
            let mut parts: Vec<_> = [(0, 0), (half, 0), (0, half), (half, half)]
                .into_iter()
                .filter_map(|(x, y)| {
                    let offset = [block.offset[0] + x, block.offset[1] + y];
                    self.scored(
                        grid,
                        Block {
                            level,
                            offset,
                            ..block
                        },
                        least,
                    )
                })
                .collect();
            scored += 4;
            parts.sort_by(|a, b| a.bound.total_cmp(&b.bound));
            self.open.extend(parts);
        }
        self.begun == starts && self.open.is_empty()
    }

    /// The best pose so far; `None` if none is above the least score.
    pub const fn best(&self) -> Option<Found> {
        self.best
    }

    /// The block with its bound, if that is above `least`.
    fn scored(&self, grid: &SearchGrid, mut block: Block, least: f64) -> Option<Block> {
        let (turn_rad, cells) = &self.turned[block.angle];
        block.bound = grid.bound(block.level, cells, block.offset);
        if let (0, Some((penalty, sigma_m, sigma_rad))) = (block.level, self.window.prior) {
            let [x, y] = block
                .offset
                .map(|cells| f64::from(cells) * CELL_M / sigma_m);
            let turn = turn_rad / sigma_rad;
            block.bound -= penalty * 0.5 * (x * x + y * y + turn * turn);
        }
        (block.bound > least).then_some(block)
    }

    fn pose(&self, block: &Block) -> Isometry2<f64> {
        let [x, y] = block.offset.map(|cells| f64::from(cells) * CELL_M);
        let middle = &self.window.middle;
        Isometry2::new(
            middle.translation.vector + Vector2::new(x, y),
            self.turned[block.angle].0 + middle.rotation.angle(),
        )
    }
}

/// Cells of a side of a level.
const fn side(level: usize) -> usize {
    SIDE as usize >> level.saturating_sub(1)
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
        half_m: 2.0,
        half_rad: 0.5,
        min_score: 0.2,
        prior: None,
        except: None,
    };

    fn search(points: &[Point2<f64>], window: SearchWindow) -> Option<Found> {
        let (mut search, grid) = (Search::new(points, window), grid());
        // In steps of any size.
        while !search.advance(&grid, 50) {}
        search.best()
    }

    #[test]
    fn every_level_bounds_the_poses_of_its_blocks() {
        let (grid, search) = (grid(), Search::new(&points(), WINDOW));
        let (_, cells) = &search.turned[search.turned.len() / 3];
        for level in 1..LEVELS {
            for [x, y] in [[-7, 3], [0, 0], [5, -11], [1, 1]] {
                let bound = grid.bound(level, cells, [x, y]);
                let size = 1 << level;
                let block = (0..size * size).map(|at| [x + at % size, y + at / size]);
                let best = block
                    .map(|offset| grid.bound(0, cells, offset))
                    .fold(0.0, f64::max);
                assert!(bound >= best, "level {level}: {bound} < {best}");
                assert!(
                    level > 3 || bound < best + 0.6,
                    "level {level}: {bound}, {best}"
                );
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
        let elsewhere = SearchWindow {
            except: Some((found.pose, 0.7, 0.3)),
            min_score: 0.8 * found.score,
            ..WINDOW
        };
        assert_eq!(search(&scan, elsewhere), None);
        let beside = SearchWindow {
            half_m: 0.5,
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
        let found = search(&wall, window).unwrap();
        assert!(found.pose.translation.vector.norm() < 0.15, "{found:?}");
    }
}
