use super::*;
use proptest::prelude::*;

use crate::height_columns::{ColumnRules, read_columns};
use crate::octree::{BrickColumn, OctreeConfig, RangeSensorModel, Ray, SurfaceHit};
use crate::registered_scan::SensorId;
use crate::rigidity::RigidityRule;

const CELL_M: f64 = 0.1;

fn octree() -> Octree {
    let config = OctreeConfig {
        enabled: true,
        ..OctreeConfig::default()
    };
    Octree::new(&config, &[RangeSensorModel::default()], 1)
}

const CAR: VehicleShape = VehicleShape {
    height_m: 0.7,
    bottom_z_m: 0.0,
    length_m: 1.5,
    width_m: 0.8,
    wheelbase_m: 1.0,
};

fn config(surface: Surface) -> CostConfig {
    CostConfig {
        enabled: true,
        box_m: 8.0,
        surface,
        ..CostConfig::default()
    }
}

fn map(surface: Surface) -> CostMap {
    let rigidity = RigidityConfig {
        enabled: true,
        rule: RigidityRule::Metrics,
        ..RigidityConfig::default()
    };
    CostMap::new(&config(surface), &rigidity, CAR, (CELL_M, true), 1)
}

/// The costs of equations 5.1 and 5.2.
fn costs_by_difference(octree: &mut Octree) -> Vec<(CellIndex, f32)> {
    let config = CostConfig {
        slope: SlopeRule::Difference,
        ..config(Surface::Land)
    };
    let mut map = CostMap::new(&config, &RigidityConfig::default(), CAR, (CELL_M, true), 1);
    map.update(octree, Point3::new(0.0, 0.0, 0.5));
    costs(&map)
}

/// A map around a vehicle at this height, updated once.
fn updated(surface: Surface, octree: &mut Octree, z_m: f64) -> CostMap {
    let mut map = map(surface);
    map.update(octree, Point3::new(0.0, 0.0, z_m));
    map
}

fn hit(octree: &mut Octree, origin: [f64; 3], points: impl IntoIterator<Item = [f64; 3]>) {
    hit_by_spots(octree, origin, 0.0, points);
}

/// Adds hits with a spot radius.
fn hit_by_spots(
    octree: &mut Octree,
    origin: [f64; 3],
    spot_m: f32,
    points: impl IntoIterator<Item = [f64; 3]>,
) {
    let points: Vec<_> = points.into_iter().collect();
    let rays = points.iter().map(|&end| Ray {
        origin: origin.into(),
        end: end.into(),
        is_hit: true,
    });
    octree.integrate(SensorId(0), rays);
    for point in points {
        let hit = SurfaceHit {
            point: point.into(),
            spot_m,
            intra: 0.3,
            inter: 0.1,
        };
        octree.add_surfaces([hit], [0.3; 2]);
    }
}

/// Points on z(x, y) over the window, some in each column, and a few of them missing.
fn surface(z: impl Fn(f64, f64) -> f64) -> Vec<[f64; 3]> {
    let steps = 0..160;
    let points = steps
        .clone()
        .flat_map(|row| steps.clone().map(move |n| (row, n)));
    points
        .filter(|(row, n)| (row * 7 + n * 3) % 11 != 0)
        .map(|(row, n)| (f64::from(n) * 0.05 - 3.98, f64::from(row) * 0.05 - 3.98))
        .map(|(x, y)| [x, y, z(x, y)])
        .collect()
}

fn costs(map: &CostMap) -> Vec<(CellIndex, f32)> {
    let mut cells = Vec::new();
    let (least, width) = map.cells(&mut cells, |cell| *cell);
    let known = cells
        .iter()
        .enumerate()
        .filter(|(_, cell)| !cell.cost.is_nan());
    known
        .map(|(n, cell)| {
            let at = CellIndex {
                x: least.x + i32::try_from(n % width).unwrap(),
                y: least.y + i32::try_from(n / width).unwrap(),
            };
            (at, cell.cost)
        })
        .collect()
}

