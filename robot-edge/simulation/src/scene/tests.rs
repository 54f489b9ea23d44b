#![expect(clippy::float_cmp, reason = "these values are exact")]

use std::f64::consts::FRAC_PI_2;

use nalgebra::{UnitQuaternion, Vector2};
use proptest::prelude::*;

use super::*;
use crate::fixtures::{a_box, solid};
use crate::solid::{Keyframe, Mesh};

fn reflecting(centre_m: [f64; 3], size_m: [f64; 3], reflectivity: Reflectivity) -> Solid {
    Solid {
        reflectivity,
        ..a_box(centre_m, size_m)
    }
}

proptest! {
    #[test]
    fn a_mirrored_range_is_the_distance_to_the_mirror_image(
        place in (-2.0_f64..2.0, -1.9_f64..1.9),
        aim_y_m in -1.9_f64..1.9,
    ) {
        // A mirror at x = 3, a wall at x = −3: the wall's image stands at x = 9.
        let mirror = Reflectivity::Specular { probability: 1.0 };
        let scene = Scene::new(&[
            reflecting([3.1, 0.0, 0.0], [0.2, 4.0, 2.0], mirror),
            a_box([-3.1, 0.0, 0.0], [0.2, 100.0, 2.0]),
        ]);
        let origin = Point3::new(place.0, place.1, 0.0);
        let direction = (Point3::new(3.0, aim_y_m, 0.0) - origin).normalize();
        let expected = (9.0 - place.0) / direction.x;
        let path_m = scene.echo(origin, direction, 100.0, 0.0, 0.5).unwrap().path_m;
        prop_assert!((path_m - expected).abs() < 1e-8, "{path_m} {expected}");
        // Too long a path is no reading, even though the mirror itself is near.
        prop_assert!(scene.echo(origin, direction, expected - 0.01, 0.0, 0.5).is_none());
    }
}

#[test]
fn chance_decides_whether_a_specular_surface_mirrors() {
    let mirror = Reflectivity::Specular { probability: 0.3 };
    let scene = Scene::new(&[
        reflecting([2.5, 0.0, 0.0], [1.0, 1.0, 1.0], mirror),
        reflecting([-2.5, 0.0, 0.0], [1.0, 1.0, 1.0], mirror),
    ]);
    let path_m = |chance| {
        let echo = scene.echo(Point3::origin(), Vector3::x(), 100.0, 0.0, chance);
        echo.map(|echo| echo.path_m)
    };
    assert_eq!(path_m(0.3), Some(2.0));
    assert_eq!(path_m(0.299), Some(6.0 - 1e-9));
    // 0.3² lets it be mirrored twice, and between facing mirrors there is an end.
    assert!((path_m(0.089).unwrap() - 10.0).abs() < 1e-8);
    assert!((path_m(0.0).unwrap() - 18.0).abs() < 1e-7);
}

#[test]
fn no_hit_out_of_reach_and_zero_range_inside_a_solid() {
    let scene = Scene::new(&[a_box([2.5, 0.0, 0.0], [1.0, 1.0, 1.0])]);
    assert_eq!(scene.cast(Point3::origin(), Vector3::x(), 1.999, 0.0), None);
    assert_eq!(scene.cast(Point3::origin(), Vector3::y(), 100.0, 0.0), None);
    let inside = scene
        .cast(Point3::new(2.5, 0.0, 0.0), Vector3::x(), 100.0, 0.0)
        .unwrap();
    assert_eq!(inside.distance_m, 0.0);
    assert_eq!(
        Scene::new(&[]).cast(Point3::origin(), Vector3::x(), 100.0, 0.0),
        None
    );
}

fn at(x: f64, y: f64, z: f64) -> Pose {
    Pose::translation(x, y, z)
}

/// Intersections themselves are parry's; this checks sizes, axes and frames.
#[test]
fn each_shape_has_its_size_and_frame() {
    let mut turned = at(5.0, 0.0, 0.0);
    turned.rotation = UnitQuaternion::from_euler_angles(0.0, 0.0, FRAC_PI_2);
    let size_m = [4.0, 1.0, 2.0];
    let (radius_m, height_m) = (0.5, 2.0);
    let boxed = solid(Shape::Box { size_m }, turned);
    let pole = Shape::Cylinder { radius_m, height_m };
    let pole = solid(pole, at(5.0, 0.0, 0.0));
    let ball = solid(Shape::Sphere { radius_m }, at(5.0, 0.0, 0.0));
    let ground = solid(Shape::Plane, at(0.0, 0.0, -1.0));
    for (solid, [y, z], expected_m) in [
        (&boxed, [1.9, 0.9], Some(4.5)),
        (&boxed, [2.1, 0.0], None),
        (&boxed, [0.0, 1.1], None),
        (&pole, [0.0, 0.9], Some(4.5)),
        (&pole, [0.0, 1.1], None),
        (&pole, [0.6, 0.0], None),
        (&ball, [0.3, 0.0], Some(4.6)),
        (&ball, [0.0, 0.6], None),
        (&ground, [0.0, 0.0], None),
        (&ground, [0.0, -1.1], Some(0.0)),
    ] {
        let scene = Scene::new(std::slice::from_ref(solid));
        let hit = scene.cast(Point3::new(0.0, y, z), Vector3::x(), 100.0, 0.0);
        let distance_m = hit.map(|hit| (hit.distance_m * 1e5).round() / 1e5);
        assert_eq!(distance_m, expected_m, "{:?} {y} {z}", solid.shape);
    }
    let slope = Mesh::of_heights(0.5, &[vec![0.0, 0.4], vec![0.0, 0.4]]).unwrap();
    let scene = Scene::new(&[solid(Shape::Mesh(slope), at(1.0, 1.0, 2.0))]);
    let height_m = scene.height_m(Point2::new(1.125, 1.25), 0.0).unwrap();
    assert!((height_m - 2.1).abs() < 1e-9, "{height_m}");
}

