//! Looking down into each cell.
//!
//! Between the lines of the plan the surface is smooth: mostly a plane, whose extremes in a cell lie at
//! the corners of the piece that the lines cut out. So a look on either side of every line near the ends
//! of its pieces finds them, however thin a wall or narrow a gap is.

use nalgebra::{Point2, Point3, Vector2};

use super::CellHeights;
use crate::scene::Scene;
use crate::truth::cells::CellGrid;
use crate::truth::crossing::clipped;
use crate::truth::plan::{Dome, Plan};

/// Parts of a cell along either axis that its area is measured by, where lines cross it and where not.
const PARTS_CROSSED: usize = 16;
const PARTS_PLAIN: usize = 4;

/// How far beside a line the looks are, metres.
const BESIDE_M: f64 = 1e-6;

/// How far from the ends of a piece of line, metres: two lines that meet at a degree or more are then
/// farther apart than [`BESIDE_M`].
const FROM_END_M: f64 = 1e-4;

/// Lines of a cell that are cut at each other: it takes the square of their number.
const MAX_CUT_LINES: usize = 32;

/// The cells in order.
pub(super) struct Columns {
    scene: Scene,
    plan: Plan,
    grid: CellGrid,
    /// Place of a cell and a line that touches it, sorted.
    touches: Vec<(usize, usize)>,
    place: usize,
}

impl Columns {
    pub(super) fn new(scene: Scene, plan: Plan, grid: CellGrid) -> Self {
        let mut touches = Vec::new();
        for (line, &[a, b]) in plan.lines.iter().enumerate() {
            for row in grid.reach(1, a.y.min(b.y), a.y.max(b.y)) {
                // Only the line's part in this row: a long one crosses few of the cells in its box.
                let least = Point2::new(a.x.min(b.x), grid.corner_m(0, row).y);
                let greatest = Point2::new(a.x.max(b.x), grid.corner_m(0, row + 1).y);
                if let Some(ends) = clipped([a, b], least, greatest) {
                    let x = ends.map(|t| a.x + (b.x - a.x) * t);
                    let columns = grid.reach(0, x[0].min(x[1]), x[0].max(x[1]));
                    touches.extend(columns.map(|column| (row * grid.size()[0] + column, line)));
                }
            }
        }
        touches.sort_unstable();
        Self {
            scene,
            plan,
            grid,
            touches,
            place: 0,
        }
    }

    fn cell(&self) -> Option<CellHeights> {
        let width = self.grid.size()[0];
        let (column, row) = (self.place % width, self.place / width);
        let cell = Cell {
            min: self.grid.corner_m(column, row),
            max: self.grid.corner_m(column + 1, row + 1),
        };
        let from = self
            .touches
            .partition_point(|(place, _)| *place < self.place);
        let pieces: Vec<Piece> = self
            .touches
            .iter()
            .skip(from)
            .take_while(|(place, _)| *place == self.place)
            .filter_map(|&(_, line)| Piece::new(*self.plan.lines.get(line)?, &cell))
            .collect();
        let mut sample_points = cell.corners();
        sample_points.extend(sample_points_beside(&pieces).filter(|&at| cell.contains(at)));
        let tops: Vec<_> = self
            .plan
            .domes
            .iter()
            .filter_map(|d| cell.top_of(d))
            .collect();
        sample_points.extend(&tops);
        let is_plain = pieces.is_empty() && tops.is_empty();
        let parts = if is_plain { PARTS_PLAIN } else { PARTS_CROSSED };
        self.sample(&sample_points, cell.min, parts)
    }

    fn sample(
        &self,
        sample_points: &[Point2<f64>],
        min_corner_m: Point2<f64>,
        parts: usize,
    ) -> Option<CellHeights> {
        let cell_m = self.grid.cell_m();
        // All that moved has been put in its place.
        let height_m = |at: Point2<f64>| self.scene.height_m(at, 0.0);
        let corners_m: Vec<_> = sample_points
            .iter()
            .filter_map(|&at| Some(Point3::new(at.x, at.y, height_m(at)?)))
            .collect();
        let samples: Vec<Option<f64>> = part_centres(min_corner_m, cell_m, parts)
            .map(height_m)
            .collect();
        let heights = || {
            let corners = corners_m.iter().map(|point| point.z);
            corners.chain(samples.iter().copied().flatten())
        };
        Some(CellHeights {
            min_m: heights().min_by(f64::total_cmp)?,
            max_m: heights().max_by(f64::total_cmp)?,
            samples_m: samples
                .iter()
                .map(|height_m| height_m.map_or(f32::NAN, |m| m as f32))
                .collect(),
            corners_m,
            min_corner_m,
            cell_m,
        })
    }
}

