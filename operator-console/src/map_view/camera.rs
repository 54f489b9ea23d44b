//! Which part of `odom` is on the screen: x to the right, y up, never turned.

use eframe::egui::{Pos2, Rect, Vec2, pos2};

/// Closest: a cell of 5 cm is 100 points wide.
const MAX_POINTS_PER_M: f64 = 2_000.0;
/// Farthest: 40 km on a screen of 2000 points.
const MIN_POINTS_PER_M: f64 = 0.05;
/// Part of the screen that a fitted map fills.
const FIT_PART: f64 = 0.92;
/// A map of one cell is not blown up to fill the screen.
const MIN_FIT_SIDE_M: f64 = 4.0;

/// The point in the middle of the screen and the scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    center_m: [f64; 2],
    points_per_m: f64,
}

impl Default for Camera {
    fn default() -> Self {
        Self {
            center_m: [0.0; 2],
            points_per_m: 40.0,
        }
    }
}

impl Camera {
    /// The point of `odom` in the middle of the screen, metres.
    pub const fn center_m(&self) -> [f64; 2] {
        self.center_m
    }

    /// Points (logical pixels) for a metre.
    pub const fn points_per_m(&self) -> f64 {
        self.points_per_m
    }

    /// Where a point of `odom` is on a map drawn in `screen`.
    pub fn to_screen(&self, screen: Rect, [x_m, y_m]: [f64; 2]) -> Pos2 {
        let [center_x_m, center_y_m] = self.center_m;
        let middle = screen.center();
        pos2(
            middle.x + ((x_m - center_x_m) * self.points_per_m) as f32,
            middle.y - ((y_m - center_y_m) * self.points_per_m) as f32,
        )
    }

    /// The point of `odom` under a place on the screen, metres.
    pub fn to_odom(&self, screen: Rect, at: Pos2) -> [f64; 2] {
        let offset = at - screen.center();
        [
            self.center_m[0] + f64::from(offset.x) / self.points_per_m,
            self.center_m[1] - f64::from(offset.y) / self.points_per_m,
        ]
    }

    /// Lowest and greatest x and y on the screen, metres.
    pub fn visible_m(&self, screen: Rect) -> [f64; 4] {
        let [low_x, low_y] = self.to_odom(screen, screen.left_bottom());
        let [high_x, high_y] = self.to_odom(screen, screen.right_top());
        [low_x, low_y, high_x, high_y]
    }

    /// Puts a point of `odom` in the middle.
    pub fn center_on(&mut self, point_m: [f64; 2]) {
        if point_m.iter().all(|edge| edge.is_finite()) {
            self.center_m = point_m;
        }
    }

    /// Moves the map with the hand that drags it, points.
    pub fn pan(&mut self, drag: Vec2) {
        self.center_m[0] -= f64::from(drag.x) / self.points_per_m;
        self.center_m[1] += f64::from(drag.y) / self.points_per_m;
    }

    /// Magnifies by `factor`; what is at `at` stays there.
    pub fn zoom_about(&mut self, screen: Rect, at: Pos2, factor: f64) {
        if !(factor.is_finite() && factor > 0.0) {
            return;
        }
        let held_m = self.to_odom(screen, at);
        self.points_per_m = (self.points_per_m * factor).clamp(MIN_POINTS_PER_M, MAX_POINTS_PER_M);
        let moved_m = self.to_odom(screen, at);
        self.center_m[0] += held_m[0] - moved_m[0];
        self.center_m[1] += held_m[1] - moved_m[1];
    }

