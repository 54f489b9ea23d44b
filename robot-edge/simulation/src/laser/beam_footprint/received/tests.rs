use nalgebra::{Point3, Vector2, Vector3};

use super::*;
use crate::scene::Scene;
use crate::solid::{Reflectivity, Shape, Solid};
use crate::vegetation::stem::Stem;
use crate::vegetation::wind::Wind;
use crate::vegetation::{Patch, Rigidity, Vegetation};
use measurement::pose::Pose;

const RECEIVER: Receiver = Receiver {
    min_share: 0.05,
    separation_m: 0.75,
};

fn scene(solids: &[Solid], canes: &[(f64, f64)], radius_m: f64) -> Scene {
    let stems: Vec<Stem> = canes
        .iter()
        .map(|&(x, y)| Stem {
            foot_m: Point3::new(x, y, -1.0),
            top_m: Point3::new(x, y, 1.0),
            radius_m,
            reach_m: [0.0, 0.0],
            phases: [[0.0, 1.0]; 3],
        })
        .collect();
    let patch = Patch {
        name: String::new(),
        rigidity: Rigidity::Flexible,
        stems: 0..stems.len(),
    };
    Scene::new(solids).with_growth(Growth {
        vegetation: Vegetation::new(stems, vec![patch], Wind::CALM),
        receiver: RECEIVER,
    })
}

fn a_box(centre_m: [f64; 3], size_m: [f64; 3]) -> Solid {
    Solid {
        name: String::new(),
        shape: Shape::Box { size_m },
        world_from_solid: Pose::translation(centre_m[0], centre_m[1], centre_m[2]),
        reflectivity: Reflectivity::Diffuse,
        motion: None,
    }
}

fn range_along(scene: &Scene, axis: Vector3<f64>, divergence_rad: f64) -> Option<f64> {
    let footprint = BeamFootprint {
        scene,
        origin: Point3::origin(),
        axis: axis.normalize(),
        divergence_rad,
        max_m: 50.0,
        time_s: 0.0,
        surface_chance: 0.5,
    };
    footprint.path_m(0.0, 0.5)
}

/// Of a beam of an LMS111 along x.
fn range_m(scene: &Scene) -> Option<f64> {
    range_along(scene, Vector3::x(), 0.015)
}

#[test]
fn one_thin_cane_in_a_wide_spot_is_missed_and_several_are_seen() {
    // At 20 m the spot is 30 cm wide; a cane of 5 mm fills 2.1 % of it.
    assert_eq!(range_m(&scene(&[], &[(20.0, 0.0)], 0.0025)), None);
    let several = [(20.0, 0.0), (20.1, 0.05), (20.2, -0.05)];
    let range = range_m(&scene(&[], &several, 0.0025)).unwrap();
    assert!((range - 20.1).abs() < 0.01, "{range}");
    // So does one alone at 2 m, where the spot is 3 cm, and one of 5 cm at 20 m.
    assert!((range_m(&scene(&[], &[(2.0, 0.0)], 0.0025)).unwrap() - 2.0).abs() < 1e-9);
    assert!((range_m(&scene(&[], &[(20.0, 0.0)], 0.025)).unwrap() - 20.0).abs() < 1e-9);
    // Three that are farther apart than a pulse is long are three echoes too weak.
    let far_apart = [(19.0, 0.0), (20.0, 0.05), (21.0, -0.05)];
    assert_eq!(range_m(&scene(&[], &far_apart, 0.0025)), None);
}

#[test]
fn what_is_behind_shows_through_gaps() {
    let wall = a_box([15.5, 0.0, 0.0], [1.0, 40.0, 4.0]);
    let behind_one = scene(std::slice::from_ref(&wall), &[(10.0, 0.0)], 0.002);
    // 4 mm of 15 cm: 3.4 %.
    assert!((range_m(&behind_one).unwrap() - 15.0).abs() < 1e-9);
    // 12 mm are noticed, and hide the wall though 90 % of the light falls on it.
    let behind_a_thick_one = scene(std::slice::from_ref(&wall), &[(10.0, 0.0)], 0.006);
    assert!((range_m(&behind_a_thick_one).unwrap() - 10.0).abs() < 1e-9);
    // Within a pulse of the wall both make one echo, which lies where most of the light does.
    let before_it = scene(&[wall], &[(14.5, 0.0)], 0.006);
    let range = range_m(&before_it).unwrap();
    let share = 0.012 * 0.2175 / (std::f64::consts::PI * 0.10875 * 0.10875);
    assert!((range - (15.0 - 0.5 * share)).abs() < 1e-3, "{range}");
}