#[test]
fn cost_of_planes_matches_their_slope() {
    // From above, and from a vehicle in front of them.
    let views = [0.0_f64, 5.0, 10.0, 20.0, 30.0, 40.0].map(|degrees| (degrees, 8.0));
    for (degrees, height_m) in views
        .into_iter()
        .chain([(10.0, 1.0), (20.0, 1.0), (35.0, 1.0)])
    {
        let slope = libm::tan(degrees.to_radians());
        // Deterministic noise of a centimetre.
        let noise = |x: f64, y: f64| 0.01 * libm::sin(x * 977.0 + y * 1201.0);
        let mut octree = octree();
        let along = |x: f64, y: f64| (x + 0.3 * y) / libm::hypot(1.0, 0.3);
        let origin = if height_m > 4.0 {
            [0.0, 0.0, height_m]
        } else {
            [-3.9, 0.0, height_m - 4.0 * slope]
        };
        hit(
            &mut octree,
            origin,
            surface(|x, y| slope * along(x, y) + noise(x, y)),
        );
        let map = updated(Surface::Land, &mut octree, 0.0);
        let costs = costs(&map);
        assert!(costs.len() > 5000, "{} cells", costs.len());
        let allowed = (0.1 * slope).max(0.05);
        let good = costs
            .iter()
            .filter(|(_, cost)| (f64::from(*cost) - slope).abs() <= allowed);
        let share = good.count() as f64 / costs.len() as f64;
        assert!(
            share >= 0.95,
            "{degrees} degrees from {height_m} m: {share} of cells are right"
        );
        let lethal = costs.iter().filter(|(_, cost)| *cost >= 1.0).count();
        assert_eq!(lethal, 0, "{degrees} degrees");
    }
}

/// Height of a step of two voxels at x = 1 m, and its face.
#[test]
fn by_differences_a_column_costs_its_greatest_rise_over_the_grounds_around() {
    // Ground in voxel layer 0, a wall four voxels high in the columns of x = 0; one column alone far away.
    let wall = [0.15, 0.25, 0.35].map(|z| [0.05, 0.05, z]);
    let ground = surface(|_, _| 0.05).into_iter().filter(|[x, ..]| *x < 1.0);
    let mut octree = octree();
    hit(&mut octree, [0.0, 0.0, 2.0], ground.chain(wall));
    let costs = costs_by_difference(&mut octree);
    let cost = |x, y| {
        let at = CellIndex { x, y };
        costs
            .iter()
            .find(|(cell, _)| *cell == at)
            .map(|(_, cost)| *cost)
    };
    // Three voxels over an adjacent column are lethal; level ground is free also beside the wall.
    assert_eq!(cost(0, 0), Some(1.0));
    assert_eq!(
        (cost(1, 0), cost(-2, 0), cost(5, 5)),
        (Some(0.0), Some(0.0), Some(0.0))
    );
    // A single voxel up from the fourth column away is not in the window; from the third it is 1/3.
    let stair = surface(|x, _| if x < 0.0 { 0.05 } else { 0.15 });
    let mut octree = self::octree();
    hit(&mut octree, [0.0, 0.0, 2.0], stair);
    let costs = costs_by_difference(&mut octree);
    for (x, expected) in [(0, 1.0), (1, 0.5), (2, 1.0 / 3.0), (3, 0.0), (-1, 0.0)] {
        let at = CellIndex { x, y: 10 };
        let found = costs.iter().find(|(cell, _)| *cell == at).unwrap().1;
        assert!(
            (found - expected).abs() < 1e-6,
            "column {x}: {found} instead of {expected}"
        );
    }
}

fn step_m(x: f64, _: f64) -> f64 {
    if x < 1.0 { 0.02 } else { 0.22 }
}

fn step_face() -> impl Iterator<Item = [f64; 3]> {
    (0..160).flat_map(|n| [0.07, 0.13, 0.19].map(move |z| [1.0, f64::from(n) * 0.05 - 3.98, z]))
}

