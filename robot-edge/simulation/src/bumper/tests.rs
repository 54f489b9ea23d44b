use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use super::*;
use crate::motion::Motion;
use crate::solid::{Reflectivity, Shape, Solid};
use crate::world::World;
use measurement::pose;

const BODY: Body = Body {
    length_m: 1.0,
    width_m: 0.6,
    lowest_m: 0.1,
    highest_m: 0.5,
};

/// A bumper beside a wall whose face is the plane x = 1.
fn at_a_wall(height_m: f64) -> Bumper {
    let mut world_from_solid = pose::planar(1.5, 0.0, 0.0);
    world_from_solid.translation.z = 0.5 * height_m;
    let wall = Solid {
        name: String::new(),
        shape: Shape::Box {
            size_m: [1.0, 9.0, height_m],
        },
        world_from_solid,
        reflectivity: Reflectivity::Diffuse,
        motion: None,
    };
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
fn what_is_lower_than_its_underside_or_above_its_top_is_passed() {
    let near = pose::planar(0.9, 0.0, 0.0);
    assert!(!at_a_wall(0.09).touches(&near, 0.0));
    assert!(at_a_wall(0.11).touches(&near, 0.0));
    let below = near * Translation3::new(0.0, 0.0, -0.51);
    assert!(!at_a_wall(2.0).touches(&below, 0.0));
}

#[test]
fn who_is_in_something_already_can_leave_but_not_go_deeper() {
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
        r#"name = "strip"
vehicle = "pioneer"
noise = {{ range_m = 0.01, dropout = 0.005 }}
start = {{ x_m = 0, y_m = 0, yaw_deg = 0 }}
path = {{ speed_mps = 0.5, turn_rate_degps = 60, waypoints = [{{ x_m = 1, y_m = 0 }}] }}

[[solids]]
shape = "plane"
point_m = [0.0, 0.0, 0.0]

[[plants]]
kind = "stems"
seed = 1
rigidity = "{rigidity}"
rectangle_m = [[3.0, -1.0], [3.2, 1.0]]
density_per_m2 = 200.0
height_m = [0.9, 1.0]
thickness_mm = [8.0, 12.0]
lean_deg = 0.0
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
