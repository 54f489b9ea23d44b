//! Ground truth: the perfect map of a world, by exact geometry.

pub(crate) mod outline;

mod heights;
#[cfg(test)]
#[expect(clippy::float_cmp, reason = "these values are exact")]
mod worlds;

pub(crate) use heights::{HeightTruth, heights};

use std::ops::Range;

use anyhow::ensure;
use nalgebra::{Point2, Point3, Vector2, Vector3};

use self::outline::Outline;
use simulation::World;
use simulation::scene::Scene;
use simulation::vegetation::{self, Rigidity};

/// Ground truth of one cell of a 2D occupancy grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CellKind {
    /// No surface passes through it and its centre is outside all solids.
    Free,
    /// A surface passes through it, or lies on its edge with the solid on its side.
    Occupied,
    /// Within a solid, out of reach of beams.
    Inside,
}

/// The truth of one cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TruthCell {
    /// What is there.
    pub(crate) kind: CellKind,
    /// From its centre to the nearest surface, metres; infinite in an empty world. It lets a comparison
    /// leave out cells that a surface only grazes.
    pub(crate) surface_distance_m: f64,
}

/// The truth over a rectangle of cells whose edges lie at multiples of the cell size.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TruthGrid {
    grid: CellGrid,
    cells: Vec<TruthCell>,
}

/// 128 MB.
const MAX_CELLS: usize = 1 << 23;

/// The truth of `world` in the plane of its vehicle's laser, over all cells that `bounds` touches. Moving
/// solids are left out, glass is a solid as any other.
pub(crate) fn occupancy(world: &World, cell_m: f64, bounds: Bounds) -> anyhow::Result<TruthGrid> {
    let laser = &world.simulated_vehicle().laser;
    let outline = Outline::at_height(world.solids(), laser.base_from_mount.translation.z);
    TruthGrid::of(&outline, cell_m, bounds)
}

impl TruthGrid {
    fn of(outline: &Outline, cell_m: f64, bounds: Bounds) -> anyhow::Result<Self> {
        let grid = CellGrid::new(cell_m, bounds, MAX_CELLS)?;
        let half_m = 0.5 * cell_m;
        let width = grid.size[0];
        let cells = cells_crossed(&grid, outline)
            .into_iter()
            .enumerate()
            .map(|(place, crossed)| {
                let corner_m = grid.corner_m(place % width, place / width);
                let centre_m = Point2::new(corner_m.x + half_m, corner_m.y + half_m);
                let kind = match (crossed, outline.contains(centre_m)) {
                    (Crossed::Interior, _) | (Crossed::Edge, true) => CellKind::Occupied,
                    (Crossed::No, true) => CellKind::Inside,
                    (Crossed::No | Crossed::Edge, false) => CellKind::Free,
                };
                TruthCell {
                    kind,
                    surface_distance_m: outline.distance_m(centre_m),
                }
            })
            .collect();
        Ok(Self { grid, cells })
    }

    /// Edge length of a cell, metres.
    pub(crate) fn cell_m(&self) -> f64 {
        self.grid.cell_m
    }

    /// The cell of index (i, j), which begins at (i, j) · `cell_m`; `None` outside the grid.
    pub(crate) fn get(&self, index: [i64; 2]) -> Option<TruthCell> {
        self.cells.get(self.grid.place(index)?).copied()
    }
}

/// How the surfaces pass each cell: only cells in the box of a segment are looked at.
fn cells_crossed(grid: &CellGrid, outline: &Outline) -> Vec<Crossed> {
    let mut crossed = vec![Crossed::No; grid.cells()];
    for &[a, b] in outline.segments() {
        let columns = grid.reach(0, a.x.min(b.x), a.x.max(b.x));
        for row in grid.reach(1, a.y.min(b.y), a.y.max(b.y)) {
            for column in columns.clone() {
                let min = grid.corner_m(column, row);
                let max = grid.corner_m(column + 1, row + 1);
                if let Some(cell) = crossed.get_mut(row * grid.size[0] + column) {
                    *cell = (*cell).max(passes(a, b, min, max));
                }
            }
        }
    }
    crossed
}