#[test]
fn two_voxel_step_is_lethal_but_not_the_ground_beside() {
    let mut octree = octree();
    hit(
        &mut octree,
        [-3.0, 0.0, 2.0],
        surface(step_m).into_iter().chain(step_face()),
    );
    let map = updated(Surface::Land, &mut octree, 0.0);
    for y in -30..30 {
        let cost = |x: i32| map.cell(CellIndex { x, y }).unwrap().cost;
        assert!(cost(10) >= 1.0, "the edge at y {y} costs {}", cost(10));
        assert!(
            cost(5) < 0.05 && cost(20) < 0.05,
            "{} and {} at y {y}",
            cost(5),
            cost(20)
        );
    }
}

/// Radius of the spot of a 15 mrad beam, metres.
fn spot_m(range_m: f32) -> f32 {
    range_m * 0.0075
}

#[test]
fn a_step_of_two_voxels_is_lethal_from_afar_too() {
    // From 15 m; and from there after it was observed from 5 m away up to its foot.
    for foot_m in [15.0, 5.0] {
        let mut octree = octree();
        let (foot, raised): (Vec<_>, Vec<_>) =
            surface(step_m).into_iter().partition(|at| at[0] < 1.0);
        hit_by_spots(&mut octree, [-3.0, 0.0, 2.0], spot_m(foot_m), foot);
        let raised = raised.into_iter().chain(step_face());
        hit_by_spots(&mut octree, [-14.0, 0.0, 2.0], spot_m(15.0), raised);
        let map = updated(Surface::Land, &mut octree, 0.0);
        for y in -30..30 {
            let cost = map.cell(CellIndex { x: 10, y }).unwrap().cost;
            assert!(
                cost >= 1.0,
                "the edge at y {y} costs {cost}, its foot from {foot_m} m"
            );
        }
    }
}

/// A bank of 10° observed from nearby. Before that, from 18 m, beams whose middle passed above its
/// crest hit a tenth of its columns with the lower part of their spots.
#[test]
fn what_was_hit_from_afar_gives_way_to_what_was_hit_from_nearby() {
    let slope = libm::tan(10.0_f64.to_radians());
    let lethal = |far_m: f32, above_m: f64| {
        let mut octree = octree();
        let bank = surface(|x, _| slope * x);
        let lit = bank.iter().filter(|[x, y, _]| {
            let [column, row] = [x, y].map(|at| libm::floor(at / CELL_M) as i32);
            (3 * column + row).rem_euclid(10) == 0
        });
        let lit: Vec<_> = lit.map(|[x, y, z]| [*x, *y, z + above_m]).collect();
        hit(&mut octree, [-3.0, 0.0, 2.0], bank.iter().copied());
        hit_by_spots(&mut octree, [-3.0, 0.0, 2.0], spot_m(far_m), lit);
        let map = updated(Surface::Land, &mut octree, 0.0);
        let costs = costs(&map);
        costs.iter().filter(|(_, cost)| *cost >= 1.0).count()
    };
    assert_eq!(lethal(18.0, 0.09), 0);
    // From nearby it would be lethal, and so is an object higher than such a spot.
    assert!(lethal(5.0, 0.09) > 100, "{}", lethal(5.0, 0.09));
    assert!(lethal(18.0, 0.2) > 500, "{}", lethal(18.0, 0.2));
}

/// A bank of 35° that rises by 7 cm per column, and a beam that grazes it, 3 cm too low, where a
/// row of columns is lowest.
#[test]
fn a_beam_that_grazes_a_bank_makes_no_hole_in_it() {
    let slope = libm::tan(35.0_f64.to_radians());
    let mut octree = octree();
    hit(
        &mut octree,
        [0.0, -3.0, 2.0],
        surface(|_, y| 0.018 + slope * (y - 1.0)),
    );
    let grazing = Ray {
        origin: [-3.9, 1.01, -0.01].into(),
        end: [3.9, 1.01, -0.01].into(),
        is_hit: false,
    };
    octree.integrate(SensorId(0), [grazing]);
    let map = updated(Surface::Land, &mut octree, 0.0);
    for y in 5..15 {
        for x in -30..30 {
            let cost = f64::from(map.cell(CellIndex { x, y }).unwrap().cost);
            assert!((cost - slope).abs() < 0.05, "{x} {y}: {cost}");
        }
    }
}

