use super::*;
use nalgebra::Translation3;

use crate::elevation::CellClass;
use crate::registered_scan::{RegisteredBeam, ScanKind, SensorId};

const SENSOR: Point3<f64> = Point3::new(0.25, 0.0, 1.08);

fn map(cells: u32) -> ElevationMap {
    map_of(cells, &GroundConfig::default())
}

fn local_map(cells: u32) -> ElevationMap {
    let local = GroundConfig {
        reference: GroundReference::Local,
        ..GroundConfig::default()
    };
    map_of(cells, &local)
}

fn map_of(cells: u32, ground: &GroundConfig) -> ElevationMap {
    let elevation = ElevationConfig {
        cells,
        cell_m: 0.2,
        ..ElevationConfig::default()
    };
    ElevationMap::new(&elevation, &ObstacleConfig::default(), ground)
}

/// A scan at `time_s` of a vehicle at `x_m` whose beams hit `points`.
fn scan(time_s: f64, x_m: f64, points: &[[f64; 3]]) -> RegisteredScan {
    let odom_from_base = Pose::from_parts(
        Translation3::new(x_m, 0.0, 0.0),
        nalgebra::UnitQuaternion::identity(),
    );
    RegisteredScan {
        stamp: RobotTime::from_secs_f64(time_s).unwrap(),
        sensor: SensorId(0),
        beam_step_rad: 0.004,
        kind: ScanKind::Beams,
        own_body_hits: 0,
        odom_from_base,
        beams: points
            .iter()
            .zip(0..)
            .map(|(&point, index)| RegisteredBeam {
                origin_in_odom: odom_from_base * SENSOR,
                end_in_odom: point.into(),
                outcome: BeamOutcome::Hit,
                index,
                range_m: 1.0,
            })
            .collect(),
    }
}

fn ground() -> GroundPlane {
    GroundPlane::under(&Pose::identity())
}

fn class_at(map: &ElevationMap, x_m: f64, y_m: f64) -> CellClass {
    map.class(CellIndex::containing(Point2::new(x_m, y_m), 0.2))
}

/// Where a beam that passes `x_m` at `height_m` meets the ground.
fn ground_behind(x_m: f64, height_m: f64) -> f64 {
    SENSOR.x + (x_m - SENSOR.x) * SENSOR.z / (SENSOR.z - height_m)
}

#[test]
fn points_become_statistics_and_classes() {
    let mut map = map(101);
    let points = [
        [5.1, 0.1, 0.02],
        [5.1, 0.1, 0.04],
        [6.1, 0.1, 0.5],
        [6.1, 0.1, 0.7],
        [99.0, 0.0, 0.0],
    ];
    let report = map.integrate(&scan(1.0, 0.0, &points), &ground());
    assert_eq!((report.points, report.outside), (4, 1));
    let cell = map.grid().get(CellIndex { x: 25, y: 0 }).unwrap();
    assert!((cell.mean_m().unwrap() - 0.03).abs() < 1e-6);
    assert_eq!((cell.points(), cell.scans()), (2, 1));
    assert_eq!(cell.last_seen_ms(), 0, "the first scan");
    assert_eq!(class_at(&map, 5.1, 0.1), CellClass::Free);
    assert_eq!(class_at(&map, 6.1, 0.1), CellClass::Obstacle);
    assert_eq!(class_at(&map, 7.1, 0.1), CellClass::Unknown);
    assert_eq!(map.take_changed().len(), 2);
}

