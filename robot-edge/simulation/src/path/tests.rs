#![expect(clippy::float_cmp, reason = "these values are exact")]

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use super::*;

fn to(x: f64, y: f64, corner_radius_m: f64) -> Waypoint {
    Waypoint {
        position_m: Point2::new(x, y),
        speed_mps: 0.5,
        corner_radius_m,
    }
}

fn from_origin(waypoints: &[Waypoint]) -> Result<Path, ItemError> {
    Path::new(PlanarPose::default(), 1.0, waypoints)
}

#[track_caller]
fn check(path: &Path, time_s: f64, expected: [f64; 3]) {
    let pose = path.planar_pose(time_s);
    let [x, y, yaw] = expected;
    assert!(
        (pose.position_m - Point2::new(x, y)).norm() < 1e-12 && (pose.yaw_rad - yaw).abs() < 1e-12,
        "{pose:?}, expected {expected:?}"
    );
}

#[test]
fn turns_on_the_spot_and_drives_straight() {
    let path = from_origin(&[to(0.0, 1.0, 0.0), to(-1.0, 1.0, 0.0)]).unwrap();
    check(&path, -1.0, [0.0, 0.0, 0.0]);
    check(&path, 0.5, [0.0, 0.0, 0.5]);
    check(&path, FRAC_PI_2 + 1.0, [0.0, 0.5, FRAC_PI_2]);
    check(
        &path,
        FRAC_PI_2 + 2.0 + FRAC_PI_4,
        [0.0, 1.0, 3.0 * FRAC_PI_4],
    );
    assert!((path.duration_s() - (PI + 4.0)).abs() < 1e-12);
    check(&path, 1e9, [-1.0, 1.0, PI]);
}

#[test]
fn rounds_a_corner_by_an_arc_tangent_to_both_legs() {
    // To the right at (2, 0), radius 1: the arc begins at (1, 0) about the centre (1, −1).
    let path = from_origin(&[to(2.0, 0.0, 1.0), to(2.0, -3.0, 0.0)]).unwrap();
    let half_turn_s = FRAC_PI_4 / 0.5;
    let diagonal = libm::sqrt(0.5);
    check(&path, 2.0, [1.0, 0.0, 0.0]);
    check(
        &path,
        2.0 + half_turn_s,
        [1.0 + diagonal, -1.0 + diagonal, -FRAC_PI_4],
    );
    check(&path, 2.0 + 2.0 * half_turn_s, [2.0, -1.0, -FRAC_PI_2]);
    assert!((path.duration_s() - (2.0 + 2.0 * half_turn_s + 4.0)).abs() < 1e-12);
}

#[test]
fn poses_are_continuous_over_all_seams() {
    let waypoints = [
        to(2.0, 0.3, 0.6),
        to(3.0, 3.0, 0.0),
        to(-1.0, 2.5, 0.7),
        to(-1.2, -2.0, 0.0),
    ];
    let path = from_origin(&waypoints).unwrap();
    let step_s = 1e-3;
    let steps = (path.duration_s() / step_s) as usize;
    for step in 0..=steps {
        let time_s = step as f64 * step_s;
        let (a, b) = (path.planar_pose(time_s), path.planar_pose(time_s + step_s));
        let moved_m = (b.position_m - a.position_m).norm();
        let turned_rad = libm::remainder(b.yaw_rad - a.yaw_rad, std::f64::consts::TAU);
        assert!(moved_m <= 0.5 * step_s + 1e-9, "{time_s} s: {moved_m} m");
        assert!(
            turned_rad.abs() <= 1.0 * step_s + 1e-9,
            "{time_s} s: {turned_rad} rad"
        );
    }
}

#[test]
fn corners_that_do_not_fit_are_refused() {
    let message = |waypoints: &[Waypoint]| from_origin(waypoints).unwrap_err().message;
    assert_eq!(message(&[]), "a path needs at least one waypoint");
    let twice = from_origin(&[to(1.0, 0.0, 0.0), to(1.0, 0.0, 0.0)]).unwrap_err();
    assert_eq!(twice.item, Some(1));
    let before = message(&[to(1.0, 0.0, 1.5), to(1.0, 5.0, 0.0)]);
    assert!(
        before.starts_with(
            "waypoint 0: an arc of `corner_radius_m` = 1.5 needs 1.500 m of the leg before"
        ),
        "{before}"
    );
    let after = message(&[to(5.0, 0.0, 1.5), to(5.0, 1.0, 0.0)]);
    assert!(after.contains("leg after it, which has 1.000 m"), "{after}");
    // Each arc alone fits the leg of 2 m, both together do not.
    let both = message(&[to(5.0, 0.0, 1.2), to(5.0, 2.0, 1.2), to(9.0, 2.0, 0.0)]);
    assert!(
        both.starts_with("waypoint 1") && both.contains("has 0.800 m"),
        "{both}"
    );
    let tight = message(&[to(2.0, 0.0, 0.4), to(2.0, 2.0, 0.0)]);
    assert!(
        tight.contains("1.250 rad/s, more than the path's turn rate of 1.000"),
        "{tight}"
    );
}

#[test]
fn its_velocity_is_that_of_its_legs() {
    let path = from_origin(&[to(2.0, 0.0, 1.0), to(2.0, -2.0, 0.0)]).unwrap();
    // 1 m, a quarter of a circle of 1 m to the right, 1 m.
    for (time_s, expected) in [
        (1.0, [0.5, 0.0, 0.0]),
        (2.1, [0.5, 0.0, -0.5]),
        (2.0 + PI + 0.1, [0.5, 0.0, 0.0]),
        (-0.1, [0.0; 3]),
        (path.duration_s(), [0.0; 3]),
    ] {
        let velocity = path.velocity(time_s);
        let found = [
            velocity.forward_mps,
            velocity.left_mps,
            velocity.turn_rate_radps,
        ];
        assert_eq!(found, expected, "{time_s}");
    }
}
