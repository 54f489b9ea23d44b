//! Camera of the map: centre, scale and orientation.

use std::f64::consts::FRAC_PI_2;

use eframe::egui::{Pos2, Rect, Vec2, pos2, vec2};

/// A cell of 5 cm is 100 points wide.
const MAX_POINTS_PER_M: f64 = 2_000.0;
/// 40 km on a screen of 2000 points.
const MIN_POINTS_PER_M: f64 = 0.05;
const FIT_PART: f64 = 0.92;
/// Share of the shorter side of the screen that an approached object fills, and the maximum scale, points/m.
const APPROACHED_PART: f64 = 1.0 / 3.0;
const NEAREST_APPROACH: f64 = 40.0;
/// A map of one cell does not fill the screen.
const MIN_FIT_SIDE_M: f64 = 4.0;
/// Exact, so that cells of an unrotated map are at whole numbers.
const NORTH: [f64; 2] = [0.0, 1.0];

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    pub(super) screen: Rect,
    pub(super) center_m: [f64; 2],
    pub(super) points_per_m: f64,
    up: [f64; 2],
}

impl Default for Camera {
    fn default() -> Self {
        Self {
            screen: Rect::NOTHING,
            center_m: [0.0; 2],
            points_per_m: 40.0,
            up: NORTH,
        }
    }
}

impl Camera {
    #[cfg(test)]
    pub(super) fn on(screen: Rect) -> Self {
        Self {
            screen,
            ..Self::default()
        }
    }

    /// Direction that is up on the screen, radians, counter-clockwise from x.
    pub fn up_rad(&self) -> f64 {
        libm::atan2(self.up[1], self.up[0])
    }

    /// Rotates the map until this direction (radians) is up.
    pub fn turn_up(&mut self, up_rad: f64) {
        if (up_rad - FRAC_PI_2).abs() < 1e-9 {
            self.up = NORTH;
        } else if up_rad.is_finite() {
            let (sin, cos) = libm::sincos(up_rad);
            self.up = [cos, sin];
        }
    }

    pub fn to_screen(&self, [x_m, y_m]: [f64; 2]) -> Pos2 {
        let (dx, dy) = (x_m - self.center_m[0], y_m - self.center_m[1]);
        let [up_x, up_y] = self.up;
        let right = dx * up_y - dy * up_x;
        let ahead = dx * up_x + dy * up_y;
        let middle = self.screen.center();
        pos2(
            middle.x + (right * self.points_per_m) as f32,
            middle.y - (ahead * self.points_per_m) as f32,
        )
    }

    pub fn line(&self, points_m: &[[f64; 2]]) -> Vec<Pos2> {
        let points = points_m.iter().map(|point_m| self.to_screen(*point_m));
        points.collect()
    }

    pub fn to_odom(&self, at: Pos2) -> [f64; 2] {
        let [dx, dy] = self.offset_m(at - self.screen.center());
        [self.center_m[0] + dx, self.center_m[1] + dy]
    }

    /// Direction in `odom` (radians, counter-clockwise from x) as a unit vector on the screen.
    pub fn direction(&self, angle_rad: f64) -> Vec2 {
        let (sin, cos) = libm::sincos(angle_rad);
        let [up_x, up_y] = self.up;
        vec2(
            (cos * up_y - sin * up_x) as f32,
            -(cos * up_x + sin * up_y) as f32,
        )
    }

    /// Bounding box of the screen in `odom`: lowest and greatest x and y, m.
    pub fn visible_m(&self) -> [f64; 4] {
        let corners = [
            self.screen.left_bottom(),
            self.screen.right_bottom(),
            self.screen.right_top(),
            self.screen.left_top(),
        ]
        .map(|corner| self.to_odom(corner));
        around(&corners)
    }

    pub fn center_on(&mut self, point_m: [f64; 2]) {
        if point_m.iter().all(|edge| edge.is_finite()) {
            self.center_m = point_m;
        }
    }