#[test]
fn only_branches_below_vehicle_height_are_obstacles() {
    for (height_m, is_lethal) in [(1.45, false), (0.45, true)] {
        let mut octree = octree();
        hit(&mut octree, [-3.0, 0.0, 1.0], surface(|_, _| 0.02));
        let branch = (-10..10).map(|n| [2.03, f64::from(n) * 0.1 + 0.03, height_m]);
        hit(&mut octree, [-3.0, 0.0, 1.0], branch);
        let map = updated(Surface::Land, &mut octree, 0.0);
        let cost = map.cell(CellIndex { x: 20, y: 3 }).unwrap().cost;
        assert_eq!(
            cost >= 1.0,
            is_lethal,
            "{cost} under a branch at {height_m} m"
        );
    }
}

#[test]
fn a_deck_is_the_ground_of_a_vehicle_that_is_on_it_or_nearly_as_high() {
    let mut octree = octree();
    hit(&mut octree, [-3.0, 0.0, 1.0], surface(|_, _| 0.02));
    let is_deck = |[x, y, _]: &[f64; 3]| (1.0..3.0).contains(x) && y.abs() < 1.0;
    let deck = surface(|_, _| 1.23).into_iter().filter(is_deck);
    // From above, and from below, where it is 0.2 m lower.
    hit(&mut octree, [2.0, 0.0, 3.0], deck.clone());
    let lower_side = deck.map(|[x, y, z]| [x, y, z - 0.2]);
    hit(&mut octree, [-3.0, 0.0, 0.5], lower_side);
    let mut map = map(Surface::Land);
    let mut cost_at = |z_m: f64, x: i32| {
        map.update(&mut octree, Point3::new(0.0, 0.0, z_m));
        map.cell(CellIndex { x, y: 0 }).unwrap().cost
    };
    // The vehicle is 0.7 m high. Its way to the deck and back, and the edge of the deck.
    let heights_m = [0.0, 0.4, 1.1, 1.23, 0.6, 0.4, 0.0];
    let costs = heights_m.map(|z_m| [5, 11, 20].map(|x| cost_at(z_m, x) >= 1.0));
    let below = [false; 3];
    let above = [false, true, false];
    assert_eq!(costs, [below, below, above, above, below, below, below]);
}

/// A box 0.65 m high. In one column its side was hit, not its top.
#[test]
fn a_column_in_which_something_stands_is_no_hole() {
    let mut octree = octree();
    let is_of_column = |[x, y, _]: &[f64; 3]| (2.0..2.1).contains(x) && (0.0..0.1).contains(y);
    let is_of_top = |at: &[f64; 3]| at[0] > 1.0 && !is_of_column(at);
    let ground = surface(|_, _| 0.02).into_iter();
    hit(
        &mut octree,
        [2.0, 0.0, 3.0],
        ground.filter(|at| !is_of_top(at)),
    );
    let top = surface(|_, _| 0.65).into_iter();
    hit(&mut octree, [2.0, 0.0, 3.0], top.filter(is_of_top));
    let cost = |octree: &mut Octree| {
        let map = updated(Surface::Land, octree, 0.0);
        map.cell(CellIndex { x: 20, y: 0 }).unwrap().cost
    };
    assert!(cost(&mut octree).is_nan());
    let side = (1..6).map(|z| [2.05, 0.05, 0.1 * f64::from(z) + 0.05]);
    hit(&mut octree, [2.0, 0.0, 3.0], side);
    assert!(cost(&mut octree) >= 1.0);
}

