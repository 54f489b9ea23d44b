//! What built-in worlds must be for their experiments; what needs their ground truth is asked in `tests/experiments`.

use nalgebra::{Point2, Point3, Vector3};

use super::*;
use crate::solid::{Reflectivity, Shape, Solid};

fn load(name: &str) -> World {
    World::load(name).unwrap()
}

fn solid<'a>(world: &'a World, name: &str) -> &'a Solid {
    let found = world.solids().iter().find(|solid| solid.name == name);
    found.unwrap_or_else(|| panic!("no {name}"))
}

/// Height of the surface under a point, movers and glass included.
fn height_m(world: &World, x: f64, y: f64) -> f64 {
    world.scene().height_m(Point2::new(x, y), 0.0).unwrap()
}

#[test]
fn bumps_lift_the_wheels_as_far_as_the_document_tilts_its_robot() {
    let world = load("bumps");
    for (x, y, tilt_deg, base_m) in [
        (2.5, 0.3, 4.5, 0.55),
        (2.5, -0.3, 4.5, 0.55),
        (4.7, 0.3, 2.5, 0.55),
        (4.7, -0.3, 2.5, 0.55),
        (7.7, -0.3, 5.2, 0.60),
    ] {
        let tilt = libm::asin(height_m(&world, x, y) / base_m).to_degrees();
        assert!((tilt - tilt_deg).abs() < 0.01, "{x} {y}: {tilt}");
    }
    assert!(height_m(&world, 7.7, 0.3).abs() < 1e-12);
    // Shorter than the wheelbase, so that only one axle stands on it; the plank carries both right wheels.
    for (name, is_short) in [
        ("board under the front wheels", true),
        ("board under the rear wheels", true),
        ("plank under the right wheels", false),
    ] {
        let Shape::Box { size_m } = solid(&world, name).shape else {
            panic!("{name}")
        };
        assert_eq!(size_m[0] < 0.55, is_short, "{name}");
    }
}

#[test]
fn the_turn_has_glass_before_a_room_and_before_blinds() {
    let world = load("turn");
    let seen = |from: [f64; 2], aim: Vector3<f64>, chance| {
        let from = Point3::new(from[0], from[1], 1.0);
        world
            .scene()
            .echo(from, aim, 20.0, 0.0, chance)
            .unwrap()
            .path_m
    };
    // The room is behind the glass, for four of five beams.
    assert!((seen([3.0, 1.0], Vector3::x(), 0.9) - 4.57).abs() < 1e-9);
    assert!(seen([3.0, 1.0], Vector3::x(), 0.79) > 10.0);
    // Behind the other pane only the blinds, 3 cm on.
    assert!((seen([4.2, 2.0], Vector3::y(), 0.5) - 7.33).abs() < 1e-6);
    let glass = |solid: &&Solid| matches!(solid.reflectivity, Reflectivity::Glass { .. });
    assert_eq!(world.solids().iter().filter(glass).count(), 2);
    let end = world.path().planar_pose(1e9);
    assert!((end.yaw_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
}

#[test]
fn sonar_measures_the_bed_and_the_laser_does_not() {
    let world = load("lake");
    let mut depths = Vec::new();
    let steps = (world.path().duration_s() / 0.2) as usize;
    for step in 0..=steps {
        let at = world.path().planar_pose(step as f64 * 0.2).position_m;
        let sonar = Point3::new(at.x, at.y, -0.5);
        let echo = world
            .scene()
            .echo(sonar, -Vector3::z(), 300.0, 0.0, 0.5)
            .unwrap();
        depths.push(echo.path_m + 0.5);
        let laser = Point3::new(at.x, at.y, 1.9);
        let ahead = Vector3::new(0.95, 0.0, -0.312).normalize();
        assert!(world.scene().echo(laser, ahead, 250.0, 0.0, 0.5).is_none());
    }
    let least = depths.iter().copied().fold(f64::INFINITY, f64::min);
    let most = depths.iter().copied().fold(0.0, f64::max);
    assert!(
        (2.0..3.0).contains(&least) && (5.0..6.0).contains(&most),
        "{least} {most}"
    );
}
