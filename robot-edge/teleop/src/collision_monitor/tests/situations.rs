#![expect(clippy::float_cmp, reason = "these values are exact")]

//! Single situations: the limits, and what bounds the requested motion.

use std::f64::consts::FRAC_PI_2;
use std::time::Duration;

use proptest::prelude::*;
use protocol::message::BarrierKind;

use super::*;
use crate::collision_monitor::{Barrier, ObstaclesAround, UnavailableReason, UnknownSpacePolicy};
use crate::interface::{CollisionMonitorOutput, SpeedLimits};
use crate::motion::Velocity;
use mapping::registered_scan::BeamOutcome;
use mapping::vehicle::VehicleConfig;
use measurement::pose::{Pose, planar};
use measurement::time::Monotonic;

const MAP_PERIOD: Duration = Duration::from_millis(200);

fn wall_ahead(x_m: f64) -> Walls {
    vec![wall([x_m, -9.0], [x_m, 9.0])]
}

fn all_around(walls: &Walls) -> Scene {
    Scene::new(Setup::default(), Laser::ALL_DIRECTIONS, walls)
}

/// Reaction time and braking distance on land, metres.
fn stopping_m(speed_mps: f64) -> f64 {
    speed_mps * 0.02 + speed_mps * speed_mps / 2.0
}

#[test]
fn the_speed_is_that_of_the_formula() {
    for (gap_m, delay_s, decel, speed_mps) in [
        (0.3, 0.1, 1.0, 0.0),
        (0.5, 0.0, 1.0, 0.4),
        (0.8, 0.1, 2.0, 0.5),
        (1.5, 0.3, 1.0, 0.9),
    ] {
        let mut setup = Setup::default();
        setup.monitor.actuator_delay_s = delay_s;
        setup.teleop.stop_decel_mps2 = decel;
        let mut at = Scene::new(setup, Laser::ALL_DIRECTIONS, &wall_ahead(0.4 + gap_m))
            .driving(Velocity::new(speed_mps, 0.0));
        let allowed = at.limits(Velocity::new(1.0, 0.0)).forward_mps;
        // v·(age + delay) with measured v, then a round, then v²/2a, leaves the margin.
        let needed_m = speed_mps * delay_s + allowed * 0.02 + allowed * allowed / (2.0 * decel);
        if allowed < 1.0 {
            assert!((needed_m - (gap_m - 0.1)).abs() < 1e-3, "{gap_m} {allowed}");
        } else {
            assert!(needed_m <= gap_m - 0.1);
        }
    }
}

#[test]
fn an_older_pose_of_a_vehicle_that_drives_allows_less() {
    let mut at = all_around(&wall_ahead(1.0)).driving(Velocity::new(0.8, 0.0));
    let [young, old] = [0, 200].map(|age_ms| {
        at.now = START + Duration::from_millis(age_ms);
        at.limits(Velocity::new(0.8, 0.0)).forward_mps
    });
    let difference_m = stopping_m(young) - stopping_m(old);
    assert!((difference_m - 0.8 * 0.2).abs() < 2e-3, "{young} {old}");
}

#[test]
fn along_a_wall_5_cm_beside_it_drives_at_full_speed() {
    for side in [1.0, -1.0] {
        let mut at = all_around(&vec![wall([-9.0, side * 0.35], [9.0, side * 0.35])]);
        for speed in [1.0, -1.0] {
            let limits = at.limits(Velocity::new(speed, 0.0));
            assert_eq!((limits.forward_mps, limits.reverse_mps), (1.0, 1.0));
            assert!(!limits.in_unknown_space);
        }
        let towards = at.limits(Velocity::new(1.0, 0.5 * side));
        assert!(towards.forward_mps < 0.4, "{towards:?}");
    }
}

#[test]
fn two_cm_beside_a_wall_it_creeps() {
    let limits = all_around(&vec![wall([-9.0, 0.32], [9.0, 0.32])]).limits(Velocity::new(1.0, 0.0));
    // Behind it, the first hit that lies within the margin is a few centimetres away.
    assert!(
        (limits.forward_mps - 0.1).abs() < 1e-9 && limits.reverse_mps < 0.15,
        "{limits:?}"
    );
}