/// Beams that graze a deck free single voxels of it, and may pass just above the voxel on it.
#[test]
fn a_freed_voxel_of_a_deck_is_no_hole_and_air_is_on_it_two_voxels_higher() {
    let deck = || surface(|_, _| 1.23).into_iter();
    let ray = |origin: [f64; 3], end: [f64; 3], is_hit| Ray {
        origin: origin.into(),
        end: end.into(),
        is_hit,
    };
    let costs = |octree: &mut Octree| {
        let map = updated(Surface::Land, octree, 1.1);
        [18, 20, 23].map(|x| match map.cell(CellIndex { x, y: 0 }).unwrap().cost {
            cost if cost.is_nan() => "unknown",
            1.0.. => "lethal",
            _ => "passable",
        })
    };
    let mut over_ground = octree();
    hit(&mut over_ground, [-3.0, 0.0, 1.0], surface(|_, _| 0.02));

    // Beside the hole, in it, and at its far side; what is in it is not steep.
    for (freed, expected) in [
        (1, ["passable", "unknown", "passable"]),
        (4, ["lethal", "passable", "passable"]),
    ] {
        let mut octree = over_ground.clone();
        let is_freed = |[x, y, _]: &[f64; 3]| {
            let reach = 0.1 * f64::from(freed);
            (2.0..2.0 + reach).contains(x) && (0.0..reach).contains(y)
        };
        hit(
            &mut octree,
            [2.0, 0.0, 3.0],
            deck().filter(|at| !is_freed(at)),
        );
        assert_eq!(costs(&mut octree), expected, "{freed}");
    }

    let rules = ColumnRules {
        surface: Surface::Land,
        from_z: -40,
        to_z: 40,
        deck_z: 17,
        water_z: 0,
        height: 7,
    };
    for (air_m, ground_z) in [(1.35, 12), (1.45, 12), (1.55, 0)] {
        let mut octree = over_ground.clone();
        let hits = deck().map(|[x, y, z]| ray([x, y, z + 0.01], [x, y, z], true));
        octree.integrate(SensorId(0), hits);
        let rows = (-39..40).map(|y| 0.1 * f64::from(y) + 0.05);
        let beams = rows.map(|y| ray([-3.95, y, air_m], [3.95, y, air_m], false));
        octree.integrate(SensorId(0), beams);
        let columns = read_columns(&octree, BrickColumn { x: 5, y: 0 }, &rules);
        assert_eq!(columns[0].ground_z, ground_z, "{air_m}");
    }
}

/// A rock 0.35 m high, of which the top was hit: no voxel stands on its lowest one. A post beside it has hits of the ground around in the
/// voxel above it, which are no part of the post.
#[test]
fn the_top_of_a_rock_is_rigid_and_ground_that_noise_raised_is_not() {
    let mut octree = octree();
    let is_rock = |[x, y, _]: &[f64; 3]| (1.0..1.8).contains(x) && y.abs() < 0.4;
    let ground = surface(|x, y| {
        let is_noisy = ((x + y) * 20.0).round().rem_euclid(2.0) < 1.0;
        if is_noisy { 0.01 } else { -0.01 }
    });
    hit(
        &mut octree,
        [0.0, 0.0, 3.0],
        ground.into_iter().filter(|at| !is_rock(at)),
    );
    let rock = surface(|_, _| 0.35).into_iter().filter(is_rock);
    hit(&mut octree, [0.0, 0.0, 3.0], rock);
    let post = Point3::new(-1.05, 0.05, 0.55);
    octree.integrate(
        SensorId(0),
        [Ray {
            origin: Point3::new(-1.05, -3.0, 0.55),
            end: post,
            is_hit: true,
        }],
    );
    let narrow = SurfaceHit {
        point: post,
        spot_m: 0.0,
        intra: 0.0,
        inter: f32::NAN,
    };
    octree.add_surfaces([narrow], [0.3; 2]);
    let rigidity = RigidityConfig {
        enabled: true,
        intra_threshold: 0.2,
        rule: RigidityRule::Metrics,
        ..RigidityConfig::default()
    };
    let mut map = CostMap::new(&config(Surface::Land), &rigidity, CAR, (CELL_M, true), 1);
    map.update(&mut octree, Point3::new(0.0, 0.0, 0.0));
    let at = |x: i32| map.cell(CellIndex { x, y: 0 }).unwrap();
    assert_eq!(at(10).rigidity, Rigidity::Rigid, "{:?}", at(10));
    assert_eq!(at(-11).rigidity, Rigidity::Traversable, "{:?}", at(-11));
}

