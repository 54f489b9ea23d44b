//! One solid as parry knows it.

use nalgebra::{Point2, Vector3};
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::{Pose as ParryPose, Rotation as ParryRotation, Vector as ParryVector};
use parry3d_f64::query::{self, Ray, RayIntersection};
use parry3d_f64::shape::{Cuboid, SharedShape};

use super::parry_vector;
use crate::solid::motion::Motion;
use crate::solid::{Reflectivity, Shape, Solid};
use measurement::pose::Pose;

pub(super) struct Body {
    shape: SharedShape,
    /// World from the shape's own frame, where it stands still.
    placed: ParryPose,
    is_endless: bool,
    reflectivity: Reflectivity,
    motion: Option<Motion>,
}

impl Body {
    pub(super) fn new(solid: &Solid) -> Self {
        let mut world_from_shape = solid.world_from_solid;
        let shape = match &solid.shape {
            Shape::Plane => SharedShape::halfspace(ParryVector::Z),
            Shape::Box { size_m: [x, y, z] } => SharedShape::cuboid(0.5 * x, 0.5 * y, 0.5 * z),
            Shape::Cylinder { radius_m, height_m } => {
                world_from_shape *= y_axis_up();
                SharedShape::cylinder(0.5 * height_m, *radius_m)
            }
            Shape::Sphere { radius_m } => SharedShape::ball(*radius_m),
            Shape::Mesh(mesh) => SharedShape(mesh.shared()),
        };
        Self {
            shape,
            placed: parry_pose(&world_from_shape),
            is_endless: matches!(solid.shape, Shape::Plane),
            reflectivity: solid.reflectivity,
            motion: solid.motion.clone(),
        }
    }

    pub(super) fn reflectivity(&self) -> Reflectivity {
        self.reflectivity
    }

    pub(super) fn stands_bounded(&self) -> bool {
        !self.is_endless && self.motion.is_none()
    }

    pub(super) fn box_m(&self) -> Aabb {
        self.shape.compute_aabb(&self.placed)
    }

    pub(super) fn cast(&self, ray: &Ray, max_m: f64, time_s: f64) -> Option<RayIntersection> {
        self.shape
            .cast_ray_and_get_normal(&self.placed_at(time_s)?, ray, max_m, true)
    }

    /// How far a ray that starts within goes until it leaves; 0 where it starts outside or there is no
    /// inside, and `None` where it never leaves.
    pub(super) fn way_out_m(&self, ray: &Ray, max_m: f64, time_s: f64) -> Option<f64> {
        let placed = self.placed_at(time_s)?;
        if self.shape.as_trimesh().is_some() {
            return Some(0.0);
        }
        let is_within = self.shape.cast_ray(&placed, ray, 0.0, true).is_some();
        if is_within {
            self.shape.cast_ray(&placed, ray, max_m, false)
        } else {
            Some(0.0)
        }
    }

    /// Whether a part of it is in a box.
    pub(super) fn touches(&self, cuboid: &Cuboid, world_from_box: &ParryPose, time_s: f64) -> bool {
        self.placed_at(time_s).is_some_and(|placed| {
            // Every pair of a box and a shape of worlds has an answer.
            query::intersection_test(world_from_box, cuboid, &placed, self.shape.as_ref())
                .is_ok_and(|test| test.intersecting)
        })
    }

    /// A height above which nothing of it stands over a point; `None` where it is not there.
    pub(super) fn top_m(&self, at: Point2<f64>, time_s: f64) -> Option<f64> {
        let placed = self.placed_at(time_s)?;
        if !self.is_endless {
            return Some(self.shape.compute_aabb(&placed).maxs.z);
        }
        let (normal, point) = (placed.rotation * ParryVector::Z, placed.translation);
        let (x, y) = (at.x - point.x, at.y - point.y);
        Some(point.z - (normal.x * x + normal.y * y) / normal.z)
    }

    fn placed_at(&self, time_s: f64) -> Option<ParryPose> {
        let mut placed = self.placed;
        if let Some(motion) = &self.motion {
            let offset_m = motion.offset_m(time_s)?;
            placed.translation += parry_vector(Vector3::new(offset_m.x, offset_m.y, 0.0));
        }
        Some(placed)
    }
}

/// The solid's frame from that of a parry cylinder, whose axis is y.
fn y_axis_up() -> Pose {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let quarter_turn_about_x = nalgebra::Quaternion::new(half, half, 0.0, 0.0);
    Pose::from_parts(
        nalgebra::Translation3::identity(),
        nalgebra::UnitQuaternion::new_normalize(quarter_turn_about_x),
    )
}

pub(super) fn parry_pose(pose: &Pose) -> ParryPose {
    let q = pose.rotation.quaternion();
    ParryPose::from_parts(
        parry_vector(pose.translation.vector),
        ParryRotation::from_xyzw(q.i, q.j, q.k, q.w),
    )
}