#[test]
fn the_window_and_its_cells_may_be_oblong() {
    let elevation = ElevationConfig {
        cell_y_m: Some(0.5),
        cells: 51,
        cells_y: Some(11),
        ..ElevationConfig::default()
    };
    let settings = (ObstacleConfig::default(), GroundConfig::default());
    let mut map = ElevationMap::new(&elevation, &settings.0, &settings.1);
    // x from -5.0 to 5.2, y from -2.5 to 3.0.
    let person = [[3.1, 2.6, 0.3], [3.1, 2.9, 0.7]];
    let outside = [[5.3, 0.0, 0.0], [0.0, -2.6, 0.0], [0.0, 3.1, 0.0]];
    let report = map.integrate(
        &scan(0.0, 0.0, &[&person[..], &outside].concat()),
        &ground(),
    );
    assert_eq!((report.points, report.outside), (2, 3));
    let cell = CellIndex { x: 15, y: 5 };
    assert_eq!(map.grid().get(cell).unwrap().points(), 2);
    assert_eq!(map.class(cell), CellClass::Obstacle);
    // Beams through the cell, to the ground behind it, clear it; those through the next row do not.
    for (through_y_m, expected) in [(2.2, CellClass::Obstacle), (2.75, CellClass::Unknown)] {
        for n in 1..=80 {
            let x_m = ground_behind(3.1, 0.3);
            let y_m = through_y_m * (x_m - SENSOR.x) / (3.1 - SENSOR.x);
            map.integrate(
                &scan(f64::from(n) * 0.04, 0.0, &[[x_m, y_m, 0.0]]),
                &ground(),
            );
        }
        assert_eq!(map.class(cell), expected, "{through_y_m}");
    }
}

#[test]
fn stationary_vehicle_clears_a_person_who_left() {
    let mut map = map(101);
    let ground_m = ground_behind(4.1, 0.5);
    let person = [[4.1, 0.1, 0.5]; 8];
    let beyond = [[ground_m, 0.1 * ground_m / 4.1, 0.0]; 8];
    map.integrate(&scan(0.0, 0.0, &[[4.1, 0.1, 0.0]]), &ground());
    for n in 1..=40 {
        map.integrate(&scan(0.04 * f64::from(n), 0.0, &person), &ground());
    }
    assert_eq!(class_at(&map, 4.1, 0.1), CellClass::Obstacle);
    for n in 41..=44 {
        map.integrate(&scan(0.04 * f64::from(n), 0.0, &beyond), &ground());
        assert_eq!(class_at(&map, 4.1, 0.1), CellClass::Obstacle, "scan {n}");
    }
    let report = map.integrate(&scan(1.8, 0.0, &beyond), &ground());
    assert_eq!(report.cleared, 1);
    assert_eq!(
        class_at(&map, 4.1, 0.1),
        CellClass::Free,
        "its ground had been seen"
    );
}

#[test]
fn a_hit_restarts_the_clearing_count() {
    let mut map = map(101);
    let ground_m = ground_behind(4.1, 0.5);
    let (pole, beyond) = (
        [[4.1, 0.1, 0.5]; 8],
        [[ground_m, 0.1 * ground_m / 4.1, 0.0]; 8],
    );
    for n in 0..60 {
        let points = if n % 5 == 0 { &pole } else { &beyond };
        map.integrate(&scan(0.04 * f64::from(n), 0.0, points), &ground());
    }
    assert_eq!(class_at(&map, 4.1, 0.1), CellClass::Obstacle);
}

/// Beams rise over a box while the vehicle drives on; the rule of \[LOD\] erases it here.
#[test]
fn a_box_stays_when_the_beams_rise_over_its_top() {
    let mut map = map(101);
    let mut hits = 0;
    for n in 0..900 {
        let x_m = 0.008 * f64::from(n);
        let height_m = SENSOR.z - (8.3 - x_m - SENSOR.x) * libm::tan(7.5f64.to_radians());
        let on_box = (0.0..0.15).contains(&height_m);
        hits += u32::from(on_box);
        let end = if on_box {
            [8.3, 0.1, height_m]
        } else {
            [
                x_m + SENSOR.x + SENSOR.z / libm::tan(7.5f64.to_radians()),
                0.1,
                0.0,
            ]
        };
        map.integrate(&scan(0.04 * f64::from(n), x_m, &[end; 8]), &ground());
    }
    assert!(hits > 100, "{hits}");
    assert_eq!(class_at(&map, 8.3, 0.1), CellClass::Obstacle);
}

