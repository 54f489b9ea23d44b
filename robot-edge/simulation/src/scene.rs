//! Ray casting among the solids of a world, with mirrors and glass.

use measurement::pose::Pose;
use nalgebra::{Point2, Point3, Vector3};
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::{Pose as ParryPose, Rotation as ParryRotation, Vector as ParryVector};
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use parry3d_f64::query::{self, Ray, RayIntersection};
use parry3d_f64::shape::{Cuboid, SharedShape};
use serde::Deserialize;

use crate::solid::{Motion, Reflectivity, Shape, Solid};
use crate::vegetation::Vegetation;
use crate::world::values::{NotNegative, Probability};

/// Solids, prepared for rays: what is bounded and stands still in a bounding volume hierarchy, the few
/// that are endless or move one by one.
pub struct Scene {
    hierarchy: Bvh,
    /// Those of the hierarchy's leaves.
    standing: Vec<Body>,
    others: Vec<Body>,
    /// Highest point of the hierarchy; −∞ if it is empty.
    highest_m: f64,
    growth: Option<Growth>,
    water_m: Option<f64>,
}

/// Plants among the solids, and how a laser sees what is as thin as they are.
pub struct Growth {
    /// The plants.
    pub vegetation: Vegetation,
    /// Of the laser that looks at them.
    pub receiver: Receiver,
}

/// How a laser combines several echoes of one pulse.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(default, deny_unknown_fields)]
pub struct Receiver {
    /// The least share of a beam's light that must come back at once to be noticed.
    #[serde(deserialize_with = "Probability::number")]
    pub min_share: f64,
    /// Echoes that are no farther behind the first than this come at once, metres.
    #[serde(deserialize_with = "NotNegative::number")]
    pub separation_m: f64,
}

impl Default for Receiver {
    fn default() -> Self {
        Self {
            // One cane of 5 mm across a spot of 30 cm fills 2 % of it, three fill 6 %.
            min_share: 0.05,
            // A pulse of 5 ns is 1.5 m long; of echoes half as far apart the later begins as the first ends.
            separation_m: 0.75,
        }
    }
}

/// First intersection of a ray with a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// From the ray's origin, metres; 0 where the origin is inside a solid.
    pub distance_m: f64,
    /// Unit normal of the surface, towards the ray; zero where the origin is inside a solid.
    pub normal: Vector3<f64>,
    /// Index of the solid.
    pub solid: usize,
}

/// Echo along a line.
#[derive(Clone, Copy)]
pub(crate) struct Echo {
    /// Length of the light's path to the surface that scatters it.
    pub(crate) path_m: f64,
    /// Unit normal of that surface, towards the light; zero where the laser is inside a solid.
    pub(crate) normal: Vector3<f64>,
    /// Whether the path is straight: no mirror bent it.
    pub(crate) is_straight: bool,
}

/// From where [`Scene::height_m`] looks down.
const ABOVE_ALL_M: f64 = 1.0;

/// A beam between mirrors that face each other ends somewhere.
const MAX_REFLECTIONS: usize = 4;

const MAX_PANES: usize = 8;

/// How far from a mirror or a pane the beam goes on, so that it does not meet the same surface again.
const GAP_M: f64 = 1e-9;

