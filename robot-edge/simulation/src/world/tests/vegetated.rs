//! What the built-in worlds of the hybrid perception document must be for their experiments.

use nalgebra::{Point2, Point3, Vector3};

use super::*;
use crate::truth::{ShoreClass, TerrainTruth};
use crate::vegetation::{Rigidity, Stem, is_inside};

/// Half widths and heights of the vehicles: of the corners of 0.8 × 1.5 × 0.7 m and of 4.5 × 2.44 × 2 m.
const WORLDS: [(&str, [f64; 2]); 4] = [
    ("yard", [0.85, 0.7]),
    ("meadow", [0.85, 0.7]),
    ("lake", [2.56, 2.0]),
    ("dock", [2.56, 2.0]),
];

fn load(name: &str) -> World {
    World::load(name).unwrap()
}

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
fn sonar_measures_the_bed_and_the_laser_does_not() {
    let world = load("lake");
    let mut depths = Vec::new();
    for at in path_m(&world) {
        let sonar = Point3::new(at.x, at.y, -0.5);
        let echo = world
            .scene()
            .echo(sonar, -Vector3::z(), 300.0, 0.0, 0.5)
            .unwrap();
        depths.push(echo.path_m + 0.5);
        let laser = Point3::new(at.x, at.y, 1.9);
        let ahead = Vector3::new(0.95, 0.0, -0.312).normalize();
        assert!(world.scene().echo(laser, ahead, 250.0, 0.0, 0.5).is_none());
    }
    let least = depths.iter().copied().fold(f64::INFINITY, f64::min);
    let most = depths.iter().copied().fold(0.0, f64::max);
    assert!(
        (2.0..3.0).contains(&least) && (5.0..6.0).contains(&most),
        "{least} {most}"
    );
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
