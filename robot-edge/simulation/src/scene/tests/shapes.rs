//! Rays against analytic intersections, shape by shape.

use std::f64::consts::PI;

use nalgebra::{UnitQuaternion, Vector2};

use super::*;
use crate::solid::mesh::Mesh;
use crate::solid::motion::{Keyframe, Motion};
use measurement::pose::Pose;

fn shape(shape: Shape, world_from_solid: Pose) -> Solid {
    Solid {
        name: String::new(),
        shape,
        world_from_solid,
        reflectivity: Reflectivity::Diffuse,
        motion: None,
    }
}

fn at(x: f64, y: f64, z: f64) -> Pose {
    Pose::translation(x, y, z)
}

/// Where a line is between two parallel planes at ±`half_m` from the origin.
fn slab(origin: f64, direction: f64, half_m: f64) -> [f64; 2] {
    if direction == 0.0 {
        return if origin.abs() <= half_m {
            [f64::NEG_INFINITY, f64::INFINITY]
        } else {
            [f64::INFINITY, f64::NEG_INFINITY]
        };
    }
    let ends = [-half_m, half_m].map(|plane| (plane - origin) / direction);
    [ends[0].min(ends[1]), ends[0].max(ends[1])]
}

/// Where a line is within `radius_m` of the origin, in as many dimensions as it has.
fn disc(origin: &[f64], direction: &[f64], radius_m: f64) -> Option<[f64; 2]> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (a, b) = (dot(direction, direction), dot(origin, direction));
    let discriminant = b * b - a * (dot(origin, origin) - radius_m * radius_m);
    let root = libm::sqrt(discriminant);
    (discriminant >= 0.0).then(|| [(-b - root) / a, (-b + root) / a])
}

/// The first point of an intersection of intervals that is not behind the origin.
fn first(intervals: &[[f64; 2]]) -> Option<f64> {
    let enter = intervals
        .iter()
        .fold(0.0_f64, |t, interval| t.max(interval[0]));
    let leave = intervals
        .iter()
        .fold(f64::INFINITY, |t, interval| t.min(interval[1]));
    (enter <= leave).then_some(enter)
}

/// Random rays from around a solid at `centre` of about `size_m`, aimed at and just beside it.
fn rays() -> impl Strategy<Value = (Point3<f64>, Point3<f64>)> {
    (
        prop::array::uniform3(-8.0_f64..8.0),
        prop::array::uniform3(-1.2_f64..1.2),
    )
        .prop_map(|(from, aim)| (Point3::from(from), Point3::from(aim)))
}

/// Compares a cast at a solid in a frame with an analytic cast in that frame; a graze may go either way.
fn check(
    solid: Solid,
    (from, aim): (Point3<f64>, Point3<f64>),
    analytic: impl Fn(Point3<f64>, Vector3<f64>) -> Option<f64>,
) -> Result<(), TestCaseError> {
    prop_assume!((aim - from).norm() > 0.1);
    let frame = solid.world_from_solid;
    let direction = (aim - from).normalize();
    let expected_m = analytic(from, direction);
    let jitter = [1e-5, -1e-5].map(|d| {
        let aside = direction.cross(&Vector3::new(0.3, -0.5, 0.8)).normalize() * d;
        analytic(from + aside, direction).is_some()
    });
    prop_assume!(jitter == [expected_m.is_some(); 2]);
    let scene = Scene::new(&[solid]);
    let hit = scene.cast(frame * from, frame.rotation * direction, 100.0, 0.0);
    prop_assert_eq!(hit.is_some(), expected_m.is_some());
    if let (Some(hit), Some(expected_m)) = (hit, expected_m) {
        // Parry meets cylinders by iteration.
        prop_assert!(
            (hit.distance_m - expected_m).abs() < 2e-6,
            "{} {}",
            hit.distance_m,
            expected_m
        );
        let towards = hit.normal.dot(&(frame.rotation * direction));
        prop_assert!(hit.distance_m == 0.0 || towards <= 1e-6, "{}", hit.normal);
    }
    Ok(())
}

