use std::f64::consts::{FRAC_PI_2, TAU};

use super::*;
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::docking::{DockingColumn, Vegetation};

const SIDE: usize = 100;
const CELL_M: f64 = 0.3;
const FIRST: CellIndex = CellIndex { x: -50, y: -50 };
/// Riverwatch.
const BOAT: BoatFootprint = BoatFootprint {
    length_m: 4.5,
    width_m: 2.44,
};
const UNKNOWN: DockingColumn = land(f32::NAN);
const LETHAL: DockingColumn = land(1.0);
const WATER: DockingColumn = DockingColumn {
    cost: 0.0,
    is_clear_water: true,
    rises_from_water: false,
    vegetation: None,
};

const fn land(cost: f32) -> DockingColumn {
    DockingColumn {
        cost,
        is_clear_water: false,
        rises_from_water: true,
        vegetation: None,
    }
}

/// A plant of shore 1; lethal by its slope.
const fn plant(class: ShoreClass, density: f32) -> DockingColumn {
    DockingColumn {
        vegetation: Some(Vegetation {
            class,
            density,
            shore: 1,
        }),
        ..LETHAL
    }
}

/// A bed below the water, as a sonar measures it.
const fn bed(cost: f32) -> DockingColumn {
    DockingColumn {
        rises_from_water: false,
        ..land(cost)
    }
}

/// Sites of a square window around the origin; `column` takes x and y in metres.
fn sites(column: impl FnMut(f64, f64) -> DockingColumn) -> Vec<DockingSite> {
    find_docking_sites(FIRST, SIDE, CELL_M, &columns(column), &BOAT)
}

fn columns(mut column: impl FnMut(f64, f64) -> DockingColumn) -> Vec<DockingColumn> {
    let metres = |index: usize| (index as f64 + 0.5 - SIDE as f64 / 2.0) * CELL_M;
    let columns = (0..SIDE * SIDE).map(|at| column(metres(at % SIDE), metres(at / SIDE)));
    columns.collect()
}

/// A shore along x = 0, land towards x, with a ramp `width_m` wide and 8 m deep around y = 0.
fn ramp(x: f64, y: f64, width_m: f64, cost: f32) -> DockingColumn {
    if x < 0.0 {
        WATER
    } else if y.abs() < 0.5 * width_m && x < 8.0 {
        land(cost)
    } else {
        LETHAL
    }
}

/// True with probability `share`.
fn chance(random: &mut ChaCha8Rng, share: f64) -> bool {
    f64::from(random.next_u32()) < share * f64::from(u32::MAX)
}

#[test]
fn a_ramp_between_overgrown_shores_is_found() {
    let found = sites(|x, y| ramp(x, y, 4.0, 0.5));
    let [site] = found.as_slice() else {
        panic!("{} sites", found.len());
    };
    assert!(site.heading_rad.abs() < 1e-9, "{}", site.heading_rad);
    assert!((site.price - 0.5).abs() < 1e-6);
    assert_eq!((site.vegetation, &site.passable), (None, &Vec::new()));
    // 4 m are 13 cells, all covered by docking poses, as far as the deepest reaches.
    assert!((site.width_m - 4.0).abs() < 0.5, "{}", site.width_m);
    assert!(
        (site.centre_in_odom.y).abs() < 0.2,
        "{}",
        site.centre_in_odom
    );
    assert!(site.cells.contains(&CellIndex { x: 0, y: 0 }));
    assert!(
        site.cells
            .iter()
            .all(|cell| cell.x >= 0 && cell.y.abs() <= 7)
    );
}

#[test]
fn a_ramp_must_hold_the_boat() {
    assert_eq!(sites(|x, y| ramp(x, y, 2.2, 0.5)).len(), 0, "too narrow");
    assert_eq!(sites(|x, y| ramp(x, y, 3.0, 0.5)).len(), 1);
    let shallow = |depth_m: f64| {
        let found = sites(|x, y| {
            if x < depth_m {
                ramp(x, y, 6.0, 0.5)
            } else {
                LETHAL
            }
        });
        found.len()
    };
    assert_eq!((shallow(3.3), shallow(4.8)), (0, 1));
}

