use super::*;
use nalgebra::Point3;

use crate::cost_map::{CostConfig, Surface};
use crate::octree::{OctreeConfig, RangeSensorModel, Ray, SurfaceHit};
use crate::registered_scan::SensorId;
use crate::rigidity::RigidityConfig;
use crate::stem_density::tests::{DIVERGENCE_RAD, canes_and_a_trunk};

const CELL_M: f64 = 0.3;

const BOAT: VehicleShape = VehicleShape {
    length_m: 4.5,
    width_m: 2.44,
    height_m: 2.6,
    bottom_z_m: -0.6,
    wheelbase_m: 4.5,
};

/// Posts at these x, observed from y = 0; those from `rigid_from_m` on are rigid.
fn posts(octree: &mut Octree, xs_m: &[f64], rigid_from_m: f64) {
    for &x in xs_m {
        let points = [0.15, 0.45, 0.75].map(|z| Point3::new(x, 3.15, z));
        let rays = points.map(|end| Ray {
            origin: Point3::new(x, 0.0, 1.9),
            end,
            is_hit: true,
        });
        octree.integrate(SensorId(0), rays);
        for point in points {
            let intra = if x < rigid_from_m { 0.05 } else { 0.9 };
            let hit = SurfaceHit {
                point,
                spot_m: 0.0,
                intra,
                inter: 0.9,
            };
            octree.add_surfaces([hit], [0.3; 2]);
        }
    }
}

fn empty_maps() -> (Octree, CostMap) {
    let octree = OctreeConfig {
        enabled: true,
        cell_m: CELL_M,
        ..OctreeConfig::default()
    };
    let octree = Octree::new(&octree, &[RangeSensorModel::default()], 1);
    let config = CostConfig {
        enabled: true,
        box_m: 40.0,
        surface: Surface::Water,
        ..CostConfig::default()
    };
    let costs = CostMap::new(&config, &RigidityConfig::default(), BOAT, (CELL_M, true), 1);
    (octree, costs)
}

#[test]
fn a_shore_that_the_boat_leaves_stays_what_it_was() {
    let (mut octree, mut costs) = empty_maps();
    // 18 m, the last third of which is rigid: ρ = 1/3 of the whole, 1 of its end.
    let xs_m: Vec<f64> = (0..20).map(|n| 0.15 + 0.9 * f64::from(n)).collect();
    posts(&mut octree, &xs_m, 12.0);
    let mut layer = ShoreLayer::new(&ShoreConfig::default(), BOAT, CELL_M);
    let mut update = |x: f64| {
        costs.update(&mut octree, Point3::new(x, 0.0, 0.0));
        layer.update(&costs, &octree, Point2::new(x, 0.0));
        let clusters = layer.clusters();
        clusters
            .map(|c| (c.number, c.voxels, c.class))
            .collect::<Vec<_>>()
    };
    let whole = update(9.0);
    assert_eq!(whole, [(1, 60, ShoreClass::Dense)]);
    for x in (9..80).step_by(2) {
        assert_eq!(update(f64::from(x)), whole, "{x}");
    }
}

#[test]
fn an_update_in_parts_is_of_the_maps_as_it_began() {
    let (mut octree, mut costs) = empty_maps();
    posts(&mut octree, &[0.15, 1.05, 1.95], 12.0);
    costs.update(&mut octree, Point3::origin());
    let mut whole = ShoreLayer::new(&ShoreConfig::default(), BOAT, CELL_M);
    let mut parts = whole.clone();
    whole.update(&costs, &octree, Point2::origin());
    parts.begin_update(&costs, &octree, Point2::origin());
    octree.erase();
    costs.erase();
    for _ in 0..3 {
        parts.continue_update();
        assert_eq!((parts.updates(), parts.clusters().count()), (0, 0));
    }
    parts.continue_update();
    let clusters: Vec<_> = whole.clusters().collect();
    assert_eq!(clusters.len(), 1);
    assert_eq!(parts.clusters().collect::<Vec<_>>(), clusters);
    assert_eq!(
        (parts.updates(), parts.take_changed()),
        (1, whole.take_changed())
    );
    parts.continue_update();
    assert_eq!(parts.updates(), 1);
}

