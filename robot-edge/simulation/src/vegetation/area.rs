//! Where a patch grows.

use nalgebra::Point2;

/// A part of the plan.
#[derive(Clone, Debug, PartialEq)]
pub enum Area {
    /// From least to greatest x and y.
    Rectangle([Point2<f64>; 2]),
    /// Inside of an outline; of one that crosses itself, what an odd number of turns goes around.
    Polygon(Vec<Point2<f64>>),
    /// What is no farther from a line than half its width.
    Strip {
        /// Its corners.
        along_m: Vec<Point2<f64>>,
        /// Metres.
        width_m: f64,
    },
}

impl Area {
    /// Whether it holds a point.
    pub fn contains(&self, at: Point2<f64>) -> bool {
        match self {
            Self::Rectangle([min, max]) => {
                (0..2).all(|axis| min[axis] <= at[axis] && at[axis] <= max[axis])
            }
            Self::Polygon(corners) => is_inside(corners, at),
            Self::Strip { along_m, width_m } => along_m
                .windows(2)
                .any(|piece| distance_m(piece[0], piece[1], at) <= 0.5 * width_m),
        }
    }

    /// The rectangle around it.
    pub fn bounds_m(&self) -> [Point2<f64>; 2] {
        let (corners, grown): (&[_], f64) = match self {
            Self::Rectangle(corners) => (corners, 0.0),
            Self::Polygon(corners) => (corners, 0.0),
            Self::Strip { along_m, width_m } => (along_m, 0.5 * width_m),
        };
        let start = [f64::INFINITY, f64::NEG_INFINITY].map(|m| Point2::new(m, m));
        let [min, max] = corners.iter().fold(start, |[min, max], corner| {
            [min.inf(corner), max.sup(corner)]
        });
        let grown = nalgebra::Vector2::repeat(grown);
        [min - grown, max + grown]
    }
}

/// Whether an outline goes around a point.
pub fn is_inside(outline: &[Point2<f64>], at: Point2<f64>) -> bool {
    let next = outline.iter().cycle().skip(1);
    let crossings = outline
        .iter()
        .zip(next)
        .filter(|(a, b)| (a.y > at.y) != (b.y > at.y))
        .filter(|(a, b)| at.x < a.x + (b.x - a.x) * (at.y - a.y) / (b.y - a.y));
    crossings.count() % 2 == 1
}

fn distance_m(a: Point2<f64>, b: Point2<f64>, at: Point2<f64>) -> f64 {
    let along = b - a;
    let length_squared = along.norm_squared();
    let share = if length_squared > 0.0 {
        ((at - a).dot(&along) / length_squared).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (a + along * share - at).norm()
}
