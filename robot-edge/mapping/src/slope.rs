//! How steep a column is, from what lies around it (\[HYB\] §5.1, with heights in place of voxel indices).
//!
//! A tile's sixteen columns are done at once: the sums of the least squares are those of a box of columns, first
//! along rows and then across them, and every step is a loop over plain numbers that the compiler makes vectors of.

mod planes;

use super::height_columns::{Column, ColumnKind, TILE_COLUMNS, TILE_EDGE};
use super::octree::FINER;
use planes::{Plane, Planes, SUMS};

/// Columns around one that count, each way.
pub(super) const REACH: usize = 3;
/// [`REACH`] for indices, which are signed.
pub(super) const REACH_COLUMNS: i32 = 3;
/// Columns along the edge of what a tile needs.
pub(super) const PATCH_EDGE: usize = TILE_EDGE + 2 * REACH;
/// Columns of what a tile needs.
pub(super) const PATCH_COLUMNS: usize = PATCH_EDGE * PATCH_EDGE;

/// A tile and the columns around it, rows of growing y.
pub(super) type Patch = [Column; PATCH_COLUMNS];

/// The slopes of the columns of a tile, rise over run; NaN where unknown.
///
/// That of the plane that fits the 7×7 columns around a column to half a voxel, or those of them that were hit finely,
/// see [`Points::fine_plane`]; where none does, Δ of the document, from the ground of each of them and of its own up to
/// its top. Of a column where no beam met the ground, only a plane says something.
///
/// On water, where the ground is as deep as the vehicle reaches, land is steeper than anything; only a plane that comes
/// out of the water nearby, `beach`, is a slope.
pub(super) fn slopes(patch: &Patch, cell_m: f32, beach: Option<&Beach>) -> [f32; TILE_COLUMNS] {
    let points = Points::of(patch, cell_m, beach);
    let planes = Planes::of(&points);
    std::array::from_fn(|column| {
        let window = Window {
            x: column % TILE_EDGE,
            y: column / TILE_EDGE,
        };
        let own = window.middle();
        let plane = || {
            planes
                .get(column)
                .filter(|plane| points.fit(*plane, window, &points.highest, 0.5 * cell_m))
                .or_else(|| points.fine_plane(window, 0.5 * cell_m))
        };
        let land = || {
            let [x, y] = [0, 1].map(|axis| points.ground[axis][own]);
            plane().filter(|plane| {
                let water_m = beach.map(|beach| beach.water_m - points.reference_m);
                let above_m = water_m.map_or(0.0, |water_m| plane.height(x, y) - water_m);
                let reach_m = beach.map_or(0.0, |beach| beach.reach_m);
                above_m <= plane.slope() * reach_m
            })
        };
        match points.kind[own] {
            PointKind::Unknown => f32::NAN,
            PointKind::Water => 0.0,
            PointKind::Below => plane().map_or(f32::NAN, Plane::slope),
            PointKind::Occluded => land().map_or(0.0, Plane::slope),
            PointKind::Bank => land().map_or(f32::INFINITY, Plane::slope),
            PointKind::Ground | PointKind::Obstacle if points.is_alone(window) => f32::NAN,
            PointKind::Ground | PointKind::Obstacle => {
                plane().map_or_else(|| points.steepest(window, cell_m), Plane::slope)
            }
        }
    })
}

/// Where land that a boat can land on comes out of the water.
pub(super) struct Beach {
    /// Height of the water, z of `odom`, metres.
    pub(super) water_m: f32,
    /// It is no farther away, metres.
    pub(super) reach_m: f32,
}

/// What a column is to the slopes around it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum PointKind {
    Unknown,
    /// Water and nothing on it: level, whatever rises beside it.
    Water,
    /// Ground that was hit and nothing on it.
    Ground,
    /// Something stands there.
    Obstacle,
    /// Where the ground lies is not known, but that it is no higher than what was seen through.
    Below,
    /// The same beside water.
    Occluded,
    /// Beside water: what was hit, and nothing seen through beneath it.
    Bank,
}

/// The columns of a patch, a number of each in a row; x and y from the patch's middle, z from a height nearby, metres.
struct Points {
    /// The height that z is from, metres.
    reference_m: f32,
    kind: [PointKind; PATCH_COLUMNS],
    /// 1 where the top counts for a plane.
    weight: Row,
    top: [Row; 3],
    /// Of a column that nothing hit the upper side of its lowest free voxel: the ground is no higher.
    ground: [Row; 3],
    /// What must not be above a plane, nor below it; far on the other side where nothing needs to be.
    highest: Row,
    lowest: Row,
    /// How far from where it is compared a column may have been seen through, along x and along y, metres.
    aside: Row,
    /// How finely the top's height is known: the radius of the spot of light that came back from it.
    spot: Row,
}

