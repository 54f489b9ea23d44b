use std::collections::BTreeMap;

use super::*;
use measurement::pose::Pose;
use measurement::time::RobotTime;
use nalgebra::Point3;
use proptest::prelude::*;

use crate::registered_scan::{RegisteredBeam, ScanKind, SensorId};

/// Start, end and outcome of a beam.
type Beam = ((f64, f64), (f64, f64), BeamOutcome);

fn scan(beams: &[Beam]) -> RegisteredScan {
    let point = |(x, y)| Point3::new(x, y, 0.0);
    RegisteredScan {
        stamp: RobotTime::from_nanos(0),
        sensor: SensorId(0),
        beam_step_rad: 0.004,
        kind: ScanKind::Beams,
        own_body_hits: 0,
        odom_from_base: Pose::identity(),
        beams: beams
            .iter()
            .zip(0..)
            .map(|(&(origin, end, outcome), index)| RegisteredBeam {
                origin_in_odom: point(origin),
                end_in_odom: point(end),
                outcome,
                index,
                range_m: 1.0,
            })
            .collect(),
    }
}

fn grid(cell_m: f64, miss: Miss) -> OccupancyGrid {
    OccupancyGrid::new(&OccupancyConfig {
        cell_m,
        miss,
        ..OccupancyConfig::default()
    })
}

fn p(grid: &OccupancyGrid, x: i32, y: i32) -> Option<f64> {
    grid.cell(CellIndex { x, y })
        .probability()
        .map(|p| (p * 1000.0).round() / 1000.0)
}

#[test]
fn a_cell_is_updated_once_per_scan_and_a_hit_wins() {
    let mut grid = grid(1.0, Miss::Unknown);
    // Ten beams graze the wall cell (5, 0) on their way to (9, 0); one ends in it.
    let mut beams = vec![((0.5, 0.5), (9.5, 0.6), BeamOutcome::Hit); 10];
    beams.push(((0.5, 0.5), (5.5, 0.5), BeamOutcome::Hit));
    let report = grid.integrate(&scan(&beams));
    assert_eq!(
        report,
        OccupancyReport {
            hits: 11,
            misses: 0,
            out_of_bounds: 0
        }
    );
    assert_eq!(p(&grid, 0, 0), Some(0.3));
    assert_eq!(p(&grid, 5, 0), Some(0.6));
    assert_eq!(p(&grid, 9, 0), Some(0.6));
    assert_eq!(p(&grid, 10, 0), None);
}

#[test]
fn misses_free_cells_only_if_configured() {
    let beams = scan(&[((0.5, 0.5), (3.5, 0.5), BeamOutcome::Miss)]);
    let mut doubting = grid(1.0, Miss::Unknown);
    assert_eq!(doubting.integrate(&beams).misses, 1);
    assert_eq!(p(&doubting, 0, 0), None);
    let mut trusting = grid(1.0, Miss::Free);
    trusting.integrate(&beams);
    assert_eq!(
        [0, 3, 4].map(|x| p(&trusting, x, 0)),
        [Some(0.3), Some(0.3), None]
    );
}

#[test]
fn senseless_beams_are_counted_and_mark_nothing() {
    let mut grid = grid(0.1, Miss::Free);
    let report = grid.integrate(&scan(&[
        ((0.0, 0.0), (f64::NAN, 0.0), BeamOutcome::Hit),
        ((0.0, 0.0), (500.0, 0.0), BeamOutcome::Hit),
        ((1e12, 0.0), (1e12, 1.0), BeamOutcome::Miss),
        ((0.05, 0.05), (0.15, 0.05), BeamOutcome::Hit),
        ((1e5, 0.0), (1e5, 1.0), BeamOutcome::Hit),
    ]));
    assert_eq!(
        report,
        OccupancyReport {
            hits: 1,
            misses: 1,
            out_of_bounds: 4
        }
    );
    assert_eq!(grid.grid().tiles().len(), 1);
    assert_eq!(p(&grid, 1, 0), Some(0.6));
}

#[test]
fn the_memory_limit_keeps_what_is_near() {
    let config = OccupancyConfig {
        cell_m: 0.1,
        memory_limit_mb: 1,
        ..OccupancyConfig::default()
    };
    let mut grid = OccupancyGrid::new(&config);
    let mut evicted = 0;
    for i in 0..400 {
        let x = f64::from(i) * 6.4 + 1.0;
        grid.integrate(&scan(&[((x, 1.0), (x + 0.5, 1.0), BeamOutcome::Hit)]));
        grid.take_changed();
        evicted += grid.enforce_memory_limit(&Point3::new(x, 1.0, 0.0));
    }
    assert_eq!(
        (grid.grid().tiles().len(), grid.bytes(), evicted),
        (120, 120 * 8192, 400 - 120)
    );
    assert_eq!(p(&grid, 399 * 64 + 15, 10), Some(0.6));
}

