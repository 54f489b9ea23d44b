//! What the built-in worlds of the elevation document must be for their experiments.

use nalgebra::{Point2, Point3, Vector3};

use super::*;
use crate::solid::{Reflectivity, Shape, Solid};
use crate::truth::outline::Outline;
use crate::truth::{Bounds, GroundPlane, HeightOptions, HeightTruth, Thresholds, heights};

const ELEVATION: &[&str] = &["hall", "floor", "ramp", "street", "bumps", "turn", "walker"];

const DOCUMENT: Thresholds = Thresholds {
    above_m: 0.10,
    below_m: -0.10,
};

/// Of the circle that holds the corners of Holos' body.
const RADIUS_M: f64 = 0.571;

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

fn truth(world: &World, min_m: [f64; 2], max_m: [f64; 2]) -> HeightTruth {
    let bounds = Bounds { min_m, max_m };
    heights(world, 0.2, bounds, HeightOptions::default()).unwrap()
}

/// Whether the cell of 0.2 m that holds a point is an obstacle to a vehicle on z = 0.
fn is_obstacle(truth: &HeightTruth, x: f64, y: f64) -> bool {
    let cell = truth
        .get([x, y].map(|m| libm::floor(m / 0.2) as i64))
        .unwrap();
    let verdict = cell.verdict(&GroundPlane::level(0.0), DOCUMENT);
    verdict.unwrap().is_obstacle
}

#[test]
fn paths_keep_clear_of_everything_that_is_not_driven_over() {
    for name in ELEVATION {
        let world = load(name);
        let path = world.path();
        for height_m in [0.12, 0.3, 0.7, 1.1] {
            let outline = Outline::at_height(world.solids(), height_m);
            let steps = (path.duration_s() / 0.1) as usize + 1;
            for step in 0..=steps {
                let position_m = path.planar_pose(step as f64 * 0.1).position_m;
                let clearance_m = outline.distance_m(position_m) - RADIUS_M;
                assert!(
                    clearance_m > 0.1 && !outline.contains(position_m),
                    "{name}: {clearance_m} m at {position_m}, height {height_m} m"
                );
            }
        }
    }
}

#[test]
fn the_hall_has_the_documents_lengths() {
    let world = load("hall");
    let face = |name, aim: Vector3<f64>| {
        let solid = solid(&world, name).clone();
        let scene = crate::scene::Scene::new(std::slice::from_ref(&solid));
        let centre = solid.world_from_solid.translation.vector;
        let from = Point3::from(centre - aim * 30.0);
        from + aim * scene.cast(from, aim, 100.0, 0.0).unwrap().distance_m
    };
    let pillar = face("first pillar", -Vector3::y());
    let wall = face("left wall", Vector3::y());
    assert!((wall.y - pillar.y - 1.7).abs() < 1e-9, "{wall} {pillar}");
    let [first, second] = ["first pillar", "second pillar"].map(|name| face(name, Vector3::x()).x);
    assert!((second - first - 4.2).abs() < 1e-9);
    // 4.2 m in the first 21 s.
    let at = world.path().planar_pose(21.0).position_m;
    assert!((at - Point2::new(4.2, 0.0)).norm() < 1e-9, "{at}");
    let truth = truth(&world, [-2.0, -4.5], [22.2, 4.0]);
    assert!(is_obstacle(&truth, 3.42, 1.78) && !is_obstacle(&truth, 3.42, 2.9));
}