type Row = [f32; PATCH_COLUMNS];

/// Farther than anything from a plane, metres.
const FAR_M: f32 = 1e6;

impl PointKind {
    const fn of(column: &Column) -> Self {
        let is_clear = column.top_z <= column.ground_z;
        match (column.kind, is_clear) {
            (ColumnKind::Unknown, _) => Self::Unknown,
            (ColumnKind::Inferred, true) => Self::Below,
            (ColumnKind::Sampled, true) => Self::Ground,
            (ColumnKind::Water, true) => Self::Water,
            (ColumnKind::Occluded, true) => Self::Occluded,
            (ColumnKind::Bank, _) => Self::Bank,
            (
                ColumnKind::Inferred
                | ColumnKind::Sampled
                | ColumnKind::Water
                | ColumnKind::Occluded,
                false,
            ) => Self::Obstacle,
        }
    }
}

impl Points {
    fn of(patch: &Patch, cell_m: f32, beach: Option<&Beach>) -> Self {
        let middle = patch[PATCH_EDGE * (REACH + 1) + REACH + 1];
        let reference_m = middle.ground_z as f32 * cell_m;
        let water_m = beach.map_or(-FAR_M, |beach| beach.water_m);
        let mut points = Self {
            reference_m,
            kind: std::array::from_fn(|n| PointKind::of(&patch[n])),
            weight: [0.0; PATCH_COLUMNS],
            top: [[0.0; PATCH_COLUMNS]; 3],
            ground: [[0.0; PATCH_COLUMNS]; 3],
            highest: [-FAR_M; PATCH_COLUMNS],
            lowest: [FAR_M; PATCH_COLUMNS],
            aside: [0.0; PATCH_COLUMNS],
            spot: std::array::from_fn(|n| patch[n].top_spot_m),
        };
        for (n, column) in patch.iter().enumerate() {
            let corner = [n % PATCH_EDGE, n / PATCH_EDGE];
            let corner = corner.map(|at| (at as f32 - 0.5 * PATCH_EDGE as f32) * cell_m);
            let [top, mut ground] = [column.top_m, column.ground_m]
                .map(|[x, y, z]| [corner[0] + x, corner[1] + y, z - reference_m]);
            let kind = points.kind[n];
            let seen_to_m = ground[2];
            if column.kind == ColumnKind::Inferred {
                let height = (column.ground_z + 2) as f32 * cell_m - reference_m;
                ground = [corner[0] + 0.5 * cell_m, corner[1] + 0.5 * cell_m, height];
                points.aside[n] = 0.5 * cell_m;
            }
            if column.kind == ColumnKind::Water {
                // As deep as the vehicle reaches.
                ground[2] = (column.ground_z as f32 + 0.5) * cell_m - reference_m;
            }
            for axis in 0..3 {
                points.top[axis][n] = top[axis];
                points.ground[axis][n] = ground[axis];
            }
            let is_hit = matches!(
                kind,
                PointKind::Ground | PointKind::Obstacle | PointKind::Bank
            );
            if is_hit {
                points.weight[n] = 1.0;
                points.highest[n] = top[2];
            }
            points.lowest[n] = match kind {
                PointKind::Unknown => FAR_M,
                // Nobody knows how deep it is beneath the water, nor whether the beams that passed above it met land
                // right behind: a gap between hits on a gentle ramp is no hole in it.
                PointKind::Water => seen_to_m.max(water_m - reference_m),
                PointKind::Ground
                | PointKind::Obstacle
                | PointKind::Below
                | PointKind::Occluded
                | PointKind::Bank => ground[2],
            };
        }
        points
    }

    /// Whether nothing else is known around the middle of a window.
    fn is_alone(&self, window: Window) -> bool {
        let own = window.middle();
        window
            .columns()
            .all(|n| n == own || self.kind[n] == PointKind::Unknown)
    }

