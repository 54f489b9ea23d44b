use super::*;
use crate::fixtures::HEADER;

const DOCUMENT: Thresholds = Thresholds {
    above_m: 0.10,
    below_m: -0.10,
};

const GROUND: &str = "shape = \"plane\"";

fn truth(solids: &[&str], options: HeightOptions) -> HeightTruth {
    let solids = solids.iter().map(|s| format!("\n[[solids]]\n{s}\n"));
    let solids = solids.collect::<Vec<_>>().concat();
    let world = World::parse("w", &format!("{HEADER}{solids}")).unwrap();
    let bounds = Bounds {
        min_m: [-1.0, -1.0],
        max_m: [3.0, 1.0],
    };
    heights(&world, 0.2, bounds, options).unwrap()
}

fn still(solids: &[&str]) -> HeightTruth {
    truth(solids, HeightOptions::default())
}

/// The surface of the cell that holds a point.
#[track_caller]
fn at(truth: &HeightTruth, x: f64, y: f64) -> &CellHeights {
    truth
        .get([x, y].map(|m| libm::floor(m / 0.2) as i64))
        .unwrap()
}

#[track_caller]
fn check(cell: &CellHeights, min_m: f64, max_m: f64) {
    let off_m = (cell.min_m - min_m).abs().max((cell.max_m - max_m).abs());
    assert!(
        off_m < 1e-6,
        "{} {}, expected {min_m} {max_m}",
        cell.min_m,
        cell.max_m
    );
}

fn level(cell: &CellHeights) -> Verdict {
    cell.verdict(&GroundPlane::level(0.0), DOCUMENT).unwrap()
}

#[test]
fn nothing_is_none_and_bare_ground_is_flat() {
    let empty = still(&[]);
    assert_eq!(empty.iter().count(), 0);
    let ground = still(&[GROUND]);
    assert_eq!((ground.grid.first, ground.grid.size), ([-5, -5], [20, 10]));
    assert_eq!(ground.iter().count(), 200);
    for (_, cell) in ground.iter() {
        check(cell, 0.0, 0.0);
        let verdict = level(cell);
        assert!(!verdict.is_obstacle && (verdict.margin_m - 0.1).abs() < 1e-9);
    }
    assert!(ground.get([15, 0]).is_none());
}

#[test]
fn a_kerb_counts_even_if_it_covers_little_of_a_cell() {
    // Its edge at y = 0.404 leaves 2 % of the cells from 0.4 to 0.6 to the road.
    let kerb = "shape = \"box\"\ncentre_m = [1, 0.702, 0.0]\nsize_m = [8, 0.596, 0.3]";
    let truth = still(&[GROUND, kerb]);
    check(at(&truth, 0.9, 0.5), 0.0, 0.15);
    check(at(&truth, 0.9, 0.3), 0.0, 0.0);
    check(at(&truth, 0.9, 0.7), 0.15, 0.15);
    let edge = level(at(&truth, 0.9, 0.5));
    assert!(edge.is_obstacle && (edge.margin_m - 0.05).abs() < 1e-7);
    // It ends 2 mm into the next row.
    let sliver = "shape = \"box\"\ncentre_m = [1, 0.7, 0.0]\nsize_m = [8, 0.204, 0.3]";
    let grazed = level(at(&still(&[GROUND, sliver]), 0.9, 0.9));
    assert!(grazed.is_obstacle, "{grazed:?}");
}

#[test]
fn a_ditch_shows_its_floor_even_where_it_is_a_crack() {
    let slabs = |gap_to: f64| {
        let right = format!(
            "shape = \"box\"\ncentre_m = [{}, 0, -0.5]\nsize_m = [4, 4, 1]",
            gap_to + 2.0
        );
        still(&[
            "shape = \"plane\"\npoint_m = [0, 0, -0.2]",
            "shape = \"box\"\ncentre_m = [-1.47, 0, -0.5]\nsize_m = [4, 4, 1]",
            &right,
        ])
    };
    let ditch = slabs(1.73);
    check(at(&ditch, 0.5, 0.1), -0.2, 0.0);
    check(at(&ditch, 0.7, 0.1), -0.2, -0.2);
    check(at(&ditch, 0.1, 0.1), 0.0, 0.0);
    assert!(level(at(&ditch, 0.7, 0.1)).is_obstacle);
    // 0.1 mm wide.
    let crack = slabs(0.5301);
    check(at(&crack, 0.5, 0.1), -0.2, 0.0);
}