impl Scene {
    /// Prepares `solids`; their indices are those of [`RayHit::solid`].
    pub fn new<'a>(solids: impl IntoIterator<Item = &'a Solid>) -> Self {
        let bodies = solids.into_iter().enumerate();
        let (standing, others): (Vec<Body>, Vec<Body>) = bodies
            .map(|(index, solid)| Body::new(index, solid))
            .partition(|body| !body.is_endless && body.motion.is_none());
        let boxes: Vec<Aabb> = standing
            .iter()
            .map(|body| body.shape.compute_aabb(&body.placed))
            .collect();
        Self {
            hierarchy: Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes),
            highest_m: boxes
                .iter()
                .map(|bounds| bounds.maxs.z)
                .fold(f64::NEG_INFINITY, f64::max),
            standing,
            others,
            growth: None,
            water_m: None,
        }
    }

    /// The same with plants.
    #[must_use]
    pub(crate) fn with_growth(self, growth: Growth) -> Self {
        Self {
            growth: Some(growth),
            ..self
        }
    }

    /// The same with still water up to a height above z = 0, metres.
    #[must_use]
    pub(crate) fn with_water(self, level_m: f64) -> Self {
        Self {
            water_m: Some(level_m),
            ..self
        }
    }

    /// The plants; [`Scene::cast`] does not meet them.
    pub fn growth(&self) -> Option<&Growth> {
        self.growth.as_ref()
    }

    /// How far along the unit vector `direction` a beam may return from, where it may from `max_m`: none
    /// returns through the surface of water. Light from above is mirrored away or lost in it, sound from
    /// below does not leave it.
    pub(crate) fn reach_m(&self, origin: Point3<f64>, direction: Vector3<f64>, max_m: f64) -> f64 {
        let surface_m = self
            .water_m
            .map(|level_m| (level_m - origin.z) / direction.z)
            .filter(|surface_m| *surface_m > 0.0);
        surface_m.map_or(max_m, |surface_m| surface_m.min(max_m))
    }

    /// The first surface of a solid along the unit vector `direction` that is not farther than `max_m`, at `time_s`
    /// seconds since the beginning.
    pub fn cast(
        &self,
        origin: Point3<f64>,
        direction: Vector3<f64>,
        max_m: f64,
        time_s: f64,
    ) -> Option<RayHit> {
        let (_, hit) = self.first(origin, direction, max_m, time_s)?;
        Some(hit)
    }

    fn first(
        &self,
        origin: Point3<f64>,
        direction: Vector3<f64>,
        max_m: f64,
        time_s: f64,
    ) -> Option<(&Body, RayHit)> {
        let ray = Ray::new(parry_vector(origin.coords), parry_vector(direction));
        let mut nearest = self
            .hierarchy
            .find_best(
                max_m,
                |node, nearest_m| node.cast_ray(&ray, nearest_m),
                |leaf, nearest_m| self.leaf(leaf)?.cast(&ray, nearest_m, time_s),
            )
            .and_then(|(leaf, hit)| Some((self.leaf(leaf)?, hit)));
        for body in &self.others {
            let nearest_m = nearest.map_or(max_m, |(_, hit)| hit.time_of_impact);
            let hit = body.cast(&ray, nearest_m, time_s);
            nearest = hit.map(|hit| (body, hit)).or(nearest);
        }
        nearest.map(|(body, hit)| {
            let normal = if hit.time_of_impact <= 0.0 {
                Vector3::zeros()
            } else {
                Vector3::new(hit.normal.x, hit.normal.y, hit.normal.z)
            };
            let hit = RayHit {
                distance_m: hit.time_of_impact.max(0.0),
                normal,
                solid: body.solid,
            };
            (body, hit)
        })
    }

    fn leaf(&self, leaf: u32) -> Option<&Body> {
        self.standing.get(leaf as usize)
    }

    /// Height of the highest surface above or below a point, as seen from above, metres; `None` where
    /// there is none.
    pub fn height_m(&self, at: Point2<f64>, time_s: f64) -> Option<f64> {
        let tops_m = self.others.iter().filter_map(|body| body.top_m(at, time_s));
        let highest_m = tops_m.fold(self.highest_m, f64::max);
        if highest_m == f64::NEG_INFINITY {
            return None;
        }
        let from_m = highest_m + ABOVE_ALL_M;
        let down = -Vector3::z();
        let hit = self.cast(Point3::new(at.x, at.y, from_m), down, f64::MAX, time_s)?;
        Some(from_m - hit.distance_m)
    }

    /// Whether a solid is in the box between two corners, in part or in whole.
    pub fn touches_box(&self, min_m: Point3<f64>, max_m: Point3<f64>, time_s: f64) -> bool {
        let bounds = Aabb::new(parry_vector(min_m.coords), parry_vector(max_m.coords));
        let cuboid = Cuboid::new(bounds.half_extents());
        let world_from_box = ParryPose::from_translation(bounds.center());
        self.touches(&cuboid, &world_from_box, &bounds, time_s)
    }

    /// The same for a box of edge lengths `size_m` about the origin of its own frame.
    pub(crate) fn touches_placed_box(
        &self,
        size_m: Vector3<f64>,
        world_from_box: &Pose,
        time_s: f64,
    ) -> bool {
        let cuboid = Cuboid::new(parry_vector(0.5 * size_m));
        let world_from_box = parry_pose(world_from_box);
        let bounds = cuboid.aabb(&world_from_box);
        self.touches(&cuboid, &world_from_box, &bounds, time_s)
    }

    fn touches(
        &self,
        cuboid: &Cuboid,
        world_from_box: &ParryPose,
        bounds: &Aabb,
        time_s: f64,
    ) -> bool {
        self.hierarchy
            .intersect_aabb(bounds)
            .filter_map(|leaf| self.leaf(leaf))
            .chain(&self.others)
            .any(|body| body.touches(cuboid, world_from_box, time_s))
    }

    /// What a laser measures of solids along the unit vector `direction`, mirrors and panes included; `None`
    /// where no surface ends the path within `max_m`, or water lies before it.
    ///
    /// `chance` in [0, 1) decides at every specular surface whether it mirrors and at every pane whether
    /// it lets through. One number serves all: given that it fell below a probability p, chance / p is
    /// uniform again.
    pub(crate) fn echo(
        &self,
        origin: Point3<f64>,
        direction: Vector3<f64>,
        max_m: f64,
        time_s: f64,
        mut chance: f64,
    ) -> Option<Echo> {
        let (mut origin, mut direction, mut length_m) = (origin, direction, 0.0);
        let (mut reflections, mut panes) = (0, 0);
        loop {
            let reach_m = self.reach_m(origin, direction, max_m - length_m);
            let (body, hit) = self.first(origin, direction, reach_m, time_s)?;
            length_m += hit.distance_m;
            let (probability, is_glass) = match body.reflectivity {
                Reflectivity::Diffuse => (0.0, false),
                Reflectivity::Specular { probability } => (probability, false),
                Reflectivity::Glass { transmission } => (transmission, true),
            };
            let inside = hit.normal == Vector3::zeros();
            let is_spent = if is_glass {
                panes == MAX_PANES
            } else {
                reflections == MAX_REFLECTIONS
            };
            if chance >= probability || inside || is_spent {
                return Some(Echo {
                    path_m: length_m,
                    normal: hit.normal,
                    is_straight: reflections == 0,
                });
            }
            chance /= probability;
            if is_glass {
                panes += 1;
                let within = origin + direction * (hit.distance_m + GAP_M);
                let ray = Ray::new(parry_vector(within.coords), parry_vector(direction));
                let through_m = body.way_out_m(&ray, max_m - length_m, time_s)?;
                length_m += through_m + 2.0 * GAP_M;
                origin = within + direction * (through_m + GAP_M);
            } else {
                reflections += 1;
                origin += direction * hit.distance_m + hit.normal * GAP_M;
                direction -= hit.normal * (2.0 * direction.dot(&hit.normal));
            }
        }
    }
}

