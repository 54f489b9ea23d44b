#![expect(clippy::float_cmp, reason = "these values are exact")]

use proptest::prelude::*;

use super::*;
use crate::solid::Shape;
use measurement::pose;

fn solid(centre_m: [f64; 3], size_m: [f64; 3], reflectivity: Reflectivity) -> Solid {
    let mut world_from_solid = pose::planar(centre_m[0], centre_m[1], 0.0);
    world_from_solid.translation.z = centre_m[2];
    Solid {
        name: String::new(),
        shape: Shape::Box { size_m },
        world_from_solid,
        reflectivity,
        motion: None,
    }
}

const ROOM_M: [f64; 3] = [6.0, 4.0, 2.0];

/// Walls, floor and ceiling around a room of [`ROOM_M`] about the origin, turned by `yaw_rad` as a whole.
fn room(yaw_rad: f64) -> Scene {
    let turn = pose::planar(0.0, 0.0, yaw_rad);
    let solids: Vec<Solid> = (0..3)
        .flat_map(|axis| [(axis, -1.0), (axis, 1.0)])
        .map(|(axis, side)| {
            let mut centre_m = [0.0; 3];
            let mut size_m = [20.0; 3];
            centre_m[axis] = side * (0.5 * ROOM_M[axis] + 0.1);
            size_m[axis] = 0.2;
            let mut wall = solid(centre_m, size_m, Reflectivity::Diffuse);
            wall.world_from_solid = turn * wall.world_from_solid;
            wall
        })
        .collect();
    Scene::new(&solids)
}

proptest! {
    #[test]
    fn ranges_in_a_room_are_the_distances_to_its_planes(
        place in prop::array::uniform3(-0.999_f64..0.999),
        direction in prop::array::uniform3(-1.0_f64..1.0),
        yaw_rad in -3.2_f64..3.2,
    ) {
        let direction = Vector3::from(direction);
        prop_assume!(direction.norm() > 0.01);
        let direction = direction.normalize();
        let half = Vector3::from(ROOM_M) * 0.5;
        let origin = Point3::from(Vector3::from(place).component_mul(&half));
        let expected = (0..3)
            .filter(|&axis| direction[axis] != 0.0)
            .map(|axis| (half[axis].copysign(direction[axis]) - origin[axis]) / direction[axis])
            .fold(f64::INFINITY, f64::min);

        let turn = pose::planar(0.0, 0.0, yaw_rad);
        let hit = room(yaw_rad).cast(turn * origin, turn.rotation * direction, 100.0, 0.0).unwrap();
        prop_assert!((hit.distance_m - expected).abs() <= 1e-9, "{} {}", hit.distance_m, expected);
        let inward = turn.rotation.inverse() * hit.normal;
        prop_assert!(inward.dot(&direction) < 0.0 && (inward.amax() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_mirrored_range_is_the_distance_to_the_mirror_image(
        place in (-2.0_f64..2.0, -1.9_f64..1.9),
        aim_y_m in -1.9_f64..1.9,
    ) {
        // A mirror at x = 3, a wall at x = −3: the wall's image stands at x = 9.
        let mirror = Reflectivity::Specular { probability: 1.0 };
        let scene = Scene::new(&[
            solid([3.1, 0.0, 0.0], [0.2, 4.0, 2.0], mirror),
            solid([-3.1, 0.0, 0.0], [0.2, 100.0, 2.0], Reflectivity::Diffuse),
        ]);
        let origin = Point3::new(place.0, place.1, 0.0);
        let direction = (Point3::new(3.0, aim_y_m, 0.0) - origin).normalize();
        let expected = (9.0 - place.0) / direction.x;
        let path_m = scene.echo(origin, direction, 100.0, 0.0, 0.5).unwrap().path_m;
        prop_assert!((path_m - expected).abs() < 1e-8, "{path_m} {expected}");
        // Too long a path is no reading, even though the mirror itself is near.
        prop_assert_eq!(scene.echo(origin, direction, expected - 0.01, 0.0, 0.5), None);
    }
}

#[test]
fn chance_decides_whether_a_specular_surface_mirrors() {
    let mirror = Reflectivity::Specular { probability: 0.3 };
    let scene = Scene::new(&[
        solid([2.5, 0.0, 0.0], [1.0, 1.0, 1.0], mirror),
        solid([-2.5, 0.0, 0.0], [1.0, 1.0, 1.0], mirror),
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
fn nothing_within_reach_is_no_hit_and_inside_a_solid_is_a_hit_at_once() {
    let scene = Scene::new(&[solid(
        [2.5, 0.0, 0.0],
        [1.0, 1.0, 1.0],
        Reflectivity::Diffuse,
    )]);
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

mod shapes;
