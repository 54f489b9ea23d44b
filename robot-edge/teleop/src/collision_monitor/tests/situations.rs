#![expect(clippy::float_cmp, reason = "these values are exact")]

//! Single situations, and what the guard has to say of them.

use std::time::Duration;

use nalgebra::Point2;
use proptest::prelude::*;

use super::world::*;
use crate::collision_monitor::{
    BlockageDetector, CollisionMonitor, CollisionMonitorConfig, CollisionMonitorInput, CopyRequest,
    LocalMap, ObstacleScan, OdometrySample, UnavailableReason, UnknownSpacePolicy,
};
use crate::input::{CollisionMonitorOutput, SpeedLimits};
use crate::motion::Velocity;
use mapping::ground_plane::GroundPlane;
use mapping::occupancy_grid::OccupancyConfig;
use mapping::occupancy_grid::OccupancyGrid;
use mapping::registered_scan::BeamOutcome;
use mapping::vehicle::VehicleConfig;
use measurement::pose::planar;
use measurement::time::Monotonic;

const MEASURED_AT: Monotonic = Monotonic::from_nanos(1_000_000_000);

const fn going(linear_mps: f64, angular_radps: f64) -> Velocity {
    Velocity {
        linear_mps,
        angular_radps,
    }
}

/// 0.8 × 0.6 m, at most 1 m/s and 1 rad/s; its corners are 0.5 m from its middle.
fn setup() -> Setup {
    Setup {
        vehicle: VehicleConfig {
            length_m: 0.8,
            width_m: 0.6,
            ..VehicleConfig::default()
        },
        ..Setup::default()
    }
}

fn obstacle_scan(setup: &Setup, laser: Laser, walls: &Walls) -> ObstacleScan {
    let pose = planar(0.0, 0.0, 0.0);
    let mut obstacle_scan = ObstacleScan::default();
    let scan = laser.scan(walls, &pose);
    let times = (MEASURED_AT, Duration::from_millis(40));
    obstacle_scan.read(
        &scan,
        &GroundPlane::under(&pose),
        &setup.rules(),
        &BlockageDetector::default(),
        times,
    );
    obstacle_scan
}

struct Situation {
    setup: Setup,
    obstacle_scans: Vec<ObstacleScan>,
    map: Option<LocalMap>,
    measured: Velocity,
    commanded: Velocity,
    age: Duration,
}

impl Situation {
    fn new(setup: Setup, laser: Laser, walls: &Walls) -> Self {
        Self {
            obstacle_scans: vec![obstacle_scan(&setup, laser, walls)],
            setup,
            map: None,
            measured: Velocity::ZERO,
            commanded: Velocity::ZERO,
            age: Duration::ZERO,
        }
    }

    /// As told and measured, driving all the time.
    fn driving(self, velocity: Velocity) -> Self {
        Self {
            measured: velocity,
            commanded: velocity,
            ..self
        }
    }

    fn output(&self, requested: Velocity) -> CollisionMonitorOutput {
        self.evaluate_with_reason(requested).0
    }

    /// Its verdict, and what it lacked.
    fn evaluate_with_reason(
        &self,
        requested: Velocity,
    ) -> (CollisionMonitorOutput, Option<UnavailableReason>) {
        let now = MEASURED_AT + self.age;
        let input = CollisionMonitorInput {
            obstacle_scans: &self.obstacle_scans,
            map: self.map.as_ref(),
            odometry: Some(OdometrySample {
                odom_from_base: planar(0.0, 0.0, 0.0),
                measured: self.measured,
                measured_at: now,
            }),
            commanded: self.commanded,
            requested,
        };
        let mut guard = CollisionMonitor::new(self.setup.rules());
        (guard.output(&input, now), guard.unavailable_reason())
    }

    fn limits(&self, requested: Velocity) -> SpeedLimits {
        match self.output(requested) {
            CollisionMonitorOutput::Limits(limits) => limits,
            output @ (CollisionMonitorOutput::Off | CollisionMonitorOutput::Stale) => {
                panic!("{output:?}")
            }
        }
    }
}

/// A laser at the front that sees the half ahead.
const HALF: Laser = Laser {
    mount_x_m: 0.35,
    beams: 361,
    field_of_view_rad: std::f64::consts::PI,
    range_max_m: 20.0,
};

