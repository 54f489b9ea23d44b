//! What stands in a world.

pub mod mesh;
pub mod motion;
pub mod section;

use nalgebra::Point3;

use crate::solid::mesh::Mesh;
use crate::solid::motion::Motion;
use measurement::pose::Pose;

/// One solid thing.
#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    /// What messages call it; empty where the world file gives it no name.
    pub name: String,
    /// Its form, in its own frame.
    pub shape: Shape,
    /// Where its own frame is while it stands still.
    pub world_from_solid: Pose,
    /// What its surface does to a laser beam.
    pub reflectivity: Reflectivity,
    /// How it moves; `None` where it stands still.
    pub motion: Option<Motion>,
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

/// What a surface does to a laser beam.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reflectivity {
    /// Scatters it: the range is the distance to the surface.
    Diffuse,
    /// With this probability mirrors it: the range is then the length of the mirrored path, a false
    /// reading behind the surface ("reflective surfaces" of the laser range finder document).
    Specular {
        /// 0 … 1, for each beam on its own.
        probability: f64,
    },
    /// With this probability lets it through: the range is then the distance to what is behind. Without
    /// refraction, which shifts a beam by less than the thickness of a pane.
    Glass {
        /// 0 … 1, for each beam and pane on its own.
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
    pub(crate) fn box_corners_m(&self, size_m: [f64; 3]) -> [Point3<f64>; 8] {
        std::array::from_fn(|corner| {
            let side = |axis: usize| if corner >> axis & 1 == 0 { -0.5 } else { 0.5 };
            let at = std::array::from_fn(|axis| side(axis) * size_m[axis]);
            self.world_from_solid * Point3::from(at)
        })
    }
}

/// Pairs of [`Solid::box_corners_m`] that an edge joins.
pub(crate) const BOX_EDGES: [[usize; 2]; 12] = [
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
