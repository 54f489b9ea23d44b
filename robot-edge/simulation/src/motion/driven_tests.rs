#![expect(clippy::float_cmp, reason = "these values are exact")]

use nalgebra::Point2;
use proptest::prelude::*;

use super::*;
use crate::attitude::Attitude;
use crate::path::{PlanarPose, Waypoint};
use crate::solid::{Reflectivity, Shape, Solid};
use crate::vehicle::SimulatedVehicle;
use crate::velocity::CommandedVelocity;
use measurement::pose;

/// A box on the ground, as high as it says.
fn block([x, y]: [f64; 2], size_m: [f64; 3]) -> Solid {
    let mut world_from_solid = pose::planar(x, y, 0.0);
    world_from_solid.translation.z = 0.5 * size_m[2];
    Solid {
        name: String::new(),
        shape: Shape::Box { size_m },
        world_from_solid,
        reflectivity: Reflectivity::Diffuse,
        motion: None,
    }
}

/// A vehicle at the origin that looks along x and is driven from the beginning on.
struct Driver {
    motion: Motion,
    step: i64,
}

impl Driver {
    fn new(vehicle: &str, solids: &[Solid]) -> Self {
        let vehicle = SimulatedVehicle::preset(vehicle).unwrap();
        let start = PlanarPose {
            position_m: Point2::origin(),
            yaw_rad: 0.0,
        };
        // It turns on the spot to get there, so that it does not move yet.
        let behind = Waypoint {
            position_m: Point2::new(-1.0, 0.0),
            speed_mps: 0.5,
            corner_radius_m: 0.0,
        };
        let path = Arc::new(Path::new(start, 1e-9, &[behind]).unwrap());
        let scene = Arc::new(Scene::new(solids));
        let mut motion = match vehicle.carriage {
            Carriage::Hull(hull) => Motion::afloat(path, hull, Arc::default(), 0.0),
            Carriage::Level | Carriage::Wheels(_) => {
                Motion::along(path, Arc::clone(&scene), vehicle.carriage.chassis())
            }
        };
        motion.take_over(0, vehicle.drive, Bumper::new(vehicle.body, scene));
        Self { motion, step: 0 }
    }

    /// The planar pose and the velocity after going so for a time.
    fn go(
        &mut self,
        linear_mps: f64,
        angular_radps: f64,
        duration_s: f64,
    ) -> ([f64; 3], PlanarVelocity) {
        self.motion
            .drive_model_mut()
            .unwrap()
            .set_command(CommandedVelocity {
                linear_mps,
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

    fn collisions(&self) -> Collisions {
        self.motion.drive_model().unwrap().collisions()
    }
}

#[track_caller]
fn check(found: [f64; 3], expected: [f64; 3], within: f64) {
    let off = [0, 1, 2].map(|n| (found[n] - expected[n]).abs());
    assert!(
        off.iter().all(|off| *off <= within),
        "{found:?} is not {expected:?}"
    );
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
fn a_wall_stops_it_once() {
    let mut driver = Driver::new("holos", &[block([3.0, 0.0], [1.0, 4.0, 1.0])]);
    let (at, velocity) = driver.go(1.0, 0.0, 6.0);
    // Its front is 0.45 m ahead, and a step's way of 5 mm may be left.
    assert!((2.044..=2.05).contains(&at[0]), "{at:?}");
    assert!(velocity.forward_mps < 0.1, "{velocity:?}");
    let felt = driver.collisions();
    assert_eq!(felt.count, 1);
    assert!((2.0..3.0).contains(&felt.last_s.unwrap()), "{felt:?}");
    assert!(felt.contact.is_some());
    // It cannot turn its corners into it, but it can go away, and come again.
    let (turned, _) = driver.go(0.0, 1.0, 2.0);
    assert!(turned[2] < 0.1, "{turned:?}");
    assert_eq!(driver.collisions().count, 1);
    let (back, _) = driver.go(-0.5, 0.0, 2.0);
    assert!(back[0] < 1.3, "{back:?}");
    assert_eq!(driver.collisions().contact, None);
    driver.go(1.0, 0.0, 3.0);
    assert_eq!(driver.collisions().count, 2);
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
        (extremes, driver.collisions().count)
    };
    // As on a path over the same kerb.
    let ([up, down], collisions) = pitch_deg(0.043);
    assert!(
        (up + 4.48).abs() < 0.05 && (down - 4.48).abs() < 0.05,
        "{up}, {down}"
    );
    assert_eq!(collisions, 0);
    assert_eq!(pitch_deg(0.13), ([0.0, 0.0], 1));
}

#[test]
fn a_slope_shortens_the_way_on_the_map() {
    // A slab that rises by 10°, its near edge sunk into the ground.
    let mut slope = block([0.0, 0.0], [20.0, 4.0, 1.0]);
    let up = Attitude {
        pitch_rad: -10.0_f64.to_radians(),
        ..Attitude::default()
    };
    slope.world_from_solid.translation.z = -0.5;
    slope.world_from_solid.rotation = up.rotation();
    let mut driver = Driver::new("holos", &[slope]);
    driver.go(0.5, 0.0, 4.0);
    let from = driver.motion.world_from_base(driver.now_s());
    driver.go(0.5, 0.0, 4.0);
    let moved = driver
        .motion
        .world_from_base(driver.now_s())
        .translation
        .vector
        - from.translation.vector;
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
    let oldest_s = 30.0 - DriveModel::KEPT_S + POSTURE_STEP_S;
    assert_eq!(pose_at(1.0).to_bits(), pose_at(oldest_s).to_bits());
    assert!(pose_at(oldest_s + 0.1) > pose_at(oldest_s) + 0.049);
    assert_eq!(pose_at(99.0).to_bits(), pose_at(30.0).to_bits());
}

proptest! {
    #[test]
    fn whatever_it_is_told_it_stays_out_of_walls(
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
        let body = SimulatedVehicle::preset("pioneer").unwrap().body;
        let bumper = Bumper::new(body, Arc::new(Scene::new(&solids)));
        for (linear_mps, angular_radps, duration_s) in commands {
            driver.go(linear_mps, angular_radps, duration_s);
            let world_from_base = driver.motion.world_from_base(driver.now_s());
            prop_assert!(!bumper.touches(&world_from_base, 0.0), "{world_from_base}");
        }
    }
}
