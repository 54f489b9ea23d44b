//! The true ground, and what stands on it.

use nalgebra::Point2;

use super::{Cell, LandWorld, around};
use crate::ExperimentError;
use simulation::truth::TerrainTruth;
use simulation::vegetation::Rigidity;

/// Columns around one whose slope it shares, each way [HYB 5.1].
pub(crate) const REACH: i64 = 3;
/// Farthest that the ground of a plane is from it, metres: what rounded heights of a world file make of one.
const PLANE_M: f64 = 0.002;

/// The ground over a rectangle of columns.
pub(crate) struct Ground<'a> {
    standing: TerrainTruth<'a>,
    cell_m: f64,
    vehicle_height_m: f64,
    first: Cell,
    /// Columns along x and y.
    size: [usize; 2],
    /// Heights of the columns' corners, rows of growing y, one more than there are columns; not-a-number where
    /// there is no ground.
    corners_m: Vec<f64>,
}

impl<'a> Ground<'a> {
    /// Of the columns that a rectangle touches, metres.
    ///
    /// # Errors
    /// Where the rectangle holds more columns than a map of any experiment.
    pub(crate) fn of(
        world: &'a LandWorld,
        [min_m, max_m]: [[f64; 2]; 2],
    ) -> Result<Self, ExperimentError> {
        let standing = TerrainTruth::of(&world.world);
        let (first, last) = (world.cell_at(min_m), world.cell_at(max_m));
        let size = [0, 1].map(|axis| usize::try_from(last[axis] - first[axis] + 1).unwrap_or(0));
        if size[0].saturating_mul(size[1]) > MAX_COLUMNS {
            return Err(world.unsuitable("is too large"));
        }
        let cell_m = world.cell_m();
        let corner = |place: usize| {
            let at = [place % (size[0] + 1), place / (size[0] + 1)];
            let [x, y] = [0, 1].map(|axis| (first[axis] + signed(at[axis])) as f64 * cell_m);
            standing.ground_m(Point2::new(x, y)).unwrap_or(f64::NAN)
        };
        let corners_m = (0..(size[0] + 1) * (size[1] + 1)).map(corner).collect();
        Ok(Self {
            vehicle_height_m: world.vehicle_height_m(),
            standing,
            cell_m,
            first,
            size,
            corners_m,
        })
    }

    /// The first of the columns and the last.
    pub(crate) fn corners(&self) -> [Cell; 2] {
        let last = [0, 1].map(|axis| self.first[axis] + signed(self.size[axis]) - 1);
        [self.first, last]
    }

    /// The columns.
    pub(crate) fn cells(&self) -> impl Iterator<Item = Cell> + use<> {
        let ([x, y], [width, height]) = (self.first, self.size);
        (0..signed(height)).flat_map(move |row| (0..signed(width)).map(move |n| [x + n, y + row]))
    }

    /// Height of the ground at a point, metres.
    pub(crate) fn height_m(&self, at: Point2<f64>) -> Option<f64> {
        self.standing.ground_m(at)
    }

    /// Lowest and highest ground of a column, metres.
    pub(crate) fn heights_m(&self, cell: Cell) -> Option<[f64; 2]> {
        let corners = [[0, 0], [1, 0], [0, 1], [1, 1]];
        let heights = corners.map(|[x, y]| self.corner_m([cell[0] + x, cell[1] + y]));
        let [mut low, mut high] = [f64::INFINITY, f64::NEG_INFINITY];
        for height_m in heights {
            low = low.min(height_m?);
            high = high.max(height_m?);
        }
        Some([low, high])
    }