#[test]
fn level_unknown_and_lethal_ground_is_no_ramp() {
    for column in [land(0.0), UNKNOWN, LETHAL] {
        let found = sites(|x, _| if x < 0.0 { WATER } else { column });
        assert_eq!(found, []);
    }
}

#[test]
fn the_water_before_it_must_be_clear() {
    let floating = sites(|x, y| {
        if (-2.0..-1.7).contains(&x) {
            LETHAL
        } else {
            ramp(x, y, 4.0, 0.5)
        }
    });
    assert_eq!(floating, []);
    let far_inland = sites(|x, y| {
        if x < -9.0 {
            WATER
        } else if x < 0.0 {
            land(0.0)
        } else {
            ramp(x, y, 4.0, 0.5)
        }
    });
    assert_eq!(far_inland, []);
    let nothing_known = sites(|x, y| {
        if x < 0.0 {
            UNKNOWN
        } else {
            ramp(x, y, 4.0, 0.5)
        }
    });
    assert_eq!(nothing_known, []);
}

#[test]
fn gentle_ground_among_lethal_ground_is_no_site() {
    for seed in 0..6 {
        for lethal in [0.1, 0.3, 0.7] {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let found = sites(|x, _| match x {
                _ if x < 0.0 => WATER,
                _ if chance(&mut random, lethal) => LETHAL,
                _ => land(0.6),
            });
            assert_eq!(found, [], "seed {seed}, {lethal} lethal");
        }
    }
}

#[test]
fn holes_and_noise_do_not_hide_a_ramp() {
    for seed in 0..6 {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let found = sites(|x, y| {
            let is_hole = chance(&mut random, 0.04);
            let noise = 1e-10 * random.next_u32() as f32;
            if is_hole {
                UNKNOWN
            } else {
                ramp(x, y, 5.0, 0.3 + noise)
            }
        });
        assert_eq!(found.len(), 1, "seed {seed}");
        assert!(found[0].heading_rad.abs() < 0.1);
    }
}

#[test]
fn gentler_then_wider_sites_rank_first() {
    let bays = |costs: [f32; 2], widths_m: [f64; 2]| {
        let found = sites(|x, y| {
            if y < 0.0 {
                ramp(x, y + 7.0, widths_m[0], costs[0])
            } else {
                ramp(x, y - 7.0, widths_m[1], costs[1])
            }
        });
        found
            .iter()
            .map(|site| site.centre_in_odom.y < 0.0)
            .collect::<Vec<_>>()
    };
    assert_eq!(bays([0.3, 0.6], [3.0, 6.0]), [true, false]);
    assert_eq!(bays([0.61, 0.64], [3.0, 6.0]), [false, true]);
    assert_eq!(bays([0.5, 0.5], [4.0, 4.0]), [true, false]);
}

#[test]
fn a_spit_is_headed_for_from_one_of_its_sides() {
    let found = sites(|x, y| {
        if x.abs() < 2.4 && y.abs() < 4.0 {
            land(0.4)
        } else {
            WATER
        }
    });
    let [site] = found.as_slice() else {
        panic!("{} sites", found.len());
    };
    let across = libm::fabs(libm::cos(site.heading_rad));
    assert!(!(0.1..=0.9).contains(&across), "{}", site.heading_rad);
}

