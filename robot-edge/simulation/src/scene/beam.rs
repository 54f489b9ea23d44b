//! What a laser measures along one line.

use nalgebra::{Point3, Vector3};
use parry3d_f64::query::Ray;

use super::{Scene, parry_vector};
use crate::solid::Reflectivity;

/// What comes back along a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Echo {
    /// Length of the light's path to the surface that scatters it, metres.
    pub path_m: f64,
    /// Unit normal of that surface, towards the light; zero where the laser is inside a solid.
    pub normal: Vector3<f64>,
    /// Whether the path is straight: no mirror bent it.
    pub is_straight: bool,
}

/// A beam between mirrors that face each other ends somewhere.
const MAX_REFLECTIONS: usize = 4;

/// So does one through many panes.
const MAX_PANES: usize = 8;

/// How far from a mirror or a pane the beam goes on, so that it does not meet the same surface again.
const GAP_M: f64 = 1e-9;

impl Scene {
    /// What a laser measures of solids along the unit vector `direction`, mirrors and panes included; `None`
    /// where no surface ends the path within `max_m`, or water lies before it.
    ///
    /// `chance` in [0, 1) decides at every specular surface whether it mirrors and at every pane whether
    /// it lets through. One number serves all: given that it fell below a probability p, chance / p is
    /// uniform again.
    pub fn echo(
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
            let hit = self.cast(origin, direction, reach_m, time_s)?;
            length_m += hit.distance_m;
            let (probability, is_glass) = match self.reflectivity(hit.solid) {
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
                let left_m = max_m - length_m;
                let through_m = self.way_out_m(hit.solid, within, direction, left_m, time_s)?;
                length_m += through_m + 2.0 * GAP_M;
                origin = within + direction * (through_m + GAP_M);
            } else {
                reflections += 1;
                origin += direction * hit.distance_m + hit.normal * GAP_M;
                direction -= hit.normal * (2.0 * direction.dot(&hit.normal));
            }
        }
    }

    fn way_out_m(
        &self,
        solid: usize,
        within: Point3<f64>,
        direction: Vector3<f64>,
        max_m: f64,
        time_s: f64,
    ) -> Option<f64> {
        let ray = Ray::new(parry_vector(within.coords), parry_vector(direction));
        self.bodies.get(solid)?.way_out_m(&ray, max_m, time_s)
    }
}
