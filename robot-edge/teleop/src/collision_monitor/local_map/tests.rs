use super::*;
use mapping::occupancy_grid::OccupancyConfig;
use mapping::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, ScanKind, SensorId};
use measurement::pose::planar;
use measurement::time::RobotTime;

fn request(x: f64, y: f64, reach_m: f64) -> CopyRequest {
    CopyRequest {
        measured_at: Monotonic::from_nanos(0),
        period: Duration::from_millis(200),
        centre: Point2::new(x, y),
        reach_m,
    }
}

#[test]
fn an_occupancy_grid_is_copied_around_the_vehicle() {
    let mut grid = OccupancyGrid::new(&OccupancyConfig::default());
    let end = nalgebra::Point3::new(-8.05, 4.05, 0.0);
    let beam = RegisteredBeam {
        origin_in_odom: nalgebra::Point3::new(-10.0, 4.0, 0.0),
        end_in_odom: end,
        outcome: BeamOutcome::Hit,
        index: 0,
        range_m: 2.0,
    };
    let scan = RegisteredScan {
        stamp: RobotTime::from_nanos(0),
        sensor: SensorId(0),
        beam_step_rad: 0.01,
        kind: ScanKind::Beams,
        own_body_hits: 0,
        odom_from_base: planar(-10.0, 4.0, 0.0),
        beams: vec![beam],
    };
    for _ in 0..3 {
        grid.integrate(&scan);
    }
    let mut map = LocalMap::default();
    map.copy_occupancy(&grid, request(-9.0, 4.0, 1.5));
    assert_eq!(map.class_at(end.xy()), CellClass::Obstacle);
    assert_eq!(map.class_at(Point2::new(-9.0, 4.04)), CellClass::Free);
    assert_eq!(map.class_at(Point2::new(-9.0, 3.5)), CellClass::Unknown);
    assert_eq!(map.class_at(Point2::new(-12.0, 4.0)), CellClass::Unknown);
    let obstacles: Vec<_> = map.obstacles().collect();
    assert_eq!(obstacles.len(), 1);
    let (index_of, centre) = obstacles[0];
    assert!((centre - end.xy()).norm() < 1e-9);
    assert_eq!(map.index_of(centre), Some(index_of));
}

#[test]
fn what_makes_no_sense_is_an_empty_map() {
    let grid = OccupancyGrid::new(&OccupancyConfig::default());
    let mut map = LocalMap::default();
    for (x, reach_m) in [
        (f64::NAN, 1.0),
        (0.0, f64::NAN),
        (0.0, f64::INFINITY),
        (f64::INFINITY, 1.0),
    ] {
        map.copy_occupancy(&grid, request(x, 0.0, reach_m));
        assert!(map.is_empty() && map.obstacles().next().is_none());
        assert_eq!(map.class_at(Point2::origin()), CellClass::Unknown);
    }
    map.copy_occupancy(&grid, request(1e300, -1e300, 1e9));
    assert_eq!(map.len(), 511 * 511);
    map.copy_occupancy(&grid, request(0.0, 0.0, -1.0));
    assert_eq!(map.len(), 1);
}
