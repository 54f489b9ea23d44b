#![expect(clippy::float_cmp, reason = "these values are exact")]

use std::f64::consts::{FRAC_PI_2, PI};

use proptest::prelude::*;

use super::*;

const BARE: Margins = Margins {
    ahead_m: 0.0,
    side_m: 0.0,
};

const fn turning(radius_m: f64) -> MotionPlane {
    MotionPlane::Turning { radius_m }
}

fn footprint() -> impl Strategy<Value = Footprint> {
    // The base frame may lie within, or up to half a length before or behind.
    (0.1..2.0, -1.0..1.0, 0.1..0.8).prop_map(|(length_m, offset, half_width_m): (f64, f64, f64)| {
        Footprint::centred(length_m, 2.0 * half_width_m).moved_ahead(offset * length_m)
    })
}

/// Every direction, turning or sideways, the axes themselves and very wide arcs among them.
fn direction(radius_m: f64) -> impl Strategy<Value = MotionDirection> {
    let plane = prop::sample::select(vec![
        MotionPlane::Turning { radius_m },
        MotionPlane::Turning { radius_m },
        MotionPlane::Sideways,
    ]);
    let angle = prop_oneof![
        8 => -PI..PI,
        1 => prop::sample::select(vec![0.0, FRAC_PI_2, PI, -FRAC_PI_2]),
        1 => -1e-6..1e-6,
    ];
    (angle, plane).prop_map(move |(angle, plane): (f64, _)| {
        MotionDirection::of(libm::cos(angle), libm::sin(angle), plane)
            .unwrap()
            .0
    })
}

/// Where a point is, seen from the vehicle, after some travel.
fn moved([x, y]: [f64; 2], direction: MotionDirection, travel_m: f64) -> [f64; 2] {
    let turned = travel_m * direction.turn_per_m;
    let (sin, cos) = (libm::sin(turned), libm::cos(turned));
    let (ahead, left) = if turned.abs() < 1e-5 {
        let gone = travel_m * direction.along;
        (gone, 0.5 * gone * turned + travel_m * direction.across)
    } else {
        let radius_m = direction.along / direction.turn_per_m;
        (radius_m * sin, radius_m * (1.0 - cos))
    };
    let (dx, dy) = (x - ahead, y - left);
    [cos * dx + sin * dy, cos * dy - sin * dx]
}

/// Finely stepped: the last travel before the point was found inside; nothing within `limit_m`.
fn stepped_m(
    footprint: &Footprint,
    direction: MotionDirection,
    point: [f64; 2],
    limit_m: f64,
) -> Option<f64> {
    let steps = (limit_m / STEP_M) as usize;
    (0..=steps)
        .map(|n| n as f64 * STEP_M)
        .find(|&travel_m| footprint.contains(moved(point, direction, travel_m)))
}