/// A rectangle in the world, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    /// Least x and y.
    pub(crate) min_m: [f64; 2],
    /// Greatest x and y.
    pub(crate) max_m: [f64; 2],
}

/// A rectangle of cells whose edges lie at multiples of the cell size, in rows of growing y, in a row
/// growing x.
#[derive(Clone, Copy, Debug, PartialEq)]
struct CellGrid {
    cell_m: f64,
    first: [i64; 2],
    size: [usize; 2],
}

impl CellGrid {
    /// All cells that `bounds` touches, where these are at most `most`.
    fn new(cell_m: f64, bounds: Bounds, most: usize) -> anyhow::Result<Self> {
        let first = bounds.min_m.map(|m| libm::floor(m / cell_m));
        let end = bounds.max_m.map(|m| libm::ceil(m / cell_m));
        let [width, height] = [end[0] - first[0], end[1] - first[1]];
        let finite = first.into_iter().chain(end).all(|n| n.abs() < 1e15);
        ensure!(
            finite && cell_m > 0.0 && width >= 1.0 && height >= 1.0,
            "no grid of cells of {cell_m} m in {bounds:?}"
        );
        ensure!(
            width * height <= most as f64,
            "a grid of {width} × {height} cells of {cell_m} m is more than {most}"
        );
        Ok(Self {
            cell_m,
            first: first.map(|n| n as i64),
            size: [width as usize, height as usize],
        })
    }

    fn cells(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// Position of cell (i, j) in the order of cells; `None` outside the grid.
    fn place(&self, index: [i64; 2]) -> Option<usize> {
        let column = usize::try_from(index[0].checked_sub(self.first[0])?).ok()?;
        let row = usize::try_from(index[1].checked_sub(self.first[1])?).ok()?;
        (column < self.size[0] && row < self.size[1]).then_some(row * self.size[0] + column)
    }

    /// Index of the cell at a place in the order of cells.
    fn index(&self, place: usize) -> [i64; 2] {
        let (column, row) = (place % self.size[0], place / self.size[0]);
        [self.along(0, column), self.along(1, row)]
    }

    /// Columns (axis 0) or rows (axis 1) that touch the interval.
    fn reach(&self, axis: usize, least_m: f64, greatest_m: f64) -> Range<usize> {
        // One more on either side: an interval that ends on an edge touches both cells.
        let from = libm::floor(least_m / self.cell_m) as i64 - 1 - self.first[axis];
        let to = libm::floor(greatest_m / self.cell_m) as i64 + 2 - self.first[axis];
        let clamp = |n: i64| usize::try_from(n).unwrap_or(0).min(self.size[axis]);
        clamp(from)..clamp(to)
    }

    /// The corner of least x and y of a column and row.
    fn corner_m(&self, column: usize, row: usize) -> Point2<f64> {
        Point2::new(
            self.along(0, column) as f64 * self.cell_m,
            self.along(1, row) as f64 * self.cell_m,
        )
    }

    fn along(&self, axis: usize, cell: usize) -> i64 {
        self.first[axis].saturating_add_unsigned(cell as u64)
    }
}

/// How a surface passes a cell.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Crossed {
    No,
    Edge,
    Interior,
}

/// How the segment from `a` to `b` passes the rectangle.
fn passes(a: Point2<f64>, b: Point2<f64>, min: Point2<f64>, max: Point2<f64>) -> Crossed {
    let Some([enter, leave]) = clipped([a, b], min, max) else {
        return Crossed::No;
    };
    let in_interior =
        |axis: usize| (b - a)[axis] != 0.0 || (min[axis] < a[axis] && a[axis] < max[axis]);
    if enter < leave && (0..2).all(in_interior) {
        Crossed::Interior
    } else {
        Crossed::Edge
    }
}

/// The part of a segment within a rectangle, edges included, as parameters in [0, 1].
fn clipped([a, b]: [Point2<f64>; 2], min: Point2<f64>, max: Point2<f64>) -> Option<[f64; 2]> {
    let (least, most) = (min - a, max - a);
    vegetation::clipped((b - a).into(), least.into(), most.into(), [0.0, 1.0])
}

