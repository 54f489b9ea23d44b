//! The truth of a shore: the greatest force on a hull that pushes into it, over the thrust.
//!
//! A cane is a hollow rod clamped in the bed. The hull bends it at the waterline, linearly, until its outer fibres
//! break or it lies flat; then it no longer resists. So those canes resist at the same time that stand in front of
//! the hull no farther behind its front than they bend. Whatever is rigid resists without limit.

use std::f64::consts::PI;

use mapping::shore::ShoreConfig;
use nalgebra::{Point2, Point3};
use simulation::World;
use simulation::dynamics::Drive;
use simulation::vegetation::{Rigidity, Stem};
use simulation::world::{Shore, ShoreClass};

/// Of common reed along its fibres, as beams of reed in bending \[Albrecht et al. 2023, "The suitability of common reed
/// (Phragmites australis) for load-bearing structural materials", J. Mater. Sci. 58\], pascals. The strength was measured dry,
/// `150e6` in tension; green canes bend and give way earlier. It was set by the kinds of the document, before a shore that H8
/// judges was classified: of its four fields of 35 stems, all Dense, the strongest meets 0.60 of the thrust (1.02 with `150e6`).
const MODULUS_PA: f64 = 8e9;
const STRENGTH_PA: f64 = 115e6;
/// Inner diameter of a stem by its outer one: a wall of a tenth of the diameter. Assumed.
const HOLLOW: f64 = 0.8;
/// Of the boat whose drag the simulated one has, which is given per mass: the WAM-V of Virtual `RobotX`.
const MASS_KG: f64 = 180.0;
/// Between places of the hull along the shore, and between its fronts, metres.
const STEP_M: f64 = 0.1;

/// Shares of thrust that divide the classes: the document's ρ [HYB §7.2], set here before the first run. Against 0.25
/// of its thrust `riverwatch` still makes 85 % of its greatest speed, against 0.68 a half.
pub(super) fn class_of(force_over_thrust: f64) -> ShoreClass {
    let ShoreConfig {
        sparse_below,
        solid_above,
        ..
    } = ShoreConfig::default();
    if force_over_thrust < sparse_below {
        ShoreClass::Sparse
    } else if force_over_thrust <= solid_above {
        ShoreClass::Dense
    } else {
        ShoreClass::Solid
    }
}

/// The greatest force that the world's boat meets in a shore, pushing straight away from y = 0, over its thrust.
/// Infinite where anything rigid stands within the height of its body: a solid, a rigid plant, ground.
pub(super) fn force_over_thrust(world: &World, shore: &Shore) -> f64 {
    let boat = world.simulated_vehicle();
    let water_m = world.water_m().unwrap_or_default();
    let corners = &shore.polygon_m;
    let least = corners
        .iter()
        .fold(Point2::from([f64::INFINITY; 2]), |a, b| a.inf(b));
    let most = corners
        .iter()
        .fold(Point2::from([f64::NEG_INFINITY; 2]), |a, b| a.sup(b));
    let at =
        |corner: Point2<f64>, height_m: f64| Point3::new(corner.x, corner.y, water_m + height_m);
    let (lowest, highest) = (at(least, boat.body.lowest_m), at(most, boat.body.highest_m));
    let growth = world.scene().growth();
    let rigid_plants = growth.and_then(|growth| growth.vegetation.standing_in(lowest, highest));
    if world.scene().touches_box(lowest, highest, 0.0) || rigid_plants == Some(Rigidity::Rigid) {
        return f64::INFINITY;
    }
    let away = 0.5 * (least.y + most.y);
    let stems = growth.map_or(&[][..], |growth| growth.vegetation.stems());
    let canes = stems.iter().filter(|stem| shore.contains(stem.foot_m.xy()));
    let canes = canes.filter_map(|stem| Cane::of(stem, water_m, away.signum()));
    greatest_force_n(&canes.collect::<Vec<_>>(), boat.body.width_m) / thrust_n(boat.drive)
}

/// What the drive gives ahead, newtons; a vehicle on wheels has none.
fn thrust_n(drive: Drive) -> f64 {
    match drive {
        Drive::Thrusters(boat) => {
            let (drag, speed) = (boat.surge_drag, boat.max_speed_mps);
            MASS_KG * speed * (drag.linear_per_s + drag.quadratic * speed)
        }
        Drive::Wheels(_) => 0.0,
    }
}

/// What a hull bends.
struct Cane {
    /// Along the shore and away from the boat, metres.
    at_m: [f64; 2],
    /// Newtons per metre that the waterline is bent away.
    stiffness_npm: f64,
    /// How far until it no longer resists, metres.
    gives_way_m: f64,
}

impl Cane {
    /// `None` for leaves, whose feet move, and for what stands on land.
    fn of(stem: &Stem, water_m: f64, outward: f64) -> Option<Self> {
        let lever_m = water_m - stem.foot_m.z;
        (stem.reach_m[0] == 0.0 && lever_m > 0.0).then(|| {
            let [stiffness_npm, gives_way_m] = bending(2.0 * stem.radius_m, lever_m);
            Self {
                at_m: [stem.foot_m.x, outward * stem.foot_m.y],
                stiffness_npm,
                gives_way_m,
            }
        })
    }
}