const STEP_M: f64 = 0.001;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn it_agrees_with_fine_steps(
        (footprint, direction) in footprint().prop_flat_map(|f| (Just(f), direction(f.radius_m()))),
        x in -3.0..3.0, y in -3.0..3.0,
    ) {
        let point = [x, y];
        prop_assume!(!footprint.grown(TOUCH_M).contains(point));
        let exact_m = footprint.free_travel_m(BARE, direction, &[point]);
        let stepped_m = stepped_m(&footprint, direction, point, 6.0);
        match stepped_m {
            // A corner may be cut for less than a step; never may it be found later.
            Some(stepped_m) => {
                prop_assert!(exact_m <= stepped_m + 1e-6, "{exact_m} {stepped_m}");
                if exact_m < stepped_m - 1.001 * STEP_M {
                    let grazed = moved(point, direction, exact_m + 0.5 * STEP_M);
                    prop_assert!(footprint.grown(2.0 * STEP_M).contains(grazed), "{exact_m} {stepped_m}");
                    let edge = footprint.grown(-0.1 * STEP_M);
                    prop_assert!(!edge.contains(grazed) , "{exact_m} {stepped_m}");
                }
            }
            None if exact_m < 6.0 => {
                let contact = moved(point, direction, exact_m);
                prop_assert!(footprint.grown(1e-5).contains(contact) && !footprint.grown(-1e-5).contains(contact));
            }
            None => {}
        }
    }

    #[test]
    fn where_it_says_touch_a_point_lies_on_the_edge(
        (footprint, direction) in footprint().prop_flat_map(|f| (Just(f), direction(f.radius_m()))),
        ahead_m in 0.0..0.3, side_m in 0.0..0.1, x in -3.0..3.0, y in -3.0..3.0,
    ) {
        let margins = Margins { ahead_m, side_m };
        let grown = footprint.with_margins(margins, direction);
        prop_assume!(!grown.grown(TOUCH_M).contains([x, y]));
        let exact_m = footprint.free_travel_m(margins, direction, &[[x, y]]);
        // Once around a very wide arc, the test itself is not exact.
        if exact_m < 1000.0 {
            let contact = moved([x, y], direction, exact_m);
            prop_assert!(grown.grown(1e-5).contains(contact));
            prop_assert!(!grown.grown(-1e-5).contains(contact));
        }
    }

    #[test]
    fn points_more_never_make_it_longer(
        direction in direction(1.0),
        points in prop::collection::vec(prop::array::uniform2(-2.0..2.0), 1..20),
    ) {
        let footprint = Footprint::centred(0.8, 0.6);
        let margins = Margins { ahead_m: 0.1, side_m: 0.02 };
        let of = |points: &[[f64; 2]]| footprint.free_travel_m(margins, direction, points);
        let each = points.iter().map(|&point| of(&[point])).fold(f64::INFINITY, f64::min);
        prop_assert!((of(&points) - each).abs() < 1e-9 || of(&points) == each);
        prop_assert!(of(&points) <= of(&points[1..]));
    }

    /// From within the margins it may go until the bare footprint touches, and nowhere nearer.
    #[test]
    fn a_point_within_the_margins_is_never_run_over(
        (footprint, direction) in footprint().prop_flat_map(|f| (Just(f), direction(f.radius_m()))),
        share_x in -1.0..1.0, share_y in -1.0..1.0,
    ) {
        let margins = Margins { ahead_m: 0.2, side_m: 0.2 };
        let grown = footprint.with_margins(margins, direction);
        let x = 0.5 * (grown.front_m + grown.rear_m + share_x * (grown.front_m - grown.rear_m));
        let point = [x, share_y * grown.half_width_m];
        if footprint.grown(TOUCH_M).contains(point) {
            return Ok(());
        }
        let free_m = footprint.free_travel_m(margins, direction, &[point]);
        let run_over_m = stepped_m(&footprint.grown(-1e-6), direction, point, free_m.min(4.0));
        prop_assert!(run_over_m.is_none_or(|at_m| at_m >= free_m - 1e-6), "{free_m} {run_over_m:?}");
    }
}