#[test]
fn beside_a_pillar_it_does_not_turn_its_corner_into_it() {
    // Left of the front, a centimetre from the side, within the circle of the corners.
    let mut at = all_around(&pillar([0.3, 0.335], 0.05));
    // To the left the side comes nearer at once; to the right its rear end does, a quarter of a turn later.
    assert_eq!(at.limits(Velocity::new(0.0, -1.0)).right_radps, 1.0);
    assert_eq!(at.limits(Velocity::new(0.0, 1.0)).left_radps, 0.0);
    // 3 cm from the corner's circle, ahead of the side.
    let mut agile = Setup::default();
    agile.vehicle.max_turn_rate_radps = 3.0;
    let walls = pillar([0.22, 0.42], 0.05);
    let limits = Scene::new(agile, Laser::ALL_DIRECTIONS, &walls).limits(Velocity::new(0.0, 3.0));
    // From (0.245, 0.395), 0.465 m away, to the side grown by its margin.
    let free_rad = libm::atan2(0.395, 0.245) - libm::asin(0.33 / 0.4648);
    let needed_rad = limits.left_radps * 0.02 + limits.left_radps * limits.left_radps / 8.0;
    assert!(
        (needed_rad - free_rad).abs() < 0.02,
        "{needed_rad} {free_rad}"
    );
    // Farther away than its corners reach it may turn as it likes.
    let free = all_around(&pillar([0.3, 0.6], 0.05)).limits(Velocity::new(0.0, 1.0));
    assert_eq!((free.left_radps, free.right_radps), (1.0, 1.0));
}

#[test]
fn behind_a_vehicle_that_looks_ahead_it_is_blind() {
    let mut at = Scene::new(Setup::default(), Laser::AHEAD, &wall_ahead(5.0));
    let ahead = at.limits(Velocity::new(1.0, 0.0));
    assert!(ahead.forward_mps == 1.0 && !ahead.in_unknown_space);
    let back = at.limits(Velocity::new(-1.0, 0.0));
    assert!((back.reverse_mps - 0.1).abs() < 1e-9 && back.in_unknown_space);

    at.setup.monitor.unknown_space_policy = UnknownSpacePolicy::Stop;
    let back = at.limits(Velocity::new(-1.0, 0.0));
    assert!(back.reverse_mps == 0.0 && back.in_unknown_space && back.forward_mps == 1.0);
}

/// A map says what the ground is that beams pass over. It does not say so of where nobody looks, and not for ever.
#[test]
fn what_beams_pass_over_the_map_may_know() {
    let pose = planar(0.0, 0.0, 0.0);
    // All beams are higher.
    let mut setup = Setup::default();
    setup.monitor.ground_visible_below_m = 0.1;
    let mut at = Scene::new(setup, Laser::ALL_DIRECTIONS, &wall_ahead(5.0));
    let map = at.setup.map(&wall_ahead(-1.6), &pose, (START, MAP_PERIOD));
    assert!(at.limits(Velocity::new(-1.0, 0.0)).in_unknown_space);
    at.map = Some(map);
    let back = at.limits(Velocity::new(-1.0, 0.0));
    // 1.2 m behind it the map has a wall, which lies anywhere in its cell of 0.1 m.
    let needed_m = stopping_m(back.reverse_mps);
    assert!(!back.in_unknown_space && back.reverse_mps > 0.9, "{back:?}");
    assert!((0.9..=1.1).contains(&needed_m) || back.reverse_mps == 1.0);
    let nobody_looks_there = Laser::AHEAD.scan(&wall_ahead(5.0), &pose);
    at.obstacle_scans[0] = at.setup.obstacle_scan(&nobody_looks_there, START);
    let back = at.limits(Velocity::new(-1.0, 0.0));
    assert!(back.in_unknown_space && back.reverse_mps < 0.11, "{back:?}");

    // A map that is not renewed no longer says that ground is free.
    at.wait(501);
    let scan = Laser::ALL_DIRECTIONS.scan(&wall_ahead(5.0), &pose);
    at.obstacle_scans[0] = at.setup.obstacle_scan(&scan, at.now);
    let back = at.limits(Velocity::new(-1.0, 0.0));
    assert!(back.in_unknown_space && back.reverse_mps < 0.11, "{back:?}");
}

