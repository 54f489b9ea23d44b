use nalgebra::{Point2, Translation3};

use super::*;
use crate::attitude::Attitude;
use crate::chassis::Posture;
use crate::path::{PlanarPose, Waypoint};
use crate::solid::{Reflectivity, Shape, Solid};
use crate::vehicle::SimulatedVehicle;
use measurement::pose;

fn solid(size_m: [f64; 3], world_from_solid: Pose) -> Solid {
    Solid {
        name: String::new(),
        shape: Shape::Box { size_m },
        world_from_solid,
        reflectivity: Reflectivity::Diffuse,
        motion: None,
    }
}

/// A box on the ground, as high as it says.
fn block([x, y]: [f64; 2], [length_m, width_m, height_m]: [f64; 3]) -> Solid {
    let mut centre = pose::planar(x, y, 0.0);
    centre.translation.z = 0.5 * height_m;
    solid([length_m, width_m, height_m], centre)
}

/// Holos along x from 0 to `length_m` at 0.5 m/s.
fn drive(length_m: f64, solids: &[Solid]) -> Motion {
    let start = PlanarPose {
        position_m: Point2::origin(),
        yaw_rad: 0.0,
    };
    let end = Waypoint {
        position_m: Point2::new(length_m, 0.0),
        speed_mps: 0.5,
        corner_radius_m: 0.0,
    };
    Motion::along(
        Arc::new(Path::new(start, 1.0, &[end]).unwrap()),
        Arc::new(Scene::new(solids)),
        SimulatedVehicle::preset("holos")
            .unwrap()
            .carriage
            .chassis(),
    )
}

fn attitude_at(motion: &Motion, time_s: f64) -> Attitude {
    Attitude::of(&motion.world_from_base(time_s).rotation)
}

/// Pitch and roll, each smallest and largest, degrees, sampled every millisecond.
fn extremes_deg(motion: &Motion) -> [[f64; 2]; 2] {
    let mut extremes = [[0.0_f64; 2]; 2];
    for millisecond in 0..=(motion.path().duration_s() * 1e3) as u32 {
        let attitude = attitude_at(motion, f64::from(millisecond) * 1e-3);
        for (range, rad) in extremes
            .iter_mut()
            .zip([attitude.pitch_rad, attitude.roll_rad])
        {
            let deg = rad.to_degrees();
            *range = [range[0].min(deg), range[1].max(deg)];
        }
    }
    extremes
}

#[track_caller]
fn check_deg(found: [[f64; 2]; 2], expected: [[f64; 2]; 2]) {
    let pairs = found.iter().flatten().zip(expected.iter().flatten());
    for (a, b) in pairs {
        assert!((a - b).abs() < 0.05, "{found:?} is not {expected:?}");
    }
}

#[test]
fn driving_over_objects_gives_the_attitudes_of_the_document() {
    // Long enough along the path that an axle passes over alone, across it for both wheels or one side.
    let front_then_rear = drive(4.0, &[block([2.0, 0.0], [0.2, 1.0, 0.043])]);
    check_deg(extremes_deg(&front_then_rear), [[-4.48, 4.48], [0.0, 0.0]]);
    let lower = drive(4.0, &[block([2.0, 0.0], [0.2, 1.0, 0.024])]);
    check_deg(extremes_deg(&lower), [[-2.50, 2.50], [0.0, 0.0]]);
    // Longer than the wheelbase, so that both right wheels stand on it; while only one does, half of the roll.
    let right = drive(4.0, &[block([2.0, -0.3], [1.2, 0.2, 0.054])]);
    check_deg(extremes_deg(&right), [[-2.81, 2.81], [-5.16, 0.0]]);
}

