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

/// A switch along one side of the body, which what touches the body there presses.
#[derive(Clone, Debug, PartialEq)]
pub struct ContactSensor {
    pub stream: &'static str,
    /// The middle of its face, x outwards; it is as high as the body.
    pub base_from_face: Pose,
    /// Along y, metres.
    pub width_m: f64,
    pub rate_hz: f64,
}

/// What is nearer presses it, metres: a vehicle that something stops ends within a step's way of it.
const PRESS_M: f64 = 0.02;

/// A body among what it can run into: solids, and plants that do not give way.
#[derive(Clone)]
pub(crate) struct Bumper {
    body: Body,
    scene: Arc<Scene>,
}

/// A depth is exact to 2⁻²⁴ of half the body: far less than a slow vehicle moves in a step.
const DEPTH_HALVINGS: u32 = 24;

/// What rounding makes of the depth of a body that moves along a wall.
const NO_DEEPER_M: f64 = 1e-7;

impl Bumper {
    pub(crate) fn new(body: Body, scene: Arc<Scene>) -> Self {
        Self { body, scene }
    }

    /// Whether anything is in the body of a vehicle at `world_from_base`, `time_s` seconds since the beginning.
    pub(crate) fn touches(&self, world_from_base: &Pose, time_s: f64) -> bool {
        self.touches_inside(0.0, world_from_base, time_s)
    }

