//! The line that is measured, its lengths beside it.

use std::sync::Arc;

use eframe::egui::{Color32, FontId, Galley, Painter, Pos2, Rect, Stroke, Vec2, vec2};

use super::super::camera::Camera;
use super::super::ruler::{Leg, total};

const LINE: Color32 = Color32::from_rgb(0xcc, 0x00, 0x7a);
/// Radius of a point, points of the screen.
pub(in crate::map_view) const POINT: f32 = 4.0;
/// A card is so much larger than its words, either way.
const CARD: Vec2 = vec2(5.0, 2.0);
/// From the end of the line to the card beside it.
const GAP: f32 = 14.0;

/// Draws points (metres in `odom`) and the pieces between them, one fewer than points.
pub(in crate::map_view) fn paint(
    painter: &Painter,
    points_m: &[[f64; 2]],
    legs: &[Leg],
    (camera, screen): (&Camera, Rect),
    ink: Color32,
    paper: Color32,
) {
    let points: Vec<Pos2> = points_m
        .iter()
        .map(|point_m| camera.to_screen(screen, *point_m))
        .collect();
    for pair in points.windows(2) {
        painter.line_segment([pair[0], pair[1]], Stroke::new(4.0, Color32::WHITE));
        painter.line_segment([pair[0], pair[1]], Stroke::new(2.0, LINE));
    }
    for point in &points {
        painter.circle(*point, POINT, LINE, Stroke::new(1.5, Color32::WHITE));
    }
    let galley = |text: String| painter.layout_no_wrap(text, FontId::proportional(13.0), ink);
    let card = |place: Rect, words: Arc<Galley>| {
        painter.rect_filled(place, 4.0, paper);
        painter.galley(place.shrink2(CARD).min, words, ink);
    };
    let mut taken = Vec::with_capacity(legs.len());
    for (pair, leg) in points.windows(2).zip(legs) {
        let words = galley(leg.label());
        let size = words.size() + 2.0 * CARD;
        let middle = pair[0].lerp(pair[1], 0.5);
        let place = Rect::from_center_size(middle - vec2(0.0, 8.0 + 0.5 * size.y), size);
        taken.push(place);
        card(place, words);
    }
    if let (Some(total), Some(end)) = (total(legs), points.last()) {
        let words = galley(total);
        let place = beside(*end, words.size() + 2.0 * CARD, &taken);
        card(place, words);
    }
}

/// Where a card of this size stands beside a point: below it, or wherever it covers no other card.
fn beside(point: Pos2, size: Vec2, taken: &[Rect]) -> Rect {
    let [right, below] = [vec2(GAP + 0.5 * size.x, 0.0), vec2(0.0, GAP + 0.5 * size.y)];
    let places = [below, -below, right, -right, 3.0 * below, -3.0 * below];
    let places = places.map(|offset| Rect::from_center_size(point + offset, size));
    let is_free = |place: &&Rect| taken.iter().all(|other| !other.intersects(**place));
    *places.iter().find(is_free).unwrap_or(&places[0])
}

#[cfg(test)]
mod tests {
    use eframe::egui::pos2;

    use super::*;

    #[test]
    fn the_total_covers_no_length() {
        let point = pos2(400.0, 300.0);
        let size = vec2(80.0, 20.0);
        let mut taken = Vec::new();
        let mut centers = Vec::new();
        for _ in 0..6 {
            let place = beside(point, size, &taken);
            assert!(!place.contains(point));
            assert!(taken.iter().all(|other| !place.intersects(*other)));
            taken.push(place);
            centers.push(place.center());
        }
        let offset = |x: f32, y: f32| point + vec2(x, y);
        assert_eq!(centers[..2], [offset(0.0, 24.0), offset(0.0, -24.0)]);
        assert_eq!(centers[2..4], [offset(54.0, 0.0), offset(-54.0, 0.0)]);
        // Where all is full it is below all the same.
        assert_eq!(beside(point, size, &taken).center(), centers[0]);
    }
}
