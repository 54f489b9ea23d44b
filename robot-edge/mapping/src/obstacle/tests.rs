use super::*;
use measurement::pose::{Pose, planar};
use measurement::time::RobotTime;
use proptest::prelude::*;

use crate::MappingConfig;
use crate::ground_plane::GroundPlane;
use crate::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, SensorId};

proptest! {
    /// Incremental updates equal a full copy of the window.
    #[test]
    fn updates_of_changed_cells_equal_a_full_copy(
        scans in prop::collection::vec(
            ((-1.0..1.0f64, -1.0..1.0f64),
             prop::collection::vec((-3.0..3.0f64, -3.0..3.0f64, -0.3..0.5f64), 0..12)),
            1..60,
        ),
        window in 5..30u32,
    ) {
        let mut config = MappingConfig::default();
        config.elevation.cells = 29;
        config.obstacle.cells = window.min(29);
        let mut elevation = ElevationMap::new(&config.elevation, &config.obstacle, &config.ground);
        let mut obstacle = ObstacleMap::new(&config.obstacle);
        let plane = GroundPlane::under(&Pose::identity());
        let (mut x_m, mut y_m) = (0.0, 0.0);
        for (n, ((dx_m, dy_m), points)) in (0i64..).zip(scans) {
            (x_m, y_m) = (x_m + dx_m, y_m + dy_m);
            let odom_from_base = planar(x_m, y_m, 0.0);
            let beams = (0..).zip(points).map(|(index, (x, y, z))| RegisteredBeam {
                origin_in_odom: [x_m, y_m, 1.0].into(),
                end_in_odom: [x_m + x, y_m + y, z].into(),
                outcome: BeamOutcome::Hit,
                index,
                range_m: 1.0,
            });
            let scan = RegisteredScan {
                stamp: RobotTime::from_nanos(40_000_000 * n),
                sensor: SensorId(0),
                beam_step_rad: 0.004,
                own_body_hits: 0,
                odom_from_base,
                beams: beams.collect(),
            };
            elevation.integrate(&scan, &plane);
            obstacle.update(&elevation, Point2::new(x_m, y_m));
            for (cell, &class) in obstacle.grid().iter() {
                prop_assert_eq!(class, elevation.class(cell), "{:?} after scan {}", cell, n);
            }
        }
    }
}
