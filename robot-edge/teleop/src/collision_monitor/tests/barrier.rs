//! What bounds the motion that is asked for, and where in `odom` that is.

use std::time::Duration;

use nalgebra::Point2;
use protocol::message::BarrierKind;

use super::world::*;
use crate::collision_monitor::{
    Barrier, BlockageDetector, CollisionMonitor, CollisionMonitorInput, CollisionMonitorRules,
    CopyRequest, LocalMap, ObstacleScan, OdometrySample,
};
use crate::input::{CollisionMonitorOutput, SpeedLimits};
use crate::motion::Velocity;
use mapping::ground_plane::GroundPlane;
use mapping::occupancy_grid::OccupancyConfig;
use mapping::occupancy_grid::OccupancyGrid;
use mapping::vehicle::VehicleConfig;
use measurement::pose::{Pose, planar};
use measurement::time::Monotonic;

const MEASURED_AT: Monotonic = Monotonic::from_nanos(1_000_000_000);

/// A laser at the front that sees the half ahead.
const HALF: Laser = Laser {
    mount_x_m: 0.35,
    beams: 361,
    field_of_view_rad: std::f64::consts::PI,
    range_max_m: 20.0,
};

/// Away from the origin, and it looks along y.
fn pose() -> Pose {
    planar(3.0, -2.0, std::f64::consts::FRAC_PI_2)
}

/// A place in `odom`, by how far it is ahead of the vehicle and to its left, metres.
const fn place([ahead_m, left_m]: [f64; 2]) -> [f64; 2] {
    [3.0 - left_m, -2.0 + ahead_m]
}

/// A wall across its way, so far ahead of its middle.
fn across(ahead_m: f64) -> [Point2<f64>; 2] {
    wall(place([ahead_m, -9.0]), place([ahead_m, 9.0]))
}

/// A wall along its way, so far to the left of its middle.
fn along(left_m: f64) -> [Point2<f64>; 2] {
    wall(place([-9.0, left_m]), place([9.0, left_m]))
}

/// Of a vehicle of 0.8 × 0.6 m, at most 1 m/s and 1 rad/s, with margins of 10 cm ahead and 3 cm beside it.
fn rules() -> CollisionMonitorRules {
    let setup = Setup {
        vehicle: VehicleConfig {
            length_m: 0.8,
            width_m: 0.6,
            ..VehicleConfig::default()
        },
        ..Setup::default()
    };
    setup.rules()
}

/// It stands there, and was told what is around.
struct Scene {
    guard: CollisionMonitor,
    obstacle_scans: Vec<ObstacleScan>,
    map: Option<LocalMap>,
    age: Duration,
}

impl Scene {
    fn new(laser: Laser, walls: &Walls) -> Self {
        let mut obstacle_scan = ObstacleScan::default();
        let scan = laser.scan(walls, &pose());
        let times = (MEASURED_AT, Duration::from_millis(40));
        obstacle_scan.read(
            &scan,
            &GroundPlane::under(&pose()),
            &rules(),
            &BlockageDetector::default(),
            times,
        );
        Self {
            guard: CollisionMonitor::new(rules()),
            obstacle_scans: vec![obstacle_scan],
            map: None,
            age: Duration::ZERO,
        }
    }

    /// With a map of what no beam hits now: a thin pillar.
    fn with_pillar_on_the_map(self, at: [f64; 2]) -> Self {
        let mut grid = OccupancyGrid::new(&OccupancyConfig::default());
        for _ in 0..3 {
            grid.integrate(&Laser::ALL_DIRECTIONS.scan(&pillar(place(at), 0.08), &pose()));
        }
        let mut map = LocalMap::default();
        let request = CopyRequest {
            measured_at: MEASURED_AT,
            period: Duration::from_millis(200),
            centre: Point2::new(3.0, -2.0),
            reach_m: rules().window_m(),
        };
        map.copy_occupancy(&grid, request);
        Self {
            map: Some(map),
            ..self
        }
    }

    fn judge(
        &mut self,
        odometry: Option<OdometrySample>,
        requested: Velocity,
    ) -> CollisionMonitorOutput {
        let input = CollisionMonitorInput {
            obstacle_scans: &self.obstacle_scans,
            map: self.map.as_ref(),
            odometry,
            commanded: Velocity::ZERO,
            requested,
        };
        self.guard.output(&input, MEASURED_AT + self.age)
    }