/// Reference: the same rules, cell by cell, in floating point.
fn reference(scans: &[RegisteredScan], cell_m: f64) -> BTreeMap<(i32, i32), f64> {
    let logit = |p: f64| libm::log(p / (1.0 - p));
    let mut cells = BTreeMap::new();
    for scan in scans {
        let mut marks = BTreeMap::new();
        for beam in &scan.beams {
            let fixed = |p: &Point3<f64>| FixedPoint::from_metres(p.x, p.y, cell_m).unwrap();
            let (start, end) = (fixed(&beam.origin_in_odom), fixed(&beam.end_in_odom));
            let walk = crate::scan_marks::RayWalk::new(start, end);
            let (mut cell, mut error) = (start.cell(), walk.error);
            for _ in 0..walk.steps {
                marks.entry(cell).or_insert(false);
                if error < 0 {
                    cell.0 += walk.step_x;
                    error += walk.error_after_x;
                } else {
                    cell.1 += walk.step_y;
                    error -= walk.error_after_y;
                }
            }
            marks.insert(end.cell(), true);
        }
        for (cell, hit) in marks {
            let odds = cells.entry(cell).or_insert(0.0f64);
            let sum = *odds + logit(if hit { 0.6 } else { 0.3 });
            *odds = sum.clamp(logit(0.02), logit(0.98));
        }
    }
    cells
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn the_grid_equals_the_reference(
        scans in prop::collection::vec(
            (-30.0..30.0f64, -30.0..30.0f64,
             prop::collection::vec((-25.0..25.0f64, -25.0..25.0f64), 1..40)),
            1..12),
        cell_m in prop::sample::select(vec![0.05, 0.1, 0.2, 0.5]),
    ) {
        let scans: Vec<_> = scans
            .iter()
            .map(|(x, y, ends)| {
                let beams: Vec<_> = ends
                    .iter()
                    .map(|(dx, dy)| ((*x, *y), (x + dx, y + dy), BeamOutcome::Hit))
                    .collect();
                scan(&beams)
            })
            .collect();
        let mut grid = grid(cell_m, Miss::Unknown);
        for scan in &scans {
            grid.integrate(scan);
        }
        let expected = reference(&scans, cell_m);
        let known: usize = grid
            .grid()
            .tiles()
            .map(|tile| tile.cells.iter().filter(|cell| **cell != i16::MIN).count())
            .sum();
        prop_assert_eq!(known, expected.len());
        for (&(x, y), &odds) in &expected {
            let got = f64::from(grid.cell(CellIndex { x, y }).steps()) / 4096.0;
            prop_assert!((got - odds).abs() < 0.01, "({x}, {y}): {got} instead of {odds}");
        }
    }
}

/// A lidar 2 m above the ground, observed from 0.2 m to 1.5 m.
#[test]
fn clouds_are_observed_between_two_heights() {
    let observed = |end: [f64; 3]| {
        let mut grid = grid(1.0, Miss::Unknown);
        let mut scan = scan(&[((0.5, 0.5), (end[0], end[1]), BeamOutcome::Hit)]);
        scan.kind = ScanKind::Cloud;
        scan.beams[0].origin_in_odom.z = 2.0;
        scan.beams[0].end_in_odom.z = end[2];
        let report = grid.integrate(&scan);
        assert_eq!((report.hits, report.misses), (1, 0));
        let cells: Vec<_> = (0..11).map(|x| p(&grid, x, 0)).collect();
        cells
    };
    let (free, hit) = (Some(0.3), Some(0.6));
    // From 1.5 m, a quarter of the way, on it is low enough.
    let wall = observed([10.5, 0.5, 0.3]);
    assert_eq!(wall[..2], [None, None]);
    assert_eq!(wall[5..], [free, free, free, free, free, hit]);
    // On the ground it is too low from 90 % of the way on.
    let ground = observed([10.5, 0.5, 0.0]);
    assert_eq!(ground[2..4], [None, free]);
    assert_eq!(ground[9..], [free, None]);
    let crown_of_a_tree = observed([10.5, 0.5, 3.0]);
    assert_eq!(crown_of_a_tree, [None; 11]);
}

/// Two rings in one column: the ground rises by 14 % at most.
#[test]
fn of_a_cloud_a_ramp_ahead_is_free_and_a_box_is_occupied() {
    for (far_z_m, expected) in [(0.6, Some(0.3)), (0.8, Some(0.6))] {
        let mut grid = grid(1.0, Miss::Unknown);
        grid.ignore_slopes(0.14);
        let near = ((0.5, 0.5), (2.5, 0.5), BeamOutcome::Hit);
        let mut scan = scan(&[near, ((0.5, 0.5), (5.5, 0.5), BeamOutcome::Hit)]);
        scan.kind = ScanKind::Cloud;
        let columns = (std::f64::consts::TAU / scan.beam_step_rad).round() as u32;
        for (beam, (ring, z_m)) in scan.beams.iter_mut().zip([(0, 0.25), (1, far_z_m)]) {
            beam.index = ring * (columns + 2);
            beam.origin_in_odom.z = 1.0;
            beam.end_in_odom.z = z_m;
        }
        grid.integrate(&scan);
        assert_eq!(p(&grid, 5, 0), expected, "{far_z_m}");
        assert_eq!(p(&grid, 2, 0), Some(0.3));
    }
}
