//! The cells that a beam crosses: a supercover line walk in whole numbers.

/// Fixed-point fraction of a cell: 2¹⁶ steps, so a point moves by less than 2 µm at 0.1 m cells.
const FRACTION_BITS: u32 = 16;
const FRACTION: i64 = 1 << FRACTION_BITS;

/// A point in fixed-point cells. Its cell is the whole part, towards −∞.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FixedPoint {
    x: i64,
    y: i64,
}

/// Greatest distance from the origin of `odom`, in cells: tiles are numbered in 32 bits and products of
/// coordinates must fit 64.
const MAX_CELL: f64 = (1u64 << 30) as f64;

impl FixedPoint {
    /// From metres; `None` where not finite or farther than 2³⁰ cells from the origin of `odom`.
    pub fn from_metres(x_m: f64, y_m: f64, cell_m: f64) -> Option<Self> {
        let (x, y) = (x_m / cell_m, y_m / cell_m);
        let fits = |cells: f64| cells.abs() < MAX_CELL; // false for NaN
        let fixed = |cells: f64| rounded_down(cells * FRACTION as f64);
        (fits(x) && fits(y)).then(|| Self {
            x: fixed(x),
            y: fixed(y),
        })
    }

    /// The cell it lies in.
    pub const fn cell(self) -> (i32, i32) {
        (
            (self.x >> FRACTION_BITS) as i32,
            (self.y >> FRACTION_BITS) as i32,
        )
    }
}

/// `value`, which fits, as a whole number towards −∞; in line, where `floor` is a call for each coordinate.
fn rounded_down(value: f64) -> i64 {
    let towards_zero = value as i64;
    towards_zero - i64::from(value < towards_zero as f64)
}

/// A walk from cell to cell along a segment. Each step crosses one edge, so diagonals are never skipped;
/// where the segment passes exactly through a corner, one of the two cells beside it is included.
///
/// Bresenham's idea with every crossed cell (\[LRF\] §2): the sign of `error` says whether the next edge to
/// be crossed is a vertical or a horizontal one. All in whole numbers, so there is nothing to accumulate.
#[derive(Clone, Copy, Debug)]
pub struct RayWalk {
    /// Steps from the first cell to the last: |Δx| + |Δy|.
    pub steps: u32,
    /// −1 or 1.
    pub step_x: i32,
    /// −1 or 1.
    pub step_y: i32,
    /// Negative: the next step is along x.
    pub error: i64,
    /// Added after a step along x.
    pub error_after_x: i64,
    /// Subtracted after a step along y.
    pub error_after_y: i64,
}

impl RayWalk {
    /// The walk from `start` to `end`, which must be fewer than 2²⁰ cells apart.
    pub fn new(start: FixedPoint, end: FixedPoint) -> Self {
        let (x0, y0) = start.cell();
        let (x1, y1) = end.cell();
        let (dx, dy) = ((end.x - start.x).abs(), (end.y - start.y).abs());
        let to_edge_x = distance_to_edge(start.x, end.x >= start.x);
        let to_edge_y = distance_to_edge(start.y, end.y >= start.y);
        Self {
            steps: x1.abs_diff(x0) + y1.abs_diff(y0),
            step_x: if end.x >= start.x { 1 } else { -1 },
            step_y: if end.y >= start.y { 1 } else { -1 },
            // The vertical edge comes first if to_edge_x / dx < to_edge_y / dy.
            error: to_edge_x * dy - to_edge_y * dx,
            error_after_x: 2 * FRACTION * dy,
            error_after_y: 2 * FRACTION * dx,
        }
    }
}

