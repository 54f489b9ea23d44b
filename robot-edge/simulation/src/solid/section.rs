//! Horizontal sections of solids.

use nalgebra::{Point2, Point3, Vector2, Vector3};

use super::{BOX_EDGES, Shape, Solid};

/// Intersection of a solid with a horizontal plane.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Section {
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

impl Solid {
    /// Its section at `height_m`, without its motion.
    pub(crate) fn section(&self, height_m: f64) -> Section {
        let above_centre_m = height_m - self.world_from_solid.translation.z;
        match &self.shape {
            Shape::Plane => area(self.plane_section(height_m)),
            Shape::Box { size_m } => area(self.box_section(*size_m, height_m)),
            Shape::Cylinder {
                radius_m,
                height_m: length_m,
            } if above_centre_m.abs() <= 0.5 * length_m => {
                Section::Area(self.circle(*radius_m, CIRCLE_CORNERS))
            }
            Shape::Sphere { radius_m } if above_centre_m.abs() < *radius_m => {
                let squared = radius_m * radius_m - above_centre_m * above_centre_m;
                Section::Area(self.circle(libm::sqrt(squared), CIRCLE_CORNERS))
            }
            Shape::Cylinder { .. } | Shape::Sphere { .. } => Section::Nothing,
            Shape::Mesh(mesh) => {
                let lines: Vec<_> = mesh
                    .triangles_m()
                    .filter_map(|corners| {
                        let [a, b, c] = corners.map(|corner| self.world_from_solid * corner);
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
    pub(crate) fn circle(&self, radius_m: f64, corners: usize) -> Vec<Point2<f64>> {
        let centre_m = Point3::from(self.world_from_solid.translation.vector).xy();
        (0..corners)
            .map(|corner| {
                let angle_rad = std::f64::consts::TAU * corner as f64 / corners as f64;
                centre_m + Vector2::new(libm::cos(angle_rad), libm::sin(angle_rad)) * radius_m
            })
            .collect()
    }

    fn box_section(&self, size_m: [f64; 3], height_m: f64) -> Vec<Point2<f64>> {
        let q = self.world_from_solid.rotation.quaternion();
        if q.i != 0.0 || q.j != 0.0 {
            let corners_m = self.box_corners_m(size_m);
            return convex_hull(
                BOX_EDGES
                    .iter()
                    .filter_map(|edge| crossing(edge.map(|corner| corners_m[corner]), height_m))
                    .collect(),
            );
        }
        let above_centre = height_m - self.world_from_solid.translation.z;
        if above_centre.abs() > 0.5 * size_m[2] {
            return Vec::new();
        }
        [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
            .map(|(along, across)| {
                let corner = Point3::new(along * size_m[0], across * size_m[1], above_centre);
                (self.world_from_solid * corner).xy()
            })
            .to_vec()
    }

    /// The part of the world's square that is in the ground.
    fn plane_section(&self, height_m: f64) -> Vec<Point2<f64>> {
        let normal = self.world_from_solid.rotation * Vector3::z();
        let point_m = Point3::from(self.world_from_solid.translation.vector);
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
mod tests;