#[test]
fn what_was_glimpsed_is_forgotten_and_ground_is_not() {
    let mut map = map(101);
    let elsewhere = [[1.1, 1.1, 0.0]];
    map.integrate(&scan(0.0, 0.0, &elsewhere), &ground());
    let glimpse = [[4.1, 0.1, 0.5], [4.1, 0.1, 0.5], [2.1, 0.1, 0.0]];
    map.integrate(&scan(2.0, 0.0, &glimpse), &ground());
    map.integrate(&scan(12.0, 0.0, &elsewhere), &ground());
    assert_eq!(class_at(&map, 4.1, 0.1), CellClass::Obstacle);
    map.integrate(&scan(12.1, 0.0, &elsewhere), &ground());
    assert_eq!(class_at(&map, 4.1, 0.1), CellClass::Unknown);
    assert_eq!(class_at(&map, 2.1, 0.1), CellClass::Free);
}

#[test]
fn initial_obstacles_are_not_forgotten() {
    let mut map = map(101);
    map.integrate(&scan(0.0, 0.0, &[[4.1, 0.1, 0.5]; 2]), &ground());
    map.integrate(&scan(60.0, 0.0, &[[1.1, 1.1, 0.0]]), &ground());
    assert_eq!(class_at(&map, 4.1, 0.1), CellClass::Obstacle);
}

#[test]
fn without_compensation_pitch_creates_a_false_wall() {
    let ground_config = GroundConfig {
        compensation: false,
        ..GroundConfig::default()
    };
    let mut without = ElevationMap::new(
        &ElevationConfig::default(),
        &ObstacleConfig::default(),
        &ground_config,
    );
    let mut with = map(101);
    let mut pitched = scan(0.0, 0.0, &[[6.1, 0.1, 0.0]; 2]);
    pitched.odom_from_base.rotation =
        nalgebra::UnitQuaternion::from_euler_angles(0.0, 2.5f64.to_radians(), 0.0);
    with.integrate(&pitched, &ground());
    without.integrate(&pitched, &ground());
    assert_eq!(class_at(&with, 6.1, 0.1), CellClass::Free);
    let raised = without
        .grid()
        .iter()
        .find(|(_, cell)| cell.is_known())
        .unwrap();
    assert!(
        (raised.1.mean_m().unwrap() - 0.266).abs() < 1e-3,
        "{raised:?}"
    );
    assert_eq!(raised.1.class(), CellClass::Obstacle);
}

#[test]
fn a_gentle_gradient_is_local_ground_and_a_kerb_on_it_is_not() {
    let rise = libm::tan(3f64.to_radians());
    let height_m = |x_m: f64| rise * x_m + if x_m > 8.0 { 0.15 } else { 0.0 };
    let sweep = |reference| {
        let config = GroundConfig {
            reference,
            ..GroundConfig::default()
        };
        let elevation = ElevationConfig {
            cells: 201,
            ..ElevationConfig::default()
        };
        let mut map = ElevationMap::new(&elevation, &ObstacleConfig::default(), &config);
        for n in 0..400 {
            let x_m = 0.025 * f64::from(n) + 0.01;
            let point = [[x_m, 0.1, height_m(x_m)]; 8];
            map.integrate(&scan(0.04 * f64::from(n), x_m - 8.0, &point), &ground());
        }
        map
    };
    let (plane, local) = (sweep(GroundReference::Plane), sweep(GroundReference::Local));
    assert_eq!(
        class_at(&plane, 5.1, 0.1),
        CellClass::Obstacle,
        "0.27 m above the plane"
    );
    for x_m in [1.1, 5.1, 7.7] {
        assert_eq!(class_at(&local, x_m, 0.1), CellClass::Free, "{x_m}");
    }
    assert_eq!(class_at(&local, 8.1, 0.1), CellClass::Obstacle, "the kerb");
}

/// After a clock reset, an obstacle from the side is not taken for an initial one.
#[test]
fn clock_reset_does_not_stop_forgetting() {
    let mut map = map(101);
    let elsewhere = [[1.1, 1.1, 0.0]];
    map.integrate(&scan(100.0, 0.0, &elsewhere), &ground());
    map.integrate(&scan(140.0, 0.0, &elsewhere), &ground());
    map.erase();
    map.integrate(&scan(142.0, 0.0, &elsewhere), &ground());
    map.integrate(&scan(100.0, 0.0, &[[4.1, 0.1, 0.5]; 2]), &ground());
    assert_eq!(class_at(&map, 4.1, 0.1), CellClass::Obstacle);
    map.integrate(&scan(110.5, 0.0, &elsewhere), &ground());
    assert_eq!(
        class_at(&map, 4.1, 0.1),
        CellClass::Unknown,
        "glimpsed and forgotten"
    );
}