proptest! {
    #[test]
    fn a_tilted_plane_has_its_height_everywhere(
        x in -50.0_f64..50.0, y in -50.0_f64..50.0, pitch_rad in -0.5_f64..0.5,
    ) {
        let mut frame = at(2.0, 0.0, 0.3);
        frame.rotation = UnitQuaternion::from_euler_angles(0.0, pitch_rad, 0.0);
        let scene = Scene::new(&[solid(Shape::Plane, frame)]);
        let height_m = scene.height_m(Point2::new(x, y), 0.0).unwrap();
        let expected_m = 0.3 - libm::tan(pitch_rad) * (x - 2.0);
        prop_assert!((height_m - expected_m).abs() < 1e-9, "{height_m} {expected_m}");
    }
}

#[test]
fn the_nearest_of_ground_still_and_moving_things_counts() {
    let mut walker = a_box([0.0, 0.0, 0.9], [0.5, 0.5, 1.8]);
    let frames = [(2.0, 0.0), (6.0, 4.0)].map(|(time_s, y)| Keyframe {
        time_s,
        offset_m: Vector2::new(5.0, y),
    });
    walker.motion = Some(Motion::new(frames.to_vec(), 1.0, 8.0).unwrap());
    let scene = Scene::new(&[
        solid(Shape::Plane, Pose::identity()),
        walker,
        a_box([10.5, 0.0, 1.0], [1.0, 20.0, 2.0]),
    ]);
    let hit = |y_m: f64, time_s| {
        let hit = scene
            .cast(Point3::new(0.0, y_m, 1.0), Vector3::x(), 100.0, time_s)
            .unwrap();
        (hit.solid, (hit.distance_m * 1e6).round() / 1e6)
    };
    assert_eq!(hit(0.0, 0.9), (2, 10.0));
    assert_eq!(hit(0.0, 1.0), (1, 4.75));
    assert_eq!(hit(0.0, 3.0), (2, 10.0));
    assert_eq!(hit(1.0, 3.0), (1, 4.75));
    assert_eq!(hit(4.0, 7.9), (1, 4.75));
    assert_eq!(hit(4.0, 8.0), (2, 10.0));
    let down = (Vector3::x() - Vector3::z() * 0.5).normalize();
    let ground = scene
        .cast(Point3::new(0.0, 0.0, 1.0), down, 100.0, 0.0)
        .unwrap();
    assert_eq!(ground.solid, 0);
    assert_eq!(ground.normal, Vector3::z());
    for (at, time_s, expected) in [
        ([1.0, 1.0], 0.0, 0.0),
        ([10.2, 1.0], 0.0, 2.0),
        ([5.2, 4.2], 7.0, 1.8),
        ([5.2, 4.2], 9.0, 0.0),
    ] {
        let height_m = scene.height_m(Point2::from(at), time_s).unwrap();
        assert!((height_m - expected).abs() < 1e-12, "{at:?} {height_m}");
    }
    assert_eq!(Scene::new(&[]).height_m(Point2::origin(), 0.0), None);
}

#[test]
fn glass_lets_its_share_through_and_measures_what_is_behind() {
    let glass = |transmission| Reflectivity::Glass { transmission };
    let mut pane = reflecting([2.005, 0.0, 0.0], [0.01, 4.0, 4.0], glass(0.8));
    let wall = a_box([6.5, 0.0, 0.0], [1.0, 40.0, 4.0]);
    let direction = Vector3::new(3.0, 1.0, 0.0).normalize();
    let path_m = |scene: &Scene, chance| {
        let echo = scene.echo(Point3::origin(), direction, 100.0, 0.0, chance);
        echo.map(|echo| echo.path_m)
    };
    let [pane_m, wall_m] = [2.0, 6.0].map(|x| x / direction.x);
    let scene = Scene::new(&[pane.clone(), wall.clone()]);
    let n = 1000;
    let mut through = 0;
    for k in 0..n {
        let found = path_m(&scene, (f64::from(k) + 0.5) / f64::from(n)).unwrap();
        if (found - wall_m).abs() < 1e-9 {
            through += 1;
        } else {
            assert!((found - pane_m).abs() < 1e-9, "{found}");
        }
    }
    assert_eq!(through, 800);

    // Round glass, and two panes one behind the other: 0.8².
    let tube = Shape::Cylinder {
        radius_m: 0.5,
        height_m: 4.0,
    };
    let mut tube = solid(tube, at(3.9, 1.3, 0.0));
    tube.reflectivity = glass(0.8);
    let scene = Scene::new(&[pane.clone(), tube, wall.clone()]);
    assert!((path_m(&scene, 0.639).unwrap() - wall_m).abs() < 1e-6);
    let tube_m = libm::sqrt(3.9 * 3.9 + 1.3 * 1.3) - 0.5;
    assert!((path_m(&scene, 0.641).unwrap() - tube_m).abs() < 1e-6);
    assert!((path_m(&scene, 0.801).unwrap() - pane_m).abs() < 1e-9);

    // Behind glass there may be nothing, and what stands against the pane is still seen.
    assert_eq!(path_m(&Scene::new(&[pane.clone()]), 0.5), None);
    pane.reflectivity = glass(1.0);
    let flush = a_box([2.51, 0.0, 0.0], [1.0, 4.0, 4.0]);
    let scene = Scene::new(&[pane, flush]);
    assert!((path_m(&scene, 0.5).unwrap() - 2.01 / direction.x).abs() < 1e-8);
}