/// Stiffness of a cane's cantilever, newtons per metre, and how far its end bends before its outer fibres break or it
/// lies flat, metres.
fn bending(diameter_m: f64, lever_m: f64) -> [f64; 2] {
    let inertia_m4 = PI / 64.0 * diameter_m.powi(4) * (1.0 - HOLLOW.powi(4));
    let stiffness_npm = 3.0 * MODULUS_PA * inertia_m4 / lever_m.powi(3);
    let breaks_m = 2.0 / 3.0 * STRENGTH_PA / MODULUS_PA * lever_m * lever_m / diameter_m;
    [stiffness_npm, breaks_m.min(lever_m)]
}

/// Over all places of a hull of this width along the shore, and all that its front may have come in.
fn greatest_force_n(canes: &[Cane], width_m: f64) -> f64 {
    let steps = |metres: f64| libm::ceil(metres / STEP_M).max(0.0) as usize;
    let least = canes.iter().fold([f64::INFINITY; 2], |[x, y], cane| {
        [x.min(cane.at_m[0]), y.min(cane.at_m[1])]
    });
    let farthest = |axis: usize| {
        canes
            .iter()
            .map(|cane| cane.at_m[axis] - least[axis])
            .fold(0.0, f64::max)
    };
    let deepest_m = canes
        .iter()
        .map(|cane| cane.gives_way_m)
        .fold(0.0, f64::max);
    let (wide, fronts) = (steps(width_m), steps(farthest(1) + deepest_m) + 1);
    // Forces by the place of the canes along the shore, in steps, and the hull's front.
    let mut forces_n = vec![vec![0.0; fronts]; steps(farthest(0)) + 1];
    for cane in canes {
        let [along_m, away_m] = [0, 1].map(|axis| cane.at_m[axis] - least[axis]);
        let column = libm::floor(along_m / STEP_M) as usize;
        for front in steps(away_m)..=steps(away_m + cane.gives_way_m) {
            let bent_m = front as f64 * STEP_M - away_m;
            if bent_m <= cane.gives_way_m
                && let Some(force_n) = forces_n.get_mut(column).and_then(|c| c.get_mut(front))
            {
                *force_n += cane.stiffness_npm * bent_m;
            }
        }
    }
    let columns = forces_n.len();
    let hulls = (0..columns).map(|first| &forces_n[first..columns.min(first + wide)]);
    hulls
        .flat_map(|hull| (0..fronts).map(|front| hull.iter().map(|column| column[front]).sum()))
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn canes(places: &[[f64; 2]]) -> Vec<Cane> {
        let cane = |&at_m| Cane {
            at_m,
            stiffness_npm: 10.0,
            gives_way_m: 0.5,
        };
        places.iter().map(cane).collect()
    }

    #[test]
    fn a_cane_bends_as_a_cantilever_until_it_breaks_or_lies_flat() {
        // 11 mm, 0.7 m under water: 3EI/L³ with I = 4.243e-10 m⁴; 2σL²/(3Ed) = 0.427 m.
        let [stiffness_npm, gives_way_m] = bending(0.011, 0.7);
        assert!((stiffness_npm - 29.69).abs() < 0.02, "{stiffness_npm}");
        assert!((gives_way_m - 0.4269).abs() < 1e-3, "{gives_way_m}");
        // It breaks at σ·2I/d over the lever.
        let breaks_n = STRENGTH_PA * 2.0 * 4.243e-10 / 0.011 / 0.7;
        assert!((stiffness_npm * gives_way_m / breaks_n - 1.0).abs() < 1e-3);
        assert!((bending(0.002, 0.7)[1] - 0.7).abs() < 1e-9);
    }

    #[test]
    fn canes_resist_together_that_are_bent_at_the_same_time() {
        for (places, expected_n) in [
            (&[][..], 0.0),
            (&[[0.05, 0.0]][..], 5.0),
            // Side by side within the hull, and just outside of it.
            (&[[0.05, 0.0], [1.95, 0.0]], 10.0),
            (&[[0.05, 0.0], [2.15, 0.0]], 5.0),
            // The second is bent by 0.3 m when the first gives way.
            (&[[0.05, 0.0], [0.05, 0.2]], 8.0),
            (&[[0.05, 0.0], [0.05, 0.6]], 5.0),
        ] {
            let force_n = greatest_force_n(&canes(places), 2.0);
            assert!((force_n - expected_n).abs() < 1e-9, "{places:?}: {force_n}");
        }
    }

    #[test]
    fn an_even_field_resists_with_the_work_of_its_canes_per_metre() {
        // 500 canes a square metre, a work of ½·10·0.5² = 1.25 J each, 2 m wide: 1250 N.
        let places = (0..40).flat_map(|x| (0..100).map(move |y| [x, y].map(f64::from)));
        let places: Vec<_> = places.map(|[x, y]| [0.1 * x + 0.05, 0.02 * y]).collect();
        let force_n = greatest_force_n(&canes(&places), 2.0);
        assert!((force_n / 1250.0 - 1.0).abs() < 0.1, "{force_n}");
    }

    #[test]
    fn the_documents_kinds_have_the_classes_of_the_lake() {
        let lake = World::load("lake").unwrap();
        assert!((thrust_n(lake.simulated_vehicle().drive) - 805.5).abs() < 0.1);
        for shore in lake.shores() {
            let ratio = force_over_thrust(&lake, shore);
            assert_eq!(class_of(ratio), shore.class, "{}: {ratio}", shore.name);
        }
    }
}
