use super::*;

fn grid(sections: Vec<Vec<Point2<f64>>>, cell_m: f64, max_m: f64) -> TruthGrid {
    let bounds = Bounds {
        min_m: [0.0, 0.0],
        max_m: [max_m, max_m],
    };
    TruthGrid::of(&Outline::of_sections(sections), cell_m, bounds).unwrap()
}

/// One line of text a row, the greatest y first.
fn drawn(grid: &TruthGrid) -> Vec<String> {
    let [width, height] = grid.grid.size;
    (0..height)
        .rev()
        .map(|row| {
            (0..width)
                .map(|column| {
                    let index = grid.grid.index(row * width + column);
                    match grid.get(index).unwrap().kind {
                        CellKind::Free => '.',
                        CellKind::Occupied => '#',
                        CellKind::Inside => 'i',
                    }
                })
                .collect()
        })
        .collect()
}

fn polygon<const N: usize>(corners: [[f64; 2]; N]) -> Vec<Point2<f64>> {
    corners.map(Point2::from).to_vec()
}

#[test]
fn cells_of_a_box_off_the_edges() {
    let block = polygon([[0.6, 0.9], [2.4, 0.9], [2.4, 2.9], [0.6, 2.9]]);
    let grid = grid(vec![block], 0.5, 3.5);
    assert_eq!(
        drawn(&grid),
        [
            ".......", ".####..", ".#ii#..", ".#ii#..", ".#ii#..", ".####..", "......."
        ]
    );
    let cell = grid.get([2, 3]).unwrap();
    assert!((cell.surface_distance_m - 0.65).abs() < 1e-12, "{cell:?}");
    assert_eq!(grid.get([-1, 0]), None);
    assert_eq!(grid.get([7, 0]), None);
}

#[test]
fn a_surface_on_an_edge_belongs_to_the_solids_side() {
    let block = polygon([[0.5, 0.5], [2.0, 0.5], [2.0, 2.0], [0.5, 2.0]]);
    assert_eq!(
        drawn(&grid(vec![block], 0.5, 2.5)),
        [".....", ".###.", ".#i#.", ".###.", "....."]
    );
}

#[test]
fn a_turned_box_marks_every_cell_that_its_surface_crosses() {
    let diamond = polygon([[3.6, 2.0], [2.0, 3.6], [0.4, 2.0], [2.0, 0.4]]);
    assert_eq!(
        drawn(&grid(vec![diamond], 1.0, 4.0)),
        [".##.", "####", "####", ".##."]
    );
    let small = polygon([[2.9, 1.5], [2.5, 1.9], [2.1, 1.5], [2.5, 1.1]]);
    assert_eq!(
        drawn(&grid(vec![small], 1.0, 4.0)),
        ["....", "....", "..#.", "...."]
    );
}

#[test]
fn cells_lie_at_multiples_of_their_size_and_cover_the_bounds() {
    let bounds = Bounds {
        min_m: [-0.31, 0.19],
        max_m: [0.25, 0.2],
    };
    let grid = TruthGrid::of(&Outline::default(), 0.1, bounds).unwrap();
    assert_eq!((grid.grid.first, grid.grid.size), ([-4, 1], [7, 1]));
    assert!(grid.cells.iter().all(|cell| cell.kind == CellKind::Free));
    assert_eq!(grid.grid.index(6), [2, 1]);
}

#[test]
fn senseless_grids_are_refused() {
    let of = |cell_m, max_m| {
        let bounds = Bounds {
            min_m: [0.0, 0.0],
            max_m: [max_m, max_m],
        };
        TruthGrid::of(&Outline::default(), cell_m, bounds).unwrap_err()
    };
    for (cell_m, max_m) in [
        (0.0, 1.0),
        (-0.1, 1.0),
        (f64::NAN, 1.0),
        (0.1, f64::INFINITY),
        (0.1, 0.0),
        (0.1, f64::NAN),
    ] {
        assert!(
            matches!(of(cell_m, max_m), TruthError::Senseless { .. }),
            "{cell_m} {max_m}"
        );
    }
    assert!(matches!(of(0.001, 1000.0), TruthError::TooLarge { .. }));
}
