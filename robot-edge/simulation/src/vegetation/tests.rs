#![expect(clippy::float_cmp, reason = "these values are exact")]

use nalgebra::{Point2, Vector2};
use proptest::prelude::*;

use super::{Area, Phases, *};
use crate::noise::NoiseStream;
use crate::vegetation::growth::{Crowns, Growth, PlantGenerator, Shoots, Stand, TooMany, Tufts};

const STILL: Phases = [[0.0, 1.0]; 3];

const BREEZE: Wind = Wind {
    towards: Vector2::new(1.0, 0.0),
    lean: 0.05,
    sway: 0.1,
    period_s: 1.5,
};

fn rod(foot_m: [f64; 3], top_m: [f64; 3], radius_m: f64) -> Stem {
    Stem {
        foot_m: Point3::from(foot_m),
        top_m: Point3::from(top_m),
        radius_m,
        reach_m: [0.0, 0.0],
        phases: STILL,
    }
}

fn of(stems: Vec<Stem>, wind: Wind) -> Vegetation {
    let patch = Patch {
        name: String::new(),
        rigidity: Rigidity::Flexible,
        stems: 0..stems.len(),
    };
    Vegetation::new(stems, vec![patch], wind)
}

/// From 1 m above the origin along x.
fn level(spread: f64) -> Cone {
    Cone {
        origin: Point3::new(0.0, 0.0, 1.0),
        axis: Vector3::x(),
        spread,
    }
}

#[test]
fn a_cane_fills_as_much_of_the_spot_as_it_covers() {
    // 15 mrad at 20 m: a spot of 30 cm.
    let spot = |x, y, top, radius_m| {
        let vegetation = of(
            vec![rod([x, y, 0.0], [x, y, top], radius_m)],
            Wind::default(),
        );
        let lit = vegetation.lit(&level(0.0075), 30.0, 0.0);
        lit.first().copied()
    };
    let through_the_middle = spot(20.0, 0.0, 2.0, 0.0025).unwrap();
    assert!((through_the_middle.distance_m - 20.0).abs() < 1e-9);
    let expected = 0.005 * 0.3 / (std::f64::consts::PI * 0.15 * 0.15);
    assert!((through_the_middle.share - expected).abs() < 1e-5);
    // It ends in the middle of the spot.
    assert!((spot(20.0, 0.0, 1.0, 0.0025).unwrap().share - 0.5 * expected).abs() < 1e-5);
    // Aside by 0.6 of the spot's radius, where its chord is 0.8 of the diameter.
    assert!((spot(20.0, 0.09, 2.0, 0.0025).unwrap().share - 0.8 * expected).abs() < 1e-4);
    assert_eq!(spot(20.0, 0.153, 2.0, 0.0025), None);
    assert_eq!(spot(20.0, 0.0, 0.84, 0.0025), None);
    // A trunk fills the spot.
    assert_eq!(spot(20.0, 0.0, 2.0, 0.4).unwrap().share, 1.0);
}

