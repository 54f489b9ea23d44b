//! Measuring on the map: distance along a line of points, bearings and height differences.

use std::sync::Arc;

use eframe::egui::{Color32, FontId, Galley, Painter, Pos2, Rect, Stroke, Vec2, vec2};

use super::camera::Camera;
use crate::panels::formatting::{direction, signed};

pub(super) const MAX_POINTS: usize = 100;

/// Points in `odom`, m.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ruler {
    points_m: Vec<[f64; 2]>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    pub length_m: f64,
    /// Clockwise from north (y of `odom`), 0 … 360°; `None` for length 0.
    pub bearing_deg: Option<f64>,
    /// Height difference, m, if both heights are known.
    pub rise_m: Option<f64>,
}

impl Ruler {
    pub fn points_m(&self) -> &[[f64; 2]] {
        &self.points_m
    }

    pub(super) fn add(&mut self, point_m: [f64; 2]) {
        if self.points_m.len() < MAX_POINTS && point_m.iter().all(|m| m.is_finite()) {
            self.points_m.push(point_m);
        }
    }

    pub(super) fn undo_point(&mut self) {
        self.points_m.pop();
    }

    /// Segments between consecutive points; `height` returns the known height of a point, m.
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
    /// Text of a segment. Its direction is a compass bearing if north is known, else relative to x.
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

const LINE: Color32 = Color32::from_rgb(0xcc, 0x00, 0x7a);
pub(super) const POINT_RADIUS: f32 = 4.0;
const CARD: Vec2 = vec2(5.0, 2.0);
/// Distance of a label from the line, points.
const GAP: f32 = 14.0;

/// Draws the line and its labels, which avoid `others`.
pub(super) fn paint_ruler(
    painter: &Painter,
    points_m: &[[f64; 2]],
    (labels, total): (&[String], Option<&str>),
    camera: &Camera,
    others: &[Rect],
    ink: Color32,
    paper: Color32,
) {
    let points = camera.line(points_m);
    for pair in points.windows(2) {
        painter.line_segment([pair[0], pair[1]], Stroke::new(4.0, Color32::WHITE));
        painter.line_segment([pair[0], pair[1]], Stroke::new(2.0, LINE));
    }
    for point in &points {
        painter.circle(*point, POINT_RADIUS, LINE, Stroke::new(1.5, Color32::WHITE));
    }
    let galley =
        |text: &str| painter.layout_no_wrap(text.to_owned(), FontId::proportional(13.0), ink);
    let words: Vec<_> = labels.iter().map(|label| galley(label)).collect();
    let total = total.map(galley);
    let size = |words: &Arc<Galley>| words.size() + 2.0 * CARD;
    let sizes: Vec<_> = words.iter().map(size).collect();
    let places = places(&points, &sizes, total.as_ref().map(size), others);
    for (place, words) in places.into_iter().zip(words.into_iter().chain(total)) {
        painter.rect_filled(place, 4.0, paper);
        painter.galley(place.shrink2(CARD).min, words, ink);
    }
}

/// Positions of the segment labels and of the total. A label avoids the line, `others` and other labels if possible.
fn places(points: &[Pos2], sizes: &[Vec2], total: Option<Vec2>, others: &[Rect]) -> Vec<Rect> {
    let mut taken = others.to_vec();
    let mut stand = |places: Vec<Rect>| {
        let is_free = |place: &&Rect| {
            let crosses = |pair: &[Pos2]| lies_on(**place, [pair[0], pair[1]]);
            !points.windows(2).any(crosses) && taken.iter().all(|other| !other.intersects(**place))
        };
        let place = places.iter().find(is_free).or_else(|| places.first());
        taken.extend(place.copied());
    };
    for (pair, size) in points.windows(2).zip(sizes) {
        stand(along([pair[0], pair[1]], *size));
    }
    if let (Some(size), Some(end)) = (total, points.last()) {
        stand(beside(*end, size));
    }
    taken.split_off(others.len())
}

/// Candidate positions beside a segment: above first, then below, then farther away.
fn along([from, to]: [Pos2; 2], size: Vec2) -> Vec<Rect> {
    let way = (to - from).normalized();
    // Perpendicular to the segment, upwards (or to the right).
    let across = vec2(way.y, -way.x);
    let across = if across == Vec2::ZERO {
        -Vec2::Y
    } else if across.y > 0.0 || (across.y == 0.0 && across.x < 0.0) {
        -across
    } else {
        across
    };
    let reach = 0.5 * (across.x.abs() * size.x + across.y.abs() * size.y);
    let middle = from.lerp(to, 0.5);
    let at = |factor: f32| Rect::from_center_size(middle + factor * (GAP + reach) * across, size);
    [1.0, -1.0, 2.0, -2.0, 3.0, -3.0].map(at).to_vec()
}

fn beside(point: Pos2, size: Vec2) -> Vec<Rect> {
    let [right, below] = [vec2(GAP + 0.5 * size.x, 0.0), vec2(0.0, GAP + 0.5 * size.y)];
    let places = [below, -below, right, -right, 3.0 * below, -3.0 * below];
    let places = places.map(|offset| Rect::from_center_size(point + offset, size));
    places.to_vec()
}

fn lies_on(card: Rect, [from, to]: [Pos2; 2]) -> bool {
    if !card.intersects(Rect::from_two_pos(from, to)) {
        return false;
    }
    let way = to - from;
    let across = vec2(way.y, -way.x);
    let distance = (card.center() - from).dot(across).abs();
    distance < 0.5 * (across.x.abs() * card.width() + across.y.abs() * card.height())
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::pos2;

    const FLAT: fn([f64; 2]) -> Option<f32> = |_| None;

    #[test]
    fn segments_have_length_bearing_and_rise() {
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
    fn bearing_of_north_and_of_length_zero() {
        let legs = Ruler::legs(&[[0.0, 0.0], [-0.001, 1.0], [-0.001, 1.0]], FLAT);
        assert_eq!(legs[0].label(true), "1.00 m  ·  000°");
        assert_eq!(legs[1].label(true), "0.00 m");
        let far = Ruler::legs(&[[0.0, 0.0], [0.0, 250.0], [0.0, 12_750.0]], FLAT);
        assert_eq!(far[0].label(true), "250.0 m  ·  000°");
        assert_eq!(far[1].label(true), "12.50 km  ·  000°");
    }

    #[test]
    fn points_are_added_removed_and_limited() {
        let mut ruler = Ruler::default();
        ruler.add([f64::NAN, 0.0]);
        assert_eq!(ruler.points_m().len(), 0);
        for index in 0..=MAX_POINTS {
            ruler.add([index as f64, 0.0]);
        }
        assert_eq!(ruler.points_m().len(), MAX_POINTS);
        ruler.undo_point();
        assert_eq!(ruler.points_m().len(), MAX_POINTS - 1);
    }

    const CARD_SIZE: Vec2 = vec2(120.0, 20.0);

    #[test]
    fn labels_do_not_cover_the_line() {
        let middle = pos2(400.0, 300.0);
        for (dx, dy) in [
            (0.0, 30.0),
            (30.0, 0.0),
            (-8.0, 20.0),
            (14.0, 14.0),
            (0.0, 0.0),
        ] {
            let points = [middle - vec2(dx, dy), middle];
            let places = places(&points, &[CARD_SIZE], None, &[]);
            assert!(!lies_on(places[0], points), "{dx} {dy}: {places:?}");
            let [up, side] = [vec2(0.0, 12.0), vec2(12.0, 0.0)];
            for arm in [[middle - up, middle + up], [middle - side, middle + side]] {
                assert!(!lies_on(places[0], arm), "{dx} {dy}: {places:?}");
            }
        }
        let flat = along([middle, middle + vec2(40.0, 0.0)], CARD_SIZE)[0];
        assert_eq!(flat.center(), pos2(420.0, 300.0 - GAP - 10.0));
        let upright = along([middle, middle + vec2(0.0, 40.0)], CARD_SIZE)[0];
        assert_eq!(upright.center(), pos2(400.0 + GAP + 60.0, 320.0));
    }

    #[test]
    fn labels_of_short_segments_do_not_overlap() {
        let points = [
            pos2(400.0, 300.0),
            pos2(420.0, 300.0),
            pos2(420.0, 320.0),
            pos2(405.0, 330.0),
        ];
        let places = places(&points, &[CARD_SIZE; 3], Some(vec2(80.0, 20.0)), &[]);
        assert_eq!(places.len(), 4);
        for (index, place) in places.iter().enumerate() {
            let mut pieces = points.windows(2);
            assert!(
                !pieces.any(|pair| lies_on(*place, [pair[0], pair[1]])),
                "{place}"
            );
            let others = &places[index + 1..];
            assert!(
                others.iter().all(|other| !other.intersects(*place)),
                "{places:?}"
            );
        }
    }

    #[test]
    fn the_total_is_below_the_end_if_free() {
        let end = pos2(400.0, 300.0);
        let size = vec2(80.0, 20.0);
        let total = |from: Pos2, others: &[Rect]| {
            let places = places(&[from, end], &[CARD_SIZE], Some(size), others);
            assert_eq!(places.len(), 2);
            places[1].center() - end
        };
        let (below, left) = (vec2(0.0, 24.0), pos2(100.0, 300.0));
        assert_eq!(total(left, &[]), below);
        assert_eq!(total(pos2(400.0, 500.0), &[]), -below);
        let letter = Rect::from_center_size(end + vec2(10.0, 30.0), vec2(22.0, 21.0));
        assert_eq!(total(left, &[letter]), -below);
    }
}
