use super::*;
use crate::collision_monitor::tests::{Setup, vehicle};
use mapping::registered_scan::{ScanKind, SensorId};
use measurement::pose::planar;
use measurement::time::RobotTime;

/// Of a vehicle so fast that points at some metres are kept.
fn setup() -> Setup {
    let mut setup = Setup {
        vehicle: vehicle(0.9, 0.7, 6.0),
        ..Setup::default()
    };
    setup.vehicle.height_m = 1.15;
    setup
}

impl Coverage {
    /// Whether a point was observed by a beam that was low enough there.
    fn is_visible(&self, point_in_odom: Point2<f64>, slack_m: f64) -> bool {
        self.observation_at(point_in_odom, slack_m)
            .is_some_and(|observation| observation.is_low)
    }
}

/// One beam from a sensor above the origin of a vehicle that stands level at the origin of `odom`.
fn beam(height_m: f64, end: [f64; 3], outcome: BeamOutcome) -> RegisteredBeam {
    RegisteredBeam {
        origin_in_odom: Point3::new(0.0, 0.0, height_m),
        end_in_odom: end.into(),
        outcome,
        index: 0,
        range_m: 1.0,
    }
}

fn obstacle_scan(setup: &Setup, beams: Vec<RegisteredBeam>) -> ObstacleScan {
    let scan = RegisteredScan {
        stamp: RobotTime::from_nanos(0),
        sensor: SensorId(0),
        beam_step_rad: 0.01,
        kind: ScanKind::Beams,
        own_body_hits: 0,
        odom_from_base: planar(0.0, 0.0, 0.0),
        beams,
    };
    setup.obstacle_scan(&scan, Monotonic::from_nanos(0))
}

/// What one hit at a height, 3 m ahead of a sensor at a height, adds to the points.
fn point_of(setup: &Setup, sensor_m: f64, hit_m: f64) -> Option<[f64; 2]> {
    let hit = beam(sensor_m, [3.0, 0.0, hit_m], BeamOutcome::Hit);
    obstacle_scan(setup, vec![hit])
        .points_in_odom()
        .first()
        .copied()
}

#[test]
fn what_is_in_the_way_depends_on_the_height_of_sensor_and_hit() {
    let setup = setup();
    for (sensor_m, hit_m, is_obstacle) in [
        (1.08, 0.0, false),
        (1.08, 0.09, false),
        (1.08, -0.09, false),
        (1.08, 0.11, true),
        (1.08, 1.0, true),
        (1.08, 1.24, true),
        (1.08, 1.26, false),
        // A sensor near the height of the ground cannot tell floor from obstacles.
        (0.0, 0.0, true),
        (0.1, 0.0, true),
        // One above the vehicle's top sees what is as high as itself.
        (1.5, 1.5, true),
        (1.5, 1.65, false),
    ] {
        let point = point_of(&setup, sensor_m, hit_m);
        let expected = is_obstacle.then_some([3.0, 0.0]);
        assert_eq!(point, expected, "{hit_m} m from {sensor_m} m");
    }
    // A hole begins where its beam passed the ground: from 1 m down to -0.5 m over 3 m, after 2 m.
    let [x, y] = point_of(&setup, 1.0, -0.5).unwrap();
    assert!((x - 2.0).abs() < 1e-12 && y == 0.0);
}

#[test]
fn under_a_boat_the_bottom_is_not_in_the_way_and_shoals_are() {
    let mut setup = setup();
    setup.teleop.is_boat = true;
    setup.vehicle.bottom_z_m = -0.6;
    setup.vehicle.height_m = 2.6;
    for (hit_m, is_obstacle) in [
        (-5.0, false),
        (-0.75, false),
        (-0.65, true),
        (-0.3, true),
        (0.05, false),
        (0.5, true),
    ] {
        for sensor_m in [-0.5, 1.9] {
            let point = point_of(&setup, sensor_m, hit_m);
            assert_eq!(point.is_some(), is_obstacle, "{hit_m}");
        }
    }
    // Half a metre of water stays under the keel.
    setup.monitor.min_depth_m = Some(0.5);
    for (hit_m, is_obstacle) in [(-1.25, false), (-1.15, true)] {
        let point = point_of(&setup, -0.5, hit_m);
        assert_eq!(point.is_some(), is_obstacle, "{hit_m}");
    }
}