/// The plane that a vehicle takes for the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct GroundPlane {
    /// A point on it, in the world, metres.
    pub(crate) point_m: Point3<f64>,
    /// Unit vector, up.
    pub(crate) normal: Vector3<f64>,
}

/// Heights beyond which a surface is an obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Thresholds {
    /// `H_pos` of the document, metres above the ground plane.
    pub(crate) above_m: f64,
    /// `H_neg` of the document, metres above the ground plane: it is negative.
    pub(crate) below_m: f64,
}

/// What a cell is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Verdict {
    /// Whether any of its surface lies beyond a threshold.
    pub(crate) is_obstacle: bool,
    /// How far the height that decides this is from the threshold, metres: of an obstacle the farthest
    /// beyond one, of a free cell the nearest to one.
    pub(crate) margin_m: f64,
}

impl GroundPlane {
    /// The level plane at a height.
    #[cfg(test)]
    pub(crate) fn level(z_m: f64) -> Self {
        Self {
            point_m: Point3::new(0.0, 0.0, z_m),
            normal: Vector3::z(),
        }
    }

    /// How far a point is above it, metres.
    pub(crate) fn height_m(&self, point_m: Point3<f64>) -> f64 {
        self.normal.dot(&(point_m - self.point_m))
    }
}

impl Verdict {
    /// The verdict on heights above the ground plane; `None` of no heights.
    fn of(heights_m: &[f64], thresholds: Thresholds) -> Option<Self> {
        let lowest_m = heights_m.iter().copied().min_by(f64::total_cmp)?;
        let highest_m = heights_m.iter().copied().max_by(f64::total_cmp)?;
        let beyond_m = (highest_m - thresholds.above_m).max(thresholds.below_m - lowest_m);
        Some(Self {
            is_obstacle: beyond_m > 0.0,
            margin_m: beyond_m.abs(),
        })
    }
}

/// The ground of a world apart from what stands on it. Moving solids are left out; plants count as they
/// stand without wind.
pub(crate) struct TerrainTruth<'a> {
    world: &'a World,
    ground: Scene,
    objects: Scene,
}

impl<'a> TerrainTruth<'a> {
    /// Of `world`.
    pub(crate) fn of(world: &'a World) -> Self {
        let [ground, objects] = world.ground_and_objects().map(|mut solids| {
            solids.retain(|solid| solid.motion.is_none());
            Scene::new(&solids)
        });
        Self {
            world,
            ground,
            objects,
        }
    }

    /// Height of the ground, under water too, metres above z = 0 of the world; `None` if there is none.
    pub(crate) fn ground_m(&self, at: Point2<f64>) -> Option<f64> {
        self.ground.height_m(at, 0.0)
    }

    /// Height of the highest rigid surface over a point from the ground up to `vehicle_height_m` above it,
    /// metres above z = 0 of the world: the ground's own where nothing rigid stands there, the upper bound
    /// where something goes on above. `None` where there is no ground.
    ///
    /// Of rigid plants it is the highest within a millimetre of the point.
    pub(crate) fn rigid_top_m(&self, at: Point2<f64>, vehicle_height_m: f64) -> Option<f64> {
        let ground_m = self.ground_m(at)?;
        let limit_m = ground_m + vehicle_height_m;
        let down = -nalgebra::Vector3::z();
        let above = Point3::new(at.x, at.y, limit_m);
        let on_objects_m = self
            .objects
            .cast(above, down, vehicle_height_m, 0.0)
            .map_or(ground_m, |hit| limit_m - hit.distance_m);
        let [min_m, max_m] = column(at, THIN_M, ground_m..limit_m);
        let on_plants_m = self
            .world
            .scene()
            .growth()
            .and_then(|growth| growth.vegetation.highest_m(min_m, max_m, Rigidity::Rigid));
        Some(on_plants_m.map_or(on_objects_m, |m| on_objects_m.max(m)))
    }