    /// Rise over run of the ground where the columns that a slope is made of lie on one plane, and those beside
    /// them: noise carries hits over their edges.
    pub(crate) fn slope(&self, cell: Cell) -> Option<f64> {
        let corner = |x: i64, y: i64| self.corner_m([cell[0] + x, cell[1] + y]);
        let (from, to) = (-REACH - 1, REACH + 2);
        let origin_m = corner(from, from)?;
        let per_cell = |end_m: f64| (end_m - origin_m) / (to - from) as f64;
        let (along_x, along_y) = (per_cell(corner(to, from)?), per_cell(corner(from, to)?));
        for y in from..=to {
            for x in from..=to {
                let plane_m = origin_m + along_x * (x - from) as f64 + along_y * (y - from) as f64;
                if (corner(x, y)? - plane_m).abs() > PLANE_M {
                    return None;
                }
            }
        }
        Some(libm::hypot(along_x, along_y) / self.cell_m)
    }

    /// What stands within `aside_m` of a column between two heights above its ground, metres; the ground's own
    /// unevenness is left out.
    pub(crate) fn standing(&self, cell: Cell, aside_m: f64, above_m: [f64; 2]) -> Option<Rigidity> {
        let [low, high] = self.heights_m(cell)?;
        let [from_m, to_m] = above_m;
        let half_m = 0.5 * self.cell_m + aside_m;
        self.standing
            .class(self.centre_m(cell), half_m, low + from_m..high + to_m)
    }

    /// Whether the vehicle meets nothing within `aside_m` of a column.
    pub(crate) fn is_bare(&self, cell: Cell, aside_m: f64) -> bool {
        let above_m = [BELOW_M, self.vehicle_height_m + MARGIN_M];
        self.heights_m(cell).is_some() && self.standing(cell, aside_m, above_m).is_none()
    }

    /// Δ of \[HYB\] §5.1 by exact geometry: from the lowest ground around up to the highest rigid thing of the
    /// column that is no higher than the vehicle.
    pub(crate) fn steepest(&self, cell: Cell) -> Option<f64> {
        let [_, high] = self.heights_m(cell)?;
        let above_m = [MARGIN_M, self.vehicle_height_m];
        let top_m = if self.standing(cell, 0.0, above_m) == Some(Rigidity::Rigid) {
            let centre = self.centre_m(cell);
            let parts = around([0, 0], 1).map(|part| {
                let [x, y] = part.map(|n| n as f64 * 0.3 * self.cell_m);
                let at = Point2::new(centre.x + x, centre.y + y);
                self.standing.rigid_top_m(at, self.vehicle_height_m)
            });
            parts.flatten().fold(high, f64::max)
        } else {
            high
        };
        let rise = |other: Cell| {
            let [low, _] = self.heights_m(other)?;
            let [x, y] = [0, 1].map(|axis| (other[axis] - cell[axis]) as f64 * self.cell_m);
            Some((top_m - low) / libm::hypot(x, y).max(self.cell_m))
        };
        around(cell, REACH).filter_map(rise).max_by(f64::total_cmp)
    }

    fn centre_m(&self, cell: Cell) -> Point2<f64> {
        let [x, y] = cell.map(|n| (n as f64 + 0.5) * self.cell_m);
        Point2::new(x, y)
    }

    fn corner_m(&self, corner: Cell) -> Option<f64> {
        let [x, y] = [0, 1].map(|axis| usize::try_from(corner[axis] - self.first[axis]).ok());
        let (x, y) = (x.filter(|x| *x <= self.size[0])?, y?);
        let height_m = self.corners_m.get(y * (self.size[0] + 1) + x).copied()?;
        (!height_m.is_nan()).then_some(height_m)
    }
}

/// What begins lower than its ground counts as standing on it, metres.
const BELOW_M: f64 = -0.05;
/// A voxel, metres: what is nearer than this to a bound may be taken for either.
const MARGIN_M: f64 = 0.1;
/// 400 m × 400 m in columns of 0.1 m.
const MAX_COLUMNS: usize = 1 << 24;

/// There are no more columns than [`MAX_COLUMNS`].
fn signed(n: usize) -> i64 {
    i64::try_from(n).unwrap_or(i64::MAX)
}
