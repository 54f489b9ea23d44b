//! One stem, and how much of a beam falls on it.

use nalgebra::{Point2, Point3, Vector2, Vector3};

use super::Cone;
use super::wind::{Gust, Phases, Wind};
use measurement::pose::Pose;

/// A straight round rod.
#[derive(Clone, Debug, PartialEq)]
pub struct Stem {
    /// Its lower end without wind, in the world.
    pub foot_m: Point3<f64>,
    /// Its upper end without wind, in the world.
    pub top_m: Point3<f64>,
    /// Half its thickness, metres.
    pub radius_m: f64,
    /// How far wind of strength 1 moves its foot and its top, metres: 0 and 0 where it is rigid. A foot
    /// that moves is that of a leaf on a stem.
    pub reach_m: [f64; 2],
    /// Where its swinging begins.
    pub phases: Phases,
}

/// What a beam lights of a stem.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Along the beam's axis to the middle of what is lit, metres.
    pub distance_m: f64,
    /// Share of the beam that falls on it.
    pub share: f64,
}

/// A line has no cross section; this is that of a needle.
const THINNEST_M: f64 = 1e-6;

impl Stem {
    /// Foot and top as the wind moves them.
    pub fn ends_m(&self, gust: &Gust) -> [Point3<f64>; 2] {
        if self.reach_m == [0.0, 0.0] {
            return [self.foot_m, self.top_m];
        }
        let offset = gust.offset(&self.phases);
        let moved = |end: Point3<f64>, reach_m: f64| {
            Point3::new(
                end.x + reach_m * offset.x,
                end.y + reach_m * offset.y,
                end.z,
            )
        };
        [
            moved(self.foot_m, self.reach_m[0]),
            moved(self.top_m, self.reach_m[1]),
        ]
    }

    /// The part of it, without wind, that is in a box grown by its radius: shares of its length.
    pub(super) fn part_in(&self, min_m: Point3<f64>, max_m: Point3<f64>) -> Option<[f64; 2]> {
        part_of([self.foot_m, self.top_m], self.radius_m, [min_m, max_m])
    }

    /// Whether a part of it, without wind, is in a box grown by its radius, whose least and greatest corners
    /// are given in its own frame.
    pub(super) fn is_in(&self, box_from_world: &Pose, corners_m: [Point3<f64>; 2]) -> bool {
        let ends_m = [self.foot_m, self.top_m].map(|end| box_from_world * end);
        part_of(ends_m, self.radius_m, corners_m).is_some()
    }

    /// The rectangle that it never leaves.
    pub(super) fn swept_m(&self, wind: &Wind) -> [Point2<f64>; 2] {
        let reach_m = self.reach_m[0].max(self.reach_m[1]);
        let grown = Vector2::repeat(self.radius_m + wind.farthest_m(reach_m));
        let (foot, top) = (self.foot_m.xy(), self.top_m.xy());
        [foot.inf(&top) - grown, foot.sup(&top) + grown]
    }
}

/// The part of a rod between `ends_m` that is in a box grown by its radius: shares of its length.
fn part_of(
    [from_m, to_m]: [Point3<f64>; 2],
    radius_m: f64,
    [min_m, max_m]: [Point3<f64>; 2],
) -> Option<[f64; 2]> {
    let along = to_m - from_m;
    let mut part = [0.0_f64, 1.0_f64];
    for axis in 0..3 {
        let least = min_m[axis] - radius_m - from_m[axis];
        let most = max_m[axis] + radius_m - from_m[axis];
        if along[axis] == 0.0 {
            if least > 0.0 || most < 0.0 {
                return None;
            }
            continue;
        }
        let ends = [least / along[axis], most / along[axis]];
        part[0] = part[0].max(ends[0].min(ends[1]));
        part[1] = part[1].min(ends[0].max(ends[1]));
    }
    (part[0] <= part[1]).then_some(part)
}

impl Spot {
    /// What `cone` lights of `stem`; `None` where it passes by.
    ///
    /// Across the beam the stem is a strip that may end within the spot. The strip's area is its width
    /// times its length in its middle: off by at most 4 % of the spot where it is a third as wide.
    pub fn on(stem: &Stem, cone: &Cone, gust: &Gust) -> Option<Self> {
        let [foot, top] = stem.ends_m(gust);
        let along: Vector3<f64> = top - foot;
        let from_tip = foot - cone.origin;
        // Feet of the perpendicular between the axis and the stem's line: `s` along the axis in metres,
        // `u` along the stem by its length.
        let (b, c) = (cone.axis.dot(&along), along.norm_squared());
        let (axis_foot, along_foot) = (cone.axis.dot(&from_tip), along.dot(&from_tip));
        let across_squared = (c - b * b).max(THINNEST_M * THINNEST_M);
        let u = (b * axis_foot - along_foot) / across_squared;
        let s = axis_foot + u * b;
        // Of a stem along the beam the perpendicular may be far beyond its ends.
        let nearest_s = axis_foot + u.clamp(0.0, 1.0) * b;
        let spot_m = (cone.spread * nearest_s).max(THINNEST_M);
        let apart_squared = (from_tip + along * u - cone.axis * s).norm_squared();
        let touch_m = spot_m + stem.radius_m;
        if nearest_s <= 0.0 || apart_squared >= touch_m * touch_m {
            return None;
        }
        let apart_m = libm::sqrt(apart_squared);
        let strip = [
            (apart_m - stem.radius_m).max(-spot_m),
            (apart_m + stem.radius_m).min(spot_m),
        ];
        let middle_m = 0.5 * (strip[0] + strip[1]);
        let half_m = libm::sqrt((spot_m * spot_m - middle_m * middle_m).max(0.0));
        let half = half_m / libm::sqrt(across_squared);
        let lit = [(u - half).max(0.0), (u + half).min(1.0)];
        if lit[0] >= lit[1] {
            return None;
        }
        let length_m = (lit[1] - lit[0]) * libm::sqrt(across_squared);
        let area = length_m * (strip[1] - strip[0]);
        Some(Self {
            distance_m: axis_foot + 0.5 * (lit[0] + lit[1]) * b,
            share: (area / (std::f64::consts::PI * spot_m * spot_m)).min(1.0),
        })
    }
}
