//! True heights of the ground and of objects, seen from above.

use nalgebra::{Point2, Point3, Vector2};

use super::outline::edges;
use super::{Bounds, CellGrid, GroundPlane, Thresholds, TruthError, Verdict, clipped};
use crate::scene::Scene;
use crate::solid::{BOX_EDGES, Reflectivity, Shape, Solid};
use crate::world::World;

/// Which objects count as surface.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct HeightOptions {
    /// Whether glass does. By default what is under and behind it does.
    pub glass: bool,
    /// Whether moving solids do, where they are at this time in seconds since the beginning. By default
    /// they are left out.
    pub moving_at_s: Option<f64>,
}

/// The heights over a rectangle of cells whose edges lie at multiples of the cell size.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightTruth {
    grid: CellGrid,
    cells: Vec<Option<CellHeights>>,
}

/// The surface in one cell, as seen from above: what stands under something else does not count.
#[derive(Clone, Debug, PartialEq)]
pub struct CellHeights {
    /// Least height, metres above z = 0 of the world.
    pub min_m: f64,
    /// Greatest height, metres above z = 0 of the world.
    pub max_m: f64,
    /// Points of the surface among which its extremes lie, measured from any plane: either side of every
    /// line where it may bend or jump, and the cell's corners.
    pub corners_m: Vec<Point3<f64>>,
    /// Heights at the centres of equal parts of the cell's area, in rows of growing y, in a row growing x;
    /// not-a-number where there is no surface.
    samples_m: Vec<f32>,
    min_corner_m: Point2<f64>,
    cell_m: f64,
}

/// 300 MB, were all crossed by edges; 70 MB, were none.
const MAX_CELLS: usize = 1 << 18;

/// The heights of `world` over all cells that `bounds` touches.
///
/// Least and greatest heights are exact, to some micrometres, where surfaces are planes that meet at the
/// edges of their solids. Two exceptions: where two faces cut through each other (a ramp sunk into the
/// floor) the crease between is seen by the samples only, and so are surfaces narrower than a sample in
/// meshes of more than some 30 lines a cell. Circles count as polygons of 32 corners.
pub fn heights(
    world: &World,
    cell_m: f64,
    bounds: Bounds,
    options: HeightOptions,
) -> Result<HeightTruth, TruthError> {
    let grid = CellGrid::new(cell_m, bounds, MAX_CELLS)?;
    let counts = |solid: &&Solid| match solid.reflectivity {
        Reflectivity::Glass { .. } => options.glass,
        Reflectivity::Diffuse | Reflectivity::Specular { .. } => true,
    };
    let solids: Vec<Solid> = world
        .solids()
        .iter()
        .filter(counts)
        .filter_map(|solid| match solid.motion {
            Some(_) => solid.at(options.moving_at_s?),
            None => Some(solid.clone()),
        })
        .collect();
    let columns = Columns::new(Scene::new(&solids), Plan::of(&solids), grid);
    let cells = (0..grid.cells()).map(|place| columns.cell(place));
    let cells = cells.collect();
    Ok(HeightTruth { grid, cells })
}

impl HeightTruth {
    /// The surface in the cell of index (i, j); `None` outside the grid and where there is nothing.
    pub fn get(&self, index: [i64; 2]) -> Option<&CellHeights> {
        self.cells.get(self.grid.place(index)?)?.as_ref()
    }

    /// Every cell that has a surface, with its index, rows of growing y, in a row growing x.
    pub fn iter(&self) -> impl Iterator<Item = ([i64; 2], &CellHeights)> + '_ {
        self.cells
            .iter()
            .enumerate()
            .filter_map(|(place, cell)| Some((self.grid.index(place), cell.as_ref()?)))
    }
}

impl CellHeights {
    /// Whether the cell is an obstacle to a vehicle on `ground`.
    pub fn verdict(&self, ground: &GroundPlane, thresholds: Thresholds) -> Option<Verdict> {
        let points = self.corners_m.iter().copied().chain(self.samples());
        let heights_m: Vec<f64> = points.map(|point| ground.height_m(point)).collect();
        Verdict::of(&heights_m, thresholds)
    }

    fn samples(&self) -> impl Iterator<Item = Point3<f64>> + '_ {
        let parts = self.samples_m.len().isqrt();
        part_centres(self.min_corner_m, self.cell_m, parts)
            .zip(&self.samples_m)
            .filter(|(_, height_m)| !height_m.is_nan())
            .map(|(at, &height_m)| Point3::new(at.x, at.y, f64::from(height_m)))
    }
}

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

