//! What the built-in worlds must be for their experiments.

use std::collections::HashSet;

use nalgebra::{Point2, Point3, Vector2, Vector3};

use super::outline::Outline;
use super::{
    Bounds, CellKind, GroundPlane, HeightTruth, TerrainTruth, Thresholds, heights, occupancy,
};
use measurement::pose::Pose;
use measurement::{Measurement, MeasurementData};
use simulation::scene::Scene;
use simulation::solid::{Shape, Solid};
use simulation::source::START;
use simulation::vegetation::{Rigidity, Stem, is_inside};
use simulation::world::ShoreClass;
use simulation::{SimulatedSource, SimulationOptions, World};

const ELEVATION: &[&str] = &["hall", "floor", "ramp", "street", "bumps", "turn", "walker"];

const DOCUMENT: Thresholds = Thresholds {
    above_m: 0.10,
    below_m: -0.10,
};

/// Of the circle that holds the corners of Holos' body.
const HOLOS_RADIUS_M: f64 = 0.571;

fn load(name: &str) -> World {
    World::load(name).unwrap()
}

fn solid<'a>(world: &'a World, name: &str) -> &'a Solid {
    let found = world.solids().iter().find(|solid| solid.name == name);
    found.unwrap_or_else(|| panic!("no {name}"))
}

/// Height of the surface under a point, movers and glass included.
fn height_m(world: &World, x: f64, y: f64) -> f64 {
    world.scene().height_m(Point2::new(x, y), 0.0).unwrap()
}

fn truth(world: &World, min_m: [f64; 2], max_m: [f64; 2]) -> HeightTruth {
    let bounds = Bounds { min_m, max_m };
    heights(world, 0.2, bounds, false).unwrap()
}

/// Whether the cell of 0.2 m that holds a point is an obstacle to a vehicle on z = 0.
fn is_obstacle(truth: &HeightTruth, x: f64, y: f64) -> bool {
    let cell = truth
        .get([x, y].map(|m| libm::floor(m / 0.2) as i64))
        .unwrap();
    let verdict = cell.verdict(&GroundPlane::level(0.0), DOCUMENT);
    verdict.unwrap().is_obstacle
}

#[test]
fn paths_keep_clear_of_everything_that_is_not_driven_over() {
    for name in ELEVATION {
        let world = load(name);
        let path = world.path();
        for height_m in [0.12, 0.3, 0.7, 1.1] {
            let outline = Outline::at_height(world.solids(), height_m);
            let steps = (path.duration_s() / 0.1) as usize + 1;
            for step in 0..=steps {
                let position_m = path.planar_pose(step as f64 * 0.1).position_m;
                let clearance_m = outline.distance_m(position_m) - HOLOS_RADIUS_M;
                assert!(
                    clearance_m > 0.1 && !outline.contains(position_m),
                    "{name}: {clearance_m} m at {position_m}, height {height_m} m"
                );
            }
        }
    }
}

#[test]
fn the_hall_has_the_documents_lengths() {
    let world = load("hall");
    let face = |name, aim: Vector3<f64>| {
        let solid = solid(&world, name).clone();
        let scene = Scene::new(std::slice::from_ref(&solid));
        let centre = solid.world_from_solid.translation.vector;
        let from = Point3::from(centre - aim * 30.0);
        from + aim * scene.cast(from, aim, 100.0, 0.0).unwrap().distance_m
    };
    let pillar = face("first pillar", -Vector3::y());
    let wall = face("left wall", Vector3::y());
    assert!((wall.y - pillar.y - 1.7).abs() < 1e-9, "{wall} {pillar}");
    let [first, second] = ["first pillar", "second pillar"].map(|name| face(name, Vector3::x()).x);
    assert!((second - first - 4.2).abs() < 1e-9);
    // 4.2 m in the first 21 s.
    let at = world.path().planar_pose(21.0).position_m;
    assert!((at - Point2::new(4.2, 0.0)).norm() < 1e-9, "{at}");
    let truth = truth(&world, [-2.0, -4.5], [22.2, 4.0]);
    assert!(is_obstacle(&truth, 3.42, 1.78) && !is_obstacle(&truth, 3.42, 2.9));
}