#[test]
fn rim_of_an_observed_hole_is_lethal() {
    let mut octree = octree();
    let pit = |x: f64, y: f64| {
        if x.abs() < 0.6 && y.abs() < 0.6 {
            -0.78
        } else {
            0.02
        }
    };
    hit(&mut octree, [0.0, 0.0, 3.0], surface(pit));
    let map = updated(Surface::Land, &mut octree, 0.0);
    let rim = (-7..7).map(|y| map.cell(CellIndex { x: 6, y }).unwrap().cost);
    assert!(
        rim.clone().filter(|cost| *cost >= 1.0).count() >= 12,
        "{:?}",
        rim.collect::<Vec<_>>()
    );
    assert!(map.cell(CellIndex { x: 20, y: 0 }).unwrap().cost < 0.05);
}

#[test]
fn water_is_level_and_costs_nothing_and_what_rises_from_it_does() {
    let mut octree = octree();
    // No returns from the water, where misses end.
    let far = (-40..40).map(|n| [3.9, f64::from(n) * 0.1 + 0.05]);
    let rays = far.flat_map(|[x, y]| {
        (0..8).map(move |n| Ray {
            origin: [-3.9, 0.05, 0.35].into(),
            end: [x - f64::from(n), y, 0.02].into(),
            is_hit: false,
        })
    });
    octree.integrate(SensorId(0), rays);
    hit(
        &mut octree,
        [-3.9, 0.05, 0.35],
        (0..6).map(|n| [1.55, 0.05, 0.05 + 0.1 * f64::from(n)]),
    );
    let mut map = updated(Surface::Water, &mut octree, 0.05);
    let pole = map.cell(CellIndex { x: 15, y: 0 }).unwrap();
    assert!(pole.cost >= 1.0 && !pole.is_clear_water, "{pole:?}");
    let water = map.cell(CellIndex { x: -10, y: 0 }).unwrap();
    assert!(water.cost == 0.0 && water.is_clear_water, "{water:?}");
    let beside = map.cell(CellIndex { x: 14, y: 0 }).unwrap();
    assert!(beside.cost == 0.0 && beside.is_clear_water, "{beside:?}");
    // A boat that heaves by half a voxel does not move the water level.
    map.take_changed();
    map.update(&mut octree, Point3::new(0.0, 0.0, 0.12));
    assert_eq!(map.take_changed(), []);
}

/// A slipway of 12° and the yard above it, from x = 0 on, in stripes: a tilting laser leaves gaps.
fn slipway() -> impl Iterator<Item = [f64; 3]> + Clone {
    let stripes = (0..68).filter(|n| n % 6 < 4);
    stripes.flat_map(|n| {
        let x = 0.025 + 0.05 * f64::from(n);
        let z = (x * 0.2126).min(0.5);
        (-24..24).map(move |row| [x, f64::from(row) * 0.05 + 0.02, z])
    })
}

#[test]
fn land_rising_from_water_is_a_slope_and_objects_lethal() {
    let mut octree = octree();
    see_shore(&mut octree, &slipway());
    let map = updated(Surface::Water, &mut octree, 0.05);
    let cell = |x: i32, y: i32| map.cell(CellIndex { x, y }).unwrap();
    for y in -8..8 {
        for x in 4..20 {
            // Up to the water level, a gap is water.
            let (cost, is_clear_water) = (cell(x, y).cost, cell(x, y).is_clear_water);
            let is_gap = x < 10 && is_clear_water && cost == 0.0;
            assert!(is_gap || (cost - 0.2126).abs() < 0.05, "{x} {y}: {cost}");
        }
        for x in 27..33 {
            let (cost, is_clear_water) = (cell(x, y).cost, cell(x, y).is_clear_water);
            // Level land is no docking site.
            assert!(cost >= 1.0 || cost == 0.0, "{x} {y}: {cost}");
            assert!(!is_clear_water, "{x} {y}");
        }
        assert!(cell(28, y).cost >= 1.0 || cell(29, y).cost >= 1.0);
        for x in -10..-2 {
            assert!(cell(x, y).is_clear_water, "{x} {y}");
        }
        for x in 0..33 {
            assert!(!cell(x, y).is_clear_water || x < 10, "{x} {y}");
        }
    }
}

