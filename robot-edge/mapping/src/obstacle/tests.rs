use super::*;
use measurement::pose::{Pose, planar};
use measurement::time::RobotTime;
use proptest::prelude::*;

use crate::MappingConfig;
use crate::ground_plane::GroundPlane;
use crate::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, SensorId};

/// Sides of cells of their own, metres.
const OWN: [Option<(f64, Option<f64>)>; 4] = [
    None,
    Some((0.1, None)),
    Some((0.3, Some(0.2))),
    Some((0.25, Some(0.5))),
];

proptest! {
    /// Incremental updates equal a full copy of the window, whatever the cells' sizes: the worst class of
    /// the cells that a cell shares area with.
    #[test]
    fn updates_of_changed_cells_equal_a_full_copy(
        scans in prop::collection::vec(
            ((-1.0..1.0f64, -1.0..1.0f64),
             prop::collection::vec((-3.0..3.0f64, -3.0..3.0f64, -0.3..0.5f64), 0..12)),
            1..60,
        ),
        window in 5..30u32,
        (cell_y_m, own) in (prop::sample::select(vec![None, Some(0.4)]), prop::sample::select(OWN.to_vec())),
    ) {
        let mut config = MappingConfig::default();
        config.elevation.cells = 29;
        config.elevation.cell_y_m = cell_y_m;
        // Cells of another size that touch the edge of the elevation map may know what has left it.
        config.obstacle.cells = window.min(if own == OWN[0] { 29 } else { 9 });
        config.obstacle.cells_y = own.is_some().then_some(7);
        if let Some((x_m, y_m)) = own {
            (config.obstacle.cell_m, config.obstacle.cell_y_m) = (Some(x_m), y_m);
        }
        let mut elevation = ElevationMap::new(&config.elevation, &config.obstacle, &config.ground);
        let mut obstacle = ObstacleMap::new(&config.obstacle, &config.elevation);
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
                let shares_area = |at: CellIndex| {
                    let pairs = obstacle.size().sides_m().into_iter().zip(elevation.size().sides_m());
                    pairs.zip([(cell.x, at.x), (cell.y, at.y)]).all(|((own_m, side_m), (own, at))| {
                        let [own, at] = [(own, own_m), (at, side_m)].map(|(index, side_m)| {
                            [f64::from(index) * side_m, f64::from(index + 1) * side_m]
                        });
                        own[1].min(at[1]) - own[0].max(at[0]) > 1e-4
                    })
                };
                let below = elevation.grid().iter().filter(|(at, _)| shares_area(*at));
                let worst = below.map(|(_, cell)| cell.class()).max();
                prop_assert_eq!(Some(class), worst, "{:?} after scan {}", cell, n);
            }
        }
    }
}
