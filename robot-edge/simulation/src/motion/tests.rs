#![expect(clippy::float_cmp, reason = "these values are exact")]

use measurement::pose;
use nalgebra::{Point2, Translation3};
use proptest::prelude::*;

use super::*;
use crate::attitude::Attitude;
use crate::fixtures::{block, check, holos, motion, path, slope, vehicle};
use crate::path::Waypoint;
use crate::solid::{Shape, Solid};

/// Holos along x from 0 to `length_m` at 0.5 m/s.
fn drive(length_m: f64, solids: &[Solid]) -> Motion {
    motion("holos", path(&[[length_m, 0.0, 0.0]]), solids)
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
    let shape = Shape::Box {
        size_m: [8.0, 2.0, 1.0],
    };
    let solids = [
        block([0.0, 0.0], [4.0, 2.0, 1.0]),
        crate::fixtures::solid(shape, edge * centre),
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
    let (chassis, scene) = (holos(), Scene::new(&solids));
    let mut last = Posture::default();
    let (mut worst_m, mut worst_rad) = (0.0_f64, 0.0_f64);
    for step in 0..=16_000_u32 {
        let time_s = f64::from(step) * 5e-4;
        let at = motion.path().planar_pose(time_s);
        last = chassis.settle(at, last, &|point| ground_below(&scene, point, time_s));
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
fn poses_do_not_depend_on_query_order() {
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
fn start_height_is_the_ground_below_not_the_roof_above() {
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
    let path = path(&[[1.0, 0.0, 0.0]]);
    let level = motion(
        "pioneer",
        Arc::clone(&path),
        &[block([0.0, 0.0], [9.0, 9.0, 0.1])],
    );
    assert_eq!(level.world_from_base(1.0), path.world_from_base(1.0));
}

/// A vehicle at the origin that looks along x and is driven from the beginning on.
struct Driver {
    motion: Motion,
    step: i64,
}

impl Driver {
    fn new(name: &str, solids: &[Solid]) -> Self {
        // It turns on the spot to get there, so that it does not move yet.
        let behind = Waypoint {
            position_m: Point2::new(-1.0, 0.0),
            speed_mps: 0.5,
            corner_radius_m: 0.0,
        };
        let path = Path::new(PlanarPose::default(), 1e-9, &[behind]).unwrap();
        let mut motion = motion(name, Arc::new(path), solids);
        motion.take_over(0, &vehicle(name), Arc::new(Scene::new(solids)));
        Self { motion, step: 0 }
    }

    /// The planar pose and the velocity after going so for a time.
    fn go(
        &mut self,
        linear_mps: f64,
        angular_radps: f64,
        duration_s: f64,
    ) -> ([f64; 3], PlanarVelocity) {
        self.motion.set_command(CommandedVelocity {
            linear_mps,
            lateral_mps: 0.0,
            angular_radps,
        });
        self.step += libm::round(duration_s / POSTURE_STEP_S) as i64;
        self.motion.advance_to(self.step);
        let base = self.motion.world_from_base(self.now_s());
        let at = [base.translation.x, base.translation.y, pose::yaw_rad(&base)];
        (at, self.motion.velocity(self.now_s()))
    }

    fn now_s(&self) -> f64 {
        self.step as f64 * POSTURE_STEP_S
    }
}

#[test]
fn straight_on_it_lags_by_its_time_constant() {
    // 0.1 s of a Pioneer, which gives 1 cm at 0.1 m/s.
    let (at, velocity) = Driver::new("pioneer", &[]).go(0.1, 0.0, 5.0);
    check(at, [0.49, 0.0, 0.0], 1e-5);
    assert_eq!(velocity.forward_mps, 0.1);
}

#[test]
fn it_turns_in_place_and_drives_circles() {
    let mut driver = Driver::new("pioneer", &[]);
    check(driver.go(0.0, 0.3, 5.0).0, [0.0, 0.0, 0.3 * 4.9], 1e-5);
    let mut driver = Driver::new("introbot", &[]);
    driver.go(0.5, 0.25, 5.0);
    let from = driver.motion.world_from_base(driver.now_s());
    // Half of a circle of 2 m.
    driver.go(0.5, 0.25, std::f64::consts::PI / 0.25);
    let to = from.inverse() * driver.motion.world_from_base(driver.now_s());
    assert!((to.translation.y - 4.0).abs() < 0.01, "{to}");
    assert!(to.translation.x.abs() < 0.01, "{to}");
}

#[test]
fn it_stops_within_the_way_that_its_brakes_and_its_lag_take() {
    let mut driver = Driver::new("pioneer", &[]);
    let (from, velocity) = driver.go(1.0, 0.0, 5.0);
    assert_eq!(velocity.forward_mps, 1.0);
    let (to, velocity) = driver.go(0.0, 0.0, 3.0);
    assert_eq!(velocity, PlanarVelocity::default());
    // 2 m/s² down to the 0.2 m/s that the lag of 0.1 s takes from there.
    let way_m = (1.0 - 0.2 * 0.2) / (2.0 * 2.0) + 0.2 * 0.1;
    assert!(
        (to[0] - from[0] - way_m).abs() < 0.003,
        "{} m",
        to[0] - from[0]
    );
    assert_eq!(driver.go(0.0, 0.0, 60.0).0, to);
}

#[test]
fn what_is_no_number_stops_it() {
    let mut driver = Driver::new("holos", &[]);
    driver.go(0.5, 0.1, 2.0);
    let (_, velocity) = driver.go(f64::NAN, 0.5, 2.0);
    assert_eq!(velocity, PlanarVelocity::default());
}

#[test]
fn a_boat_drifts_on() {
    let mut driver = Driver::new("riverwatch", &[]);
    let (from, velocity) = driver.go(3.0, 0.0, 60.0);
    assert!((velocity.forward_mps - 3.0).abs() < 1e-3, "{velocity:?}");
    let (after_1_s, velocity) = driver.go(0.0, 0.0, 1.0);
    assert!((1.0..2.0).contains(&velocity.forward_mps), "{velocity:?}");
    assert!(after_1_s[0] - from[0] > 1.9, "{after_1_s:?}");
    let (to, velocity) = driver.go(0.0, 0.0, 60.0);
    assert_eq!(velocity, PlanarVelocity::default());
    // 4.1 m by drag alone, and near to 1 m while the propellers slow down.
    assert!((5.0..5.2).contains(&(to[0] - from[0])), "{to:?}, {from:?}");
    check([0.0, to[1], to[2]], [0.0; 3], 1e-6);
}

#[test]
fn a_wall_stops_it() {
    let mut driver = Driver::new("holos", &[block([3.0, 0.0], [1.0, 4.0, 1.0])]);
    let (at, velocity) = driver.go(1.0, 0.0, 6.0);
    // Its front is 0.45 m ahead, and a step's way of 5 mm may be left.
    assert!((2.044..=2.05).contains(&at[0]), "{at:?}");
    assert!(velocity.forward_mps < 0.1, "{velocity:?}");
    // It cannot turn its corners into it, but it can go away, and come again.
    let (turned, _) = driver.go(0.0, 1.0, 2.0);
    assert!(turned[2] < 0.1, "{turned:?}");
    let (back, _) = driver.go(-0.5, 0.0, 2.0);
    assert!(back[0] < 1.3, "{back:?}");
    let (again, _) = driver.go(1.0, 0.0, 3.0);
    assert!((2.044..=2.05).contains(&again[0]), "{again:?}");
}

#[test]
fn kerbs_are_felt_and_steps_as_high_as_an_axle_stop_it() {
    let pitch_deg = |height_m| {
        let mut driver = Driver::new("holos", &[block([2.0, 0.0], [0.2, 1.0, height_m])]);
        let mut extremes = [0.0_f64; 2];
        for _ in 0..800 {
            driver.go(0.5, 0.0, 0.01);
            let base = driver.motion.world_from_base(driver.now_s());
            let deg = Attitude::of(&base.rotation).pitch_rad.to_degrees();
            extremes = [extremes[0].min(deg), extremes[1].max(deg)];
        }
        extremes
    };
    // As on a path over the same kerb.
    let [up, down] = pitch_deg(0.043);
    assert!(
        (up + 4.48).abs() < 0.05 && (down - 4.48).abs() < 0.05,
        "{up}, {down}"
    );
    assert_eq!(pitch_deg(0.13), [0.0, 0.0]);
}

#[test]
fn a_slope_shortens_the_way_on_the_map() {
    let mut driver = Driver::new("holos", &[slope(-10.0)]);
    driver.go(0.5, 0.0, 4.0);
    let from = driver.motion.world_from_base(driver.now_s());
    driver.go(0.5, 0.0, 4.0);
    let to = driver.motion.world_from_base(driver.now_s());
    let moved = to.translation.vector - from.translation.vector;
    assert!((moved.norm() - 2.0).abs() < 1e-3, "{moved}");
    assert!(
        (moved.z - 2.0 * libm::sin(10.0_f64.to_radians())).abs() < 1e-3,
        "{moved}"
    );
}

#[test]
fn poses_that_are_no_longer_kept_are_the_oldest_that_are() {
    let mut driver = Driver::new("pioneer", &[]);
    driver.go(0.5, 0.0, 30.0);
    let pose_at = |time_s| driver.motion.world_from_base(time_s).translation.x;
    let oldest_s = 30.0 - 10.0 + POSTURE_STEP_S;
    assert_eq!(pose_at(1.0).to_bits(), pose_at(oldest_s).to_bits());
    assert!(pose_at(oldest_s + 0.1) > pose_at(oldest_s) + 0.049);
    assert_eq!(pose_at(99.0).to_bits(), pose_at(30.0).to_bits());
}

proptest! {
    #[test]
    fn it_stays_out_of_walls_at_any_command(
        commands in prop::collection::vec((-1.5..1.5, -6.0..6.0, 0.05..1.0), 1..20)
    ) {
        // A pen of 1.6 m × 1.2 m with a post in it.
        let solids = [
            block([0.9, 0.0], [0.2, 2.0, 1.0]),
            block([-0.9, 0.0], [0.2, 2.0, 1.0]),
            block([0.0, 0.7], [2.0, 0.2, 1.0]),
            block([0.0, -0.7], [2.0, 0.2, 1.0]),
            block([0.4, 0.3], [0.1, 0.1, 1.0]),
        ];
        let mut driver = Driver::new("pioneer", &solids);
        let bumper = Bumper::new(vehicle("pioneer").body, Arc::new(Scene::new(&solids)));
        for (linear_mps, angular_radps, duration_s) in commands {
            driver.go(linear_mps, angular_radps, duration_s);
            let world_from_base = driver.motion.world_from_base(driver.now_s());
            prop_assert!(!bumper.touches(&world_from_base, 0.0), "{world_from_base}");
        }
    }
}