#[test]
fn poles_and_thin_walls_are_never_missed() {
    // A pole that reaches 2 mm into the cell at (0.4, 0), and one within a cell.
    let pole = |x: f64, radius_m: f64| {
        format!(
            "shape = \"cylinder\"\nbase_m = [{x}, 0.1, 0]\nradius_m = {radius_m}\nheight_m = 1.2"
        )
    };
    let poles = still(&[GROUND, &pole(0.352, 0.05), &pole(1.3, 0.004)]);
    check(at(&poles, 0.5, 0.1), 0.0, 1.2);
    check(at(&poles, 0.3, 0.1), 0.0, 1.2);
    check(at(&poles, 1.3, 0.1), 0.0, 1.2);
    check(at(&poles, 0.7, 0.1), 0.0, 0.0);
    // 1 mm of wall, askew: every cell that it crosses.
    let wall = "shape = \"wall\"\nfrom_m = [-0.9, -0.83]\nto_m = [2.7, 0.77]\nthickness_m = 0.001\nheight_m = 2";
    let walls = still(&[GROUND, wall]);
    let crossed = walls.iter().filter(|(_, cell)| cell.max_m > 1.0).count();
    let mut expected = std::collections::BTreeSet::new();
    for k in 0..100_000 {
        let t = f64::from(k) / 1e5;
        let on_wall = [-0.9 + 3.6 * t, -0.83 + 1.6 * t];
        expected.insert(on_wall.map(|m| libm::floor(m / 0.2) as i64));
    }
    assert!(
        (expected.len()..=expected.len() + 2).contains(&crossed),
        "{crossed} {}",
        expected.len()
    );
    for index in expected {
        check(walls.get(index).unwrap(), 0.0, 2.0);
    }
}

#[test]
fn a_ball_is_highest_over_its_centre_and_a_ramp_at_its_ends() {
    let ball = still(&[
        GROUND,
        "shape = \"sphere\"\ncentre_m = [0.5, 0.1, 0.2]\nradius_m = 0.3",
    ]);
    check(at(&ball, 0.5, 0.1), 0.2 + libm::sqrt(0.07), 0.5);
    // Beside: the nearest point to the centre is 0.1 m away.
    let beside = at(&ball, 0.7, 0.1);
    assert!(
        (beside.max_m - (0.2 + libm::sqrt(0.08))).abs() < 1e-5,
        "{}",
        beside.max_m
    );
    // 10 % down from x = 0, through the world's plane along x = 2.
    let slope = format!(
        "shape = \"plane\"\npoint_m = [0, 0, 0.2]\npitch_deg = {}",
        libm::atan(0.1).to_degrees()
    );
    let ramp = still(&[GROUND, &slope]);
    check(at(&ramp, 0.5, 0.1), 0.14, 0.16);
    check(at(&ramp, 2.5, 0.1), 0.0, 0.0);
    // On the slope itself all is flat, and the level ground rises out of it.
    let on_slope = GroundPlane {
        point_m: Point3::new(0.0, 0.0, 0.2),
        normal: nalgebra::Vector3::new(0.1, 0.0, 1.0).normalize(),
    };
    let verdict = |x| at(&ramp, x, 0.1).verdict(&on_slope, DOCUMENT).unwrap();
    assert!(!verdict(0.5).is_obstacle && (verdict(0.5).margin_m - 0.1).abs() < 1e-7);
    assert!(!verdict(2.9).is_obstacle);
    let normal_z = 1.0 / libm::sqrt(1.01);
    assert!((verdict(2.9).margin_m - 0.1 * (1.0 - normal_z)).abs() < 1e-6);
}

#[test]
fn glass_and_movers_count_where_asked_for() {
    let pane = "shape = \"box\"\ncentre_m = [0.5, 0.1, 1]\nsize_m = [0.01, 0.1, 2]\nreflectivity.glass = { transmission = 0.9 }";
    let walker = "shape = \"cylinder\"\nbase_m = [0.5, 0.1, 0]\nradius_m = 0.25\nheight_m = 1.75\nmotion = [{ t_s = 0, x_m = 0, y_m = 0 }, { t_s = 1, x_m = 2, y_m = 0 }]\nleaves_s = 5";
    for (glass, moving_at_s, expected_m) in [
        (false, None, [0.0, 0.0]),
        (true, None, [2.0, 0.0]),
        (false, Some(0.0), [1.75, 0.0]),
        (false, Some(3.0), [0.0, 1.75]),
        (false, Some(5.0), [0.0, 0.0]),
    ] {
        let options = HeightOptions { glass, moving_at_s };
        let truth = truth(&[GROUND, pane, walker], options);
        for (x, expected_m) in [0.5, 2.5].into_iter().zip(expected_m) {
            let max_m = at(&truth, x, 0.1).max_m;
            assert!(
                (max_m - expected_m).abs() < 1e-9,
                "{options:?} {x}: {max_m}"
            );
        }
    }
}

#[test]
fn too_many_cells_are_refused() {
    let world = World::parse("w", HEADER).unwrap();
    let bounds = Bounds {
        min_m: [0.0, 0.0],
        max_m: [1000.0, 1000.0],
    };
    let error = heights(&world, 0.1, bounds, HeightOptions::default()).unwrap_err();
    assert!(
        matches!(
            error,
            TruthError::TooLarge {
                most: MAX_CELLS,
                ..
            }
        ),
        "{error}"
    );
}