#[test]
fn the_ramp_goes_down_by_four_degrees_without_cracks() {
    let world = load("ramp");
    let on_ramp_m = |x: f64| -(x - 7.12) * libm::tan(4.0_f64.to_radians());
    for x in [7.2, 12.0, 20.0, 31.0] {
        assert!(
            (height_m(&world, x, 0.3) - on_ramp_m(x)).abs() < 1e-4,
            "{x}"
        );
    }
    for (x, expected_m) in [
        (1.0, 0.0),
        (7.0, 0.0),
        (2.5, 0.03),
        (4.2, 0.02),
        (33.0, -1.68),
    ] {
        assert!((height_m(&world, x, 0.3) - expected_m).abs() < 1e-9, "{x}");
    }
    // From the upper level all of the ramp but its beginning is below −0.1 m; on its own plane all is free.
    let truth = truth(&world, [5.0, -2.8], [31.0, 2.8]);
    let ramp = GroundPlane {
        point_m: Point3::new(7.12, 0.0, 0.0),
        normal: Vector3::new(
            libm::sin(4.0_f64.to_radians()),
            0.0,
            libm::cos(4.0_f64.to_radians()),
        ),
    };
    for (index, cell) in truth.iter().filter(|(index, _)| index[0] >= 36) {
        let x = index[0] as f64 * 0.2;
        let of = |ground: &GroundPlane| cell.verdict(ground, DOCUMENT).unwrap();
        assert!(!of(&ramp).is_obstacle, "{index:?} {:?}", of(&ramp));
        assert_eq!(
            of(&GroundPlane::level(0.0)).is_obstacle,
            x > 8.3,
            "{index:?}"
        );
    }
    for (index, cell) in truth.iter().filter(|(index, _)| index[0] < 35) {
        assert!(cell.min_m > -1e-9, "{index:?}");
    }
}

#[test]
fn the_street_has_kerbs_a_ditch_a_pit_and_no_cracks() {
    let world = load("street");
    for (y, expected_m) in [
        (0.0, 0.0),
        (4.0, 0.0),
        (4.1, 0.15),
        (-4.1, 0.0),
        (-4.2, 0.15),
        (-5.5, -0.2),
        (-7.8, -0.2),
    ] {
        assert!((height_m(&world, 30.0, y) - expected_m).abs() < 1e-9, "{y}");
    }
    let truth = truth(&world, [-6.0, -10.4], [50.0, 7.2]);
    for x in [5.1, 30.1, 45.1] {
        for y in [4.1, -4.1, -5.5, -6.5, -7.7, 6.8, -10.1] {
            assert!(is_obstacle(&truth, x, y), "{x} {y}");
        }
        for y in [-3.9, 0.0, 3.9] {
            assert!(!is_obstacle(&truth, x, y), "{x} {y}");
        }
    }
    for (x, y) in [
        (8.5, 4.5),
        (10.1, -4.5),
        (12.3, 3.0),
        (14.3, -1.7),
        (19.5, -2.6),
        (15.9, -1.5),
    ] {
        assert!(is_obstacle(&truth, x, y), "{x} {y}");
    }
    // The lane that it drives along is bare.
    for (index, cell) in truth
        .iter()
        .filter(|(index, _)| (-4..20).contains(&index[1]))
    {
        if cell.max_m < 1e-9 {
            assert!(cell.min_m > -1e-9, "{index:?} {}", cell.min_m);
        }
        if (-4..10).contains(&index[1]) {
            assert!(cell.max_m < 1e-9, "{index:?} {}", cell.max_m);
        }
    }
}