#[test]
fn down_a_ramp_of_4_degrees_the_pitch_is_4_degrees() {
    let slope_rad = 4.0_f64.to_radians();
    let down = Attitude {
        pitch_rad: slope_rad,
        ..Attitude::default()
    };
    // The surface of a tilted slab; a platform of 1 m before it.
    let under_surface = Pose::from_parts(
        Translation3::new(0.0, 0.0, -0.5),
        Attitude::default().rotation(),
    );
    let edge = Pose::from_parts(Translation3::new(2.0, 0.0, 1.0), down.rotation());
    let mut centre = under_surface;
    centre.translation.x = 4.0;
    let solids = [
        block([0.0, 0.0], [4.0, 2.0, 1.0]),
        solid([8.0, 2.0, 1.0], edge * centre),
    ];
    let motion = drive(8.0, &solids);
    assert!((motion.world_from_base(0.0).translation.z - 1.0).abs() < 1e-9);
    for time_s in [5.0, 8.123, 15.0] {
        let attitude = attitude_at(&motion, time_s);
        assert!(
            (attitude.pitch_rad - slope_rad).abs() < 1e-5,
            "{attitude:?}"
        );
        let base = motion.world_from_base(time_s).translation;
        let expected_m = 1.0 - (0.5 * time_s - 2.0) * libm::tan(slope_rad);
        assert!((base.z - expected_m).abs() < 3e-5, "{base}, {expected_m}");
    }
    // Across the edge the pitch grows from one to the other and never beyond.
    check_deg(extremes_deg(&motion), [[0.0, 4.0], [0.0, 0.0]]);
}

#[test]
fn between_its_steps_a_posture_is_as_exact_as_it_says() {
    let solids = [
        block([1.5, 0.1], [0.3, 1.0, 0.043]),
        block([2.5, -0.3], [1.0, 0.3, 0.054]),
    ];
    let motion = drive(4.0, &solids);
    let (chassis, scene) = (
        SimulatedVehicle::preset("holos")
            .unwrap()
            .carriage
            .chassis()
            .unwrap(),
        Scene::new(&solids),
    );
    let mut last = Posture::default();
    let (mut worst_m, mut worst_rad) = (0.0_f64, 0.0_f64);
    for step in 0..=16_000_u32 {
        let time_s = f64::from(step) * 5e-4;
        let at = motion.path().planar_pose(time_s);
        last = chassis.settle(at, last, &|point| {
            posture_track::ground_below(&scene, point, time_s)
        });
        let error = last.world_from_base(at).inverse() * motion.world_from_base(time_s);
        worst_m = worst_m.max(error.translation.vector.norm());
        worst_rad = worst_rad.max(error.rotation.angle());
    }
    assert!(worst_m < 0.4e-3, "{worst_m}");
    assert!(worst_rad.to_degrees() < 0.08, "{}", worst_rad.to_degrees());
    // Not because nothing moves.
    assert!(worst_rad.to_degrees() > 0.001, "{}", worst_rad.to_degrees());
}

#[test]
fn poses_do_not_depend_on_the_order_in_which_they_are_asked_for() {
    let obstacles: Vec<Solid> = (0..20)
        .map(|n| block([1.0 + 1.7 * f64::from(n), 0.2], [0.4, 0.8, 0.03]))
        .collect();
    let (forwards, backwards) = (drive(36.0, &obstacles), drive(36.0, &obstacles));
    // More blocks of postures than are kept.
    let times: Vec<f64> = (-3..=750).map(|n| f64::from(n) * 0.1).collect();
    let first: Vec<Pose> = times.iter().map(|&s| forwards.world_from_base(s)).collect();
    let mut second: Vec<Pose> = times
        .iter()
        .rev()
        .map(|&s| backwards.world_from_base(s))
        .collect();
    second.reverse();
    assert_eq!(first, second);
    assert_eq!(first[0], forwards.world_from_base(0.0));
    assert_eq!(first.last(), Some(&forwards.world_from_base(1e9)));
    assert!(first.iter().any(|pose| pose.translation.z > 0.007));
}

#[test]
fn a_vehicle_starts_on_top_of_what_is_below_it_and_drives_under_what_is_above() {
    let mut roof = block([2.0, 0.0], [10.0, 4.0, 0.2]);
    roof.world_from_solid.translation.z = 2.6;
    let platform = block([0.0, 0.0], [20.0, 4.0, 0.8]);
    let motion = drive(4.0, &[roof, platform]);
    for time_s in [0.0, 4.0, 8.0] {
        assert!((motion.world_from_base(time_s).translation.z - 0.8).abs() < 1e-9);
    }
}

#[test]
fn a_vehicle_without_wheels_stays_level() {
    let scene = Arc::new(Scene::new(&[block([0.0, 0.0], [9.0, 9.0, 0.1])]));
    let holos = drive(1.0, &[]);
    let level = Motion::along(Arc::new(holos.path().clone()), scene, None);
    assert_eq!(
        level.world_from_base(1.0),
        holos.path().world_from_base(1.0)
    );
}
