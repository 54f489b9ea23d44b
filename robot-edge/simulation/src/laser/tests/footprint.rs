//! Mixed pixels: at edges only, and of the two surfaces there.

use super::*;
use crate::solid::Solid;

fn block(centre_m: [f64; 3], size_m: [f64; 3]) -> Solid {
    Solid {
        name: String::new(),
        shape: Shape::Box { size_m },
        world_from_solid: Pose::translation(centre_m[0], centre_m[1], centre_m[2]),
        reflectivity: Reflectivity::Diffuse,
        motion: None,
    }
}

fn ground() -> Solid {
    Solid {
        shape: Shape::Plane,
        ..block([0.0; 3], [1.0; 3])
    }
}

/// The robot of the document: 1.08 m above the ground, tilted down by 7.5°.
fn tilted() -> Pose {
    let pitch = Vector3::new(0.0, 7.5_f64.to_radians(), 0.0);
    Pose::new(Vector3::new(0.0, 0.0, 1.08), pitch)
}

/// Sweeps with every edge mixed, beside the exact one.
fn sweeps(solids: &[Solid], world_from_laser: Pose, n: usize) -> (Vec<f32>, Vec<Vec<f32>>) {
    let laser = PlanarLaser::lms111();
    let scene = Scene::new(solids);
    let mut noise = LaserNoise::new(7, "laser");
    let mut sweep = |mixed_pixels| {
        let errors = LaserErrors {
            mixed_pixels,
            ..EXACT
        };
        laser
            .sweep(&scene, errors, &mut noise, 0.0, |_| world_from_laser)
            .ranges_m
    };
    (sweep(0.0), (0..n).map(|_| sweep(1.0)).collect())
}

/// Beams that any of the sweeps reads otherwise than the exact one.
fn mixed_beams(exact: &[f32], sweeps: &[Vec<f32>]) -> Vec<usize> {
    let differs = |beam: &usize| {
        sweeps
            .iter()
            .any(|sweep| sweep[*beam].to_bits() != exact[*beam].to_bits())
    };
    (0..exact.len()).filter(differs).collect()
}

#[test]
fn the_lms111_covers_120_degrees_in_a_third_of_its_turn() {
    let laser = PlanarLaser::lms111();
    let angle_deg = |beam: f64| {
        (f64::from(laser.angle_min_rad) + beam * f64::from(laser.angle_increment_rad)).to_degrees()
    };
    assert!((angle_deg(0.0) + 60.0).abs() < 1e-5);
    assert!((angle_deg(480.0) - 60.0).abs() < 1e-5);
    assert!((laser.sweep_duration_s() - 0.04 / 3.0).abs() < 1e-6);
    assert_eq!((laser.range_min_m, laser.range_max_m), (0.5, 20.0));
    // [LOD §4.2.1]: h = 1.08 m and φ = 82.5° give d = 8.274 m straight ahead.
    let (exact, _) = sweeps(&[ground()], tilted(), 0);
    assert!((exact[240] - 8.274).abs() < 1e-3, "{}", exact[240]);
}

#[test]
fn nothing_mixes_on_ground_in_corners_or_on_round_things() {
    // The ground is met at 7.5°, where the spot is 1 m long, and beyond 20 m nothing is.
    let (exact, mixed) = sweeps(&[ground()], tilted(), 3);
    assert!(exact.iter().all(|range_m| range_m.is_finite()));
    assert_eq!(mixed_beams(&exact, &mixed), [0_usize; 0]);
    let flat = Pose::new(
        Vector3::new(0.0, 0.0, 1.08),
        Vector3::new(0.0, 3.2_f64.to_radians(), 0.0),
    );
    let (exact, mixed) = sweeps(&[ground()], flat, 3);
    assert!(exact.iter().any(|range_m| range_m.is_infinite()));
    assert_eq!(mixed_beams(&exact, &mixed), [0_usize; 0]);
    // A room: floor, walls and the corners between them.
    let room = [
        ground(),
        block([6.0, 0.0, 1.0], [0.2, 8.0, 2.0]),
        block([2.0, 4.0, 1.0], [8.0, 0.2, 2.0]),
        block([2.0, -4.0, 1.0], [8.0, 0.2, 2.0]),
        // A corner that points at the laser, flush with the wall behind.
        block([5.7, -1.0, 1.0], [0.6, 0.6, 2.0]),
    ];
    let (exact, mixed) = sweeps(&room[..4], tilted(), 3);
    assert_eq!(mixed_beams(&exact, &mixed), [0_usize; 0]);
    // The side of the pillar that faces the middle is seen, the other one is not.
    let (exact, mixed) = sweeps(&room, tilted(), 3);
    let beams = mixed_beams(&exact, &mixed);
    let side_deg = libm::atan2(-1.3, 5.4).to_degrees();
    assert!(!beams.is_empty());
    for beam in beams {
        let angle_deg = -60.0 + 0.25 * beam as f64;
        assert!((angle_deg - side_deg).abs() < 0.7, "{angle_deg} {side_deg}");
    }
    // A ball under a roof of its own size has no edge where it is looked at.
    let ball = Solid {
        shape: Shape::Sphere { radius_m: 3.0 },
        ..block([6.0, 0.0, 0.5], [1.0; 3])
    };
    let (exact, mixed) = sweeps(&[ball], tilted(), 3);
    let beams = mixed_beams(&exact, &mixed);
    for beam in beams {
        let on_limb = exact[beam.saturating_sub(3)..exact.len().min(beam + 4)]
            .iter()
            .any(|range_m| range_m.is_infinite());
        assert!(on_limb, "beam {beam}");
    }
}