#[test]
fn the_walker_walks_through_the_doors_and_nothing_else() {
    let world = load("walker");
    let walls = Outline::at_height(world.solids(), 0.5);
    let person = [solid(&world, "legs"), solid(&world, "trunk")];
    assert_eq!(person[0].motion, person[1].motion);
    let Shape::Cylinder { radius_m, height_m } = person[1].shape else {
        panic!("{person:?}")
    };
    let mut was_at: Option<Point2<f64>> = None;
    for step in 0..=300 {
        let time_s = f64::from(step) * 0.1;
        let trunk = person[1].at(time_s);
        assert_eq!(trunk.is_some(), (4.0..20.7).contains(&time_s), "{time_s}");
        let Some(trunk) = trunk else { continue };
        let at = Point3::from(trunk.world_from_solid.translation.vector);
        assert!((at.z + 0.5 * height_m - 1.75).abs() < 1e-9);
        assert!(
            walls.distance_m(at.xy()) > radius_m + 0.05,
            "{time_s} s: {at}"
        );
        let robot_m = world.path().planar_pose(time_s).position_m;
        assert!((at.xy() - robot_m).norm() > 1.5, "{time_s} s: {at}");
        if let Some(before) = was_at {
            let pace_mps = (at.xy() - before).norm() / 0.1;
            assert!(pace_mps < 1.5, "{time_s} s: {pace_mps} m/s");
        }
        was_at = Some(at.xy());
    }
    assert!(was_at.unwrap().y > 8.0);
    assert!(world.path().duration_s() > 20.7 + 30.0);
}

/// Half widths and heights of the vehicles: of the corners of 0.8 × 1.5 × 0.7 m and of 4.5 × 2.44 × 2 m.
const WORLDS: [(&str, [f64; 2]); 4] = [
    ("yard", [0.85, 0.7]),
    ("meadow", [0.85, 0.7]),
    ("lake", [2.56, 2.0]),
    ("dock", [2.56, 2.0]),
];

fn path_m(world: &World) -> Vec<Point2<f64>> {
    let steps = (world.path().duration_s() / 0.2) as usize;
    let at = |step| world.path().planar_pose(step as f64 * 0.2).position_m;
    (0..=steps).map(at).collect()
}

fn stems_of<'a>(world: &'a World, name: &str) -> &'a [Stem] {
    let vegetation = &world.scene().growth().unwrap().vegetation;
    let patch = vegetation.patches().iter().find(|patch| patch.name == name);
    &vegetation.stems()[patch.unwrap_or_else(|| panic!("no {name}")).stems.clone()]
}

#[test]
fn paths_are_clear_and_as_long_as_they_should_be() {
    for (name, [half_m, height_m]) in WORLDS {
        let world = load(name);
        let standing = TerrainTruth::of(&world);
        let mut length_m = 0.0;
        for pair in path_m(&world).windows(2) {
            length_m += (pair[1] - pair[0]).norm();
            let ground_m = standing
                .ground_m(pair[0])
                .unwrap()
                .max(world.water_m().unwrap_or(-9.0));
            let low_m = ground_m + 0.3;
            let met = standing.class(pair[0], half_m, low_m..ground_m + height_m);
            assert_eq!(met, None, "{name} at {}", pair[0]);
        }
        let duration_s = world.path().duration_s();
        assert!((25.0..125.0).contains(&length_m), "{name}: {length_m} m");
        assert!((40.0..90.0).contains(&duration_s), "{name}: {duration_s} s");
        assert_eq!(world.laser_errors().range_noise_m, 0.01);
    }
}