    /// This motion is asked for: what is allowed, and what bounds it.
    fn requested(&mut self, linear_mps: f64, angular_radps: f64) -> (SpeedLimits, Option<Barrier>) {
        let odometry = OdometrySample {
            odom_from_base: pose(),
            measured: Velocity::ZERO,
            measured_at: MEASURED_AT + self.age,
        };
        let requested = Velocity {
            linear_mps,
            angular_radps,
        };
        match self.judge(Some(odometry), requested) {
            CollisionMonitorOutput::Limits(limits) => (limits, self.guard.barrier()),
            output @ (CollisionMonitorOutput::Off | CollisionMonitorOutput::Stale) => {
                panic!("{output:?}")
            }
        }
    }

    fn barrier(&mut self, linear_mps: f64, angular_radps: f64) -> Option<Barrier> {
        self.requested(linear_mps, angular_radps).1
    }
}

/// It is this, and within some centimetres there.
fn is_at(barrier: Option<Barrier>, kind: BarrierKind, at: [f64; 2], within_m: f64) {
    let barrier = barrier.unwrap();
    let [x, y] = barrier.position_in_odom;
    let [place_x, place_y] = place(at);
    let is_there = (x - place_x).abs() <= within_m && (y - place_y).abs() <= within_m;
    assert!(barrier.kind == kind && is_there, "{barrier:?}, not {at:?}");
}

#[test]
fn a_wall_is_reported_at_its_position_in_any_direction() {
    let mut scene = Scene::new(Laser::ALL_DIRECTIONS, &vec![across(0.9), across(-0.8)]);
    is_at(
        scene.barrier(1.0, 0.0),
        BarrierKind::Detected,
        [0.9, 0.0],
        0.005,
    );
    is_at(
        scene.barrier(-1.0, 0.0),
        BarrierKind::Detected,
        [-0.8, 0.0],
        0.005,
    );
    // It would stop in time from these; and turns past both.
    for free in [(0.0, 0.0), (0.7, 0.0), (-0.7, 0.0), (0.0, 1.0)] {
        assert_eq!(scene.barrier(free.0, free.1), None, "{free:?}");
    }
}

#[test]
fn of_a_motion_that_turns_it_is_what_bounds_the_mixture() {
    let mut scene = Scene::new(Laser::ALL_DIRECTIONS, &vec![along(0.35)]);
    assert_eq!(scene.barrier(1.0, 0.0), None);
    let barrier = scene.barrier(1.0, 0.5).unwrap();
    assert_eq!(barrier.kind, BarrierKind::Detected);
    assert!(
        (barrier.position_in_odom[0] - 2.65).abs() < 1e-6,
        "{barrier:?}"
    );
    // Along a wall that is too near for anything but creeping.
    let mut scene = Scene::new(Laser::ALL_DIRECTIONS, &vec![along(0.32)]);
    let (limits, barrier) = scene.requested(1.0, 0.0);
    let barrier = barrier.unwrap();
    assert!((limits.forward_mps - 0.1).abs() < 1e-9, "{limits:?}");
    assert_eq!(barrier.kind, BarrierKind::Detected);
    assert!(
        (barrier.position_in_odom[0] - 2.68).abs() < 1e-6,
        "{barrier:?}"
    );
}

#[test]
fn a_mapped_barrier_is_reported_and_the_nearer_one_wins() {
    let at = [0.95, 0.05];
    let nothing_seen = Scene::new(Laser::ALL_DIRECTIONS, &vec![]);
    let mut scene = nothing_seen.with_pillar_on_the_map(at);
    is_at(scene.barrier(1.0, 0.0), BarrierKind::Mapped, at, 1e-6);
    for (ahead_m, kind, nearer) in [
        (1.2, BarrierKind::Mapped, at),
        (0.8, BarrierKind::Detected, [0.8, 0.0]),
    ] {
        let wall = Scene::new(Laser::ALL_DIRECTIONS, &vec![across(ahead_m)]);
        let mut scene = wall.with_pillar_on_the_map(at);
        is_at(scene.barrier(1.0, 0.0), kind, nearer, 0.005);
    }
}

