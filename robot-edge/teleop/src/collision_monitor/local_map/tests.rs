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
        map_from_odom: Isometry2::identity(),
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

/// A loop was closed: the map lies elsewhere in `odom`, and turned. Posts of one cell each.
#[test]
fn of_a_map_that_was_moved_no_obstacle_is_lost() {
    let mut grid = OccupancyGrid::new(&OccupancyConfig::default());
    let posts: Vec<_> = (0..100)
        .map(|n| {
            Point2::new(
                0.05 + 0.3 * f64::from(n % 10),
                0.05 + 0.3 * f64::from(n / 10),
            )
        })
        .collect();
    let beams = posts.iter().map(|post| RegisteredBeam {
        origin_in_odom: nalgebra::Point3::new(post.x - 0.1, post.y, 0.0),
        end_in_odom: nalgebra::Point3::new(post.x, post.y, 0.0),
        outcome: BeamOutcome::Hit,
        index: 0,
        range_m: 0.1,
    });
    let scan = RegisteredScan {
        stamp: RobotTime::from_nanos(0),
        sensor: SensorId(0),
        beam_step_rad: 0.01,
        kind: ScanKind::Beams,
        own_body_hits: 0,
        odom_from_base: planar(0.0, 0.0, 0.0),
        beams: beams.collect(),
    };
    for _ in 0..3 {
        grid.integrate(&scan);
    }
    for degrees in 1..90 {
        let map_from_odom =
            Isometry2::new(Vector2::new(0.33, -0.21), f64::from(degrees).to_radians());
        let odom_from_map = map_from_odom.inverse();
        let centre = odom_from_map * Point2::new(1.5, 1.5);
        let mut map = LocalMap::default();
        let request = CopyRequest {
            map_from_odom,
            ..request(centre.x, centre.y, 3.0)
        };
        map.copy_occupancy(&grid, request);
        for post in &posts {
            assert_eq!(
                map.class_at(odom_from_map * post),
                CellClass::Obstacle,
                "{degrees}° {post}"
            );
        }
        // Of cells of 0.1 m, one post makes four at most.
        assert!(map.obstacles().count() <= 4 * posts.len(), "{degrees}°");
    }
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

/// A boat that draws 0.6 m over a bed that rises along x.
#[test]
fn mapped_water_that_is_too_shallow_is_an_obstacle() {
    use mapping::MappingConfig;
    use mapping::cost_map::Surface;
    use mapping::octree::RangeSensorModel;
    use mapping::vehicle::VehicleShape;
    use mapping::voxel_layers::VoxelLayers;

    let mut config = MappingConfig::default();
    config.octree.enabled = true;
    config.octree.cell_m = 0.3;
    config.octree.p_max = 0.6;
    config.cost.enabled = true;
    config.cost.surface = Surface::Water;
    let sonar = RangeSensorModel {
        min_neighbours: 0,
        has_metrics: false,
        ..RangeSensorModel::default()
    };
    let boat = VehicleShape {
        height_m: 2.0,
        bottom_z_m: -0.6,
        length_m: 4.0,
        width_m: 2.0,
        wheelbase_m: 4.0,
    };
    let mut voxels = VoxelLayers::new(&config, boat, &[sonar]);
    let bed = |cell: u32| {
        nalgebra::Point3::new(
            0.15 + 0.3 * f64::from(cell),
            0.15,
            -2.0 + 0.1 * f64::from(cell),
        )
    };
    let beam = |index: u32| RegisteredBeam {
        origin_in_odom: nalgebra::Point3::new(0.15, 0.15, -0.5),
        end_in_odom: bed(index),
        outcome: BeamOutcome::Hit,
        index,
        range_m: 2.0,
    };
    voxels.integrate(&RegisteredScan {
        kind: mapping::registered_scan::ScanKind::Beams,
        stamp: RobotTime::from_nanos(0),
        sensor: SensorId(0),
        beam_step_rad: 0.01,
        own_body_hits: 0,
        odom_from_base: planar(0.0, 0.0, 0.0),
        beams: (0..13).map(beam).collect(),
    });
    let shallow = |least_m: Option<f64>| {
        let mut map = LocalMap::default();
        let depth = voxels.depth().zip(least_m);
        map.copy_costs(
            voxels.cost().unwrap(),
            depth,
            &[],
            0.3,
            request(2.0, 0.0, 3.0),
        );
        let is_obstacle = |cell: &u32| map.class_at(bed(*cell).xy()) == CellClass::Obstacle;
        (0..13).filter(is_obstacle).collect::<Vec<_>>()
    };
    // The bed is 2.0 m, 1.9 m … 0.8 m deep.
    assert_eq!(shallow(None), [0_u32; 0]);
    assert_eq!(shallow(Some(0.75)), [0_u32; 0]);
    assert_eq!(shallow(Some(1.05)), [10, 11, 12]);
}