proptest! {
    #[test]
    fn boxes_of_any_attitude(
        ray in rays(),
        size_m in prop::array::uniform3(0.1_f64..2.0),
        angles in prop::array::uniform3(-PI..PI),
    ) {
        let mut frame = at(1.0, -2.0, 0.7);
        frame.rotation = UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]);
        check(shape(Shape::Box { size_m }, frame), ray, |o, d| {
            first(&[0, 1, 2].map(|axis| slab(o[axis], d[axis], 0.5 * size_m[axis])))
        })?;
    }

    #[test]
    fn upright_cylinders(ray in rays(), radius_m in 0.02_f64..1.0, height_m in 0.1_f64..2.4) {
        let pole = shape(Shape::Cylinder { radius_m, height_m }, at(3.0, 1.0, 0.5));
        check(pole, ray, |o, d| {
            let round = disc(&[o.x, o.y], &[d.x, d.y], radius_m)?;
            first(&[round, slab(o.z, d.z, 0.5 * height_m)])
        })?;
    }

    #[test]
    fn spheres(ray in rays(), radius_m in 0.02_f64..1.2) {
        check(shape(Shape::Sphere { radius_m }, at(3.0, 1.0, 0.5)), ray, |o, d| {
            first(&[disc(o.coords.as_slice(), d.as_slice(), radius_m)?])
        })?;
    }

    #[test]
    fn planes(ray in rays(), pitch_rad in -1.0_f64..1.0, roll_rad in -1.0_f64..1.0) {
        let mut frame = at(3.0, 1.0, 0.5);
        frame.rotation = UnitQuaternion::from_euler_angles(roll_rad, pitch_rad, 0.3);
        check(shape(Shape::Plane, frame), ray, |o, d| {
            if o.z <= 0.0 {
                return Some(0.0);
            }
            (d.z < 0.0).then(|| -o.z / d.z).filter(|&m| m <= 100.0)
        })?;
    }

    #[test]
    fn a_height_field_is_its_triangles(
        ray in rays(),
        heights_m in prop::collection::vec(prop::collection::vec(-0.4_f64..0.4, 4), 5),
    ) {
        let mesh = Mesh::of_heights(0.5, &heights_m).unwrap();
        let triangles: Vec<_> = mesh.triangles_m().collect();
        check(shape(Shape::Mesh(mesh), at(-1.0, -1.0, 0.0)), ray, |o, d| {
            triangles.iter().filter_map(|corners| triangle(o, d, corners)).min_by(f64::total_cmp)
        })?;
    }

    #[test]
    fn a_tilted_plane_has_its_height_everywhere(
        x in -50.0_f64..50.0, y in -50.0_f64..50.0, pitch_rad in -0.5_f64..0.5,
    ) {
        let mut frame = at(2.0, 0.0, 0.3);
        frame.rotation = UnitQuaternion::from_euler_angles(0.0, pitch_rad, 0.0);
        let scene = Scene::new(&[shape(Shape::Plane, frame)]);
        let height_m = scene.height_m(Point2::new(x, y), 0.0).unwrap();
        let expected_m = 0.3 - libm::tan(pitch_rad) * (x - 2.0);
        prop_assert!((height_m - expected_m).abs() < 1e-9, "{height_m} {expected_m}");
    }
}

/// Signed volumes: the ray passes all three edges on the same side.
fn triangle(o: Point3<f64>, d: Vector3<f64>, corners: &[Point3<f64>; 3]) -> Option<f64> {
    let [a, b, c] = corners.map(|corner| corner - o);
    let sides = [
        d.dot(&a.cross(&b)),
        d.dot(&b.cross(&c)),
        d.dot(&c.cross(&a)),
    ];
    let same_side = sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0);
    let normal = (b - a).cross(&(c - a));
    let distance_m = a.dot(&normal) / d.dot(&normal);
    (same_side && distance_m >= 0.0).then_some(distance_m)
}

#[test]
fn the_nearest_of_ground_still_and_moving_things_counts() {
    let mut walker = solid([0.0, 0.0, 0.9], [0.5, 0.5, 1.8], Reflectivity::Diffuse);
    let frames = [(2.0, 0.0), (6.0, 4.0)].map(|(time_s, y)| Keyframe {
        time_s,
        offset_m: Vector2::new(5.0, y),
    });
    walker.motion = Some(Motion::new(frames.to_vec(), 1.0, 8.0).unwrap());
    let scene = Scene::new(&[
        shape(Shape::Plane, Pose::identity()),
        walker,
        solid([10.5, 0.0, 1.0], [1.0, 20.0, 2.0], Reflectivity::Diffuse),
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
    let mut pane = solid([2.005, 0.0, 0.0], [0.01, 4.0, 4.0], glass(0.8));
    let wall = solid([6.5, 0.0, 0.0], [1.0, 40.0, 4.0], Reflectivity::Diffuse);
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
    let mut tube = shape(tube, at(3.9, 1.3, 0.0));
    tube.reflectivity = glass(0.8);
    let scene = Scene::new(&[pane.clone(), tube, wall.clone()]);
    assert!((path_m(&scene, 0.639).unwrap() - wall_m).abs() < 1e-6);
    let tube_m = libm::sqrt(3.9 * 3.9 + 1.3 * 1.3) - 0.5;
    assert!((path_m(&scene, 0.641).unwrap() - tube_m).abs() < 1e-6);
    assert!((path_m(&scene, 0.801).unwrap() - pane_m).abs() < 1e-9);

    // Behind glass there may be nothing, and what stands against the pane is still seen.
    assert_eq!(path_m(&Scene::new(&[pane.clone()]), 0.5), None);
    pane.reflectivity = glass(1.0);
    let flush = solid([2.51, 0.0, 0.0], [1.0, 4.0, 4.0], Reflectivity::Diffuse);
    let scene = Scene::new(&[pane, flush]);
    assert!((path_m(&scene, 0.5).unwrap() - 2.01 / direction.x).abs() < 1e-8);
}