#[test]
fn its_own_body_is_not_in_the_way() {
    let setup = setup();
    let hit = |x, y| beam(1.0, [x, y, 0.5], BeamOutcome::Hit);
    let own = obstacle_scan(
        &setup,
        vec![hit(0.44, 0.0), hit(-0.44, 0.34), hit(0.0, -0.34)],
    );
    assert_eq!(own.points_in_odom(), [[0.0; 2]; 0]);
    let other = obstacle_scan(&setup, vec![hit(0.46, 0.0), hit(-0.44, 0.36)]);
    assert_eq!(other.points_in_odom(), [[0.46, 0.0], [-0.44, 0.36]]);
    // The vehicle has gone half a metre since the first beam, and the body with it.
    let mut late = hit(0.94, 0.0);
    late.origin_in_odom += nalgebra::Vector3::new(0.5, 0.0, 0.0);
    let moved = obstacle_scan(&setup, vec![hit(3.0, 0.0), late]);
    assert_eq!(moved.points_in_odom(), [[3.0, 0.0]]);
}

#[test]
fn a_tilted_beam_has_seen_the_ground_only_near_its_end() {
    let setup = setup();
    let check = |from_m, end, outcome, seen: &[f64], unseen: &[f64]| {
        let scan = obstacle_scan(&setup, vec![beam(from_m, end, outcome)]);
        let is_seen = |x: &f64| scan.coverage().is_visible(Point2::new(*x, 0.0), 1e-6);
        assert!(seen.iter().all(is_seen), "{from_m} {end:?}");
        assert!(!unseen.iter().any(is_seen), "{from_m} {end:?}");
    };
    let (hit, miss) = (BeamOutcome::Hit, BeamOutcome::Miss);
    // Below 0.3 m after 7/10 of the way.
    check(1.0, [8.0, 0.0, 0.0], hit, &[5.7, 7.9], &[1.0, 5.5, 8.1]);
    check(0.25, [8.0, 0.0, 0.25], hit, &[0.1, 5.5, 7.9], &[8.1]);
    check(0.5, [8.0, 0.0, 0.5], hit, &[], &[0.1, 7.9]);
    check(0.1, [8.0, 0.0, 0.5], miss, &[0.1, 3.9], &[4.1]);
    // Behind the edge of a hole nothing is known of the ground.
    check(1.0, [3.0, 0.0, -0.5], hit, &[1.5, 1.9], &[1.3, 2.1]);
}

#[test]
fn misses_are_trusted_or_not() {
    let miss = || vec![beam(0.2, [8.0, 0.0, 0.2], BeamOutcome::Miss)];
    let at = Point2::new(4.0, 0.0);
    for treat_no_return_as_free in [true, false] {
        let mut setup = setup();
        setup.monitor.treat_no_return_as_free = treat_no_return_as_free;
        let scan = obstacle_scan(&setup, miss());
        assert_eq!(scan.coverage().is_visible(at, 0.0), treat_no_return_as_free);
        assert_eq!(scan.points_in_odom().len(), 0);
    }
}

#[test]
fn beams_that_are_no_numbers_say_nothing() {
    let setup = setup();
    for bad in [f64::NAN, f64::INFINITY] {
        for end in [[bad, 0.0, 0.2], [3.0, bad, 0.2], [3.0, 0.0, bad]] {
            let obstacle_scan = obstacle_scan(&setup, vec![beam(0.2, end, BeamOutcome::Hit)]);
            assert_eq!(obstacle_scan.points_in_odom().len(), 0, "{end:?}");
            assert!(
                !obstacle_scan
                    .coverage()
                    .is_visible(Point2::new(1.0, 0.0), 0.0),
                "{end:?}"
            );
        }
    }
    let empty = obstacle_scan(&setup, vec![]);
    assert!(!empty.coverage().is_visible(Point2::new(1.0, 0.0), 0.0));
}

#[test]
fn it_grows_stale_after_300_ms_or_two_and_a_half_periods() {
    let measured_at = Monotonic::from_nanos(1_000_000_000);
    for (period_ms, stale_ms) in [(0, 300), (40, 300), (120, 300), (200, 500), (1000, 2500)] {
        let is_stale = |age_ms| {
            let period = Duration::from_millis(period_ms);
            super::is_stale(
                measured_at,
                period,
                measured_at + Duration::from_millis(age_ms),
            )
        };
        assert!(!is_stale(stale_ms) && is_stale(stale_ms + 1), "{period_ms}");
    }
}

fn visible(near_m: f32, far_m: f32) -> VisibleRange {
    VisibleRange {
        near_m,
        far_m,
        reach_m: far_m,
        is_miss: false,
    }
}