/// Far away and back: the entry of the obstacle's quarter was reused in between (17 quarters on),
/// those of its block (15 blocks) and cell (101 cells) were not.
#[test]
fn reobserved_obstacles_can_still_be_cleared() {
    let mut map = map(101);
    let ground_m = ground_behind(4.1, 0.5);
    let person = [[4.1, 0.1, 0.5]; 8];
    let beyond = [[ground_m, 0.1 * ground_m / 4.1, 0.0]; 8];
    let mut time_s = 0.0;
    let mut see = |map: &mut ElevationMap, x_m: f64, points: &[[f64; 3]]| {
        time_s += 0.04;
        map.integrate(&scan(time_s, x_m, points), &ground());
    };
    see(&mut map, 0.0, &person);
    see(&mut map, 27.0, &[[31.1, 0.1, 0.5]; 2]);
    for _ in 0..30 {
        see(&mut map, 0.0, &person);
    }
    assert_eq!(class_at(&map, 4.1, 0.1), CellClass::Obstacle);
    for _ in 0..6 {
        see(&mut map, 0.0, &beyond);
    }
    assert_ne!(class_at(&map, 4.1, 0.1), CellClass::Obstacle);
}

#[test]
fn grass_is_free_and_what_is_wider_than_the_spot_an_obstacle() {
    let sensor = RangeSensorModel {
        divergence_rad: 0.015,
        ..RangeSensorModel::default()
    };
    for (next_m, class) in [(1.0, CellClass::Obstacle), (3.0, CellClass::Free)] {
        let mut map = map(101);
        map.ignore_grass(Grass::new(0.04, &MetricsConfig::default(), &[sensor]));
        let mut scan = scan(0.0, 0.0, &[[6.1, 0.1, 0.5]; 20]);
        for beam in scan.beams.iter_mut().skip(1).step_by(2) {
            beam.range_m = next_m;
        }
        map.integrate(&scan, &ground());
        assert_eq!(class_at(&map, 6.1, 0.1), class, "{next_m}");
    }
}

/// Rings of a lidar 10 m away, with no ground known around: it may have risen or fallen to where one of them ends. What two of them meet at
/// different heights in a cell is no ground, nor is one point above it.
#[test]
fn of_a_cloud_far_rings_are_not_judged_by_the_ground_plane_alone() {
    use CellClass::{Free, Obstacle, Unknown};
    let class = |kind: ScanKind, heights_m: &[f64]| {
        let mut map = local_map(201);
        map.ignore_overhangs(1.0);
        let points: Vec<_> = heights_m.iter().map(|z_m| [10.1, 0.1, *z_m]).collect();
        let mut scan = scan(0.0, 0.0, &points);
        scan.kind = kind;
        let columns = (std::f64::consts::TAU / scan.beam_step_rad).round() as u32;
        // A ring for each two points.
        for (place, beam) in (0..).zip(&mut scan.beams) {
            beam.index = place / 2 * (columns + 2) + place % 2;
            beam.range_m = 10.0;
        }
        map.integrate(&scan, &ground());
        class_at(&map, 10.1, 0.1)
    };
    for (heights_m, of_cloud, of_beams) in [
        (&[0.05, 0.05][..], Free, Free),
        (&[0.3, 0.3], Unknown, Obstacle),
        (&[-0.3, -0.3], Unknown, Obstacle),
        (&[0.3, 0.3, 0.45, 0.45], Obstacle, Obstacle),
        (&[0.3, 0.3, 0.45], Unknown, Obstacle),
        (&[0.05, 0.05, 0.2, 0.2], Obstacle, Obstacle),
        (&[2.0, 2.0, 2.2, 2.2], Unknown, Obstacle),
        // A roof, seen before and after the ground below it.
        (&[0.9, 0.9, -0.4, -0.4], Unknown, Obstacle),
        (&[-0.4, -0.4, 0.9, 0.9], Unknown, Obstacle),
    ] {
        let classes = [ScanKind::Cloud, ScanKind::Beams].map(|kind| class(kind, heights_m));
        assert_eq!(classes, [of_cloud, of_beams], "{heights_m:?}");
    }
}

