//! Whether the map is large enough to drive by with all panels around it.
//!
//! Where it is not, the window shows it and the driving panel alone while somebody drives.

use eframe::egui::Vec2;

use super::layout::{BELOW, LEFT, RIGHT};
use super::sizes::{LEAST, LEAST_SHARE};

/// Whether a window that has so much for its panels, points, is too narrow for those beside the map, and too low for those below
/// it, as large as they are at first: the map would have less than two fifths, or than 300 points.
pub fn is_tight(window: Vec2) -> [bool; 2] {
    let is_too_small = |whole: f32, taken: f32| whole - taken < LEAST.max(LEAST_SHARE * whole);
    [
        is_too_small(window.x, LEFT + RIGHT),
        is_too_small(window.y, BELOW),
    ]
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;

    use super::*;

    /// Of the bar at the top, points.
    const BAR: f32 = 39.0;

    #[test]
    fn only_a_map_of_less_than_two_fifths_or_300_points_wants_the_room_of_others() {
        for (width, height, percent, expected) in [
            (1280.0, 800.0, 100.0, [false, false]),
            (1280.0, 800.0, 120.0, [false, false]),
            (1024.0, 600.0, 100.0, [false, false]),
            // 580 points beside the map are three fifths of 967, and 190 below it leave 300 of 490.
            (968.0, 491.0 + BAR, 100.0, [false, false]),
            (966.0, 489.0 + BAR, 100.0, [true, true]),
            (1280.0, 800.0, 150.0, [true, false]),
            (700.0, 620.0, 100.0, [true, false]),
            (640.0, 480.0, 100.0, [true, true]),
        ] {
            let points = 100.0 / percent * vec2(width, height);
            let told = is_tight(points - vec2(0.0, BAR));
            assert_eq!(told, expected, "{width} × {height} at {percent} %");
        }
    }
}