#[test]
fn an_edge_gives_ranges_between_its_sides_and_a_deep_one_either() {
    let level = Pose::identity();
    let wall_behind = |behind_m: f64| {
        [
            block([4.5, 5.0, 0.0], [1.0, 10.0, 4.0]),
            block([4.5 + behind_m, 0.0, 0.0], [1.0, 60.0, 4.0]),
        ]
    };
    // The edge is in the middle of the view: half of the spot of beam 240 ± 1 lies on either side.
    let (exact, mixed) = sweeps(&wall_behind(1.0), level, 200);
    let beams = mixed_beams(&exact, &mixed);
    // Half of 15 mrad is 1.7 steps to either side.
    assert_eq!(beams, [239, 240, 241]);
    let of_beam = |sweeps: &[Vec<f32>]| -> Vec<f64> {
        sweeps.iter().map(|sweep| f64::from(sweep[239])).collect()
    };
    let ranges_m = of_beam(&mixed);
    assert!(ranges_m.iter().all(|m| (3.99..5.01).contains(m)));
    let mean_m = ranges_m.iter().sum::<f64>() / 200.0;
    // Uniform in between: four standard errors of 0.29 / √200.
    assert!((mean_m - 4.5).abs() < 0.085, "{mean_m}");

    let (exact, mixed) = sweeps(&wall_behind(2.0), level, 200);
    let either = of_beam(&mixed);
    let near = either.iter().filter(|m| (**m - 4.0).abs() < 0.01).count();
    let far = either.iter().filter(|m| (**m - 6.0).abs() < 0.01).count();
    assert_eq!(near + far, 200);
    // Beam 239 points away from the near wall by one step of 4.4 mrad, of 7.5: 3 of 9 rays meet it.
    assert!((40..95).contains(&near), "{near}");
    assert!((exact[239] - 6.0).abs() < 0.01);

    // With nothing behind, the spot's share gives the near wall and the rest nothing.
    let (exact, mixed) = sweeps(&wall_behind(2.0)[..1], level, 200);
    assert_eq!(exact[239], f32::INFINITY);
    let near = mixed.iter().filter(|sweep| sweep[239].is_finite()).count();
    assert!((40..95).contains(&near), "{near}");
}

#[test]
fn mixed_pixels_have_the_configured_share_and_leave_all_else_as_it_was() {
    let scene = Scene::new(&[
        block([4.5, 5.0, 0.0], [1.0, 10.0, 4.0]),
        block([5.5, 0.0, 0.0], [1.0, 60.0, 4.0]),
    ]);
    let run = |mixed_pixels, divergence_rad| {
        let mut laser = PlanarLaser::lms111();
        laser.beam_divergence_rad = divergence_rad;
        let errors = LaserErrors {
            range_noise_m: 0.01,
            dropout: 0.1,
            mixed_pixels,
        };
        let mut noise = LaserNoise::new(5, "laser");
        let mut sweep = || {
            laser
                .sweep(&scene, errors, &mut noise, 0.0, |_| Pose::identity())
                .ranges_m
        };
        (0..300).map(|_| sweep()).collect::<Vec<_>>()
    };
    let (without, with, thin) = (run(0.0, 0.015), run(0.3, 0.015), run(1.0, 0.0));
    let mut mixed = [0_i32; 481];
    for (without, with) in without.iter().zip(&with) {
        for (beam, (without, with)) in without.iter().zip(with).enumerate() {
            assert_eq!(without.is_nan(), with.is_nan());
            mixed[beam] += i32::from(!without.is_nan() && without != with);
        }
    }
    let edges: i32 = mixed[239..242].iter().sum();
    assert_eq!(edges, mixed.iter().sum::<i32>());
    // 3 beams · 300 sweeps · 0.9 · 0.3 = 243, four standard deviations of 13.
    assert!((190..296).contains(&edges), "{edges}");
    // A line has no edges to straddle.
    assert_eq!(format!("{without:?}"), format!("{thin:?}"));
}
