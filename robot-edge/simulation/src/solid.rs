//! Solids of a world.

use std::sync::Arc;

use measurement::pose::Pose;
use nalgebra::{Point3, Vector2, Vector3};
use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::shape::TriMesh;

use crate::world::values::ItemError;

/// One solid thing.
#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    /// Name in messages; empty if the world file gives none.
    pub name: String,
    /// Its form, in its own frame.
    pub shape: Shape,
    /// Its own frame in the world, without its motion.
    pub world_from_solid: Pose,
    /// Optical behaviour of its surface.
    pub reflectivity: Reflectivity,
    /// Motion; `None` if it does not move.
    pub motion: Option<Motion>,
    /// Whether plants and vehicles stand on it.
    pub is_ground: bool,
}

/// Form of a solid.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Everything below its own plane z = 0, without end.
    Plane,
    /// A box about its own centre; a wall is one too.
    Box {
        /// Edge lengths along the solid's own x, y, z, metres.
        size_m: [f64; 3],
    },
    /// A cylinder about its own centre, its axis along its own z.
    Cylinder {
        /// Metres.
        radius_m: f64,
        /// Along the axis, metres.
        height_m: f64,
    },
    /// A sphere about its own centre.
    Sphere {
        /// Metres.
        radius_m: f64,
    },
    /// Triangles: a surface seen from both sides, without an inside.
    Mesh(Mesh),
}

/// Optical behaviour of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reflectivity {
    /// Scatters it: the range is the distance to the surface.
    Diffuse,
    /// With this probability, for each beam on its own, mirrors it: the range is then the length of the mirrored
    /// path, a false reading behind the surface ("reflective surfaces" of the laser range finder document).
    Specular {
        /// 0 … 1.
        probability: f64,
    },
    /// With this probability, for each beam and pane on its own, lets it through: the range is then the distance
    /// to what is behind. Without refraction, which shifts a beam by less than the thickness of a pane.
    Glass {
        /// 0 … 1.
        transmission: f64,
    },
}

impl Solid {
    /// The solid as it stands at a time, in seconds since the beginning, without its motion; `None` where
    /// it is not there.
    pub fn at(&self, time_s: f64) -> Option<Self> {
        let mut still = Self {
            motion: None,
            ..self.clone()
        };
        if let Some(motion) = &self.motion {
            let offset_m = motion.offset_m(time_s)?;
            still.world_from_solid.translation.x += offset_m.x;
            still.world_from_solid.translation.y += offset_m.y;
        }
        Some(still)
    }

    /// The corners of a box in the world, so that two whose numbers differ in one bit share an edge.
    pub fn box_corners_m(&self, size_m: [f64; 3]) -> [Point3<f64>; 8] {
        std::array::from_fn(|corner| {
            let side = |axis: usize| if corner >> axis & 1 == 0 { -0.5 } else { 0.5 };
            let at = std::array::from_fn(|axis| side(axis) * size_m[axis]);
            self.world_from_solid * Point3::from(at)
        })
    }
}

/// Pairs of [`Solid::box_corners_m`] that an edge joins.
pub const BOX_EDGES: [[usize; 2]; 12] = [
    [0, 1],
    [2, 3],
    [4, 5],
    [6, 7],
    [0, 2],
    [1, 3],
    [4, 6],
    [5, 7],
    [0, 4],
    [1, 5],
    [2, 6],
    [3, 7],
];

/// Triangles with shared vertices, ready for rays. A clone shares them.
#[derive(Clone)]
pub struct Mesh(Arc<TriMesh>);

impl Mesh {
    /// The mesh of `triangles`, each three indices into `vertices_m` in either sense.
    pub(crate) fn new(
        vertices_m: &[Point3<f64>],
        triangles: Vec<[u32; 3]>,
    ) -> Result<Self, ItemError> {
        for (triangle, corners) in triangles.iter().enumerate() {
            let refused = |message: String| ItemError {
                item: Some(triangle),
                message: format!("triangle {triangle} has {message}"),
            };
            let vertex = |n: u32| {
                vertices_m.get(n as usize).ok_or_else(|| {
                    let vertices = vertices_m.len();
                    refused(format!(
                        "vertex {n}, but there are {vertices}, counted from 0"
                    ))
                })
            };
            let [a, b, c] = *corners;
            let (a, b, c) = (vertex(a)?, vertex(b)?, vertex(c)?);
            let doubled_area: Vector3<f64> = (b - a).cross(&(c - a));
            if doubled_area == Vector3::zeros() {
                return Err(refused("no area".to_owned()));
            }
        }
        let vertices = vertices_m
            .iter()
            .map(|vertex| ParryVector::new(vertex.x, vertex.y, vertex.z))
            .collect();
        // The only other errors are about flags, and none are set.
        TriMesh::new(vertices, triangles)
            .map(|mesh| Self(Arc::new(mesh)))
            .map_err(|_empty| ItemError::whole("a mesh needs at least one triangle"))
    }