    /// Whether nothing is farther from the plane than `margin_m`: neither what was hit, nor a place that far below
    /// it that was seen through, which may be anywhere in its column. That the ground lies beneath what was seen above
    /// the plane says nothing against it.
    fn fit(&self, plane: Plane, window: Window, highest: &Row, margin_m: f32) -> bool {
        let mut misfits = 0;
        let drop = plane.drop();
        for row in window.rows() {
            let [top_x, top_y] = [&self.top[0][row.clone()], &self.top[1][row.clone()]];
            let [ground_x, ground_y] = [&self.ground[0][row.clone()], &self.ground[1][row.clone()]];
            let (highest, lowest) = (&highest[row.clone()], &self.lowest[row.clone()]);
            let aside = &self.aside[row];
            for n in 0..WINDOW {
                let above = highest[n] - plane.height(top_x[n], top_y[n]);
                let ground = plane.height(ground_x[n], ground_y[n]) - drop * aside[n];
                let below = ground - lowest[n];
                misfits |= u32::from(above > margin_m) | u32::from(below > margin_m);
            }
        }
        misfits == 0 && self.tops_fit(plane, window, margin_m)
    }

    /// Whether no obstacle's top is below the plane; of what has none its ground is the top.
    fn tops_fit(&self, plane: Plane, window: Window, margin_m: f32) -> bool {
        let [x, y, z] = &self.top;
        window.columns().all(|n| {
            self.kind[n] != PointKind::Obstacle || plane.height(x[n], y[n]) - z[n] <= margin_m
        })
    }

    /// The plane through what was hit finely around a column, where coarser hits say nothing against it.
    ///
    /// A spot of light that lies across a crest sends back its lower part, and the hit is placed in its middle: too
    /// high by up to its radius. So the coarsest tops are left out, more and more of them, and need lie no farther
    /// above the plane than that is; what is left is held to `margin_m` as ever.
    fn fine_plane(&self, window: Window, margin_m: f32) -> Option<Plane> {
        let hit = || window.columns().filter(|&n| self.weight[n] > 0.0);
        let coarsest_m = hit().map(|n| self.spot[n]).fold(0.0, f32::max);
        let finer = |limit_m: &f32| {
            let is_coarse = *limit_m > margin_m;
            is_coarse.then(|| (FINER as f32 * limit_m).max(margin_m))
        };
        let mut limits_m = std::iter::successors(finer(&coarsest_m), finer);
        let plane = |limit_m: f32| {
            let mut sums = [0.0; SUMS];
            let mut highest = self.highest;
            for n in hit() {
                if self.spot[n] > limit_m {
                    highest[n] -= self.spot[n] - margin_m;
                } else {
                    for (sum, product) in sums.iter_mut().zip(self.products(n)) {
                        *sum += product;
                    }
                }
            }
            Plane::through(sums).filter(|plane| self.fit(*plane, window, &highest, margin_m))
        };
        limits_m.find_map(plane)
    }

    /// What a column adds to [`Planes`].
    fn products(&self, n: usize) -> [f32; SUMS] {
        let [x, y, z] = [0, 1, 2].map(|axis| self.top[axis][n]);
        [1.0, x, y, z, x * x, x * y, y * y, x * z, y * z]
    }

    /// Δ of the document: from the ground around it, and its own, up to its top.
    fn steepest(&self, window: Window, cell_m: f32) -> f32 {
        let own = window.middle();
        let [x, y, top_m] = [0, 1, 2].map(|axis| self.top[axis][own]);
        let rise = |n: usize| {
            let [dx, dy] = [x - self.ground[0][n], y - self.ground[1][n]];
            (top_m - self.ground[2][n]) / libm::sqrtf(dx * dx + dy * dy).max(cell_m)
        };
        let known = window
            .columns()
            .filter(|&n| self.kind[n] != PointKind::Unknown);
        known.map(rise).fold(0.0, f32::max)
    }
}

/// The columns up to [`REACH`] around a column of a tile.
#[derive(Clone, Copy)]
struct Window {
    x: usize,
    y: usize,
}

/// Columns along the edge of a window.
const WINDOW: usize = 2 * REACH + 1;

impl Window {
    const fn middle(self) -> usize {
        (self.y + REACH) * PATCH_EDGE + self.x + REACH
    }

    /// Their places in the patch, row by row.
    fn rows(self) -> impl Iterator<Item = std::ops::Range<usize>> + Clone {
        (0..WINDOW).map(move |row| {
            let first = (self.y + row) * PATCH_EDGE + self.x;
            first..first + WINDOW
        })
    }

    fn columns(self) -> impl Iterator<Item = usize> + Clone {
        self.rows().flatten()
    }
}