#[test]
fn the_yard_has_its_slopes_canopy_branch_and_pit() {
    let world = load("yard");
    let standing = TerrainTruth::of(&world);
    let ground_m = |x: f64, y: f64| standing.ground_m(Point2::new(x, y)).unwrap();
    let slope_deg = |from: [f64; 2], to: [f64; 2]| {
        let run_m = libm::hypot(to[0] - from[0], to[1] - from[1]);
        let rise_m = ground_m(to[0], to[1]) - ground_m(from[0], from[1]);
        libm::atan2(rise_m, run_m).to_degrees()
    };
    for (from, to, expected_deg) in [
        ([6.1, 0.0], [9.9, 0.0], 10.0),
        ([18.1, 0.0], [20.9, 0.0], -13.2),
        ([0.0, 3.1], [0.0, 6.9], 20.0),
        ([0.0, -3.1], [0.0, -6.9], 25.0),
        ([14.0, 3.1], [14.0, 6.9], 35.0),
        ([14.0, -3.1], [14.0, -6.9], 10.0),
        ([25.0, 3.1], [25.0, 6.9], 30.0),
        ([31.0, 3.1], [31.0, 6.9], 15.0),
        ([31.0, -3.1], [31.0, -6.9], 5.0),
    ] {
        let slope_deg = slope_deg(from, to);
        assert!(
            (slope_deg - expected_deg).abs() < 0.05,
            "{slope_deg} at {from:?}"
        );
    }
    assert!(ground_m(25.0, -2.5) <= -0.7 && ground_m(25.0, -1.4) == 0.0);

    // Leaves above the way from x = 12 to 17 begin 1.4 m above the ground; the robot is 0.7 m high.
    let over = |x: f64, from_m: f64, to_m: f64| {
        let above_m = ground_m(x, 0.0);
        standing.class(Point2::new(x, 0.0), 0.5, above_m + from_m..above_m + to_m)
    };
    for x in [13.0, 14.0, 15.0, 16.0] {
        assert_eq!(over(x, 1.4, 3.5), Some(Rigidity::Flexible));
        assert_eq!(over(x, 0.05, 1.4), None);
    }
    let branch = Point2::new(21.5, -2.0);
    assert_eq!(
        standing.class(branch, 0.05, 0.3..0.5),
        Some(Rigidity::Rigid)
    );
    assert_eq!(standing.class(branch, 0.05, 0.05..0.35), None);
    let top_m = standing.rigid_top_m(branch, 0.7).unwrap();
    assert!((top_m - 0.43).abs() < 1e-9, "{top_m}");
}

#[test]
fn the_meadow_keeps_its_distances_and_its_grass_is_tall() {
    let world = load("meadow");
    let path = path_m(&world);
    let off_m = |at: Point2<f64>| {
        path.iter()
            .map(|p| (p - at).norm())
            .fold(f64::INFINITY, f64::min)
    };
    let vegetation = &world.scene().growth().unwrap().vegetation;
    for patch in vegetation.patches() {
        assert_eq!(patch.rigidity, Rigidity::Flexible);
        let stems = &vegetation.stems()[patch.stems.clone()];
        for stem in stems {
            assert!(
                (1.9..8.5).contains(&off_m(stem.foot_m.xy())),
                "{}",
                patch.name
            );
        }
        if patch.name.ends_with("grass") {
            assert!(stems.len() > 500);
            let heights = || stems.iter().map(|stem| stem.top_m.z - stem.foot_m.z);
            assert!(heights().all(|m| (0.5..=0.9).contains(&m)));
        }
    }
    let things = world.ground_and_objects()[1].clone();
    assert_eq!(things.len(), 8);
    for thing in things {
        let at = thing.world_from_solid.translation.vector.xy();
        assert!((2.0..8.0).contains(&off_m(at.into())), "{}", thing.name);
    }
}