#[test]
fn edges_share_out_the_light_and_surfaces_that_go_on_do_not_spread_it() {
    let far = [(40.0, 20.0)];
    // Half of the spot on a wall at 4 m, half at 6 m: the near one is strong enough.
    let walls = [
        a_box([4.5, 5.0, 0.0], [1.0, 10.0, 4.0]),
        a_box([6.5, 0.0, 0.0], [1.0, 60.0, 4.0]),
    ];
    assert!((range_m(&scene(&walls, &far, 0.01)).unwrap() - 4.0).abs() < 0.01);
    // Less than a pulse apart they mix by their shares: 3 of 8 rays around and the axis are off the near.
    let walls = [
        a_box([4.5, 5.001, 0.0], [1.0, 10.0, 4.0]),
        a_box([5.0, 0.0, 0.0], [1.0, 60.0, 4.0]),
    ];
    let range = range_m(&scene(&walls, &far, 0.01)).unwrap();
    assert!((4.1..4.4).contains(&range), "{range}");
    // Ground at a flat angle: the spot is drawn out over more than a metre, its range is the axis'.
    let ground = a_box([0.0, 0.0, -1.58], [100.0, 100.0, 1.0]);
    let flat = Vector3::new(libm::cos(0.1), 0.0, -libm::sin(0.1));
    let range = range_along(&scene(&[ground], &far, 0.01), flat, 0.015).unwrap();
    assert!((range - 1.08 / libm::sin(0.1)).abs() < 1e-9);
}

#[test]
fn nothing_returns_through_the_surface_of_water() {
    let bed = a_box([0.0, 0.0, -5.0], [100.0, 100.0, 2.0]);
    let down = Vector3::new(1.0, 0.0, -1.0);
    for plants in [true, false] {
        let dry = if plants {
            scene(std::slice::from_ref(&bed), &[(30.0, 0.0)], 0.01)
        } else {
            Scene::new(std::slice::from_ref(&bed))
        };
        // A laser 1 m above the water, the bed 4 m below the laser.
        let range = range_along(&dry, down, 0.0).unwrap();
        assert!((range - 4.0 * std::f64::consts::SQRT_2).abs() < 1e-6);
        let lake = dry.with_water(-1.0);
        assert_eq!(range_along(&lake, down, 0.0), None);
        assert_eq!(range_along(&lake, down, 0.015), None);
        // A sonar 1 m below the surface sees the bed and nothing above.
        let sonar = dry_again(&bed, plants).with_water(1.0);
        let range = range_along(&sonar, down, 0.05).unwrap();
        assert!((range - 4.0 * std::f64::consts::SQRT_2).abs() < 1e-6);
        assert_eq!(range_along(&sonar, Vector3::new(1.0, 0.0, 1.0), 0.05), None);
        assert_eq!(range_along(&sonar, Vector3::z(), 0.05), None);
    }
}

fn dry_again(bed: &Solid, plants: bool) -> Scene {
    // And a bridge above the water.
    let solids = [bed.clone(), a_box([0.0, 0.0, 5.0], [100.0, 100.0, 1.0])];
    if plants {
        scene(&solids, &[(30.0, 0.0)], 0.01)
    } else {
        Scene::new(&solids)
    }
}

/// Tall grass from a distance on, 3 m deep: 300 blades of 6 mm a square metre, which stop half of the light
/// in 0.38 m.
fn meadow(from_m: f64) -> Scene {
    let mut noise = crate::noise::NoiseStream::new(4, "test");
    let blades: Vec<(f64, f64)> = (0..3600)
        .map(|_| (from_m + 3.0 * noise.uniform(), 4.0 * noise.uniform() - 2.0))
        .collect();
    scene(&[], &blades, 0.003)
}

#[test]
fn ranges_scatter_in_near_grass_and_less_where_the_spot_holds_many_blades() {
    let depths = |from_m: f64| -> Vec<f64> {
        let scene = meadow(from_m);
        (-20..=20)
            .filter_map(|n| {
                let heading = Vector2::new(1.0, 0.05 * f64::from(n) / from_m);
                let axis = Vector3::new(heading.x, heading.y, 0.0);
                Some(range_along(&scene, axis, 0.015)? - from_m)
            })
            .collect()
    };
    let spread = |depths: &[f64]| {
        let n = depths.len() as f64;
        let mean = depths.iter().sum::<f64>() / n;
        let variance = depths.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() / n;
        (mean, libm::sqrt(variance))
    };
    let (near, far) = (depths(2.0), depths(15.0));
    assert_eq!((near.len(), far.len()), (41, 41));
    let ((near_mean, near_spread), (far_mean, far_spread)) = (spread(&near), spread(&far));
    assert!(
        near_spread > 0.12 && far_spread < 0.1,
        "{near_spread} {far_spread}"
    );
    assert!((0.2..0.6).contains(&near_mean) && (0.2..0.5).contains(&far_mean));
}