    /// Whether the vehicle can move on from one place to another near by.
    ///
    /// Where something is in its body already, because that moved or because the body came down on it, it can move
    /// to where it is no deeper.
    pub(crate) fn allows_motion(&self, from: &Pose, to: &Pose, time_s: f64) -> bool {
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

    /// Whether something presses a switch of a vehicle at `world_from_base`.
    pub(crate) fn presses(
        &self,
        sensor: &ContactSensor,
        world_from_base: &Pose,
        time_s: f64,
    ) -> bool {
        let mut base_from_face = sensor.base_from_face;
        base_from_face.translation.z = self.middle_m();
        let face_from_box = Translation3::new(0.5 * PRESS_M, 0.0, 0.0);
        let size_m = Vector3::new(PRESS_M, sensor.width_m, self.size_m().z);
        let world_from_box = world_from_base * base_from_face * face_from_box;
        self.touches_box(size_m, &world_from_box, time_s)
    }

    fn touches_inside(&self, inset_m: f64, world_from_base: &Pose, time_s: f64) -> bool {
        let world_from_body = world_from_base * Translation3::new(0.0, 0.0, self.middle_m());
        let size_m = self.size_m().add_scalar(-2.0 * inset_m);
        self.touches_box(size_m, &world_from_body, time_s)
    }

    fn touches_box(&self, size_m: Vector3<f64>, world_from_box: &Pose, time_s: f64) -> bool {
        self.scene
            .touches_placed_box(size_m, world_from_box, time_s)
            || self
                .scene
                .growth()
                .is_some_and(|growth| growth.vegetation.has_rigid_in(size_m, world_from_box))
    }

    fn middle_m(&self) -> f64 {
        0.5 * (self.body.lowest_m + self.body.highest_m)
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
mod tests {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

    use measurement::pose;

    use super::*;
    use crate::fixtures::{HEADER, block};
    use crate::motion::Motion;
    use crate::world::World;

    const BODY: Body = Body {
        length_m: 1.0,
        width_m: 0.6,
        lowest_m: 0.1,
        highest_m: 0.5,
    };

    /// A bumper beside a wall whose face is the plane x = 1.
    fn at_a_wall(height_m: f64) -> Bumper {
        let wall = block([1.5, 0.0], [1.0, 9.0, height_m]);
        Bumper::new(BODY, Arc::new(Scene::new(&[wall])))
    }

    #[test]
    fn it_touches_with_its_outline_at_any_yaw() {
        let bumper = at_a_wall(2.0);
        let touches = |x, yaw_rad| bumper.touches(&pose::planar(x, 0.3, yaw_rad), 0.0);
        assert!(!touches(0.499, 0.0) && touches(0.501, 0.0));
        assert!(!touches(0.699, FRAC_PI_2) && touches(0.701, FRAC_PI_2));
        // A corner: (0.5 + 0.3) / √2.
        assert!(!touches(0.434, FRAC_PI_4) && touches(0.435, FRAC_PI_4));
    }

    #[test]
    fn objects_below_or_above_the_body_are_passed() {
        let near = pose::planar(0.9, 0.0, 0.0);
        assert!(!at_a_wall(0.09).touches(&near, 0.0));
        assert!(at_a_wall(0.11).touches(&near, 0.0));
        let below = near * Translation3::new(0.0, 0.0, -0.51);
        assert!(!at_a_wall(2.0).touches(&below, 0.0));
    }

    #[test]
    fn what_touches_a_side_presses_the_switch_there_and_no_other() {
        let bumper = at_a_wall(2.0);
        let switch = |x_m, yaw_rad| ContactSensor {
            stream: "/bumper",
            base_from_face: pose::planar(x_m, 0.0, yaw_rad),
            width_m: 0.6,
            rate_hz: 20.0,
        };
        let (front, rear) = (switch(0.5, 0.0), switch(-0.5, 2.0 * FRAC_PI_2));
        for (x_m, yaw_rad, expected) in [
            (0.47, 0.0, [false, false]),
            (0.495, 0.0, [true, false]),
            (0.495, 2.0 * FRAC_PI_2, [false, true]),
        ] {
            let at = pose::planar(x_m, 0.0, yaw_rad);
            let pressed = [&front, &rear].map(|switch| bumper.presses(switch, &at, 0.0));
            assert_eq!(pressed, expected, "{x_m} {yaw_rad}");
        }
    }

    #[test]
    fn a_vehicle_inside_a_solid_can_only_leave() {
        let bumper = at_a_wall(2.0);
        let at = |x| pose::planar(x, 0.0, 0.0);
        let passes = |from, to| bumper.allows_motion(&at(from), &at(to), 0.0);
        assert!(passes(0.49, 0.499) && !passes(0.499, 0.501));
        assert!(passes(0.55, 0.549_9) && !passes(0.55, 0.550_1));
        assert!(passes(0.501, 0.499));
        let along = |y| pose::planar(0.55, y, 0.0);
        assert!(bumper.allows_motion(&along(0.0), &along(0.3), 0.0));
    }

    /// Stems on a strip of 0.2 m from x = 3 on.
    fn strip(rigidity: &str) -> World {
        let text = format!(
            r#"{HEADER}
    [[solids]]
    shape = "plane"

    [[plants]]
    kind = "stems"
    seed = 1
    rigidity = "{rigidity}"
    rectangle_m = [[3.0, -1.0], [3.2, 1.0]]
    density_per_m2 = 200.0
    height_m = [0.9, 1.0]
    thickness_mm = [8.0, 12.0]
    "#
        );
        World::parse("strip.toml", &text).unwrap()
    }

    #[test]
    fn rigid_plants_stop_it_and_flexible_ones_do_not() {
        for (rigidity, stops) in [("rigid", true), ("flexible", false)] {
            let bumper = Bumper::new(BODY, Arc::clone(strip(rigidity).scene()));
            let at = |x, y, yaw_rad| bumper.touches(&pose::planar(x, y, yaw_rad), 0.0);
            let touches = |x, yaw_rad| at(x, 0.0, yaw_rad);
            assert!(!touches(2.48, 0.0) && !touches(3.72, 0.0));
            assert_eq!([touches(2.6, 0.0), touches(3.6, 0.0)], [stops; 2]);
            assert!(!touches(2.68, FRAC_PI_2));
            assert_eq!(touches(2.60, FRAC_PI_4), stops);
            // Off a corner of the strip, where only the upright box about the turned body reaches.
            assert!(!at(2.6, 1.45, FRAC_PI_4));
        }
    }

    /// A vehicle that is taken off its path must not be in something there.
    #[test]
    fn no_path_of_a_built_in_world_leads_through_anything() {
        for name in World::names() {
            let world = World::load(name).unwrap();
            let motion = Motion::new(&world);
            let vehicle = world.simulated_vehicle();
            let bumper = Bumper::new(vehicle.body, Arc::clone(world.scene()));
            let fifths = (5.0 * world.path().duration_s().min(12.0)) as u32;
            for fifth in 0..=fifths {
                let time_s = 0.2 * f64::from(fifth);
                let world_from_base = motion.world_from_base(time_s);
                assert!(
                    !bumper.touches(&world_from_base, time_s),
                    "{name} after {time_s} s at {}",
                    world_from_base.translation
                );
            }
        }
    }
}