#[test]
fn what_stands_only_in_the_map_is_stopped_for() {
    let mut at = all_around(&vec![]);
    assert_eq!(at.limits(Velocity::new(1.0, 0.0)).forward_mps, 1.0);
    // Also if the map has not been renewed for long.
    let times = (Monotonic::from_nanos(0), MAP_PERIOD);
    let walls = pillar([1.05, 0.05], 0.08);
    at.map = Some(at.setup.map(&walls, &planar(0.0, 0.0, 0.0), times));
    let needed_m = stopping_m(at.limits(Velocity::new(1.0, 0.0)).forward_mps);
    assert!((needed_m - 0.55).abs() < 0.06, "{needed_m}");
}

#[test]
fn stale_sweeps_mean_creeping_or_a_stop() {
    let mut at = all_around(&wall_ahead(5.0));
    at.wait(300);
    let limits = at.limits(Velocity::new(1.0, 0.0));
    assert!(limits.forward_mps == 1.0 && !limits.in_unknown_space);
    at.wait(301);
    for requested in [Velocity::new(1.0, 0.0), Velocity::ZERO] {
        let limits = at.limits(requested);
        assert!(creeps_ahead(&limits), "{limits:?}");
        assert!(limits.forward_mps > 0.09 && limits.left_radps <= 0.2 + 1e-9);
    }
    at.setup.monitor.unknown_space_policy = UnknownSpacePolicy::Stop;
    assert_eq!(
        at.output(Velocity::new(1.0, 0.0)),
        CollisionMonitorOutput::Stale
    );
    let reason = at.monitor.unavailable_reason();
    assert_eq!(reason, Some(UnavailableReason::ScansTooOld));
    // What was seen to stand there still does.
    let mut near = all_around(&wall_ahead(0.5));
    near.wait(10_000);
    assert_eq!(near.limits(Velocity::new(1.0, 0.0)).forward_mps, 0.0);
    near.obstacle_scans.clear();
    assert!(near.limits(Velocity::new(1.0, 0.0)).in_unknown_space);
}

#[test]
fn without_a_pose_it_stops() {
    let at = || all_around(&wall_ahead(5.0));
    let mut known = at();
    known.limits(Velocity::new(1.0, 0.0));
    assert_eq!(known.monitor.unavailable_reason(), None);
    let stale = |mut scene: Scene, reason| {
        let output = scene.output(Velocity::new(1.0, 0.0));
        assert_eq!(output, CollisionMonitorOutput::Stale, "{reason:?}");
        assert_eq!(scene.monitor.unavailable_reason(), Some(reason));
        scene
    };
    let mut unknown = at();
    unknown.odometry = None;
    stale(unknown, UnavailableReason::PoseTooOld(None));
    for bad in [f64::NAN, f64::INFINITY] {
        let mut lost = [at(), at(), at()];
        let [pose, measured, commanded] = &mut lost;
        let odometry = pose.odometry.as_mut().unwrap();
        odometry.odom_from_base.translation.vector.y = bad;
        measured.odometry.as_mut().unwrap().measured.angular_radps = bad;
        commanded.commanded = Velocity::new(bad, 0.0);
        for scene in lost {
            stale(scene, UnavailableReason::NotFinite);
        }
    }
    let mut late = at();
    let age = Duration::from_millis(301);
    late.now = START + age;
    let mut again = stale(late, UnavailableReason::PoseTooOld(Some(age)));
    again.now = START;
    limits_of(again.next_output(Velocity::ZERO));
    assert_eq!(again.monitor.unavailable_reason(), None);
}

#[test]
fn switched_off_it_says_so() {
    let mut at = all_around(&wall_ahead(0.5));
    at.setup.monitor.enabled = false;
    assert_eq!(
        at.output(Velocity::new(1.0, 0.0)),
        CollisionMonitorOutput::Off
    );
}

/// The greatest speed ahead that the motors get.
fn thrust_mps(limits: SpeedLimits) -> f64 {
    CollisionMonitorOutput::Limits(limits)
        .caps()
        .linear
        .towards(1.0)
}

