//! Whether a surface passes a cell.

use nalgebra::Point2;

/// How a surface passes a cell.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Crossed {
    No,
    Edge,
    Interior,
}

/// How the segment from `a` to `b` passes the rectangle.
pub(super) fn passes(
    a: Point2<f64>,
    b: Point2<f64>,
    min: Point2<f64>,
    max: Point2<f64>,
) -> Crossed {
    let Some([enter, leave]) = clipped([a, b], min, max) else {
        return Crossed::No;
    };
    let in_interior =
        |axis: usize| (b - a)[axis] != 0.0 || (min[axis] < a[axis] && a[axis] < max[axis]);
    if enter < leave && (0..2).all(in_interior) {
        Crossed::Interior
    } else {
        Crossed::Edge
    }
}

/// The part of a segment within a rectangle, edges included, as parameters in [0, 1] (clipping by Liang
/// and Barsky).
pub(super) fn clipped(
    [a, b]: [Point2<f64>; 2],
    min: Point2<f64>,
    max: Point2<f64>,
) -> Option<[f64; 2]> {
    let along = b - a;
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for axis in 0..2 {
        if along[axis] == 0.0 {
            if a[axis] < min[axis] || a[axis] > max[axis] {
                return None;
            }
        } else {
            let t = [min[axis], max[axis]].map(|edge| (edge - a[axis]) / along[axis]);
            enter = enter.max(t[0].min(t[1]));
            leave = leave.min(t[0].max(t[1]));
        }
    }
    (enter <= leave).then_some([enter, leave])
}