/// From three places a boat hits the shore; misses end at the water before it.
fn see_shore(octree: &mut Octree, points: &(impl Iterator<Item = [f64; 3]> + Clone)) {
    for y in [-0.8, 0.0, 0.8] {
        hit(octree, [-1.5, y, 0.6], points.clone());
    }
    let ends = (-24..24).flat_map(|row| (0..14).map(move |n| (n, row)));
    let rays = ends.map(|(n, row)| Ray {
        origin: BOAT_LASER.into(),
        end: [
            -0.05 - 0.1 * f64::from(n),
            f64::from(row) * 0.05 + 0.02,
            0.0,
        ]
        .into(),
        is_hit: false,
    });
    octree.integrate(SensorId(0), rays);
}

const BOAT_LASER: [f64; 3] = [-1.5, 0.02, 0.6];

#[test]
fn a_gap_that_beams_graze_is_no_hole_in_a_ramp() {
    let mut octree = octree();
    let height_m = |x: f64| 0.2126 * x + 0.005;
    // In one row of columns, the upper side of the voxels of the water level has no hit: every beam
    // over it met the ramp right behind.
    let is_gap = |x: f64| (0.8..0.9).contains(&x);
    // Hits at a flat angle are above the ramp, by pose noise and because only the upper part of a
    // voxel is hit: 4 to 10 cm in world `dock`, here the same fraction of a voxel.
    let points = (0..60).map(|n| 0.025 + 0.05 * f64::from(n));
    let points = points.filter(|&x| !is_gap(x));
    let points = points.flat_map(|x| {
        (-24..24).map(move |row| [x, f64::from(row) * 0.05 + 0.02, height_m(x) + 0.02])
    });
    see_shore(&mut octree, &points);
    let grazing = (-24..24).map(|row| [0.905, f64::from(row) * 0.05 + 0.02, 0.198]);
    hit(&mut octree, BOAT_LASER, grazing);
    let map = updated(Surface::Water, &mut octree, 0.05);
    for y in -8..8 {
        let cell = |x: i32| map.cell(CellIndex { x, y }).unwrap();
        assert!(cell(8).is_clear_water, "{y}: {:?}", cell(8));
        for x in (4..8).chain(9..20) {
            let cost = cell(x).cost;
            assert!((cost - 0.2126).abs() < 0.05, "{x} {y}: {cost}");
        }
    }
}

#[test]
fn a_quay_beside_water_is_lethal_at_its_edge() {
    let mut octree = octree();
    // Its wall is a voxel above the water level; behind it the ground rises gently.
    let rows = (-24..24).map(|row| f64::from(row) * 0.05 + 0.02);
    let wall = rows
        .clone()
        .flat_map(|y| [0.03, 0.08, 0.13, 0.18, 0.23, 0.27].map(|z| [0.01, y, z]));
    let top = rows.flat_map(|y| {
        (1..60).map(move |n| {
            let x = 0.025 + 0.05 * f64::from(n);
            [x, y, 0.28 + 0.05 * x]
        })
    });
    see_shore(&mut octree, &wall.chain(top));
    let map = updated(Surface::Water, &mut octree, 0.05);
    for y in -8..8 {
        let cell = |x: i32| map.cell(CellIndex { x, y }).unwrap();
        for x in -10..-2 {
            assert!(cell(x).is_clear_water, "{x} {y}: {:?}", cell(x));
        }
        for x in 0..4 {
            assert!(cell(x).cost >= 1.0, "{x} {y}: {:?}", cell(x));
        }
    }
}

