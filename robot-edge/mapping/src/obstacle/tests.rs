use super::*;
use measurement::pose::{Pose, planar};
use measurement::time::RobotTime;
use proptest::prelude::*;

use crate::ground_plane::GroundPlane;
use crate::octree::RangeSensorModel;
use crate::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, ScanKind, SensorId};
use crate::terrain::Terrain;
use crate::vehicle::VehicleConfig;
use crate::{Mapper, MappingConfig};

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
                kind: ScanKind::Beams,
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

/// Terrain of 0.2 m cells around a vehicle 0.8 m wide.
fn terrain() -> Terrain {
    let mut config = MappingConfig::default();
    config.elevation.forget_s = 10.0;
    let shape = VehicleConfig {
        width_m: 0.8,
        ..VehicleConfig::default()
    };
    Terrain::new(&config, shape.shape(), &[])
}

/// A scan at `time_s` of a vehicle at the origin, from 0.4 m above it to `ends`.
fn scan_of(kind: ScanKind, time_s: f64, ends: &[[f64; 3]]) -> RegisteredScan {
    let beams = (0..).zip(ends).map(|(index, &end)| RegisteredBeam {
        origin_in_odom: [0.0, 0.0, 0.4].into(),
        end_in_odom: end.into(),
        outcome: BeamOutcome::Hit,
        index,
        range_m: 1.0,
    });
    RegisteredScan {
        stamp: RobotTime::from_secs_f64(time_s).unwrap(),
        sensor: SensorId(0),
        kind,
        beam_step_rad: 0.02,
        own_body_hits: 0,
        odom_from_base: Pose::identity(),
        beams: beams.collect(),
    }
}

fn class_at(terrain: &Terrain, x_m: f64, y_m: f64) -> CellClass {
    let cell = CellIndex::containing(Point2::new(x_m, y_m), 0.2);
    let class = terrain.obstacle().grid().get(cell);
    class.copied().unwrap_or(CellClass::Unknown)
}

const ARC: [[f64; 3]; 3] = [[1.5, -0.3, 0.4], [1.55, 0.05, 0.4], [1.5, 0.3, 0.4]];

#[test]
fn an_arc_is_an_obstacle_that_no_beam_clears_until_it_is_forgotten() {
    let mut terrain = terrain();
    // The ground on both sides of a pane, seen through it.
    let ground: Vec<_> = (0..40)
        .map(|n| [0.6 + 0.1 * f64::from(n), 0.05, 0.0])
        .collect();
    let beams = |time_s| scan_of(ScanKind::Beams, time_s, &ground);
    terrain.integrate(&beams(1.0));
    assert_eq!(class_at(&terrain, 1.55, 0.05), CellClass::Free);
    terrain.mark_arc(&scan_of(ScanKind::Arc, 1.1, &ARC));
    for [x_m, y_m, _] in ARC {
        assert_eq!(class_at(&terrain, x_m, y_m), CellClass::Obstacle);
    }
    let of_elevation = CellIndex::containing(Point2::new(1.55, 0.05), 0.2);
    assert_eq!(terrain.elevation().class(of_elevation), CellClass::Free);
    terrain.obstacle_mut().take_changed();
    terrain.integrate(&beams(11.0));
    assert_eq!(class_at(&terrain, 1.55, 0.05), CellClass::Obstacle);
    terrain.integrate(&beams(11.2));
    assert_eq!(class_at(&terrain, 1.55, 0.05), CellClass::Free);
    assert_eq!(class_at(&terrain, 1.5, -0.3), CellClass::Unknown);
    assert_eq!(terrain.obstacle_mut().take_changed().len(), 3);
}

#[test]
fn an_arc_wider_than_the_vehicle_is_not_mapped() {
    let mut terrain = terrain();
    terrain.integrate(&scan_of(ScanKind::Beams, 1.0, &[[1.0, 0.0, 0.0]]));
    let wide = ARC.map(|[x, y, z]| [x, 1.4 * y, z]);
    terrain.mark_arc(&scan_of(ScanKind::Arc, 1.1, &wide));
    assert_eq!(class_at(&terrain, 1.55, 0.05), CellClass::Unknown);
}

#[test]
fn arcs_reach_the_obstacle_map_alone_and_contacts_every_layer() {
    let mut config = MappingConfig::default();
    config.elevation.enabled = true;
    config.octree.enabled = true;
    let shape = VehicleConfig {
        width_m: 0.8,
        ..VehicleConfig::default()
    };
    let models = [RangeSensorModel {
        min_neighbours: 0,
        ..RangeSensorModel::default()
    }];
    let knows = |scan: &RegisteredScan| {
        let mut mapper = Mapper::new(&config, shape.shape(), &models);
        mapper.integrate(&scan_of(ScanKind::Beams, 1.0, &[]));
        let report = mapper.integrate(scan);
        assert_eq!((report.hits, report.misses), (0, 0));
        let cell = |cell_m| CellIndex::containing(Point2::new(1.55, 0.05), cell_m);
        let occupancy = mapper.occupancy().unwrap();
        let octree = mapper.voxels().unwrap().octree();
        [
            class_at(mapper.terrain().unwrap(), 1.55, 0.05) == CellClass::Obstacle,
            occupancy
                .cell(cell(occupancy.cell_m()))
                .probability()
                .is_some_and(|p| p > 0.5),
            octree.occupied().count() > 0,
        ]
    };
    assert_eq!(
        knows(&scan_of(ScanKind::Arc, 1.1, &ARC)),
        [true, false, false]
    );
    let contact = ScanKind::Contact { width_m: 0.6 };
    let touched = [[1.55, 0.05, 0.4], [1.56, 0.06, 0.4]];
    assert_eq!(knows(&scan_of(contact, 1.1, &touched)), [true; 3]);
    assert_eq!(knows(&scan_of(contact, 1.1, &[])), [false; 3]);
}
