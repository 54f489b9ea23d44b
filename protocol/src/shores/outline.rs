//! A convex polygon of few corners around cells, in whole numbers: exact, and the same on every platform.

use std::collections::BTreeMap;

/// Corners of an outline at most.
pub const MAX_CORNERS: usize = 12;

type Corner = (i32, i32);

/// The convex hull of cells, counter-clockwise from its lowest corner to the left, in cells: cell `(x, y)`
/// covers `x … x + 1` and `y … y + 1`. Empty where there is no cell.
///
/// Where the hull has more than [`MAX_CORNERS`] corners, those are left out, one after the other, that cost the
/// least area; so parts of cells may stick out.
pub fn convex_outline(cells: impl IntoIterator<Item = (i32, i32)>) -> Vec<(i32, i32)> {
    // Only the ends of each line of corners can be corners of the hull.
    let mut ends: BTreeMap<i32, (i32, i32)> = BTreeMap::new();
    for (x, y) in cells {
        let right = x.saturating_add(1);
        for line in [y, y.saturating_add(1)] {
            let (low, high) = ends.entry(line).or_insert((x, right));
            (*low, *high) = ((*low).min(x), (*high).max(right));
        }
    }
    let mut hull = Vec::new();
    let rights = ends.iter().map(|(&y, &(_, high))| (high, y));
    let lefts = ends.iter().rev().map(|(&y, &(low, _))| (low, y));
    let lowest = ends.iter().next().map(|(&y, &(low, _))| (low, y));
    for corner in lowest.into_iter().chain(rights).chain(lefts) {
        add(&mut hull, corner);
    }
    // The last is the first again.
    hull.pop();
    while hull.len() > MAX_CORNERS {
        let cheapest = (0..hull.len()).min_by_key(|&at| cost(&hull, at));
        hull.remove(cheapest.unwrap_or_default());
    }
    hull
}

/// Adds the next corner of a walk around the hull, and drops those before it that it makes no corners.
fn add(hull: &mut Vec<Corner>, corner: Corner) {
    while let [.., a, b] = hull[..]
        && turn(a, b, corner) <= 0
    {
        hull.pop();
    }
    if hull.last() != Some(&corner) {
        hull.push(corner);
    }
}

/// Twice the area of a triangle; positive where it turns left.
fn turn(a: Corner, b: Corner, c: Corner) -> i128 {
    let along = |from: Corner, to: Corner| {
        [
            i128::from(to.0) - i128::from(from.0),
            i128::from(to.1) - i128::from(from.1),
        ]
    };
    let ([bx, by], [cx, cy]) = (along(a, b), along(a, c));
    bx * cy - by * cx
}

/// Twice the area that goes with a corner.
fn cost(hull: &[Corner], at: usize) -> i128 {
    let before = hull[(at + hull.len() - 1) % hull.len()];
    let after = hull[(at + 1) % hull.len()];
    turn(before, hull[at], after)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn hulls_are_those_drawn_by_hand() {
        let check = |cells: &[(i32, i32)], expected: &[(i32, i32)]| {
            assert_eq!(convex_outline(cells.iter().copied()), expected, "{cells:?}");
        };
        check(&[], &[]);
        check(&[(2, -3)], &[(2, -3), (3, -3), (3, -2), (2, -2)]);
        // An L: its inner corner is bridged.
        check(
            &[(0, 0), (1, 0), (2, 0), (0, 1), (0, 2)],
            &[(0, 0), (3, 0), (3, 1), (1, 3), (0, 3)],
        );
        // A diagonal, from the upper left to the lower right.
        check(
            &[(0, 2), (1, 1), (2, 0)],
            &[(2, 0), (3, 0), (3, 1), (1, 3), (0, 3), (0, 2)],
        );
        // Its right side is no number: it has no area, so no outline.
        check(&[(i32::MAX, i32::MIN)], &[]);
    }

    #[test]
    fn a_disc_keeps_its_twelve_dearest_corners() {
        let disc = (-50..50).flat_map(|x: i32| (-50..50).map(move |y| (x, y)));
        let disc = disc.filter(|(x, y)| x * x + y * y < 2_400);
        let hull = convex_outline(disc);
        assert_eq!(hull.len(), MAX_CORNERS);
        let area: i128 = (1..hull.len() - 1)
            .map(|at| turn(hull[0], hull[at], hull[at + 1]))
            .sum();
        // π · 2400 = 7540; the regular polygon of twelve corners has 95.5 % of its circle.
        assert!((7_200..7_800).contains(&(area / 2)), "{area}");
    }

    proptest! {
        #[test]
        fn few_corners_hold_every_cell_and_turn_left(
            cells in prop::collection::vec((-4..4i32, -4..4i32), 1..20)
        ) {
            let hull = convex_outline(cells.iter().copied());
            let side = |at: usize, corner| turn(hull[at], hull[(at + 1) % hull.len()], corner);
            for at in 0..hull.len() {
                prop_assert!(side(at, hull[(at + 2) % hull.len()]) > 0);
            }
            // So small a patch has no hull of more than twelve corners.
            for (x, y) in cells {
                for corner in [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)] {
                    prop_assert!((0..hull.len()).all(|at| side(at, corner) >= 0), "{hull:?}");
                }
            }
        }
    }
}
