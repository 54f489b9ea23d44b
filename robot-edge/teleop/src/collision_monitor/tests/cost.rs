//! How long a round takes. Not judged, for no machine is like another: run it with `--release --ignored --nocapture`.

use std::time::{Duration, Instant};

use nalgebra::Point2;

use super::world::*;
use crate::collision_monitor::{
    BlockageDetector, CollisionMonitor, CollisionMonitorInput, CopyRequest, LocalMap, ObstacleScan,
    OdometrySample,
};
use crate::motion::Velocity;
use mapping::ground_plane::GroundPlane;
use mapping::occupancy_grid::OccupancyConfig;
use mapping::occupancy_grid::OccupancyGrid;
use mapping::vehicle::VehicleConfig;
use measurement::pose::planar;
use measurement::time::Monotonic;

#[test]
#[ignore = "a measurement"]
#[expect(
    clippy::disallowed_methods,
    reason = "it measures time and judges nothing"
)]
fn a_round_of_1081_points_and_a_map_in_release() {
    let setup = Setup {
        vehicle: VehicleConfig {
            length_m: 1.5,
            width_m: 0.8,
            max_speed_mps: 1.5,
            ..VehicleConfig::default()
        },
        ..Setup::default()
    };
    let laser = Laser {
        mount_x_m: 0.65,
        beams: 1081,
        field_of_view_rad: 1.5 * std::f64::consts::PI,
        range_max_m: 20.0,
    };
    let pose = planar(0.0, 0.0, 0.0);
    let plane = GroundPlane::under(&pose);
    let rules = setup.rules();
    let measured_at = Monotonic::from_nanos(1_000_000_000);
    // A room that is so narrow that every point of it matters.
    let mut walls = vec![
        wall([-2.0, -0.7], [2.2, -0.7]),
        wall([2.2, -0.7], [2.2, 0.8]),
        wall([2.2, 0.8], [-2.0, 0.8]),
        wall([-2.0, 0.8], [-2.0, -0.7]),
    ];
    walls.extend(pillar([1.6, 0.5], 0.1));
    let scan = laser.scan(&walls, &pose);
    let mut obstacle_scan = ObstacleScan::default();
    let mut grid = OccupancyGrid::new(&OccupancyConfig::default());
    grid.integrate(&Laser::ALL_DIRECTIONS.scan(&walls, &pose));
    let mut map = LocalMap::default();
    let request = CopyRequest {
        measured_at,
        period: Duration::from_millis(200),
        centre: Point2::origin(),
        reach_m: rules.window_m(),
    };
    let mut guard = CollisionMonitor::new(rules);
    let rounds = 500;
    let mut worst = Duration::ZERO;
    let mut timed = |name: &str, of: &mut dyn FnMut(u32)| {
        let mut times: Vec<_> = (0..rounds)
            .map(|round| {
                let start = Instant::now();
                of(round);
                start.elapsed()
            })
            .collect();
        times.sort_unstable();
        let at =
            |share: f64| times[(share * f64::from(rounds - 1)) as usize].as_nanos() as f64 / 1000.0;
        println!("{name}: median {:.0} us, p99 {:.0} us", at(0.5), at(0.99));
        worst = worst.max(times[0]);
    };
    timed("sweep", &mut |_| {
        obstacle_scan.read(
            &scan,
            &plane,
            &rules,
            &BlockageDetector::default(),
            (measured_at, Duration::from_millis(40)),
        );
    });
    timed("map copy", &mut |_| map.copy_occupancy(&grid, request));
    let obstacle_scans = [obstacle_scan.clone()];
    for (name, velocity) in [
        ("standing", (0.0, 0.0)),
        ("straight on", (0.5, 0.0)),
        ("on an arc", (0.5, 0.3)),
        ("on an arc, to the other side", (0.5, -0.3)),
    ] {
        let moving = |share: f64| Velocity {
            linear_mps: share * velocity.0,
            angular_radps: velocity.1 * (2.0 * share - 1.0),
        };
        timed(name, &mut |round| {
            let now = measured_at + Duration::from_millis(u64::from(round % 10) * 20);
            let input = CollisionMonitorInput {
                obstacle_scans: &obstacle_scans,
                map: Some(&map),
                odometry: Some(OdometrySample {
                    odom_from_base: pose,
                    measured: moving(0.5),
                    measured_at: now,
                }),
                commanded: moving(0.7),
                requested: moving(1.0),
            };
            std::hint::black_box(guard.output(&input, now));
        });
    }
}