/// Centres of the `parts` × `parts` parts of a cell.
pub(super) fn part_centres(
    min_corner_m: Point2<f64>,
    cell_m: f64,
    parts: usize,
) -> impl Iterator<Item = Point2<f64>> {
    let step_m = cell_m / parts as f64;
    let along_m = move |n: usize| (n as f64 + 0.5) * step_m;
    (0..parts * parts)
        .map(move |n| min_corner_m + Vector2::new(along_m(n % parts), along_m(n / parts)))
}

impl Iterator for Columns {
    type Item = Option<CellHeights>;

    fn next(&mut self) -> Option<Self::Item> {
        (self.place < self.grid.cells()).then(|| {
            let cell = self.cell();
            self.place += 1;
            cell
        })
    }
}

struct Cell {
    min: Point2<f64>,
    max: Point2<f64>,
}

impl Cell {
    fn contains(&self, at: Point2<f64>) -> bool {
        (0..2).all(|axis| self.min[axis] < at[axis] && at[axis] < self.max[axis])
    }

    fn corners(&self) -> Vec<Point2<f64>> {
        let [x, y] = [0, 1].map(|axis| [self.min[axis] + BESIDE_M, self.max[axis] - BESIDE_M]);
        let corner = |n: usize| Point2::new(x[n & 1], y[n >> 1]);
        (0..4).map(corner).collect()
    }

    /// Where in the cell a dome is highest.
    fn top_of(&self, dome: &Dome) -> Option<Point2<f64>> {
        let within = |axis: usize| {
            dome.centre[axis].clamp(self.min[axis] + BESIDE_M, self.max[axis] - BESIDE_M)
        };
        let top = Point2::new(within(0), within(1));
        ((top - dome.centre).norm() < dome.radius_m).then_some(top)
    }
}

/// The part of a line in a cell.
struct Piece {
    from: Point2<f64>,
    /// Unit vector.
    along: Vector2<f64>,
    length_m: f64,
}

impl Piece {
    /// `None` where the line only touches the cell.
    fn new(line: [Point2<f64>; 2], cell: &Cell) -> Option<Self> {
        let [a, b] = line;
        let [enter, leave] = clipped(line, cell.min, cell.max)?;
        let length_m = (b - a).norm() * (leave - enter);
        (length_m > BESIDE_M).then(|| Self {
            from: a + (b - a) * enter,
            along: (b - a).normalize(),
            length_m,
        })
    }

    /// How far along it another crosses it.
    fn crossed_by_m(&self, other: &Self) -> Option<f64> {
        let sine = self.along.perp(&other.along);
        let between = other.from - self.from;
        let at_m = between.perp(&other.along) / sine;
        let on_other_m = between.perp(&self.along) / sine;
        let crosses = 0.0 < at_m
            && at_m < self.length_m
            && -BESIDE_M <= on_other_m
            && on_other_m <= other.length_m + BESIDE_M;
        crosses.then_some(at_m)
    }
}

/// Points either side of every piece, near both ends of each part that the others cut it into, and in its
/// middle.
fn sample_points_beside(pieces: &[Piece]) -> impl Iterator<Item = Point2<f64>> + '_ {
    let cutting = if pieces.len() > MAX_CUT_LINES {
        &[]
    } else {
        pieces
    };
    pieces.iter().flat_map(move |piece| {
        let mut cuts: Vec<f64> = cutting
            .iter()
            .filter_map(|other| piece.crossed_by_m(other))
            .chain([0.0, piece.length_m])
            .collect();
        cuts.sort_by(f64::total_cmp);
        let parts: Vec<[f64; 2]> = cuts.windows(2).map(|cut| [cut[0], cut[1]]).collect();
        let aside = Vector2::new(-piece.along.y, piece.along.x) * BESIDE_M;
        parts.into_iter().flat_map(move |[from_m, to_m]| {
            let inset_m = FROM_END_M.min(0.25 * (to_m - from_m));
            [from_m + inset_m, 0.5 * (from_m + to_m), to_m - inset_m]
                .into_iter()
                .flat_map(move |at_m| {
                    let on_line = piece.from + piece.along * at_m;
                    [on_line + aside, on_line - aside]
                })
        })
    })
}