#[test]
fn a_shoal_is_a_site_only_where_land_follows_it() {
    let patch = |behind: DockingColumn| {
        sites(|x, y| match x {
            _ if y.abs() > 3.0 => WATER,
            _ if x < 0.0 => WATER,
            _ if x < 5.0 => bed(0.08),
            _ => behind,
        })
    };
    assert_eq!(patch(WATER), [], "where the boat has lain");
    assert_eq!(patch(bed(0.08)), [], "a shoal without an end");
    assert_eq!(patch(LETHAL), [], "a wall or canes");
    // Bare banks, steep or level, right behind it.
    assert_eq!(patch(land(0.4)).len(), 1);
    assert_eq!(patch(land(0.0)).len(), 1);
    // A bank within a boat's length of the shoal, with clear water between.
    let before_a_bank = |gap_m: f64| {
        let found = sites(|x, _| match x {
            _ if x < 0.0 => WATER,
            _ if x < 5.0 => bed(0.08),
            _ if x < 5.0 + gap_m => WATER,
            _ => land(0.0),
        });
        found.len()
    };
    assert_eq!((before_a_bank(0.0), before_a_bank(2.5)), (1, 0));
    // The cells between are unknown.
    let behind_a_hole = sites(|x, _| match x {
        _ if x < 0.0 => WATER,
        _ if x < 5.0 => bed(0.08),
        _ if x < 7.5 => bed(f32::NAN),
        _ => land(0.4),
    });
    assert!(behind_a_hole.iter().any(|site| site.centre_in_odom.x < 5.0));
}

#[test]
fn vegetation_is_a_site_with_a_price() {
    use ShoreClass::{Dense, Sparse};
    // A gentle ramp, scattered canes of which a quarter of the cells is known, and a field.
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let found = sites(|x, y| match x {
        _ if x < 0.0 => WATER,
        _ if y > 5.0 => ramp(x, y - 9.0, 4.0, 0.5),
        _ if y > 1.0 => LETHAL,
        _ if y < -9.0 => LETHAL,
        _ if y > -4.0 && chance(&mut random, 0.25) => plant(Sparse, 0.125),
        _ if y > -4.0 => WATER,
        _ if x < 1.5 => plant(Dense, 0.5),
        _ => UNKNOWN,
    });
    let what: Vec<_> = found
        .iter()
        .map(|site| (site.vegetation, site.price))
        .collect();
    assert_eq!(
        what,
        [(None, 0.5), (Some(Sparse), 1.125), (Some(Dense), 1.5)]
    );
    for site in &found[1..] {
        assert!(site.heading_rad.abs() < 0.1, "{}", site.heading_rad);
        let ahead_m = site.centre_in_odom - site.approach_in_odom;
        assert!(
            (ahead_m.norm() - BOAT.length_m).abs() < 1e-9 && ahead_m.x > 4.4,
            "{ahead_m}"
        );
    }
    // Into the denser plants a boat may push from their site alone, and into no rock from any.
    let cells = |site: usize, y: std::ops::Range<f64>| {
        let plants = found[site].passable.iter().map(|cell| cell.centre(CELL_M));
        plants
            .filter(|at| y.contains(&at.y) && (0.0..1.5).contains(&at.x))
            .count()
    };
    assert_eq!(cells(1, -20.0..-4.2), 0, "dense from the sparse site");
    assert!(cells(1, -4.0..1.0) > 50 && cells(2, -9.0..-4.2) > 70);
    let rocks = [(1, 1.2..20.0), (2, 1.2..20.0), (2, -20.0..-9.2)];
    assert_eq!(rocks.map(|(site, y)| cells(site, y)), [0; 3]);
}

#[test]
fn what_does_not_give_way_makes_vegetation_no_site() {
    use ShoreClass::Dense;
    let field = |stone_m: f64, width_m: f64, behind: DockingColumn| {
        let found = sites(|x, y| match x {
            _ if x < 0.0 => behind,
            _ if y.abs() > 0.5 * width_m => LETHAL,
            _ if (x - 1.0).abs() < 0.15 && (y - stone_m).abs() < 0.15 => LETHAL,
            _ => plant(Dense, 0.5),
        });
        found.len()
    };
    assert_eq!(field(20.0, 3.0, WATER), 1);
    assert_eq!(field(20.0, 2.0, WATER), 0, "too narrow");
    assert_eq!(field(0.15, 3.0, WATER), 0, "a stone in its middle");
    assert_eq!(field(0.15, 12.0, WATER), 1, "beside the stone");
    assert_eq!(field(20.0, 3.0, UNKNOWN), 0, "no water before it");
    assert_eq!(
        field(20.0, 3.0, plant(Dense, 0.5)),
        0,
        "no open water before it"
    );
}