prop_compose! {
    fn scan()(
        x in -3.0..3.0f64, y in -3.0..3.0f64, z in -1.5..1.5f64,
        ends in prop::collection::vec((-5.0..5.0f64, -5.0..5.0f64, -1.0..1.5f64, 0.0..1.0f32), 1..60),
    ) -> ([f64; 3], Vec<([f64; 3], f32)>) {
        let ends = ends.into_iter().map(|(ex, ey, ez, m)| ([x + ex, y + ey, ez], m)).collect();
        ([x, y, z], ends)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Voxels change and are evicted, and the window moves: the map always equals one computed from
    /// scratch.
    #[test]
    fn it_is_the_map_that_would_be_computed_from_nothing(
        scans in prop::collection::vec(scan(), 2..10),
        on_water in any::<bool>(),
    ) {
        let surface = if on_water { Surface::Water } else { Surface::Land };
        let mut octree = octree();
        let mut map = map(surface);
        for (origin, ends) in scans {
            let rays = ends.iter().map(|(end, _)| Ray {
                origin: origin.into(), end: (*end).into(), is_hit: true,
            });
            octree.integrate(SensorId(0), rays);
            for (point, metric) in &ends {
                let hit = SurfaceHit {
                    point: (*point).into(), spot_m: *metric * 0.2, intra: *metric * 0.08, inter: *metric };
                octree.add_surfaces([hit], [0.3; 2]);
            }
            let mut whole = octree.clone();
            let vehicle = Point3::new(origin[0], origin[1], origin[2] * 0.5);
            map.update(&mut octree, vehicle);
            // Also with two threads.
            let mut fresh = CostMap {
                threads: 2, window: ColumnWindow::new(8.0, CELL_M), changed: Vec::new(), ..map.clone() };
            // With the same levels, which are kept while the vehicle moves vertically.
            fresh.update(&mut whole, vehicle);
            let bits = |map: &CostMap| -> Vec<_> {
                let mut cells = Vec::new();
                let (least, width) = map.cells(&mut cells, |cell| *cell);
                let cells = cells.iter().map(|c| (c.cost.to_bits(), c.rigidity, c.is_clear_water));
                cells.map(|cell| (least, width, cell)).collect()
            };
            prop_assert_eq!(bits(&map), bits(&fresh));
        }
    }
}

#[test]
fn metrics_of_a_column_are_those_of_the_voxel_that_decides() {
    let mut octree = octree();
    let origin = [0.0, 0.0, 2.0];
    let ground = surface(|_, _| 0.05);
    hit(&mut octree, origin, ground);
    // Voxels over x = 1.05 m, the last one higher than the vehicle; then one that has no metrics.
    let posts = [
        (1.05, 0.25, 0.2, 0.8),
        (1.05, 0.45, 0.6, 0.5),
        (1.05, 0.65, 0.4, 0.7),
        (1.05, 1.05, 1.0, 0.0),
        (-1.05, 0.45, f32::NAN, f32::NAN),
    ];
    let point = |x_m, z_m| Point3::new(x_m, 0.05, z_m);
    let rays = posts.map(|(x_m, z_m, ..)| Ray {
        origin: Point3::new(x_m, -3.0, z_m),
        end: point(x_m, z_m),
        is_hit: true,
    });
    octree.integrate(SensorId(0), rays);
    for (x_m, z_m, intra, inter) in posts {
        let hit = SurfaceHit {
            point: point(x_m, z_m),
            spot_m: 0.0,
            intra,
            inter,
        };
        octree.add_surfaces([hit], [0.3; 2]);
    }
    let map = updated(Surface::Land, &mut octree, 0.1);
    let at = |x_m: f64| {
        let cell = map.cell(VoxelIndex::containing(point(x_m, 0.0), CELL_M).column());
        cell.map(|cell| (cell.intra, cell.inter)).unwrap()
    };
    assert_eq!(at(1.05), (0.6, 0.5), "the widest and the stillest");
    assert_eq!(at(2.05), (0.3, 0.1), "of the ground where nothing stands");
    assert!(at(-1.05).0.is_nan() && at(-1.05).1.is_nan());
}