#[test]
fn the_edge_of_observed_ground_is_reported_without_creeping() {
    let near_sighted = Laser {
        range_max_m: 0.8,
        ..Laser::ALL_DIRECTIONS
    };
    let (limits, barrier) = Scene::new(near_sighted, &vec![]).requested(1.0, 0.0);
    assert!(
        !limits.in_unknown_space && (0.8..0.95).contains(&limits.forward_mps),
        "{limits:?}"
    );
    // The first cell of 5 cm that it has not seen, at a side of its way.
    let [x, y] = barrier.unwrap().position_in_odom;
    assert_eq!(barrier.unwrap().kind, BarrierKind::Unknown);
    assert!((x - 3.0).abs() < 0.3 && (y + 1.175).abs() < 0.03, "{x} {y}");
    // What stands before that edge comes first.
    let wall = vec![across(0.75)];
    let barrier = Scene::new(near_sighted, &wall).barrier(1.0, 0.0);
    is_at(barrier, BarrierKind::Detected, [0.75, 0.0], 0.005);

    // Behind a vehicle that looks ahead nothing was seen at all.
    let mut scene = Scene::new(HALF, &vec![across(5.0)]);
    let (limits, barrier) = scene.requested(-1.0, 0.0);
    assert!(limits.in_unknown_space, "{limits:?}");
    is_at(barrier, BarrierKind::Unknown, [-0.45, 0.0], 0.04);
    assert_eq!(scene.barrier(1.0, 0.0), None);
}

#[test]
fn stale_scans_report_only_hits_as_barrier() {
    for (ahead_m, is_told) in [(0.9, false), (0.48, true)] {
        let mut scene = Scene::new(Laser::ALL_DIRECTIONS, &vec![across(ahead_m)]);
        scene.age = Duration::from_millis(301);
        let (limits, barrier) = scene.requested(1.0, 0.0);
        assert!(limits.in_unknown_space, "{limits:?}");
        assert_eq!(barrier.is_some(), is_told, "{barrier:?}");
        if is_told {
            is_at(barrier, BarrierKind::Detected, [ahead_m, 0.0], 0.005);
        }
    }
}

#[test]
fn a_guard_that_cannot_judge_tells_none() {
    let mut scene = Scene::new(Laser::ALL_DIRECTIONS, &vec![across(0.9)]);
    assert!(scene.barrier(1.0, 0.0).is_some());
    let requested = Velocity {
        linear_mps: 1.0,
        angular_radps: 0.0,
    };
    assert_eq!(scene.judge(None, requested), CollisionMonitorOutput::Stale);
    assert_eq!(scene.guard.barrier(), None);
}

/// A boat whose sonar finds a shoal ahead, and beside it a post that stands out of the water.
#[test]
fn a_shoal_and_an_obstacle_in_water_have_different_kinds() {
    let mut setup = Setup::default();
    setup.teleop.is_boat = true;
    setup.vehicle.length_m = 0.8;
    setup.vehicle.width_m = 0.6;
    setup.vehicle.bottom_z_m = -0.6;
    setup.vehicle.height_m = 1.6;
    let rules = setup.rules();
    for (height_m, kind) in [(-0.4, BarrierKind::Shallow), (0.3, BarrierKind::Detected)] {
        let mut scan = HALF.scan(&vec![across(0.8)], &pose());
        for beam in &mut scan.beams {
            beam.end_in_odom.z = height_m;
        }
        let mut obstacle_scan = ObstacleScan::default();
        let times = (MEASURED_AT, Duration::from_millis(40));
        let blockage = BlockageDetector::default();
        obstacle_scan.read(
            &scan,
            &GroundPlane::under(&pose()),
            &rules,
            &blockage,
            times,
        );
        let mut scene = Scene {
            guard: CollisionMonitor::new(rules),
            obstacle_scans: vec![obstacle_scan],
            map: None,
            age: Duration::ZERO,
        };
        let (limits, barrier) = scene.requested(1.0, 0.0);
        assert!(limits.forward_mps < 0.9, "{limits:?}");
        is_at(barrier, kind, [0.8, 0.0], 0.01);
    }
}
