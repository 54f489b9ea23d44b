#![expect(clippy::float_cmp, reason = "these values are exact")]

use super::*;
use crate::solid::{Reflectivity, Shape, Solid};
use measurement::pose;

const EXACT: LaserErrors = LaserErrors {
    range_noise_m: 0.0,
    dropout: 0.0,
    mixed_pixels: 0.0,
};

fn laser() -> PlanarLaser {
    PlanarLaser::urg_04lx_ug01()
}

/// A wall whose face is the line x = `x_m`.
fn wall_at(x_m: f64) -> Scene {
    Scene::new(&[Solid {
        name: String::new(),
        shape: Shape::Box {
            size_m: [1.0, 1000.0, 1.0],
        },
        world_from_solid: pose::planar(x_m + 0.5, 0.0, 0.0),
        reflectivity: Reflectivity::Diffuse,
        motion: None,
    }])
}

#[test]
fn the_urg_covers_240_degrees_in_two_thirds_of_its_turn() {
    let laser = laser();
    let last = f64::from(laser.angle_min_rad) + 682.0 * f64::from(laser.angle_increment_rad);
    assert!((last.to_degrees() - 119.88).abs() < 0.01, "{last}");
    assert!((f64::from(laser.angle_min_rad) + last).abs() < 1e-6);
    assert!((laser.sweep_duration_s() - 0.0666).abs() < 1e-4);
}

#[test]
fn each_beam_starts_from_the_pose_of_its_own_time() {
    // Turning at 2 rad/s while driving at 1 m/s towards a wall at x = 3.
    let pose_at = |t: f64| pose::planar(t, 0.0, 2.0 * t);
    let laser = laser();
    let mut noise = LaserNoise::new(0, "laser");
    let scan = laser.sweep(&wall_at(3.0), EXACT, &mut noise, 0.0, pose_at);
    let mut hits = 0;
    for (beam, &range_m) in scan.ranges_m.iter().enumerate() {
        let time_s = beam as f64 * f64::from(scan.time_increment_s);
        let angle_rad = f64::from(scan.angle_min_rad)
            + beam as f64 * f64::from(scan.angle_increment_rad)
            + 2.0 * time_s;
        let expected_m = (3.0 - time_s) / libm::cos(angle_rad);
        if (0.0..5.59).contains(&expected_m) {
            assert!(
                (f64::from(range_m) - expected_m).abs() < 1e-6,
                "beam {beam}"
            );
            hits += 1;
        }
    }
    assert!(hits > 300, "{hits}");
    // Had all beams started from the first pose, the last would be off by 13 cm and more.
    let frozen = laser.sweep(&wall_at(3.0), EXACT, &mut noise, 0.0, |_| pose_at(0.0));
    let beam = 341 + 100;
    assert!((frozen.ranges_m[beam] - scan.ranges_m[beam]).abs() > 0.05);
}

#[test]
fn a_mount_places_and_tilts_the_beams() {
    let mount = Pose::new(Vector3::new(0.2, 0.0, 0.3), Vector3::new(0.0, 0.5, 0.0));
    let mut noise = LaserNoise::new(0, "laser");
    let scan = laser().sweep(&wall_at(1.2), EXACT, &mut noise, 0.0, |_| mount);
    // The wall reaches down to −0.5: 1 m ahead the tilted beam is at 0.3 − tan(0.5) = −0.246.
    assert!((f64::from(scan.ranges_m[341]) - 1.0 / libm::cos(0.5)).abs() < 1e-6);
}

#[test]
fn readings_outside_the_range_follow_rep_117() {
    let mut noise = LaserNoise::new(0, "laser");
    let mut reading = |x_m: f64| {
        let scan = laser().sweep(&wall_at(x_m), EXACT, &mut noise, 0.0, |_| Pose::identity());
        scan.ranges_m[341]
    };
    assert_eq!(reading(5.7), f32::INFINITY);
    assert!((reading(5.59) - 5.59).abs() < 1e-6);
    assert_eq!(reading(0.01), f32::NEG_INFINITY);
    assert_eq!(reading(-0.5), f32::NEG_INFINITY);
}

#[test]
fn noise_and_dropouts_have_the_configured_size() {
    let errors = LaserErrors {
        range_noise_m: 0.01,
        dropout: 0.005,
        mixed_pixels: 0.0,
    };
    let scene = wall_at(2.0);
    let mut noise = LaserNoise::new(3, "laser");
    let mut exact = LaserNoise::new(3, "laser");
    let truth = laser().sweep(&scene, EXACT, &mut exact, 0.0, |_| Pose::identity());
    let (mut n, mut sum, mut squares) = (0.0_f64, 0.0_f64, 0.0_f64);
    let (mut dropped, mut beams) = (0.0_f64, 0.0_f64);
    for _ in 0..400 {
        let scan = laser().sweep(&scene, errors, &mut noise, 0.0, |_| Pose::identity());
        for (&measured, &true_m) in scan.ranges_m.iter().zip(&truth.ranges_m) {
            beams += 1.0;
            if measured.is_nan() {
                dropped += 1.0;
            } else if true_m < 5.5 {
                let error_m = f64::from(measured) - f64::from(true_m);
                n += 1.0;
                sum += error_m;
                squares += error_m * error_m;
            }
        }
    }
    // 10⁵ readings: four standard errors of mean, sigma and rate.
    assert!(n > 1e5, "{n}");
    let (mean, sigma) = (sum / n, libm::sqrt(squares / n));
    assert!(mean.abs() < 4.0 * 0.01 / libm::sqrt(n), "{mean}");
    assert!(
        (sigma - 0.01).abs() < 4.0 * 0.01 / libm::sqrt(2.0 * n),
        "{sigma}"
    );
    let rate = dropped / beams;
    assert!(
        (rate - 0.005).abs() < 4.0 * libm::sqrt(0.005 / beams),
        "{rate}"
    );
}

#[test]
fn switching_dropouts_off_leaves_the_range_noise_as_it_was() {
    let sweep = |dropout| {
        let errors = LaserErrors {
            range_noise_m: 0.01,
            dropout,
            mixed_pixels: 0.0,
        };
        let mut noise = LaserNoise::new(5, "laser");
        laser().sweep(&wall_at(2.0), errors, &mut noise, 0.0, |_| Pose::identity())
    };
    let (some, none) = (sweep(0.3), sweep(0.0));
    let mut dropped = 0;
    for (some, none) in some.ranges_m.iter().zip(&none.ranges_m) {
        if some.is_nan() {
            dropped += 1;
        } else {
            assert_eq!(some.to_bits(), none.to_bits());
        }
    }
    assert!((150..260).contains(&dropped), "{dropped}");
}

mod footprint;
