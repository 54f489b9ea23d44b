//! What the built-in world `rooms` must be for experiments L1 and L2.

use std::collections::HashSet;

use nalgebra::{Point2, Point3, Vector2};

use crate::solid::{Shape, Solid};
use crate::source::START;
use crate::truth::outline::Outline;
use crate::truth::{Bounds, CellKind, occupancy};
use crate::{SimulatedSource, SimulationOptions, World};
use measurement::pose::Pose;
use measurement::{Measurement, MeasurementData};

fn rooms() -> World {
    World::load("rooms").unwrap()
}

/// Swing radius of the Pioneer.
const RADIUS_M: f64 = 0.27;

const FLOOR: Bounds = Bounds {
    min_m: [-2.37, -3.23],
    max_m: [17.68, 11.84],
};

fn outline(world: &World) -> Outline {
    let laser = &world.simulated_vehicle().laser;
    Outline::at_height(world.solids(), laser.base_from_mount.translation.z)
}

#[test]
fn the_path_takes_two_minutes_and_is_free() {
    let world = rooms();
    let path = world.path();
    assert!(
        (100.0..125.0).contains(&path.duration_s()),
        "{}",
        path.duration_s()
    );
    // Everything as low as the vehicle is high stands in this plane, too.
    let lowest_m = world.solids().iter().map(|solid| {
        let Shape::Box { size_m } = solid.shape else {
            panic!("{solid:?}")
        };
        solid.world_from_solid.translation.z - 0.5 * size_m[2]
    });
    assert!(lowest_m.into_iter().all(|m| m.abs() < 1e-9));
    let outline = Outline::at_height(world.solids(), 0.1);
    let step_s = 0.01;
    let steps = (path.duration_s() / step_s) as usize + 1;
    let nearest_m = (0..=steps)
        .map(|step| {
            let position_m = path.planar_pose(step as f64 * step_s).position_m;
            assert!(!outline.contains(position_m), "{position_m}");
            outline.distance_m(position_m)
        })
        .fold(f64::INFINITY, f64::min);
    // Between two steps the vehicle comes nearer by at most half a step.
    let clearance_m = nearest_m - 0.5 * 0.6 * step_s - RADIUS_M;
    assert!(clearance_m > 0.05, "{clearance_m}");
}

/// Exact points that noise-free beams of a whole run hit, mirrored ones left out.
fn points_seen(world: &World) -> Vec<Point2<f64>> {
    let options = SimulationOptions {
        range_noise_m: Some(0.0),
        dropout: Some(0.0),
        ..SimulationOptions::default()
    };
    let mut source = SimulatedSource::new(world, options).unwrap();
    let laser = &world.simulated_vehicle().laser;
    let mut points = Vec::new();
    while let Some(Measurement { stamp, data, .. }) = source.next_measurement() {
        let MeasurementData::Scan { scan, .. } = data else {
            continue;
        };
        for (beam, &range_m) in scan
            .ranges_m
            .iter()
            .enumerate()
            .filter(|(_, r)| r.is_finite())
        {
            let time_s =
                stamp.since(START).as_secs_f64() + beam as f64 * f64::from(scan.time_increment_s);
            let angle_rad =
                f64::from(scan.angle_min_rad) + beam as f64 * f64::from(scan.angle_increment_rad);
            let world_from_laser: Pose =
                world.path().world_from_base(time_s) * laser.base_from_mount;
            let in_laser =
                Point3::new(libm::cos(angle_rad), libm::sin(angle_rad), 0.0) * f64::from(range_m);
            points.push((world_from_laser * in_laser).xy());
        }
    }
    points
}

#[test]
fn every_wall_is_seen_within_the_lasers_range() {
    let world = rooms();
    let outline = outline(&world);
    let spacing_m = 0.1;
    let cell_of = |p: Point2<f64>| [p.x, p.y].map(|m| libm::floor(m / spacing_m) as i64);
    let seen: HashSet<[i64; 2]> = points_seen(&world)
        .into_iter()
        .filter(|&point| outline.distance_m(point) < 1e-5)
        .map(cell_of)
        .collect();
    let is_wall = |solid: &&Solid| {
        let Shape::Box { size_m } = solid.shape else {
            panic!("{solid:?}")
        };
        size_m[1] <= 0.2 && size_m[2] > 2.4
    };
    let walls: Vec<Solid> = world.solids().iter().filter(is_wall).cloned().collect();
    assert_eq!(walls.len(), 18);
    let (mut samples, mut missed) = (0, Vec::new());
    for &[a, b] in Outline::at_height(&walls, 0.3).segments() {
        let along: Vector2<f64> = b - a;
        let outward = Vector2::new(along.y, -along.x).normalize();
        let n = (along.norm() / spacing_m) as usize;
        for k in 0..n {
            let point = a + along * ((k as f64 + 0.5) / n as f64);
            let before = point + outward * 0.01;
            let indoors = (0..2)
                .all(|axis| FLOOR.min_m[axis] < before[axis] && before[axis] < FLOOR.max_m[axis]);
            let behind_furniture = outline.distance_m(point) > 1e-6;
            if indoors && !behind_furniture {
                samples += 1;
                let [i, j] = cell_of(point);
                let near = (-1..=1).any(|di| (-1..=1).any(|dj| seen.contains(&[i + di, j + dj])));
                if !near {
                    missed.push(point);
                }
            }
        }
    }
    assert!(samples > 1500, "{samples}");
    assert!(
        missed.len() * 200 <= samples,
        "{} of {samples}: {missed:?}",
        missed.len()
    );
}

#[test]
fn false_readings_of_the_mirror_lie_within_the_room_behind_it() {
    let world = rooms();
    let outline = outline(&world);
    let false_points: Vec<_> = points_seen(&world)
        .into_iter()
        .filter(|&point| outline.distance_m(point) > 0.05)
        .collect();
    assert!(false_points.len() > 1000, "{}", false_points.len());
    let behind = false_points
        .iter()
        .filter(|p| 4.13 < p.x && p.x < 11.04 && -3.33 < p.y && p.y < 5.43);
    assert!(behind.count() * 100 >= false_points.len() * 99);
}

#[test]
fn truth_has_rooms_walls_and_doors() {
    let grid = occupancy(&rooms(), 0.05, FLOOR).unwrap();
    let kind = |x: f64, y: f64| {
        let index = [x, y].map(|m| libm::floor(m / 0.05) as i64);
        grid.get(index).unwrap().kind
    };
    assert_eq!(kind(2.505, 3.27), CellKind::Free);
    assert_eq!(kind(0.0, 3.19), CellKind::Occupied);
    assert_eq!(kind(0.0, 3.27), CellKind::Inside);
    assert_eq!(kind(8.46, 2.08), CellKind::Inside);
    let cells = (-100..400).flat_map(|i| (-100..300).map(move |j| [i, j]));
    let free = cells
        .filter_map(|index| grid.get(index))
        .filter(|cell| cell.kind == CellKind::Free)
        .count();
    let area_m2 = free as f64 * 0.05 * 0.05;
    assert!((260.0..290.0).contains(&area_m2), "{area_m2}");
}