    /// Shows all of a rectangle: lowest and greatest x and y, metres.
    pub fn fit(&mut self, screen: Rect, [low_x, low_y, high_x, high_y]: [f64; 4]) {
        let is_rectangle = [low_x, low_y, high_x, high_y].iter().all(|m| m.is_finite());
        if !is_rectangle || screen.width() < 1.0 || screen.height() < 1.0 {
            return;
        }
        let width_m = (high_x - low_x).max(MIN_FIT_SIDE_M);
        let height_m = (high_y - low_y).max(MIN_FIT_SIDE_M);
        let across = f64::from(screen.width()) / width_m;
        let up = f64::from(screen.height()) / height_m;
        self.center_m = [0.5 * (low_x + high_x), 0.5 * (low_y + high_y)];
        self.points_per_m = (across.min(up) * FIT_PART).clamp(MIN_POINTS_PER_M, MAX_POINTS_PER_M);
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;

    use super::*;

    fn screen() -> Rect {
        Rect::from_min_size(pos2(260.0, 30.0), vec2(1000.0, 700.0))
    }

    fn assert_near(a: [f64; 2], b: [f64; 2], limit_m: f64) {
        let is_near = (a[0] - b[0]).abs() < limit_m && (a[1] - b[1]).abs() < limit_m;
        assert!(is_near, "{a:?} is not {b:?}");
    }

    #[test]
    fn x_is_right_and_y_is_up() {
        let camera = Camera::default();
        assert_eq!(camera.to_screen(screen(), [0.0; 2]), screen().center());
        assert_eq!(
            camera.to_screen(screen(), [1.0, 2.0]),
            screen().center() + vec2(40.0, -80.0)
        );
    }

    #[test]
    fn screen_and_odom_are_each_others_inverse() {
        let mut camera = Camera::default();
        for step in 0..40 {
            camera.zoom_about(screen(), pos2(300.0, 200.0), 0.9 + 0.01 * f64::from(step));
            camera.pan(vec2(7.0, -3.0));
            let at = pos2(900.5, 71.25);
            let back = camera.to_screen(screen(), camera.to_odom(screen(), at));
            assert!((back - at).length() < 1e-2, "{back:?} after {step}");
        }
    }

    #[test]
    fn zooming_keeps_the_point_under_the_cursor_even_at_the_limits() {
        let mut camera = Camera::default();
        let at = pos2(411.0, 603.0);
        let held_m = camera.to_odom(screen(), at);
        for factor in [1.2, 50.0, 50.0, 0.3, 1e-9, f64::NAN, 0.0, -1.0, 1.0] {
            camera.zoom_about(screen(), at, factor);
            let scale_m = 1.0 / camera.points_per_m();
            assert_near(
                camera.to_odom(screen(), at),
                held_m,
                1e-6 * scale_m.max(1.0),
            );
        }
        assert_eq!(camera.points_per_m().to_bits(), MIN_POINTS_PER_M.to_bits());
    }

    #[test]
    fn dragging_moves_the_point_with_the_hand() {
        let mut camera = Camera::default();
        let at = pos2(500.0, 300.0);
        let held_m = camera.to_odom(screen(), at);
        camera.pan(vec2(33.0, -21.0));
        assert_near(
            camera.to_odom(screen(), at + vec2(33.0, -21.0)),
            held_m,
            1e-4,
        );
    }

    #[test]
    fn a_fitted_map_is_all_there_and_nearly_fills_the_screen() {
        for bounds in [
            [-3.0, 2.0, 17.0, 9.0],
            [100.0, -900.0, 130.0, -100.0],
            [5.0, 5.0, 5.0, 5.0],
        ] {
            let mut camera = Camera::default();
            camera.fit(screen(), bounds);
            let [low_x, low_y, high_x, high_y] = camera.visible_m(screen());
            assert!(low_x < bounds[0] && low_y < bounds[1], "{bounds:?}");
            assert!(high_x > bounds[2] && high_y > bounds[3], "{bounds:?}");
            let filled = ((bounds[2] - bounds[0]) / (high_x - low_x))
                .max((bounds[3] - bounds[1]) / (high_y - low_y));
            assert!(
                filled > 0.9 || bounds[2] - bounds[0] < 1.0,
                "{bounds:?} {filled}"
            );
        }
        let mut camera = Camera::default();
        camera.fit(screen(), [0.0, f64::NAN, 1.0, 1.0]);
        assert_eq!(camera, Camera::default());
    }
}