#[test]
fn distances_that_are_known() {
    let footprint = Footprint::centred(0.8, 0.6);
    let plane = MotionPlane::Turning {
        radius_m: footprint.radius_m(),
    };
    let free_in_m = |first, second, plane, point| {
        let (direction, _) = MotionDirection::of(first, second, plane).unwrap();
        footprint.free_travel_m(BARE, direction, &[point])
    };
    let free_m = |along, swing, point| free_in_m(along, swing, plane, point);
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
    close(free_m(1.0, 0.0, [1.4, 0.29]), 1.0);
    assert_eq!(free_m(1.0, 0.0, [1.4, 0.31]), f64::INFINITY);
    assert_eq!(free_m(1.0, 0.0, [-1.4, 0.0]), f64::INFINITY);
    close(free_m(-1.0, 0.0, [-1.4, 0.0]), 1.0);
    // On the spot the left side, at its end near the corner, reaches a point beside it.
    close(
        free_m(0.0, 1.0, [0.0, 0.45]) / 0.5,
        FRAC_PI_2 - libm::asin(0.3 / 0.45),
    );
    assert_eq!(free_m(0.0, 1.0, [0.0, 0.51]), f64::INFINITY);
    // To the right, and ahead to the left, where the side comes before the front.
    let sideways_m = |first, second, point| free_in_m(first, second, MotionPlane::Sideways, point);
    close(sideways_m(0.0, -1.0, [0.39, -1.3]), 1.0);
    assert_eq!(sideways_m(0.0, -1.0, [0.41, -1.3]), f64::INFINITY);
    close(sideways_m(0.6, 0.8, [0.5, 1.1]), 1.0);
    close(sideways_m(0.6, 0.8, [1.0, 0.9]), 1.0);
    assert_eq!(sideways_m(0.6, 0.8, [0.0, 1.2]), f64::INFINITY);
    // About a point 0.5 m to the left, the front reaches one that is 0.6 m to the right of that.
    let (direction, _) = MotionDirection::of(0.5, 0.5, plane).unwrap();
    let point = [0.6, 0.5];
    let turned_rad = footprint.free_travel_m(BARE, direction, &[point]) * direction.turn_per_m;
    close(turned_rad, FRAC_PI_2 - libm::asin(0.4 / 0.6));
}

#[test]
fn what_is_no_number_is_not_there() {
    let footprint = Footprint::centred(0.8, 0.6);
    for (along, swing) in [(1.0, 0.0), (1.0, 0.5), (0.0, -1.0)] {
        let (direction, _) = MotionDirection::of(along, swing, turning(0.5)).unwrap();
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for point in [[bad, 0.0], [0.5, bad], [bad, bad]] {
                let free_m = footprint.free_travel_m(BARE, direction, &[point]);
                assert_eq!(free_m, f64::INFINITY, "{point:?}");
            }
        }
    }
}

impl MotionDirection {
    /// Travel until it stands, metres, from a speed of travel: `v·t + v²/2a`, of the slower to stop of going and
    /// turning.
    fn stopping_travel_m(self, speed_mps: f64, braking: &Braking) -> f64 {
        speed_mps * (braking.reaction_s + speed_mps * self.seconds_per_speed(braking))
    }
}

const BRAKING: Braking = Braking {
    reaction_s: 0.12,
    decel_mps2: 1.0,
    decel_radps2: 4.0,
};

#[test]
fn straight_on_it_is_the_formula_of_the_design() {
    let (ahead, _) = MotionDirection::of(2.0, 0.0, turning(0.8)).unwrap();
    assert!((ahead.stopping_travel_m(1.0, &BRAKING) - (0.12 + 0.5)).abs() < 1e-12);
    let (left, _) = MotionDirection::of(0.0, 1.0, turning(0.5)).unwrap();
    // 2 rad/s: the outermost point at 1 m/s.
    let turned_rad = left.stopping_travel_m(1.0, &BRAKING) * left.turn_per_m;
    assert!((turned_rad - (2.0 * 0.12 + 4.0 / 8.0)).abs() < 1e-12);
}

#[test]
fn what_does_not_move_has_no_heading() {
    for (along_m, swing_m) in [(0.0, 0.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)] {
        assert_eq!(MotionDirection::of(along_m, swing_m, turning(0.5)), None);
    }
}

proptest! {
    #[test]
    fn the_speed_is_the_one_that_needs_the_travel(
        along in -1.0..1.0, swing in -1.0..1.0, travel_m in 1e-6..50.0
    ) {
        let (direction, _) = MotionDirection::of(along, swing, turning(0.7)).unwrap();
        let speed = direction.speed_for_mps(travel_m, &BRAKING);
        let needed = direction.stopping_travel_m(speed, &BRAKING);
        prop_assert!((needed - travel_m).abs() < 1e-9 * (1.0 + travel_m));
    }
}
