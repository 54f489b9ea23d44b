//! The surfaces of all solids together in one horizontal plane.

use nalgebra::{Point2, Point3, Vector2, Vector3};

use simulation::solid::{BOX_EDGES, Shape, Solid};

/// The boundary of the union of the solids' sections; moving solids are left out.
///
/// Where solids overlap or stand flush against each other the surface between them is no surface: no beam
/// reaches it.
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct Outline {
    sections: Vec<Vec<Point2<f64>>>,
    segments: Vec<[Point2<f64>; 2]>,
}

/// Solids closer than this stand flush, metres: far below a laser's resolution, far above rounding.
const FLUSH_M: f64 = 1e-9;

impl Outline {
    /// The outline of what of `solids` reaches `height_m` and stands still.
    pub(crate) fn at_height(solids: &[Solid], height_m: f64) -> Self {
        let (mut areas, mut lines) = (Vec::new(), Vec::new());
        for solid in solids.iter().filter(|solid| solid.motion.is_none()) {
            match section_of(solid, height_m) {
                Section::Nothing => {}
                Section::Area(corners) => areas.push(corners),
                Section::Lines(pieces) => lines.extend(pieces),
            }
        }
        let mut outline = Self::of_sections(areas);
        for line in lines {
            let visible = visible_parts(line, &mut outline.sections.iter());
            outline.segments.extend(visible);
        }
        outline
    }

    /// The outline of convex polygons, each counter-clockwise.
    pub(super) fn of_sections(sections: Vec<Vec<Point2<f64>>>) -> Self {
        let mut segments = Vec::new();
        for (index, section) in sections.iter().enumerate() {
            for edge in edges(section) {
                let mut others = sections
                    .iter()
                    .enumerate()
                    .filter_map(|(other, cover)| (other != index).then_some(cover));
                segments.extend(visible_parts(edge, &mut others));
            }
        }
        Self { sections, segments }
    }

    /// Straight pieces of surface, the solid on their left where it has an inside.
    pub(crate) fn segments(&self) -> &[[Point2<f64>; 2]] {
        &self.segments
    }

    /// Whether a point is in a solid or on its surface.
    pub(crate) fn contains(&self, point: Point2<f64>) -> bool {
        self.sections
            .iter()
            .any(|section| edges(section).all(|edge| outward_distance_m(edge, point) <= 0.0))
    }

