//! Measuring on the map: how far it is along a line of points, in which direction, and how much higher. Pure.

use crate::panels::formatting::{direction, signed};

/// Points of a line at most.
pub(super) const MAX_POINTS: usize = 100;

/// The points that were set, metres in `odom`, the first first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ruler {
    points_m: Vec<[f64; 2]>,
}

/// One straight piece.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// How long, metres.
    pub length_m: f64,
    /// Clockwise from north (y of `odom`), 0 … 360°; `None` for a piece without length.
    pub bearing_deg: Option<f64>,
    /// How much higher it ends than it begins, metres, where heights are known at both ends.
    pub rise_m: Option<f64>,
}

impl Ruler {
    /// The points, metres in `odom`.
    pub fn points_m(&self) -> &[[f64; 2]] {
        &self.points_m
    }

    /// Sets another point; false where there are too many.
    pub(super) fn add(&mut self, point_m: [f64; 2]) -> bool {
        let has_room = self.points_m.len() < MAX_POINTS;
        if has_room && point_m.iter().all(|m| m.is_finite()) {
            self.points_m.push(point_m);
        }
        has_room
    }

    /// Takes the last point back.
    pub(super) fn undo_point(&mut self) {
        self.points_m.pop();
    }

    /// The pieces to each point from the one before it, `height` being what is known of heights at a point, metres.
    pub(super) fn legs(
        points_m: &[[f64; 2]],
        height: impl Fn([f64; 2]) -> Option<f32>,
    ) -> Vec<Leg> {
        let leg = |pair: &[[f64; 2]]| {
            let [from, to] = [pair[0], pair[1]];
            let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
            let length_m = libm::hypot(dx, dy);
            let bearing_deg = libm::atan2(dx, dy).to_degrees().rem_euclid(360.0);
            Leg {
                length_m,
                bearing_deg: (length_m > 0.0).then_some(bearing_deg),
                rise_m: height(from)
                    .zip(height(to))
                    .map(|(from, to)| f64::from(to) - f64::from(from)),
            }
        };
        points_m.windows(2).map(leg).collect()
    }
}

impl Leg {
    /// In words: its direction is the compass's where north is known, else from the map's x, as the robot's heading is.
    pub fn label(&self, knows_north: bool) -> String {
        let bearing = self.bearing_deg;
        let bearing = bearing.map(|deg| direction(90.0 - deg, knows_north, "x"));
        let rise = self.rise_m.map(|rise_m| {
            let sign = if rise_m > 0.0 { "+" } else { "" };
            format!("height {sign}{} m", signed(rise_m, 2))
        });
        let parts = [Some(length(self.length_m)), bearing, rise];
        parts
            .into_iter()
            .flatten()
            .collect::<Vec<_>>()
            .join("  ·  ")
    }
}

/// The length of all pieces, in words; `None` of fewer than two.
pub(super) fn total(legs: &[Leg]) -> Option<String> {
    let total_m: f64 = legs.iter().map(|leg| leg.length_m).sum();
    (legs.len() > 1).then(|| format!("total {}", length(total_m)))
}

fn length(length_m: f64) -> String {
    match length_m {
        0.0..100.0 => format!("{length_m:.2} m"),
        100.0..10_000.0 => format!("{length_m:.1} m"),
        _ => format!("{:.2} km", length_m / 1000.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLAT: fn([f64; 2]) -> Option<f32> = |_| None;

    #[test]
    fn pieces_have_length_bearing_and_rise() {
        let slope = |[x, _]: [f64; 2]| (x < 5.0).then_some(0.5 * x as f32);
        let points_m = [[0.0, 0.0], [3.0, 4.0], [3.0, 0.0], [-1.0, 0.0], [9.0, 0.0]];
        let legs = Ruler::legs(&points_m, slope);
        let labels: Vec<_> = legs.iter().map(|leg| leg.label(true)).collect();
        assert_eq!(
            labels,
            [
                "5.00 m  ·  037°  ·  height +1.50 m",
                "4.00 m  ·  180°  ·  height 0.00 m",
                "4.00 m  ·  270°  ·  height −2.00 m",
                "10.00 m  ·  090°"
            ]
        );
        let labels: Vec<_> = legs.iter().map(|leg| leg.label(false)).collect();
        assert_eq!(
            labels,
            [
                "5.00 m  ·  53° left of x  ·  height +1.50 m",
                "4.00 m  ·  90° right of x  ·  height 0.00 m",
                "4.00 m  ·  against x  ·  height −2.00 m",
                "10.00 m  ·  along x"
            ]
        );
        assert_eq!(total(&legs).as_deref(), Some("total 23.00 m"));
        assert_eq!(total(&legs[..1]), None);
    }

    #[test]
    fn nearly_north_is_north_and_nothing_has_no_direction() {
        let legs = Ruler::legs(&[[0.0, 0.0], [-0.001, 1.0], [-0.001, 1.0]], FLAT);
        assert_eq!(legs[0].label(true), "1.00 m  ·  000°");
        assert_eq!(legs[1].label(true), "0.00 m");
        let far = Ruler::legs(&[[0.0, 0.0], [0.0, 250.0], [0.0, 12_750.0]], FLAT);
        assert_eq!(far[0].label(true), "250.0 m  ·  000°");
        assert_eq!(far[1].label(true), "12.50 km  ·  000°");
    }

    #[test]
    fn points_are_set_taken_back_and_bounded() {
        let mut ruler = Ruler::default();
        ruler.add([f64::NAN, 0.0]);
        assert_eq!(ruler.points_m().len(), 0);
        for index in 0..MAX_POINTS {
            assert!(ruler.add([index as f64, 0.0]));
        }
        assert!(!ruler.add([0.0, 0.0]));
        ruler.undo_point();
        assert_eq!(ruler.points_m().len(), MAX_POINTS - 1);
    }
}
