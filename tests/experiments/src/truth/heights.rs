//! True heights of the ground and of objects, seen from above.

use nalgebra::{Point2, Point3, Vector2};

use super::outline::{circle, edges};
use super::{Bounds, CellGrid, GroundPlane, Thresholds, Verdict, clipped};
use simulation::World;
use simulation::scene::Scene;
use simulation::solid::{BOX_EDGES, Reflectivity, Shape, Solid};

/// The heights over a rectangle of cells whose edges lie at multiples of the cell size.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct HeightTruth {
    grid: CellGrid,
    cells: Vec<Option<CellHeights>>,
}

/// The surface in one cell, as seen from above: what stands under something else does not count.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CellHeights {
    /// Least height, metres above z = 0 of the world.
    pub(crate) min_m: f64,
    /// Greatest height, metres above z = 0 of the world.
    pub(crate) max_m: f64,
    /// Points of the surface among which its extremes lie, measured from any plane: either side of every
    /// line where it may bend or jump, and the cell's corners.
    pub(crate) corners_m: Vec<Point3<f64>>,
    /// Heights at the centres of equal parts of the cell's area, in rows of growing y, in a row growing x;
    /// not-a-number where there is no surface.
    samples_m: Vec<f32>,
    min_corner_m: Point2<f64>,
    cell_m: f64,
}

/// 300 MB, were all crossed by edges; 70 MB, were none.
const MAX_CELLS: usize = 1 << 18;

/// The heights of `world` over all cells that `bounds` touches. Moving solids are left out; if `glass` does not count,
/// what is under and behind it does.
///
/// Least and greatest heights are exact, to some micrometres, where surfaces are planes that meet at the
/// edges of their solids. Two exceptions: where two faces cut through each other (a ramp sunk into the
/// floor) the crease between is seen by the samples only, and so are surfaces narrower than a sample in
/// meshes of more than some 30 lines a cell. Circles count as polygons of 32 corners.
pub(crate) fn heights(
    world: &World,
    cell_m: f64,
    bounds: Bounds,
    glass: bool,
) -> anyhow::Result<HeightTruth> {
    let grid = CellGrid::new(cell_m, bounds, MAX_CELLS)?;
    let counts = |solid: &&Solid| match solid.reflectivity {
        Reflectivity::Glass { .. } => glass,
        Reflectivity::Diffuse | Reflectivity::Specular { .. } => true,
    };
    let solids: Vec<Solid> = world
        .solids()
        .iter()
        .filter(|solid| solid.motion.is_none())
        .filter(counts)
        .cloned()
        .collect();
    let columns = Columns::new(Scene::new(&solids), Plan::of(&solids), grid);
    let cells = (0..grid.cells()).map(|place| columns.cell(place));
    let cells = cells.collect();
    Ok(HeightTruth { grid, cells })
}

impl HeightTruth {
    /// The surface in the cell of index (i, j); `None` outside the grid and where there is nothing.
    pub(crate) fn get(&self, index: [i64; 2]) -> Option<&CellHeights> {
        self.cells.get(self.grid.place(index)?)?.as_ref()
    }

    /// Every cell that has a surface, with its index, rows of growing y, in a row growing x.
    pub(crate) fn iter(&self) -> impl Iterator<Item = ([i64; 2], &CellHeights)> + '_ {
        self.cells
            .iter()
            .enumerate()
            .filter_map(|(place, cell)| Some((self.grid.index(place), cell.as_ref()?)))
    }
}