    /// Distance from a point, inside or outside, to the nearest surface, metres; infinite where there is
    /// none.
    pub(crate) fn distance_m(&self, point: Point2<f64>) -> f64 {
        let squared = |&[a, b]: &[Point2<f64>; 2]| {
            let along: Vector2<f64> = b - a;
            let t = ((point - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            (point - (a + along * t)).norm_squared()
        };
        libm::sqrt(
            self.segments
                .iter()
                .map(squared)
                .fold(f64::INFINITY, f64::min),
        )
    }
}

pub(super) fn edges(polygon: &[Point2<f64>]) -> impl Iterator<Item = [Point2<f64>; 2]> + '_ {
    let next = polygon.iter().cycle().skip(1);
    polygon.iter().zip(next).map(|(&a, &b)| [a, b])
}

/// Distance of a point from an edge's line, positive outside a counter-clockwise polygon, metres.
fn outward_distance_m([a, b]: [Point2<f64>; 2], point: Point2<f64>) -> f64 {
    outward_normal([a, b]).dot(&(point - a))
}

fn outward_normal([a, b]: [Point2<f64>; 2]) -> Vector2<f64> {
    let along = b - a;
    Vector2::new(along.y, -along.x) / along.norm()
}

/// Parts of `edge` that no polygon of `covers` hides.
fn visible_parts(
    edge: [Point2<f64>; 2],
    covers: &mut dyn Iterator<Item = &Vec<Point2<f64>>>,
) -> Vec<[Point2<f64>; 2]> {
    let mut visible = vec![[0.0, 1.0]];
    for cover in covers {
        if let Some(hidden) = hidden_part(edge, cover) {
            visible = without(&visible, hidden);
        }
    }
    let [a, b] = edge;
    visible
        .into_iter()
        .map(|part| part.map(|t| a + (b - a) * t))
        .collect()
}

/// The part of `edge`, as parameters in [0, 1], that the convex polygon `cover` hides.
fn hidden_part(edge: [Point2<f64>; 2], cover: &[Point2<f64>]) -> Option<[f64; 2]> {
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for cover_edge in edges(cover) {
        let [start, end] = edge.map(|point| outward_distance_m(cover_edge, point));
        if start.abs() <= FLUSH_M && end.abs() <= FLUSH_M {
            // On the same line. Face to face they hide each other; with the same outside neither does.
            if outward_normal(edge).dot(&outward_normal(cover_edge)) > 0.0 {
                return None;
            }
        } else if start > 0.0 && end > 0.0 {
            return None;
        } else if start > 0.0 {
            from = from.max(start / (start - end));
        } else if end > 0.0 {
            to = to.min(start / (start - end));
        }
    }
    (from < to).then_some([from, to])
}

/// `parts` without `hidden`; slivers that only rounding leaves are dropped.
fn without(parts: &[[f64; 2]], [from, to]: [f64; 2]) -> Vec<[f64; 2]> {
    parts
        .iter()
        .flat_map(|&[a, b]| [[a, b.min(from)], [a.max(to), b]])
        .filter(|[a, b]| b - a > FLUSH_M)
        .collect()
}

/// Intersection of a solid with a horizontal plane.
#[derive(Clone, Debug, PartialEq)]
enum Section {
    /// The plane passes above or below it.
    Nothing,
    /// Corners of a convex polygon, counter-clockwise.
    Area(Vec<Point2<f64>>),
    /// Pieces of a surface without an inside.
    Lines(Vec<[Point2<f64>; 2]>),
}

/// Corners of the polygon that stands for a circle: they lie on it, so the polygon's edges come within
/// 0.12 % of the radius.
const CIRCLE_CORNERS: usize = 64;

/// Half the edge of the square that stands for all the world, metres: all coordinates are smaller.
const WORLD_M: f64 = 4e6;

/// Section of a solid at `height_m`, without its motion.
fn section_of(solid: &Solid, height_m: f64) -> Section {
    let above_centre_m = height_m - solid.world_from_solid.translation.z;
    match &solid.shape {
        Shape::Plane => area(plane_section(solid, height_m)),
        Shape::Box { size_m } => area(box_section(solid, *size_m, height_m)),
        Shape::Cylinder {
            radius_m,
            height_m: length_m,
        } if above_centre_m.abs() <= 0.5 * length_m => {
            Section::Area(circle(solid, *radius_m, CIRCLE_CORNERS))
        }
        Shape::Sphere { radius_m } if above_centre_m.abs() < *radius_m => {
            let squared = radius_m * radius_m - above_centre_m * above_centre_m;
            Section::Area(circle(solid, libm::sqrt(squared), CIRCLE_CORNERS))
        }
        Shape::Cylinder { .. } | Shape::Sphere { .. } => Section::Nothing,
        Shape::Mesh(mesh) => {
            let lines: Vec<_> = mesh
                .triangles_m()
                .filter_map(|corners| {
                    let [a, b, c] = corners.map(|corner| solid.world_from_solid * corner);
                    let cut = [[a, b], [b, c], [c, a]].map(|edge| crossing(edge, height_m));
                    let mut ends = cut.into_iter().flatten();
                    Some([ends.next()?, ends.next()?])
                })
                .filter(|[from, to]| from != to)
                .collect();
            if lines.is_empty() {
                Section::Nothing
            } else {
                Section::Lines(lines)
            }
        }
    }
}

/// A polygon whose corners lie on a level circle about the centre.
pub(super) fn circle(solid: &Solid, radius_m: f64, corners: usize) -> Vec<Point2<f64>> {
    let centre_m = Point3::from(solid.world_from_solid.translation.vector).xy();
    (0..corners)
        .map(|corner| {
            let angle_rad = std::f64::consts::TAU * corner as f64 / corners as f64;
            centre_m + Vector2::new(libm::cos(angle_rad), libm::sin(angle_rad)) * radius_m
        })
        .collect()
}

fn box_section(solid: &Solid, size_m: [f64; 3], height_m: f64) -> Vec<Point2<f64>> {
    let q = solid.world_from_solid.rotation.quaternion();
    if q.i != 0.0 || q.j != 0.0 {
        let corners_m = solid.box_corners_m(size_m);
        return convex_hull(
            BOX_EDGES
                .iter()
                .filter_map(|edge| crossing(edge.map(|corner| corners_m[corner]), height_m))
                .collect(),
        );
    }
    let above_centre = height_m - solid.world_from_solid.translation.z;
    if above_centre.abs() > 0.5 * size_m[2] {
        return Vec::new();
    }
    [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
        .map(|(along, across)| {
            let corner = Point3::new(along * size_m[0], across * size_m[1], above_centre);
            (solid.world_from_solid * corner).xy()
        })
        .to_vec()
}

/// The part of the world's square that is in the ground.
fn plane_section(solid: &Solid, height_m: f64) -> Vec<Point2<f64>> {
    let normal = solid.world_from_solid.rotation * Vector3::z();
    let point_m = Point3::from(solid.world_from_solid.translation.vector);
    let above_m = |at: &Point2<f64>| normal.dot(&(Point3::new(at.x, at.y, height_m) - point_m));
    let square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        .map(|corner| Point2::from(corner) * WORLD_M);
    let mut inside = Vec::new();
    for (corner, &from) in square.iter().enumerate() {
        let to = square[(corner + 1) % square.len()];
        let (from_m, to_m) = (above_m(&from), above_m(&to));
        if from_m <= 0.0 {
            inside.push(from);
        }
        if (from_m <= 0.0) != (to_m <= 0.0) {
            inside.push(from + (to - from) * (from_m / (from_m - to_m)));
        }
    }
    inside
}

fn area(corners: Vec<Point2<f64>>) -> Section {
    if corners.len() < 3 {
        Section::Nothing
    } else {
        Section::Area(corners)
    }
}

/// Where an edge passes the height: its lower end counts, its upper end does not, and a level edge never
/// does, so that every closed outline of edges is passed an even number of times.
fn crossing([a, b]: [Point3<f64>; 2], height_m: f64) -> Option<Point2<f64>> {
    ((a.z <= height_m) != (b.z <= height_m))
        .then(|| (a + (b - a) * ((height_m - a.z) / (b.z - a.z))).xy())
}

/// Convex hull, counter-clockwise (Andrew 1979).
fn convex_hull(mut points: Vec<Point2<f64>>) -> Vec<Point2<f64>> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let half = |points: &mut dyn Iterator<Item = &Point2<f64>>| {
        let mut chain: Vec<Point2<f64>> = Vec::new();
        for &point in points {
            while let [.., a, b] = chain[..]
                && (b - a).perp(&(point - b)) <= 0.0
            {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut hull = half(&mut points.iter());
    hull.extend(half(&mut points.iter().rev()));
    hull
}

#[cfg(test)]
mod tests {
    use measurement::pose::{self, Pose};
    use simulation::World;
    use simulation::solid::Reflectivity;

    use super::*;
    use crate::truth::HEADER;

    fn rectangle(min: [f64; 2], max: [f64; 2]) -> Vec<Point2<f64>> {
        [
            [min[0], min[1]],
            [max[0], min[1]],
            [max[0], max[1]],
            [min[0], max[1]],
        ]
        .map(Point2::from)
        .to_vec()
    }

    fn length_m(outline: &Outline) -> f64 {
        outline.segments().iter().map(|[a, b]| (b - a).norm()).sum()
    }

    #[track_caller]
    fn check_length(sections: &[Vec<Point2<f64>>], expected_m: f64) {
        let length_m = length_m(&Outline::of_sections(sections.to_vec()));
        assert!((length_m - expected_m).abs() < 1e-9, "{length_m}");
    }

    #[test]
    fn overlapping_and_flush_solids_have_no_surface_between_them() {
        let square = rectangle([0.0, 0.0], [2.0, 2.0]);
        check_length(std::slice::from_ref(&square), 8.0);
        // Apart.
        check_length(&[square.clone(), rectangle([3.0, 0.0], [4.0, 1.0])], 12.0);
        // Overlapping corner: the union's girth is that of the bounding square.
        check_length(&[square.clone(), rectangle([1.0, 1.0], [3.0, 3.0])], 12.0);
        // A cross.
        check_length(
            &[
                rectangle([-3.0, 0.0], [5.0, 2.0]),
                rectangle([0.0, -3.0], [2.0, 5.0]),
            ],
            32.0,
        );
        // Flush, of different lengths.
        check_length(&[square.clone(), rectangle([2.0, 0.5], [3.0, 1.5])], 10.0);
        // One within the other.
        check_length(&[square.clone(), rectangle([0.5, 0.5], [1.0, 1.0])], 8.0);
        // A T whose bar ends exactly in the other's face, with one shared outside line.
        let bar = rectangle([1.0, 1.5], [4.0, 2.0]);
        let union = Outline::of_sections(vec![square, bar]);
        assert!(union.distance_m(Point2::new(2.0, 1.75)) > 0.24);
        assert!(union.distance_m(Point2::new(1.5, 2.0)) < 1e-12);
    }

    #[test]
    fn distance_is_that_to_the_nearest_surface_inside_and_outside() {
        let outline = Outline::of_sections(vec![
            rectangle([0.0, 0.0], [2.0, 1.0]),
            rectangle([2.0, 0.0], [4.0, 1.0]),
        ]);
        for (point, expected_m, inside) in [
            ([5.0, 0.5], 1.0, false),
            ([7.0, 5.0], 5.0, false),
            ([3.0, 0.6], 0.4, true),
            ([2.0, 0.5], 0.5, true),
            ([1.0, 1.0], 0.0, true),
        ] {
            let point = Point2::from(point);
            assert!(
                (outline.distance_m(point) - expected_m).abs() < 1e-12,
                "{point}"
            );
            assert_eq!(outline.contains(point), inside, "{point}");
        }
        let nothing = Outline::default();
        assert!(nothing.distance_m(Point2::origin()).is_infinite());
    }

    #[test]
    fn a_turned_solid_hides_what_it_covers() {
        // A diamond of half diagonal 1 over the right edge of a square: it hides 2 m of that edge, and of
        // its own girth 4√2 the half inside the square is hidden.
        let diamond = [[3.0, 1.5], [2.0, 2.5], [1.0, 1.5], [2.0, 0.5]]
            .map(Point2::from)
            .to_vec();
        let square = rectangle([0.0, 0.0], [2.0, 3.0]);
        check_length(
            &[square, diamond],
            10.0 - 2.0 + 2.0 * std::f64::consts::SQRT_2,
        );
    }

    fn solid(shape: Shape, world_from_solid: Pose) -> Solid {
        Solid {
            name: String::new(),
            shape,
            world_from_solid,
            reflectivity: Reflectivity::Diffuse,
            motion: None,
            is_ground: false,
        }
    }

    fn at(x: f64, y: f64, z: f64) -> Pose {
        let mut pose = pose::planar(x, y, 0.0);
        pose.translation.z = z;
        pose
    }

    fn pitched(mut pose: Pose, pitch_rad: f64) -> Pose {
        pose.rotation *=
            nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::y_axis(), pitch_rad);
        pose
    }

    fn corners(section: Section) -> Vec<Point2<f64>> {
        let Section::Area(corners) = section else {
            panic!("{section:?}")
        };
        corners
    }

    #[track_caller]
    fn check_area(solid: &Solid, height_m: f64, expected_m2: f64) {
        let corners = corners(section_of(solid, height_m));
        let next = corners.iter().cycle().skip(1);
        let doubled: f64 = corners
            .iter()
            .zip(next)
            .map(|(a, b)| a.coords.perp(&b.coords))
            .sum();
        let area_m2 = 0.5 * doubled;
        assert!(
            (area_m2 - expected_m2).abs() <= 2e-3 * expected_m2,
            "{area_m2}, expected {expected_m2}"
        );
    }

    #[test]
    fn section_of_a_turned_box() {
        let mut centre = pose::planar(1.0, 2.0, std::f64::consts::FRAC_PI_2);
        centre.translation.z = 0.5;
        let block = solid(
            Shape::Box {
                size_m: [4.0, 2.0, 1.0],
            },
            centre,
        );
        let found = corners(section_of(&block, 0.3));
        for (corner, expected) in found
            .iter()
            .zip([[2.0, 0.0], [2.0, 4.0], [0.0, 4.0], [0.0, 0.0]])
        {
            assert!((corner - Point2::from(expected)).norm() < 1e-12, "{corner}");
        }
        assert_ne!(section_of(&block, 1.0), Section::Nothing);
        assert_eq!(section_of(&block, 1.001), Section::Nothing);
        assert_eq!(section_of(&block, -0.001), Section::Nothing);
    }

    #[test]
    fn section_of_a_pitched_box() {
        // On edge: its diagonals are level and upright, and halfway up half of the level one is left.
        let upright = pitched(at(3.0, 1.0, 0.0), std::f64::consts::FRAC_PI_4);
        let block = solid(
            Shape::Box {
                size_m: [1.0, 2.0, 1.0],
            },
            upright,
        );
        let half_diagonal_m = libm::sqrt(0.5);
        check_area(&block, 0.0, 2.0 * 2.0 * half_diagonal_m);
        check_area(&block, 0.5 * half_diagonal_m, 2.0 * half_diagonal_m);
        assert_eq!(section_of(&block, 0.708), Section::Nothing);
    }

    #[test]
    fn sections_of_round_solids_are_circles() {
        let pole = solid(
            Shape::Cylinder {
                radius_m: 0.5,
                height_m: 2.0,
            },
            at(1.0, 0.0, 1.0),
        );
        let ball = solid(Shape::Sphere { radius_m: 1.0 }, at(0.0, 0.0, 1.0));
        let circle_m2 = std::f64::consts::PI * 0.25;
        check_area(&pole, 0.0, circle_m2);
        check_area(&pole, 2.0, circle_m2);
        assert_eq!(section_of(&pole, 2.01), Section::Nothing);
        check_area(&ball, 1.0, 4.0 * circle_m2);
        check_area(&ball, 1.6, 4.0 * circle_m2 * 0.64);
        assert_eq!(section_of(&ball, 2.01), Section::Nothing);
    }

    #[test]
    fn a_plane_is_all_the_world_below_it() {
        let flat = solid(Shape::Plane, at(0.0, 0.0, 0.3));
        check_area(&flat, 0.2, 4.0 * WORLD_M * WORLD_M);
        assert_eq!(section_of(&flat, 0.4), Section::Nothing);
        // Falling to the front: at its own height the half behind its point is in the ground.
        let slope = solid(Shape::Plane, pitched(at(2.0, 0.0, 0.3), 0.1));
        let corners = corners(section_of(&slope, 0.3));
        let front_m = corners
            .iter()
            .map(|corner| corner.x)
            .fold(f64::MIN, f64::max);
        assert!((front_m - 2.0).abs() < 1e-6, "{front_m}");
        check_area(&slope, 0.3, 2.0 * WORLD_M * (WORLD_M + 2.0));
    }

    #[test]
    fn section_of_a_mesh_is_lines() {
        let roof = "[[solids]]\nshape = \"height_field\"\norigin_m = [5, 0, 1]\nspacing_m = 1\n\
                    heights_m = [[0, 1, 0], [0, 1, 0]]";
        let world = World::parse("w", &format!("{HEADER}{roof}")).unwrap();
        let roof = world.solids()[0].clone();
        let Section::Lines(lines) = section_of(&roof, 1.5) else {
            panic!("no lines")
        };
        let length_m: f64 = lines.iter().map(|[a, b]| (b - a).norm()).sum();
        assert!((length_m - 2.0).abs() < 1e-12, "{lines:?}");
        assert!(
            lines
                .iter()
                .flatten()
                .all(|p| (p.x - 5.5).abs() < 1e-12 || (p.x - 6.5).abs() < 1e-12)
        );
        assert_eq!(section_of(&roof, 2.1), Section::Nothing);
    }
}