#[test]
fn the_ramp_goes_down_by_four_degrees_without_cracks() {
    let world = load("ramp");
    let on_ramp_m = |x: f64| -(x - 7.12) * libm::tan(4.0_f64.to_radians());
    for x in [7.2, 12.0, 20.0, 31.0] {
        assert!(
            (height_m(&world, x, 0.3) - on_ramp_m(x)).abs() < 1e-4,
            "{x}"
        );
    }
    for (x, expected_m) in [
        (1.0, 0.0),
        (7.0, 0.0),
        (2.5, 0.03),
        (4.2, 0.02),
        (33.0, -1.68),
    ] {
        assert!((height_m(&world, x, 0.3) - expected_m).abs() < 1e-9, "{x}");
    }
    // From the upper level all of the ramp but its beginning is below −0.1 m; on its own plane all is free.
    let truth = truth(&world, [5.0, -2.8], [31.0, 2.8]);
    let ramp = GroundPlane {
        point_m: Point3::new(7.12, 0.0, 0.0),
        normal: Vector3::new(
            libm::sin(4.0_f64.to_radians()),
            0.0,
            libm::cos(4.0_f64.to_radians()),
        ),
    };
    for (index, cell) in truth.iter().filter(|(index, _)| index[0] >= 36) {
        let x = index[0] as f64 * 0.2;
        let of = |ground: &GroundPlane| cell.verdict(ground, DOCUMENT).unwrap();
        assert!(!of(&ramp).is_obstacle, "{index:?} {:?}", of(&ramp));
        assert_eq!(
            of(&GroundPlane::level(0.0)).is_obstacle,
            x > 8.3,
            "{index:?}"
        );
    }
    for (index, cell) in truth.iter().filter(|(index, _)| index[0] < 35) {
        assert!(cell.min_m > -1e-9, "{index:?}");
    }
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
fn the_street_has_kerbs_a_ditch_a_pit_and_no_cracks() {
    let world = load("street");
    for (y, expected_m) in [
        (0.0, 0.0),
        (4.0, 0.0),
        (4.1, 0.15),
        (-4.1, 0.0),
        (-4.2, 0.15),
        (-5.5, -0.2),
        (-7.8, -0.2),
    ] {
        assert!((height_m(&world, 30.0, y) - expected_m).abs() < 1e-9, "{y}");
    }
    let truth = truth(&world, [-6.0, -10.4], [50.0, 7.2]);
    for x in [5.1, 30.1, 45.1] {
        for y in [4.1, -4.1, -5.5, -6.5, -7.7, 6.8, -10.1] {
            assert!(is_obstacle(&truth, x, y), "{x} {y}");
        }
        for y in [-3.9, 0.0, 3.9] {
            assert!(!is_obstacle(&truth, x, y), "{x} {y}");
        }
    }
    for (x, y) in [
        (8.5, 4.5),
        (10.1, -4.5),
        (12.3, 3.0),
        (14.3, -1.7),
        (19.5, -2.6),
        (15.9, -1.5),
    ] {
        assert!(is_obstacle(&truth, x, y), "{x} {y}");
    }
    // The lane that it drives along is bare.
    for (index, cell) in truth
        .iter()
        .filter(|(index, _)| (-4..20).contains(&index[1]))
    {
        if cell.max_m < 1e-9 {
            assert!(cell.min_m > -1e-9, "{index:?} {}", cell.min_m);
        }
        if (-4..10).contains(&index[1]) {
            assert!(cell.max_m < 1e-9, "{index:?} {}", cell.max_m);
        }
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
fn the_walker_walks_through_the_doors_and_nothing_else() {
    let world = load("walker");
    let walls = Outline::at_height(world.solids(), 0.5);
    let person = [solid(&world, "legs"), solid(&world, "trunk")];
    assert_eq!(person[0].motion, person[1].motion);
    let Shape::Cylinder { radius_m, height_m } = person[1].shape else {
        panic!("{person:?}")
    };
    let mut was_at: Option<Point2<f64>> = None;
    for step in 0..=300 {
        let time_s = f64::from(step) * 0.1;
        let trunk = person[1].at(time_s);
        assert_eq!(trunk.is_some(), (4.0..20.7).contains(&time_s), "{time_s}");
        let Some(trunk) = trunk else { continue };
        let at = Point3::from(trunk.world_from_solid.translation.vector);
        assert!((at.z + 0.5 * height_m - 1.75).abs() < 1e-9);
        assert!(
            walls.distance_m(at.xy()) > radius_m + 0.05,
            "{time_s} s: {at}"
        );
        let robot_m = world.path().planar_pose(time_s).position_m;
        assert!((at.xy() - robot_m).norm() > 1.5, "{time_s} s: {at}");
        if let Some(before) = was_at {
            let pace_mps = (at.xy() - before).norm() / 0.1;
            assert!(pace_mps < 1.5, "{time_s} s: {pace_mps} m/s");
        }
        was_at = Some(at.xy());
    }
    assert!(was_at.unwrap().y > 8.0);
    assert!(world.path().duration_s() > 20.7 + 30.0);
}
