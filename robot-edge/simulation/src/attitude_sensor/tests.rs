use std::sync::Arc;

use nalgebra::{Point2, Quaternion, UnitQuaternion};

use super::*;
use crate::path::{Path, PlanarPose, Waypoint};
use crate::scene::Scene;
use crate::solid::{Reflectivity, Shape, Solid};
use crate::vehicle::SimulatedVehicle;

/// Holos drives 4 m at 0.5 m/s, and 2 m to the left along an arc of 1 m; `tilt` is the ground's.
fn drive(tilt: Attitude) -> Motion {
    let ground = Solid {
        name: String::new(),
        shape: Shape::Box {
            size_m: [60.0, 60.0, 0.2],
        },
        world_from_solid: measurement::pose::Pose::from_parts(
            nalgebra::Translation3::new(0.0, 0.0, -0.1),
            tilt.rotation(),
        ),
        reflectivity: Reflectivity::Diffuse,
        motion: None,
    };
    let to = |x, y, corner_radius_m| Waypoint {
        position_m: Point2::new(x, y),
        speed_mps: 0.5,
        corner_radius_m,
    };
    let start = PlanarPose {
        position_m: Point2::origin(),
        yaw_rad: 0.0,
    };
    Motion::along(
        Arc::new(Path::new(start, 1.0, &[to(4.0, 0.0, 1.0), to(4.0, 2.0, 0.0)]).unwrap()),
        Arc::new(Scene::new(&[ground])),
        SimulatedVehicle::preset("holos")
            .unwrap()
            .carriage
            .chassis(),
    )
}

fn attitude(sample: &ImuSample) -> Attitude {
    let [x, y, z, w] = sample.orientation_xyzw.unwrap();
    Attitude::of(&UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)))
}

fn sample(motion: &Motion, time_s: f64) -> ImuSample {
    let noise = &mut AttitudeNoise::new(1, "ahrs");
    AttitudeSensor::xsens_mti().sample(motion, time_s, 0.0, noise)
}

#[track_caller]
fn check(found: [f64; 3], expected: [f64; 3]) {
    let is_near = found
        .iter()
        .zip(expected)
        .all(|(a, b)| (a - b).abs() < 1e-4);
    assert!(is_near, "{found:?} is not {expected:?}");
}

#[test]
fn on_level_ground_it_feels_gravity_and_its_turns() {
    let motion = drive(Attitude::default());
    let straight = sample(&motion, 2.0);
    check(straight.angular_velocity_radps, [0.0; 3]);
    check(straight.linear_acceleration_mps2, [0.0, 0.0, GRAVITY_MPS2]);
    // On the arc from 6 s on: 0.5 rad/s, and v²/r to the left.
    let turning = sample(&motion, 7.0);
    check(turning.angular_velocity_radps, [0.0, 0.0, 0.5]);
    check(turning.linear_acceleration_mps2, [0.0, 0.25, GRAVITY_MPS2]);
    assert!((attitude(&turning).yaw_rad - 0.5).abs() < 1e-9);
}

#[test]
fn on_a_slope_gravity_points_to_its_foot() {
    let up_rad = 10.0_f64.to_radians();
    let motion = drive(Attitude {
        pitch_rad: -up_rad,
        ..Attitude::default()
    });
    let climbing = sample(&motion, 2.0);
    assert!((attitude(&climbing).pitch_rad + up_rad).abs() < 1e-5);
    let (sine, cosine) = (libm::sin(up_rad), libm::cos(up_rad));
    check(
        climbing.linear_acceleration_mps2,
        [GRAVITY_MPS2 * sine, 0.0, GRAVITY_MPS2 * cosine],
    );
}

#[test]
fn a_speed_that_changes_at_once_is_its_change_within_a_period() {
    let motion = drive(Attitude::default());
    let [start, ..] = sample(&motion, 0.0).linear_acceleration_mps2;
    // 0.5 m/s in 10 ms is more than the accelerometer reads.
    assert!((start - 5.0 * GRAVITY_MPS2).abs() < 1e-9, "{start}");
    check(
        sample(&motion, -1.0).linear_acceleration_mps2,
        [0.0, 0.0, GRAVITY_MPS2],
    );
}

#[test]
fn noise_has_its_size_on_each_angle_and_is_independent() {
    let motion = drive(Attitude::default());
    let (sensor, noise_rad) = (AttitudeSensor::xsens_mti(), 0.1_f64.to_radians());
    let mut noise = AttitudeNoise::new(1, "ahrs");
    let n = 20_000;
    let errors: Vec<[f64; 3]> = (0..n)
        .map(|_| {
            let read = attitude(&sensor.sample(&motion, 2.0, noise_rad, &mut noise));
            [read.roll_rad, read.pitch_rad, read.yaw_rad].map(|rad| rad / noise_rad)
        })
        .collect();
    let mean_of = |f: &dyn Fn(&[f64; 3]) -> f64| errors.iter().map(f).sum::<f64>() / f64::from(n);
    for a in 0..3 {
        // Four standard errors: 4/√20000, and √2 of that for a variance.
        assert!(mean_of(&|e| e[a]).abs() < 0.029);
        assert!((mean_of(&|e| e[a] * e[a]) - 1.0).abs() < 0.04);
        for b in 0..a {
            assert!(mean_of(&|e| e[a] * e[b]).abs() < 0.029);
        }
    }
}

#[test]
fn noise_leaves_rates_and_forces_alone() {
    let motion = drive(Attitude::default());
    let sensor = AttitudeSensor::xsens_mti();
    let noisy = sensor.sample(&motion, 7.0, 0.01, &mut AttitudeNoise::new(1, "ahrs"));
    let exact = sample(&motion, 7.0);
    assert_ne!(noisy.orientation_xyzw, exact.orientation_xyzw);
    let with_exact_attitude = ImuSample {
        orientation_xyzw: exact.orientation_xyzw,
        ..noisy
    };
    assert_eq!(with_exact_attitude, exact);
}