proptest! {
    #[test]
    fn shares_are_the_parts_of_the_spot_that_a_strip_covers(
        aside_m in -0.2_f64..0.2, end_m in -0.2_f64..0.2, tilt_rad in -1.5_f64..1.5,
        radius_m in 0.001_f64..0.05,
    ) {
        // In the plane x = 20: a strip that ends at `end_m` along itself.
        let (sin, cos) = (libm::sin(tilt_rad), libm::cos(tilt_rad));
        let at = |along: f64| [20.0, -aside_m * cos - along * sin, 1.0 - aside_m * sin + along * cos];
        let vegetation = of(vec![rod(at(-3.0), at(end_m), radius_m)], Wind::default());
        let lit: f64 = vegetation.lit(&level(0.0075), 30.0, 0.0).iter().map(|spot| spot.share).sum();
        let n = 200;
        let (mut covered, mut all) = (0, 0);
        for i in 0..n * n {
            let [u, v] = [i % n, i / n].map(|k| (f64::from(k) + 0.5) / f64::from(n) * 0.3 - 0.15);
            if u * u + v * v < 0.15 * 0.15 {
                all += 1;
                covered += i32::from((u - aside_m).abs() < radius_m && v < end_m);
            }
        }
        let expected = f64::from(covered) / f64::from(all);
        prop_assert!((lit - expected).abs() < 0.04, "{lit} {expected}");
    }

    #[test]
    fn bins_lose_and_double_nothing(
        seed in 0_u64..1000, heading_rad in -3.2_f64..3.2, pitch_rad in -1.5_f64..1.5, time_s in 0.0_f64..9.0,
    ) {
        let mut noise = NoiseStream::new(seed, "test");
        let mut within = |most: f64| most * (2.0 * noise.uniform() - 1.0);
        let stems: Vec<Stem> = (0..300)
            .map(|n| {
                let foot = [within(4.0), within(4.0), within(0.5)];
                let top = [foot[0] + within(0.5), foot[1] + within(0.5), foot[2] + 1.0];
                Stem { reach_m: [0.0, f64::from(n % 2)], ..rod(foot, top, 0.01) }
            })
            .collect();
        let level = libm::cos(pitch_rad);
        let axis = Vector3::new(
            level * libm::cos(heading_rad), level * libm::sin(heading_rad), libm::sin(pitch_rad),
        );
        let cone = Cone { origin: Point3::new(0.3, -0.2, 0.4), axis, spread: 0.02 };
        let mut expected: Vec<Spot> = stems
            .iter()
            .filter_map(|stem| Spot::on(stem, &cone, &BREEZE.at(time_s)))
            .collect();
        expected.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
        let mut left = 1.0;
        for spot in &mut expected {
            spot.share *= left;
            left -= spot.share;
        }
        let lit = of(stems, BREEZE).lit(&cone, 20.0, time_s);
        // The walk may end early where nothing is left.
        prop_assert!(lit.len() == expected.len() || left <= SPENT, "{} {}", lit.len(), expected.len());
        for (spot, expected) in lit.iter().zip(&expected) {
            prop_assert_eq!(spot, expected);
        }
    }
}

#[test]
fn wind_moves_tops_by_their_reach_and_feet_not_at_all() {
    let blade = Stem {
        reach_m: [0.0, 0.8],
        ..rod([5.0, 0.0, 0.0], [5.0, 0.0, 0.8], 0.003)
    };
    let times = (0..4000).map(|n| 0.05 * f64::from(n));
    let offsets: Vec<Vector3<f64>> = times
        .map(|time_s| {
            let [foot, top] = blade.ends_m(&BREEZE.at(time_s));
            assert_eq!(foot, blade.foot_m);
            top - blade.top_m
        })
        .collect();
    let mean = offsets.iter().sum::<Vector3<f64>>() / 4000.0;
    // It leans by 5 % of its height with the wind, swings by 10 % and by 4 % across.
    assert!(
        (mean.x - 0.04).abs() < 0.002 && mean.y.abs() < 0.002,
        "{mean}"
    );
    let most = offsets.iter().fold(Vector3::zeros(), |m: Vector3<f64>, o| {
        m.sup(&(o - mean).abs())
    });
    assert!(most.x > 0.07 && most.x < 0.0801, "{most}");
    assert!(most.y > 0.028 && most.y < 0.0321, "{most}");
    // At 2 m the beam loses the blade where it swings aside and finds it again.
    let vegetation = of(vec![blade], BREEZE);
    let seen: Vec<bool> = (0..40)
        .map(|n| {
            !vegetation
                .lit(&level(0.0), 10.0, 0.1 * f64::from(n))
                .is_empty()
        })
        .collect();
    assert!(!seen.contains(&true), "it is only 0.8 m high");
    let low = Cone {
        origin: Point3::new(0.0, 0.0, 0.7),
        ..level(0.0)
    };
    let seen: Vec<bool> = (0..40)
        .map(|n| !vegetation.lit(&low, 10.0, 0.1 * f64::from(n)).is_empty())
        .collect();
    assert!(seen.contains(&true) && seen.contains(&false), "{seen:?}");
}

fn grown(growth: &Growth, reach: f64, seed: u64) -> Vec<Stem> {
    let ground_m = |at: Point2<f64>| (at.x < 5.0).then_some(0.1 * at.x);
    let mut generator = PlantGenerator::new(&ground_m, &ground_m);
    let noise = NoiseStream::new(seed, "world/plants");
    generator.grow(growth, reach, noise).unwrap();
    generator.into_stems()
}

