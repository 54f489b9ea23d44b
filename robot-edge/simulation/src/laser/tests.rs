#![expect(clippy::float_cmp, reason = "these values are exact")]

use measurement::pose;
use nalgebra::Vector2;

use super::*;
use crate::fixtures::{a_box, solid};
use crate::solid::{Shape, Solid};
use crate::vegetation::{Patch, Rigidity, Stem, Vegetation, Wind};

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
    Scene::new(&[a_box([x_m + 0.5, 0.0, 0.0], [1.0, 1000.0, 1.0])])
}

#[test]
fn each_laser_covers_its_angles_in_its_time() {
    for (laser, angles_deg, sweep_s) in [
        (
            PlanarLaser::urg_04lx_ug01(),
            [-119.8828, 119.8828],
            0.066_602,
        ),
        (PlanarLaser::lms111(), [-60.0, 60.0], 0.04 / 3.0),
        // A turn in 0.1 s, of which the last column is left out.
        (PlanarLaser::vlp_16(), [179.9, -179.9], 0.1 - 0.1 / 1800.0),
        (
            PlanarLaser::os1_64(),
            [179.82422, -179.82422],
            0.1 - 0.1 / 1024.0,
        ),
        (
            PlanarLaser::os1_64().turning(2048),
            [179.91211, -179.91211],
            0.1 - 0.1 / 2048.0,
        ),
    ] {
        let (beams, first_rad) = (laser.beams, f64::from(laser.angle_min_rad));
        let last_rad = first_rad + f64::from(beams - 1) * f64::from(laser.angle_increment_rad);
        for (rad, deg) in [first_rad, last_rad].iter().zip(angles_deg) {
            assert!((rad.to_degrees() - deg).abs() < 1e-4, "{beams}: {rad}");
        }
        assert!((laser.sweep_duration_s() - sweep_s).abs() < 1e-6);
    }
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
fn readings_are_multiples_of_the_range_step() {
    let mut laser = laser();
    let read =
        |laser: &PlanarLaser| [1.031, 5.58, 5.595, 0.005].map(|range_m| laser.reading(range_m));
    assert_eq!(read(&laser), [1.031, 5.58, 5.595, f32::NEG_INFINITY]);
    laser.range_step_m = 0.06;
    assert_eq!(read(&laser), [1.02, 5.58, 5.58, f32::NEG_INFINITY]);
    laser.range_step_m = 0.1;
    assert_eq!(
        read(&laser),
        [1.0, f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY]
    );
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
fn range_noise_does_not_depend_on_dropouts() {
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

fn scene(solids: &[Solid], canes: &[(f64, f64)], radius_m: f64) -> Scene {
    let stems: Vec<Stem> = canes
        .iter()
        .map(|&(x, y)| Stem {
            foot_m: Point3::new(x, y, -1.0),
            top_m: Point3::new(x, y, 1.0),
            radius_m,
            reach_m: [0.0, 0.0],
            phases: [[0.0, 1.0]; 3],
        })
        .collect();
    let patch = Patch {
        name: String::new(),
        rigidity: Rigidity::Flexible,
        stems: 0..stems.len(),
    };
    Scene::new(solids).with_growth(Growth {
        vegetation: Vegetation::new(stems, vec![patch], Wind::default()),
        receiver: Receiver::default(),
    })
}

fn range_along(scene: &Scene, axis: Vector3<f64>, divergence_rad: f64) -> Option<f64> {
    let footprint = BeamFootprint {
        scene,
        origin: Point3::origin(),
        axis: axis.normalize(),
        divergence_rad,
        max_m: 50.0,
        time_s: 0.0,
        surface_chance: 0.5,
    };
    footprint.path_m(0.0, 0.5)
}

/// Of a beam of an LMS111 along x.
fn range_m(scene: &Scene) -> Option<f64> {
    range_along(scene, Vector3::x(), 0.015)
}

#[test]
fn one_thin_cane_in_a_wide_spot_is_missed_and_several_are_seen() {
    // At 20 m the spot is 30 cm wide; a cane of 5 mm fills 2.1 % of it.
    assert_eq!(range_m(&scene(&[], &[(20.0, 0.0)], 0.0025)), None);
    let several = [(20.0, 0.0), (20.1, 0.05), (20.2, -0.05)];
    let range = range_m(&scene(&[], &several, 0.0025)).unwrap();
    assert!((range - 20.1).abs() < 0.01, "{range}");
    // So does one alone at 2 m, where the spot is 3 cm, and one of 5 cm at 20 m.
    assert!((range_m(&scene(&[], &[(2.0, 0.0)], 0.0025)).unwrap() - 2.0).abs() < 1e-9);
    assert!((range_m(&scene(&[], &[(20.0, 0.0)], 0.025)).unwrap() - 20.0).abs() < 1e-9);
    // Three that are farther apart than a pulse is long are three echoes too weak.
    let far_apart = [(19.0, 0.0), (20.0, 0.05), (21.0, -0.05)];
    assert_eq!(range_m(&scene(&[], &far_apart, 0.0025)), None);
}

#[test]
fn what_is_behind_shows_through_gaps() {
    let wall = a_box([15.5, 0.0, 0.0], [1.0, 40.0, 4.0]);
    let behind_one = scene(std::slice::from_ref(&wall), &[(10.0, 0.0)], 0.002);
    // 4 mm of 15 cm: 3.4 %.
    assert!((range_m(&behind_one).unwrap() - 15.0).abs() < 1e-9);
    // 12 mm are noticed, and hide the wall though 90 % of the light falls on it.
    let behind_a_thick_one = scene(std::slice::from_ref(&wall), &[(10.0, 0.0)], 0.006);
    assert!((range_m(&behind_a_thick_one).unwrap() - 10.0).abs() < 1e-9);
    // Within a pulse of the wall both make one echo, which lies where most of the light does.
    let before_it = scene(&[wall], &[(14.5, 0.0)], 0.006);
    let range = range_m(&before_it).unwrap();
    let share = 0.012 * 0.2175 / (std::f64::consts::PI * 0.10875 * 0.10875);
    assert!((range - (15.0 - 0.5 * share)).abs() < 1e-3, "{range}");
}

#[test]
fn only_edges_split_the_beam() {
    let far = [(40.0, 20.0)];
    // Half of the spot on a wall at 4 m, half at 6 m: the near one is strong enough.
    let walls = [
        a_box([4.5, 5.0, 0.0], [1.0, 10.0, 4.0]),
        a_box([6.5, 0.0, 0.0], [1.0, 60.0, 4.0]),
    ];
    assert!((range_m(&scene(&walls, &far, 0.01)).unwrap() - 4.0).abs() < 0.01);
    // Less than a pulse apart they mix by their shares: 3 of 8 rays around and the axis are off the near.
    let walls = [
        a_box([4.5, 5.001, 0.0], [1.0, 10.0, 4.0]),
        a_box([5.0, 0.0, 0.0], [1.0, 60.0, 4.0]),
    ];
    let range = range_m(&scene(&walls, &far, 0.01)).unwrap();
    assert!((4.1..4.4).contains(&range), "{range}");
    // Ground at a flat angle: the spot is drawn out over more than a metre, its range is the axis'.
    let ground = a_box([0.0, 0.0, -1.58], [100.0, 100.0, 1.0]);
    let flat = Vector3::new(libm::cos(0.1), 0.0, -libm::sin(0.1));
    let range = range_along(&scene(&[ground], &far, 0.01), flat, 0.015).unwrap();
    assert!((range - 1.08 / libm::sin(0.1)).abs() < 1e-9);
}

#[test]
fn nothing_returns_through_the_surface_of_water() {
    let bed = a_box([0.0, 0.0, -5.0], [100.0, 100.0, 2.0]);
    let down = Vector3::new(1.0, 0.0, -1.0);
    for plants in [true, false] {
        let dry = if plants {
            scene(std::slice::from_ref(&bed), &[(30.0, 0.0)], 0.01)
        } else {
            Scene::new(std::slice::from_ref(&bed))
        };
        // A laser 1 m above the water, the bed 4 m below the laser.
        let range = range_along(&dry, down, 0.0).unwrap();
        assert!((range - 4.0 * std::f64::consts::SQRT_2).abs() < 1e-6);
        let lake = dry.with_water(-1.0);
        assert_eq!(range_along(&lake, down, 0.0), None);
        assert_eq!(range_along(&lake, down, 0.015), None);
        // A sonar 1 m below the surface sees the bed and nothing above.
        let sonar = dry_again(&bed, plants).with_water(1.0);
        let range = range_along(&sonar, down, 0.05).unwrap();
        assert!((range - 4.0 * std::f64::consts::SQRT_2).abs() < 1e-6);
        assert_eq!(range_along(&sonar, Vector3::new(1.0, 0.0, 1.0), 0.05), None);
        assert_eq!(range_along(&sonar, Vector3::z(), 0.05), None);
    }
}

fn dry_again(bed: &Solid, plants: bool) -> Scene {
    // And a bridge above the water.
    let solids = [bed.clone(), a_box([0.0, 0.0, 5.0], [100.0, 100.0, 1.0])];
    if plants {
        scene(&solids, &[(30.0, 0.0)], 0.01)
    } else {
        Scene::new(&solids)
    }
}

/// Tall grass from a distance on, 3 m deep: 300 blades of 6 mm a square metre, which stop half of the light
/// in 0.38 m.
fn meadow(from_m: f64) -> Scene {
    let mut noise = crate::noise::NoiseStream::new(4, "test");
    let blades: Vec<(f64, f64)> = (0..3600)
        .map(|_| (from_m + 3.0 * noise.uniform(), 4.0 * noise.uniform() - 2.0))
        .collect();
    scene(&[], &blades, 0.003)
}

#[test]
fn ranges_scatter_more_in_near_grass_than_in_far_grass() {
    let depths = |from_m: f64| -> Vec<f64> {
        let scene = meadow(from_m);
        (-20..=20)
            .filter_map(|n| {
                let heading = Vector2::new(1.0, 0.05 * f64::from(n) / from_m);
                let axis = Vector3::new(heading.x, heading.y, 0.0);
                Some(range_along(&scene, axis, 0.015)? - from_m)
            })
            .collect()
    };
    let spread = |depths: &[f64]| {
        let n = depths.len() as f64;
        let mean = depths.iter().sum::<f64>() / n;
        let variance = depths.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() / n;
        (mean, libm::sqrt(variance))
    };
    let (near, far) = (depths(2.0), depths(15.0));
    assert_eq!((near.len(), far.len()), (41, 41));
    let ((near_mean, near_spread), (far_mean, far_spread)) = (spread(&near), spread(&far));
    assert!(
        near_spread > 0.12 && far_spread < 0.1,
        "{near_spread} {far_spread}"
    );
    assert!((0.2..0.6).contains(&near_mean) && (0.2..0.5).contains(&far_mean));
}

/// Everything below z = 0.
fn ground() -> Solid {
    solid(Shape::Plane, Pose::identity())
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
        a_box([6.0, 0.0, 1.0], [0.2, 8.0, 2.0]),
        a_box([2.0, 4.0, 1.0], [8.0, 0.2, 2.0]),
        a_box([2.0, -4.0, 1.0], [8.0, 0.2, 2.0]),
        // A corner that points at the laser, flush with the wall behind.
        a_box([5.7, -1.0, 1.0], [0.6, 0.6, 2.0]),
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
    let ball = solid(
        Shape::Sphere { radius_m: 3.0 },
        Pose::translation(6.0, 0.0, 0.5),
    );
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
            a_box([4.5, 5.0, 0.0], [1.0, 10.0, 4.0]),
            a_box([4.5 + behind_m, 0.0, 0.0], [1.0, 60.0, 4.0]),
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
fn mixed_pixels_have_the_configured_share() {
    let scene = Scene::new(&[
        a_box([4.5, 5.0, 0.0], [1.0, 10.0, 4.0]),
        a_box([5.5, 0.0, 0.0], [1.0, 60.0, 4.0]),
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

#[test]
fn each_column_of_a_lidar_has_its_pose_and_each_ring_its_angle() {
    // 1 m above level ground, turning at 1 rad/s while driving at 1 m/s; rings 30° and 15° down, and level.
    let pose_at = |t: f64| {
        let mut pose = pose::planar(t, 0.0, t);
        pose.translation.z = 1.0;
        pose
    };
    let rings_rad = [-30.0_f64, -15.0, 0.0].map(f64::to_radians);
    let scene = Scene::new(&[solid(Shape::Plane, Pose::identity())]);
    let lidar = PlanarLaser::os1_64();
    let mut noise = LaserNoise::new(0, "lidar");
    let cloud = lidar.revolution(&rings_rad, &scene, EXACT, &mut noise, 0.0, pose_at);
    assert_eq!((cloud.points.len(), cloud.without_return), (2 * 1024, 1024));
    for (place, point) in cloud.points.iter().enumerate() {
        let (column, ring) = (place / 2, place % 2);
        assert_eq!(point.ring, Some(ring as u16));
        assert!((f64::from(point.after_s) - column as f64 * 0.1 / 1024.0).abs() < 1e-8);
        let position = Point3::from(point.position_m.map(f64::from));
        // Clockwise from astern.
        let azimuth_rad =
            std::f64::consts::PI - (column as f64 + 0.5) * std::f64::consts::TAU / 1024.0;
        let level_m = libm::hypot(position.x, position.y);
        let away_m = 1.0 / libm::tan(-rings_rad[ring]);
        assert!((level_m - away_m).abs() < 1e-5, "{place}: {level_m}");
        assert!(
            (libm::atan2(position.y, position.x) - azimuth_rad).abs() < 1e-5,
            "{place}"
        );
        assert!(
            (pose_at(point.after_s.into()) * position).z.abs() < 1e-6,
            "{place}"
        );
    }
    // A wall at x = 3: the vehicle nears it by 0.1 m in a turn.
    let level_at = |t: f64| pose::planar(t, 0.0, t);
    let cloud = lidar.revolution(&[0.0], &wall_at(3.0), EXACT, &mut noise, 0.0, level_at);
    for point in &cloud.points {
        let in_world =
            level_at(point.after_s.into()) * Point3::from(point.position_m.map(f64::from));
        assert!((in_world.x - 3.0).abs() < 1e-4, "{point:?}");
    }
    assert!(cloud.points.len() > 400, "{}", cloud.points.len());
}

#[test]
fn the_points_of_a_lidar_err_along_their_beams_and_drop_out() {
    let errors = LaserErrors {
        range_noise_m: 0.02,
        dropout: 0.1,
        mixed_pixels: 0.0,
    };
    let mut noise = LaserNoise::new(3, "lidar");
    let scene = Scene::new(&[solid(Shape::Plane, Pose::identity())]);
    let pose = Pose::translation(0.0, 0.0, 1.0);
    let rings_rad = [-30.0_f64.to_radians(); 4];
    let cloud =
        PlanarLaser::os1_64().revolution(&rings_rad, &scene, errors, &mut noise, 0.0, |_| pose);
    // 4096 beams, four standard deviations of 19.
    assert!(
        (330..490).contains(&cloud.without_return),
        "{}",
        cloud.without_return
    );
    assert_eq!(cloud.points.len() as u32 + cloud.without_return, 4096);
    let errors_m: Vec<f64> = cloud
        .points
        .iter()
        .map(|point| {
            let position = Vector3::from(point.position_m.map(f64::from));
            assert!((position.z / position.norm() + 0.5).abs() < 1e-6);
            position.norm() - 2.0
        })
        .collect();
    let mean_m = errors_m.iter().sum::<f64>() / errors_m.len() as f64;
    let variance_m2 = errors_m.iter().map(|m| m * m).sum::<f64>() / errors_m.len() as f64;
    assert!(
        mean_m.abs() < 0.0015 && (libm::sqrt(variance_m2) - 0.02).abs() < 0.001,
        "{mean_m} {variance_m2}"
    );
}