#[test]
fn sectors_follow_each_other_around() {
    let mut last = 0;
    for step in 0..3600 {
        let angle_rad = f64::from(step) * 0.1_f64.to_radians();
        let at = sector(Vector2::new(libm::cos(angle_rad), libm::sin(angle_rad)));
        assert!(at == last || at == last + 1, "{step}");
        last = at;
    }
    assert_eq!(last, SECTORS - 1);
}

#[test]
fn adjoining_beams_leave_no_gap_and_cover_nothing_beside() {
    let mut coverage = Coverage::default();
    coverage.clear(Point2::new(5.0, -3.0));
    let degree = 1.0_f64.to_radians();
    for n in -45..=45 {
        let angle_rad = f64::from(n) * degree;
        let direction = Vector2::new(libm::cos(angle_rad), libm::sin(angle_rad));
        coverage.add_beam(direction, degree, visible(0.0, 2.0));
    }
    let sees = |angle_deg: f64, distance_m: f64| {
        let (sin, cos) = (
            libm::sin(angle_deg.to_radians()),
            libm::cos(angle_deg.to_radians()),
        );
        coverage.is_visible(
            Point2::new(5.0 + distance_m * cos, -3.0 + distance_m * sin),
            0.01,
        )
    };
    for tenth in -450..=450 {
        assert!(sees(f64::from(tenth) / 10.0, 1.99), "{tenth}");
        assert!(!sees(f64::from(tenth) / 10.0, 2.02), "{tenth}");
    }
    assert!(!sees(47.0, 1.0) && !sees(-47.0, 1.0) && !sees(180.0, 0.5));
}

#[test]
fn the_shorter_of_two_beams_counts() {
    let mut coverage = Coverage::default();
    let ahead = Vector2::new(1.0, 0.001);
    coverage.add_beam(ahead, 0.001, visible(0.5, 4.0));
    coverage.add_beam(ahead, 0.001, visible(0.2, 2.0));
    let sees = |x: f64| coverage.is_visible(Point2::new(x, 0.001 * x), 0.0);
    assert_eq!([0.3, 1.0, 3.0].map(sees), [false, true, false]);
    for bad in [Vector2::zeros(), Vector2::new(f64::NAN, 1.0)] {
        coverage.add_beam(bad, 0.01, visible(0.0, 100.0));
    }
    coverage.add_beam(Vector2::new(0.0, 1.0), f64::NAN, visible(0.0, f32::NAN));
    assert!(!coverage.is_visible(Point2::new(0.0, 1.0), 0.0));
}

/// A wall of 40,000 points, 3 m ahead of a sensor 1.08 m high, behind 20,000 points of ground and a crown of a tree above.
#[test]
fn a_dense_cloud_keeps_every_place_of_a_wall_and_shows_no_free_ground() {
    let setup = setup();
    let grid = |columns: i32, rows: i32| {
        (0..columns).flat_map(move |column| (0..rows).map(move |row| [column, row].map(f64::from)))
    };
    let ground = grid(200, 100).map(|[y, x]| [1.0 + 0.015 * x, 0.01 * (y - 100.0), 0.0]);
    let tree = grid(100, 10).map(|[y, z]| [2.0, 0.01 * (y - 50.0), 1.5 + 0.1 * z]);
    let wall = grid(400, 100).map(|[y, z]| [3.0, 0.005 * (y - 200.0), 0.15 + 0.01 * z]);
    let points = ground.chain(tree).chain(wall);
    let beams: Vec<_> = points
        .map(|end| beam(1.08, end, BeamOutcome::Hit))
        .collect();
    let mut scan = RegisteredScan {
        stamp: RobotTime::from_nanos(0),
        sensor: SensorId(0),
        beam_step_rad: 0.01,
        kind: ScanKind::Cloud,
        own_body_hits: 0,
        odom_from_base: planar(0.0, 0.0, 0.0),
        beams,
    };
    let now = Monotonic::from_nanos(0);
    let of_cloud = setup.obstacle_scan(&scan, now);
    let points = of_cloud.points_in_odom();
    assert!(
        (100..=101).contains(&points.len()),
        "2 m in steps of 2 cm: {}",
        points.len()
    );
    assert!(points.iter().all(|point| (point[0] - 3.0).abs() < 1e-9));
    assert!(of_cloud.is_stale(now), "the map shows free ground");
    // Without thinning the wall would end where there is no more room.
    scan.kind = ScanKind::Beams;
    let of_beams = setup.obstacle_scan(&scan, now);
    assert_eq!(of_beams.points_in_odom().len(), MAX_POINTS);
}