#[test]
fn a_boat_that_is_too_fast_gets_no_thrust() {
    let mut boat = Setup::default();
    boat.teleop.is_boat = true;
    boat.teleop.stop_decel_mps2 = 0.5;
    // On a boat what a beam hits must rise from the water; here it is 0.2 m high.
    let mut at =
        Scene::new(boat, Laser::ALL_DIRECTIONS, &wall_ahead(1.4)).driving(Velocity::new(0.9, 0.0));
    // It must have 0.9 m left before the margin, and says so; of thrust there is none.
    let limits = at.limits(Velocity::new(0.9, 0.0));
    let needed_m = limits.forward_mps * (0.02 + limits.forward_mps);
    assert!((needed_m - 0.81).abs() < 1e-9, "{limits:?}");
    assert_eq!(thrust_mps(limits), 0.0);
    let limits = at
        .driving(Velocity::new(0.3, 0.0))
        .limits(Velocity::new(0.9, 0.0));
    assert!(thrust_mps(limits) > 0.7, "{limits:?}");
}

#[test]
fn a_boat_above_its_greatest_speed_keeps_thrust_in_open_water() {
    for (is_boat, measured_mps, thrust) in [
        (true, 0.97, 1.0),
        (true, 1.02, 1.0),
        (true, 1.2, 0.0),
        // On land it brakes, at any speed.
        (false, 1.2, 1.0),
    ] {
        let mut at = all_around(&vec![]).driving(Velocity::new(measured_mps, 0.0));
        at.setup.teleop.is_boat = is_boat;
        at.commanded = Velocity::new(1.0, 0.0);
        let limits = at.limits(Velocity::new(1.0, 0.0));
        assert_eq!(limits.forward_mps, 1.0, "{measured_mps}");
        assert_eq!(thrust_mps(limits), thrust, "{measured_mps}");
    }
}

/// The laser of `docs/methods.md`: 1.08 m high, 7.5 degrees down. On level floor it only hits floor.
#[test]
fn floor_before_a_tilted_laser_limits_nothing() {
    let setup = Setup {
        vehicle: VehicleConfig {
            height_m: 1.15,
            ..vehicle(0.9, 0.7, 1.0)
        },
        ..Setup::default()
    };
    let pose = planar(0.0, 0.0, 0.0);
    let range_m = 2.0 * 1.08 / libm::sin(7.5_f64.to_radians());
    let mut scan = Laser::AHEAD.scan(&vec![], &pose);
    for beam in &mut scan.beams {
        let along = (beam.end_in_odom - beam.origin_in_odom).normalize();
        let dip = 7.5_f64.to_radians() * along.x;
        let down = nalgebra::Vector3::new(along.x, along.y, -libm::tan(dip)).normalize();
        let fall_m = 1.08 / -down.z;
        beam.origin_in_odom.z = 1.08;
        beam.end_in_odom = beam.origin_in_odom + down * fall_m.min(range_m);
        beam.outcome = if fall_m < range_m {
            BeamOutcome::Hit
        } else {
            BeamOutcome::Miss
        };
    }
    let mut at = Scene::new(setup, Laser::AHEAD, &vec![]);
    at.obstacle_scans[0] = at.setup.obstacle_scan(&scan, START);
    assert_eq!(at.obstacle_scans[0].points_in_odom().len(), 0);
    // Near the vehicle it has looked at nothing: that is the map's part.
    assert!(at.limits(Velocity::new(1.0, 0.0)).in_unknown_space);
    at.map = Some(at.setup.map(&wall_ahead(4.0), &pose, (START, SCAN_PERIOD)));
    let limits = at.limits(Velocity::new(1.0, 0.0));
    assert!(limits.forward_mps == 1.0 && !limits.in_unknown_space);
}

/// Away from the origin, and it looks along y.
fn pose() -> Pose {
    planar(3.0, -2.0, FRAC_PI_2)
}

/// A place in `odom`, by how far it is ahead of the vehicle and to its left, metres.
const fn place([ahead_m, left_m]: [f64; 2]) -> [f64; 2] {
    [3.0 - left_m, -2.0 + ahead_m]
}

/// A wall across its way, so far ahead of its middle.
fn across(ahead_m: f64) -> [nalgebra::Point2<f64>; 2] {
    wall(place([ahead_m, -9.0]), place([ahead_m, 9.0]))
}