    /// The surface over a grid of heights: row j and column i stand at (i, j) · `spacing_m`, and every
    /// square of four is two triangles with the diagonal from its least to its greatest x and y.
    ///
    /// Not parry's own height field: of 139 000 random rays that meet one, 0.31.1 lets 1900 that enter
    /// through the sides of its box pass (dev profile, compared with a loop over its own triangles); its
    /// triangle mesh lets none.
    pub(crate) fn of_heights(spacing_m: f64, heights_m: &[Vec<f64>]) -> Result<Self, ItemError> {
        let columns = heights_m.first().map_or(0, Vec::len);
        if columns < 2 || heights_m.len() < 2 || u32::try_from(columns * heights_m.len()).is_err() {
            return Err(ItemError::whole(
                "a height field needs at least 2 rows of at least 2 heights",
            ));
        }
        let mut vertices_m = Vec::with_capacity(columns * heights_m.len());
        for (row, heights) in heights_m.iter().enumerate() {
            if heights.len() != columns {
                let found = heights.len();
                return Err(ItemError::whole(&format!(
                    "row {row} has {found} heights, the first row has {columns}"
                )));
            }
            vertices_m.extend(heights.iter().enumerate().map(|(column, &height_m)| {
                Point3::new(column as f64 * spacing_m, row as f64 * spacing_m, height_m)
            }));
        }
        let triangles = (0..heights_m.len() - 1)
            .flat_map(|row| (0..columns - 1).map(move |column| row * columns + column))
            .flat_map(|corner| {
                let [a, b] = [corner, corner + 1].map(|n| n as u32);
                let [c, d] = [corner + columns, corner + columns + 1].map(|n| n as u32);
                [[a, b, d], [a, d, c]]
            })
            .collect();
        Self::new(&vertices_m, triangles)
    }

    /// Corners of each triangle, in the solid's own frame.
    pub fn triangles_m(&self) -> impl ExactSizeIterator<Item = [Point3<f64>; 3]> + '_ {
        self.0.triangles().map(|triangle| {
            [triangle.a, triangle.b, triangle.c].map(|v| Point3::new(v.x, v.y, v.z))
        })
    }

    pub(crate) fn shared(&self) -> Arc<TriMesh> {
        Arc::clone(&self.0)
    }
}

impl PartialEq for Mesh {
    fn eq(&self, other: &Self) -> bool {
        self.0.vertices() == other.0.vertices() && self.0.indices() == other.0.indices()
    }
}

impl std::fmt::Debug for Mesh {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Mesh({} triangles)", self.0.num_triangles())
    }
}

/// A motion along straight lines, without turning.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    keyframes: Vec<Keyframe>,
    appears_s: f64,
    leaves_s: f64,
}

/// Place of a moving solid at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Keyframe {
    /// Seconds since the beginning of the run.
    pub(crate) time_s: f64,
    /// From where its world file puts it, metres.
    pub(crate) offset_m: Vector2<f64>,
}

impl Motion {
    /// The motion through `keyframes`, in between at constant speed, before the first and after the last
    /// at rest; no keyframes are no offset. It is there from `appears_s` until before `leaves_s`.
    pub(crate) fn new(
        keyframes: Vec<Keyframe>,
        appears_s: f64,
        leaves_s: f64,
    ) -> Result<Self, ItemError> {
        let is_late = |pair: &[Keyframe]| pair[0].time_s < pair[1].time_s;
        if let Some(before) = keyframes.windows(2).position(|pair| !is_late(pair)) {
            let keyframe = before + 1;
            return Err(ItemError {
                item: Some(keyframe),
                message: format!("keyframe {keyframe} is not later than the one before it"),
            });
        }
        if appears_s < leaves_s {
            Ok(Self {
                keyframes,
                appears_s,
                leaves_s,
            })
        } else {
            Err(ItemError::whole(
                "`leaves_s` is not later than `appears_s`: it is never there",
            ))
        }
    }

