//! A vehicle's body, and what it cannot drive through.

use std::sync::Arc;

use nalgebra::{Translation3, Vector3};

use crate::scene::Scene;
use measurement::pose::Pose;

/// The box about a vehicle's body, centred on `base_link` along x and y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Along x, metres.
    pub length_m: f64,
    /// Along y, metres.
    pub width_m: f64,
    /// Height of its underside above `base_link`, metres; negative under water. On wheels what is lower is
    /// driven over: it is at the height of the axles, since a wheel that is pushed against a higher step only
    /// pushes.
    pub lowest_m: f64,
    /// Height of its top above `base_link`, metres.
    pub highest_m: f64,
}

/// A body among what it can run into: solids, and plants that do not give way.
#[derive(Clone)]
pub struct Bumper {
    body: Body,
    scene: Arc<Scene>,
}

/// A depth is exact to 2⁻²⁴ of half the body: far less than a slow vehicle moves in a step.
const DEPTH_HALVINGS: u32 = 24;

/// What rounding makes of the depth of one who moves along a wall.
const NO_DEEPER_M: f64 = 1e-7;

impl Bumper {
    /// A body in the world of `scene`.
    pub fn new(body: Body, scene: Arc<Scene>) -> Self {
        Self { body, scene }
    }

    /// Whether anything is in the body of a vehicle at `world_from_base`, `time_s` seconds since the beginning.
    pub fn touches(&self, world_from_base: &Pose, time_s: f64) -> bool {
        self.touches_inside(0.0, world_from_base, time_s)
    }

    /// Whether the vehicle can move on from one place to another near by.
    ///
    /// Where something is in its body already, because that moved or because the body came down on it, it can move
    /// to where it is no deeper.
    pub fn allows_motion(&self, from: &Pose, to: &Pose, time_s: f64) -> bool {
        let is_no_deeper = || self.depth_m(to, time_s) <= self.depth_m(from, time_s) + NO_DEEPER_M;
        !self.touches(to, time_s) || (self.touches(from, time_s) && is_no_deeper())
    }

    /// How far something reaches into the body: by how much all its faces have to be drawn in for it to be free.
    fn depth_m(&self, world_from_base: &Pose, time_s: f64) -> f64 {
        let (mut free_m, mut touching_m) = (0.5 * self.size_m().min(), 0.0);
        for _ in 0..DEPTH_HALVINGS {
            let middle_m = 0.5 * (free_m + touching_m);
            if self.touches_inside(middle_m, world_from_base, time_s) {
                touching_m = middle_m;
            } else {
                free_m = middle_m;
            }
        }
        free_m
    }

    fn touches_inside(&self, inset_m: f64, world_from_base: &Pose, time_s: f64) -> bool {
        let middle_m = 0.5 * (self.body.lowest_m + self.body.highest_m);
        let world_from_body = world_from_base * Translation3::new(0.0, 0.0, middle_m);
        let size_m = self.size_m().add_scalar(-2.0 * inset_m);
        self.scene
            .touches_placed_box(size_m, &world_from_body, time_s)
            || self
                .scene
                .growth()
                .is_some_and(|growth| growth.vegetation.has_rigid_in(size_m, &world_from_body))
    }

    fn size_m(&self) -> Vector3<f64> {
        let Body {
            length_m,
            width_m,
            lowest_m,
            highest_m,
        } = self.body;
        Vector3::new(length_m, width_m, highest_m - lowest_m)
    }
}

#[cfg(test)]
mod tests;
