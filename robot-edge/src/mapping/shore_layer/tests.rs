use nalgebra::Point3;

use super::*;
use crate::mapping::cost_config::{CostConfig, RigidityConfig, Surface};
use crate::mapping::octree::{Ray, SurfaceHit};
use crate::mapping::octree_config::{OctreeConfig, RangeSensorModel};
use crate::mapping::posed_scan::SensorId;

const CELL_M: f64 = 0.3;

const BOAT: VehicleShape = VehicleShape {
    length_m: 4.5,
    width_m: 2.44,
    height_m: 2.6,
    lowest_point_m: -0.6,
    wheelbase_m: 4.5,
};

/// Posts at these x, seen from y = 0; those from `rigid_from_m` on are rigid.
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
            octree.add_surface(&hit, 0.3);
        }
    }
}

#[test]
fn a_shore_that_the_boat_leaves_stays_what_it_was() {
    let octree = OctreeConfig {
        enabled: true,
        cell_m: CELL_M,
        ..OctreeConfig::default()
    };
    let mut octree = Octree::new(&octree, &[RangeSensorModel::default()], 1);
    // 18 m, the last third of which is rigid: ρ = 1/3 of the whole, 1 of its end.
    let xs_m: Vec<f64> = (0..20).map(|n| 0.15 + 0.9 * f64::from(n)).collect();
    posts(&mut octree, &xs_m, 12.0);
    let config = CostConfig {
        enabled: true,
        box_m: 40.0,
        surface: Surface::Water,
        ..CostConfig::default()
    };
    let mut costs = CostMap::new(&config, &RigidityConfig::default(), BOAT, CELL_M, 1);
    let mut layer = ShoreLayer::new(&ShoreConfig::default(), BOAT, CELL_M);
    let mut update = |x: f64| {
        costs.update(&mut octree, Point3::new(x, 0.0, 0.0));
        layer.update(&costs, &octree);
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