fn reeds(area: Area) -> Stand {
    Stand {
        area,
        density_per_m2: 50.0,
        height_m: [1.0, 2.0],
        thickness_m: [0.006, 0.012],
        tufts: None,
        lean_rad: 0.2,
        shoots: None,
    }
}

#[test]
fn stems_have_the_configured_density_and_area() {
    let triangle = Area::Polygon(vec![
        Point2::new(0.0, 0.0),
        Point2::new(4.0, 0.0),
        Point2::new(0.0, 4.0),
    ]);
    let stems = grown(&Growth::Stems(reeds(triangle)), 0.5, 1);
    // 8 m² of 50, four standard deviations of 20.
    assert!((320..480).contains(&stems.len()), "{}", stems.len());
    for stem in &stems {
        assert!(
            stem.foot_m.x >= 0.0 && stem.foot_m.y >= 0.0 && stem.foot_m.x + stem.foot_m.y <= 4.0
        );
        assert_eq!(stem.foot_m.z, 0.1 * stem.foot_m.x);
        let up = stem.top_m - stem.foot_m;
        assert!((1.0..=2.0).contains(&up.z) && (0.003..=0.006).contains(&stem.radius_m));
        assert!(libm::atan2(up.xy().norm(), up.z) <= 0.2 + 1e-9);
        assert_eq!(stem.reach_m[0], 0.0);
        assert!((stem.reach_m[1] - 0.5 * up.z).abs() < 1e-12);
    }
    let strip = Area::Strip {
        along_m: vec![Point2::new(0.0, 0.0), Point2::new(10.0, 10.0)],
        width_m: 2.0,
    };
    let stems = grown(&Growth::Stems(reeds(strip)), 0.0, 1);
    // 15.7 m² of it lie where x < 5, where there is ground.
    assert!((670..900).contains(&stems.len()), "{}", stems.len());
    for stem in &stems {
        let aside_m = (stem.foot_m.x - stem.foot_m.y).abs() * std::f64::consts::FRAC_1_SQRT_2;
        assert!(aside_m <= 1.0 || stem.foot_m.xy().coords.norm() <= 1.0);
        assert!(stem.foot_m.x < 5.0 && stem.reach_m == [0.0, 0.0]);
    }
}

#[test]
fn the_same_seed_grows_the_same_and_another_does_not() {
    let area = || Area::Rectangle([Point2::new(0.0, 0.0), Point2::new(2.0, 2.0)]);
    let growth = Growth::Stems(Stand {
        shoots: Some(Shoots {
            count: 3,
            length_m: [0.2, 0.3],
            thickness_m: [0.01, 0.01],
        }),
        ..reeds(area())
    });
    assert_eq!(grown(&growth, 0.5, 1), grown(&growth, 0.5, 1));
    assert_ne!(grown(&growth, 0.5, 1), grown(&growth, 0.5, 2));
    // 4 m² of 50 stems, each with 3 shoots that begin on it.
    let stems = grown(&growth, 0.5, 1);
    assert_eq!(stems.len(), 800);
    let (stem, shoot) = (&stems[0], &stems[1]);
    let share = (shoot.foot_m.z - stem.foot_m.z) / (stem.top_m.z - stem.foot_m.z);
    assert!((0.2..=1.0).contains(&share));
    assert!((stem.foot_m + (stem.top_m - stem.foot_m) * share - shoot.foot_m).norm() < 1e-12);
    assert_eq!(shoot.phases, stem.phases);
}

