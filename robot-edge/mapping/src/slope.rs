//! Slopes of columns (docs/methods.md, section 4, equation (4) and "Levels are heights"; \[HYB\]
//! §5.1).
//!
//! The sixteen columns of a tile are computed together: the sums of the least squares are box sums,
//! first along rows and then across them, in loops that the compiler vectorises.

use crate::height_columns::{Column, ColumnKind, TILE_COLUMNS, TILE_EDGE};
use crate::octree::FINER;

/// Reach of the 7×7 window to each side, columns.
pub(super) const REACH: usize = 3;
/// [`REACH`] for signed indices.
pub(super) const REACH_COLUMNS: i32 = 3;
pub(super) const PATCH_EDGE: usize = TILE_EDGE + 2 * REACH;
pub(super) const PATCH_COLUMNS: usize = PATCH_EDGE * PATCH_EDGE;

/// A tile and the columns around it, rows of growing y.
pub(super) type Patch = [Column; PATCH_COLUMNS];

/// Slopes of the columns of a tile, rise over run; NaN if unknown.
///
/// The slope of the least-squares plane through the 7×7 columns around a column if it fits within
/// half a voxel, or of the plane through its fine hits (see [`Points::fine_plane`]); otherwise α of
/// equation (4). A column whose ground was not hit gets a slope from a plane only.
///
/// On water, where the ground is as deep as the vehicle's draught, only a plane that rises out of
/// the water nearby (`beach`) is a slope; other land is steeper than any limit.
pub(super) fn slopes(patch: &Patch, cell_m: f32, beach: Option<&Beach>) -> [f32; TILE_COLUMNS] {
    let kind = |n: usize| PointKind::of(&patch[n]);
    if !(0..PATCH_COLUMNS).any(|n| kind(n).is_hit()) {
        // Most tiles over open water: no plane, and nothing rises.
        return std::array::from_fn(|column| match kind(Window::of(column).middle()) {
            PointKind::Water | PointKind::Occluded => 0.0,
            _ => f32::NAN,
        });
    }
    let points = Points::of(patch, cell_m, beach);
    let planes = Planes::of(&points);
    std::array::from_fn(|column| {
        let window = Window::of(column);
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

/// Slopes of the columns of a tile by the levels of voxels alone, rise over run; NaN if unknown, or
/// if no column around is known (\[HYB\] §5.1): the greatest of `(top_i − ground_j) / distance`.
pub(super) fn greatest_differences(patch: &Patch) -> [f32; TILE_COLUMNS] {
    std::array::from_fn(|column| {
        let window = Window::of(column);
        let own = window.middle();
        if patch[own].kind == ColumnKind::Unknown {
            return f32::NAN;
        }
        let around = window
            .columns()
            .filter(|&n| n != own && patch[n].kind != ColumnKind::Unknown);
        let rises = around.map(|n| {
            let [dx, dy] = [n % PATCH_EDGE, n / PATCH_EDGE];
            let [dx, dy] = [dx.abs_diff(own % PATCH_EDGE), dy.abs_diff(own / PATCH_EDGE)];
            let rise = (patch[own].top_z - patch[n].ground_z) as f32;
            rise / libm::sqrtf((dx * dx + dy * dy) as f32)
        });
        rises.fold(f32::NAN, f32::max)
    })
}

/// Where land that a boat can land on rises out of the water.
pub(super) struct Beach {
    /// Height of the water, z of `odom`, metres.
    pub(super) water_m: f32,
    /// Greatest distance to the water, metres.
    pub(super) reach_m: f32,
}

/// Kind of a column for the slopes around it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum PointKind {
    Unknown,
    /// Water without obstacle: level.
    Water,
    /// Ground was hit, without obstacle.
    Ground,
    /// An obstacle.
    Obstacle,
    /// Ground unknown, but no higher than what was observed through.
    Below,
    /// As `Below`, beside water.
    Occluded,
    /// Beside water: hit, and nothing observed through below.
    Bank,
}

/// The columns of a patch as arrays; x and y from the patch's middle, z from `reference_m`, metres.
struct Points {
    /// z of `odom`, metres.
    reference_m: f32,
    kind: [PointKind; PATCH_COLUMNS],
    /// 1 if the top counts for a plane.
    weight: Row,
    top: [Row; 3],
    /// Ground; of a column without hit the upper side of its lowest free voxel, an upper bound.
    ground: [Row; 3],
    /// Bounds that a plane must respect; ±[`FAR_M`] without bound.
    highest: Row,
    lowest: Row,
    /// Horizontal uncertainty of a bound along x and along y, metres.
    aside: Row,
    /// Radius of the laser spot that hit the top, metres.
    spot: Row,
}

type Row = [f32; PATCH_COLUMNS];

/// Beyond any plane, metres.
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

    const fn is_hit(self) -> bool {
        matches!(self, Self::Ground | Self::Obstacle | Self::Bank)
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
                // As deep as the vehicle's draught.
                ground[2] = (column.ground_z as f32 + 0.5) * cell_m - reference_m;
            }
            for axis in 0..3 {
                points.top[axis][n] = top[axis];
                points.ground[axis][n] = ground[axis];
            }
            if kind.is_hit() {
                points.weight[n] = 1.0;
                points.highest[n] = top[2];
            }
            points.lowest[n] = match kind {
                PointKind::Unknown => FAR_M,
                // The depth below the water is unknown, and so is whether the beams above it met
                // land right behind: a gap between hits on a gentle ramp is no hole.
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

    /// Whether the window has no other known column.
    fn is_alone(&self, window: Window) -> bool {
        let own = window.middle();
        window
            .columns()
            .all(|n| n == own || self.kind[n] == PointKind::Unknown)
    }

    /// Whether every hit is within `margin_m` of the plane, and no place farther than that below it
    /// was observed through (anywhere in its column). Ground below what was observed above the
    /// plane is consistent with it.
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

    /// Whether no obstacle's top is below the plane; without obstacle the ground is the top.
    fn tops_fit(&self, plane: Plane, window: Window, margin_m: f32) -> bool {
        let [x, y, z] = &self.top;
        window.columns().all(|n| {
            self.kind[n] != PointKind::Obstacle || plane.height(x[n], y[n]) - z[n] <= margin_m
        })
    }

    /// Plane through the fine hits around a column, if the coarser hits are consistent with it
    /// (docs/methods.md, section 4, "Coarse hits").
    ///
    /// A laser spot across a crest returns its lower part, and the hit is placed in its middle, too
    /// high by up to the spot's radius. So the coarsest tops are left out, more and more of them,
    /// if they are above the plane by no more than that radius; the rest must fit within
    /// `margin_m`.
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

    /// Terms of a column for [`Planes`].
    fn products(&self, n: usize) -> [f32; SUMS] {
        let [x, y, z] = [0, 1, 2].map(|axis| self.top[axis][n]);
        [1.0, x, y, z, x * x, x * y, y * y, x * z, y * z]
    }

    /// α of equation (4): from the grounds around and its own up to its top.
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
    /// Around a column of the tile.
    const fn of(column: usize) -> Self {
        Self {
            x: column % TILE_EDGE,
            y: column / TILE_EDGE,
        }
    }

    const fn middle(self) -> usize {
        (self.y + REACH) * PATCH_EDGE + self.x + REACH
    }

    /// Index ranges in the patch, row by row.
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

/// z = a·x + b·y + c.
#[derive(Clone, Copy)]
struct Plane {
    a: f32,
    b: f32,
    c: f32,
}

impl Plane {
    /// Least-squares plane of the sums of [`Planes`]; `None` if the points are nearly collinear.
    fn through([n, x, y, z, xx, xy, yy, xz, yz]: [f32; SUMS]) -> Option<Self> {
        if n < 3.0 {
            return None;
        }
        let mean = [x / n, y / n, z / n];
        let (xx, xy, yy) = (xx - x * mean[0], xy - x * mean[1], yy - y * mean[1]);
        let (xz, yz) = (xz - x * mean[2], yz - y * mean[2]);
        let determinant = xx * yy - xy * xy;
        let is_spread = determinant > MIN_SPREAD * (xx + yy) * (xx + yy);
        is_spread.then(|| {
            let a = (xz * yy - yz * xy) / determinant;
            let b = (yz * xx - xz * xy) / determinant;
            Self {
                a,
                b,
                c: mean[2] - a * mean[0] - b * mean[1],
            }
        })
    }

    fn slope(self) -> f32 {
        libm::sqrtf(self.a * self.a + self.b * self.b)
    }

    /// Greatest descent over a horizontal offset of one in x and in y.
    fn drop(self) -> f32 {
        self.a.abs() + self.b.abs()
    }

    #[inline]
    fn height(self, x: f32, y: f32) -> f32 {
        self.a * x + self.b * y + self.c
    }
}

/// Sums over the windows of the sixteen columns: n, x, y, z, xx, xy, yy, xz, yz.
struct Planes([[f32; TILE_COLUMNS]; SUMS]);

/// Number of sums in [`Planes`].
const SUMS: usize = 9;
/// Least ratio of the points' spread across their main direction to that along it, squared.
const MIN_SPREAD: f32 = 0.02;

impl Planes {
    /// Planes through the tops.
    fn of(points: &Points) -> Self {
        let [x, y, z] = &points.top;
        let w = &points.weight;
        let products: [Row; SUMS] = std::array::from_fn(|sum| {
            let mut row = [0.0; PATCH_COLUMNS];
            for n in 0..PATCH_COLUMNS {
                row[n] = w[n]
                    * match sum {
                        0 => 1.0,
                        1 => x[n],
                        2 => y[n],
                        3 => z[n],
                        4 => x[n] * x[n],
                        5 => x[n] * y[n],
                        6 => y[n] * y[n],
                        7 => x[n] * z[n],
                        _ => y[n] * z[n],
                    };
            }
            row
        });
        Self(products.map(|row| window_sums(&row)))
    }

    fn get(&self, column: usize) -> Option<Plane> {
        Plane::through(self.0.map(|sums| sums[column]))
    }
}

/// Box sums over the window of each column of the tile.
fn window_sums(row: &Row) -> [f32; TILE_COLUMNS] {
    let mut along = [[0.0; TILE_EDGE]; PATCH_EDGE];
    for (sums, row) in along.iter_mut().zip(row.chunks_exact(PATCH_EDGE)) {
        for step in 0..WINDOW {
            for (x, sum) in sums.iter_mut().enumerate() {
                *sum += row[x + step];
            }
        }
    }
    let mut sums = [0.0; TILE_COLUMNS];
    for (y, sums) in sums.chunks_exact_mut(TILE_EDGE).enumerate() {
        for along in &along[y..y + WINDOW] {
            for (sum, part) in sums.iter_mut().zip(along) {
                *sum += part;
            }
        }
    }
    sums
}