/// Docking sites beside a boat over a bed of height `bed_m(x, y)`, metres, observed from above;
/// `None` is too deep.
fn sites(bed_m: impl Fn(f64, f64) -> Option<f64>) -> Vec<DockingSite> {
    let (mut octree, mut costs) = empty_maps();
    let middles = |from: i32, to: i32| (from..to).map(|n| (f64::from(n) + 0.5) * CELL_M);
    let places = middles(-40, 60).flat_map(|x| middles(-30, 30).map(move |y| (x, y)));
    let seen = places.map(|(x, y)| (Point3::new(x, y, 1.9), bed_m(x, y)));
    let seen: Vec<_> = seen.collect();
    let rays = seen.iter().map(|&(origin, bed_m)| Ray {
        origin,
        end: Point3::new(origin.x, origin.y, bed_m.unwrap_or(0.02)),
        is_hit: bed_m.is_some(),
    });
    octree.integrate(SensorId(0), rays);
    for (origin, bed_m) in seen {
        if let Some(z) = bed_m {
            let hit = SurfaceHit {
                point: Point3::new(origin.x, origin.y, z),
                spot_m: 0.0,
                intra: 0.9,
                inter: 0.1,
            };
            octree.add_surfaces([hit], [0.3; 2]);
        }
    }
    let mut layer = ShoreLayer::new(&ShoreConfig::default(), BOAT, CELL_M);
    // The water level is in the middle of its voxels.
    costs.update(&mut octree, Point3::new(0.0, 0.0, 0.5 * CELL_M));
    layer.update(&costs, &octree, Point2::origin());
    let beside = CellIndex { x: 16, y: 0 };
    let cost = costs.cell(beside).unwrap().cost;
    assert!(cost > 0.01 && cost < 0.3, "{cost} is moderate");
    layer.docking_sites().to_vec()
}

#[test]
fn bank_is_a_docking_site_and_shoal_is_not() {
    let rising = |slope: f64| {
        move |x: f64, y: f64| {
            let is_there = (3.0..12.0).contains(&x) && y.abs() < 4.0;
            is_there.then_some(-0.5 + slope * (x - 3.0))
        }
    };
    // All of it is under water: the hulls, which reach down to 60 cm, touch it.
    assert_eq!(sites(rising(0.03)), []);
    let bank = sites(rising(0.15));
    assert_eq!(bank.len(), 1);
    // The part under water belongs to the site.
    assert!(bank[0].cells.contains(&CellIndex { x: 12, y: 0 }));
}

#[test]
fn near_the_boat_canes_beside_a_trunk_give_way() {
    let config = ShoreConfig {
        near_m: 20.0,
        ..ShoreConfig::default()
    };
    let mut layer = ShoreLayer::new(&config, BOAT, CELL_M);
    for scan in canes_and_a_trunk() {
        layer.add_scan(&scan, DIVERGENCE_RAD, 0.0);
    }
    let columns = (-40..40).flat_map(|x| (33..45).map(move |y| CellIndex { x, y }));
    let columns: Vec<_> = columns.collect();
    let densest = layer.stems.densest(&columns);
    let cluster = ShoreCluster {
        number: 1,
        voxels: 1,
        rigid_voxels: 0,
        ratio: 0.0,
        densest,
        class: layer.config.class_of_densest(densest.unwrap()),
        centre_in_odom: Point3::origin(),
        columns,
    };
    assert_eq!(cluster.class, ShoreClass::Solid);
    let part = layer
        .passable_part(&cluster, Point2::origin())
        .expect("a part that gives way");
    assert_eq!((part.number, part.class), (1, ShoreClass::Sparse));
    let has = |x_m: f64, y_m: f64| {
        part.columns
            .binary_search(&CellIndex::containing(Point2::new(x_m, y_m), CELL_M))
            .is_ok()
    };
    assert!(has(-5.0, 10.5) && has(5.0, 10.5), "canes");
    assert!(
        !has(0.0, 10.0) && !has(1.0, 10.5),
        "the trunk and beside it"
    );
    let far = Point2::new(0.0, -20.0);
    assert_eq!(layer.passable_part(&cluster, far), None, "too far");
    layer.config.near_m = 0.0;
    assert_eq!(layer.passable_part(&cluster, Point2::origin()), None);
}

#[test]
fn a_site_in_vegetation_stays_while_the_boat_is_near_one_of_its_cells() {
    let (mut octree, mut costs) = empty_maps();
    costs.update(&mut octree, Point3::origin());
    let mut layer = ShoreLayer::new(&ShoreConfig::default(), BOAT, CELL_M);
    let cell = CellIndex { x: 20, y: 0 };
    let site = |number, vegetation, price| DockingSite {
        number,
        cells: vec![CellIndex { x: 0, y: 0 }, cell],
        centre_in_odom: Point2::new(-20.0, 0.0),
        heading_rad: 0.0,
        vegetation,
        price,
        approach_in_odom: Point2::origin(),
        passable: vec![cell],
        width_m: 3.0,
    };
    layer.sites = vec![
        site(1, Some(ShoreClass::Dense), 1.5),
        site(2, Some(ShoreClass::Sparse), 1.2),
        site(3, None, 0.2),
    ];
    let numbers = |layer: &ShoreLayer| -> Vec<_> {
        let sites = layer.docking_sites().iter();
        sites
            .map(|site| (site.number, site.passable.len()))
            .collect()
    };
    layer.update(&costs, &octree, Point2::new(10.4, 0.15));
    assert_eq!(numbers(&layer), [(2, 0), (1, 0)], "nothing grows there now");
    layer.update(&costs, &octree, Point2::new(10.8, 0.15));
    assert_eq!(numbers(&layer), []);
}