fn scene_away(laser: Laser, walls: &Walls) -> Scene {
    Scene::at(pose(), Setup::default(), laser, walls)
}

/// With a map of what no beam hits now: a thin pillar.
fn with_mapped_pillar(mut scene: Scene, at: [f64; 2]) -> Scene {
    let walls = pillar(place(at), 0.08);
    scene.map = Some(scene.setup.map(&walls, &pose(), (START, MAP_PERIOD)));
    scene
}

impl Scene {
    fn barrier(&mut self, linear_mps: f64, angular_radps: f64) -> Option<Barrier> {
        self.limits(Velocity::new(linear_mps, angular_radps));
        self.monitor.barrier()
    }
}

/// It is of this kind, and there.
#[track_caller]
fn is_at(barrier: Option<Barrier>, kind: BarrierKind, at: [f64; 2], within_m: f64) {
    let barrier = barrier.unwrap();
    let [x, y] = barrier.position_in_odom;
    let [place_x, place_y] = place(at);
    let is_there = (x - place_x).abs() <= within_m && (y - place_y).abs() <= within_m;
    assert!(barrier.kind == kind && is_there, "{barrier:?}, not {at:?}");
}

#[test]
fn a_wall_is_reported_at_its_position_in_any_direction() {
    let mut scene = scene_away(Laser::ALL_DIRECTIONS, &vec![across(0.9), across(-0.8)]);
    for (speed_mps, ahead_m) in [(1.0, 0.9), (-1.0, -0.8)] {
        let barrier = scene.barrier(speed_mps, 0.0);
        is_at(barrier, BarrierKind::Detected, [ahead_m, 0.0], 0.005);
    }
    // It would stop in time from these; and turns past both.
    for free in [(0.0, 0.0), (0.7, 0.0), (-0.7, 0.0), (0.0, 1.0)] {
        assert_eq!(scene.barrier(free.0, free.1), None, "{free:?}");
    }
    // Without a pose there is no barrier.
    assert!(scene.barrier(1.0, 0.0).is_some());
    scene.odometry = None;
    let output = scene.next_output(Velocity::new(1.0, 0.0));
    assert_eq!(output, CollisionMonitorOutput::Stale);
    assert_eq!(scene.monitor.barrier(), None);
}

#[test]
fn of_a_motion_that_turns_it_is_what_bounds_the_mixture() {
    // Along a wall, and along one that is too near for anything but creeping.
    for (left_m, turn_radps) in [(0.35, 0.5), (0.32, 0.0)] {
        let walls = vec![wall(place([-9.0, left_m]), place([9.0, left_m]))];
        let mut scene = scene_away(Laser::ALL_DIRECTIONS, &walls);
        let creeps = (scene.limits(Velocity::new(1.0, 0.0)).forward_mps - 0.1).abs() < 1e-9;
        assert_eq!(scene.monitor.barrier().is_some(), creeps);
        assert_eq!(creeps, left_m < 0.33);
        let barrier = scene.barrier(1.0, turn_radps).unwrap();
        assert_eq!(barrier.kind, BarrierKind::Detected);
        let off_m = barrier.position_in_odom[0] - (3.0 - left_m);
        assert!(off_m.abs() < 1e-6, "{barrier:?}");
    }
}

#[test]
fn a_mapped_barrier_is_reported_and_the_nearer_one_wins() {
    let at = [0.95, 0.05];
    for (walls, kind, nearer, within_m) in [
        (vec![], BarrierKind::Mapped, at, 1e-6),
        (vec![across(1.2)], BarrierKind::Mapped, at, 0.005),
        (vec![across(0.8)], BarrierKind::Detected, [0.8, 0.0], 0.005),
    ] {
        let mut scene = with_mapped_pillar(scene_away(Laser::ALL_DIRECTIONS, &walls), at);
        is_at(scene.barrier(1.0, 0.0), kind, nearer, within_m);
    }
}

