//! What stands in a world.

use nalgebra::{Point2, Point3};

use crate::pose::Pose;

/// One solid thing.
#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    /// What messages call it; empty where the world file gives it no name.
    pub name: String,
    /// Its form, about its own centre.
    pub shape: Shape,
    /// Where its centre is; turned about z only.
    pub world_from_solid: Pose,
    /// What its surface does to a laser beam.
    pub reflectivity: Reflectivity,
}

/// Form of a solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A box; a wall is one too.
    Box {
        /// Edge lengths along the solid's own x, y, z, metres.
        size_m: [f64; 3],
    },
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
}

impl Solid {
    /// Corners of its section at `height_m`, a convex polygon counter-clockwise; `None` where the plane
    /// passes above or below it.
    pub fn section(&self, height_m: f64) -> Option<Vec<Point2<f64>>> {
        let Shape::Box {
            size_m: [length, width, height],
        } = self.shape;
        let above_centre = height_m - self.world_from_solid.translation.z;
        (above_centre.abs() <= 0.5 * height).then(|| {
            [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
                .map(|(along, across)| {
                    let corner = Point3::new(along * length, across * width, above_centre);
                    (self.world_from_solid * corner).xy()
                })
                .to_vec()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose;

    #[test]
    fn section_of_a_turned_box() {
        let mut centre = pose::planar(1.0, 2.0, std::f64::consts::FRAC_PI_2);
        centre.translation.z = 0.5;
        let solid = Solid {
            name: String::new(),
            shape: Shape::Box {
                size_m: [4.0, 2.0, 1.0],
            },
            world_from_solid: centre,
            reflectivity: Reflectivity::Diffuse,
        };
        let corners = solid.section(0.3).unwrap();
        for (corner, expected) in
            corners
                .iter()
                .zip([[2.0, 0.0], [2.0, 4.0], [0.0, 4.0], [0.0, 0.0]])
        {
            assert!((corner - Point2::from(expected)).norm() < 1e-12, "{corner}");
        }
        assert!(solid.section(1.0).is_some());
        assert_eq!(solid.section(1.001), None);
        assert_eq!(solid.section(-0.001), None);
    }
}