fn wall_ahead(x_m: f64) -> Walls {
    vec![wall([x_m, -9.0], [x_m, 9.0])]
}

#[test]
fn the_speed_is_that_of_the_formula() {
    for (gap_m, delay_s, decel, speed_mps) in [
        (0.3, 0.1, 1.0, 0.0),
        (0.5, 0.0, 1.0, 0.4),
        (0.8, 0.1, 2.0, 0.5),
        (1.5, 0.3, 1.0, 0.9),
    ] {
        let mut setup = setup();
        setup.guard.actuator_delay_s = delay_s;
        setup.teleop.stop_decel_mps2 = decel;
        let at = Situation::new(setup, Laser::ALL_DIRECTIONS, &wall_ahead(0.4 + gap_m))
            .driving(going(speed_mps, 0.0));
        let allowed = at.limits(going(1.0, 0.0)).forward_mps;
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
    let at =
        Situation::new(setup(), Laser::ALL_DIRECTIONS, &wall_ahead(1.0)).driving(going(0.8, 0.0));
    let allowed = |age_ms| {
        let now = MEASURED_AT + Duration::from_millis(age_ms);
        let input = CollisionMonitorInput {
            obstacle_scans: &at.obstacle_scans,
            map: None,
            odometry: Some(OdometrySample {
                odom_from_base: planar(0.0, 0.0, 0.0),
                measured: at.measured,
                measured_at: MEASURED_AT,
            }),
            commanded: at.commanded,
            requested: at.commanded,
        };
        match CollisionMonitor::new(at.setup.rules()).output(&input, now) {
            CollisionMonitorOutput::Limits(limits) => limits.forward_mps,
            output @ (CollisionMonitorOutput::Off | CollisionMonitorOutput::Stale) => {
                panic!("{output:?}")
            }
        }
    };
    let (young, old) = (allowed(0), allowed(200));
    let needed = |v: f64| v * 0.02 + v * v / 2.0;
    assert!(
        (needed(young) - needed(old) - 0.8 * 0.2).abs() < 2e-3,
        "{young} {old}"
    );
}

#[test]
fn along_a_wall_5_cm_beside_it_drives_at_full_speed() {
    for side in [1.0, -1.0] {
        let walls = vec![wall([-9.0, side * 0.35], [9.0, side * 0.35])];
        let at = Situation::new(setup(), Laser::ALL_DIRECTIONS, &walls);
        for speed in [1.0, -1.0] {
            let limits = at.limits(going(speed, 0.0));
            assert_eq!((limits.forward_mps, limits.reverse_mps), (1.0, 1.0));
            assert!(!limits.in_unknown_space);
        }
        let towards = at.limits(going(1.0, 0.5 * side));
        assert!(towards.forward_mps < 0.4, "{towards:?}");
    }
}

#[test]
fn two_cm_beside_a_wall_it_creeps() {
    let walls = vec![wall([-9.0, 0.32], [9.0, 0.32])];
    let limits = Situation::new(setup(), Laser::ALL_DIRECTIONS, &walls).limits(going(1.0, 0.0));
    // Behind it, the first hit that lies within the margin is a few centimetres away.
    assert!(
        (limits.forward_mps - 0.1).abs() < 1e-9 && limits.reverse_mps < 0.15,
        "{limits:?}"
    );
}

#[test]
fn beside_a_pillar_it_does_not_turn_its_corner_into_it() {
    // Left of the front, a centimetre from the side, within the circle of the corners.
    let walls = pillar([0.3, 0.335], 0.05);
    let at = Situation::new(setup(), Laser::ALL_DIRECTIONS, &walls);
    let right = at.limits(going(0.0, -1.0));
    let left = at.limits(going(0.0, 1.0));
    // To the left the side comes nearer at once; to the right its rear end does, a quarter of a turn later.
    assert_eq!((left.left_radps, right.right_radps), (0.0, 1.0));
    // 3 cm from the corner's circle, ahead of the side.
    let walls = pillar([0.22, 0.42], 0.05);
    let mut agile = setup();
    agile.vehicle.max_turn_rate_radps = 3.0;
    let limits = Situation::new(agile, Laser::ALL_DIRECTIONS, &walls).limits(going(0.0, 3.0));
    // From (0.245, 0.395), 0.465 m away, to the side grown by its margin.
    let free_rad = libm::atan2(0.395, 0.245) - libm::asin(0.33 / 0.4648);
    let needed_rad = |rate: f64| rate * 0.02 + rate * rate / 8.0;
    let needed_rad = needed_rad(limits.left_radps);
    assert!(
        (needed_rad - free_rad).abs() < 0.02,
        "{needed_rad} {free_rad}"
    );
    // Farther away than its corners reach it may turn as it likes.
    let walls = pillar([0.3, 0.6], 0.05);
    let free = Situation::new(setup(), Laser::ALL_DIRECTIONS, &walls).limits(going(0.0, 1.0));
    assert_eq!((free.left_radps, free.right_radps), (1.0, 1.0));
}

#[test]
fn behind_a_vehicle_that_looks_ahead_it_is_blind() {
    let at = Situation::new(setup(), HALF, &wall_ahead(5.0));
    let ahead = at.limits(going(1.0, 0.0));
    assert!(
        ahead.forward_mps == 1.0 && !ahead.in_unknown_space,
        "{ahead:?}"
    );
    let back = at.limits(going(-1.0, 0.0));
    assert!(
        (back.reverse_mps - 0.1).abs() < 1e-9 && back.in_unknown_space,
        "{back:?}"
    );

    let mut stops = setup();
    stops.guard.unknown_space_policy = UnknownSpacePolicy::Stop;
    let back = Situation::new(stops, HALF, &wall_ahead(5.0)).limits(going(-1.0, 0.0));
    assert!(
        back.reverse_mps == 0.0 && back.in_unknown_space && back.forward_mps == 1.0,
        "{back:?}"
    );
}

/// A map says what the ground is that beams pass over. It does not say so of where nobody looks, and not for ever.
#[test]
fn what_beams_pass_over_the_map_may_know() {
    let mut grid = OccupancyGrid::new(&OccupancyConfig::default());
    for _ in 0..3 {
        grid.integrate(&Laser::ALL_DIRECTIONS.scan(&wall_ahead(-1.6), &planar(0.0, 0.0, 0.0)));
    }
    let mut setup = setup();
    // All beams are higher.
    setup.guard.ground_visible_below_m = 0.1;
    let mut at = Situation::new(setup, Laser::ALL_DIRECTIONS, &wall_ahead(5.0));
    let mut map = LocalMap::default();
    map.copy_occupancy(
        &grid,
        CopyRequest {
            measured_at: MEASURED_AT,
            period: Duration::from_millis(200),
            centre: Point2::origin(),
            reach_m: at.setup.rules().window_m(),
        },
    );
    assert!(at.limits(going(-1.0, 0.0)).in_unknown_space);
    at.map = Some(map);
    let back = at.limits(going(-1.0, 0.0));
    // 1.2 m behind it the map has a wall, which lies anywhere in its cell of 0.1 m.
    let needed_m = back.reverse_mps * 0.02 + 0.5 * back.reverse_mps * back.reverse_mps;
    assert!(!back.in_unknown_space && back.reverse_mps > 0.9, "{back:?}");
    assert!(
        (0.9..=1.1).contains(&needed_m) || back.reverse_mps == 1.0,
        "{needed_m}"
    );
    at.obstacle_scans[0] = obstacle_scan(&at.setup, HALF, &wall_ahead(5.0));
    let back = at.limits(going(-1.0, 0.0));
    assert!(
        back.in_unknown_space && back.reverse_mps < 0.11,
        "nobody looks there: {back:?}"
    );

    // A map that nobody renews no longer says that ground is free.
    at.age = Duration::from_millis(501);
    let scan = Laser::ALL_DIRECTIONS.scan(&wall_ahead(5.0), &planar(0.0, 0.0, 0.0));
    let plane = GroundPlane::under(&planar(0.0, 0.0, 0.0));
    let times = (MEASURED_AT + at.age, Duration::from_millis(40));
    let blockage = BlockageDetector::default();
    at.obstacle_scans[0].read(&scan, &plane, &at.setup.rules(), &blockage, times);
    let back = at.limits(going(-1.0, 0.0));
    assert!(back.in_unknown_space && back.reverse_mps < 0.11, "{back:?}");
}

#[test]
fn what_stands_only_in_the_map_is_stopped_for() {
    let mut grid = OccupancyGrid::new(&OccupancyConfig::default());
    for _ in 0..3 {
        grid.integrate(
            &Laser::ALL_DIRECTIONS.scan(&pillar([1.05, 0.05], 0.08), &planar(0.0, 0.0, 0.0)),
        );
    }
    let mut at = Situation::new(setup(), Laser::ALL_DIRECTIONS, &vec![]);
    assert_eq!(at.limits(going(1.0, 0.0)).forward_mps, 1.0);
    let mut map = LocalMap::default();
    map.copy_occupancy(
        &grid,
        CopyRequest {
            // Also where it has not been renewed for long.
            measured_at: Monotonic::from_nanos(0),
            period: Duration::from_millis(200),
            centre: Point2::origin(),
            reach_m: at.setup.rules().window_m(),
        },
    );
    at.map = Some(map);
    let limits = at.limits(going(1.0, 0.0));
    let needed_m = limits.forward_mps * 0.02 + 0.5 * limits.forward_mps * limits.forward_mps;
    assert!((needed_m - 0.55).abs() < 0.06, "{needed_m}");
}

#[test]
fn stale_sweeps_mean_creeping_or_a_stop() {
    let mut at = Situation::new(setup(), Laser::ALL_DIRECTIONS, &wall_ahead(5.0));
    at.age = Duration::from_millis(300);
    let limits = at.limits(going(1.0, 0.0));
    assert!(limits.forward_mps == 1.0 && !limits.in_unknown_space);
    at.age = Duration::from_millis(301);
    for requested in [going(1.0, 0.0), Velocity::ZERO] {
        let limits = at.limits(requested);
        assert!(
            limits.in_unknown_space && limits.forward_mps <= 0.1 + 1e-9,
            "{limits:?}"
        );
        assert!(limits.forward_mps > 0.09 && limits.left_radps <= 0.2 + 1e-9);
    }
    at.setup.guard.unknown_space_policy = UnknownSpacePolicy::Stop;
    assert_eq!(at.output(going(1.0, 0.0)), CollisionMonitorOutput::Stale);
    let (_, unavailable_reason) = at.evaluate_with_reason(going(1.0, 0.0));
    assert_eq!(unavailable_reason, Some(UnavailableReason::ScansTooOld));
    // What was seen to stand there still does.
    let mut near = Situation::new(setup(), Laser::ALL_DIRECTIONS, &wall_ahead(0.5));
    near.age = Duration::from_secs(10);
    assert_eq!(near.limits(going(1.0, 0.0)).forward_mps, 0.0);
    near.obstacle_scans.clear();
    assert!(near.limits(going(1.0, 0.0)).in_unknown_space);
}

#[test]
fn without_a_pose_it_stops() {
    let at = Situation::new(setup(), Laser::ALL_DIRECTIONS, &wall_ahead(5.0));
    let output = |odometry, commanded| {
        let input = CollisionMonitorInput {
            obstacle_scans: &at.obstacle_scans,
            map: None,
            odometry,
            commanded,
            requested: going(1.0, 0.0),
        };
        let mut guard = CollisionMonitor::new(at.setup.rules());
        (
            guard.output(&input, MEASURED_AT),
            guard.unavailable_reason(),
        )
    };
    let known = OdometrySample {
        odom_from_base: planar(0.0, 0.0, 0.0),
        measured: Velocity::ZERO,
        measured_at: MEASURED_AT,
    };
    assert!(matches!(
        output(Some(known), Velocity::ZERO),
        (CollisionMonitorOutput::Limits(_), None)
    ));
    let stale = |unavailable_reason| (CollisionMonitorOutput::Stale, Some(unavailable_reason));
    assert_eq!(
        output(None, Velocity::ZERO),
        stale(UnavailableReason::PoseTooOld(None))
    );
    for bad in [f64::NAN, f64::INFINITY] {
        let mut lost = known;
        lost.odom_from_base.translation.vector.y = bad;
        assert_eq!(
            output(Some(lost), Velocity::ZERO),
            stale(UnavailableReason::NotFinite)
        );
        lost = known;
        lost.measured.angular_radps = bad;
        assert_eq!(
            output(Some(lost), Velocity::ZERO),
            stale(UnavailableReason::NotFinite)
        );
        let bad = going(bad, 0.0);
        assert_eq!(
            output(Some(known), bad),
            stale(UnavailableReason::NotFinite)
        );
    }
    let late = MEASURED_AT + Duration::from_millis(301);
    let input = CollisionMonitorInput {
        obstacle_scans: &at.obstacle_scans,
        map: None,
        odometry: Some(known),
        commanded: Velocity::ZERO,
        requested: Velocity::ZERO,
    };
    let mut guard = CollisionMonitor::new(at.setup.rules());
    assert_eq!(guard.output(&input, late), CollisionMonitorOutput::Stale);
    let age = Duration::from_millis(301);
    assert_eq!(
        guard.unavailable_reason(),
        Some(UnavailableReason::PoseTooOld(Some(age)))
    );
    assert!(matches!(
        guard.output(&input, MEASURED_AT),
        CollisionMonitorOutput::Limits(_)
    ));
    assert_eq!(guard.unavailable_reason(), None);
}

#[test]
fn switched_off_it_says_so() {
    let mut at = Situation::new(setup(), Laser::ALL_DIRECTIONS, &wall_ahead(0.5));
    at.setup.guard.enabled = false;
    assert_eq!(at.output(going(1.0, 0.0)), CollisionMonitorOutput::Off);
}

#[test]
fn a_boat_that_is_too_fast_gets_no_thrust() {
    let mut boat = setup();
    boat.teleop.is_boat = true;
    boat.teleop.stop_decel_mps2 = 0.5;
    // On a boat what a beam hits must rise from the water; here it is 0.2 m high.
    let at = Situation::new(boat, Laser::ALL_DIRECTIONS, &wall_ahead(1.4)).driving(going(0.9, 0.0));
    // It must have 0.9 m left before the margin, and says so; of thrust there is none.
    let limits = at.limits(going(0.9, 0.0));
    let needed_m = limits.forward_mps * (0.02 + limits.forward_mps);
    assert!((needed_m - 0.81).abs() < 1e-9, "{limits:?}");
    assert_eq!(thrust_mps(limits), 0.0);
    let slow =
        Situation::new(at.setup, Laser::ALL_DIRECTIONS, &wall_ahead(1.4)).driving(going(0.3, 0.0));
    let limits = slow.limits(going(0.9, 0.0));
    assert!(thrust_mps(limits) > 0.7, "{limits:?}");
}

/// The greatest speed ahead that the motors may be told.
fn thrust_mps(limits: SpeedLimits) -> f64 {
    CollisionMonitorOutput::Limits(limits).caps().0.towards(1.0)
}

#[test]
fn a_boat_above_its_greatest_speed_keeps_thrust_in_open_water() {
    let mut boat = setup();
    boat.teleop.is_boat = true;
    let limits_at = |setup: &Setup, measured_mps: f64| {
        let mut at = Situation::new(setup.clone(), Laser::ALL_DIRECTIONS, &vec![]);
        at.measured = going(measured_mps, 0.0);
        at.commanded = going(1.0, 0.0);
        at.limits(going(1.0, 0.0))
    };
    for (measured_mps, thrust) in [(0.97, 1.0), (1.02, 1.0), (1.2, 0.0)] {
        let limits = limits_at(&boat, measured_mps);
        assert_eq!(
            (limits.forward_mps, thrust_mps(limits)),
            (1.0, thrust),
            "{measured_mps}"
        );
    }
    // On land it brakes, at any speed.
    assert_eq!(thrust_mps(limits_at(&setup(), 1.2)), 1.0);
}

/// The laser of the elevation document: 1.08 m high, 7.5 degrees down. On level floor it only hits floor.
#[test]
fn floor_before_a_tilted_laser_limits_nothing() {
    let setup = Setup {
        vehicle: VehicleConfig {
            length_m: 0.9,
            width_m: 0.7,
            height_m: 1.15,
            ..VehicleConfig::default()
        },
        ..Setup::default()
    };
    let range_m = 1.08 / libm::sin(7.5_f64.to_radians());
    let mut scan = HALF.scan(&wall_ahead(100.0), &planar(0.0, 0.0, 0.0));
    let floor = |scan: &mut mapping::registered_scan::RegisteredScan, range_m: f64| {
        for beam in &mut scan.beams {
            let along = (beam.end_in_odom - beam.origin_in_odom).normalize();
            let dip = 7.5_f64.to_radians() * along.x;
            let down = nalgebra::Vector3::new(along.x, along.y, -libm::tan(dip)).normalize();
            beam.origin_in_odom.z = 1.08;
            let fall = (1.08 / -down.z).min(range_m);
            beam.end_in_odom = beam.origin_in_odom + down * fall;
            beam.outcome = if fall < range_m {
                BeamOutcome::Hit
            } else {
                BeamOutcome::Miss
            };
        }
    };
    floor(&mut scan, 2.0 * range_m);
    let mut at = Situation::new(setup, HALF, &vec![]);
    let plane = GroundPlane::under(&planar(0.0, 0.0, 0.0));
    let times = (MEASURED_AT, Duration::from_millis(40));
    at.obstacle_scans[0].read(
        &scan,
        &plane,
        &at.setup.rules(),
        &BlockageDetector::default(),
        times,
    );
    assert_eq!(at.obstacle_scans[0].points_in_odom().len(), 0);
    // Near the vehicle it has looked at nothing: that is the map's part.
    assert!(at.limits(going(1.0, 0.0)).in_unknown_space);
    let mut map = LocalMap::default();
    let mut grid = OccupancyGrid::new(&OccupancyConfig::default());
    for _ in 0..2 {
        grid.integrate(&Laser::ALL_DIRECTIONS.scan(&wall_ahead(4.0), &planar(0.0, 0.0, 0.0)));
    }
    map.copy_occupancy(
        &grid,
        CopyRequest {
            measured_at: MEASURED_AT,
            period: Duration::from_millis(40),
            centre: Point2::origin(),
            reach_m: at.setup.rules().window_m(),
        },
    );
    at.map = Some(map);
    let limits = at.limits(going(1.0, 0.0));
    assert!(
        limits.forward_mps == 1.0 && !limits.in_unknown_space,
        "{limits:?}"
    );
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        8 => -3.0..3.0,
        1 => prop::sample::select(vec![0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, 1e-300]),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// P9, and P8 as far as the guard goes: whatever it knows, its limits are finite, not negative and at most the
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
        let mut setup = setup();
        setup.teleop.is_boat = is_boat;
        setup.guard = CollisionMonitorConfig {
            unknown_space_policy: if stops { UnknownSpacePolicy::Stop } else { UnknownSpacePolicy::Creep },
            ..trusting_no_returns()
        };
        let rules = setup.rules();
        let mut scan = Laser::ALL_DIRECTIONS.scan(&vec![], &planar(0.0, 0.0, 0.0));
        for (beam, (x, y)) in scan.beams.iter_mut().step_by(60).zip(points) {
            beam.end_in_odom.x = x;
            beam.end_in_odom.y = y;
            beam.outcome = BeamOutcome::Hit;
        }
        let mut obstacle_scan = ObstacleScan::default();
        let plane = GroundPlane::under(&planar(0.0, 0.0, 0.0));
        obstacle_scan.read(&scan, &plane, &rules, &BlockageDetector::default(), (MEASURED_AT, Duration::from_millis(40)));
        let now = MEASURED_AT + Duration::from_millis(age_ms);
        let mut pose = planar(0.0, 0.0, yaw);
        pose.translation.vector.x = x;
        pose.translation.vector.y = y;
        let input = CollisionMonitorInput {
            obstacle_scans: &[obstacle_scan],
            map: None,
            odometry: Some(OdometrySample { odom_from_base: pose, measured: going(measured_v, measured_w), measured_at: MEASURED_AT }),
            commanded: going(told_v, told_w),
            requested: going(v, w),
        };
        match CollisionMonitor::new(rules).output(&input, now) {
            CollisionMonitorOutput::Off => prop_assert!(false),
            CollisionMonitorOutput::Stale => {}
            CollisionMonitorOutput::Limits(limits) => {
                for (most, own) in [
                    (limits.forward_mps, setup.vehicle.max_speed_mps),
                    (limits.reverse_mps, setup.vehicle.max_speed_mps),
                    (limits.left_radps, setup.vehicle.max_turn_rate_radps),
                    (limits.right_radps, setup.vehicle.max_turn_rate_radps),
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