    /// The offset at a time; `None` if the solid is not there.
    pub fn offset_m(&self, time_s: f64) -> Option<Vector2<f64>> {
        if !(self.appears_s..self.leaves_s).contains(&time_s) {
            return None;
        }
        let next = self
            .keyframes
            .partition_point(|keyframe| keyframe.time_s <= time_s);
        let before = next.checked_sub(1).and_then(|n| self.keyframes.get(n));
        Some(match (before, self.keyframes.get(next)) {
            (Some(from), Some(to)) => {
                let share = (time_s - from.time_s) / (to.time_s - from.time_s);
                from.offset_m + (to.offset_m - from.offset_m) * share
            }
            (Some(only), None) | (None, Some(only)) => only.offset_m,
            (None, None) => Vector2::zeros(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_become_two_triangles_a_square() {
        let mesh = Mesh::of_heights(0.5, &[vec![0.0, 1.0, 2.0], vec![3.0, 4.0, 5.0]]).unwrap();
        let triangles: Vec<_> = mesh.triangles_m().collect();
        assert_eq!(triangles.len(), 4);
        let at = |x, y, z| Point3::new(x, y, z);
        assert_eq!(
            triangles[2],
            [at(0.5, 0.0, 1.0), at(1.0, 0.0, 2.0), at(1.0, 0.5, 5.0)]
        );
        assert_eq!(
            triangles[3],
            [at(0.5, 0.0, 1.0), at(1.0, 0.5, 5.0), at(0.5, 0.5, 4.0)]
        );
    }

    #[test]
    fn what_makes_no_mesh_is_refused() {
        let vertices =
            [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Point3::from);
        let of = |triangles: &[[u32; 3]]| Mesh::new(&vertices, triangles.to_vec()).unwrap_err();
        let heights = |rows: &[Vec<f64>]| Mesh::of_heights(1.0, rows).unwrap_err();
        let too_few = "a height field needs at least 2 rows of at least 2 heights";
        for (error, item, message) in [
            (of(&[]), None, "a mesh needs at least one triangle"),
            (
                of(&[[0, 1, 3], [0, 1, 4]]),
                Some(1),
                "triangle 1 has vertex 4, but there are 4, counted from 0",
            ),
            (of(&[[0, 1, 2]]), Some(0), "triangle 0 has no area"),
            (heights(&[vec![0.0, 1.0]]), None, too_few),
            (heights(&[]), None, too_few),
            (
                heights(&[vec![0.0, 1.0], vec![0.0]]),
                None,
                "row 1 has 1 heights, the first row has 2",
            ),
        ] {
            assert_eq!((error.item, error.message.as_str()), (item, message));
        }
    }

    fn keyframe(time_s: f64, x: f64, y: f64) -> Keyframe {
        Keyframe {
            time_s,
            offset_m: Vector2::new(x, y),
        }
    }

    #[test]
    fn moves_in_straight_lines_and_rests_before_and_after() {
        let frames = vec![
            keyframe(2.0, 1.0, 0.0),
            keyframe(4.0, 1.0, 3.0),
            keyframe(5.0, -1.0, 3.0),
        ];
        let motion = Motion::new(frames, f64::NEG_INFINITY, f64::INFINITY).unwrap();
        for (time_s, expected) in [
            (-1.0, [1.0, 0.0]),
            (2.0, [1.0, 0.0]),
            (3.5, [1.0, 2.25]),
            (4.25, [0.5, 3.0]),
            (5.0, [-1.0, 3.0]),
            (1e9, [-1.0, 3.0]),
        ] {
            let offset_m = motion.offset_m(time_s).unwrap();
            assert!(
                (offset_m - Vector2::from(expected)).norm() < 1e-12,
                "{time_s} s: {offset_m}"
            );
        }
    }

    #[test]
    fn is_there_between_appearing_and_leaving_only() {
        let motion = Motion::new(vec![keyframe(0.0, 1.0, 0.0)], 1.0, 3.0).unwrap();
        let there = [0.999, 1.0, 2.999, 3.0].map(|time_s| motion.offset_m(time_s).is_some());
        assert_eq!(there, [false, true, true, false]);
        let standing = Motion::new(Vec::new(), f64::NEG_INFINITY, 3.0).unwrap();
        assert_eq!(standing.offset_m(2.0), Some(Vector2::zeros()));
        assert_eq!(standing.offset_m(4.0), None);
    }

    #[test]
    fn invalid_motions_are_refused() {
        let twice = vec![keyframe(1.0, 0.0, 0.0), keyframe(1.0, 1.0, 0.0)];
        assert_eq!(Motion::new(twice, 0.0, 9.0).unwrap_err().item, Some(1));
        let never = Motion::new(Vec::new(), 3.0, 3.0).unwrap_err();
        assert_eq!(never.item, None);
    }
}