    pub fn pan(&mut self, drag: Vec2) {
        let [dx, dy] = self.offset_m(drag);
        self.center_m[0] -= dx;
        self.center_m[1] -= dy;
    }

    /// Zooms by `factor` with the point at `at` fixed.
    pub fn zoom_about(&mut self, at: Pos2, factor: f64) {
        if !(factor.is_finite() && factor > 0.0) {
            return;
        }
        let held_m = self.to_odom(at);
        self.points_per_m = (self.points_per_m * factor).clamp(MIN_POINTS_PER_M, MAX_POINTS_PER_M);
        let moved_m = self.to_odom(at);
        self.center_m[0] += held_m[0] - moved_m[0];
        self.center_m[1] += held_m[1] - moved_m[1];
    }

    /// Shows a rectangle (lowest and greatest x and y, m) in a part of the screen.
    pub fn fit(&mut self, part: Rect, bounds_m: [f64; 4]) {
        let is_rectangle = bounds_m.iter().all(|m| m.is_finite());
        if !is_rectangle || part.width() < 1.0 || part.height() < 1.0 {
            return;
        }
        let [across_m, ahead_m] = self.size_m(bounds_m).map(|m| m.max(MIN_FIT_SIDE_M));
        let across = f64::from(part.width()) / across_m;
        let ahead = f64::from(part.height()) / ahead_m;
        self.points_per_m =
            (across.min(ahead) * FIT_PART).clamp(MIN_POINTS_PER_M, MAX_POINTS_PER_M);
        let [dx, dy] = self.offset_m(part.center() - self.screen.center());
        let [x, y] = middle(bounds_m);
        self.center_m = [x - dx, y - dy];
    }

    /// Centres a rectangle (lowest and greatest x and y, m); zooms in until it is easy to see.
    pub fn approach(&mut self, bounds_m: [f64; 4]) {
        let is_rectangle = bounds_m.iter().all(|m| m.is_finite());
        if !is_rectangle || self.screen.width() < 1.0 || self.screen.height() < 1.0 {
            return;
        }
        self.center_m = middle(bounds_m);
        let [across_m, ahead_m] = self.size_m(bounds_m);
        let [width, height] = [self.screen.width(), self.screen.height()].map(f64::from);
        let part = APPROACHED_PART * width.min(height) / across_m.max(ahead_m);
        let wanted = part.clamp(MIN_POINTS_PER_M, NEAREST_APPROACH);
        let scale = self.points_per_m / FIT_PART;
        let is_all_seen = across_m * scale <= width && ahead_m * scale <= height;
        if self.points_per_m < wanted || !is_all_seen {
            self.points_per_m = wanted;
        }
    }

    pub fn place_of(&self, bounds_m: [f64; 4]) -> Rect {
        let [across_m, ahead_m] = self.size_m(bounds_m);
        let size = vec2(
            (across_m * self.points_per_m) as f32,
            (ahead_m * self.points_per_m) as f32,
        );
        Rect::from_center_size(self.to_screen(middle(bounds_m)), size)
    }

    fn size_m(&self, [low_x, low_y, high_x, high_y]: [f64; 4]) -> [f64; 2] {
        let (dx, dy) = (high_x - low_x, high_y - low_y);
        let [up_x, up_y] = self.up.map(f64::abs);
        [dx * up_y + dy * up_x, dx * up_x + dy * up_y]
    }

    fn offset_m(&self, offset: Vec2) -> [f64; 2] {
        let right = f64::from(offset.x) / self.points_per_m;
        let ahead = -f64::from(offset.y) / self.points_per_m;
        let [up_x, up_y] = self.up;
        [right * up_y + ahead * up_x, ahead * up_y - right * up_x]
    }
}

fn middle([low_x, low_y, high_x, high_y]: [f64; 4]) -> [f64; 2] {
    [0.5 * (low_x + high_x), 0.5 * (low_y + high_y)]
}

