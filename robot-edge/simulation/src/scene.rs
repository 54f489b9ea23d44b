//! Ray casting among the solids of a world.

mod beam;
mod body;

use nalgebra::{Point2, Point3, Vector3};
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::{Pose as ParryPose, Vector as ParryVector};
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use parry3d_f64::query::{Ray, RayIntersection};
use parry3d_f64::shape::Cuboid;

pub use beam::Echo;

use crate::scene::body::Body;
use crate::solid::{Reflectivity, Solid};
use crate::vegetation::Vegetation;
use measurement::pose::Pose;

/// Solids, prepared for rays: what is bounded and stands still in a bounding volume hierarchy, the few
/// that are endless or move one by one.
pub struct Scene {
    hierarchy: Bvh,
    /// Bodies of the hierarchy's leaves.
    leaves: Vec<usize>,
    others: Vec<usize>,
    bodies: Vec<Body>,
    /// Of what stands in the hierarchy; −∞ where nothing does.
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

/// What a laser makes of many echoes of one pulse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receiver {
    /// The least share of a beam's light that must come back at once to be noticed.
    pub min_share: f64,
    /// Echoes that are no farther behind the first than this come at once, metres.
    pub separation_m: f64,
}

/// Where a ray meets a surface first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// From the ray's origin, metres; 0 where the origin is inside a solid.
    pub distance_m: f64,
    /// Unit normal of the surface, towards the ray; zero where the origin is inside a solid.
    pub normal: Vector3<f64>,
    /// Index of the solid.
    pub solid: usize,
}

impl Scene {
    /// Prepares `solids`; their indices are those of [`RayHit::solid`].
    pub fn new(solids: &[Solid]) -> Self {
        let bodies: Vec<Body> = solids.iter().map(Body::new).collect();
        let (leaves, others): (Vec<usize>, Vec<usize>) =
            (0..bodies.len()).partition(|&body| bodies[body].stands_bounded());
        let boxes: Vec<_> = leaves.iter().map(|&body| bodies[body].box_m()).collect();
        Self {
            hierarchy: Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes),
            highest_m: boxes
                .iter()
                .map(|bounds| bounds.maxs.z)
                .fold(f64::NEG_INFINITY, f64::max),
            leaves,
            others,
            bodies,
            growth: None,
            water_m: None,
        }
    }

    /// The same with plants.
    #[must_use]
    pub fn with_growth(self, growth: Growth) -> Self {
        Self {
            growth: Some(growth),
            ..self
        }
    }

    /// The same with still water up to a height above z = 0, metres.
    #[must_use]
    pub fn with_water(self, level_m: f64) -> Self {
        Self {
            water_m: Some(level_m),
            ..self
        }
    }

    /// The plants; [`Scene::cast`] and [`Scene::echo`] do not meet them.
    pub fn growth(&self) -> Option<&Growth> {
        self.growth.as_ref()
    }

    /// How far along the unit vector `direction` a beam may return from, where it may from `max_m`: none
    /// returns through the surface of water. Light from above is mirrored away or lost in it, sound from
    /// below does not leave it.
    pub fn reach_m(&self, origin: Point3<f64>, direction: Vector3<f64>, max_m: f64) -> f64 {
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
        let ray = Ray::new(parry_vector(origin.coords), parry_vector(direction));
        let standing = self.hierarchy.find_best(
            max_m,
            |node, nearest_m| node.cast_ray(&ray, nearest_m),
            |leaf, nearest_m| self.leaf(leaf)?.cast(&ray, nearest_m, time_s),
        );
        let mut nearest =
            standing.and_then(|(leaf, hit)| Some((*self.leaves.get(leaf as usize)?, hit)));
        for &index in &self.others {
            let nearest_m = nearest.map_or(max_m, |(_, hit)| hit.time_of_impact);
            let hit = self.bodies.get(index)?.cast(&ray, nearest_m, time_s);
            nearest = hit.map(|hit| (index, hit)).or(nearest);
        }
        nearest.map(|(solid, hit)| RayHit::new(solid, &hit))
    }

    /// Height of the highest surface above or below a point, as seen from above, metres; `None` where
    /// there is none.
    pub fn height_m(&self, at: Point2<f64>, time_s: f64) -> Option<f64> {
        let highest_m = self
            .others
            .iter()
            .filter_map(|&index| self.bodies.get(index)?.top_m(at, time_s))
            .fold(self.highest_m, f64::max);
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
    pub fn touches_placed_box(
        &self,
        size_m: Vector3<f64>,
        world_from_box: &Pose,
        time_s: f64,
    ) -> bool {
        let cuboid = Cuboid::new(parry_vector(0.5 * size_m));
        let world_from_box = body::parry_pose(world_from_box);
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
        let touches = |body: &Body| body.touches(cuboid, world_from_box, time_s);
        self.hierarchy
            .intersect_aabb(bounds)
            .filter_map(|leaf| self.leaf(leaf))
            .any(touches)
            || self
                .others
                .iter()
                .filter_map(|&index| self.bodies.get(index))
                .any(touches)
    }

    fn leaf(&self, leaf: u32) -> Option<&Body> {
        self.bodies.get(*self.leaves.get(leaf as usize)?)
    }

    fn reflectivity(&self, solid: usize) -> Reflectivity {
        self.bodies
            .get(solid)
            .map_or(Reflectivity::Diffuse, Body::reflectivity)
    }
}

/// From where [`Scene::height_m`] looks down.
const ABOVE_ALL_M: f64 = 1.0;

impl RayHit {
    fn new(solid: usize, hit: &RayIntersection) -> Self {
        let inside = hit.time_of_impact <= 0.0;
        Self {
            distance_m: hit.time_of_impact.max(0.0),
            normal: if inside {
                Vector3::zeros()
            } else {
                Vector3::new(hit.normal.x, hit.normal.y, hit.normal.z)
            },
            solid,
        }
    }
}

fn parry_vector(v: Vector3<f64>) -> ParryVector {
    ParryVector::new(v.x, v.y, v.z)
}

#[cfg(test)]
mod tests;
