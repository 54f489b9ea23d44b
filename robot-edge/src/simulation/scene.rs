//! Ray casting among the solids of a world.

use nalgebra::{Point3, Vector3};
use parry3d_f64::math::{Pose as ParryPose, Rotation as ParryRotation, Vector as ParryVector};
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use parry3d_f64::query::Ray;
use parry3d_f64::shape::SharedShape;

use crate::pose::Pose;
use crate::simulation::solid::{Reflectivity, Shape, Solid};

/// Solids in a bounding volume hierarchy.
pub struct Scene {
    hierarchy: Bvh,
    bodies: Vec<Body>,
}

/// Where a ray meets a surface first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// From the ray's origin, metres; 0 where the origin is inside a solid.
    pub distance_m: f64,
    /// Unit normal of the surface, outward; zero where the origin is inside a solid.
    pub normal: Vector3<f64>,
    /// Index of the solid.
    pub solid: usize,
}

struct Body {
    shape: SharedShape,
    /// World from the shape's own frame.
    placed: ParryPose,
    reflectivity: Reflectivity,
}

/// A beam between mirrors that face each other ends somewhere.
const MAX_REFLECTIONS: usize = 4;

/// How far from the mirror a reflected beam starts, so that it does not meet the same surface again.
const MIRROR_GAP_M: f64 = 1e-9;

impl Scene {
    /// Prepares `solids`; their indices are those of [`RayHit::solid`].
    pub fn new(solids: &[Solid]) -> Self {
        let bodies: Vec<Body> = solids.iter().map(Body::new).collect();
        let boxes: Vec<_> = bodies
            .iter()
            .map(|body| body.shape.compute_aabb(&body.placed))
            .collect();
        Self {
            hierarchy: Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes),
            bodies,
        }
    }

    /// The first surface along the unit vector `direction` that is nearer than `max_m`.
    pub fn cast(&self, origin: Point3<f64>, direction: Vector3<f64>, max_m: f64) -> Option<RayHit> {
        let ray = Ray::new(parry_vector(origin.coords), parry_vector(direction));
        let (solid, hit) = self.hierarchy.find_best(
            max_m,
            |node, nearest_m| node.cast_ray(&ray, nearest_m),
            |leaf, nearest_m| {
                let body = self.bodies.get(leaf as usize)?;
                body.shape
                    .cast_ray_and_get_normal(&body.placed, &ray, nearest_m, true)
            },
        )?;
        Some(RayHit {
            distance_m: hit.time_of_impact,
            normal: Vector3::new(hit.normal.x, hit.normal.y, hit.normal.z),
            solid: solid as usize,
        })
    }

    /// Length of the path that a laser measures along the unit vector `direction`, mirrors included;
    /// `None` where no surface ends it within `max_m`.
    ///
    /// `chance` in [0, 1) decides at every specular surface whether it mirrors. One number serves all:
    /// given that it fell below a probability p, chance / p is uniform again.
    pub fn measured_path_m(
        &self,
        origin: Point3<f64>,
        direction: Vector3<f64>,
        max_m: f64,
        mut chance: f64,
    ) -> Option<f64> {
        let (mut origin, mut direction, mut length_m) = (origin, direction, 0.0);
        for reflection in 0..=MAX_REFLECTIONS {
            let hit = self.cast(origin, direction, max_m - length_m)?;
            length_m += hit.distance_m;
            let probability = match self.bodies.get(hit.solid)?.reflectivity {
                Reflectivity::Diffuse => 0.0,
                Reflectivity::Specular { probability } => probability,
            };
            let inside = hit.normal == Vector3::zeros();
            if chance >= probability || inside || reflection == MAX_REFLECTIONS {
                return Some(length_m);
            }
            chance /= probability;
            origin += direction * hit.distance_m + hit.normal * MIRROR_GAP_M;
            direction -= hit.normal * (2.0 * direction.dot(&hit.normal));
        }
        None
    }
}

impl Body {
    fn new(solid: &Solid) -> Self {
        let shape = match solid.shape {
            Shape::Box { size_m: [x, y, z] } => SharedShape::cuboid(0.5 * x, 0.5 * y, 0.5 * z),
        };
        Self {
            shape,
            placed: parry_pose(&solid.world_from_solid),
            reflectivity: solid.reflectivity,
        }
    }
}

fn parry_vector(v: Vector3<f64>) -> ParryVector {
    ParryVector::new(v.x, v.y, v.z)
}

fn parry_pose(pose: &Pose) -> ParryPose {
    let q = pose.rotation.quaternion();
    ParryPose::from_parts(
        parry_vector(pose.translation.vector),
        ParryRotation::from_xyzw(q.i, q.j, q.k, q.w),
    )
}

#[cfg(test)]
mod tests;