#[test]
fn the_edge_of_observed_ground_is_reported_without_creeping() {
    let near_sighted = Laser {
        range_max_m: 0.8,
        ..Laser::ALL_DIRECTIONS
    };
    let mut scene = scene_away(near_sighted, &vec![]);
    let limits = scene.limits(Velocity::new(1.0, 0.0));
    assert!(
        !limits.in_unknown_space && (0.8..0.95).contains(&limits.forward_mps),
        "{limits:?}"
    );
    // The first cell of 5 cm that it has not seen, at a side of its way.
    let barrier = scene.monitor.barrier().unwrap();
    let [x, y] = barrier.position_in_odom;
    assert_eq!(barrier.kind, BarrierKind::Unknown);
    assert!((x - 3.0).abs() < 0.3 && (y + 1.175).abs() < 0.03, "{x} {y}");
    // What stands before that edge comes first.
    let barrier = scene_away(near_sighted, &vec![across(0.75)]).barrier(1.0, 0.0);
    is_at(barrier, BarrierKind::Detected, [0.75, 0.0], 0.005);

    // Behind a vehicle that looks ahead nothing was seen at all.
    let mut scene = scene_away(Laser::AHEAD, &vec![across(5.0)]);
    assert!(scene.limits(Velocity::new(-1.0, 0.0)).in_unknown_space);
    let barrier = scene.monitor.barrier();
    is_at(barrier, BarrierKind::Unknown, [-0.45, 0.0], 0.04);
    assert_eq!(scene.barrier(1.0, 0.0), None);
}

#[test]
fn stale_scans_report_only_hits_as_barrier() {
    for (ahead_m, is_reported) in [(0.9, false), (0.48, true)] {
        let mut scene = scene_away(Laser::ALL_DIRECTIONS, &vec![across(ahead_m)]);
        scene.wait(301);
        assert!(scene.limits(Velocity::new(1.0, 0.0)).in_unknown_space);
        let barrier = scene.monitor.barrier();
        assert_eq!(barrier.is_some(), is_reported, "{barrier:?}");
        if is_reported {
            is_at(barrier, BarrierKind::Detected, [ahead_m, 0.0], 0.005);
        }
    }
}

/// A boat whose sonar finds a shoal ahead, and beside it a post that stands out of the water.
#[test]
fn a_shoal_and_an_obstacle_in_water_have_different_kinds() {
    let mut setup = Setup::default();
    setup.teleop.is_boat = true;
    setup.vehicle.bottom_z_m = -0.6;
    setup.vehicle.height_m = 1.6;
    for (height_m, kind) in [(-0.4, BarrierKind::Shallow), (0.3, BarrierKind::Detected)] {
        let mut scan = Laser::AHEAD.scan(&vec![across(0.8)], &pose());
        for beam in &mut scan.beams {
            beam.end_in_odom.z = height_m;
        }
        let mut scene = Scene::at(pose(), setup.clone(), Laser::AHEAD, &vec![]);
        scene.obstacle_scans[0] = setup.obstacle_scan(&scan, START);
        assert!(scene.limits(Velocity::new(1.0, 0.0)).forward_mps < 0.9);
        is_at(scene.monitor.barrier(), kind, [0.8, 0.0], 0.01);
    }
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        8 => -3.0..3.0,
        1 => prop::sample::select(vec![0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, 1e-300]),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// P9, and P8 as far as the collision monitor goes: whatever it knows, its limits are finite, not negative and at most the
    /// vehicle's own; so what is within them is no faster than what was asked.
    #[test]
    fn it_never_makes_anything_faster(
        points in prop::collection::vec((number(), number()), 0..12),
        (v, w) in (number(), number()),
        (measured_v, measured_w) in (number(), number()),
        (told_v, told_w) in (number(), number()),
        (x, y, yaw) in (number(), number(), -3.0..3.0),
        age_ms in 0_u64..700,
        is_boat in any::<bool>(),
        stops in any::<bool>(),
    ) {
        let mut setup = Setup::default();
        setup.teleop.is_boat = is_boat;
        if stops {
            setup.monitor.unknown_space_policy = UnknownSpacePolicy::Stop;
        }
        let mut scan = Laser::ALL_DIRECTIONS.scan(&vec![], &planar(0.0, 0.0, 0.0));
        for (beam, (x, y)) in scan.beams.iter_mut().step_by(60).zip(points) {
            beam.end_in_odom.x = x;
            beam.end_in_odom.y = y;
            beam.outcome = BeamOutcome::Hit;
        }
        let mut pose = planar(0.0, 0.0, yaw);
        pose.translation.vector.x = x;
        pose.translation.vector.y = y;
        let mut scene = Scene::at(pose, setup, Laser::ALL_DIRECTIONS, &vec![]);
        scene.obstacle_scans[0] = scene.setup.obstacle_scan(&scan, START);
        scene.odometry.as_mut().unwrap().measured = Velocity::new(measured_v, measured_w);
        scene.commanded = Velocity::new(told_v, told_w);
        scene.now = START + Duration::from_millis(age_ms);
        match scene.output(Velocity::new(v, w)) {
            CollisionMonitorOutput::Off => prop_assert!(false),
            CollisionMonitorOutput::Stale => {}
            CollisionMonitorOutput::Limits(limits) => {
                let vehicle = &scene.setup.vehicle;
                for (most, own) in [
                    (limits.forward_mps, vehicle.max_speed_mps),
                    (limits.reverse_mps, vehicle.max_speed_mps),
                    (limits.left_radps, vehicle.max_turn_rate_radps),
                    (limits.right_radps, vehicle.max_turn_rate_radps),
                ] {
                    prop_assert!((0.0..=own * (1.0 + 1e-12)).contains(&most), "{limits:?}");
                }
                let is_stale = age_ms > 300;
                prop_assert!(!is_stale || limits.in_unknown_space);
                if limits.in_unknown_space && is_stale {
                    prop_assert!(limits.forward_mps <= 0.1 + 1e-9 && limits.left_radps <= 0.2 + 1e-9);
                }
            }
        }
    }
}