/// Twice the distance to the first cell edge. Points are taken at the middle of their fixed-point step
/// (hence twice, and odd), so that none lies on an edge and a walk ends exactly in its last cell.
const fn distance_to_edge(coordinate: i64, forward: bool) -> i64 {
    let twice = 2 * (coordinate & (FRACTION - 1)) + 1;
    if forward { 2 * FRACTION - twice } else { twice }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn cells(start: FixedPoint, end: FixedPoint) -> Vec<(i32, i32)> {
        let walk = RayWalk::new(start, end);
        let (mut cell, mut error) = (start.cell(), walk.error);
        let mut crossed = vec![cell];
        for _ in 0..walk.steps {
            if error < 0 {
                cell.0 += walk.step_x;
                error += walk.error_after_x;
            } else {
                cell.1 += walk.step_y;
                error -= walk.error_after_y;
            }
            crossed.push(cell);
        }
        crossed
    }

    fn walk(from: (f64, f64), to: (f64, f64)) -> Vec<(i32, i32)> {
        let point = |(x, y)| FixedPoint::from_metres(x, y, 1.0).unwrap();
        cells(point(from), point(to))
    }

    #[test]
    fn a_shallow_beam_crosses_every_cell_on_its_way() {
        let drawn = walk((0.5, 0.5), (3.5, 1.5));
        // Edges are crossed at x = 1 (y = 0.67), y = 1 (x = 2 exactly: one of two), x = 3 (y = 1.33).
        assert_eq!(drawn.first(), Some(&(0, 0)));
        assert_eq!(drawn.last(), Some(&(3, 1)));
        assert_eq!(drawn.len(), 5);
        assert_eq!(walk((0.2, 0.9), (0.9, 0.2)), [(0, 0)]);
        assert_eq!(walk((0.5, 0.5), (-1.5, 0.5)), [(0, 0), (-1, 0), (-2, 0)]);
        assert_eq!(walk((0.1, 0.8), (0.9, 1.9)), [(0, 0), (0, 1)]);
    }

    #[test]
    fn points_are_rounded_down_on_both_sides_of_zero() {
        for value in [-2.0, -1.75, -1.0, -1e-9, -0.0, 0.0, 0.25, 1.0, 1.75] {
            assert_eq!(rounded_down(value), libm::floor(value) as i64, "{value}");
        }
    }

    #[test]
    fn far_or_senseless_points_have_no_cell() {
        for x in [f64::NAN, f64::INFINITY, 2e9, -2e9] {
            assert_eq!(FixedPoint::from_metres(x, 0.0, 1.0), None, "{x}");
        }
    }

    /// Liang–Barsky: how far along the segment it is inside the open cell; `None` where it misses it.
    fn overlap(from: (f64, f64), to: (f64, f64), cell: (i32, i32)) -> Option<f64> {
        let (mut t0, mut t1) = (0.0f64, 1.0f64);
        for (a, b, low) in [(from.0, to.0, cell.0), (from.1, to.1, cell.1)] {
            let (low, high) = (f64::from(low), f64::from(low) + 1.0);
            let d = b - a;
            if d == 0.0 {
                if a < low || a >= high {
                    return None;
                }
                continue;
            }
            let (near, far) = ((low - a) / d, (high - a) / d);
            t0 = t0.max(near.min(far));
            t1 = t1.min(near.max(far));
        }
        (t1 > t0).then_some(t1 - t0)
    }

    proptest! {
        #[test]
        fn the_walk_is_the_supercover(
            x0 in -40.0..40.0f64, y0 in -40.0..40.0f64, x1 in -40.0..40.0f64, y1 in -40.0..40.0f64,
        ) {
            let crossed = walk((x0, y0), (x1, y1));
            for pair in crossed.windows(2) {
                let moved = (pair[1].0 - pair[0].0).abs() + (pair[1].1 - pair[0].1).abs();
                prop_assert_eq!(moved, 1, "a diagonal step");
            }
            let length = ((x1 - x0).powi(2) + (y1 - y0).powi(2)).sqrt();
            for x in -41..=41 {
                for y in -41..=41 {
                    // Overlaps shorter than the fixed-point step may go either way.
                    let inside = overlap((x0, y0), (x1, y1), (x, y)).map_or(0.0, |t| t * length);
                    let walked = crossed.contains(&(x, y));
                    prop_assert!(inside <= 1e-3 || walked, "({x}, {y}) left out");
                    if walked {
                        let near = (-1..=1).any(|i| (-1..=1).any(|j| {
                            overlap((x0, y0), (x1, y1), (x + i, y + j)).is_some()
                        }));
                        prop_assert!(near, "({x}, {y}) is not on the beam");
                    }
                }
            }
        }

        #[test]
        fn there_and_back_cross_the_same_number_of_cells(
            x0 in -1e6..1e6f64, y0 in -1e6..1e6f64, dx in -9e3..9e3f64, dy in -9e3..9e3f64,
        ) {
            let (from, to) = ((x0, y0), (x0 + dx, y0 + dy));
            let (there, back) = (walk(from, to), walk(to, from));
            prop_assert_eq!(there.first(), back.last());
            prop_assert_eq!(there.last(), back.first());
            prop_assert_eq!(there.len(), back.len());
        }
    }
}
