use super::*;

fn rectangle(min: [f64; 2], max: [f64; 2]) -> Vec<Point2<f64>> {
    [
        [min[0], min[1]],
        [max[0], min[1]],
        [max[0], max[1]],
        [min[0], max[1]],
    ]
    .map(Point2::from)
    .to_vec()
}

fn length_m(outline: &Outline) -> f64 {
    outline.segments().iter().map(|[a, b]| (b - a).norm()).sum()
}

#[track_caller]
fn check_length(sections: &[Vec<Point2<f64>>], expected_m: f64) {
    let length_m = length_m(&Outline::of_sections(sections.to_vec()));
    assert!((length_m - expected_m).abs() < 1e-9, "{length_m}");
}

#[test]
fn overlapping_and_flush_solids_have_no_surface_between_them() {
    let square = rectangle([0.0, 0.0], [2.0, 2.0]);
    check_length(std::slice::from_ref(&square), 8.0);
    // Apart.
    check_length(&[square.clone(), rectangle([3.0, 0.0], [4.0, 1.0])], 12.0);
    // Overlapping corner: the union's girth is that of the bounding square.
    check_length(&[square.clone(), rectangle([1.0, 1.0], [3.0, 3.0])], 12.0);
    // A cross.
    check_length(
        &[
            rectangle([-3.0, 0.0], [5.0, 2.0]),
            rectangle([0.0, -3.0], [2.0, 5.0]),
        ],
        32.0,
    );
    // Flush, of different lengths.
    check_length(&[square.clone(), rectangle([2.0, 0.5], [3.0, 1.5])], 10.0);
    // One within the other.
    check_length(&[square.clone(), rectangle([0.5, 0.5], [1.0, 1.0])], 8.0);
    // A T whose bar ends exactly in the other's face, with one shared outside line.
    let bar = rectangle([1.0, 1.5], [4.0, 2.0]);
    let union = Outline::of_sections(vec![square, bar]);
    assert!(union.distance_m(Point2::new(2.0, 1.75)) > 0.24);
    assert!(union.distance_m(Point2::new(1.5, 2.0)) < 1e-12);
}

#[test]
fn distance_is_that_to_the_nearest_surface_inside_and_outside() {
    let outline = Outline::of_sections(vec![
        rectangle([0.0, 0.0], [2.0, 1.0]),
        rectangle([2.0, 0.0], [4.0, 1.0]),
    ]);
    for (point, expected_m, inside) in [
        ([5.0, 0.5], 1.0, false),
        ([7.0, 5.0], 5.0, false),
        ([3.0, 0.6], 0.4, true),
        ([2.0, 0.5], 0.5, true),
        ([1.0, 1.0], 0.0, true),
    ] {
        let point = Point2::from(point);
        assert!(
            (outline.distance_m(point) - expected_m).abs() < 1e-12,
            "{point}"
        );
        assert_eq!(outline.contains(point), inside, "{point}");
    }
    let nothing = Outline::default();
    assert!(nothing.distance_m(Point2::origin()).is_infinite());
}

#[test]
fn a_turned_solid_hides_what_it_covers() {
    // A diamond of half diagonal 1 over the right edge of a square: it hides 2 m of that edge, and of
    // its own girth 4√2 the half inside the square is hidden.
    let diamond = [[3.0, 1.5], [2.0, 2.5], [1.0, 1.5], [2.0, 0.5]]
        .map(Point2::from)
        .to_vec();
    let square = rectangle([0.0, 0.0], [2.0, 3.0]);
    check_length(
        &[square, diamond],
        10.0 - 2.0 + 2.0 * std::f64::consts::SQRT_2,
    );
}