    /// What stands in the square column about `centre` of half width `half_m`, between two heights above
    /// z = 0 of the world, the ground left out: `None` where nothing does, and rigid where anything rigid
    /// does.
    pub(crate) fn class(
        &self,
        centre: Point2<f64>,
        half_m: f64,
        heights_m: Range<f64>,
    ) -> Option<Rigidity> {
        let [min_m, max_m] = column(centre, half_m, heights_m);
        if self.objects.touches_box(min_m, max_m, 0.0) {
            return Some(Rigidity::Rigid);
        }
        let growth = self.world.scene().growth()?;
        growth.vegetation.standing_in(min_m, max_m)
    }
}

/// Half the width of the column that stands for a point.
const THIN_M: f64 = 1e-3;

fn column(centre: Point2<f64>, half_m: f64, heights_m: Range<f64>) -> [Point3<f64>; 2] {
    let half = Vector2::repeat(half_m);
    let (min, max) = (centre - half, centre + half);
    [
        Point3::new(min.x, min.y, heights_m.start),
        Point3::new(max.x, max.y, heights_m.end),
    ]
}

/// Beginning of a world file of 5 lines.
#[cfg(test)]
pub(crate) const HEADER: &str = r#"name = "w"
vehicle = "pioneer"
noise = { range_m = 0.0, dropout = 0.0 }
start = { x_m = 0.0, y_m = 0.0, yaw_deg = 0.0 }
path = { speed_mps = 1.0, turn_rate_degps = 60.0, waypoints = [{ x_m = 1.0, y_m = 0.0 }] }
"#;

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(sections: Vec<Vec<Point2<f64>>>, cell_m: f64, max_m: f64) -> TruthGrid {
        let bounds = Bounds {
            min_m: [0.0, 0.0],
            max_m: [max_m, max_m],
        };
        TruthGrid::of(&Outline::of_sections(sections), cell_m, bounds).unwrap()
    }

    /// One line of text a row, the greatest y first.
    fn drawn(grid: &TruthGrid) -> Vec<String> {
        let [width, height] = grid.grid.size;
        (0..height)
            .rev()
            .map(|row| {
                (0..width)
                    .map(|column| {
                        let index = grid.grid.index(row * width + column);
                        match grid.get(index).unwrap().kind {
                            CellKind::Free => '.',
                            CellKind::Occupied => '#',
                            CellKind::Inside => 'i',
                        }
                    })
                    .collect()
            })
            .collect()
    }

    fn polygon<const N: usize>(corners: [[f64; 2]; N]) -> Vec<Point2<f64>> {
        corners.map(Point2::from).to_vec()
    }

    #[test]
    fn cells_of_a_box_off_the_edges() {
        let block = polygon([[0.6, 0.9], [2.4, 0.9], [2.4, 2.9], [0.6, 2.9]]);
        let grid = grid(vec![block], 0.5, 3.5);
        assert_eq!(
            drawn(&grid),
            [
                ".......", ".####..", ".#ii#..", ".#ii#..", ".#ii#..", ".####..", "......."
            ]
        );
        let cell = grid.get([2, 3]).unwrap();
        assert!((cell.surface_distance_m - 0.65).abs() < 1e-12, "{cell:?}");
        assert_eq!(grid.get([-1, 0]), None);
        assert_eq!(grid.get([7, 0]), None);
    }

    #[test]
    fn a_surface_on_an_edge_belongs_to_the_solids_side() {
        let block = polygon([[0.5, 0.5], [2.0, 0.5], [2.0, 2.0], [0.5, 2.0]]);
        assert_eq!(
            drawn(&grid(vec![block], 0.5, 2.5)),
            [".....", ".###.", ".#i#.", ".###.", "....."]
        );
    }

    #[test]
    fn a_turned_box_marks_every_cell_that_its_surface_crosses() {
        let diamond = polygon([[3.6, 2.0], [2.0, 3.6], [0.4, 2.0], [2.0, 0.4]]);
        assert_eq!(
            drawn(&grid(vec![diamond], 1.0, 4.0)),
            [".##.", "####", "####", ".##."]
        );
        let small = polygon([[2.9, 1.5], [2.5, 1.9], [2.1, 1.5], [2.5, 1.1]]);
        assert_eq!(
            drawn(&grid(vec![small], 1.0, 4.0)),
            ["....", "....", "..#.", "...."]
        );
    }

    #[test]
    fn cells_lie_at_multiples_of_their_size_and_cover_the_bounds() {
        let bounds = Bounds {
            min_m: [-0.31, 0.19],
            max_m: [0.25, 0.2],
        };
        let grid = TruthGrid::of(&Outline::default(), 0.1, bounds).unwrap();
        assert_eq!((grid.grid.first, grid.grid.size), ([-4, 1], [7, 1]));
        assert!(grid.cells.iter().all(|cell| cell.kind == CellKind::Free));
        assert_eq!(grid.grid.index(6), [2, 1]);
    }

    #[test]
    fn senseless_grids_are_refused() {
        let of = |cell_m, max_m| {
            let bounds = Bounds {
                min_m: [0.0, 0.0],
                max_m: [max_m, max_m],
            };
            TruthGrid::of(&Outline::default(), cell_m, bounds).unwrap_err()
        };
        for (cell_m, max_m) in [
            (0.0, 1.0),
            (-0.1, 1.0),
            (f64::NAN, 1.0),
            (0.1, f64::INFINITY),
            (0.1, 0.0),
            (0.1, f64::NAN),
        ] {
            let error = of(cell_m, max_m).to_string();
            assert!(error.contains("no grid"), "{cell_m} {max_m}: {error}");
        }
        let error = of(0.001, 1000.0).to_string();
        assert!(error.contains("is more than"), "{error}");
    }

    #[test]
    fn ground_and_objects_on_it_are_distinguished() {
        const SHORE: &str =
            include_str!("../../../../robot-edge/simulation/src/world/tests/shore.toml");
        let parse = |text: &str| World::parse("shore.toml", &format!("{HEADER}{text}")).unwrap();
        let world = parse(SHORE);
        let standing = TerrainTruth::of(&world);
        assert_eq!(standing.ground_m(Point2::new(0.0, 8.0)), Some(-1.0));
        let class =
            |x: f64, y: f64, from_m, to_m| standing.class(Point2::new(x, y), 0.3, from_m..to_m);
        assert_eq!(class(2.0, 1.0, 0.3, 1.5), Some(Rigidity::Flexible));
        assert_eq!(class(2.0, 1.0, 3.0, 4.0), None);
        assert_eq!(class(6.0, 1.0, 0.3, 1.5), Some(Rigidity::Rigid));
        assert_eq!(class(0.0, 8.0, -0.9, 1.0), Some(Rigidity::Rigid));
        assert_eq!(class(0.0, 8.0, 0.01, 1.0), None);
        assert_eq!(
            class(0.79, 8.0, -0.9, 1.0),
            Some(Rigidity::Rigid),
            "it reaches to 0.5"
        );
        assert_eq!(class(0.81, 8.0, -0.9, 1.0), None);
        assert_eq!(class(-3.0, 8.0, -2.0, 1.0), None, "ground does not count");
        // The stone's top is z = 0, 1 m above the bed.
        let top_m = |vehicle_m| {
            standing
                .rigid_top_m(Point2::new(0.0, 8.0), vehicle_m)
                .unwrap()
        };
        assert!((top_m(2.0) - 0.0).abs() < 1e-9 && (top_m(0.7) + 0.3).abs() < 1e-9);
        assert_eq!(standing.rigid_top_m(Point2::new(2.0, 1.0), 2.0), Some(-1.0));
        // A box that is ground is driven on.
        let paved = SHORE.replace("name = \"stone\"", "name = \"stone\"\nground = true");
        let world = parse(&paved);
        let standing = TerrainTruth::of(&world);
        assert_eq!(
            standing.ground_m(Point2::new(0.0, 8.0)).map(f64::round),
            Some(0.0)
        );
        assert_eq!(standing.class(Point2::new(0.0, 8.0), 0.3, -0.9..1.0), None);
    }
}
