use measurement::pose::{self, Pose};

use super::*;
use crate::fixtures::solid;
use crate::solid::Mesh;

fn at(x: f64, y: f64, z: f64) -> Pose {
    let mut pose = pose::planar(x, y, 0.0);
    pose.translation.z = z;
    pose
}

fn pitched(mut pose: Pose, pitch_rad: f64) -> Pose {
    pose.rotation *=
        nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::y_axis(), pitch_rad);
    pose
}

fn corners(section: Section) -> Vec<Point2<f64>> {
    let Section::Area(corners) = section else {
        panic!("{section:?}")
    };
    corners
}

#[track_caller]
fn check_area(solid: &Solid, height_m: f64, expected_m2: f64) {
    let corners = corners(solid.section(height_m));
    let next = corners.iter().cycle().skip(1);
    let doubled: f64 = corners
        .iter()
        .zip(next)
        .map(|(a, b)| a.coords.perp(&b.coords))
        .sum();
    let area_m2 = 0.5 * doubled;
    assert!(
        (area_m2 - expected_m2).abs() <= 2e-3 * expected_m2,
        "{area_m2}, expected {expected_m2}"
    );
}

#[test]
fn section_of_a_turned_box() {
    let mut centre = pose::planar(1.0, 2.0, std::f64::consts::FRAC_PI_2);
    centre.translation.z = 0.5;
    let block = solid(
        Shape::Box {
            size_m: [4.0, 2.0, 1.0],
        },
        centre,
    );
    let found = corners(block.section(0.3));
    for (corner, expected) in found
        .iter()
        .zip([[2.0, 0.0], [2.0, 4.0], [0.0, 4.0], [0.0, 0.0]])
    {
        assert!((corner - Point2::from(expected)).norm() < 1e-12, "{corner}");
    }
    assert_ne!(block.section(1.0), Section::Nothing);
    assert_eq!(block.section(1.001), Section::Nothing);
    assert_eq!(block.section(-0.001), Section::Nothing);
}

#[test]
fn section_of_a_pitched_box() {
    // On edge: its diagonals are level and upright, and halfway up half of the level one is left.
    let upright = pitched(at(3.0, 1.0, 0.0), std::f64::consts::FRAC_PI_4);
    let block = solid(
        Shape::Box {
            size_m: [1.0, 2.0, 1.0],
        },
        upright,
    );
    let half_diagonal_m = libm::sqrt(0.5);
    check_area(&block, 0.0, 2.0 * 2.0 * half_diagonal_m);
    check_area(&block, 0.5 * half_diagonal_m, 2.0 * half_diagonal_m);
    assert_eq!(block.section(0.708), Section::Nothing);
}

#[test]
fn sections_of_round_solids_are_circles() {
    let pole = solid(
        Shape::Cylinder {
            radius_m: 0.5,
            height_m: 2.0,
        },
        at(1.0, 0.0, 1.0),
    );
    let ball = solid(Shape::Sphere { radius_m: 1.0 }, at(0.0, 0.0, 1.0));
    let circle_m2 = std::f64::consts::PI * 0.25;
    check_area(&pole, 0.0, circle_m2);
    check_area(&pole, 2.0, circle_m2);
    assert_eq!(pole.section(2.01), Section::Nothing);
    check_area(&ball, 1.0, 4.0 * circle_m2);
    check_area(&ball, 1.6, 4.0 * circle_m2 * 0.64);
    assert_eq!(ball.section(2.01), Section::Nothing);
}

#[test]
fn a_plane_is_all_the_world_below_it() {
    let flat = solid(Shape::Plane, at(0.0, 0.0, 0.3));
    check_area(&flat, 0.2, 4.0 * WORLD_M * WORLD_M);
    assert_eq!(flat.section(0.4), Section::Nothing);
    // Falling to the front: at its own height the half behind its point is in the ground.
    let slope = solid(Shape::Plane, pitched(at(2.0, 0.0, 0.3), 0.1));
    let corners = corners(slope.section(0.3));
    let front_m = corners
        .iter()
        .map(|corner| corner.x)
        .fold(f64::MIN, f64::max);
    assert!((front_m - 2.0).abs() < 1e-6, "{front_m}");
    check_area(&slope, 0.3, 2.0 * WORLD_M * (WORLD_M + 2.0));
}

#[test]
fn section_of_a_mesh_is_lines() {
    let roof = Mesh::of_heights(1.0, &[vec![0.0, 1.0, 0.0], vec![0.0, 1.0, 0.0]]).unwrap();
    let roof = solid(Shape::Mesh(roof), at(5.0, 0.0, 1.0));
    let Section::Lines(lines) = roof.section(1.5) else {
        panic!("no lines")
    };
    let length_m: f64 = lines.iter().map(|[a, b]| (b - a).norm()).sum();
    assert!((length_m - 2.0).abs() < 1e-12, "{lines:?}");
    assert!(
        lines
            .iter()
            .flatten()
            .all(|p| (p.x - 5.5).abs() < 1e-12 || (p.x - 6.5).abs() < 1e-12)
    );
    assert_eq!(roof.section(2.1), Section::Nothing);
}
