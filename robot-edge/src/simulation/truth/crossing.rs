//! Whether a surface passes a cell.

use nalgebra::Point2;

/// How a surface passes a cell.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Crossed {
    No,
    Edge,
    Interior,
}

/// How the segment from `a` to `b` passes the rectangle (clipping by Liang and Barsky).
pub(super) fn passes(
    a: Point2<f64>,
    b: Point2<f64>,
    min: Point2<f64>,
    max: Point2<f64>,
) -> Crossed {
    let along = b - a;
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    let mut in_interior = true;
    for axis in 0..2 {
        if along[axis] == 0.0 {
            if a[axis] < min[axis] || a[axis] > max[axis] {
                return Crossed::No;
            }
            in_interior &= min[axis] < a[axis] && a[axis] < max[axis];
        } else {
            let t = [min[axis], max[axis]].map(|edge| (edge - a[axis]) / along[axis]);
            enter = enter.max(t[0].min(t[1]));
            leave = leave.min(t[0].max(t[1]));
        }
    }
    if enter > leave {
        Crossed::No
    } else if in_interior && enter < leave {
        Crossed::Interior
    } else {
        Crossed::Edge
    }
}