pub(super) fn around(points: &[[f64; 2]]) -> [f64; 4] {
    let start = [
        f64::INFINITY,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NEG_INFINITY,
    ];
    points.iter().fold(start, |[lx, ly, hx, hy], [x, y]| {
        [lx.min(*x), ly.min(*y), hx.max(*x), hy.max(*y)]
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn screen() -> Rect {
        Rect::from_min_size(pos2(260.0, 30.0), vec2(1000.0, 700.0))
    }

    fn assert_near(a: [f64; 2], b: [f64; 2], limit_m: f64) {
        let is_near = (a[0] - b[0]).abs() < limit_m && (a[1] - b[1]).abs() < limit_m;
        assert!(is_near, "{a:?} is not {b:?}");
    }

    fn camera() -> impl Strategy<Value = Camera> {
        let center_m = [-1e4..1e4, -1e4..1e4];
        (center_m, -3.0..3.0, prop_oneof![Just(FRAC_PI_2), -4.0..4.0]).prop_map(
            |(center_m, log_scale, up_rad)| {
                let mut camera = Camera::on(screen());
                camera.center_on(center_m);
                camera.zoom_about(screen().center(), libm::exp(log_scale));
                camera.turn_up(up_rad);
                camera
            },
        )
    }

    proptest! {
        #[test]
        fn screen_and_odom_round_trip(
            camera in camera(),
            (x, y) in (0.0_f32..1300.0, 0.0_f32..800.0),
        ) {
            let point_m = camera.to_odom(pos2(x, y));
            let back = camera.to_screen(point_m);
            prop_assert!(back.distance(pos2(x, y)) < 1e-3, "{back:?}");
            let again_m = camera.to_odom(back);
            let limit_m = 1e-3 / camera.points_per_m;
            prop_assert!((again_m[0] - point_m[0]).abs() < limit_m);
            prop_assert!((again_m[1] - point_m[1]).abs() < limit_m);
        }

        #[test]
        fn the_dragged_point_stays_under_the_pointer(
            camera in camera(),
            (x, y) in (260.0_f32..1260.0, 30.0_f32..730.0),
            (dx, dy) in (-300.0_f32..300.0, -300.0_f32..300.0),
            factor in 0.1..10.0,
        ) {
            let at = pos2(x, y);
            let held_m = camera.to_odom(at);
            let mut zoomed = camera;
            zoomed.zoom_about(at, factor);
            prop_assert!(zoomed.to_screen(held_m).distance(at) < 1e-2);
            let mut panned = camera;
            panned.pan(vec2(dx, dy));
            let moved = panned.to_screen(held_m);
            prop_assert!(moved.distance(at + vec2(dx, dy)) < 1e-2);
        }

        #[test]
        fn a_fitted_rectangle_is_on_the_screen(
            camera in camera(),
            [x, y] in [-1e3..1e3, -1e3..1e3],
            [width, height] in [0.0..2e3, 0.0..2e3],
        ) {
            let mut camera = camera;
            let part = Rect::from_min_size(pos2(300.0, 50.0), vec2(400.0, 500.0));
            camera.fit(part, [x, y, x + width, y + height]);
            let place = camera.place_of([x, y, x + width, y + height]);
            prop_assert!(part.contains_rect(place), "{place}");
            for corner_m in [[x, y], [x + width, y], [x + width, y + height], [x, y + height]] {
                let corner = camera.to_screen(corner_m);
                prop_assert!(place.expand(0.1).contains(corner), "{corner:?}");
            }
            let [low_x, low_y, high_x, high_y] = camera.visible_m();
            prop_assert!(low_x <= x && low_y <= y && high_x >= x + width && high_y >= y + height);
        }

        #[test]
        fn directions_match_points(camera in camera(), angle_rad in -4.0..4.0) {
            let [x, y] = camera.center_m;
            let (sin, cos) = libm::sincos(angle_rad);
            let tip = camera.to_screen([x + cos, y + sin]);
            let expected = (tip - screen().center()) / camera.points_per_m as f32;
            prop_assert!((camera.direction(angle_rad) - expected).length() < 1e-2);
        }
    }

    #[test]
    fn north_is_up_unless_rotated() {
        let mut camera = Camera::on(screen());
        let middle = screen().center();
        assert_eq!(camera.to_screen([1.0, 2.0]), middle + vec2(40.0, -80.0));
        // East is up, north is left.
        camera.turn_up(0.0);
        let north = camera.to_screen([0.0, 1.0]);
        assert!(north.distance(middle + vec2(-40.0, 0.0)) < 1e-3);
        assert!(camera.up_rad().abs() < 1e-12);
        camera.turn_up(FRAC_PI_2);
        assert_eq!(camera, Camera::on(screen()), "exactly");
    }

    #[test]
    fn zoom_has_limits_and_ignores_invalid_factors() {
        let mut camera = Camera::on(screen());
        camera.zoom_about(screen().center(), 1e9);
        assert!((camera.points_per_m - MAX_POINTS_PER_M).abs() < 1e-9);
        camera.zoom_about(screen().center(), 1e-9);
        assert!((camera.points_per_m - MIN_POINTS_PER_M).abs() < 1e-9);
        let before = camera;
        for factor in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            camera.zoom_about(screen().center(), factor);
        }
        camera.center_on([f64::NAN, 0.0]);
        camera.turn_up(f64::NAN);
        for edge in [f64::INFINITY, f64::NAN] {
            camera.fit(screen(), [0.0, 0.0, edge, 1.0]);
            camera.approach([0.0, 0.0, edge, 1.0]);
        }
        camera.fit(Rect::NOTHING, [0.0, 0.0, 1.0, 1.0]);
        assert_eq!(camera, before);
        let mut unseen = Camera::on(Rect::NOTHING);
        unseen.approach([0.0, 0.0, 1.0, 1.0]);
        assert_eq!(unseen, Camera::on(Rect::NOTHING));
    }

    #[test]
    fn fit_fills_the_screen_except_for_tiny_maps() {
        let mut camera = Camera::on(screen());
        camera.fit(screen(), [0.0, 0.0, 50.0, 10.0]);
        assert_near(camera.center_m, [25.0, 5.0], 1e-9);
        assert!((camera.points_per_m - 20.0 * FIT_PART).abs() < 1e-9);
        camera.fit(screen(), [1.0, 1.0, 1.1, 1.1]);
        assert!((camera.points_per_m - 700.0 / MIN_FIT_SIDE_M * FIT_PART).abs() < 1e-9);
    }

    #[test]
    fn approach_zooms_to_a_third_of_the_screen() {
        let at_scale = |points_per_m: f64, bounds_m| {
            let mut camera = Camera::on(screen());
            let middle = screen().center();
            camera.zoom_about(middle, points_per_m / camera.points_per_m);
            camera.approach(bounds_m);
            assert_near(camera.center_m, middle_of(bounds_m), 1e-9);
            camera.points_per_m
        };
        // The screen is 1000 × 700 points.
        for (before, bounds_m, after) in [
            (0.5, [10.0, 10.0, 30.0, 15.0], 700.0 / 3.0 / 20.0),
            (0.5, [10.0, 10.0, 15.0, 30.0], 700.0 / 3.0 / 20.0),
            // Small rectangles are not enlarged beyond the maximum scale.
            (0.5, [10.0, 10.0, 11.0, 10.5], 40.0),
            (0.5, [10.0, 10.0, 10.0, 10.0], 40.0),
            (100.0, [10.0, 10.0, 11.0, 10.5], 100.0),
            // The current scale stays if all is visible.
            (30.0, [10.0, 10.0, 30.0, 15.0], 30.0),
            (100.0, [10.0, 10.0, 30.0, 15.0], 700.0 / 3.0 / 20.0),
        ] {
            let scale = at_scale(before, bounds_m);
            assert!(
                (scale - after).abs() < 1e-9,
                "{before} {bounds_m:?}: {scale}"
            );
        }
    }

    fn middle_of([low_x, low_y, high_x, high_y]: [f64; 4]) -> [f64; 2] {
        [
            low_x + 0.5 * (high_x - low_x),
            low_y + 0.5 * (high_y - low_y),
        ]
    }
}
