//! Where legends stand: in the lower right corner, never on the buttons and the compass of the upper right one. Pure.

use eframe::egui::{Pos2, Rect, Vec2, pos2};

use super::CARD_MARGIN;

/// To what else stands on the map at least, points.
const LEAST_GAP: f32 = 4.0;

/// The map, and what stands in its upper right corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LegendPlace {
    pub(super) screen: Rect,
    /// Lower edge of the buttons.
    pub(super) buttons: f32,
    /// Below them, where it is drawn.
    pub(super) compass: Option<Rect>,
}

impl LegendPlace {
    /// Lower edge of all that stands in the upper corner.
    fn top_widgets_bottom(&self) -> f32 {
        let compass = self.compass.map(|compass| compass.bottom());
        compass.map_or(self.buttons, |compass| compass.max(self.buttons))
    }

    /// The room below the compass; it may have no height.
    pub(super) fn below(&self) -> Rect {
        let whole = self.screen.shrink(CARD_MARGIN);
        let top = self.top_widgets_bottom() + CARD_MARGIN;
        whole.with_min_y(top.min(whole.bottom()))
    }

    /// The room beside the compass, below the buttons.
    fn beside(&self) -> Rect {
        let whole = self.screen.shrink(CARD_MARGIN);
        let right = self.compass.map_or(whole.right(), |compass| {
            whole.right().min(compass.left() - LEAST_GAP)
        });
        let top = self.buttons + LEAST_GAP;
        // A narrow map is not left unused at its other edge.
        let left = self.screen.left() + LEAST_GAP;
        let corner = pos2(right.max(left), whole.bottom());
        Rect::from_min_max(pos2(left, top.min(corner.y)), corner)
    }

    /// The room for legends that somebody has opened, so wide and so high at least, points: below the compass where it
    /// is enough, else beside that; `None` where there is none.
    pub(super) fn opened(&self, least: Vec2) -> Option<Rect> {
        let rooms = [self.below(), self.beside()];
        let has_room = |room: &Rect| room.width() >= least.x && room.height() >= least.y;
        rooms.into_iter().find(has_room)
    }

    /// The lower right corner of a button that stands for all legends. On a low map it is nearer to the edge, or beside
    /// the compass; where there is no room there either, there is none.
    pub(super) fn button(&self, size: Vec2) -> Option<Pos2> {
        let (screen, whole) = (self.screen, self.screen.shrink(CARD_MARGIN));
        let lowest = self.top_widgets_bottom() + LEAST_GAP + size.y;
        if lowest + LEAST_GAP <= screen.bottom() {
            return Some(pos2(whole.right(), lowest.max(whole.bottom())));
        }
        let beside = self.beside();
        let has_room = beside.width() >= size.x && beside.height() >= size.y;
        has_room.then(|| beside.right_bottom())
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;

    use super::*;

    const BUTTON: Vec2 = vec2(65.0, 20.0);

    /// A map whose buttons end at 48 points, with a compass below them; a banner is so high.
    fn map(width: f32, height: f32, banner: f32) -> LegendPlace {
        let compass = pos2(width - CARD_MARGIN - 44.0, banner + 48.0 + CARD_MARGIN);
        LegendPlace {
            screen: Rect::from_min_size(Pos2::ZERO, vec2(width, height)),
            buttons: banner + 48.0,
            compass: Some(Rect::from_min_size(compass, vec2(44.0, 44.0))),
        }
    }

    #[test]
    fn the_button_stands_below_the_compass_or_beside_it_or_nowhere() {
        for (height, banner, expected) in [
            (300.0, 0.0, Some(pos2(201.0, 288.0))),
            (140.0, 0.0, Some(pos2(201.0, 128.0))),
            // Nearer to the edge than usual.
            (134.0, 0.0, Some(pos2(201.0, 128.0))),
            (131.0, 0.0, Some(pos2(153.0, 119.0))),
            (168.0, 80.0, Some(pos2(153.0, 156.0))),
            (168.0, 90.0, None),
        ] {
            let map = map(213.0, height, banner);
            let corner = map.button(BUTTON);
            assert_eq!(corner, expected, "{height}, {banner}");
            if let Some(corner) = corner {
                let button = Rect::from_min_max(corner - BUTTON, corner);
                assert!(!button.intersects(map.compass.unwrap()), "{button}");
                assert!(
                    button.top() > map.buttons && map.screen.contains_rect(button),
                    "{button}"
                );
            }
        }
        // Nor does it reach out of the map.
        assert_eq!(map(120.0, 120.0, 0.0).button(BUTTON), None);
        let bare = LegendPlace {
            compass: None,
            ..map(120.0, 120.0, 0.0)
        };
        assert_eq!(bare.button(BUTTON), Some(pos2(108.0, 108.0)));
    }

    #[test]
    fn opened_legends_stand_beside_the_compass_where_there_is_no_room_below_it() {
        let least = vec2(113.0, 60.0);
        let high = map(213.0, 300.0, 0.0);
        assert_eq!(high.opened(least), Some(high.below()));
        assert!((high.below().top() - 116.0).abs() < 1e-3);
        let low = map(213.0, 168.0, 0.0);
        let room = low.opened(least).unwrap();
        assert_eq!(room.right_bottom(), pos2(153.0, 156.0));
        assert!(room.top() > low.buttons && room.height() > 100.0, "{room}");
        assert_eq!(map(160.0, 168.0, 0.0).opened(least), None, "too narrow");
        assert_eq!(map(213.0, 110.0, 0.0).opened(least), None, "too low");
    }
}
