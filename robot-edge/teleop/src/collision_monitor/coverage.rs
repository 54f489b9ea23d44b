//! Where a sweep has looked: how far in each direction.

use nalgebra::{Point2, Vector2};

/// Directions that are told apart: 0.3 to 0.6 degrees each.
const SECTORS: usize = 720;

/// Widest gap between beams that counts as looked at, radians; coarser sensors leave gaps.
const WIDEST_BEAM_RAD: f64 = 0.1;

/// What was looked at from one place, metres from there, in each direction.
#[derive(Clone, Debug)]
pub(super) struct Coverage {
    origin_in_odom: Point2<f64>,
    sectors: Box<[Option<VisibleRange>; SECTORS]>,
}

/// What one beam has looked at, or all beams of one sector have; distances along the ground, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct VisibleRange {
    /// From here on it was low enough to see what stands on the ground, …
    pub(super) near_m: f32,
    /// … up to here.
    pub(super) far_m: f32,
    /// It passed over everything up to here, at whatever height.
    pub(super) reach_m: f32,
    /// It had no echo.
    pub(super) is_miss: bool,
}

impl VisibleRange {
    pub(super) const NOTHING: Self = Self {
        near_m: f32::INFINITY,
        far_m: 0.0,
        reach_m: 0.0,
        is_miss: false,
    };

    /// What both have looked at.
    fn and(self, other: Self) -> Self {
        Self {
            near_m: self.near_m.max(other.near_m),
            far_m: self.far_m.min(other.far_m),
            reach_m: self.reach_m.min(other.reach_m),
            is_miss: self.is_miss || other.is_miss,
        }
    }
}

/// How a place was looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Observation {
    /// By a beam that was low enough there; else by one that passed above it.
    pub(super) is_low: bool,
    /// By a beam without an echo.
    pub(super) is_miss: bool,
}

impl Default for Coverage {
    fn default() -> Self {
        Self {
            origin_in_odom: Point2::origin(),
            sectors: Box::new([None; SECTORS]),
        }
    }
}

/// The number of the sector of a direction that is not zero. Sectors are equal parts of a square, not of a circle, which
/// takes no trigonometry.
fn sector(direction: Vector2<f64>) -> usize {
    let share = direction.y / (direction.x.abs() + direction.y.abs());
    let quarters = match (direction.x >= 0.0, direction.y >= 0.0) {
        (true, true) => share,
        (true, false) => 4.0 + share,
        (false, _) => 2.0 - share,
    };
    ((0.25 * SECTORS as f64 * quarters) as usize).min(SECTORS - 1)
}

impl Coverage {
    /// Forgets everything, and looks from another place.
    pub(super) fn clear(&mut self, origin_in_odom: Point2<f64>) {
        self.origin_in_odom = origin_in_odom;
        self.sectors.fill(None);
    }

    /// A beam of some width, radians, looked in a direction (any length).
    pub(super) fn add_beam(
        &mut self,
        direction: Vector2<f64>,
        width_rad: f64,
        visible: VisibleRange,
    ) {
        let is_direction =
            direction.x.is_finite() && direction.y.is_finite() && direction != Vector2::zeros();
        if !is_direction {
            return;
        }
        let half = (0.5 * width_rad).clamp(0.0, 0.5 * WIDEST_BEAM_RAD); // NaN stays, and looks nowhere
        let across = Vector2::new(-direction.y, direction.x) * half;
        let (first, last) = (sector(direction - across), sector(direction + across));
        let mut at = first;
        loop {
            let observation = &mut self.sectors[at];
            *observation = Some(observation.map_or(visible, |before| before.and(visible)));
            if at == last {
                break;
            }
            at = if at + 1 == SECTORS { 0 } else { at + 1 };
        }
    }

    /// How a point, metres in `odom`, was looked at, if it was; with `slack_m` for what lies at the end of a beam.
    pub(super) fn observation_at(
        &self,
        point_in_odom: Point2<f64>,
        slack_m: f64,
    ) -> Option<Observation> {
        let to = point_in_odom - self.origin_in_odom;
        let distance_m = (to.x * to.x + to.y * to.y).sqrt();
        if distance_m <= 0.0 {
            return Some(Observation {
                is_low: true,
                is_miss: false,
            });
        }
        let visible = self.sectors[sector(to)]?;
        let is_low = distance_m >= f64::from(visible.near_m) - slack_m
            && distance_m <= f64::from(visible.far_m) + slack_m;
        let is_passed = distance_m <= f64::from(visible.reach_m);
        (is_low || is_passed).then_some(Observation {
            is_low,
            is_miss: visible.is_miss,
        })
    }

    /// Whether a point was looked at by a beam that was low enough there.
    #[cfg(test)]
    pub(super) fn is_visible(&self, point_in_odom: Point2<f64>, slack_m: f64) -> bool {
        self.observation_at(point_in_odom, slack_m)
            .is_some_and(|observation| observation.is_low)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn visible(near_m: f32, far_m: f32) -> VisibleRange {
        VisibleRange {
            near_m,
            far_m,
            reach_m: far_m,
            is_miss: false,
        }
    }

    #[test]
    fn sectors_follow_each_other_around() {
        let mut last = 0;
        for step in 0..3600 {
            let angle_rad = f64::from(step) * 0.1_f64.to_radians();
            let at = sector(Vector2::new(libm::cos(angle_rad), libm::sin(angle_rad)));
            assert!(at == last || at == last + 1, "{step}");
            last = at;
        }
        assert_eq!(last, SECTORS - 1);
    }

    #[test]
    fn between_beams_that_adjoin_there_is_no_gap_and_beside_them_nothing() {
        let mut coverage = Coverage::default();
        coverage.clear(Point2::new(5.0, -3.0));
        let degree = 1.0_f64.to_radians();
        for n in -45..=45 {
            let angle_rad = f64::from(n) * degree;
            let direction = Vector2::new(libm::cos(angle_rad), libm::sin(angle_rad));
            coverage.add_beam(direction, degree, visible(0.0, 2.0));
        }
        let sees = |angle_deg: f64, distance_m: f64| {
            let (sin, cos) = (
                libm::sin(angle_deg.to_radians()),
                libm::cos(angle_deg.to_radians()),
            );
            coverage.is_visible(
                Point2::new(5.0 + distance_m * cos, -3.0 + distance_m * sin),
                0.01,
            )
        };
        for tenth in -450..=450 {
            assert!(sees(f64::from(tenth) / 10.0, 1.99), "{tenth}");
            assert!(!sees(f64::from(tenth) / 10.0, 2.02), "{tenth}");
        }
        assert!(!sees(47.0, 1.0) && !sees(-47.0, 1.0) && !sees(180.0, 0.5));
    }

    #[test]
    fn the_shorter_of_two_beams_counts() {
        let mut coverage = Coverage::default();
        let ahead = Vector2::new(1.0, 0.001);
        coverage.add_beam(ahead, 0.001, visible(0.5, 4.0));
        coverage.add_beam(ahead, 0.001, visible(0.2, 2.0));
        let sees = |x: f64| coverage.is_visible(Point2::new(x, 0.001 * x), 0.0);
        assert_eq!([0.3, 1.0, 3.0].map(sees), [false, true, false]);
        for bad in [Vector2::zeros(), Vector2::new(f64::NAN, 1.0)] {
            coverage.add_beam(bad, 0.01, visible(0.0, 100.0));
        }
        coverage.add_beam(Vector2::new(0.0, 1.0), f64::NAN, visible(0.0, f32::NAN));
        assert!(!coverage.is_visible(Point2::new(0.0, 1.0), 0.0));
    }
}