#[test]
fn the_lake_has_four_separate_shores_of_each_class() {
    let world = load("lake");
    let (path, shores) = (path_m(&world), world.shores());
    for class in [ShoreClass::Sparse, ShoreClass::Dense, ShoreClass::Solid] {
        assert_eq!(
            shores.iter().filter(|shore| shore.class == class).count(),
            4
        );
    }
    let vegetation = &world.scene().growth().unwrap().vegetation;
    let mut of_shore: Vec<Vec<Point2<f64>>> = vec![Vec::new(); shores.len()];
    for stem in vegetation.stems() {
        for end in [stem.foot_m.xy(), stem.top_m.xy()] {
            let shore = shores
                .iter()
                .position(|shore| is_inside(&shore.polygon_m, end));
            of_shore[shore.unwrap_or_else(|| panic!("nobody's: {end}"))].push(end);
        }
    }
    let mut boxes = Vec::new();
    for (shore, points) in shores.iter().zip(&of_shore) {
        let min = points.iter().fold(points[0], |a, b| a.inf(b));
        let max = points.iter().fold(points[0], |a, b| a.sup(b));
        boxes.push([min, max]);
        let nearest = |p: &Point2<f64>| {
            path.iter()
                .map(|q| (p - q).norm())
                .fold(f64::INFINITY, f64::min)
        };
        let off_m = points.iter().map(nearest).fold(f64::INFINITY, f64::min);
        assert!((6.0..15.0).contains(&off_m), "{}: {off_m} m", shore.name);
    }
    for (n, [min, max]) in boxes.iter().enumerate() {
        for [other_min, other_max] in &boxes[n + 1..] {
            let gap = |axis: usize| (other_min[axis] - max[axis]).max(min[axis] - other_max[axis]);
            assert!(
                gap(0).max(gap(1)) > 4.0,
                "{min} {max} {other_min} {other_max}"
            );
        }
    }
    // Stems a square metre, leaves left out.
    for (name, area_m2, per_stem, least, most) in [
        ("first scattered canes", 28.0, 1, 0.5, 1.0),
        ("fourth scattered canes", 28.0, 1, 2.0, 3.0),
        ("first patch of the first cane field", 6.5625, 3, 33.0, 37.0),
        ("second patch of the first cane field", 6.5625, 3, 9.0, 11.0),
    ] {
        let density = (stems_of(&world, name).len() / per_stem) as f64 / area_m2;
        assert!((least..=most).contains(&density), "{name}: {density}");
    }
    // What rises out of the water is farther than the metrics reach.
    let standing = TerrainTruth::of(&world);
    for at in &path {
        for aside_m in [-20.0, -14.0, 14.0, 20.0] {
            assert!(
                standing
                    .ground_m(at + nalgebra::Vector2::new(0.0, aside_m))
                    .unwrap()
                    < 0.0
            );
        }
        assert!(
            standing
                .ground_m(at + nalgebra::Vector2::new(0.0, 30.0))
                .unwrap()
                > 0.5
        );
    }
}

#[test]
fn the_dock_is_a_clear_twelve_degree_ramp() {
    let world = load("dock");
    let standing = TerrainTruth::of(&world);
    let [dock] = world.docks() else {
        panic!("{:?}", world.docks())
    };
    let height_m = |x: f64, y: f64| standing.ground_m(Point2::new(x, y)).unwrap();
    for x in [-2.9, 0.0, 2.9] {
        for y in [-0.9, 0.5, 4.0, 7.9] {
            assert!(is_inside(&dock.polygon_m, Point2::new(x, y)));
            assert!((height_m(x, y) - y * libm::tan(12.0_f64.to_radians())).abs() < 1e-3);
        }
    }
    assert!((height_m(0.0, 12.0) - 1.7).abs() < 1e-9);
    let vegetation = &world.scene().growth().unwrap().vegetation;
    for stem in vegetation.stems() {
        let ends = [stem.foot_m.xy(), stem.top_m.xy()];
        assert!(ends.iter().all(|end| !is_inside(&dock.polygon_m, *end)));
    }
    assert_eq!(standing.class(Point2::new(0.0, 4.0), 2.9, -2.0..4.0), None);
    for x in [-8.0, 7.0] {
        assert_eq!(
            standing.class(Point2::new(x, -1.0), 1.0, 0.2..1.5),
            Some(Rigidity::Flexible)
        );
    }
    for x in [-18.0, 18.0] {
        assert_eq!(
            standing.class(Point2::new(x, -0.7), 1.5, 0.2..1.5),
            Some(Rigidity::Rigid)
        );
    }
    let nearest_m = path_m(&world)
        .iter()
        .map(|p| p.coords.norm())
        .fold(f64::INFINITY, f64::min);
    assert!((10.0..15.0).contains(&nearest_m), "{nearest_m}");
}

fn rooms() -> World {
    World::load("rooms").unwrap()
}

/// Swing radius of the Pioneer.
const PIONEER_RADIUS_M: f64 = 0.27;

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
    let clearance_m = nearest_m - 0.5 * 0.6 * step_s - PIONEER_RADIUS_M;
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