#[test]
fn while_it_goes_sideways_that_axis_has_limits_whatever_is_asked() {
    let walls = [wall([-5.0, 2.0], [5.0, 2.0])].to_vec();
    for (commanded_mps, requested_mps) in [(0.0, 0.5), (0.5, 0.5), (0.5, 0.0)] {
        let sideways = |lateral_mps| Velocity {
            lateral_mps,
            ..Velocity::ZERO
        };
        let mut scene = Scene::new(Setup::default(), Laser::ALL_DIRECTIONS, &walls)
            .driving(sideways(commanded_mps));
        let limits = scene.limits(sideways(requested_mps));
        assert!(
            limits.left_mps > 0.5 && limits.right_mps > 0.5,
            "{limits:?}"
        );
        assert!(limits.left_radps + limits.right_radps < 1e-9, "{limits:?}");
    }
    let limits = Scene::new(Setup::default(), Laser::ALL_DIRECTIONS, &walls).limits(Velocity::ZERO);
    assert!(limits.left_mps + limits.right_mps < 1e-9, "{limits:?}");
}

/// A wall ahead and one to the left; a laser that sees the half ahead, and whose misses can be trusted.
#[test]
fn what_is_around_the_vehicle_is_told_by_sector_clockwise_from_ahead() {
    let setup = Setup::default();
    for heading_rad in [0.0, 2.0] {
        let pose = planar(7.0, -3.0, heading_rad);
        let in_odom = |x: f64, y: f64| {
            let point = pose * Point3::new(x, y, 0.0);
            [point.x, point.y]
        };
        let walls = vec![
            wall(in_odom(4.0, -1.0), in_odom(4.0, 1.0)),
            wall(in_odom(-1.0, 3.0), in_odom(1.0, 3.0)),
        ];
        let scan = Laser::AHEAD.scan(&walls, &pose);
        let mut around = ObstaclesAround::default();
        ObstacleScan::default().read(
            &scan,
            &GroundPlane::under(&pose),
            &setup.rules(),
            &BlockageDetector::default(),
            (Monotonic::default(), SCAN_PERIOD),
            Some(&mut around),
        );
        let [ahead, right, behind, left] = [0, 18, 36, 55].map(|sector| around.nearest_m[sector]);
        assert!((ahead - 4.0).abs() < 0.01, "{ahead}");
        // The laser is 0.35 m ahead of the vehicle's frame, and sees nothing farther back.
        assert!((left - 3.02).abs() < 0.01, "{left}");
        assert!(right.is_infinite(), "{right}");
        assert!(behind.is_nan(), "{behind}");
    }
}