/// Looks down into each cell.
///
/// Between the lines of the plan the surface is smooth: mostly a plane, whose extremes in a cell lie at the corners
/// of the piece that the lines cut out. So a look on either side of every line near the ends of its pieces finds
/// them, however thin a wall or narrow a gap is.
struct Columns {
    scene: Scene,
    plan: Plan,
    grid: CellGrid,
    /// Place of a cell and a line that touches it, sorted.
    touches: Vec<(usize, usize)>,
}

impl Columns {
    fn new(scene: Scene, plan: Plan, grid: CellGrid) -> Self {
        let mut touches = Vec::new();
        for (line, &[a, b]) in plan.lines.iter().enumerate() {
            for row in grid.reach(1, a.y.min(b.y), a.y.max(b.y)) {
                // Only the line's part in this row: a long one crosses few of the cells in its box.
                let least = Point2::new(a.x.min(b.x), grid.corner_m(0, row).y);
                let greatest = Point2::new(a.x.max(b.x), grid.corner_m(0, row + 1).y);
                if let Some(ends) = clipped([a, b], least, greatest) {
                    let x = ends.map(|t| a.x + (b.x - a.x) * t);
                    let columns = grid.reach(0, x[0].min(x[1]), x[0].max(x[1]));
                    touches.extend(columns.map(|column| (row * grid.size[0] + column, line)));
                }
            }
        }
        touches.sort_unstable();
        Self {
            scene,
            plan,
            grid,
            touches,
        }
    }

    fn cell(&self, place: usize) -> Option<CellHeights> {
        let width = self.grid.size[0];
        let (column, row) = (place % width, place / width);
        let cell = Cell {
            min: self.grid.corner_m(column, row),
            max: self.grid.corner_m(column + 1, row + 1),
        };
        let from = self.touches.partition_point(|(cell, _)| *cell < place);
        let pieces: Vec<Piece> = self
            .touches
            .iter()
            .skip(from)
            .take_while(|(cell, _)| *cell == place)
            .filter_map(|&(_, line)| Piece::new(*self.plan.lines.get(line)?, &cell))
            .collect();
        let mut sample_points = cell.corners();
        sample_points.extend(sample_points_beside(&pieces).filter(|&at| cell.contains(at)));
        let domes = self.plan.domes.iter();
        let tops: Vec<_> = domes.filter_map(|dome| cell.top_of(dome)).collect();
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
        let cell_m = self.grid.cell_m;
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
fn part_centres(
    min_corner_m: Point2<f64>,
    cell_m: f64,
    parts: usize,
) -> impl Iterator<Item = Point2<f64>> {
    let step_m = cell_m / parts as f64;
    let along_m = move |n: usize| (n as f64 + 0.5) * step_m;
    (0..parts * parts)
        .map(move |n| min_corner_m + Vector2::new(along_m(n % parts), along_m(n / parts)))
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

/// The lines of all solids across which the surface seen from above may bend or jump.
struct Plan {
    lines: Vec<[Point2<f64>; 2]>,
    domes: Vec<Dome>,
}

/// A solid whose top is round.
struct Dome {
    centre: Point2<f64>,
    radius_m: f64,
}

/// Corners of the polygon that stands for a circle; they lie on it.
const CIRCLE_CORNERS: usize = 32;

impl Plan {
    fn of(solids: &[Solid]) -> Self {
        let (mut lines, mut domes) = (Vec::new(), Vec::new());
        for solid in solids {
            match &solid.shape {
                Shape::Plane => {}
                Shape::Box { size_m } => {
                    let corners = solid.box_corners_m(*size_m).map(|corner| corner.xy());
                    lines.extend(BOX_EDGES.map(|edge| edge.map(|corner| corners[corner])));
                }
                Shape::Cylinder { radius_m, .. } => {
                    lines.extend(edges(&solid.circle(*radius_m, CIRCLE_CORNERS)));
                }
                Shape::Sphere { radius_m } => {
                    lines.extend(edges(&solid.circle(*radius_m, CIRCLE_CORNERS)));
                    domes.push(Dome {
                        centre: solid.world_from_solid.translation.vector.xy().into(),
                        radius_m: *radius_m,
                    });
                }
                Shape::Mesh(mesh) => {
                    for corners in mesh.triangles_m() {
                        let corners = corners.map(|corner| (solid.world_from_solid * corner).xy());
                        lines.extend(edges(&corners));
                    }
                }
            }
        }
        // Upright edges are points on a plan.
        lines.retain(|[a, b]| a != b);
        Self { lines, domes }
    }
}

#[cfg(test)]
mod tests;
