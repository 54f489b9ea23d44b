//! The line that is measured, its lengths beside it.

use std::sync::Arc;

use eframe::egui::{Color32, FontId, Galley, Painter, Pos2, Rect, Stroke, Vec2, vec2};

use super::super::camera::Camera;

const LINE: Color32 = Color32::from_rgb(0xcc, 0x00, 0x7a);
/// Radius of a point, points of the screen.
pub(in crate::map_view) const POINT: f32 = 4.0;
/// A card is so much larger than its words, either way.
const CARD: Vec2 = vec2(5.0, 2.0);
/// From the end of the line to the card beside it.
const GAP: f32 = 14.0;

/// Draws points (metres in `odom`) and the pieces between them, with the words for each piece and for all of them. These
/// stand beside `others`, which are on the map already.
pub(in crate::map_view) fn paint(
    painter: &Painter,
    points_m: &[[f64; 2]],
    (labels, total): (&[String], Option<&str>),
    (camera, screen): (&Camera, Rect),
    others: &[Rect],
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
    let galley =
        |text: &str| painter.layout_no_wrap(text.to_owned(), FontId::proportional(13.0), ink);
    let card = |place: Rect, words: Arc<Galley>| {
        painter.rect_filled(place, 4.0, paper);
        painter.galley(place.shrink2(CARD).min, words, ink);
    };
    let words: Vec<_> = labels.iter().map(|label| galley(label)).collect();
    let total = total.map(galley);
    let size = |words: &Arc<Galley>| words.size() + 2.0 * CARD;
    let sizes: Vec<_> = words.iter().map(size).collect();
    let places = places(&points, &sizes, total.as_ref().map(size), others);
    for (place, words) in places.into_iter().zip(words.into_iter().chain(total)) {
        card(place, words);
    }
}

/// Where cards of these sizes stand, one beside the middle of each piece, and that of the total beside the last point:
/// over nothing of the line, nor of what marks its end, over no other card and none of `others`, while there is such a
/// place.
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

/// Where a card of this size may stand along a piece: above it, below it, and so on farther away.
fn along([from, to]: [Pos2; 2], size: Vec2) -> Vec<Rect> {
    let way = (to - from).normalized();
    // Across it and up; of an upright one, to the right.
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

/// Where a card of this size may stand beside a point: below it, above it, and so on.
fn beside(point: Pos2, size: Vec2) -> Vec<Rect> {
    let [right, below] = [vec2(GAP + 0.5 * size.x, 0.0), vec2(0.0, GAP + 0.5 * size.y)];
    let places = [below, -below, right, -right, 3.0 * below, -3.0 * below];
    let places = places.map(|offset| Rect::from_center_size(point + offset, size));
    places.to_vec()
}

/// Whether a card lies on a piece of the line.
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
    use eframe::egui::pos2;

    use super::*;

    const CARD_SIZE: Vec2 = vec2(120.0, 20.0);

    #[test]
    fn no_card_lies_on_the_line_or_on_its_end_however_short_it_is() {
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
            // The cross in the middle of the map.
            let [up, side] = [vec2(0.0, 12.0), vec2(12.0, 0.0)];
            for arm in [[middle - up, middle + up], [middle - side, middle + side]] {
                assert!(!lies_on(places[0], arm), "{dx} {dy}: {places:?}");
            }
        }
        // Above what lies flat, and to the right of what is upright.
        let flat = along([middle, middle + vec2(40.0, 0.0)], CARD_SIZE)[0];
        assert_eq!(flat.center(), pos2(420.0, 300.0 - GAP - 10.0));
        let upright = along([middle, middle + vec2(0.0, 40.0)], CARD_SIZE)[0];
        assert_eq!(upright.center(), pos2(400.0 + GAP + 60.0, 320.0));
    }

    #[test]
    fn cards_of_short_pieces_cover_neither_one_another_nor_other_pieces() {
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
    fn the_total_stands_below_the_end_while_nothing_is_there() {
        let end = pos2(400.0, 300.0);
        let size = vec2(80.0, 20.0);
        let total = |from: Pos2, others: &[Rect]| {
            let places = places(&[from, end], &[CARD_SIZE], Some(size), others);
            assert_eq!(places.len(), 2);
            places[1].center() - end
        };
        let (below, left) = (vec2(0.0, 24.0), pos2(100.0, 300.0));
        assert_eq!(total(left, &[]), below);
        // The line comes from below, or the letter of a docking site is there.
        assert_eq!(total(pos2(400.0, 500.0), &[]), -below);
        let letter = Rect::from_center_size(end + vec2(10.0, 30.0), vec2(22.0, 21.0));
        assert_eq!(total(left, &[letter]), -below);
    }
}