/// Three rings of a lidar on a slope of 5 %, 40 cm from ring to ring, a kerb of 15 cm behind the last, and a branch above.
#[test]
fn of_a_cloud_ground_is_found_ring_by_ring_and_branches_are_passed_below() {
    use CellClass::{Free, Obstacle};
    let on_slope = |x_m: f64| [x_m, 0.1, 0.05 * x_m];
    let xs_m = [1.9, 2.3, 2.7, 3.1, 3.5];
    let mut points: Vec<_> = xs_m.map(on_slope).to_vec();
    points.extend([[3.9, 0.1, 0.35], [3.9, 0.1, 0.35], [2.7, 0.1, 2.0]]);
    let classes = |kind: ScanKind, is_upside_down: bool| {
        let mut map = local_map(101);
        map.ignore_overhangs(1.0);
        let mut scan = scan(0.0, 0.0, &points);
        scan.kind = kind;
        // A ring for each height; of some sensors the first is the highest.
        let rings = points.len() as u32;
        for (ring, beam) in (0..).zip(&mut scan.beams) {
            let ring = if is_upside_down { rings - ring } else { ring };
            let columns = (std::f64::consts::TAU / scan.beam_step_rad).round() as u32;
            beam.index = ring * (columns + 2);
            beam.range_m = 5.0;
        }
        scan.beams.sort_by_key(|beam| beam.index);
        map.integrate(&scan, &ground());
        let top_m = map.grid.get(CellIndex { x: 13, y: 0 }).unwrap().max_m();
        let xs_m = [1.9, 2.7, 3.5, 3.9];
        (xs_m.map(|x_m| class_at(&map, x_m, 0.1)), top_m < 0.2)
    };
    for is_upside_down in [false, true] {
        let of_cloud = classes(ScanKind::Cloud, is_upside_down);
        assert_eq!(
            of_cloud,
            ([Free, Free, Free, Obstacle], true),
            "{is_upside_down}"
        );
    }
    let (of_scan, is_below) = classes(ScanKind::Beams, false);
    assert!(
        of_scan != [Free, Free, Free, Obstacle] && !is_below,
        "{of_scan:?}"
    );
}

#[test]
fn a_reset_of_the_plane_keeps_the_ground_in_the_blind_zone_of_a_lidar() {
    use CellClass::{Free, Obstacle, Unknown};
    let mut map = local_map(101);
    let xs_m = (0..11).map(|n| 1.1 + 0.4 * f64::from(n));
    let mut points: Vec<_> = xs_m.map(|x_m| [x_m, 0.1, 0.05 * x_m]).collect();
    points.extend([[2.1, 1.1, 0.6], [2.1, 1.1, 0.7]]);
    map.integrate(&scan(1.0, 0.0, &points), &ground());
    let places = [(1.1, 0.1), (3.5, 0.1), (5.1, 0.1), (2.1, 1.1)];
    let classes = |map: &ElevationMap| places.map(|(x_m, y_m)| class_at(map, x_m, y_m));
    assert_eq!(classes(&map), [Free, Free, Free, Obstacle]);
    let pitch_rad = -libm::atan(0.05);
    let on_ramp =
        nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::y_axis(), pitch_rad);
    let after = GroundPlane::under(&Pose::from_parts(Translation3::identity(), on_ramp));
    map.erase_beyond_blind_zone([&ground(), &after], Point2::origin());
    assert_eq!(classes(&map), [Free, Free, Unknown, Unknown]);
    let cell = map.grid().get(CellIndex { x: 17, y: 0 }).unwrap();
    assert!(cell.mean_m().unwrap().abs() < 1e-3, "{cell:?}");
}