#[test]
fn an_entered_site_stays_but_for_what_is_rigid_now() {
    use ShoreClass::{Dense, Sparse};
    let field = |deep: DockingColumn, is_stone: bool| {
        move |x: f64, y: f64| match x {
            _ if x < 0.0 => WATER,
            _ if y.abs() > 3.0 || x > 4.0 => LETHAL,
            _ if is_stone && (x - 1.0).abs() < 0.5 && (y - 1.0).abs() < 0.5 => LETHAL,
            _ if x > 2.0 => deep,
            _ => plant(Sparse, 0.25),
        }
    };
    let found = sites(field(plant(Sparse, 0.25), false));
    let [site] = found.as_slice() else {
        panic!("{} sites", found.len());
    };
    let count = |site: &DockingSite, is: &dyn Fn(Point2<f64>) -> bool| {
        let centres = site.passable.iter().map(|cell| cell.centre(CELL_M));
        centres.filter(|centre| is(*centre)).count()
    };
    let now = columns(field(plant(Dense, 0.5), true));
    let entered = entered_site(FIRST, SIDE, CELL_M, &now, site.clone());
    assert_eq!(
        (entered.number, entered.width_m),
        (site.number, site.width_m)
    );
    let in_stone = |at: Point2<f64>| (at.x - 1.0).abs() < 0.5 && (at.y - 1.0).abs() < 0.5;
    let beside = |at: Point2<f64>| (0.0..2.0).contains(&at.x) && (-1.0..0.0).contains(&at.y);
    let deep = |at: Point2<f64>| at.x > 2.0;
    assert!(count(site, &in_stone) > 8 && count(site, &deep) > 50);
    assert_eq!(count(&entered, &in_stone), 0, "a stone");
    assert_eq!(count(&entered, &deep), 0, "denser plants");
    assert_eq!(count(&entered, &beside), count(site, &beside));
    let elsewhere = CellIndex { x: 500, ..FIRST };
    let gone = entered_site(elsewhere, SIDE, CELL_M, &now, site.clone());
    assert_eq!(gone.passable, []);
}

#[test]
fn odd_windows_and_boats_have_no_sites() {
    let window = |width: usize, columns: &[DockingColumn], boat: BoatFootprint| {
        find_docking_sites(FIRST, width, CELL_M, columns, &boat).len()
    };
    let gentle = [land(0.5); 12];
    assert_eq!(window(0, &gentle, BOAT), 0);
    assert_eq!(window(5, &[], BOAT), 0);
    assert_eq!(window(5, &gentle, BOAT), 0);
    for length_m in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e9] {
        assert_eq!(window(4, &gentle, BoatFootprint { length_m, ..BOAT }), 0);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    /// A ramp is found at any heading of the shore.
    #[test]
    fn a_ramp_is_found_at_any_heading(heading_rad in 0.0..TAU) {
        let (sin, cos) = libm::sincos(heading_rad);
        let found = sites(|x, y| ramp(x * cos + y * sin, y * cos - x * sin, 5.0, 0.5));
        prop_assert_eq!(found.len(), 1);
        let off_rad = libm::remainder(found[0].heading_rad - heading_rad, TAU);
        prop_assert!(off_rad.abs() < FRAC_PI_2 / 9.0, "{} off", off_rad);
        prop_assert!((found[0].width_m - 5.0).abs() < 1.0, "{} wide", found[0].width_m);
    }
}
