//! The surfaces of all solids together in one horizontal plane.

use nalgebra::{Point2, Vector2};

use crate::solid::Solid;
use crate::solid::section::Section;

/// The boundary of the union of the solids' sections; moving solids are left out.
///
/// Where solids overlap or stand flush against each other the surface between them is no surface: no beam
/// reaches it.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Outline {
    sections: Vec<Vec<Point2<f64>>>,
    segments: Vec<[Point2<f64>; 2]>,
}

/// Solids closer than this stand flush, metres: far below a laser's resolution, far above rounding.
const FLUSH_M: f64 = 1e-9;

impl Outline {
    /// The outline of what of `solids` reaches `height_m` and stands still.
    pub fn at_height(solids: &[Solid], height_m: f64) -> Self {
        let (mut areas, mut lines) = (Vec::new(), Vec::new());
        for solid in solids.iter().filter(|solid| solid.motion.is_none()) {
            match solid.section(height_m) {
                Section::Nothing => {}
                Section::Area(corners) => areas.push(corners),
                Section::Lines(pieces) => lines.extend(pieces),
            }
        }
        let mut outline = Self::of_sections(areas);
        for line in lines {
            let visible = visible_parts(line, &mut outline.sections.iter());
            outline.segments.extend(visible);
        }
        outline
    }

    /// The outline of convex polygons, each counter-clockwise.
    pub(super) fn of_sections(sections: Vec<Vec<Point2<f64>>>) -> Self {
        let mut segments = Vec::new();
        for (index, section) in sections.iter().enumerate() {
            for edge in edges(section) {
                let mut others = sections
                    .iter()
                    .enumerate()
                    .filter_map(|(other, cover)| (other != index).then_some(cover));
                segments.extend(visible_parts(edge, &mut others));
            }
        }
        Self { sections, segments }
    }

    /// Straight pieces of surface, the solid on their left where it has an inside.
    pub fn segments(&self) -> &[[Point2<f64>; 2]] {
        &self.segments
    }

    /// Whether a point is in a solid or on its surface.
    pub fn contains(&self, point: Point2<f64>) -> bool {
        self.sections
            .iter()
            .any(|section| edges(section).all(|edge| outward_distance_m(edge, point) <= 0.0))
    }

    /// Distance from a point, inside or outside, to the nearest surface, metres; infinite where there is
    /// none.
    pub fn distance_m(&self, point: Point2<f64>) -> f64 {
        let squared = |&[a, b]: &[Point2<f64>; 2]| {
            let along: Vector2<f64> = b - a;
            let t = ((point - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            (point - (a + along * t)).norm_squared()
        };
        libm::sqrt(
            self.segments
                .iter()
                .map(squared)
                .fold(f64::INFINITY, f64::min),
        )
    }
}

pub(super) fn edges(polygon: &[Point2<f64>]) -> impl Iterator<Item = [Point2<f64>; 2]> + '_ {
    let next = polygon.iter().cycle().skip(1);
    polygon.iter().zip(next).map(|(&a, &b)| [a, b])
}

/// Distance of a point from an edge's line, positive outside a counter-clockwise polygon, metres.
fn outward_distance_m([a, b]: [Point2<f64>; 2], point: Point2<f64>) -> f64 {
    outward_normal([a, b]).dot(&(point - a))
}

fn outward_normal([a, b]: [Point2<f64>; 2]) -> Vector2<f64> {
    let along = b - a;
    Vector2::new(along.y, -along.x) / along.norm()
}

/// Parts of `edge` that no polygon of `covers` hides.
fn visible_parts(
    edge: [Point2<f64>; 2],
    covers: &mut dyn Iterator<Item = &Vec<Point2<f64>>>,
) -> Vec<[Point2<f64>; 2]> {
    let mut visible = vec![[0.0, 1.0]];
    for cover in covers {
        if let Some(hidden) = hidden_part(edge, cover) {
            visible = without(&visible, hidden);
        }
    }
    let [a, b] = edge;
    visible
        .into_iter()
        .map(|part| part.map(|t| a + (b - a) * t))
        .collect()
}

/// The part of `edge`, as parameters in [0, 1], that the convex polygon `cover` hides.
fn hidden_part(edge: [Point2<f64>; 2], cover: &[Point2<f64>]) -> Option<[f64; 2]> {
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for cover_edge in edges(cover) {
        let [start, end] = edge.map(|point| outward_distance_m(cover_edge, point));
        if start.abs() <= FLUSH_M && end.abs() <= FLUSH_M {
            // On the same line. Face to face they hide each other; with the same outside neither does.
            if outward_normal(edge).dot(&outward_normal(cover_edge)) > 0.0 {
                return None;
            }
        } else if start > 0.0 && end > 0.0 {
            return None;
        } else if start > 0.0 {
            from = from.max(start / (start - end));
        } else if end > 0.0 {
            to = to.min(start / (start - end));
        }
    }
    (from < to).then_some([from, to])
}

/// `parts` without `hidden`; slivers that only rounding leaves are dropped.
fn without(parts: &[[f64; 2]], [from, to]: [f64; 2]) -> Vec<[f64; 2]> {
    parts
        .iter()
        .flat_map(|&[a, b]| [[a, b.min(from)], [a.max(to), b]])
        .filter(|[a, b]| b - a > FLUSH_M)
        .collect()
}

#[cfg(test)]
mod tests;