/// A solid as parry knows it.
struct Body {
    /// Its index among the solids.
    solid: usize,
    shape: SharedShape,
    /// World from the shape's own frame, without motion.
    placed: ParryPose,
    is_endless: bool,
    reflectivity: Reflectivity,
    motion: Option<Motion>,
}

impl Body {
    fn new(index: usize, solid: &Solid) -> Self {
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
            solid: index,
            shape,
            placed: parry_pose(&world_from_shape),
            is_endless: matches!(solid.shape, Shape::Plane),
            reflectivity: solid.reflectivity,
            motion: solid.motion.clone(),
        }
    }

    fn cast(&self, ray: &Ray, max_m: f64, time_s: f64) -> Option<RayIntersection> {
        self.shape
            .cast_ray_and_get_normal(&self.placed_at(time_s)?, ray, max_m, true)
    }

    /// How far a ray that starts within goes until it leaves; 0 where it starts outside or there is no
    /// inside, and `None` where it never leaves.
    fn way_out_m(&self, ray: &Ray, max_m: f64, time_s: f64) -> Option<f64> {
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
    fn touches(&self, cuboid: &Cuboid, world_from_box: &ParryPose, time_s: f64) -> bool {
        self.placed_at(time_s).is_some_and(|placed| {
            // Every pair of a box and a shape of worlds has an answer.
            query::intersection_test(world_from_box, cuboid, &placed, self.shape.as_ref())
                .is_ok_and(|test| test.intersecting)
        })
    }

    /// A height above which nothing of it stands over a point; `None` if it is not there.
    fn top_m(&self, at: Point2<f64>, time_s: f64) -> Option<f64> {
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
            placed.translation += parry_vector(offset_m.push(0.0));
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
