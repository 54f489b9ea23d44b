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
    sectors: Box<[Looked; SECTORS]>,
}

/// From where to where beams of one sector looked, metres; as far as all of them did.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Looked {
    near_m: f32,
    far_m: f32,
}

impl Looked {
    const NOWHERE: Self = Self {
        near_m: f32::INFINITY,
        far_m: 0.0,
    };
}

impl Default for Coverage {
    fn default() -> Self {
        Self {
            origin_in_odom: Point2::origin(),
            sectors: Box::new([Looked::NOWHERE; SECTORS]),
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
        self.sectors.fill(Looked::NOWHERE);
    }

    /// A beam of some width, radians, looked in a direction (any length) between two distances, metres.
    pub(super) fn look(
        &mut self,
        direction: Vector2<f64>,
        width_rad: f64,
        near_m: f64,
        far_m: f64,
    ) {
        let is_direction =
            direction.x.is_finite() && direction.y.is_finite() && direction != Vector2::zeros();
        if !is_direction {
            return;
        }
        let half = (0.5 * width_rad).clamp(0.0, 0.5 * WIDEST_BEAM_RAD); // NaN stays, and looks nowhere
        let across = Vector2::new(-direction.y, direction.x) * half;
        let (first, last) = (sector(direction - across), sector(direction + across));
        let (near_m, far_m) = (near_m as f32, far_m as f32);
        let mut at = first;
        loop {
            let looked = &mut self.sectors[at];
            *looked = if *looked == Looked::NOWHERE {
                Looked { near_m, far_m }
            } else {
                Looked {
                    near_m: looked.near_m.max(near_m),
                    far_m: looked.far_m.min(far_m),
                }
            };
            if at == last {
                break;
            }
            at = if at + 1 == SECTORS { 0 } else { at + 1 };
        }
    }

    /// Whether a point, metres in `odom`, was looked at; with `slack_m` for what lies at the end of a beam.
    pub(super) fn has_seen(&self, point_in_odom: Point2<f64>, slack_m: f64) -> bool {
        let to = point_in_odom - self.origin_in_odom;
        let distance_m = (to.x * to.x + to.y * to.y).sqrt();
        if distance_m <= 0.0 {
            return true;
        }
        let looked = self.sectors[sector(to)];
        distance_m >= f64::from(looked.near_m) - slack_m
            && distance_m <= f64::from(looked.far_m) + slack_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
            coverage.look(direction, degree, 0.0, 2.0);
        }
        let sees = |angle_deg: f64, distance_m: f64| {
            let (sin, cos) = (
                libm::sin(angle_deg.to_radians()),
                libm::cos(angle_deg.to_radians()),
            );
            coverage.has_seen(
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
        coverage.look(ahead, 0.001, 0.5, 4.0);
        coverage.look(ahead, 0.001, 0.2, 2.0);
        let sees = |x: f64| coverage.has_seen(Point2::new(x, 0.001 * x), 0.0);
        assert_eq!([0.3, 1.0, 3.0].map(sees), [false, true, false]);
        for bad in [Vector2::zeros(), Vector2::new(f64::NAN, 1.0)] {
            coverage.look(bad, 0.01, 0.0, 100.0);
        }
        coverage.look(Vector2::new(0.0, 1.0), f64::NAN, 0.0, f64::NAN);
        assert!(!coverage.has_seen(Point2::new(0.0, 1.0), 0.0));
    }
}
