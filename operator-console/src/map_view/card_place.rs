//! Where on the map the card stands that says what is at a point: beside that point and the vehicle, not over them.

use eframe::egui::{Align2, Pos2, Rect, Vec2, pos2};

use super::CARD_MARGIN;

/// A card that is narrower than this has too many lines, points.
pub(super) const LEAST: f32 = 330.0;
/// What is around a point is seen as well, points.
const AROUND: f32 = 24.0;

/// What else stands on the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Others {
    /// The map.
    pub(super) screen: Rect,
    /// Its upper edge, or that of what a banner leaves of it.
    pub(super) map_top: f32,
    /// Upper edge of the scale bar in the lower left corner.
    pub(super) bar: f32,
    /// The legends in the lower right corner, with their button.
    pub(super) legend: Option<Rect>,
    /// The buttons in the upper right corner.
    pub(super) buttons: Rect,
    /// Left edge of the compass, which is below them.
    pub(super) compass: f32,
}

/// Where the card stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CardPlace {
    /// One of its corners.
    pub(super) corner: Pos2,
    /// Which of them.
    pub(super) align: Align2,
    /// What it has for its width, points.
    pub(super) width: f32,
}

impl CardPlace {
    /// For a card that was of this size when it was drawn last. It stands at the lower edge; where it would cover one of
    /// `points`, at the upper, unless it covers more there.
    pub(super) fn new(others: Others, size: Vec2, points: &[Pos2]) -> Self {
        let [low, high] = [Self::low(others), Self::high(others, size)];
        let covered = |place: &Self| {
            [0.0, AROUND].map(|around| {
                let rect = place.rect(size).expand(around);
                let covered = points.iter().filter(|point| rect.contains(**point));
                covered.count()
            })
        };
        if covered(&high) < covered(&low) {
            high
        } else {
            low
        }
    }

    /// What a card of this size covers there, as far as it is known before it is drawn.
    fn rect(&self, size: Vec2) -> Rect {
        let size = pos2(size.x.min(self.width), size.y).to_vec2();
        self.align.anchor_size(self.corner, size)
    }

    /// Beside the legend where both fit, else above it; over the scale bar in any case.
    fn low(others: Others) -> Self {
        let Others {
            screen,
            bar,
            legend,
            ..
        } = others;
        let left = screen.left() + CARD_MARGIN;
        let beside = legend.map_or(screen.right(), |legend| legend.left()) - CARD_MARGIN - left;
        let align = Align2::LEFT_BOTTOM;
        match legend {
            Some(legend) if beside < LEAST => Self {
                corner: pos2(left, bar.min(legend.top() - CARD_MARGIN)),
                align,
                width: screen.right() - CARD_MARGIN - left,
            },
            Some(_) | None => Self {
                corner: pos2(left, bar),
                align,
                width: beside,
            },
        }
    }

    /// Beside the buttons where a card so wide fits, else below them and beside the compass.
    fn high(others: Others, size: Vec2) -> Self {
        let Others {
            screen,
            map_top,
            buttons,
            compass,
            ..
        } = others;
        let left = screen.left() + CARD_MARGIN;
        let until = |edge: f32| (edge - CARD_MARGIN - left).max(0.0);
        let beside = until(buttons.left().min(compass));
        let (top, width) = if beside >= size.x {
            (map_top, beside)
        } else {
            (buttons.bottom().max(map_top), until(compass))
        };
        Self {
            corner: pos2(left, top + CARD_MARGIN),
            align: Align2::LEFT_TOP,
            width,
        }
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;

    use super::*;

    fn others(screen: Rect, has_legend: bool) -> Others {
        let corner = screen.right_bottom() - vec2(CARD_MARGIN, CARD_MARGIN);
        let legend = Rect::from_min_max(corner - vec2(236.0, 140.0), corner);
        let corner = screen.right_top() + vec2(-CARD_MARGIN, CARD_MARGIN);
        Others {
            screen,
            map_top: screen.top(),
            bar: screen.bottom() - 60.0,
            legend: has_legend.then_some(legend),
            buttons: Rect::from_min_max(corner - vec2(116.0, 0.0), corner + vec2(0.0, 36.0)),
            compass: corner.x - 44.0,
        }
    }

    #[test]
    fn the_card_is_never_under_the_legend() {
        for (size, is_beside) in [
            (vec2(700.0, 560.0), true),
            (vec2(500.0, 560.0), false),
            (vec2(270.0, 300.0), false),
        ] {
            let screen = Rect::from_min_size(pos2(280.0, 40.0), size);
            let others = others(screen, true);
            let legend = others.legend.unwrap();
            let place = CardPlace::new(others, vec2(200.0, 80.0), &[]);
            let right = place.corner.x + place.width;
            assert_eq!(right <= legend.left(), is_beside, "{size}");
            assert!(is_beside || place.corner.y <= legend.top(), "{size}");
            assert!(
                place.corner.y <= others.bar && right <= screen.right(),
                "{size}"
            );
        }
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(270.0, 300.0));
        let alone = CardPlace::new(others(screen, false), vec2(200.0, 80.0), &[]);
        assert_eq!((alone.corner, alone.width), (pos2(12.0, 240.0), 246.0));
    }

    #[test]
    fn it_is_never_under_a_banner() {
        let card = vec2(190.0, 70.0);
        for size in [vec2(398.0, 560.0), vec2(700.0, 560.0)] {
            let screen = Rect::from_min_size(pos2(0.0, 40.0), size);
            let mut others = others(screen, true);
            others.map_top += 60.0;
            others.buttons = others.buttons.translate(vec2(0.0, 60.0));
            let usual = CardPlace::new(others, card, &[]).rect(card);
            let rect = CardPlace::new(others, card, &[usual.center()]).rect(card);
            assert!(
                rect.top() > others.map_top && !rect.intersects(usual),
                "{rect}"
            );
            assert!(!rect.intersects(others.buttons), "{size}: {rect}");
        }
    }

    #[test]
    fn it_hides_neither_the_point_that_is_read_nor_the_vehicle() {
        let card = vec2(190.0, 70.0);
        for size in [vec2(280.0, 390.0), vec2(398.0, 560.0), vec2(700.0, 560.0)] {
            let screen = Rect::from_min_size(pos2(0.0, 40.0), size);
            let others = others(screen, true);
            let usual = CardPlace::new(others, card, &[]).rect(card);
            let vehicle = usual.center();
            for pointer in [usual.center_top(), screen.center_bottom()] {
                let rect = CardPlace::new(others, card, &[pointer, vehicle]).rect(card);
                assert!(!rect.contains(pointer) && !rect.contains(vehicle), "{size}");
                assert!(screen.contains_rect(rect), "{size}: {rect}");
                assert!(!rect.intersects(others.buttons), "{size}: {rect}");
                assert!(rect.right() < others.compass, "{size}: {rect}");
            }
            // Where it would hide one here and the other there, it stays.
            let high = CardPlace::high(others, card).rect(card);
            let both = CardPlace::new(others, card, &[high.center(), vehicle]);
            assert_eq!(both.rect(card), usual, "{size}");
        }
    }
}