impl CellHeights {
    /// Whether the cell is an obstacle to a vehicle on `ground`.
    pub(crate) fn verdict(&self, ground: &GroundPlane, thresholds: Thresholds) -> Option<Verdict> {
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
                    lines.extend(edges(&circle(solid, *radius_m, CIRCLE_CORNERS)));
                }
                Shape::Sphere { radius_m } => {
                    lines.extend(edges(&circle(solid, *radius_m, CIRCLE_CORNERS)));
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
mod tests {
    use super::*;
    use crate::truth::HEADER;

    const DOCUMENT: Thresholds = Thresholds {
        above_m: 0.10,
        below_m: -0.10,
    };

    const GROUND: &str = "shape = \"plane\"";

    fn truth(solids: &[&str], glass: bool) -> HeightTruth {
        let solids = solids.iter().map(|s| format!("\n[[solids]]\n{s}\n"));
        let solids = solids.collect::<Vec<_>>().concat();
        let world = World::parse("w", &format!("{HEADER}{solids}")).unwrap();
        let bounds = Bounds {
            min_m: [-1.0, -1.0],
            max_m: [3.0, 1.0],
        };
        heights(&world, 0.2, bounds, glass).unwrap()
    }

    fn still(solids: &[&str]) -> HeightTruth {
        truth(solids, false)
    }

    /// The surface of the cell that holds a point.
    #[track_caller]
    fn at(truth: &HeightTruth, x: f64, y: f64) -> &CellHeights {
        truth
            .get([x, y].map(|m| libm::floor(m / 0.2) as i64))
            .unwrap()
    }

    #[track_caller]
    fn check(cell: &CellHeights, min_m: f64, max_m: f64) {
        let off_m = (cell.min_m - min_m).abs().max((cell.max_m - max_m).abs());
        assert!(
            off_m < 1e-6,
            "{} {}, expected {min_m} {max_m}",
            cell.min_m,
            cell.max_m
        );
    }

    fn level(cell: &CellHeights) -> Verdict {
        cell.verdict(&GroundPlane::level(0.0), DOCUMENT).unwrap()
    }

    #[test]
    fn nothing_is_none_and_bare_ground_is_flat() {
        let empty = still(&[]);
        assert_eq!(empty.iter().count(), 0);
        let ground = still(&[GROUND]);
        assert_eq!((ground.grid.first, ground.grid.size), ([-5, -5], [20, 10]));
        assert_eq!(ground.iter().count(), 200);
        for (_, cell) in ground.iter() {
            check(cell, 0.0, 0.0);
            let verdict = level(cell);
            assert!(!verdict.is_obstacle && (verdict.margin_m - 0.1).abs() < 1e-9);
        }
        assert!(ground.get([15, 0]).is_none());
    }

    #[test]
    fn a_kerb_counts_even_if_it_covers_little_of_a_cell() {
        // Its edge at y = 0.404 leaves 2 % of the cells from 0.4 to 0.6 to the road.
        let kerb = "shape = \"box\"\ncentre_m = [1, 0.702, 0.0]\nsize_m = [8, 0.596, 0.3]";
        let truth = still(&[GROUND, kerb]);
        check(at(&truth, 0.9, 0.5), 0.0, 0.15);
        check(at(&truth, 0.9, 0.3), 0.0, 0.0);
        check(at(&truth, 0.9, 0.7), 0.15, 0.15);
        let edge = level(at(&truth, 0.9, 0.5));
        assert!(edge.is_obstacle && (edge.margin_m - 0.05).abs() < 1e-7);
        // It ends 2 mm into the next row.
        let sliver = "shape = \"box\"\ncentre_m = [1, 0.7, 0.0]\nsize_m = [8, 0.204, 0.3]";
        let grazed = level(at(&still(&[GROUND, sliver]), 0.9, 0.9));
        assert!(grazed.is_obstacle, "{grazed:?}");
    }

    #[test]
    fn a_ditch_shows_its_floor_even_where_it_is_a_crack() {
        let slabs = |gap_to: f64| {
            let right = format!(
                "shape = \"box\"\ncentre_m = [{}, 0, -0.5]\nsize_m = [4, 4, 1]",
                gap_to + 2.0
            );
            still(&[
                "shape = \"plane\"\npoint_m = [0, 0, -0.2]",
                "shape = \"box\"\ncentre_m = [-1.47, 0, -0.5]\nsize_m = [4, 4, 1]",
                &right,
            ])
        };
        let ditch = slabs(1.73);
        check(at(&ditch, 0.5, 0.1), -0.2, 0.0);
        check(at(&ditch, 0.7, 0.1), -0.2, -0.2);
        check(at(&ditch, 0.1, 0.1), 0.0, 0.0);
        assert!(level(at(&ditch, 0.7, 0.1)).is_obstacle);
        // 0.1 mm wide.
        let crack = slabs(0.5301);
        check(at(&crack, 0.5, 0.1), -0.2, 0.0);
    }

    #[test]
    fn poles_and_thin_walls_are_never_missed() {
        // A pole that reaches 2 mm into the cell at (0.4, 0), and one within a cell.
        let pole = |x: f64, radius_m: f64| {
            format!(
                "shape = \"cylinder\"\nbase_m = [{x}, 0.1, 0]\nradius_m = {radius_m}\nheight_m = 1.2"
            )
        };
        let poles = still(&[GROUND, &pole(0.352, 0.05), &pole(1.3, 0.004)]);
        check(at(&poles, 0.5, 0.1), 0.0, 1.2);
        check(at(&poles, 0.3, 0.1), 0.0, 1.2);
        check(at(&poles, 1.3, 0.1), 0.0, 1.2);
        check(at(&poles, 0.7, 0.1), 0.0, 0.0);
        // 1 mm of wall, askew: every cell that it crosses.
        let wall = "shape = \"wall\"\nfrom_m = [-0.9, -0.83]\nto_m = [2.7, 0.77]\nthickness_m = 0.001\nheight_m = 2";
        let walls = still(&[GROUND, wall]);
        let crossed = walls.iter().filter(|(_, cell)| cell.max_m > 1.0).count();
        let mut expected = std::collections::BTreeSet::new();
        for k in 0..100_000 {
            let t = f64::from(k) / 1e5;
            let on_wall = [-0.9 + 3.6 * t, -0.83 + 1.6 * t];
            expected.insert(on_wall.map(|m| libm::floor(m / 0.2) as i64));
        }
        assert!(
            (expected.len()..=expected.len() + 2).contains(&crossed),
            "{crossed} {}",
            expected.len()
        );
        for index in expected {
            check(walls.get(index).unwrap(), 0.0, 2.0);
        }
    }

    #[test]
    fn a_ball_is_highest_over_its_centre_and_a_ramp_at_its_ends() {
        let ball = still(&[
            GROUND,
            "shape = \"sphere\"\ncentre_m = [0.5, 0.1, 0.2]\nradius_m = 0.3",
        ]);
        check(at(&ball, 0.5, 0.1), 0.2 + libm::sqrt(0.07), 0.5);
        // Beside: the nearest point to the centre is 0.1 m away.
        let beside = at(&ball, 0.7, 0.1);
        assert!(
            (beside.max_m - (0.2 + libm::sqrt(0.08))).abs() < 1e-5,
            "{}",
            beside.max_m
        );
        // 10 % down from x = 0, through the world's plane along x = 2.
        let slope = format!(
            "shape = \"plane\"\npoint_m = [0, 0, 0.2]\npitch_deg = {}",
            libm::atan(0.1).to_degrees()
        );
        let ramp = still(&[GROUND, &slope]);
        check(at(&ramp, 0.5, 0.1), 0.14, 0.16);
        check(at(&ramp, 2.5, 0.1), 0.0, 0.0);
        // On the slope itself all is flat, and the level ground rises out of it.
        let on_slope = GroundPlane {
            point_m: Point3::new(0.0, 0.0, 0.2),
            normal: nalgebra::Vector3::new(0.1, 0.0, 1.0).normalize(),
        };
        let verdict = |x| at(&ramp, x, 0.1).verdict(&on_slope, DOCUMENT).unwrap();
        assert!(!verdict(0.5).is_obstacle && (verdict(0.5).margin_m - 0.1).abs() < 1e-7);
        assert!(!verdict(2.9).is_obstacle);
        let normal_z = 1.0 / libm::sqrt(1.01);
        assert!((verdict(2.9).margin_m - 0.1 * (1.0 - normal_z)).abs() < 1e-6);
    }

    #[test]
    fn glass_counts_where_asked_for_and_movers_never() {
        let pane = "shape = \"box\"\ncentre_m = [0.5, 0.1, 1]\nsize_m = [0.01, 0.1, 2]\nreflectivity.glass = { transmission = 0.9 }";
        let walker = "shape = \"cylinder\"\nbase_m = [0.5, 0.1, 0]\nradius_m = 0.25\nheight_m = 1.75\nmotion = [{ t_s = 0, x_m = 0, y_m = 0 }, { t_s = 1, x_m = 2, y_m = 0 }]\nleaves_s = 5";
        for (glass, expected_m) in [(false, [0.0, 0.0]), (true, [2.0, 0.0])] {
            let truth = truth(&[GROUND, pane, walker], glass);
            for (x, expected_m) in [0.5, 2.5].into_iter().zip(expected_m) {
                let max_m = at(&truth, x, 0.1).max_m;
                assert!((max_m - expected_m).abs() < 1e-9, "{glass} {x}: {max_m}");
            }
        }
    }

    #[test]
    fn too_many_cells_are_refused() {
        let world = World::parse("w", HEADER).unwrap();
        let bounds = Bounds {
            min_m: [0.0, 0.0],
            max_m: [1000.0, 1000.0],
        };
        let error = heights(&world, 0.1, bounds, false).unwrap_err().to_string();
        assert!(error.contains("is more than"), "{error}");
    }
}
