use nalgebra::Vector3;
use proptest::prelude::*;

use super::*;
use crate::fixtures::{self, holos};

fn at(x_m: f64, y_m: f64, yaw_rad: f64) -> PlanarPose {
    PlanarPose {
        position_m: Point2::new(x_m, y_m),
        yaw_rad,
    }
}

fn settled(at: PlanarPose, ground: impl Fn(Point3<f64>) -> Option<f64>) -> Posture {
    holos().settle(at, Posture::default(), &ground)
}

#[track_caller]
fn check(posture: Posture, expected: [f64; 3]) {
    let (pitch_deg, roll_deg) = (
        posture.pitch_rad.to_degrees(),
        posture.roll_rad.to_degrees(),
    );
    fixtures::check([posture.z_m, pitch_deg, roll_deg], expected, 2e-3);
}

/// Height where the condition holds, 0 elsewhere.
fn raised(height_m: f64, is_raised: bool) -> f64 {
    if is_raised { height_m } else { 0.0 }
}

#[test]
fn level_ground_is_level() {
    assert_eq!(
        settled(at(1.0, 2.0, 0.7), |_| Some(0.0)),
        Posture::default()
    );
    check(settled(at(1.0, 2.0, 0.7), |_| Some(0.1)), [0.1, 0.0, 0.0]);
}

#[test]
fn wheels_on_boxes_give_the_attitudes_of_the_document() {
    // asin(0.043 / 0.55), asin(0.024 / 0.55), asin(0.054 / 0.60); base_link in the middle.
    let front = settled(at(0.0, 0.0, 0.0), |p| Some(raised(0.043, p.x > 0.0)));
    check(front, [0.0215, -4.484, 0.0]);
    let rear = settled(at(0.0, 0.0, 0.0), |p| Some(raised(0.024, p.x < 0.0)));
    check(rear, [0.012, 2.501, 0.0]);
    let right = settled(at(0.0, 0.0, 0.0), |p| Some(raised(0.054, p.y < 0.0)));
    check(right, [0.027, 0.0, -5.164]);
    let turned = settled(at(3.0, 1.0, std::f64::consts::FRAC_PI_2), |p| {
        Some(raised(0.054, p.x > 3.0))
    });
    check(turned, [0.027, 0.0, -5.164]);
}

#[test]
fn one_wheel_on_a_box_lifts_the_middle_by_a_quarter() {
    let posture = settled(at(0.0, 0.0, 0.0), |p| {
        Some(raised(0.04, p.x > 0.0 && p.y > 0.0))
    });
    // Half of its height at the front axle, half on the left side.
    check(
        posture,
        [
            0.01,
            -libm::asin(0.02 / 0.55).to_degrees(),
            libm::asin(0.02 / 0.60).to_degrees(),
        ],
    );
}

#[test]
fn a_wheel_rests_on_the_edge_of_a_kerb_as_a_disc_does() {
    let (radius_m, kerb_m) = (0.125, 0.043);
    for tenth_mm in -1300..=100 {
        let axle_m = f64::from(tenth_mm) * 1e-4;
        let level = Posture::default().world_from_base(at(axle_m, 0.0, 0.0));
        let rim = Rim::new(level, Point2::origin(), radius_m);
        let lift_m = rim.lift_m(&|p| Some(raised(kerb_m, p.x >= 0.0))).unwrap();
        let on_edge_m = if axle_m >= 0.0 {
            kerb_m
        } else {
            let over_edge_m2 = radius_m * radius_m - axle_m * axle_m;
            kerb_m + libm::sqrt(over_edge_m2.max(0.0)) - radius_m
        };
        let expected_m = on_edge_m.max(0.0);
        assert!(
            (lift_m - expected_m).abs() < 2e-5,
            "{axle_m}: {lift_m}, {expected_m}"
        );
    }
}

#[test]
fn a_kerb_is_climbed_without_jumps_and_never_down() {
    let kerb = |p: Point3<f64>| Some(raised(0.043, p.x >= 0.0));
    let step_m = 1e-4;
    let mut last = settled(at(-0.5, 0.0, 0.0), kerb);
    for step in 1..=10_000 {
        let posture = holos().settle(at(-0.5 + f64::from(step) * step_m, 0.0, 0.0), last, &kerb);
        let (rise_m, turn_rad) = (posture.z_m - last.z_m, posture.pitch_rad - last.pitch_rad);
        // Half of the wheels rise by at most 1.15 of the way, and the tilting body moves them a little too.
        assert!((-1e-5..0.8 * step_m).contains(&rise_m), "{step}: {rise_m}");
        assert!(turn_rad.abs() < 3.0 * step_m, "{step}: {turn_rad}");
        last = posture;
    }
    check(last, [0.043, 0.0, 0.0]);
}

#[test]
fn walls_are_not_climbed_and_cliffs_end() {
    // Inside a wall there is no ground to be found.
    let wall = |p: Point3<f64>| (p.x < 0.3).then_some(0.0);
    assert_eq!(settled(at(0.0, 0.0, 0.0), wall), Posture::default());
    assert_eq!(settled(at(2.0, 0.0, 0.0), wall), Posture::default());
    let cliff = settled(at(0.0, 0.0, 0.0), |p| Some(raised(-5.0, p.x > 0.0)));
    assert!((cliff.pitch_rad - MAX_TILT_RAD).abs() < 1e-12, "{cliff:?}");
    assert!(
        cliff.z_m.is_finite() && cliff.roll_rad.abs() < 1e-6,
        "{cliff:?}"
    );
}

proptest! {
    #[test]
    fn on_a_plane_the_vehicle_lies_in_it(
        slope_x in -0.5..0.5_f64, slope_y in -0.5..0.5_f64, x_m in -3.0..3.0_f64, yaw_rad in -3.0..3.0_f64
    ) {
        let height = |p: Point2<f64>| 0.2 + slope_x * p.x + slope_y * p.y;
        let at = at(x_m, 1.0, yaw_rad);
        let posture = settled(at, |p| Some(height(p.xy())));
        let pose = posture.world_from_base(at);
        let up = pose.rotation * Vector3::z();
        let expected = Vector3::new(-slope_x, -slope_y, 1.0).normalize();
        prop_assert!((up - expected).norm() < 1e-6, "{up} {expected}");
        prop_assert!((posture.z_m - height(at.position_m)).abs() < 3e-5, "{posture:?}");
        prop_assert!((measurement::pose::yaw_rad(&pose) - yaw_rad).abs() < 1e-12);
    }
}