#[test]
fn tufts_stand_apart_and_are_as_dense_on_the_whole() {
    let area = Area::Rectangle([Point2::new(0.0, 0.0), Point2::new(4.0, 2.0)]);
    let tufts = Some(Tufts {
        stems: 20,
        radius_m: 0.05,
    });
    let growth = Growth::Stems(Stand {
        tufts,
        ..reeds(area)
    });
    let stems = grown(&growth, 0.0, 1);
    // 8 m² of 50; those of tufts at the edge that would stand outside are missing.
    assert!((370..=400).contains(&stems.len()), "{}", stems.len());
    let nearest_m = |n: usize| {
        let others = stems.iter().enumerate().filter(|(m, _)| *m != n);
        let apart = others.map(|(_, other)| (other.foot_m - stems[n].foot_m).xy().norm());
        apart.fold(f64::INFINITY, f64::min)
    };
    let mean_m = (0..stems.len()).map(nearest_m).sum::<f64>() / stems.len() as f64;
    // Half of the root of the area of each: 7 cm one by one, 1 cm in a tuft.
    assert!((0.007..0.014).contains(&mean_m), "{mean_m}");
}

#[test]
fn too_much_to_grow_is_refused() {
    let ground_m = |_: Point2<f64>| Some(0.0);
    let mut generator = PlantGenerator::new(&ground_m, &ground_m);
    let mut grow = |stand| generator.grow(&Growth::Stems(stand), 0.0, NoiseStream::new(1, "test"));
    let wide = Area::Rectangle([Point2::new(-1e6, -1e6), Point2::new(1e6, 1e6)]);
    assert_eq!(grow(reeds(wide)), Err(TooMany::Draws));
    let small = Area::Rectangle([Point2::new(0.0, 0.0), Point2::new(1.0, 1.0)]);
    let dense = Stand {
        density_per_m2: 600_000.0,
        ..reeds(small.clone())
    };
    assert_eq!(grow(dense), Err(TooMany::Draws), "the budget is spent");
    let mut generator = PlantGenerator::new(&ground_m, &ground_m);
    let leafy = Stand {
        shoots: Some(Shoots {
            count: u32::MAX,
            length_m: [0.2, 0.3],
            thickness_m: [0.01, 0.01],
        }),
        ..reeds(small)
    };
    let grown = generator.grow(&Growth::Stems(leafy), 0.0, NoiseStream::new(1, "test"));
    assert_eq!(grown, Err(TooMany::Stems));
}

#[test]
fn a_bush_is_closed_from_all_sides() {
    let bush = Growth::Crowns(Crowns {
        at_m: vec![Point2::new(0.0, 0.0)],
        radius_m: [1.0, 1.0],
        bottom_m: [0.0, 0.0],
        height_m: [1.6, 1.6],
        branches: 30,
        branch_thickness_m: [0.02, 0.06],
        leaves_per_m2: 900.0,
        leaf_length_m: [0.06, 0.1],
        leaf_thickness_m: [0.03, 0.05],
    });
    let stems = grown(&bush, 0.0, 3);
    let patch = Patch {
        name: "bush".to_owned(),
        rigidity: Rigidity::Rigid,
        stems: 0..stems.len(),
    };
    let vegetation = Vegetation::new(stems, vec![patch], BREEZE);
    for n in 0..100 {
        let heading_rad = f64::from(n);
        let from = Vector3::new(libm::cos(heading_rad), libm::sin(heading_rad), 0.0);
        let cone = Cone {
            origin: Point3::from(from * 5.0 + Vector3::z() * 0.8),
            axis: -from,
            spread: 0.001,
        };
        let lit = vegetation.lit(&cone, 10.0, 0.0);
        let share: f64 = lit.iter().map(|spot| spot.share).sum();
        assert!(share > 0.9, "{share} at {heading_rad}");
        assert!((3.9..6.2).contains(&lit[0].distance_m));
    }
    let class = |x: f64, z: f64| {
        let half = Vector3::repeat(0.15);
        let centre = Point3::new(x, 0.0, z);
        vegetation.standing_in(centre - half, centre + half)
    };
    assert_eq!(class(0.9, 0.8), Some(Rigidity::Rigid));
    assert_eq!(class(0.0, 0.3), Some(Rigidity::Rigid));
    assert_eq!(class(1.5, 0.8), None);
    assert_eq!(class(0.0, 2.0), None);
    let [min, max] = [-2.0, 2.0].map(|m| Point3::new(m, m, m + 2.0));
    let top_m = vegetation.highest_m(min, max, Rigidity::Rigid).unwrap();
    assert!((1.5..1.8).contains(&top_m), "{top_m}");
    assert_eq!(vegetation.highest_m(min, max, Rigidity::Flexible), None);
}
